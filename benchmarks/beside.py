"""Time whole decisions of two checkouts in turn, and compare their commands and plans.

    python benchmarks/beside.py ../old/wideberth

Each checkout decides in a process of its own, with its own virtual environment, what
`decision.Drive` of this checkout asks: some decisions here, as many there, and so on, so that both
meet the same load of the machine. Both decide on one core: those of a shared machine are seldom
equally fast. Times are processor time of the process. The first decisions of a turn find the
processor's caches filled by the other checkout. `PAIRS` says which predictors are compared.
"""

import argparse
import os
import subprocess
import sys
from hashlib import sha256
from itertools import product
from pathlib import Path
from statistics import median

import numpy as np

HERE = Path(__file__).resolve().parents[1]
SEEN = (1, 3, 10, 40)
PAIRS = (("recommended", "recommended"), ("kalman", "kalman"), ("kalman", "recommended"))
"""Predictors of the other checkout and of this one, of `decision.PREDICTORS`."""


def main() -> int:
    """Compare; or, asked by another process, decide."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("other", type=Path)
    parser.add_argument("--drives", type=int, default=3)
    parser.add_argument("--turns", type=int, default=30)
    parser.add_argument("--at-once", type=int, default=5, help="decisions of a turn")
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.serve:
        return serve()
    size = asked.drives, asked.turns, asked.at_once
    same = [
        compared(asked.other.resolve(), pair, seen, *size) for pair, seen in product(PAIRS, SEEN)
    ]
    return int(not all(same))


def compared(
    other: Path, predictors: tuple[str, str], seen: int, drives: int, turns: int, at_once: int
) -> bool:
    """Print the ratio of this checkout to another one.

    Returns
    -------
    Whether they decide the same; those with different predictors are not asked for that.
    """
    ratios, same = [], True
    both = Served(other), Served(HERE)
    for drive in range(drives):
        for one, predictor in zip(both, predictors, strict=True):
            one.ask(f"{predictor} {seen} {drive}")
        for turn in range(turns):
            order = both if turn % 2 else both[::-1]
            found = {one: one.ask(f"{at_once}").split() for one in order}
            there, here = (found[one] for one in both)
            same &= there[1] == here[1]
            ratios.append(float(here[0]) / float(there[0]))
    low, high = np.quantile(ratios, [0.25, 0.75])
    before, after = predictors
    words = f"{after}, {seen} seen: {median(ratios):.3f} of the time of {before} there"
    same |= before != after
    alike = f"; the same bytes: {same}" if before == after else ""
    print(f"{words}, quartiles {low:.3f} to {high:.3f}{alike}", flush=True)
    for one in both:
        one.end()
    return same


class Served:
    """A checkout that decides when it is asked."""

    def __init__(self, folder: Path) -> None:
        command = [folder / ".venv" / "bin" / "python", __file__, folder, "--serve"]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def ask(self, line: str) -> str:
        """Send a line, and return the answer."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()
        return self._process.stdout.readline().strip()

    def end(self) -> None:
        """Let it go."""
        self._process.communicate()


def serve() -> int:
    """Answer lines: a predictor and two numbers begin a drive, a number asks for decisions."""
    from decision import PREDICTORS, Drive

    from wideberth.framework.control.rate_limited_warnings import quiet

    if sys.platform == "linux":
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever else is printed
    with quiet():
        for predictor in PREDICTORS:  # imports and compiles
            Drive(predictor, SEEN[0], 0)
        drive = None
        for line in sys.stdin:
            words = line.split()
            if len(words) == 3:
                drive = Drive(words[0], int(words[1]), int(words[2]))
                print("begun", file=answers, flush=True)
                continue
            assert drive is not None
            decisions = [drive.decide() for _ in range(int(words[0]))]
            said = sha256()
            for _, (command, plan) in decisions:
                said.update(repr((command, str(plan.rung), plan.ids, plan.reason)).encode())
                for array in (plan.states, plan.inputs, plan.level, plan.content):
                    said.update(np.ascontiguousarray(array).tobytes())
            print(sum(taken for taken, _ in decisions), said.hexdigest(), file=answers, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
