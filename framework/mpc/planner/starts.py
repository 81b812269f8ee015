"""Starting points of the solver: the last plan, and others round what stands in the way of it.

An interior point method goes on from its start to the nearest local optimum, and on which side
an obstacle is passed is decided there. Measured with fatrop on 420 recorded instances (`tests`
keep a sample), the share that comes within 1e-3 of the best cost that about forty set-ups found:
the shifted last plan alone 94.3 %, with ``along`` 99.8 %, with ``right`` besides 100 %. Of 16
head-on, perfectly symmetric encounters these are 9, 11 and 15; with all of `OTHERS` every one of
136 other hard instances with a known feasible point is solved to its best cost as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, copysign, cos, hypot, pi, sin
from typing import Literal, TypeAlias, final

import numpy as np

from ...control.command_limits import FAST, attained, slower_backwards, turns_on_the_spot
from ...robot import Robot
from ...values.arrays import Array
from ...values.errors import WideberthError
from ...values.motion import Pose, Twist
from ...values.plan import Plan
from ..ocp.problem import Parameters, Problem
from ..ocp.transcription import Guess, Multipliers
from ..problem_robot import with_carried
from ..slots.base import SlotAssignment, with_auxiliaries_each
from .instance import Instance
from .rollout import (
    SWEEPS,
    Held,
    RobotMotion,
    clip,
    drive_each,
    shift,
    stand,
    steer,
    steer_each,
    sweep,
)

Starts: TypeAlias = tuple[str, ...] | Literal["auto"]
"""Names of starting points, or ``auto``: `OTHERS`, where something is in the way."""

OTHERS = ("along", "left", "right", "back-left", "back-right", "wait")
"""What is worth a try beside the last plan, most useful first."""

WARM_WITHIN = 0.5
"""Share of a plan's step up to which its multipliers start the next solve, of solvers that take
them (riccati). Later they are worth little."""

NAMES = ("along", "turn", *SWEEPS)
"""Every starting point that can be named."""


def suited_each(instance: Instance, guesses: Sequence[Guess]) -> list[Guess]:
    """Fill in the auxiliaries that suit the poses of some guesses best."""
    none = instance.problem.no_auxiliaries
    if none:
        return [
            Guess(one.states, one.inputs, none, one.level, one.slack, one.multipliers)
            for one in guesses
        ]
    kinds, parameters = instance.around.kinds, instance.parameters
    return with_auxiliaries_each(instance.robot, kinds, parameters, guesses)


def at_target(instance: Instance, states: Array, inputs: Array) -> Guess:
    """Wrap a trajectory at the level aimed at, with the auxiliaries that suit it best."""
    return suited_each(instance, [Guess.bare(states, inputs, instance.target)])[0]


def remaining_inputs(
    robot: Robot, plan: Plan, stamp: float, start: Array, *, standing: bool
) -> Array | None:
    """Return the inputs that are left of a plan at ``stamp``, (N, m); None before it begins.

    Parameters
    ----------
    robot, start : the robot and its state at ``stamp``, (n,).
    plan : the last one.
    stamp : s.
    standing : whether it brakes and stands beyond its end; else it goes on without input.
    """
    share = min((stamp - plan.stamp) / plan.dt, len(plan.inputs))
    if share < 0.0:
        return None
    inputs = shift(plan.inputs, share)
    return stand(robot, start, inputs, share, plan.dt) if standing else inputs


def first_trajectory(
    motion: RobotMotion, start: Array, inputs: Array | None
) -> tuple[Array, Array]:
    """Return what to solve from first: the last plan's inputs driven from here, or coasting.

    Parameters
    ----------
    motion, start : the robot's compiled motion, and its state (n,).
    inputs : (N, m), of the last plan from now on; None without one.

    Returns
    -------
    states : (N + 1, n). inputs : (N, m).
    """
    if inputs is not None:
        return motion.follow(start, inputs), inputs
    robot = motion.robot
    return steer(robot, start, sweep(robot, start, "coast", 0.0), motion.steps, motion.dt)


def checked_starts(starts: Starts) -> None:
    """Refuse names that are no starting point.

    Raises
    ------
    WideberthError : another word than auto, or unknown names.
    """
    if starts == "auto":
        return
    unknown = [starts] if isinstance(starts, str) else sorted(set(starts) - set(NAMES))
    if unknown:
        raise WideberthError(f"planner.starts holds {unknown}; wanted some of {NAMES}, or auto")


def other_starts(
    robot: Robot,
    problem: Problem,
    parameters: Parameters,
    guess: Guess,
    names: Sequence[str] = OTHERS,
    laid: "ReferenceGuess | None" = None,
) -> list[Guess]:
    """Return further starting points for an instance, in the order of their names.

    ``along`` lies on the reference, through whatever stands there, which leaves the choice of
    side to the solver. ``turn`` turns on the spot until the robot looks along the path, and then
    drives ahead. Every other holds a twist from x_0 on, see `rollout.sweep`, and is driven
    within the limits. A point equal to an earlier one is left out.

    Parameters
    ----------
    robot : of the problem.
    problem, parameters : the instance.
    guess : what is solved from first; it gives the shared level. Auxiliaries are filled in
        later, see `slots.base.with_auxiliaries`.
    names : of `NAMES`.
    laid : states on the reference, where they are known already.
    """
    if not names:
        return []
    found: list[Guess] = []
    known = {_numbers(guess.states)}
    for states, inputs in _trajectories(robot, problem, parameters, names, laid):
        numbers = _numbers(states)
        if numbers not in known:
            known.add(numbers)
            none = problem.no_auxiliaries
            found.append(Guess(states, inputs, none, guess.level, guess.slack))
    return [with_carried(robot, point, parameters, problem.dt) for point in found]


def _numbers(states: Array) -> bytes:
    """Return what equal states have in common; -0 is 0."""
    return (states + 0.0).tobytes()


def _trajectories(
    robot: Robot,
    problem: Problem,
    parameters: Parameters,
    names: Sequence[str],
    laid: "ReferenceGuess | None",
) -> list[tuple[Array, Array]]:
    """States (N + 1, n) and inputs (N, m) of each start, see `other_starts`."""
    pace = max(float(np.abs(parameters.speed).max()), 1e-3)
    moving, start = _under_way(robot, parameters, pace), parameters.initial
    once, steps, dt = list(dict.fromkeys(names)), problem.horizon, problem.dt
    held = [name for name in once if name in SWEEPS]
    manoeuvres = [
        [(sweep(robot, start, name, pace, None if name == "coast" else moving), steps)]
        for name in held
    ]
    found = dict(zip(held, steer_each(robot, start, manoeuvres, dt), strict=True))
    if "along" in once:
        laid = laid or ReferenceGuess.along(robot, parameters, dt)
        found["along"] = laid.states, laid.inputs(robot, dt)
    if "turn" in once:
        (found["turn"],) = steer_each(
            robot, start, [_turn(robot, parameters, moving, steps, dt)], dt
        )
    return [found[name] for name in once]


def faces_away(robot: Robot, parameters: Parameters) -> bool:
    """Whether the reference lies or begins behind a robot that drives backwards less fast.

    One that stands so is stuck at a local optimum: to turn a little brings it no nearer, nor does
    to drive ahead. Only a robot that turns on the spot counts, which knows a way out; and for a
    reference that ends within the robot's own disc it need not.
    """
    pose = robot.pose(parameters.initial.tolist())
    if pose.heading is None:
        return False
    heading, end = pose.heading, parameters.reference[-1].tolist()
    begins, way = parameters.direction[0].tolist(), _to_reference(pose, parameters)
    if not (_behind(heading, way) or _behind(heading, begins)):
        return False
    if hypot(end[0] - pose.position[0], end[1] - pose.position[1]) <= robot.radius:
        return False
    start = parameters.initial
    return slower_backwards(robot, start) and turns_on_the_spot(robot, start)


def _to_reference(pose: Pose, parameters: Parameters) -> tuple[float, float]:
    """Return the way from a pose to the middle of the reference, m."""
    steps, (east, north, *_) = len(parameters.reference), parameters.reference.sum(axis=0).tolist()
    return east / steps - pose.position[0], north / steps - pose.position[1]


def _behind(heading: float, way: Sequence[float]) -> bool:
    return cos(heading) * way[0] + sin(heading) * way[1] < 0.0


def _turn(robot: Robot, parameters: Parameters, moving: Twist, steps: int, dt: float) -> Held:
    """Return the twists of ``turn``: on the spot until it looks along the path, then ``moving``.

    Where it does that already, as beyond the end of the path, it turns to the reference. It begins
    to stop turning where its yaw rate, which falls as fast as it can, brings it there.
    """
    start, way = parameters.initial, parameters.direction[0].tolist()
    pose = robot.pose(tuple(start.tolist()))
    heading = pose.heading
    if heading is None:
        return [(moving, steps)]
    if not _behind(heading, way):
        way = _to_reference(pose, parameters)
    missing = atan2(way[1], way[0]) - heading
    missing -= 2.0 * pi * round(missing / (2.0 * pi))
    sign, still, none = (
        copysign(1.0, missing),
        (0.0,) * robot.dimension,
        (0.0,) * len(robot.inputs),
    )
    spin = Twist(still, sign * FAST)
    states, _ = steer(robot, start, spin, steps, dt)
    turned = sign * (robot.pose(tuple(states.T)).heading - heading)
    rates = sign * robot.twist(tuple(states.T), none).angular
    opposite = attained(robot, start, [Twist(still, -sign * FAST)], dt)[0, -1]
    slowing = abs(opposite - robot.twist(tuple(start), none).angular) / dt
    there = rates * np.abs(rates) >= 2.0 * slowing * (abs(missing) - turned)
    count = int(there.argmax()) if there.any() else steps
    return [(spin, count), (moving, steps - count)]


def _under_way(robot: Robot, parameters: Parameters, pace: float) -> Twist:
    """Return the twist of x_0 if it kept its pace: ahead, or, without a heading, along the path.

    A turn of a robot that stands leads nowhere.
    """
    if robot.pose(tuple(parameters.initial)).heading is not None:
        return Twist((pace, 0.0))
    return Twist(tuple(float(pace * part) for part in parameters.direction[0]))


@dataclass(frozen=True, eq=False)
class ReferenceGuess:
    """States on the reference, whether or not they can be driven.

    Attributes
    ----------
    states : (N + 1, n). twist : from each state to the next, of arrays (N,).
    """

    states: Array
    twist: Twist

    @classmethod
    def along(cls, robot: Robot, parameters: Parameters, dt: float) -> "ReferenceGuess":
        """Lay them.

        State i is at the reference's place with the velocity that leads there from the one before;
        the heading, if there is one, looks that way.
        """
        start, end = parameters.initial, parameters.reference
        here = robot.pose(tuple(start.tolist()))
        before = np.empty(end.shape)
        before[0], before[1:] = here.position, end[:-1]
        velocities = (end - before) / dt
        headings, twist = None, Twist(tuple(velocities.T))
        if here.heading is not None:
            speeds = np.sqrt(np.add.reduce(velocities * velocities, axis=1))
            headings = _headings(velocities, speeds, here.heading)
            twist = Twist((speeds, 0.0))
        driven = robot.state_at(Pose(tuple(end.T), headings), twist)
        bounds = robot.state_bounds()
        states = np.empty((len(end) + 1, len(start)))
        states[0] = start
        for k, values in enumerate(driven):
            states[1:, k] = values
        states[1:] = np.minimum(np.maximum(states[1:], bounds.lower), bounds.upper)
        return cls(states, twist)

    def inputs(self, robot: Robot, dt: float) -> Array:
        """Return the inputs that bring each twist to the next, (N, m)."""
        return clip(robot, drive_each(robot, self.states[:-1], self.twist, dt))


def _headings(velocities: Array, speeds: Array, first: float) -> Array:
    """Directions of travel without a jump by a turn; standing keeps the one before."""
    angles = np.empty(len(speeds) + 1)
    angles[0], angles[1:] = first, np.arctan2(velocities[:, 1], velocities[:, 0])
    moving = speeds > 1e-6
    if not moving.all():
        last = np.maximum.accumulate(np.where(moving, np.arange(len(speeds)) + 1, 0))
        angles[1:] = angles[last]
    if (np.abs(angles[1:] - angles[:-1]) < np.pi).all():  # nowhere a turn to take away
        return angles[1:] + 0.0
    return np.asarray(np.unwrap(angles)[1:])


@final
@dataclass(frozen=True, eq=False)
class KeptMultipliers:
    """Multipliers of a plan, with the names of what they belong to: a start for the next solve.

    Where plans follow each other within a fraction of their step, the last plan's multipliers are
    nearly those of the next. The solver then begins with a barrier as low as they say, see
    `Riccati`.

    Attributes
    ----------
    multipliers : of the plan.
    level : that it holds; nan where none is shared.
    names : of the slots in use, of each kind.
    """

    multipliers: Multipliers
    level: float
    names: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, point: Guess, chosen: tuple[SlotAssignment, ...]) -> "KeptMultipliers | None":
        """Keep those of a solution; None where the solver has none."""
        if point.multipliers is None:
            return None
        return cls(point.multipliers, point.level, tuple(one.called for one in chosen))

    def at(
        self, share: float, parameters: Parameters, chosen: tuple[SlotAssignment, ...]
    ) -> Multipliers:
        """Return those of a plan that begins later, for the slots that it has.

        Between two steps they are interpolated; behind the last they stay as they are there. A
        slot whose thing had none before is NaN.

        Parameters
        ----------
        share : of a step by which it begins later.
        parameters, chosen : of the problem that is solved next.
        """
        slots = []
        for held, names, one, new in zip(
            self.multipliers.slots, self.names, parameters.slots, chosen, strict=True
        ):
            known, shape = _numbered(names), (len(held), len(one.active), held.shape[2])
            found = np.full(shape, np.nan)
            places = _numbered(new.called).items()
            pairs = [(known[name], place) for name, place in places if name in known]
            if pairs:
                old, place = np.array(pairs).T
                found[:, place] = held[:, old]
            slots.append(_later(found, share))
        return Multipliers(_later(self.multipliers.steps, share), tuple(slots))


def _numbered(names: tuple[str, ...]) -> dict[tuple[str, int], int]:
    """Return the place of each name; the modes of an obstacle, which share one, are counted."""
    found: dict[tuple[str, int], int] = {}
    counts: dict[str, int] = {}
    for place, name in enumerate(names):
        counts[name] = counts.get(name, -1) + 1
        found[name, counts[name]] = place
    return found


def _later(rows: Array, share: float) -> Array:
    """Interpolate rows at steps (N, ...) that are a share of a step later."""
    last = len(rows) - 1
    place = np.minimum(np.arange(last + 1) + share, last)
    before = place.astype(np.int64)
    weight = (place - before).reshape(-1, *[1] * (rows.ndim - 1))
    return np.asarray((1.0 - weight) * rows[before] + weight * rows[np.minimum(before + 1, last)])
