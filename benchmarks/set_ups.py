"""The set-ups that are compared: a solver, the region it is given, its deadline, its starts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from importlib.util import find_spec
from typing import Any, TypeAlias

import acados_program
from paper_program import PaperProgram
from sqp_program import SETTINGS, Sqp

from wideberth.benchmarks.recorded_instances import ELLIPSE, EXACT, unicycle
from wideberth.framework import names
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.starts import other_starts
from wideberth.framework.mpc.planner.watchdog import SAME
from wideberth.framework.mpc.solver import Solution, Solver, pressed, solve_cheapest
from wideberth.framework.plugins.config import build
from wideberth.framework.values.plan import Status

PAPER, HONEST = "paper_mx", "ipopt_sx"
"""The references: the paper's program on MX graphs, and the same on SX."""
OWN = "riccati"
"""The solver of this project."""
TOLERANCE = 1e-6
"""Of every solver, in its own measure of optimality."""
CAP = 0.45
"""s, the paper's deadline."""
Starts: TypeAlias = Callable[[Problem, Parameters, Guess], Sequence[Guess]]


@dataclass(frozen=True)
class SetUp:
    """A solver with its settings.

    Attributes
    ----------
    solver : how the problem is solved.
    region : which constraint is given to it.
    deadline : s, or None.
    starts : makes further starting points; None to take the instance's own alone.
    rounds : most repeats of one instance, where more would be a waste of time; None for all.
    """

    solver: Solver
    region: str = ELLIPSE
    deadline: float | None = None
    starts: Starts | None = None
    rounds: int | None = None

    def solve(self, problem: Problem, parameters: Parameters, guess: Guess) -> Solution:
        """Solve from one starting point or several; of several keep the cheapest that converged.

        Others are tried as the planner does: where regions press on the first plan, and while they
        may lead to a cheaper one.

        Iterations are those of all starts together.
        """
        found = self.solver.solve(problem, parameters, [guess], self.deadline)
        if self.starts is not None and pressed(found[0]):
            others = self.starts(problem, parameters, guess)
            given = self.solver, problem, parameters, others, found
            found += solve_cheapest(*given, SAME * unicycle().radius, self.deadline)
        solved = [one for one in found if one.status is Status.SOLVED]
        best = min(solved, key=lambda one: one.cost, default=found[0])
        return replace(best, iterations=sum(one.iterations for one in found))


def set_ups() -> dict[str, SetUp]:
    """Return the references, every registered solver on both regions, and the peers."""
    paper = PaperProgram("mx", TOLERANCE)
    found = {
        PAPER: SetUp(paper),
        f"{PAPER}, 450 ms": SetUp(paper, deadline=CAP, rounds=1),
        HONEST: SetUp(PaperProgram("sx", TOLERANCE)),
    }
    for name, peer in peers(TOLERANCE).items():
        # Those take up to seconds: twice is enough of that.
        found[name] = SetUp(peer, rounds=2 if name.startswith("sqpmethod") else None)
    solvers = registered()
    found |= {name: SetUp(solver) for name, solver in solvers.items()}
    for name, solver in solvers.items():
        # The others run into their limits where s ends at 0: twice is enough of that.
        found[f"{name}, exact"] = SetUp(solver, EXACT, rounds=None if name == OWN else 2)
    if OWN in solvers:
        found[f"{OWN}, several starts"] = SetUp(solvers[OWN], starts=several)
    return found


def registered() -> dict[str, Solver]:
    """Return every registered solver, at the common tolerance where it has such a setting."""
    solvers: dict[str, Any] = {name: build("solvers", name) for name in names("solvers")}
    for name, solver in solvers.items():
        if "tolerance" in {field.name for field in fields(solver)}:
            solvers[name] = replace(solver, tolerance=TOLERANCE)
    return solvers


def several(problem: Problem, parameters: Parameters, guess: Guess) -> list[Guess]:
    """Return all starting points that the planner has beside the instance's own guess."""
    return other_starts(unicycle(), problem, parameters, guess)  # the ellipse has no auxiliaries


def peers(tolerance: float) -> dict[str, Solver]:
    """Return the peers that are installed here; their problems are compiled when first solved."""
    found: dict[str, Solver] = {}
    lacking = missing()
    if "do-mpc" not in lacking:
        from do_mpc_program import DoMpcProgram

        found["do-mpc"] = DoMpcProgram(tolerance)
    if "acados" not in lacking:
        found["acados"] = acados_program.AcadosProgram(tolerance)
    return found | {f"sqpmethod, {qp}": Sqp(qp, tolerance) for qp in SETTINGS}


def missing() -> dict[str, str]:
    """Return why each peer that is left out is left out, by name."""
    do_mpc = "" if find_spec("do_mpc") else "not installed (dependency group `bench`)"
    found = {"do-mpc": do_mpc, "acados": acados_program.missing()}
    return {name: why for name, why in found.items() if why}
