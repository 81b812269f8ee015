"""A wrapper: a robot that stands before another one that stands too makes room after a while."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from ..framework.control.command_limits import within_bounds
from ..framework.controller import (
    Controller,
    DrivesRobot,
    checked_path,
    checked_ready,
    checked_use,
    noted,
    own_copy,
    usable,
)
from ..framework.robot import Robot
from ..framework.tracking.stand_ins import sound
from ..framework.values.arrays import Array
from ..framework.values.motion import Command, Detection, Observation
from ..framework.values.path import Path
from ..framework.values.path_progress import PathProgress
from ..framework.values.plan import Plan
from ..framework.values.polygon import separation

STILL = 2.0
"""s over which the robot and the other one are looked at."""
STUCK, STANDING = 0.15, 0.3
"""m that the robot, and the other one, have moved at most in this time."""
NEAR, AWAY = 1.5, 2.0
"""m between the surfaces: another body is near; the way is free again."""
HALT, HALTED = 0.6, 0.12
"""s, m: who has moved no more in this time has come to a halt."""
PRECEDENCE = 0.0, 3.0
"""s, range of the drawn time that a robot waits after both have come to a halt."""
HESITATION = 0.0, 2.0
"""s, range of the drawn time before the robot withdraws."""
ABSENCE = 4.0, 8.0
"""s, range of the drawn time that it stays away at most."""
RETREATS = 2.0, 1.5, 1.0
"""m that it withdraws."""
DIRECTIONS = 24
"""In which it may withdraw."""
ROOM = 0.05
"""m beside the bodies on the way there."""
LEFT = 0.3
"""m of path to go at which the robot stands because it has arrived."""
SAME_GOAL = 0.3
"""m between the goals of two paths up to which the second is the first one planned anew."""


@dataclass(eq=False)
class _Memory:
    """What the wrapper holds between two calls."""

    path: Path | None = None
    progress: PathProgress | None = None
    followed: Path | None = None
    away: bool = False
    known: "DeadlockResolver" = field(default_factory=lambda: DeadlockResolver())


@final
@dataclass(frozen=True, eq=False)
class Withdrawing(Controller):
    """Lets another controller drive, and leads it out of deadlocks.

    While the robot withdraws or waits, see `DeadlockResolver`, the other controller follows a
    short way instead of its path. The reason of the plan then names whom the robot withdraws from,
    and where to, or for whom it waits.

    Parameters
    ----------
    controller : of any kind that knows its robot; the wrapper drives a copy of its own.

    Raises
    ------
    WideberthError : a controller that does not know its robot.
    """

    controller: Controller
    _memory: _Memory = field(init=False, repr=False, default_factory=_Memory)

    def __post_init__(self) -> None:
        object.__setattr__(self, "controller", own_copy(self.controller, "withdrawing.controller"))

    @property
    def robot(self) -> Robot:
        """The robot of the other controller."""
        assert isinstance(self.controller, DrivesRobot)
        return self.controller.robot

    @property
    def period(self) -> float:  # type: ignore[override]
        """Time between two calls, s, as of the other controller."""
        return self.controller.period

    def reset(self) -> None:
        """Forget everything but settings and path."""
        memory = self._memory
        memory.known = DeadlockResolver()
        self.controller.reset()
        if memory.path is not None:
            self._follow(memory.path, away=False)
            memory.progress = PathProgress(memory.path)

    def set_path(self, path: Path) -> None:
        """Follow this path from now on; to the same goal, a withdrawal goes on."""
        path, memory = checked_path(self.robot, path), self._memory
        memory.known = memory.known.on(path, memory.path)
        memory.path, memory.progress = path, (memory.progress or PathProgress(path)).on(path)
        self._follow(memory.known.way or path, away=memory.known.way is not None)

    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without deciding."""
        self.controller.remember(observation)

    def command(self, observation: Observation) -> Command:
        """Decide as the other controller does, on the path or on the way out of a deadlock.

        Raises
        ------
        WideberthError : wrong use, see `Controller`.
        """
        memory = self._memory
        progress = checked_ready(memory.progress)
        checked_use(self.robot, observation)
        if usable(observation):
            memory.progress, memory.known = self._looked(progress, observation)
            if memory.known.way is not None:
                self._follow(memory.known.way, away=True)
            elif memory.away:  # on the rest of the path, which may cross itself
                self._follow(memory.progress.rest, away=False)
        return self.controller.command(observation)

    def _looked(
        self, progress: PathProgress, observation: Observation
    ) -> tuple[PathProgress, "DeadlockResolver"]:
        """Return the progress along the path, and what is known after an observation.

        Whatever the observation holds, nothing is raised: then nothing is known of a deadlock.
        """
        robot = self.robot
        try:
            state = within_bounds(robot, observation.state)
            place = np.array(robot.pose(tuple(state)).position, dtype=np.float64)
            progress, arc = progress.advanced(place)
            left = progress.path.length - arc
            return progress, self._memory.known.after(observation, place, robot.radius, left)
        except Exception:
            return progress, DeadlockResolver()

    @property
    def last_plan(self) -> Plan | None:
        """The other controller's plan; its reason says where the robot withdraws to."""
        return noted(self.controller.last_plan, self._memory.known.note)

    def _follow(self, way: Path, *, away: bool) -> None:
        """Hand a way to the other controller, if it is another one than before.

        Parameters
        ----------
        way : from now on. away : whether it is a way out of a deadlock.
        """
        self._memory.away = away
        if way is not self._memory.followed:
            self._memory.followed = way
            self.controller.set_path(way)


@final
@dataclass(frozen=True, eq=False)
class Snapshot:
    """Where the robot and the others were at one instant.

    Attributes
    ----------
    stamp : s.
    place : (D,), m, of the robot.
    others : identity -> (D,), m.
    """

    stamp: float
    place: Array
    others: dict[str, Array]


@final
@dataclass(frozen=True, eq=False)
class Wait:
    """A robot lets the other go first that came to a halt when it did.

    Attributes
    ----------
    other : identity of who may go.
    place : (D,), m, where the robot waits.
    end : s.
    way : the point to stay at, as a way of 1 cm; None from the end of the wait on. Then the wait
        is kept until the robot has moved, so that it does not begin again at the same place.
    """

    other: str
    place: Array
    end: float
    way: Path | None


@final
@dataclass(frozen=True, eq=False)
class Withdrawal:
    """A robot waits to withdraw, or has begun to.

    Attributes
    ----------
    other : identity of whom it stands before.
    begin, end : s.
    way : to where it withdraws; None while it hesitates.
    there : (D,), m, where the other one was when the robot set out; None while it hesitates.
    """

    other: str
    begin: float
    end: float
    way: Path | None = None
    there: Array | None = None


@final
@dataclass(frozen=True, eq=False)
class DeadlockResolver:
    """Recognises that the robot and another body near it stand still, and withdraws.

    Each of two planners forecasts that the other stays where it is, for a while, and plans to
    withdraw later; the first step of such a plan is to stand, and the next plan says the same.
    Here a withdrawal is carried out. Two that do move come to a halt at the same time and set out
    again at the same time, since each sees the other stand; so each lets the other go first, for
    a drawn time. The rule, for each robot alone:

    0. robot and nearest other, within `NEAR` m, have both come to a halt in the last `HALT` s and
       both moved before that: the robot waits for a time drawn from `PRECEDENCE`, or until the
       other one is `AWAY` m from it, and not again before it has moved;

    1. the robot has moved less than `STUCK` m in `STILL` s, is not at the end of its path, and
       another body within `NEAR` m has moved less than `STANDING` m;
    2. it hesitates for a time drawn from `HESITATION`; if 1 then still holds of the same other,
    3. it follows a straight way of at most 2 m to the place, free of others and of walls, that
       is farthest from the line through both, instead of its path, as the planner follows any
       path;
    4. back on its path it goes after a time drawn from `ABSENCE`, or as soon as the other one has
       passed the place from which it withdrew and the surfaces are `AWAY` m apart. Being far
       apart is not enough: where both have withdrawn, both would come back at once.

    The times are drawn from a generator that hangs on the robot's own state and clock, which no
    other robot shares. So two equal planners hesitate for different times, and the same
    observations give the same bytes.

    Attributes
    ----------
    seen : of the last `STILL` s, oldest first.
    withdrawal : under way; None while there is none.
    wait : under way, or over at the place where the robot still is; None while there is none.
    """

    seen: tuple[Snapshot, ...] = ()
    withdrawal: Withdrawal | None = None
    wait: Wait | None = None

    @property
    def way(self) -> Path | None:
        """What it follows while it withdraws or waits; None while it follows its path."""
        if self.withdrawal is not None and self.withdrawal.way is not None:
            return self.withdrawal.way
        return None if self.wait is None else self.wait.way

    @property
    def note(self) -> str:
        """Say where it withdraws to, and from whom, or for whom it waits; "" if neither."""
        if self.withdrawal is None or self.withdrawal.way is None:
            waits = self.wait is not None and self.wait.way is not None
            return f"waits for {self.wait.other!r}" if self.wait is not None and waits else ""
        where = ", ".join(f"{value:.2f}" for value in self.withdrawal.way.goal)
        return f"withdraws from {self.withdrawal.other!r} to ({where}) m"

    def on(self, path: Path, before: Path | None) -> "DeadlockResolver":
        """Return what is still known on another path: all, or nothing where it has a new goal.

        Parameters
        ----------
        path : from now on. before : until now; None where there was none.
        """
        if before is None or np.linalg.norm(path.goal - before.goal) > SAME_GOAL:
            return DeadlockResolver()
        return self

    def after(
        self, observation: Observation, place: Array, radius: float, left: float
    ) -> "DeadlockResolver":
        """Return what is known after an observation.

        Parameters
        ----------
        place : (D,), m, of the robot.
        radius : m, of the disc that encloses it.
        left : m, of its path.
        """
        others = sound(observation, len(place), here=place).detections
        known = self._looked(observation.stamp, place, others)
        if len(known.seen) == 1:  # the first look, or a clock that was set back
            return known
        gaps = {one.ident: _gap(one, place, radius) for one in others}
        under_way = known.withdrawal
        if under_way is not None and under_way.way is not None:
            over = observation.stamp >= under_way.end or known._passed(gaps)
            return DeadlockResolver(known.seen[-1:]) if over else known
        known = replace(known, wait=known._waiting(observation, gaps, left))
        other = known._opposite(gaps) if left > LEFT else ""
        if not other or (under_way is not None and under_way.other != other):
            return replace(known, withdrawal=None)
        if under_way is None:
            return replace(known, withdrawal=_drawn(observation, other))
        if observation.stamp < under_way.begin:
            return known
        goal = retreat(observation, others, place, radius, other)
        if goal is None:  # no room: look again after some time
            return DeadlockResolver(known.seen[-1:])
        way, there = Path(np.stack([place, goal])), known.seen[-1].others[other]
        return replace(known, withdrawal=replace(under_way, way=way, there=there), wait=None)

    def _looked(self, now: float, place: Array, others: Sequence[Detection]) -> "DeadlockResolver":
        """Remember where the robot and the others are; drop what is older than needed."""
        snapshot = Snapshot(now, place, {one.ident: one.position for one in others})
        if not self.seen or self.seen[-1].stamp >= now:
            return DeadlockResolver((snapshot,))
        old = [k for k, one in enumerate(self.seen) if one.stamp <= now - STILL + 1e-6]
        return replace(self, seen=(*self.seen[max(old, default=0) :], snapshot))

    def _waiting(
        self, observation: Observation, gaps: Mapping[str, float], left: float
    ) -> Wait | None:
        """Return the wait that begins, goes on or is over; None where there is none."""
        now, one = self.seen[-1], self.wait
        if one is None:
            name = self._met(gaps) if left > LEFT else ""
            if not name:
                return None
            end = now.stamp + _generator_of(observation).uniform(*PRECEDENCE)
            step = np.eye(len(now.place))[0] * 0.01
            return Wait(name, now.place, end, Path(np.stack([now.place, now.place + step])))
        if one.way is None:
            stays = np.linalg.norm(now.place - one.place) < STANDING
            return one if stays else None
        near = gaps.get(one.other, np.inf) < AWAY
        return one if near and now.stamp < one.end else replace(one, way=None)

    def _met(self, gaps: Mapping[str, float]) -> str:
        """Name the nearest one near the robot, if both have just come to a halt; "" if not."""
        name = min(gaps, key=lambda one: gaps[one], default="")
        if not name or gaps[name] > NEAR:
            return ""
        both = "", name
        halted = all(self._moved(one, HALT) < HALTED for one in both)
        came = all(STANDING < self._moved(one, STILL) < np.inf for one in both)
        return name if halted and came else ""

    def _moved(self, name: str, span: float) -> float:
        """Return how far a body was from where it is now in the last ``span`` s, at most, m.

        Infinite where it has not been seen for so long. The name "" is the robot's.
        """
        now = self.seen[-1]
        before = [k for k, one in enumerate(self.seen) if one.stamp <= now.stamp - span + 1e-6]
        if not before:
            return np.inf
        past = self.seen[before[-1] :]
        places = [one.place if not name else one.others.get(name) for one in past]
        here = places[-1]
        if here is None:
            return np.inf
        return max(np.inf if at is None else float(np.linalg.norm(here - at)) for at in places)

    def _passed(self, gaps: Mapping[str, float]) -> bool:
        """Whether the other one has gone by, or is no longer seen."""
        one = self.withdrawal
        assert one is not None and one.way is not None and one.there is not None
        if one.other not in gaps:
            return True
        left = one.way.points[0]
        beyond = (self.seen[-1].others[one.other] - left) @ (left - one.there)
        return gaps[one.other] > AWAY and bool(beyond > 0.0)

    def _opposite(self, gaps: Mapping[str, float]) -> str:
        """Name the nearest one near the robot, if both stand; "" if not.

        Parameters
        ----------
        gaps : identity -> distance of the surfaces, m.
        """
        now, past = self.seen[-1], self.seen[:-1]
        name = min(gaps, key=lambda one: gaps[one], default="")
        if not name or gaps[name] > NEAR or past[0].stamp > now.stamp - STILL + 1e-6:
            return ""
        moved = max(float(np.linalg.norm(now.place - one.place)) for one in past)
        there = [one.others[name] for one in past if name in one.others]
        went = max((float(np.linalg.norm(now.others[name] - one)) for one in there), default=0.0)
        stands = len(there) == len(past) and went < STANDING
        return name if moved < STUCK and stands else ""


def retreat(
    observation: Observation,
    others: Sequence[Detection],
    place: Array,
    radius: float,
    opposite: str,
) -> Array | None:
    """Return the place to withdraw to, (D,), m; None where there is no room for any.

    Of the places at `RETREATS` in `DIRECTIONS` (in space at the same height), those count whose
    straight way keeps clear of all others and walls as they are now, or comes no nearer to what
    is too near already. The one farthest from the line through both is taken, and of equally far
    ones, to within 1 cm, the one farthest from the opposite one.

    Parameters
    ----------
    observation : whose polygons count.
    others : of it.
    place : (D,), m; radius : m, of the robot.
    opposite : identity of whom it withdraws from.
    """
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    there = next(one.position for one in others if one.ident == opposite)
    towards = (there - place)[:2] / max(float(np.linalg.norm((there - place)[:2])), 1e-9)
    best: tuple[tuple[float, float], Array] | None = None
    for length in RETREATS:
        for angle in angles + np.arctan2(towards[1], towards[0]):
            step = np.zeros(len(place))
            step[:2] = length * np.cos(angle), length * np.sin(angle)
            aside = abs(float(towards[0] * step[1] - towards[1] * step[0]))
            worth = round(aside, 2), float(np.linalg.norm(place + step - there))
            if (best is None or worth > best[0]) and _free(
                observation, others, place, step, radius
            ):
                best = worth, place + step
    return None if best is None else best[1]


def _free(
    observation: Observation, others: Sequence[Detection], place: Array, step: Array, radius: float
) -> bool:
    """Whether a straight way keeps clear of bodies and walls, or comes no nearer to them."""
    for one in others:
        away = one.position - place
        share = np.clip(away @ step / (step @ step), 0.0, 1.0)
        least = min(radius + one.radius + ROOM, float(np.linalg.norm(away)) - 1e-6)
        if np.linalg.norm(away - share * step) < least:
            return False
    for part in (part for polygon in observation.polygons for part in polygon.parts):
        now = float(separation(place[None], part)[0])
        on_way = float(separation(np.stack([place, place + step]), part)[0])
        if on_way < min(radius + ROOM, now - 1e-6):
            return False
    return True


def _gap(one: Detection, place: Array, radius: float) -> float:
    return float(np.linalg.norm(one.position - place)) - radius - one.radius


def _generator_of(observation: Observation) -> np.random.Generator:
    """Return the robot's own generator for a decision: that of its state and clock."""
    numbers = np.append(observation.state, observation.stamp)
    return np.random.default_rng(np.frombuffer(numbers.tobytes(), dtype=np.uint32).tolist())


def _drawn(observation: Observation, other: str) -> Withdrawal:
    """Draw when to withdraw and when to come back, by the robot's own state and clock."""
    rng = _generator_of(observation)
    begin = observation.stamp + rng.uniform(*HESITATION)
    return Withdrawal(other, begin, begin + rng.uniform(*ABSENCE))
