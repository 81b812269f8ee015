"""The contract of a SlotKind, checked among obstacles and polygons that stand still."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from ..mpc.levels.fixed import Fixed
from ..mpc.ocp.problem import Parameters, SlotNumbers, Slots
from ..mpc.ocp.reference import Reference
from ..mpc.ocp.stage import Frame
from ..mpc.ocp.transcription import Guess
from ..mpc.slots.base import (
    LevelledKind,
    PlanningContext,
    SidedKind,
    SlotAssignment,
    SlotKind,
    with_auxiliaries_each,
)
from ..numerics.symbolic import ca
from ..plugins.registry import load
from ..robot import Robot
from ..values.arrays import Array
from ..values.forecast import Forecast
from ..values.motion import Detection, Observation
from ..values.polygon import Polygon
from ..values.tracks import Tracks
from .laws import Contract, Law, check_coverage, law, stated

STEPS, COUNT = 40, 3
PLACES = np.array([[2.0, 0.4], [-1.5, 1.5], [0.5, -2.2]])
"""m, of the things of the sample; the robot is put on and between them."""
NEAR, FAR = 1e-3, 60.0
"""m; contact deeper than the one, and a distance larger than the other, are beyond doubt."""


def sample_view() -> PlanningContext:
    """Three obstacles "a", "b", "c" and three polygons of the same names that stand still."""
    names = ("a", "b", "c")
    mean = np.repeat(PLACES[:, None], STEPS, axis=1)
    spread = np.array([[0.05, 0.02], [0.02, 0.03]])
    covariance = np.broadcast_to(spread, (COUNT, STEPS, 2, 2))
    corners = np.array([[-0.5, -0.3], [0.5, -0.3], [0.4, 0.5]])
    polygons = tuple(
        Polygon(tuple(map(tuple, (corners + place).tolist())), name)
        for place, name in zip(PLACES, names, strict=True)
    )
    seen = tuple(
        Detection(name, place, 1e-4 * np.eye(2), 0.3)
        for name, place in zip(names, PLACES, strict=True)
    )
    position = np.zeros((STEPS, 2))
    direction = np.tile([1.0, 0.0], (STEPS, 1))
    return PlanningContext(
        observation=Observation(0.0, np.zeros(5), seen, polygons=polygons),
        tracks=_tracks(np.repeat(PLACES[:, None], 2, axis=1), names),
        forecast=Forecast.single(mean, covariance, 0.5),
        times=0.5 * np.arange(1, STEPS + 1, dtype=np.float64),
        dt=0.5,
        reference=Reference(position, direction, np.full(STEPS, 0.5), np.zeros((STEPS, 0))),
        route=np.stack([position, position]),
        planned=position,
        own=np.zeros((STEPS, 2, 2)),
        own_on_map=np.zeros((STEPS, 2, 2)),
        travel=np.full(STEPS, np.inf),
        level=Fixed(0.05),
        margin=0.1,
        wall_margin=0.1,
        aside=10.0,
        most=5,
    )


@dataclass(frozen=True, eq=False)
class Sample:
    """A kind among things, and a robot at random poses on and between them.

    Attributes
    ----------
    kind, view, robot : what is checked, and where.
    """

    kind: SlotKind
    view: PlanningContext
    robot: Robot

    @cached_property
    def chosen(self) -> SlotAssignment:
        """The things that the kind chooses."""
        return self.kind.choose(self.robot, self.view)

    @property
    def frame(self) -> Frame:
        """State and pose as symbols; no level is shared."""
        x = ca.SX.sym("x", len(self.robot.states))
        return Frame(self.robot, x, self.robot.pose(tuple(ca.vertsplit(x))), ca.SX(0, 1))

    @cached_property
    def slots(self) -> Slots:
        """The constraint of a slot."""
        return self.kind.slots(self.chosen.room, self.frame)

    @cached_property
    def states(self) -> Array:
        """Random states at steps 0..N, (N + 1, n); the first ones are at the things."""
        rng = np.random.default_rng(0)
        states = np.zeros((STEPS + 1, len(self.robot.states)))
        states[:, :2] = rng.uniform(-4.0, 4.0, (STEPS + 1, 2))
        states[1 : COUNT + 1, :2] = PLACES
        states[:, 2] = rng.uniform(-np.pi, np.pi, STEPS + 1)
        return states

    def auxiliaries(self, states: Array, numbers: SlotNumbers) -> Array:
        """Return starting values of the auxiliaries, (N, K, A)."""
        return self.auxiliaries_each([states], numbers)[0]

    def auxiliaries_each(self, every: Sequence[Array], numbers: SlotNumbers) -> list[Array]:
        """Return those of several plans, asked for at once."""
        at = self.view.reference
        along = at.position, at.direction, at.speed
        parameters = Parameters(every[0][0], *along, (numbers,), at.curve)
        inputs = np.zeros((STEPS, len(self.robot.inputs)))
        bare = [Guess.bare(states, inputs, float("nan")) for states in every]
        found = with_auxiliaries_each(self.robot, [self.kind], parameters, bare)
        return [one.auxiliaries[0] for one in found]

    def rows(
        self, states: Array, numbers: SlotNumbers, lifted: Array | None = None
    ) -> tuple[Array, Array]:
        """Inequalities and equalities of every slot at steps 1..N, (N, K, rows)."""
        if lifted is None:
            lifted = self.auxiliaries(states, numbers)
        columns = replace(numbers, auxiliaries=lifted).stages()
        count = len(numbers.active)
        free, tied = [], []
        for state, own, given in zip(states[1:], lifted, columns, strict=True):
            pairs = zip(own, given.reshape(count, -1), strict=True)
            rows = [self.slots.constraint(state, one, [], other) for one, other in pairs]
            free.append([np.asarray(one, dtype=np.float64).ravel() for one, _ in rows])
            tied.append([np.asarray(one, dtype=np.float64).ravel() for _, one in rows])
        return np.array(free), np.array(tied)

    def lowest(self, states: Array, numbers: SlotNumbers) -> Array:
        """Lowest inequality of all used slots at steps 1..N, (N,)."""
        free = self.rows(states, numbers)[0][:, numbers.active > 0]
        return np.asarray(free.reshape(STEPS, -1).min(axis=1))

    def depth(self, state: Array) -> float:
        """How deep a robot that stands is in any thing, by geometry, m."""
        still = np.tile(state, (STEPS + 1, 1))
        known = self.chosen.known
        touched = known.touched(self.robot, still).depth
        return float(np.maximum(known.overlap(self.robot, still), touched)[-1])

    @law("name")
    def has_a_name_for_c(self) -> None:
        """Demand a name that can be part of a name in C."""
        name = self.kind.name
        assert re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name), f"the name is {name!r}"
        assert name not in ("level", "state", "input", "nlp"), f"{name!r} has another meaning in C"

    @law("what it promises is stated")
    def states_its_coverage(self) -> None:
        """Demand a `Coverage`, or None."""
        check_coverage(self.kind.coverage)

    @law("sizes")
    def sizes_fit(self) -> None:
        """Slots and numbers have the sizes that the room says; levels are there where stated."""
        chosen, slots, numbers = self.chosen, self.slots, self.chosen.numbers
        count, levelled = chosen.room[0], isinstance(self.kind, LevelledKind)
        wanted = STEPS, count, slots.width
        assert slots.count == count, (
            f"the room is {chosen.room}, and there are {slots.count} slots"
        )
        assert numbers.parameters.shape == wanted, (
            f"numbers are {numbers.parameters.shape}; {wanted}"
        )
        assert slots.levelled == (numbers.level is not None) == levelled, (
            "levels: some say so, not all"
        )
        if numbers.level is not None:
            assert numbers.level.shape == wanted[:2], f"levels are {numbers.level.shape}"
        found = self.auxiliaries(self.states, numbers).shape
        assert found == (STEPS, count, len(slots.auxiliary)), f"auxiliaries are {found}"
        kept = np.arange(count) < len(chosen.called)
        assert np.array_equal(numbers.active, kept), "used slots stand first, one for each name"
        assert not self.kind.slots((), self.frame).count, "without room there are slots"

    @law("finite")
    def numbers_are_finite(self) -> None:
        """Numbers, constraints and their slopes are finite, also in empty slots."""
        numbers = self.chosen.numbers
        assert np.isfinite(numbers.stages()).all(), "numbers must be finite, also of empty slots"
        lifted = self.auxiliaries(self.states, numbers)
        for shift in (0.0, 3.0):  # also where auxiliaries are beyond their bounds
            for rows in self.rows(self.states, numbers, lifted + shift):
                assert np.isfinite(rows).all(), "rows must be finite wherever a solver may look"
        given = [ca.SX.sym("v", self.slots.constraint.size1_in(i)) for i in range(4)]
        rows = ca.vertcat(*self.slots.constraint(*given))
        slope = ca.Function("slope", given, [ca.jacobian(rows, ca.vertcat(*given[:2]))])
        columns = replace(numbers, auxiliaries=lifted).stages()
        columns = columns.reshape(STEPS, len(numbers.active), -1)
        for i, state in enumerate(self.states[1:]):
            for own, column in zip(lifted[i], columns[i], strict=True):
                value = np.asarray(slope(state, own, [], column))
                assert np.isfinite(value).all(), "slopes must be finite wherever a solver may look"

    @law("empty")
    def empty_slots_are_neutral(self) -> None:
        """Demand that an empty slot states 1 >= 0, whatever it holds and wherever the robot is."""
        numbers = self.chosen.numbers
        off = replace(numbers, active=np.zeros_like(numbers.active))
        free, tied = self.rows(self.states, off)
        assert (free == 1.0).all(), "an empty slot states 1 >= 0"
        moved, still = self.rows(self.states + 1.0, off, self.auxiliaries(self.states, off))
        assert (moved == 1.0).all(), "an empty slot states 1 >= 0"
        assert np.array_equal(tied, still), "the equalities of an empty slot depend on the robot"

    @law("auxiliaries")
    def auxiliaries_start_well(self) -> None:
        """Auxiliaries start within their bounds, meet the equalities, and know no other plan."""
        numbers, own = self.chosen.numbers, self.slots.auxiliary
        lifted = self.auxiliaries(self.states, numbers)
        inside = (lifted >= np.array(own.lower) - 1e-9) & (lifted <= np.array(own.upper) + 1e-9)
        assert inside.all(), "auxiliaries must start within their bounds"
        tied = self.rows(self.states, numbers)[1][:, numbers.active > 0]
        worst = float(np.abs(tied).max(initial=0.0))
        assert worst < 1e-6, f"auxiliaries start off the equalities by {worst:.2g}"
        back = self.states[::-1]
        pair = self.auxiliaries_each([self.states, back], numbers)
        alone = [lifted, self.auxiliaries(back, numbers)]
        same = np.array_equal(pair, alone)
        assert same, "auxiliaries of two plans at once are others than those of each"

    @law("inside")
    def inside_is_negative(self) -> None:
        """Where the robot stands in a thing, by geometry, an inequality is negative."""
        depths = np.array([self.depth(state) for state in self.states[1:]])
        lowest = self.lowest(self.states, self.chosen.numbers)
        assert (depths > NEAR).any(), "the robot stands on every thing, and touches none of them"
        wrong = (depths > NEAR) & (lowest >= 0.0)
        assert not wrong.any(), (
            f"{depths[wrong].max(initial=0.0):.2g} m deep, and no row is negative"
        )

    @law("outside", lambda kind: not isinstance(kind, SidedKind), "it keeps plans on one side")
    def outside_is_positive(self) -> None:
        """Far away and clear every inequality is positive; without levels, wherever it is clear.

        A thing without an end, such as a half plane, is not clear everywhere that is far away.
        """
        away = self.states.copy()
        away[:, :2] += FAR * np.where(away[:, :2] < 0.0, -1.0, 1.0)
        clear = np.array([self.depth(state) == 0.0 for state in away[1:]])
        assert clear.any(), f"the robot stands in a thing wherever it is {FAR:g} m away"
        least = float(self.lowest(away, self.chosen.numbers)[clear].min())
        assert least > 0.0, f"{FAR:g} m away a row is {least:.2g}; wanted above 0"
        if isinstance(self.kind, LevelledKind):
            return
        exact = replace(self, view=replace(self.view, margin=0.0, wall_margin=0.0))
        lowest = exact.lowest(self.states, exact.chosen.numbers)
        clear = np.array([exact.depth(state) == 0.0 for state in self.states[1:]])
        assert clear.any(), "the robot stands in a thing at every pose of the sample"
        least = float(lowest[clear].min())
        assert least > -NEAR, f"the robot is clear, and a row is {least:.2g}"

    @law("levels", LevelledKind, "it has no levels")
    def larger_levels_keep_farther(self) -> None:
        """Demand that a larger level lowers the inequalities, and has a smaller tail."""
        kind, numbers = self.kind, self.chosen.numbers
        assert isinstance(kind, LevelledKind) and numbers.level is not None  # see `sizes_fit`
        rows, tails = [], []
        for share in (0.0, 0.5, 1.0, 1.5):
            level = share * numbers.level
            rows.append(self.lowest(self.states, replace(numbers, level=level)))
            tails.append(kind.tail(float(level[0, 0]), "content", 2))
        assert (np.diff(rows, axis=0) < 1e-9).all(), "a larger level must not come nearer"
        assert (np.diff(rows, axis=0) < -1e-6).any(), "a larger level must keep farther away"
        falling = np.diff(tails) < 0.0
        assert falling.all() and 0.0 <= tails[-1] <= tails[0] <= 1.0, f"tails are {tails}"
        assert kind.tail(-1.0, "content", 2) == 1.0, "below level 0 the tail is 1"
        aimed = kind.levels(self.view.level, STEPS, 1, 2)
        assert np.allclose(aimed, numbers.level[:, :1]), "slots have the level that is aimed at"

    @law("order")
    def order_changes_nothing(self) -> None:
        """Demand the same numbers for the same things in another order, and when asked again."""
        view = self.view
        again = self.kind.choose(self.robot, view)
        same = np.array_equal(again.numbers.stages(), self.chosen.numbers.stages())
        assert same and again.names == self.chosen.names, "the same view, and another choice"
        other = self.kind.choose(self.robot, _reversed(view))
        assert sorted(other.names) == sorted(self.chosen.names), "another order, and other things"
        first, second = (_by_name(one) for one in (self.chosen, other))
        for name, values in first.items():
            assert np.array_equal(values, second[name]), f"another order, and {name!r} is another"

    @law("left out")
    def what_does_not_fit_is_named(self) -> None:
        """With room for one or none the others are left out by name."""
        for most in (0, 1):
            fewer = replace(self, view=replace(self.view, most=most))
            chosen = fewer.chosen
            assert len(chosen.names) == most, f"room for {most}, and {len(chosen.names)} are kept"
            missing = set(self.chosen.names) - {*chosen.names, *chosen.left_out}
            assert not missing, f"{sorted(missing)} have no room and are not named"

    @law("contact")
    def contact_is_a_depth(self) -> None:
        """Contact has one finite number, at least 0, per step; touching names a thing."""
        known = self.chosen.known
        touch = known.touched(self.robot, self.states)
        for depth in (touch.depth, known.overlap(self.robot, self.states)):
            assert depth.shape == (STEPS,), f"contact has shape {depth.shape}; wanted ({STEPS},)"
            assert np.isfinite(depth).all() and (depth >= 0.0).all(), (
                "depths are finite, at least 0"
            )
        for depth, name in zip(touch.depth, touch.names, strict=True):
            assert not depth or name in self.chosen.names, f"{name!r} is touched; which is that?"

    @law("explanation")
    def is_explained(self) -> None:
        """Demand an explanation of the numbers for users of the exported C."""
        text = self.kind.explanation(2)
        assert len(text.split()) > 5, f"the explanation is {text!r}"


@Contract
def check_slot_kind(
    kind: SlotKind, view: PlanningContext | None = None, robot: Robot | None = None
) -> Iterator[Law]:
    """Check the laws of a kind of things to keep clear of.

    Parameters
    ----------
    kind : to be checked.
    view : with three things of the kind at `PLACES` that stand still; by default `sample_view`,
        which has obstacles and polygons called "a", "b" and "c" there.
    robot : a unicycle of radius 0.4 m by default.

    Raises
    ------
    AssertionError : names every law that does not hold.
    """

    @cache
    def samples() -> tuple[Sample]:
        moved: Robot = load("robots", "unicycle")(radius=0.4) if robot is None else robot
        sample = Sample(kind, sample_view() if view is None else view, moved)
        found = len(sample.chosen.names)
        assert found > 1, (
            f"of the sample's things it chose {found}; wanted at least two. Set its fields so "
            "that it does (obstacles and polygons are called a, b and c), or give "
            "`check_slot_kind` a view with things of the kind"
        )
        return (sample,)

    return stated(Sample, kind, samples)


def _tracks(positions: Array, names: tuple[str, ...]) -> Tracks:
    """Tracks of obstacles of one size."""
    noise = np.tile(1e-4 * np.eye(2), (COUNT, 1, 1))
    return Tracks(positions, 0.5, names, np.full(COUNT, 0.3), noise)


def _reversed(view: PlanningContext) -> PlanningContext:
    """Return the same things in the opposite order."""
    seen = view.observation
    observation = replace(seen, detections=seen.detections[::-1], polygons=seen.polygons[::-1])
    tracks, forecast = view.tracks, view.forecast
    if tracks is not None and forecast is not None:
        tracks = _tracks(tracks.positions[::-1], tracks.ids[::-1])
        mean, covariance = forecast.mean[::-1, 0], forecast.covariance[::-1, 0]
        forecast = Forecast.single(mean, covariance, forecast.dt)
    return replace(view, observation=observation, tracks=tracks, forecast=forecast)


def _by_name(chosen: SlotAssignment) -> dict[str, Array]:
    """Numbers of the used slots by name, those of one name in the order of their size."""
    count = len(chosen.numbers.active)
    stages = chosen.numbers.stages().reshape(STEPS, count, -1)
    found: dict[str, list[list[float]]] = {}
    for k, name in enumerate(chosen.names):
        found.setdefault(name, []).append(stages[:, k].ravel().tolist())
    return {name: np.array(sorted(rows)) for name, rows in found.items()}
