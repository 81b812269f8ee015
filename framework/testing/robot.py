"""The laws of `Robot` as a check that any robot can run on itself."""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any, TypeAlias

import numpy as np

from ..numerics.integration import runge_kutta
from ..robot import Bounds, Robot, SpeedLimited, SymbolicDrive
from ..values.arrays import Array
from ..values.motion import Pose, Twist
from .laws import Law, each, require

State: TypeAlias = tuple[float, ...]
Pair: TypeAlias = tuple[State, tuple[float, ...]]
"""A state and an input."""
_STEP = 1e-4
"""s, of central differences."""
_HELD = 20
"""Steps of 50 ms that a wanted twist is held for when a drive has ended."""
_DURATION = 0.5
"""s, of one step in which the way is measured."""
_SAMPLES = 40
_REACH = 5.0
"""m (or rad): states without limits are drawn up to here."""


def check_robot(robot: Robot, *, rng: np.random.Generator | None = None) -> None:
    """Check every law of `wideberth.framework.robot.Robot`.

    Names and bounds fit together; a footprint lies within the radius and turns with a heading;
    it is no faster than its largest speed, if it names one;
    NumPy (one state or a batch) and CasADi agree; pose changes as twist says and twist as
    acceleration (central differences); `state_at` is the inverse of pose and twist; one
    Runge-Kutta step has order four; turning the start turns the motion; `drive` keeps every
    limit and reaches twists that the robot can have; both also serve a robot that stands, if
    its bounds let it stand. A `SymbolicDrive` drives alike with CasADi expressions.

    Parameters
    ----------
    robot : to be checked.
    rng : where states and inputs are drawn from; the same ones each time by default.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    require(laws(robot, rng=rng))


def laws(robot: Robot, *, rng: np.random.Generator | None = None) -> tuple[Law, ...]:
    """Return the laws of a robot; the arguments are those of `check_robot`."""
    drawn, turned = (np.random.default_rng(0) if rng is None else rng).spawn(2)

    free = "" if isinstance(robot, SpeedLimited) else "it names no largest speed"

    @cache
    def pairs() -> list[Pair]:
        return [_draw(robot, drawn) for _ in range(_SAMPLES)]

    def drives() -> list[tuple[State, Twist]]:
        """Return states to drive from, and twists that the robot can have."""
        both = zip(pairs()[::2], pairs()[1::2], strict=True)
        return [(start, robot.twist(*goal)) for (start, _), goal in both]

    symbolic_drive: tuple[Law, ...] = ()
    if isinstance(robot, SymbolicDrive):
        symbolic_drive = (
            Law("drive of CasADi expressions", lambda: _check_symbolic_drive(robot, drives())),
        )
    return (
        Law("names and bounds", lambda: _check_bounds(robot)),
        Law("NumPy and CasADi agree", lambda: _check_casadi(robot, pairs())),
        Law("no faster than its largest speed", each(partial(_check_speed, robot), pairs), free),
        Law("Runge-Kutta converges with order four", lambda: _check_order(robot, pairs())),
        Law("pose changes as twist says", each(partial(_check_twist, robot), pairs)),
        Law(
            "twist changes as acceleration says", each(partial(_check_acceleration, robot), pairs)
        ),
        Law("state_at inverts pose and twist", each(partial(_check_inverse, robot), pairs)),
        Law("drive", each(partial(_check_drive, robot), drives)),
        *symbolic_drive,
        Law("standing", each(partial(_check_standing, robot), drives)),
        Law("turning the start", each(partial(_check_turned, robot, turned), drives)),
    )


def _check_bounds(robot: Robot) -> None:
    assert robot.radius > 0, f"radius is {robot.radius}; wanted above 0"
    if robot.footprint is not None:
        assert robot.footprint.reach <= robot.radius * (1 + 1e-9), (
            f"the footprint reaches {robot.footprint.reach:g} m, beyond radius {robot.radius:g} m"
        )
        heading = robot.pose(tuple(0.0 for _ in robot.states)).heading
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
        assert all(a < b for a, b in zip(bounds.lower, bounds.upper, strict=True)), (
            f"{what}_bounds: a lower bound is not below its upper bound"
        )
        assert len({q.name for q in names}) == count, f"{what} names repeat"


def _draw(robot: Robot, rng: np.random.Generator) -> Pair:
    """Draw a state and an input that keep all limits."""
    for _ in range(1000):
        state = _within(robot.state_bounds(), rng, _REACH)
        control = _within(robot.input_bounds(), rng, 1.0)
        if all(value >= 0 for value in robot.constraints(state, control)):
            return state, control
    raise AssertionError("constraints: none of 1000 draws within the bounds keeps them")


def _within(bounds: Bounds, rng: np.random.Generator, reach: float) -> tuple[float, ...]:
    low = np.maximum(bounds.lower, -reach)
    high = np.minimum(bounds.upper, reach)
    return tuple(float(v) for v in rng.uniform(low, high))


def _everything(robot: Robot, state: Sequence[Any], control: Sequence[Any]) -> list[Any]:
    """All that a robot computes, as one flat list."""
    pose, twist = robot.pose(state), robot.twist(state, control)
    acceleration = robot.acceleration(state, control)
    heading = () if pose.heading is None else (pose.heading,)
    return [
        *robot.derivative(state, control),
        *robot.constraints(state, control),
        *pose.position,
        *heading,
        *twist.linear,
        twist.angular,
        *acceleration.linear,
        acceleration.angular,
        *robot.state_at(pose, twist),
    ]


def _check_casadi(robot: Robot, pairs: list[Pair]) -> None:
    from ..numerics.symbolic import ca

    x, u = ca.SX.sym("x", len(robot.states)), ca.SX.sym("u", len(robot.inputs))
    values = _everything(robot, ca.vertsplit(x), ca.vertsplit(u))
    function = ca.Function("robot", [x, u], [ca.vertcat(*values)])
    states = tuple(np.array([state for state, _ in pairs]).T)
    controls = tuple(np.array([control for _, control in pairs]).T)
    batch = np.stack(
        [np.broadcast_to(v, len(pairs)) for v in _everything(robot, states, controls)]
    )
    for index, (state, control) in enumerate(pairs):
        single = np.array(_everything(robot, state, control), dtype=np.float64)
        symbolic = np.asarray(function(state, control)).ravel()
        assert np.allclose(symbolic, single, rtol=1e-9, atol=1e-9), (
            f"NumPy and CasADi disagree by {np.abs(symbolic - single).max():.3g} "
            f"at state {state}, input {control}"
        )
        assert np.allclose(batch[:, index], single, rtol=1e-12, atol=1e-12), (
            f"a batch and a single state disagree at state {state}, input {control}"
        )


def _check_speed(robot: Robot, pair: Pair) -> None:
    """One step of half a second, where it ends within the limits."""
    assert isinstance(robot, SpeedLimited)
    state, control = pair
    end = tuple(map(float, runge_kutta(robot.derivative, state, control, _DURATION)))
    if (
        not _keeps(end, robot.state_bounds())
        or min(robot.constraints(end, control), default=0) < 0
    ):
        return
    way = np.linalg.norm(np.subtract(robot.pose(end).position, robot.pose(state).position))
    assert way <= robot.max_speed * _DURATION * (1 + 1e-9), (
        f"it moves {way:.4g} m in {_DURATION:g} s from state {state}; wanted at most max_speed, "
        f"{robot.max_speed:g} m/s"
    )


def _check_order(robot: Robot, pairs: list[Pair]) -> None:
    """One step of 1 s against two of half a second: the error falls by about 2^4.

    The step is shorter where the state would leave its bounds: beyond them the equation need not
    be smooth, as tan of a steering angle is not.
    """
    errors = np.zeros(2)
    for state, control in pairs:
        duration = _time_within_bounds(robot, state, control)
        exact = np.array(runge_kutta(robot.derivative, state, control, duration, 64))
        for i, parts in enumerate((1, 2)):
            moved = np.array(runge_kutta(robot.derivative, state, control, duration, parts))
            errors[i] += float(np.sum((moved - exact) ** 2))
    coarse, fine = np.sqrt(errors)
    assert coarse < 1e-9 or coarse / fine > 10.0, (
        f"halving the Runge-Kutta step divides the error by {coarse / fine:.3g}; wanted about "
        "16: derivative is not smooth"
    )


def _time_within_bounds(robot: Robot, state: State, control: tuple[float, ...]) -> float:
    """Return 1 s, or the half of it, or a quarter, ..., so that the state stays in its bounds."""
    duration = 1.0
    for _ in range(5):
        end = runge_kutta(robot.derivative, state, control, duration, 64)
        if _keeps(tuple(map(float, end)), robot.state_bounds()):
            break
        duration *= 0.5
    return duration


def _check_twist(robot: Robot, pair: Pair) -> None:
    state, control = pair
    before, after = _around(robot, pair)
    rate = (_pose(robot, after) - _pose(robot, before)) / (2 * _STEP)
    wanted = _world(robot, state, control)
    assert np.allclose(rate, wanted, atol=1e-6), (
        f"pose changes by {rate} per second and twist says {wanted}, at state {state}"
    )


def _check_acceleration(robot: Robot, pair: Pair) -> None:
    state, control = pair
    before, after = _around(robot, pair)
    change = (_twist(robot, after, control) - _twist(robot, before, control)) / (2 * _STEP)
    acceleration = _flat(robot.acceleration(state, control))
    assert np.allclose(change, acceleration, atol=1e-6), (
        f"twist changes by {change} per second and acceleration says {acceleration}, "
        f"at state {state}, input {control}"
    )


def _around(robot: Robot, pair: Pair) -> tuple[Sequence[Any], Sequence[Any]]:
    """Return the states `_STEP` before and after."""
    before, after = (runge_kutta(robot.derivative, *pair, h) for h in (-_STEP, _STEP))
    return before, after


def _check_inverse(robot: Robot, pair: Pair) -> None:
    state, control = pair
    again = robot.state_at(robot.pose(state), robot.twist(state, control))
    twist = robot.twist(tuple(map(float, again)), control)
    assert np.allclose(_pose(robot, again), _pose(robot, state), atol=1e-9) and np.allclose(
        _flat(twist), _twist(robot, state, control), atol=1e-9
    ), f"state_at does not lead back to pose and twist of state {state}"


def _check_drive(robot: Robot, drive: tuple[State, Twist]) -> None:
    state, wanted = drive
    control = (0.0,) * len(robot.inputs)
    bounds, inputs = robot.state_bounds(), robot.input_bounds()
    held, reached = 0, _twist(robot, state, control)
    for _ in range(800):
        control = tuple(map(float, robot.drive(state, wanted, 0.05)))
        _assert_within("an input bound", control, inputs)
        state = tuple(map(float, runge_kutta(robot.derivative, state, control, 0.05)))
        _assert_within("a state bound", state, bounds)
        worst = min(map(float, robot.constraints(state, control)), default=0.0)
        assert worst >= -1e-9, f"drive breaks a constraint by {-worst:.3g} at state {state}"
        reached = _twist(robot, state, control)
        held = held + 1 if np.abs(reached - _flat(wanted)).max() < 1e-9 else 0
        if held == _HELD:
            return
    assert np.allclose(reached, _flat(wanted), atol=1e-6), (
        f"drive ends at twist {reached} after 40 s; wanted {_flat(wanted)}"
    )


def _check_symbolic_drive(robot: SymbolicDrive, drives: list[tuple[State, Twist]]) -> None:
    from ..numerics.symbolic import ca

    hash(robot)
    x, w = ca.SX.sym("x", len(robot.states)), ca.SX.sym("w", robot.dimension + 1)
    state, (*linear, angular) = tuple(ca.vertsplit(x)), ca.vertsplit(w)
    control = robot.drive(state, Twist(tuple(linear), angular), 0.05)
    function = ca.Function("drive", [x, w], [ca.vertcat(*control)])
    for here, wanted in drives:
        for twist in (wanted, Twist((0.0,) * robot.dimension)):
            symbolic = np.asarray(function(here, _flat(twist))).ravel()
            single = np.array(robot.drive(here, twist, 0.05), dtype=np.float64)
            assert np.allclose(symbolic, single, rtol=1e-12, atol=1e-12), (
                f"drive of expressions gives {symbolic} and of floats {single}, at state {here}"
            )


def _check_standing(robot: Robot, drive: tuple[State, Twist]) -> None:
    """Stop from a motion, and set off from a stand; a robot that has to move is exempt."""
    state, wanted = drive
    rest = Twist((0.0,) * len(wanted.linear))
    still = tuple(map(float, robot.state_at(robot.pose(state), rest)))
    assert np.isfinite(still).all(), f"state_at returns {still} for a twist of zero"
    bounds = robot.state_bounds()
    if not _keeps(still, bounds):
        return
    _check_inverse(robot, (still, (0.0,) * len(robot.inputs)))
    _check_drive(robot, (still, rest))
    _check_drive(robot, (still, wanted))
    _check_drive(robot, (state, rest))


def _keeps(values: Sequence[float], bounds: Bounds) -> bool:
    return all(
        low - 1e-9 <= value <= high + 1e-9
        for value, low, high in zip(values, bounds.lower, bounds.upper, strict=True)
    )


def _check_turned(robot: Robot, rng: np.random.Generator, drive: tuple[State, Twist]) -> None:
    """Drive from a turned and shifted start; the end must be turned and shifted as well."""
    start, wanted = drive
    angle = float(rng.uniform(-np.pi, np.pi))
    pose = robot.pose(start)
    twist = robot.twist(start, (0.0,) * len(robot.inputs))
    shift = np.arange(1.0, robot.dimension + 1.0)
    place = _turn(np.array(pose.position), angle) + shift
    if pose.heading is None:
        moved = Pose(tuple(place))
        goal = Twist(tuple(_turn(np.array(wanted.linear), angle)))
        twist = Twist(tuple(_turn(np.array(twist.linear), angle)))
    else:
        moved, goal = Pose(tuple(place), pose.heading + angle), wanted
    end = _pose(robot, _driven(robot, start, wanted))
    other = _pose(robot, _driven(robot, robot.state_at(moved, twist), goal))
    expected = np.array(end)
    expected[: robot.dimension] = _turn(end[: robot.dimension], angle) + shift
    if pose.heading is not None:
        expected[-1] += angle
    assert np.allclose(other, expected, atol=1e-8), (
        f"turning the start by {angle:.3g} rad moves the end to {other}; wanted {expected}"
    )


def _driven(robot: Robot, state: Sequence[Any], wanted: Twist) -> tuple[float, ...]:
    point = tuple(map(float, state))
    for _ in range(20):
        control = robot.drive(point, wanted, 0.05)
        point = tuple(map(float, runge_kutta(robot.derivative, point, control, 0.05)))
    return point


def _assert_within(what: str, values: tuple[float, ...], bounds: Bounds) -> None:
    for value, low, high in zip(values, bounds.lower, bounds.upper, strict=True):
        assert low - 1e-9 <= value <= high + 1e-9, (
            f"drive breaks {what}: {value:g} is not within [{low:g}, {high:g}]"
        )


def _turn(vector: Array, angle: float) -> Array:
    """Turn about the vertical axis."""
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array(vector)
    turned[0], turned[1] = c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]
    return turned


def _pose(robot: Robot, state: Sequence[Any]) -> Array:
    pose = robot.pose(state)
    heading = () if pose.heading is None else (pose.heading,)
    return np.array([*pose.position, *heading], dtype=np.float64)


def _twist(robot: Robot, state: Sequence[Any], control: Sequence[Any]) -> Array:
    return _flat(robot.twist(state, control))


def _flat(twist: Twist) -> Array:
    return np.array([*twist.linear, twist.angular], dtype=np.float64)


def _world(robot: Robot, state: Sequence[Any], control: Sequence[Any]) -> Array:
    """Rate of the pose that the twist stands for."""
    pose, twist = robot.pose(state), robot.twist(state, control)
    linear = np.array(twist.linear, dtype=np.float64)
    if pose.heading is None:
        return linear
    return np.array([*_turn(linear, pose.heading), twist.angular], dtype=np.float64)
