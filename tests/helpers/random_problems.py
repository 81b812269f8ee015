"""Random problems of any size: several kinds of slots, with and without own variables."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers, Slots
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins.registry import load
from wideberth.framework.region import Auxiliary
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.tests.helpers.problems import assemble

ROBOTS = (
    "unicycle", "bicycle", "differential_drive", "holonomic", "holonomic_velocity",
    "unicycle_velocity", "holonomic_3d",
)  # fmt: skip
KINDS = ("disc", "line", "tied")


@dataclass(frozen=True)
class Draw:
    """What a problem is made of; ``repr`` reproduces it."""

    robot: str
    steps: int
    counts: tuple[int, ...]
    shared: bool
    penalty: float | None
    iterations: int
    seed: int

    def make(self) -> tuple[Problem, Parameters, Guess]:
        """Make the problem, its numbers and a guess."""
        rng, robot = np.random.default_rng(self.seed), load("robots", self.robot)()
        level = Relaxed(weight=10.0, minimum=0.0) if self.shared else Fixed()
        plain = assemble(
            robot, MahalanobisEllipse(), level, horizon=self.steps, dt=0.2, capacity=0,
            penalty=self.penalty, stop_at_end=bool(self.seed % 2),
        )  # fmt: skip
        kinds = tuple(
            _slots(plain, kind, count) for kind, count in zip(KINDS, self.counts, strict=False)
        )
        problem = replace(plain, slots=kinds)
        n, d = problem.states, problem.dimension
        along = np.zeros((self.steps, d))
        along[:, 0] = 1.0
        reference = 0.1 * np.cumsum(along, axis=0)
        numbers = tuple(_numbers(slots, self.steps, d, rng) for slots in kinds)
        parameters = Parameters(
            np.zeros(n), reference, along, np.full(self.steps, 0.5), numbers,
            np.zeros((self.steps, problem.curve)),
        )  # fmt: skip
        states = np.zeros((self.steps + 1, n))
        states[1:, :d] = reference + 0.05 * rng.normal(size=(self.steps, d))
        own = tuple(one.auxiliaries for one in numbers)
        start = Guess(
            states, np.zeros((self.steps, problem.inputs)), own, 1.0 if self.shared else np.nan,
            np.zeros(self.steps),
        )  # fmt: skip
        return problem, parameters, start


def draws() -> Iterator[Draw]:
    """Yield problems of every robot, 1 to 3 kinds, 0 to 40 slots, 1 to 100 steps."""
    rng = np.random.default_rng(0)
    steps = (1, 2, 7, 8, 9, 15, 16, 23, 30, 60, 100)
    for k in range(44):
        counts = tuple(int(c) for c in rng.choice([0, 1, 3, 8], size=1 + k % 3))
        if k == 5:
            counts = (40,)
        yield Draw(
            ROBOTS[k % len(ROBOTS)], steps[k % len(steps)], counts, bool(k % 2),
            (None, 1e3)[k // 2 % 2], (200, 12)[k // 4 % 2], k,
        )  # fmt: skip


def _slots(problem: Problem, kind: str, count: int) -> Slots:
    """One kind: discs, separating lines with an own angle, or lines tied by an equality."""
    x, d = ca.SX.sym("x", problem.states), problem.dimension
    s = ca.SX.sym("s", int(problem.shared))
    own = {
        "disc": Auxiliary(),
        "line": Auxiliary((-np.inf,), (np.inf,), (0.0,), 1e-3),
        "tied": Auxiliary((0.0, -2.0), (np.inf, 2.0), (0.7, 0.7), 1e-3),
    }[kind]
    a, numbers = ca.SX.sym("a", len(own)), ca.SX.sym("numbers", d + 1 + 1 + len(own))
    off, reach = x[:d] - numbers[:d], numbers[d] * (1.0 + 0.1 * ca.sum1(s))
    equalities = ca.SX(0, 1)
    if kind == "disc":
        inequalities = ca.dot(off, off) / reach**2 - 1.0
    elif kind == "line":
        inequalities = ca.cos(a[0]) * off[0] + ca.sin(a[0]) * off[1] - reach
    else:
        away = a[0] * off[0] + a[1] * off[1]
        inequalities = ca.vertcat(away - reach, 9.0 - away)
        equalities = a[0] ** 2 + a[1] ** 2 - 1.0
    active = numbers[d + 1]
    stated = [ca.if_else(active > 0, inequalities, 1.0), active * equalities]
    constraint = ca.Function("constraint", [x, a, s, numbers], stated)
    return Slots(kind, count, d + 1, False, own, constraint)


def _numbers(slots: Slots, steps: int, dimension: int, rng: np.random.Generator) -> SlotNumbers:
    count = slots.count
    parameters = np.zeros((steps, count, dimension + 1))
    parameters[..., :dimension] = rng.normal(scale=3.0, size=(count, dimension))
    parameters[..., 1] += 2.0
    parameters[..., dimension] = rng.uniform(0.2, 0.6, count)
    active = (rng.uniform(size=count) < 0.8).astype(float)
    own = np.array(slots.auxiliary.start, dtype=np.float64)
    begun = np.broadcast_to(own, (steps, count, len(own))).copy()
    return SlotNumbers(parameters, active, begun, None)
