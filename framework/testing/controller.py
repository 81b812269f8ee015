"""The laws of `Controller` as a check that any controller can run on itself."""

from collections.abc import Iterator
from dataclasses import dataclass, is_dataclass, replace
from functools import cached_property

import numpy as np

from ..control.command_limits import broken_limit
from ..controller import Controller, DrivesRobot, fresh
from ..mpc.planner.in_contact import LEAVING
from ..robot import Robot, start_state
from ..tracking.stand_ins import sound
from ..values.arrays import Array
from ..values.errors import WideberthError
from ..values.motion import Detection, Observation, Pose, Twist
from ..values.path import Path
from .laws import Contract, Law, law, refusing, serving, stated

STILL = 1e-3
"""m/s and rad/s, below which a command is none."""


@Contract
def check_controller(
    controller: Controller,
    robot: Robot | None = None,
    *,
    cycles: int = 8,
    rng: np.random.Generator | None = None,
) -> Iterator[Law]:
    """Check every law of `wideberth.framework.controller.Controller`.

    `command` raises a `WideberthError` before there is a path, of what is no observation, and
    of a state of the wrong length. It raises nothing else, and its commands keep the limits of
    the robot (`command_limits.broken_limit`): without obstacles, with obstacles that come, go,
    stand in the way or on the robot itself, with far too many of them, after the clock has
    jumped ahead or back, with one identity seen twice, from states beyond every limit, with
    numbers that are none, and when the path is replaced.
    What is seen and cannot be used is treated as `wideberth.framework.tracking.stand_ins` says:
    the commands are those for the detections with their stand-ins. A controller that plans leaves
    a robot at rest where it is while an obstacle without a place is seen, and is no faster in
    contact than the robot is, or than `wideberth.framework.mpc.planner.in_contact.LEAVING`.
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
    AssertionError : names every law that does not hold.
    WideberthError : no robot given or found.
    """
    model = controller.robot if robot is None and isinstance(controller, DrivesRobot) else robot
    if not isinstance(model, Robot):
        raise WideberthError(
            f"check_controller needs the robot that {type(controller).__name__} drives: give the "
            "controller a field or property `robot` (a wrapper returns that of its controller), "
            "or pass robot="
        )
    seed = np.random.default_rng(0) if rng is None else rng
    days = _Days(controller, model, list(_meeting(controller, model, cycles, seed)))
    return stated(_Days, controller, lambda: [days])


@dataclass(frozen=True, eq=False)
class _Days:
    """A controller, what it sees on an ordinary day, and what it sees on bad ones."""

    controller: Controller
    robot: Robot
    ordinary: list[Observation]

    @cached_property
    def first(self) -> Array:
        """Commands of the first ordinary day, before any bad one."""
        return self._run()

    def _run(self) -> Array:
        self._begin()
        before = len(self.ordinary) // 2
        for observation in self.ordinary[:before]:
            self.controller.remember(observation)
        return np.array([self._asked(seen) for seen in self.ordinary[before:]])

    def _begin(self) -> None:
        self.controller.reset()
        self.controller.set_path(_line(self.robot, 10.0))

    def _asked(self, observation: Observation) -> Array:
        """Return a command as numbers, if it is one that the robot can follow."""
        with serving("command", "; it must turn that into a status"):
            command = self.controller.command(observation)
        wrong = broken_limit(self.robot, command)
        assert not wrong, f"the command breaks the contract: {wrong}; state {observation.state}"
        return np.array([*command.linear, command.omega, command.ramp], dtype=np.float64)

    @property
    def near(self) -> list[Detection]:
        """One obstacle that touches the robot."""
        return [_detection("near", np.full(self.robot.dimension, 0.8 * self.robot.radius), 0.5)]

    @law("period")
    def check_period(self) -> None:
        period = self.controller.period
        assert period > 0, f"period is {period}; wanted above 0"

    @law("refuses to command without a path", is_dataclass, "it cannot be made anew")
    def check_unready(self) -> None:
        """Ask a controller that has not been given a path."""
        with refusing("a command without a path"):
            fresh(self.controller).command(_seen(self.robot, 0.0, []))

    @law("an ordinary day")
    def check_ordinary(self) -> None:
        assert len(self.first) == len(self.ordinary) - len(self.ordinary) // 2

    @law("remember leaves the plan alone")
    def check_remembering(self) -> None:
        self.controller.reset()
        assert self.controller.last_plan is None, "reset leaves a plan behind; wanted None"
        self.controller.set_path(_line(self.robot, 10.0))
        for observation in self.ordinary[: len(self.ordinary) // 2]:
            self.controller.remember(observation)
            assert self.controller.last_plan is None, "remember makes a plan; wanted a note alone"

    @law("odd observations")
    def check_odd(self) -> None:
        """Feed what a simulation does not, but a bad day does."""
        self._begin()
        robot, near = self.robot, self.near
        origin = np.zeros(robot.dimension)
        here = [_detection("here", origin, 0.01)]
        crowd = [_detection(f"c{i}", origin + 3.0 + i, 0.01) for i in range(25)]
        certain = [_detection("certain", origin + 4.0, 0.0)]
        late = [_detection("late", origin + 4.0, 0.01, age=1.0)]
        stamp = 0.0
        for detections in (here, near, [], crowd, certain, late):
            stamp += self.controller.period
            self._asked(_seen(robot, stamp, detections))
        self._asked(_seen(robot, stamp + 1000.0, near))
        self._asked(_seen(robot, stamp, near))
        self._asked(_seen(robot, stamp, [*near, *here, *near]))
        self.controller.set_path(_line(robot, -10.0))
        self._asked(_seen(robot, stamp + 1000.0 + self.controller.period, near))

    @law("numbers beyond limits and no numbers")
    def check_numbers(self) -> None:
        """Feed states beyond every limit, and numbers that are none, of robot and obstacles."""
        self._begin()
        stamp = 0.0
        for observation in _wild(self.robot, self.near):
            stamp += self.controller.period
            self._asked(replace(observation, stamp=stamp))
        self._asked(replace(_seen(self.robot, 0.0, self.near), stamp=np.nan))
        self._asked(_seen(self.robot, stamp + self.controller.period, self.near))

    @law("what is seen and cannot be used is an obstacle")
    def check_unusable(self) -> None:
        """Feed detections of which a number is of no use, and those with its stand-in."""
        for bad in _flawed(_ahead(self.robot, 3.0)):
            seen = _seen(self.robot, 0.0, [bad])
            instead = replace(seen, detections=sound(seen, self.robot.dimension).detections)
            first, second = (self._twice(one) for one in (seen, instead))
            assert np.array_equal(first, second), (
                f"a detection is not treated as its stand-in ({bad.flaw}): commands differ by up "
                f"to {np.abs(first - second).max():.3g}; see framework/tracking/stand_ins.py"
            )
        nowhere = np.full(self.robot.dimension, np.nan)
        lost = replace(_ahead(self.robot, 3.0), position=nowhere)
        found = self._twice(_seen(self.robot, 0.0, [lost]))[:, :-1]
        assert self.controller.last_plan is None or np.abs(found).max() <= STILL, (
            f"the robot sets out ({np.abs(found).max():.3g}) while an obstacle is seen without a "
            "place, which may be anywhere; wanted the command to stay"
        )

    @law("no faster in contact")
    def check_contact(self) -> None:
        """Put an obstacle on a robot that drives on, from every side and on its middle."""
        size, radius = self.robot.dimension, self.robot.radius
        ahead, aside = np.eye(size)[:2]
        state, _ = start_state(self.robot, np.zeros(size).tolist(), ahead.tolist(), 0.5)
        bounds = self.robot.state_bounds()
        start = np.clip(np.array(state), bounds.lower, bounds.upper)
        twist = self.robot.twist(tuple(start), tuple(0.0 for _ in self.robot.inputs))
        present = float(np.linalg.norm(np.array(twist.linear, dtype=np.float64)))
        for place in (0.0 * ahead, ahead, -ahead, aside, -aside):
            self._begin()
            on_it = Detection("on it", 0.8 * radius * place, 1e-4 * np.eye(size), 0.3)
            command = self._asked(Observation(0.0, start, (on_it,)))
            if self.controller.last_plan is None:
                return
            fast = float(np.linalg.norm(command[:size]))
            assert fast <= max(present, LEAVING) + STILL, (
                f"in contact with an obstacle at {on_it.position.round(2).tolist()} m the robot "
                f"is commanded {fast:.3g} m/s at {present:.3g} m/s; wanted no more than that"
            )

    def _twice(self, seen: Observation) -> Array:
        """Commands for an observation that stays, after a reset."""
        self._begin()
        stamps = (0.0, self.controller.period)
        return np.array([self._asked(replace(seen, stamp=stamp)) for stamp in stamps])

    @law("refuses what is no observation")
    def check_wrong_use(self) -> None:
        self._begin()
        wrong = np.zeros(len(self.robot.states) + 1)
        with refusing("a state of the wrong length"):
            self.controller.command(Observation(0.0, wrong))
        with refusing("what is no observation"):
            self.controller.command({"stamp": 0.0})  # type: ignore[arg-type]

    @law("same commands after reset")
    def check_repeats(self) -> None:
        """Run an ordinary day, a bad one with every kind of harm, and the ordinary one again."""
        first = self.first
        self._asked(_seen(self.robot, 0.0, self.near))
        state = np.full(len(self.robot.states), np.nan)
        self._asked(Observation(1000.0, state, tuple(self.near)))
        self.controller.set_path(_line(self.robot, -10.0))
        self._asked(_seen(self.robot, 500.0, [*self.near, *self.near]))
        second = self._run()
        assert np.array_equal(first, second), (
            f"after reset the same observations give other commands (by up to "
            f"{np.abs(first - second).max():.3g}): something is kept, or a clock is read"
        )


def _ahead(robot: Robot, away: float) -> Detection:
    """One obstacle straight ahead."""
    return _detection("ahead", away * np.eye(robot.dimension)[0], 0.01)


def _flawed(one: Detection) -> Iterator[Detection]:
    """Yield detections of which one number is of no use, at a place that is one."""
    size = len(one.position)
    for radius in (-0.3, np.nan, np.inf):
        yield replace(one, radius=radius)
    yield replace(one, covariance=-np.eye(size))
    yield replace(one, covariance=np.full((size, size), np.nan))
    yield replace(one, age=-1.0)


def _wild(robot: Robot, around: list[Detection]) -> Iterator[Observation]:
    """Observe states beyond every limit, and numbers that are none; stamps are still zero."""
    rest = _seen(robot, 0.0, []).state
    beyond = [rest + sign * size for sign in (-1.0, 1.0) for size in (1.0, 30.0, 1e9, 1e200)]
    for state in (*beyond, np.full_like(rest, np.nan), np.full_like(rest, np.inf)):
        yield Observation(0.0, state, tuple(around))
    one, size = around[0], robot.dimension
    for detection in (
        replace(one, position=np.full(size, np.nan)),
        replace(one, covariance=np.full((size, size), np.nan)),
        replace(one, covariance=-np.eye(size)),
        replace(one, covariance=1e30 * np.eye(size)),
        replace(one, radius=np.nan),
        replace(one, age=-1.0),
        replace(one, position=np.full(size, 1e200)),
        replace(one, position=np.zeros(size + 1), covariance=np.eye(size + 1)),
    ):
        yield _seen(robot, 0.0, [detection])
    spread = np.full((len(rest), len(rest)), np.nan)
    yield replace(_seen(robot, 0.0, around), covariance=spread)


def _meeting(
    controller: Controller, robot: Robot, cycles: int, rng: np.random.Generator
) -> Iterator[Observation]:
    """Let an obstacle come the other way, a little to the side."""
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
