"""Recorded solves on the command line: what happened, and what another solver makes of it."""

from pathlib import Path

from ...framework.mpc.diagnosis.explain import compared
from ...framework.mpc.diagnosis.solve_record import read_solve
from ...framework.values.errors import WideberthError


def explained(target: Path, solver: str | None) -> list[str]:
    """Lines about one recorded solve, or about all in a folder.

    Parameters
    ----------
    target : either file of a pair, or a folder of pairs.
    solver : what to solve again with; the recorded one by default.

    Raises
    ------
    WideberthError : no recorded solve there, or one that cannot be opened.
    """
    if target.is_dir():
        files = sorted(target.glob("solve-*.json"))
        if not files:
            raise WideberthError(f"{target} holds no recorded solve (solve-*.json)")
        return [line for file in files for line in (*_one(file, solver), "")][:-1]
    if target.suffix not in ("", ".json", ".npz"):
        raise WideberthError(
            f"{target} is no recorded solve; wanted a .json or .npz file of one, or their folder"
        )
    return _one(target, solver)


def _one(path: Path, solver: str | None) -> list[str]:
    solve = read_solve(path)
    again = f"solved again with {solver or 'the recorded solver'}:"
    solutions = solve.again(solver)
    return [str(path.with_suffix(".json")), solve.text(), again, *compared(solve, solutions)]
