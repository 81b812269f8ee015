"""The SlotKind interface: one kind of things that a plan keeps clear of.

A problem holds slots of several kinds. A kind states the constraint of one slot, chooses at each
planning cycle which things of the kind get a slot, and holds plans against all of them. Assembly,
solvers, re-check and C export know this interface and no kind.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from inspect import getdoc
from math import hypot, isnan
from typing import Any, ClassVar, TypeAlias, final

import numpy as np

from ...robot import Robot
from ...values.arrays import Array, BoolArray
from ...values.coverage import Coverage
from ...values.forecast import Forecast
from ...values.motion import Observation, Pose
from ...values.tracks import Tracks
from ..levels.base import LevelPolicy, Promise, SharedLevel
from ..ocp.bodies import Body
from ..ocp.problem import Parameters, Problem, SlotNumbers, Slots
from ..ocp.reference import Reference
from ..ocp.stage import Frame
from ..ocp.transcription import Guess

CAPACITIES = (0, 1, 2, 5, 10, 20, 50, 100)
"""Slots that problems are compiled for: one obstacle in a problem made for 20 costs IPOPT
twice and fatrop three times the time."""

FAR, WIDE = 1e6, 1e4
"""m; largest distance of a mean from the robot, and largest standard deviation and radius, that a
solver is given. Squares of larger numbers drown all others, and a solver may then never end.
Nothing is lost: what is farther off is out of reach, and what is wider is everywhere."""

SlotSizes: TypeAlias = tuple[int, ...]
"""Sizes of the slots of one kind in a problem: their number, then what the kind defines."""


@dataclass(frozen=True, eq=False)
class PlanningContext:
    """Inputs of a planning cycle from which a kind chooses what to keep clear of.

    Attributes
    ----------
    observation : of this cycle.
    tracks, forecast : of the observed obstacles, on the plan's grid 1..N; None without any.
    times : (N,), s, of steps 1..N, on the clock of the observations.
    dt : s between steps. Times on a clock that counts in larger steps do not show it.
    reference : along the path, at steps 1..N.
    route : (2, N, D), m, places where the robot may be at each step: the reference, and where it
        is now.
    planned : (N, D), m, positions of the shifted last plan.
    own : (N, D, D), m^2, covariance of the robot's own position relative to the detections.
    own_on_map : (N, D, D), m^2, relative to the polygons.
    travel : (N,), m, how far from where it is its limits let it be at each step; infinite where
        that is not known.
    level : the planner's level policy.
    margin : m, added around the robot's bodies.
    wall_margin : m, the same before static polygons.
    aside : m, how far a plan may turn aside: half of what the reference covers.
    most : how many things of a kind a problem may hold.
    beyond : the forecast at steps N + 1..N + M, at which a robot that stands where its plan ends
        is to be clear as well; None where it need not.
    """

    observation: Observation
    tracks: Tracks | None
    forecast: Forecast | None
    times: Array
    dt: float
    reference: Reference
    route: Array
    planned: Array
    own: Array
    own_on_map: Array
    travel: Array
    level: LevelPolicy
    margin: float
    wall_margin: float
    aside: float
    most: int
    beyond: Forecast | None = None


@dataclass(frozen=True, eq=False)
class Touch:
    """How deep the bodies are in things on the way to each step.

    Attributes
    ----------
    depth : (N,), m; 0 where nothing is touched.
    names : of the thing that each is about.
    """

    depth: Array
    names: tuple[str, ...]

    @staticmethod
    def none(steps: int) -> "Touch":
        """Nothing is touched."""
        return _nothing(steps)

    def deeper(self, other: "Touch") -> "Touch":
        """Return the deeper of two contacts at each step."""
        if other is self or not (more := other.depth > self.depth).any():
            return self
        pairs = zip(self.names, other.names, more, strict=True)
        names = tuple(second if deep else first for first, second, deep in pairs)
        return Touch(np.where(more, other.depth, self.depth), names)


@lru_cache(maxsize=16)
def _nothing(steps: int) -> Touch:
    """Return the same contact for the same number of steps: most plans touch nothing."""
    depth = np.zeros(steps)
    depth.setflags(write=False)
    return Touch(depth, ("",) * steps)


class KnownObstacles(ABC):
    """Things of one kind that plans are verified against: at least those that have a slot."""

    @abstractmethod
    def touched(self, robot: Robot, states: Array) -> Touch:
        """How deep the robot's bodies enter these things on the way to each step.

        Parameters
        ----------
        robot : whose bodies move; its states may be more than the planner's robot has.
        states : (N + 1, n), a finite plan.
        """

    @abstractmethod
    def overlap(self, robot: Robot, states: Array) -> Array:
        """How deep the bodies are in the places expected at steps 1..N, (N,), m, 0 where clear.

        Manoeuvres that stop the robot are compared by it: it counts the things themselves, without
        the room that a region adds for their uncertainty.
        """


@final
@dataclass(frozen=True, eq=False)
class OutOfReach:
    """Things that no plan can meet, so that they need no slot; every plan keeps clear of them.

    Attributes
    ----------
    names : of them.
    level : (N, O), aimed at.
    """

    names: tuple[str, ...]
    level: Array


@final
@dataclass(frozen=True, eq=False)
class SlotAssignment:
    """Things of one kind in one planning cycle.

    Attributes
    ----------
    room : of the smallest problem that has room for them.
    names : of those that have a slot, slot by slot; slots behind them are empty, or ``lesser``.
    left_out : names of those that the problem has no room for.
    numbers : of all slots; the auxiliaries have width 0, see `with_auxiliaries`.
    known : the things that plans are held against, see the kind.
    out_of_reach : those that need no slot, of a `LevelledKind`; None for none.
    lesser : names of slots between the things and the empty ones that a plan says no level of.
    risk : largest probability that one of these things is met anywhere on a plan that keeps every
        slot at the level aimed at; nan where a kind promises none of whole plans.
    at_end : (K, P), parameters of all slots that the solver is given at step N instead, so that
        the next problem has a plan; None for the same. Plans are not verified against them.
    """

    room: SlotSizes
    names: tuple[str, ...]
    left_out: tuple[str, ...]
    numbers: SlotNumbers
    known: KnownObstacles
    out_of_reach: OutOfReach | None = None
    lesser: tuple[str, ...] = ()
    risk: float = float("nan")
    at_end: Array | None = None

    @property
    def called(self) -> tuple[str, ...]:
        """Names of all slots that are not empty."""
        return (*self.names, *self.lesser)


class SlotKind(ABC):
    """One kind of things that a plan keeps clear of.

    A kind is a frozen dataclass. Laws, checked by `wideberth.framework.testing.check_slot_kind`:
    numbers and constraints are finite; an empty slot changes nothing; slots may be permuted; the
    inequalities are positive where the robot is clear of a thing and negative inside it;
    auxiliaries start within their bounds and meet the equalities.
    """

    name: ClassVar[str]
    """Of one such thing, in lower case: part of reasons and of names in C."""

    coverage: ClassVar[Coverage | None] = None
    """What a plan promises that keeps its constraints; None where the level and forecast say."""

    @abstractmethod
    def bodies(self, robot: Robot) -> tuple[Body, ...]:
        """Bodies that stand for the robot before these things."""

    @abstractmethod
    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        """State the constraint of one slot in CasADi, see `ocp.stage.slots_of`.

        Parameters
        ----------
        room : what there is room for; () stands for none.
        frame : symbols of a stage.
        """

    @abstractmethod
    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Choose the things that get a slot, and fill the numbers of all slots.

        Empty slots hold a finite dummy: their mask multiplies it by zero, and zero times NaN
        would be NaN.

        Raises
        ------
        WideberthError : things are observed that this kind cannot keep clear of.
        """

    @abstractmethod
    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        """Best auxiliaries of every slot for NumPy poses (N, 1) of the robot, (N, K, A).

        The poses may be those of several plans, one after the other, and so the numbers.
        """

    @abstractmethod
    def explanation(self, dimension: int) -> str:
        """Say how the numbers of a slot are made, in Markdown, for users of the exported C."""


class LevelledKind(SlotKind):
    """A kind whose constraints have a level: a larger one keeps farther away."""

    @abstractmethod
    def levels(self, policy: LevelPolicy, steps: int, count: int, dimension: int) -> Array:
        """Levels that a policy aims at, (steps, count)."""

    @abstractmethod
    def tail(self, level: float, promise: Promise, dimension: int) -> float:
        """Probability that is not covered at a level; 1 below level 0."""


class SidedKind(SlotKind):
    """A kind that keeps plans on one side of each thing, that of the last plan.

    Behind a thing, however far away, its inequalities are negative.
    """


class SelectiveKind(SlotKind):
    """A kind that does not go with the settings of every planner."""

    @abstractmethod
    def refuse(self, level: LevelPolicy, penalty: float | None, most: int) -> None:
        """Refuse settings that do not go with it; ``most`` is how many things a problem may hold.

        Raises
        ------
        WideberthError : says which, and what to set instead.
        """


class GaussianKind(SlotKind):
    """A kind of things that are Gaussian in place; exported code may fill their slots itself."""

    @abstractmethod
    def parameters_of_one(self, robot: Robot, margin: float) -> Any:
        """Return a CasADi function of a thing's Gaussian to the parameters of its slot.

        Parameters
        ----------
        robot, margin : whom it is for, and m added around its bodies.

        Returns
        -------
        Function (mean (D), covariance (D, D), radius in m) -> (P).

        Raises
        ------
        WideberthError : the region states them in no closed form.
        """


@final
@dataclass(frozen=True, eq=False)
class ActiveObstacles:
    """Things of every kind that a plan is held against.

    Parameters
    ----------
    robot : whose bodies move.
    kinds, chosen : the kinds, and the things of each.
    """

    robot: Robot
    kinds: tuple[SlotKind, ...]
    chosen: tuple[SlotAssignment, ...]

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of all things that the problem has no room for."""
        return tuple(name for one in self.chosen for name in one.left_out)

    def names(self, problem: Problem) -> tuple[str, ...]:
        """Names of all slots of the problem, "?" where empty."""
        return tuple(
            name
            for one, slots in zip(self.chosen, problem.slots, strict=True)
            for name in (*one.called, *("?",) * (slots.count - len(one.called)))
        )

    @cached_property
    def levelled(self) -> tuple[tuple[LevelledKind, int, tuple[str, ...]], ...]:
        """Used slots with a level: a kind, which kind that is, the names of its first slots."""
        return tuple(
            (kind, k, one.names)
            for k, (kind, one) in enumerate(zip(self.kinds, self.chosen, strict=True))
            if isinstance(kind, LevelledKind)
        )

    @property
    def out_of_reach(self) -> tuple[tuple[LevelledKind, OutOfReach], ...]:
        """What needs no slot, of each kind that has such things."""
        return tuple(
            (kind, one.out_of_reach)
            for kind, one in zip(self.kinds, self.chosen, strict=True)
            if isinstance(kind, LevelledKind) and one.out_of_reach is not None
        )

    @property
    def risk(self) -> float:
        """Risk of a plan that keeps every slot, of the kinds that promise one; nan for none."""
        promised = [one.risk for one in self.chosen if not isnan(one.risk)]
        return sum(promised) if promised else float("nan")

    def touched(self, states: Array) -> Touch:
        """Hold a plan's states (N + 1, n) against everything that is known, also between steps."""
        found = Touch.none(len(states) - 1)
        if not np.isfinite(states).all():
            return found  # what is no number breaks the dynamics already
        for one in self.chosen:
            found = found.deeper(one.known.touched(self.robot, states))
        return found

    def overlap(self, states: Array) -> Array:
        """How deep the bodies are in the things' expected places at steps 1..N, (N,), m."""
        depth = np.zeros(len(states) - 1)
        for one in self.chosen:
            depth = np.maximum(depth, one.known.overlap(self.robot, states))
        return depth


def with_auxiliaries(
    robot: Robot, kinds: Sequence[SlotKind], parameters: Parameters, guess: Guess
) -> Guess:
    """Fill in the auxiliaries that suit the guess's poses best."""
    return with_auxiliaries_each(robot, kinds, parameters, [guess])[0]


def with_auxiliaries_each(
    robot: Robot, kinds: Sequence[SlotKind], parameters: Parameters, guesses: Sequence[Guess]
) -> list[Guess]:
    """Fill in those of several guesses; kinds see all their steps in one row."""
    if not guesses:
        return []
    states = np.concatenate([guess.states[1:] for guess in guesses])
    pose = robot.pose(tuple(states[:, None].T))  # (1, S N): every slot sees each step
    pose = Pose(
        tuple(entry.T for entry in pose.position), None if pose.heading is None else pose.heading.T
    )
    found: list[list[Array]] = [[] for _ in guesses]
    for kind, numbers in zip(kinds, parameters.slots, strict=True):
        steps, count = numbers.parameters.shape[:2]
        own = np.zeros((steps * len(guesses), 0, 0))
        if count:
            own = kind.auxiliary_start(robot, pose, _repeated(numbers, guesses))
        for place, auxiliaries in enumerate(found):
            auxiliaries.append(np.array(own[steps * place : steps * (place + 1)]))
    return [
        replace(guess, auxiliaries=tuple(auxiliaries))
        for guess, auxiliaries in zip(guesses, found, strict=True)
    ]


def _repeated(numbers: SlotNumbers, guesses: Sequence[Guess]) -> SlotNumbers:
    """Numbers of slots for the steps of several guesses, each at its own level if it has one."""
    given, count = numbers.level, len(guesses)
    level = None
    if given is not None:
        levels = [
            given if np.isnan(guess.level) else np.full_like(given, guess.level)
            for guess in guesses
        ]
        level = np.concatenate(levels)
    return replace(
        numbers,
        parameters=np.concatenate([numbers.parameters] * count),
        auxiliaries=np.concatenate([numbers.auxiliaries] * count),
        level=level,
    )


def level_at_first(kinds: Iterable[SlotKind], policy: LevelPolicy, dimension: int) -> float:
    """Level that a policy aims at; that of the first kind with levels, nan without one."""
    for kind in kinds:
        if isinstance(kind, LevelledKind):
            return float(kind.levels(policy, 1, 1, dimension)[0, 0])
    return float("nan")


def shared_target(kinds: Iterable[SlotKind], policy: LevelPolicy, dimension: int) -> float:
    """Return s_ref, the level that a shared level is drawn to; nan where none is shared."""
    if not isinstance(policy, SharedLevel):
        return float("nan")
    return level_at_first(kinds, policy, dimension)


def farthest(bodies: Iterable[Body]) -> float:
    """How far centres and corners of some bodies are from the robot's position, m."""
    places = [place for body in bodies for place in (body.centre, *body.outline)]
    return max((hypot(*place) for place in places), default=0.0)


def quoted(plugin: Any) -> str:
    """Quote the documentation of a plug-in and of its method ``parameters``, in Markdown."""
    kind = type(plugin)
    texts = (getdoc(kind), getdoc(kind.parameters))
    lines = "\n\n".join(text for text in texts if text).splitlines()
    return (
        f"They are made by `parameters` of `{kind.__module__}.{kind.__name__}`, of which Python's "
        "documentation says:\n\n" + "\n".join(f"> {line}".rstrip() for line in lines)
    )


def next_capacity(count: int) -> int:
    """Return the smallest of `CAPACITIES` with room for ``count``."""
    return next(size for size in CAPACITIES if size >= count)


def active_slots(count: int, capacity: int) -> Array:
    """Mask of the slots: 1 for the first ``count``, 0 for the empty ones, (capacity,)."""
    active: BoolArray = np.arange(capacity) < count
    return active.astype(np.float64)
