"""The laws of `Controller` as a check that any controller can run on itself."""

from collections.abc import Iterator
from dataclasses import is_dataclass, replace

import numpy as np

from ..control.command_limits import broken_limit
from ..controller import Controller, DrivesRobot, fresh
from ..robot import Robot
from ..values.arrays import Array
from ..values.errors import WideberthError
from ..values.motion import Detection, Observation, Pose, Twist
from ..values.path import Path


def check_controller(
    controller: Controller,
    robot: Robot | None = None,
    *,
    cycles: int = 8,
    rng: np.random.Generator | None = None,
) -> None:
    """Check every law of `wideberth.framework.controller.Controller`.

    `command` raises a `WideberthError` before there is a path, of what is no observation, and
    of a state of the wrong length. It raises nothing else, and its commands keep the limits of
    the robot (`command_limits.broken_limit`): with nobody around, with obstacles that come, go,
    stand in the way or on the robot itself, with far too many of them, after the clock has
    jumped ahead or back, with one identity seen twice, from states beyond every limit, with
    numbers that are none, and when the path is replaced.
    `remember` leaves the plan alone. After `reset` the same observations give the same
    commands again.

    Parameters
    ----------
    controller : to be checked; it is reset.
    robot : whose states it is fed; its field ``robot`` when it has one.
    cycles : decisions in the ordinary run; each costs one solve.
    rng : where the noise is drawn from; the same one each time by default.

    Raises
    ------
    AssertionError : a law does not hold; the message names it.
    WideberthError : no robot given or found.
    """
    model = controller.robot if robot is None and isinstance(controller, DrivesRobot) else robot
    if not isinstance(model, Robot):
        raise WideberthError("check_controller needs the robot that the controller drives")
    assert controller.period > 0, f"period is {controller.period}; wanted above 0"
    _check_unready(controller, model)
    seed = np.random.default_rng(0) if rng is None else rng
    ordinary = list(_meeting(controller, model, cycles, seed))
    first = _run(controller, model, ordinary)
    _check_strange(controller, model)
    second = _run(controller, model, ordinary)
    assert np.array_equal(first, second), (
        f"after reset the same observations give other commands (by up to "
        f"{np.abs(first - second).max():.3g}): something is kept, or a clock is read"
    )


def _run(controller: Controller, robot: Robot, observations: list[Observation]) -> Array:
    controller.reset()
    assert controller.plan is None, "reset leaves a plan behind; wanted None"
    controller.set_path(_line(robot, 10.0))
    before = len(observations) // 2
    for observation in observations[:before]:
        controller.remember(observation)
        assert controller.plan is None, "remember makes a plan; it must only take note"
    return np.array([_asked(controller, robot, seen) for seen in observations[before:]])


def _check_strange(controller: Controller, robot: Robot) -> None:
    """Feed what a simulation does not, but a bad day does."""
    controller.reset()
    origin = np.zeros(robot.dimension)
    controller.set_path(_line(robot, 10.0))
    here = [_detection("here", origin, 0.01)]
    near = [_detection("near", origin + 0.8 * robot.radius, 0.5)]
    crowd = [_detection(f"c{i}", origin + 3.0 + i, 0.01) for i in range(25)]
    certain = [_detection("certain", origin + 4.0, 0.0)]
    late = [_detection("late", origin + 4.0, 0.01, age=1.0)]
    stamp = 0.0
    for detections in (here, near, [], crowd, certain, late):
        stamp += controller.period
        _asked(controller, robot, _seen(robot, stamp, detections))
    _asked(controller, robot, _seen(robot, stamp + 1000.0, near))
    _asked(controller, robot, _seen(robot, stamp, near))
    _asked(controller, robot, _seen(robot, stamp, [*near, *here, *near]))
    _check_numbers(controller, robot, stamp + controller.period, near)
    controller.set_path(_line(robot, -10.0))
    _asked(controller, robot, _seen(robot, stamp + 1000.0 + controller.period, near))
    _check_refused(controller, Observation(stamp, np.zeros(len(robot.states) + 1)))
    _check_refused(controller, {"stamp": 0.0})


def _check_unready(controller: Controller, robot: Robot) -> None:
    """Ask a controller that nobody gave a path."""
    if is_dataclass(controller):
        _check_refused(fresh(controller), _seen(robot, 0.0, []))


def _check_refused(controller: Controller, observation: object) -> None:
    """Use a controller wrongly."""
    try:
        controller.command(observation)  # type: ignore[arg-type]
    except WideberthError:
        return
    except Exception as error:
        raise AssertionError(
            f"wrong use raised {type(error).__name__}: {error}; wanted a WideberthError"
        ) from error
    raise AssertionError("command accepts wrong use without a word; wanted a WideberthError")


def _check_numbers(
    controller: Controller, robot: Robot, stamp: float, around: list[Detection]
) -> None:
    """Feed states beyond every limit, and numbers that are none, of the robot and of others."""
    rest = _seen(robot, stamp, []).state
    beyond = [rest + sign * size for sign in (-1.0, 1.0) for size in (1.0, 30.0, 1e9, 1e200)]
    beyond += [np.full_like(rest, np.nan), np.full_like(rest, np.inf)]
    for state in beyond:
        _asked(controller, robot, Observation(stamp, state, tuple(around)))
        stamp += controller.period
    one, size = around[0], robot.dimension
    unknown = np.full((size, size), np.nan)
    wild = [
        replace(one, position=np.full(size, np.nan)),
        replace(one, covariance=unknown),
        replace(one, covariance=-np.eye(size)),
        replace(one, covariance=1e30 * np.eye(size)),
        replace(one, radius=np.nan),
        replace(one, age=-1.0),
        replace(one, position=np.full(size, 1e200)),
        replace(one, position=np.zeros(size + 1), covariance=np.eye(size + 1)),
    ]
    for detection in wild:
        _asked(controller, robot, _seen(robot, stamp, [detection]))
        stamp += controller.period
    _asked(controller, robot, replace(_seen(robot, stamp, around), stamp=np.nan))
    spread = np.full((len(rest), len(rest)), np.nan)
    _asked(controller, robot, replace(_seen(robot, stamp, around), covariance=spread))
    _asked(controller, robot, _seen(robot, stamp, around))


def _asked(controller: Controller, robot: Robot, observation: Observation) -> Array:
    try:
        command = controller.command(observation)
    except Exception as error:
        raise AssertionError(
            f"command raised {type(error).__name__}: {error}; it must turn that into a status"
        ) from error
    wrong = broken_limit(robot, command)
    assert not wrong, f"the command breaks the contract: {wrong}; state {observation.state}"
    return np.array([*command.linear, command.omega, command.ramp], dtype=np.float64)


def _meeting(
    controller: Controller, robot: Robot, cycles: int, rng: np.random.Generator
) -> Iterator[Observation]:
    """Somebody comes the other way, a little to the side."""
    for cycle in range(2 * cycles):
        stamp = cycle * controller.period
        place = np.zeros(robot.dimension)
        place[:2] = 9.0 - 0.4 * stamp, 0.2
        noise = 0.01 * rng.standard_normal(robot.dimension)
        yield _seen(robot, stamp, [_detection("other", place + noise, 0.01)])


def _seen(robot: Robot, stamp: float, detections: list[Detection]) -> Observation:
    pose = Pose((0.0,) * robot.dimension, 0.0)
    still = Twist((0.0,) * robot.dimension, 0.0)
    state = np.array(robot.state_at(pose, still), dtype=np.float64)
    return Observation(stamp, state, tuple(detections))


def _detection(name: str, place: Array, noise: float, age: float = 0.0) -> Detection:
    return Detection(name, place, noise**2 * np.eye(len(place)), 0.75, age)


def _line(robot: Robot, reach: float) -> Path:
    goal = np.zeros(robot.dimension)
    goal[0] = reach
    return Path(np.stack([np.zeros(robot.dimension), goal]))
