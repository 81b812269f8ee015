"""What a solve that is cut short is worth: one to three Newton steps, or one QP per decision.

    python benchmarks/real_time.py --hertz 20 2 --seeds 0 1 2 3 4 5 6 7 8 9

The robot crosses the walkers of `walker_field.Field`; all plan from the last plan alone. Table
one: while converged `riccati` drives, each of the others solves the same instances from the same
guess, which is the shifted converged plan with its multipliers. Table two: each drives by itself,
behind the planner's check and its fallback ladder.
"""

import argparse
import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from time import thread_time

import numpy as np
from measuring import Row, markdown
from set_ups import ELLIPSE, TOLERANCE, unicycle
from sqp_program import Sqp
from warm_start import crossing

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.values.plan import Rung, Status
from wideberth.solvers.riccati.solver import Riccati

CONVERGED = "riccati, converged"
ALLOWED = 1e-4
"""Largest violation of a plan that the planner accepts."""
SECONDS, FAR = 90.0, 7.0
"""s, the longest drive; m, where it ends, from which on no walker is met."""


def solvers() -> dict[str, Solver]:
    """Return the converged solver, and those that stop short."""
    cut: dict[str, Solver] = {
        f"riccati, {count} step{'s' * (count > 1)}": Riccati(iterations=count)
        for count in (1, 2, 3)
    }
    return {CONVERGED: Riccati(), **cut, "one QP": Sqp("piqp", TOLERANCE, iterations=1)}


@dataclass(eq=False)
class Beside(Solver):
    """Returns what the first solver finds; the others solve the same, and ``rows`` keeps all.

    Only guesses with multipliers count: they continue a plan that was optimal.
    """

    candidates: dict[str, Solver]
    label: str
    rows: list[Row] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess."""
        return [self._one(problem, parameters, guess) for guess in guesses]

    def _one(self, problem: Problem, parameters: Parameters, guess: Guess) -> Solution:
        (best,) = self.candidates[CONVERGED].solve(problem, parameters, [guess])
        if guess.multipliers is None or best.status is not Status.SOLVED:
            return best
        limits = np.array(problem.input_bounds.upper)
        kept = violation(problem, parameters, best.point).worst
        for name, solver in self.candidates.items():
            begin = thread_time()
            (found,) = solver.solve(problem, parameters, [guess])
            spent = 1e6 * (thread_time() - begin)
            off = np.abs(found.point.inputs[0] - best.point.inputs[0]) / limits
            worst = violation(problem, parameters, found.point).worst
            row = {"rate": self.label, "solver": name, "us": spent, "off": float(off.max())}
            self.rows.append(row | {"worst": worst, "possible": kept <= ALLOWED})
        return best


def beside(hertz: float, seeds: Sequence[int]) -> list[Row]:
    """Compare plans on the decisions of the converged solver."""
    solver = Beside(solvers(), f"{hertz:g} Hz")
    for seed in seeds:
        for _ in crossing(_planner(solver, hertz), seed, hertz, SECONDS, FAR):
            pass
    rows = []
    for name in solver.candidates:
        own = [row for row in solver.rows if row["solver"] == name]
        off = [row["off"] for row in own]
        possible = [row for row in own if row["possible"]]
        reference = [row["us"] for row in solver.rows if row["solver"] == CONVERGED]
        rows.append({
            "rate": solver.label, "solver": name, "solves": len(own),
            "breaks_1e-4": float(np.mean([row["worst"] > ALLOWED for row in possible])),
            "first_input_off_median": float(np.median(off)),
            "first_input_off_p95": float(np.percentile(off, 95)),
            "time": float(np.median([row["us"] for row in own]) / np.median(reference)),
        })  # fmt: skip
    return rows


def alone(hertz: float, seeds: Sequence[int]) -> list[Row]:
    """Let each drive by itself, seed for seed."""
    rows = []
    for name, solver in solvers().items():
        arrived, touched, gaps, rungs = 0, 0, [], Counter[Rung]()
        for seed in seeds:
            planner = _planner(solver, hertz)
            least, reached = np.inf, -np.inf
            for gap, place in crossing(planner, seed, hertz, SECONDS, FAR):
                least, reached = min(least, gap), place
                assert planner.plan is not None
                rungs[planner.plan.rung] += 1
            arrived, touched = arrived + (reached >= FAR), touched + (least < 0.0)
            gaps.append(least)
        total = sum(rungs.values())
        rows.append({
            "rate": f"{hertz:g} Hz", "solver": name, "drives": len(seeds), "arrived": arrived,
            "touched": touched, "least_gap_median_m": float(np.median(gaps)),
            "s": total / hertz / len(seeds),
            "own_plan": (rungs[Rung.OPTIMAL] + rungs[Rung.FEASIBLE]) / total,
            "last_plan": rungs[Rung.SHIFTED] / total,
            "brake": (rungs[Rung.LEAST] + rungs[Rung.BRAKE]) / total,
        })  # fmt: skip
    return rows


def _planner(solver: Solver, hertz: float) -> Planner:
    return Planner(
        unicycle(), build("regions", ELLIPSE), build("predictors", "kalman"),
        build("levels", "relaxed"), solver, period=1.0 / hertz, penalty=1e5,
        starts=(),
    )  # fmt: skip


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hertz", type=float, nargs="+", default=[20.0, 2.0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    asked = parser.parse_args()
    logging.getLogger("wideberth").setLevel(logging.CRITICAL)  # the tables count the same
    compared = [row for hertz in asked.hertz for row in beside(hertz, asked.seeds)]
    print(markdown("On the decisions of the converged solver", compared), flush=True)
    driven = [row for hertz in asked.hertz for row in alone(hertz, asked.seeds)]
    print(markdown("Each by itself", driven))


if __name__ == "__main__":
    main()
