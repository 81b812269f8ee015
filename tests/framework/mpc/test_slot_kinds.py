"""Kinds of things to keep clear of: their laws, and one of a user's own through everything."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path as File
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest

from wideberth.controllers.diagnosis.explain import SolveRecord
from wideberth.controllers.diagnosis.solve_record import read_solve, write_solve
from wideberth.controllers.slots.drawn_futures import DrawnFutures
from wideberth.controllers.slots.ways import Ways
from wideberth.framework.mpc.ocp.problem import SlotNumbers, Slots
from wideberth.framework.mpc.ocp.stage import Frame
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.slots.base import (
    ActiveObstacles,
    LevelledKind,
    PlanningContext,
    SlotAssignment,
    SlotKind,
    SlotSizes,
    Touch,
)
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.mpc.slots.static_polygons import StaticPolygons
from wideberth.framework.mpc.solver import Solver
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.robot import Robot
from wideberth.framework.testing.laws import require
from wideberth.framework.testing.slot_kind import check_slot_kind, sample_view
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Pose
from wideberth.framework.values.plan import Rung, Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.static.dual import Dual
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.export.bundle import bundle, write_folder
from wideberth.solvers.export.subject import Subject
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.solvers.riccati.solver import Riccati

EXAMPLES = File(__file__).resolve().parents[3] / "examples"
sys.path.insert(0, str(EXAMPLES))
carts: ModuleType = import_module("my_slot_kind")
sys.path.remove(str(EXAMPLES))

CART = carts.CART
KINDS: list[SlotKind] = [
    GaussianDiscs(MahalanobisEllipse()),
    GaussianDiscs(MinkowskiSum()),
    Ways(MahalanobisEllipse()),
    Ways(MinkowskiSum()),
    DrawnFutures(),
    StaticPolygons(StaticSeparatingLine()),
    StaticPolygons(Dual()),
    carts.Carts({"a": CART, "b": CART[:3], "c": CART}),
]


LAWS = [law.name for law in check_slot_kind.laws(KINDS[0])]


def check(kind: SlotKind, name: str) -> None:
    """Check one law of a kind."""
    require(law for law in check_slot_kind.laws(kind) if law.name == name)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_a_kind_keeps_the_law(kind: SlotKind, law: str) -> None:
    check(kind, law)


# every law can fail

Spoil = Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Spoilt(LevelledKind):
    """A sound kind, one answer of which is spoilt by a function of it and its first argument."""

    method: str
    spoil: Spoil
    named: str = "obstacle"

    inner: ClassVar[GaussianDiscs] = GaussianDiscs(MinkowskiSum())

    @property
    def name(self) -> str:  # type: ignore[override]
        return self.named

    @property
    def coverage(self) -> Any:  # type: ignore[override]
        return self._told("coverage", None, None)

    def _told(self, method: str, found: Any, given: Any) -> Any:
        return self.spoil(found, given) if method == self.method else found

    def bodies(self, robot: Robot) -> Any:
        return self.inner.bodies(robot)

    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        found: Slots = self._told("slots", self.inner.slots(room, frame), room)
        return found

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        found: SlotAssignment = self._told("choose", self.inner.choose(robot, view), view)
        return found

    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        found = self.inner.auxiliary_start(robot, pose, numbers)
        return np.asarray(self._told("auxiliary_start", found, numbers))

    def levels(self, policy: Any, steps: int, count: int, dimension: int) -> Array:
        found = self.inner.levels(policy, steps, count, dimension)
        return np.asarray(self._told("levels", found, policy))

    def tail(self, level: float, promise: Any, dimension: int) -> float:
        return float(self._told("tail", self.inner.tail(level, promise, dimension), level))

    def explanation(self, dimension: int) -> str:
        return str(self._told("explanation", self.inner.explanation(dimension), dimension))


def with_numbers(chosen: SlotAssignment, **changes: Any) -> SlotAssignment:
    return replace(chosen, numbers=replace(chosen.numbers, **changes))


def with_rows(slots: Slots, change: Callable[..., Any]) -> Slots:
    """The same slots with other inequalities: change(x, auxiliaries, numbers, inequalities)."""
    given = [ca.SX.sym("v", slots.constraint.size1_in(i)) for i in range(4)]
    free, tied = slots.constraint(*given)
    other = change(given[0], given[1], given[3], free)
    return replace(slots, constraint=ca.Function("constraint", given, [other, tied]))


@dataclass(frozen=True, eq=False)
class Contact:
    """Contact of a fixed depth with a thing of a name."""

    depth: float
    thing: str

    def touched(self, robot: Robot, states: Array) -> Touch:
        steps = len(states) - 1
        return Touch(np.full(steps, self.depth), (self.thing,) * steps)

    def overlap(self, robot: Robot, states: Array) -> Array:
        return np.zeros(len(states) - 1)


def with_a_kink(x: Any, auxiliaries: Any, numbers: Any, free: Any) -> Any:
    """The same inequalities, with a slope that is not a number."""
    return free + ca.sqrt(ca.fmax(-(x[0] ** 2), 0))


def in_their_order(chosen: SlotAssignment, view: PlanningContext) -> SlotAssignment:
    """The first thing, of whatever name, gets wider numbers."""
    numbers = chosen.numbers.parameters.copy()
    numbers[:, 0] *= 1.5
    return with_numbers(chosen, parameters=numbers)


BROKEN: dict[str, list[Spoilt]] = {
    "name": [Spoilt("", max, "Big Cart"), Spoilt("", max, "level")],
    "what it promises is stated": [Spoilt("coverage", lambda one, _: "all people")],
    "sizes": [
        Spoilt("slots", lambda one, _: replace(one, width=one.width + 1)),
        Spoilt("slots", lambda one, _: replace(one, levelled=False)),
        Spoilt("choose", lambda one, _: replace(one, names=one.names[:-1])),
        Spoilt("choose", lambda one, _: with_numbers(one, active=one.numbers.active[::-1])),
        Spoilt("slots", lambda one, room: one if room else replace(one, count=1)),
    ],
    "finite": [
        Spoilt(
            "choose", lambda one, _: with_numbers(one, parameters=one.numbers.parameters * np.nan)
        ),
        Spoilt("slots", lambda one, _: with_rows(one, lambda x, a, p, h: ca.sqrt(h - 1e3))),
        Spoilt(
            "slots",
            lambda one, _: with_rows(
                one, lambda x, a, p, h: h + ca.sqrt(ca.fmax(-(x[0] ** 2), 0))
            ),
        ),
    ],
    "empty": [
        Spoilt("slots", lambda one, _: with_rows(one, lambda x, a, p, h: h + 1e-3 * x[0])),
        Spoilt("slots", lambda one, _: with_rows(one, lambda x, a, p, h: 2.0 * h)),
    ],
    "auxiliaries": [
        Spoilt("auxiliary_start", lambda one, _: one + 1e6),
        Spoilt("auxiliary_start", lambda one, _: one - 1e6),
        Spoilt("auxiliary_start", lambda one, _: one[::-1]),
    ],
    "inside": [Spoilt("slots", lambda one, _: with_rows(one, lambda x, a, p, h: h**2))],
    "outside": [Spoilt("slots", lambda one, _: with_rows(one, lambda x, a, p, h: -h))],
    "levels": [
        Spoilt("tail", lambda one, _: 1.0 - one),
        Spoilt("tail", lambda one, level: one if level >= 0.0 else 0.5),
        Spoilt("levels", lambda one, _: one + 0.1),
        Spoilt("slots", lambda one, _: with_rows(one, lambda x, a, p, h: -h)),
        Spoilt("slots", lambda one, _: with_rows(one, lambda x, a, p, h: 0.0 * h + x[0])),
    ],
    "order": [
        Spoilt("choose", in_their_order),
        Spoilt("choose", lambda one, _: replace(one, names=("a", "b", "c"))),
    ],
    "left out": [
        Spoilt("choose", lambda one, _: replace(one, left_out=())),
    ],
    "contact": [
        Spoilt("choose", lambda one, _: replace(one, known=Contact(np.nan, "a"))),
        Spoilt("choose", lambda one, _: replace(one, known=Contact(-1.0, "a"))),
        Spoilt("choose", lambda one, _: replace(one, known=Contact(1.0, "nobody"))),
    ],
    "explanation": [Spoilt("explanation", lambda one, _: "")],
}


def test_every_law_is_broken_by_something() -> None:
    assert [*BROKEN, "frozen"] == LAWS  # which is of all kinds of values, and tested there


@pytest.mark.parametrize(
    ("law", "kind"),
    [
        pytest.param(law, one, id=f"{law}-{i}")
        for law in BROKEN
        for i, one in enumerate(BROKEN[law])
    ],
)
def test_a_law_can_fail(law: str, kind: Spoilt) -> None:
    with pytest.raises(AssertionError) as caught:
        check(kind, law)
    assert "breaks a law" not in str(caught.value)  # `require` and the command line say it


# a kind of a user's own goes through everything


@pytest.fixture(scope="module")
def solve() -> SolveRecord:
    """What the planner of the example solves: discs, no polygon, and a cart."""
    made = carts.planner(penalty=1e4)
    plan = carts.drive(made)
    assert plan.rung is Rung.OPTIMAL, plan.reason
    found: SolveRecord = made.explain()
    assert [one.name for one in found.problem().slots] == ["obstacle", "polygon", "cart"]
    return found


@pytest.mark.parametrize(
    "solver",
    [Ipopt(), Fatrop(), Riccati()],
    ids=repr,
)
def test_every_solver_takes_it(solver: Solver, solve: SolveRecord) -> None:
    _takes(solver, solve)


def _takes(solver: Solver, solve: SolveRecord) -> None:
    problem = solve.problem()
    (found,) = solver.solve(problem, solve.parameters, solve.guesses[:1])
    assert found.status is Status.SOLVED and not found.stand_in, found
    assert violation(problem, solve.parameters, found.point).worst < 1e-4
    (other,) = Fatrop(tolerance=1e-8).solve(problem, solve.parameters, solve.guesses[:1])
    np.testing.assert_allclose(found.point.states, other.point.states, atol=2e-4)
    for own, wanted in zip(found.point.auxiliaries, other.point.auxiliaries, strict=True):
        assert own.shape == wanted.shape


def test_the_cart_matters_and_the_re_check_sees_it(solve: SolveRecord) -> None:
    problem, *slots = solve.problem(), *solve.parameters.slots
    off = replace(slots[2], active=np.zeros_like(slots[2].active))
    free = replace(solve.parameters, slots=(slots[0], slots[1], off))
    (without,) = Fatrop().solve(problem, free, solve.guesses[:1])
    assert without.status is Status.SOLVED
    entered = violation(problem, solve.parameters, without.point).regions
    assert entered[:, -1].max() > 0.05  # the last slot is the cart's
    assert solve.names[-1] == "cart"


def test_a_cart_on_the_way_is_touched_between_the_steps() -> None:
    """Two steps of 4 m: at neither the robot is at the cart, which stands in between."""
    kind, view, robot = KINDS[-1], sample_view(), Unicycle(radius=0.2)
    around = ActiveObstacles(robot, (kind,), (kind.choose(robot, view),))
    states = np.zeros((len(view.reference.position) + 1, 5))
    states[:, :2] = (0.0, 0.4)
    states[2:, 0] = 4.0
    touch = around.touched(states)
    assert touch.names[1] == "a" and touch.depth[1] > 0.2
    assert not touch.depth[2:].any() and not around.overlap(states).any()


def test_it_is_recorded_and_opens_again(solve: SolveRecord, tmp_path: File) -> None:
    again = read_solve(write_solve(tmp_path / "one", solve))
    assert again.rooms == solve.rooms and again.problem().key == solve.problem().key
    np.testing.assert_array_equal(again.parameters.stages(), solve.parameters.stages())
    assert "1 carts in 1 slots" in again.text()


@pytest.mark.skipif(
    shutil.which("cc") is None or shutil.which("make") is None,
    reason="no C compiler with make here",
)
def test_the_exported_c_knows_it(solve: SolveRecord, tmp_path: File) -> None:
    made = carts.planner(penalty=1e4)
    subject = Subject(
        solve.problem(), solve.parameters, solve.guesses[0], made.robot, made.kinds, made.cost,
        solve.planner, "my_slot_kind, planner",
    )  # fmt: skip
    folder = tmp_path / "c"
    write_folder(folder, bundle(subject), force=False)
    text = (folder / "wideberth.h").read_text()
    for word in ("WIDEBERTH_CARTS 1", "wideberth_cart_hessian(", "wideberth_nlp_cart_auxiliaries"):
        assert word in text
    done = subprocess.run(["make"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "all results agree" in done.stdout, done.stderr
