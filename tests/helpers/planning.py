"""What the tests of the planner share: one that follows a straight path, and what it sees."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wideberth import recommended
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Status
from wideberth.predictors.kalman import Kalman
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop

STRAIGHT = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))


def planner(**changes: Any) -> Planner:
    settings: dict[str, Any] = {
        "robot": Unicycle(),
        "region": MahalanobisEllipse(),
        "predictor": Kalman(),
        "level": Relaxed(weight=100.0, minimum=0.0),
        "solver": Fatrop(),
        "penalty": 1e4,
        **changes,
    }
    made = Planner(**settings)
    made.set_path(STRAIGHT)
    if isinstance(made.solver, Failing):
        made.solver.calls.clear()  # those of the warm-up
    return made


def at(
    time: float, x: float, *seen: tuple[str, float, float], y: float = 0.0, v: float = 0.5
) -> Observation:
    detections = tuple(
        Detection(name, np.array([a, b]), 1e-4 * np.eye(2), 0.75) for name, a, b in seen
    )
    return Observation(time, np.array([x, y, 0.0, v, 0.0]), detections)


def approach(made: Planner, ticks: int = 6, gap: float = 9.0) -> Plan:
    """The robot drives on while another one comes towards it."""
    for k in range(ticks):
        made.command(at(0.5 * k, 0.25 * k, ("other", gap - 0.25 * k, 0.8)))
    assert made.plan is not None
    return made.plan


@dataclass(frozen=True)
class Failing(Solver):
    """Solves the first calls and then returns what it is told to."""

    good: int = 3
    status: Status = Status.INFEASIBLE
    calls: list[int] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.calls.append(1)
        solutions = Fatrop().solve(problem, parameters, guesses, deadline)
        if len(self.calls) <= self.good:
            return solutions
        wild = [replace(s.point, inputs=s.point.inputs * 0 + 9.0) for s in solutions]
        return [
            replace(s, point=w, status=self.status, message="told to fail")
            for s, w in zip(solutions, wild, strict=True)
        ]


def past_a_walker() -> Planner:
    """Return the recommended planner after a command past a walker who crosses the path."""
    planner = recommended("unicycle", 0.5, quiet=True)
    planner.set_path(Path([(0, 0), (12, 0)]))
    for k in range(-20, 1):
        walker = Detection("walker", (5.0, 0.25 * k - 1.0), 4e-4 * np.eye(2), 0.3)
        observation = Observation(0.5 * k, (0, 0, 0, 0.5, 0), (walker,))
        planner.remember(observation)
    planner.command(observation)
    return planner
