"""Where a solver starts from: the last plan, and ways round what stands in the way of it.

An interior point method goes on from its start to the nearest local optimum, and on which side
an obstacle is passed is decided there. Measured with fatrop on 420 recorded instances (`tests`
keep a sample), the share that comes within 1e-3 of the best cost that about forty set-ups found:
the shifted last plan alone 94.3 %, with ``along`` 99.8 %, with ``right`` besides 100 %. Of 16
head-on, perfectly symmetric encounters these are 9, 11 and 15; with all of `OTHERS` every one of
136 other hard instances with a known feasible point is solved to its best cost as well.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from ...robot import Robot
from ...values.arrays import Array
from ...values.errors import WideberthError
from ...values.motion import Pose, Twist
from ...values.plan import Plan
from ..fallback.ladder import Ladder
from ..fallback.rollout import SWEEPS, clip, follow, steer, sweep
from ..ocp.problem import Parameters, Problem
from ..ocp.progress_robot import ProgressRobot, progress_robot_of
from ..ocp.reference import Reference
from ..ocp.transcription import Guess

Starts: TypeAlias = tuple[str, ...] | Literal["auto"]
"""Names of starting points, or ``auto``: `OTHERS`, where something is in the way."""

OTHERS = ("along", "left", "right", "back-left", "back-right", "wait")
"""What is worth a try beside the last plan, most useful first."""

NAMES = ("along", *SWEEPS)
"""Every starting point that can be named."""


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
) -> list[Guess]:
    """Return further starting points for an instance, in the order of their names.

    ``along`` lies on the reference, through whatever stands there, which leaves the choice of
    side to the solver. Every other holds a twist from x_0 on, see `rollout.sweep`, and is driven
    within the limits. A point equal to an earlier one is left out.

    Parameters
    ----------
    robot : of the problem.
    problem, parameters : the instance.
    guess : what is solved from first; it gives the shared level. Auxiliaries are filled in
        later, see `bodies.with_auxiliaries`.
    names : of `NAMES`.
    """
    found: list[Guess] = []
    pace = max(float(np.abs(parameters.speed).max()), 1e-3)
    moving = _under_way(robot, parameters, pace)
    start = parameters.initial
    for name in dict.fromkeys(names):
        if name == "along":
            states, inputs = along(robot, parameters, problem.dt)
        else:
            now = None if name == "coast" else moving
            twist = sweep(robot, start, name, pace, now)
            states, inputs = steer(robot, start, twist, problem.horizon, problem.dt)
        known = [guess, *found]
        if not any(np.array_equal(states, one.states) for one in known):
            found.append(replace(Guess.bare(states, inputs, guess.level), slack=guess.slack))
    if isinstance(robot, ProgressRobot):
        arc = float(parameters.initial[-1])
        return [add_progress(robot, point, parameters, arc, problem.dt) for point in found]
    return found


def _under_way(robot: Robot, parameters: Parameters, pace: float) -> Twist:
    """Return the twist of x_0 if it kept its pace: ahead, or, without a heading, along the path.

    A turn of a robot that stands leads nowhere.
    """
    if robot.pose(tuple(parameters.initial)).heading is not None:
        return Twist((pace, 0.0))
    return Twist(tuple(float(pace * part) for part in parameters.direction[0]))


def along(robot: Robot, parameters: Parameters, dt: float) -> tuple[Array, Array]:
    """Lay states (N + 1, n) and inputs (N, m) on the reference, whether or not they can be driven.

    State i is at the reference's place with the velocity that leads there from the one before;
    the heading, if there is one, looks that way. The inputs are those that bring each twist to
    the next.
    """
    start = parameters.initial
    here = robot.pose(tuple(start))
    places = np.concatenate([[np.array(here.position, dtype=np.float64)], parameters.reference])
    velocities = np.diff(places, axis=0) / dt
    twists = [Twist(tuple(float(v) for v in velocity)) for velocity in velocities]
    headings: list[float | None] = [None] * len(velocities)
    if here.heading is not None:
        speeds = np.linalg.norm(velocities, axis=1)
        headings = list(_headings(velocities, speeds, float(here.heading)))
        twists = [Twist((float(speed), 0.0)) for speed in speeds]
    states = np.array(
        [
            start,
            *(
                robot.state_at(Pose(tuple(float(p) for p in place), heading), twist)
                for place, heading, twist in zip(places[1:], headings, twists, strict=True)
            ),
        ],
        dtype=np.float64,
    )
    bounds = robot.state_bounds()
    states[1:] = np.clip(states[1:], np.asarray(bounds.lower), np.asarray(bounds.upper))
    inputs = [
        robot.drive(tuple(state.tolist()), twist, dt)
        for state, twist in zip(states[:-1], twists, strict=True)
    ]
    return states, clip(robot, np.array(inputs, dtype=np.float64))


def _headings(velocities: Array, speeds: Array, first: float) -> Array:
    """Directions of travel without a jump by a turn; standing keeps the one before."""
    angles = np.arctan2(velocities[:, 1], velocities[:, 0])
    moving = speeds > 1e-6
    last = np.maximum.accumulate(np.where(moving, np.arange(len(speeds)) + 1, 0))
    kept = np.concatenate([[first], angles])[last]
    return np.asarray(np.unwrap(np.concatenate([[first], kept]))[1:])


def augment_with_progress(
    ladder: Ladder, guesses: Sequence[Guess], reference: Reference, arc: float
) -> tuple[Ladder, list[Guess]]:
    """Let theta, at first ``arc``, ride along in all that a plan is chosen from."""
    start, robot, inputs = (
        np.append(ladder.start, arc),
        progress_robot_of(ladder.robot),
        ladder.inputs,
    )
    if inputs is not None:
        last = ladder.guess(follow(ladder.robot, ladder.start, inputs, ladder.dt), inputs)
        inputs = add_progress(robot, last, reference, arc, ladder.dt).inputs
    own = [add_progress(robot, guess, reference, arc, ladder.dt) for guess in guesses]
    return replace(ladder, robot=robot, start=start, inputs=inputs), own


def add_progress(
    robot: ProgressRobot, guess: Guess, reference: Reference | Parameters, arc: float, dt: float
) -> Guess:
    """Fill in theta and its rate, whether or not a trajectory has them already.

    theta starts at ``arc`` and moves by what each step covers in the direction of the reference
    there.
    """
    states = guess.states[:, : len(robot.robot.states)]
    places = np.stack(robot.pose(tuple(states.T)).position, axis=-1)
    theta, pace = np.full(len(places), arc), max(float(reference.speed.max()) * dt, 1e-9)
    for i, step in enumerate(np.diff(places, axis=0)):
        nearest = int(np.clip((theta[i] - arc) / pace, 0, len(reference.direction) - 1))
        theta[i + 1] = theta[i] + step @ reference.direction[nearest]
    inputs = guess.inputs[:, : len(robot.robot.inputs)]
    return replace(
        guess,
        states=np.column_stack([states, theta]),
        inputs=np.column_stack([inputs, np.diff(theta) / dt]),
    )


def strip_progress(robot: Robot, plan: Plan) -> Plan:
    """Leave the plan with the states and inputs of the robot itself."""
    states, inputs = plan.states[:, : len(robot.states)], plan.inputs[:, : len(robot.inputs)]
    return replace(plan, states=states, inputs=inputs)
