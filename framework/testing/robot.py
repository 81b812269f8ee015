"""The laws of `Robot` as a check that any robot can run on itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from ..numerics.geometry import plane_turn
from ..numerics.integration import runge_kutta
from ..robot import Bounds, Robot, SpeedLimited, SymbolicDrive
from ..values.arrays import Array
from ..values.motion import Pose, Twist
from .laws import Contract, Law, law, stated

State: TypeAlias = tuple[float, ...]
Control: TypeAlias = tuple[float, ...]
Pair: TypeAlias = tuple[State, Control]
"""A state and an input."""
_TICK = 0.05
"""s, of one step of a drive."""
_STEP = 1e-4
"""s, of central differences."""
_HELD = 20
"""Steps of 50 ms that a wanted twist is held for when a drive has ended."""
_DURATION = 0.5
"""s, of one step in which the way is measured."""
_EXCESS = 1e3
"""m/s and rad/s, more than any robot can do."""
_SAMPLES = 40
_REACH = 5.0
"""m (or rad): states without limits are drawn up to here."""


@Contract
def check_robot(robot: Robot, *, rng: np.random.Generator | None = None) -> Iterator[Law]:
    """Check every law of `wideberth.framework.robot.Robot`.

    Names and bounds fit together; a footprint lies within the radius and turns with a heading;
    it is no faster than its largest speed, if it names one;
    NumPy (one state or a batch) and CasADi agree; pose changes as twist says and twist as
    acceleration (central differences); `state_at` is the inverse of pose and twist; one
    Runge-Kutta step has order four; turning the start turns the motion; `drive` keeps every
    limit, whatever is asked, and reaches twists that the robot can have; both also serve a robot
    that stands, if its bounds let it stand. A `SymbolicDrive` drives alike with CasADi
    expressions.

    Parameters
    ----------
    robot : to be checked.
    rng : where states and inputs are drawn from; the same ones each time by default.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    generator = np.random.default_rng(0) if rng is None else rng
    samples = _Samples(robot, generator.spawn(1)[0])
    return stated(_Samples, robot, lambda: [samples], generator)


@dataclass(frozen=True, eq=False)
class _Samples:
    """A robot, and states and inputs that keep all its limits."""

    robot: Robot
    drawn: np.random.Generator

    @cached_property
    def pairs(self) -> list[Pair]:
        return [self._draw() for _ in range(_SAMPLES)]

    def _draw(self) -> Pair:
        robot, rng = self.robot, self.drawn
        for _ in range(1000):
            state = _within(robot.state_bounds(), rng, _REACH)
            control = _within(robot.input_bounds(), rng, 1.0)
            if all(value >= 0 for value in robot.constraints(state, control)):
                return state, control
        raise AssertionError("constraints: none of 1000 draws within the bounds keeps them")

    @property
    def drives(self) -> list[tuple[State, Twist]]:
        """States to drive from, and twists that the robot can have."""
        both = zip(self.pairs[::2], self.pairs[1::2], strict=True)
        return [(start, self.robot.twist(*goal)) for (start, _), goal in both]

    @property
    def idle(self) -> tuple[float, ...]:
        """An input of zeros."""
        return (0.0,) * len(self.robot.inputs)

    @law("names and bounds")
    def check_bounds(self) -> None:
        robot = self.robot
        assert robot.radius > 0, f"radius is {robot.radius}; wanted above 0"
        if robot.footprint is not None:
            reach, radius = robot.footprint.reach, robot.radius
            assert reach <= radius * (1 + 1e-9), (
                f"the footprint reaches {reach:g} m, beyond radius {radius:g} m"
            )
            heading = robot.pose((0.0,) * len(robot.states)).heading
            assert heading is not None, "a footprint turns with the heading; this robot has none"
        named = (
            ("state", robot.states, robot.state_bounds()),
            ("input", robot.inputs, robot.input_bounds()),
        )
        for what, names, bounds in named:
            count = len(names)
            assert len(bounds.lower) == len(bounds.upper) == count, (
                f"{what}_bounds have {len(bounds.lower)} and {len(bounds.upper)} entries; "
                f"the robot names {count} {what}s"
            )
            assert all(np.less(bounds.lower, bounds.upper)), (
                f"{what}_bounds: a lower bound is not below its upper bound"
            )
            assert len({quantity.name for quantity in names}) == count, f"{what} names repeat"

    @law("NumPy and CasADi agree")
    def check_casadi(self) -> None:
        from ..numerics.symbolic import ca

        robot, pairs = self.robot, self.pairs
        x, u = ca.SX.sym("x", len(robot.states)), ca.SX.sym("u", len(robot.inputs))
        values = self._everything(ca.vertsplit(x), ca.vertsplit(u))
        function = ca.Function("robot", [x, u], [ca.vertcat(*values)])
        states = tuple(np.array([state for state, _ in pairs]).T)
        controls = tuple(np.array([control for _, control in pairs]).T)
        batch = np.stack(
            [np.broadcast_to(v, len(pairs)) for v in self._everything(states, controls)]
        )
        for index, (state, control) in enumerate(pairs):
            single = np.array(self._everything(state, control), dtype=np.float64)
            symbolic = np.asarray(function(state, control)).ravel()
            assert np.allclose(symbolic, single, rtol=1e-9, atol=1e-9), (
                f"NumPy and CasADi disagree by {np.abs(symbolic - single).max():.3g} "
                f"at state {state}, input {control}"
            )
            assert np.allclose(batch[:, index], single, rtol=1e-12, atol=1e-12), (
                f"a batch and a single state disagree at state {state}, input {control}"
            )

    def _everything(self, state: Sequence[Any], control: Sequence[Any]) -> list[Any]:
        """All that a robot computes, as one flat list."""
        robot = self.robot
        pose, twist = robot.pose(state), robot.twist(state, control)
        return [
            *robot.derivative(state, control),
            *robot.constraints(state, control),
            *_placed(pose),
            *_flat(twist),
            *_flat(robot.acceleration(state, control)),
            *robot.state_at(pose, twist),
        ]

    @law("no faster than its largest speed", SpeedLimited, "it names none")
    def check_speed(self) -> None:
        """One step of half a second, where it ends within the limits."""
        robot = self.robot
        assert isinstance(robot, SpeedLimited)
        for state, control in self.pairs:
            end = self._moved(state, control, _DURATION)
            kept = min(robot.constraints(end, control), default=0) >= 0
            if not (kept and _keeps(end, robot.state_bounds())):
                continue
            way = np.linalg.norm(np.subtract(robot.pose(end).position, robot.pose(state).position))
            assert way <= robot.max_speed * _DURATION * (1 + 1e-9), (
                f"it moves {way:.4g} m in {_DURATION:g} s from state {state}; wanted at most "
                f"max_speed, {robot.max_speed:g} m/s"
            )

    @law("Runge-Kutta converges with order four")
    def check_order(self) -> None:
        """One step of 1 s against two of half a second: the error falls by about 2^4.

        The step is shorter where the state would leave its bounds: beyond them the equation need
        not be smooth, as tan of a steering angle is not.
        """
        errors = np.zeros(2)
        for state, control in self.pairs:
            duration = self._time_within_bounds(state, control)
            exact = self._moved(state, control, duration, 64)
            for i, parts in enumerate((1, 2)):
                gap = np.subtract(self._moved(state, control, duration, parts), exact)
                errors[i] += float(np.sum(gap**2))
        coarse, fine = np.sqrt(errors)
        assert coarse < 1e-9 or coarse / fine > 10.0, (
            f"halving the Runge-Kutta step divides the error by {coarse / fine:.3g}; wanted about "
            "16: derivative is not smooth"
        )

    def _time_within_bounds(self, state: State, control: Control) -> float:
        """Return 1 s, or the half of it, ..., so that the state stays in its bounds."""
        duration = 1.0
        for _ in range(5):
            if _keeps(self._moved(state, control, duration, 64), self.robot.state_bounds()):
                break
            duration *= 0.5
        return duration

    def _moved(self, state: State, control: Control, duration: float, parts: int = 1) -> State:
        end = runge_kutta(self.robot.derivative, state, control, duration, parts)
        return tuple(map(float, end))

    @law("pose changes as twist says")
    def check_twist(self) -> None:
        for state, control in self.pairs:
            before, after = self._around(state, control)
            rate = (self._pose(after) - self._pose(before)) / (2 * _STEP)
            pose, twist = self.robot.pose(state), self.robot.twist(state, control)
            wanted = np.array(twist.linear, dtype=np.float64)
            if pose.heading is not None:
                wanted = np.array([*_turn(wanted, pose.heading), twist.angular])
            assert np.allclose(rate, wanted, atol=1e-6), (
                f"pose changes by {rate} per second and twist says {wanted}, at state {state}"
            )

    @law("twist changes as acceleration says")
    def check_acceleration(self) -> None:
        for state, control in self.pairs:
            before, after = (self._twist(end, control) for end in self._around(state, control))
            change = (after - before) / (2 * _STEP)
            acceleration = np.array(_flat(self.robot.acceleration(state, control)))
            assert np.allclose(change, acceleration, atol=1e-6), (
                f"twist changes by {change} per second and acceleration says {acceleration}, "
                f"at state {state}, input {control}"
            )

    def _around(self, state: State, control: Control) -> tuple[State, State]:
        """Return the states `_STEP` before and after."""
        return self._moved(state, control, -_STEP), self._moved(state, control, _STEP)

    @law("state_at inverts pose and twist")
    def check_inverse(self) -> None:
        for state, control in self.pairs:
            self._check_inverse(state, control)

    def _check_inverse(self, state: State, control: Control) -> None:
        robot = self.robot
        again = tuple(map(float, robot.state_at(robot.pose(state), robot.twist(state, control))))
        pose, twist = self._pose(state), self._twist(state, control)
        same = np.allclose(self._pose(again), pose, atol=1e-9)
        same &= np.allclose(self._twist(again, control), twist, atol=1e-9)
        assert same, f"state_at does not lead back to pose and twist of state {state}"

    @law("drive")
    def check_drive(self) -> None:
        for state, wanted in self.drives:
            self._check_drive(state, wanted)

    def _check_drive(self, state: State, wanted: Twist) -> None:
        robot, goal = self.robot, _flat(wanted)
        held, reached = 0, self._twist(state, self.idle)
        for _ in range(800):
            control = tuple(map(float, robot.drive(state, wanted, _TICK)))
            state = self._moved(state, control, _TICK)
            self._assert_kept(state, control)
            reached = self._twist(state, control)
            held = held + 1 if np.abs(reached - goal).max() < 1e-9 else 0
            if held == _HELD:
                return
        assert np.allclose(reached, goal, atol=1e-6), (
            f"drive ends at twist {reached} after 40 s; wanted {goal}"
        )

    @law("drive stays within the limits whatever is asked")
    def check_excess(self) -> None:
        """Ask for far more than any robot can do, ahead and back, to the left and to the right."""
        size = self.robot.dimension
        for state, wanted in self.drives:
            for sign in (-1.0, 1.0):
                ahead = (sign * _EXCESS, *wanted.linear[1:])
                for linear in (ahead, wanted.linear, (0.0,) * size):
                    self._check_excess(state, Twist(linear, _EXCESS * sign))

    def _check_excess(self, state: State, wanted: Twist) -> None:
        robot = self.robot
        for _ in range(_HELD):
            control = tuple(map(float, robot.drive(state, wanted, _TICK)))
            state = self._moved(state, control, _TICK)
            self._assert_kept(state, control)

    def _assert_kept(self, state: State, control: Control) -> None:
        """Refuse a drive that left the limits."""
        robot = self.robot
        _assert_within("an input bound", control, robot.input_bounds())
        _assert_within("a state bound", state, robot.state_bounds())
        worst = min(map(float, robot.constraints(state, control)), default=0.0)
        assert worst >= -1e-9, f"drive breaks a constraint by {-worst:.3g} at state {state}"

    @law("drive of CasADi expressions", SymbolicDrive, "it drives by numbers alone")
    def check_symbolic_drive(self) -> None:
        from ..numerics.symbolic import ca

        robot = self.robot
        assert isinstance(robot, SymbolicDrive)
        hash(robot)
        x, w = ca.SX.sym("x", len(robot.states)), ca.SX.sym("w", robot.dimension + 1)
        state, (*linear, angular) = tuple(ca.vertsplit(x)), ca.vertsplit(w)
        control = robot.drive(state, Twist(tuple(linear), angular), _TICK)
        function = ca.Function("drive", [x, w], [ca.vertcat(*control)])
        for here, wanted in self.drives:
            for twist in (wanted, Twist((0.0,) * robot.dimension)):
                symbolic = np.asarray(function(here, _flat(twist))).ravel()
                single = np.array(robot.drive(here, twist, _TICK), dtype=np.float64)
                assert np.allclose(symbolic, single, rtol=1e-12, atol=1e-12), (
                    f"drive of expressions gives {symbolic} and of floats {single}, at {here}"
                )

    @law("standing")
    def check_standing(self) -> None:
        """Stop from a motion, and set off from a stand; a robot that has to move is exempt."""
        robot, rest = self.robot, Twist((0.0,) * self.robot.dimension)
        for state, wanted in self.drives:
            still = tuple(map(float, robot.state_at(robot.pose(state), rest)))
            assert np.isfinite(still).all(), f"state_at returns {still} for a twist of zero"
            if _keeps(still, robot.state_bounds()):
                self._check_inverse(still, self.idle)
                self._check_drive(still, rest)
                self._check_drive(still, wanted)
                self._check_drive(state, rest)

    @law("turning the start")
    def check_turned(self, rng: np.random.Generator) -> None:
        """Drive from a turned and shifted start; the end must be turned and shifted as well."""
        robot, size = self.robot, self.robot.dimension
        shift = np.arange(1.0, size + 1.0)
        for start, wanted in self.drives:
            angle = float(rng.uniform(-np.pi, np.pi))
            pose, twist, goal = robot.pose(start), robot.twist(start, self.idle), wanted
            place = tuple(_turn(np.array(pose.position), angle) + shift)
            expected = self._driven(start, wanted)
            expected[:size] = _turn(expected[:size], angle) + shift
            if pose.heading is None:
                moved = Pose(place)
                goal, twist = (Twist(tuple(_turn(np.array(one.linear), angle)))
                               for one in (wanted, twist))  # fmt: skip
            else:
                moved = Pose(place, pose.heading + angle)
                expected[-1] += angle
            end = self._driven(robot.state_at(moved, twist), goal)
            assert np.allclose(end, expected, atol=1e-8), (
                f"turning the start by {angle:.3g} rad moves the end to {end}; wanted {expected}"
            )

    def _driven(self, state: Sequence[Any], wanted: Twist) -> Array:
        """Return the pose after a second."""
        point = tuple(map(float, state))
        for _ in range(20):
            point = self._moved(point, self.robot.drive(point, wanted, _TICK), _TICK)
        return self._pose(point)

    def _pose(self, state: State) -> Array:
        return np.array(_placed(self.robot.pose(state)), dtype=np.float64)

    def _twist(self, state: State, control: Control) -> Array:
        return np.array(_flat(self.robot.twist(state, control)), dtype=np.float64)


def _within(bounds: Bounds, rng: np.random.Generator, reach: float) -> tuple[float, ...]:
    low, high = np.maximum(bounds.lower, -reach), np.minimum(bounds.upper, reach)
    return tuple(float(value) for value in rng.uniform(low, high))


def _beyond(values: Sequence[float], bounds: Bounds) -> list[tuple[float, float, float]]:
    """Return values that are out of their bounds, with these."""
    return [
        (value, low, high)
        for value, low, high in zip(values, bounds.lower, bounds.upper, strict=True)
        if not low - 1e-9 <= value <= high + 1e-9
    ]


def _keeps(values: Sequence[float], bounds: Bounds) -> bool:
    return not _beyond(values, bounds)


def _assert_within(what: str, values: tuple[float, ...], bounds: Bounds) -> None:
    for value, low, high in _beyond(values, bounds):
        raise AssertionError(f"drive breaks {what}: {value:g} is not within [{low:g}, {high:g}]")


def _turn(vector: Array, angle: float) -> Array:
    """Turn about the vertical axis."""
    return np.concatenate([plane_turn(angle) @ vector[:2], vector[2:]])


def _placed(pose: Pose) -> list[Any]:
    return [*pose.position, *(() if pose.heading is None else (pose.heading,))]


def _flat(twist: Twist) -> list[Any]:
    return [*twist.linear, twist.angular]
