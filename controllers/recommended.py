"""The recommended planner for a robot and a speed, in one call."""

import logging
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import ceil
from typing import Any

from ..framework.control.command_limits import broken_limit
from ..framework.mpc.costs.base import Weights
from ..framework.mpc.costs.tracking import Tracking
from ..framework.mpc.planner.planner import Planner
from ..framework.mpc.planner.settings import PlannerSettings, doubts
from ..framework.plugins.config import build, describe
from ..framework.plugins.njit import LOG
from ..framework.plugins.registry import choices, load
from ..framework.plugins.yamlfile import shared_settings
from ..framework.robot import Robot, SpeedLimited, start_state, step
from ..framework.values.arrays import positive
from ..framework.values.errors import WideberthError, short
from ..framework.values.motion import Command, Twist
from .costs.contouring import Contouring
from .costs.smooth_tracking import SmoothTracking

SPEED, STEP = 0.5, 0.5
"""m/s and s: the speed and the step that the weights of `Weights` are made for (the paper's)."""
AHEAD, STOPPING = 5.0, 7.5
"""s that a plan reaches ahead at least: for people who walk, and, over k, for the weights."""
FASTEST = 10.0
"""m/s that the setting is scaled to: plans of 200 steps of 25 ms. Nothing of it was measured."""
HEADROOM = 1.4
"""Largest speed of a robot over its reference speed (the paper's 0.7 m/s over 0.5 m/s)."""
PERSON, MOST_ASIDE, LONGEST_ASIDE = 0.3, 3.5, 20.0
"""m, s and s: radius of a person; longest time to move aside that suits people; longest sought."""
TRACKING, SMOOTH = "tracking", "smooth_tracking"
"""Cost unless another one is named, and that of a robot whose velocity acts at once."""
_TICK, _RATES = 0.05, (0.1, 0.2, 0.5, 1.0, 2.0, 4.0)
"""s, and rad/s: step, and yaw rates that are tried, when the time to move aside is sought."""
_POWERS = {
    **{"max_speed": 1, "max_wheel_speed": 1, "max_yaw_rate": 1, "max_steering_rate": 1},
    **{"max_acceleration": 1, "max_wheel_acceleration": 1, "max_yaw_acceleration": 2},
}
"""Limit of a robot -> the power of k with which it grows for a robot that is k times as fast."""


def recommended(
    robot: str | Mapping[str, Any] | Robot = "unicycle",
    speed: float | None = None,
    *,
    quiet: bool = False,
    **settings: Any,
) -> Planner:
    """Return our recommended planner for a robot that drives at a speed.

    The same planner as ``{<<: recommended, robot: ..., reference_speed: ...}`` in a config, see
    `completed`. Predictor, region, level, solver, penalty and margin are those of
    ``framework/recommended.yaml``. The weights of the cost, the step and the horizon follow the
    speed. A robot that is k = speed / 0.5 m/s times as fast drives the same way in 1/k of the
    time, so that every weight is divided by the power of k that its unit has of time::

        k = max(speed / (0.5 m/s), 1)   dt = 0.5 s / k   N = max(15, 5 s / dt, 7.5 s / (k dt))
        w_p = 100     w_v = 10 / k^2       w_a = 1e4 / k^4     w_alpha = 500 / k^4

    At 0.5 m/s and below these are the paper's numbers, and the planner that the studies recommend.
    Kept at 1 m/s, they let the robot arrive too fast to stop, and it circles its goal. The horizon
    reaches 5 s ahead or more, as people who walk need it, and 7.5 s / k, in which a robot with
    these weights stops: their time constant is (w_a / w_p)^(1/4) = 3.2 s / k, and a plan of 5 s
    at 0.5 m/s would run 0.5 m past the end of the path. The controller's period and the samples
    of tracks are one step long. The cost is ``tracking``, and ``smooth_tracking`` for a robot
    whose velocity acts at once: planned without a price on its changes, such robots turned by 60
    degrees from one step to the next and collided with each other.

    Parameters
    ----------
    robot : a name, a config, or a `Robot`. A robot given by its name alone gets limits for the
        speed: where the largest speed is below 1.4 times the speed, all limits grow with it (the
        yaw acceleration with its square), so that the smallest turning circle stays. A config or
        a `Robot` is taken as it is.
    speed : m/s, along the path; None for 1/1.4 of the robot's largest speed.
    quiet : print nothing, and log no compilation of loops in this process from now on; otherwise
        a line says each choice and its reason.
    settings : any other of `PlannerSettings`, instead of the recommended ones. A step ``dt`` sets
        the horizon, the period and the samples of tracks too, unless they are given.

    Raises
    ------
    WideberthError : an unknown robot, a speed not above 0 or beyond 10 m/s (km/h are no m/s), a
        robot that cannot drive at it, or settings that `PlannerSettings` refuses.

    Examples
    --------
    >>> planner = recommended("unicycle", speed=1.0, quiet=True)
    >>> planner.dt, planner.horizon, planner.cost.weights.acceleration
    (0.25, 20, 625.0)
    """
    if speed is not None and "reference_speed" in settings:
        raise WideberthError(
            f"speed is {speed!r} and reference_speed is {settings['reference_speed']!r}: they are "
            "the same setting, state one of them"
        )
    chosen = {} if speed is None else {"reference_speed": speed}
    given = {**settings, "robot": robot, **chosen}
    if quiet:
        LOG.setLevel(logging.ERROR)
    planner: Planner = build("controllers", completed(given))
    if not quiet:
        changes = _robot_for(robot, planner.reference_speed)[1]
        print("\n".join(_choices(planner, changes)))
    return planner


def completed(given: Mapping[str, Any], path: str = "") -> dict[str, Any]:
    """Our recommended planner: what its settings leave open follows from robot and speed.

    How it follows stands at `recommended`. Without a speed it is 1/1.4 of the robot's largest.
    A step ``dt`` sets the horizon, the period and the samples of tracks too, unless they are
    given. What is made is a planner of ``type: mpc``.

    Parameters
    ----------
    given : settings of a planner, ``robot`` and ``reference_speed`` among them.
    path : where they stand in a config, for messages.

    Raises
    ------
    WideberthError : as `recommended`.
    """
    settings = shared_settings("recommended") | {"type": "mpc"} | dict(given)
    if "robot" not in given:
        return settings
    place = f"{path}." if path else ""
    named = given["robot"]
    own: Robot = build("robots", named, f"{place}robot")
    speed = _fitting_speed(own) if "reference_speed" not in given else given["reference_speed"]
    if positive(f"{place}reference_speed", speed) > FASTEST:
        raise WideberthError(
            f"{place}reference_speed is {speed:g} m/s; wanted at most {FASTEST:g} m/s, at which a "
            f"step of the recommended planner is {SPEED * STEP / FASTEST:g} s ({speed:g} km/h are "
            f"{speed / 3.6:.3g} m/s); for a robot that is so fast state a planner of `type: mpc`"
        )
    robot, _ = _robot_for(named, speed)
    _check_speed(robot, speed, place)
    k = max(speed / SPEED, 1.0)
    dt = positive(f"{place}dt", given.get("dt", STEP / k))
    derived: dict[str, Any] = {
        "reference_speed": float(speed),
        "dt": dt,
        "period": dt,
        "track_dt": dt,
        "horizon": max(PlannerSettings.horizon, ceil(max(AHEAD, STOPPING / k) / dt - 1e-9)),
    }
    cost = _scaled_cost(given.get("cost", {}), k, robot)
    derived |= for_polygons(robot)
    return settings | {**derived, **given, "type": "mpc", "robot": robot, "cost": cost}


def for_polygons(robot: Robot) -> dict[str, str]:
    """Return the settings with which a planner minds polygons, which lie in the plane."""
    return {"static_region": "separating_line"} if robot.dimension == 2 else {}


def velocity_acts_at_once(robot: Robot) -> bool:
    """Whether a robot's velocity is its input and no part of its state."""
    ahead = (1.0, *(0.0,) * (robot.dimension - 1))
    state, _ = start_state(robot, (0.0,) * robot.dimension, ahead, 0.1)
    return not any(robot.twist(state, (0.0,) * len(robot.inputs)).linear)


def _scaled_cost(cost: Any, k: float, robot: Robot) -> Any:
    """Return the config of a cost whose type and weights, where none are stated, are ours."""
    settings = {"type": cost} if isinstance(cost, str) else cost
    if isinstance(settings, Mapping) and not {"type", "saved"} & {*settings}:
        usual = SMOOTH if velocity_acts_at_once(robot) else TRACKING
        settings = {"type": usual, **settings}
    kind = settings.get("type") if isinstance(settings, Mapping) else None
    known = load("costs", kind) if kind in choices("costs") else None
    if known not in (Tracking, SmoothTracking, Contouring):
        return cost  # made already, of a user's own, or refused by `build`
    defaults, stated = describe(known().scaled(k)), settings.get("weights", {})
    if not isinstance(stated, Mapping):
        return cost
    return {**defaults, **settings, "weights": {**defaults["weights"], **stated}}


def _fitting_speed(robot: Robot) -> float:
    """Return the speed for a robot that is given without one, m/s."""
    fastest = robot.max_speed if isinstance(robot, SpeedLimited) else HEADROOM * SPEED
    return round(fastest / HEADROOM, 3)


def _robot_for(robot: Any, speed: float) -> tuple[Robot, str]:
    """Return the robot, and what was changed of its limits; nothing unless given by name."""
    model: Robot = build("robots", robot, "robot")
    if not isinstance(robot, str) or not isinstance(model, SpeedLimited):
        return model, ""
    k = HEADROOM * speed / model.max_speed
    if k <= 1.0 + 1e-9 or not is_dataclass(model):
        return model, ""
    limits = {
        entry.name: round(getattr(model, entry.name) * k ** _POWERS[entry.name], 6)
        for entry in fields(model)
        if entry.name in _POWERS
    }
    fast: Robot = load("robots", robot)(**limits)
    return fast, ", ".join(f"{name} {value:g}" for name, value in limits.items())


def _check_speed(robot: Robot, speed: float, place: str) -> None:
    """Refuse a robot that cannot drive straight on at this speed, which stands in ``place``.

    Raises
    ------
    WideberthError : it cannot.
    """
    ahead = (1.0, *(0.0,) * (robot.dimension - 1))
    _, twist = start_state(robot, (0.0,) * robot.dimension, ahead, speed)
    if broken_limit(robot, Command(tuple(float(v) for v in twist.linear))):
        limit = f"at most {robot.max_speed:g} m/s" if isinstance(robot, SpeedLimited) else "less"
        raise WideberthError(
            f"{place}reference_speed is {speed:g} m/s; {short(robot)} can drive {limit}: take a "
            "lower speed, or give the robot higher limits"
        )


def slow_aside(robot: Robot, speed: float) -> str:
    """Warn of a robot that moves aside too slowly for people who make no way; empty for others.

    It drives at ``speed`` and steers as hard as it can, until it is its own radius and that of a
    person (0.3 m) away from its line. The bound `MOST_ASIDE` lies between a robot that takes 2.9 s
    and had no contact in four episodes of ``recorded_scene``, and one that takes 4.5 s and was
    touched in all four; people walk 4.7 m in that time.
    """
    distance = robot.radius + PERSON
    needed = min(_time_aside(robot, speed, rate, distance) for rate in _RATES)
    if needed <= MOST_ASIDE:
        return ""
    span = f"{needed:.1f} s" if needed < LONGEST_ASIDE else f"more than {LONGEST_ASIDE:g} s"
    return (
        f"this robot takes {span} at {speed:g} m/s to move aside by {distance:g} m (its radius "
        f"and a person's); above {MOST_ASIDE:g} s people who make no way may walk into it: state "
        "the limits that it really has (those not given are the paper's), or a higher speed"
    )


def _time_aside(robot: Robot, speed: float, rate: float, distance: float) -> float:
    """Return when the robot is this far from its line if it turns at a rate, s."""
    ahead = (1.0, *(0.0,) * (robot.dimension - 1))
    state, _ = start_state(robot, (0.0,) * robot.dimension, ahead, speed)
    turning = Twist((speed, 0.0), rate)
    if robot.pose(state).heading is None:
        turning = Twist((0.0, 1e3, *(0.0,) * (robot.dimension - 2)))
    now = 0.0
    while abs(float(robot.pose(state).position[1])) < distance and now < LONGEST_ASIDE:
        control = robot.drive(state, turning, _TICK)
        state = tuple(float(value) for value in step(robot, state, control, _TICK))
        now += _TICK
    return now


def _at_walls(planner: PlannerSettings) -> str:
    return "" if planner.wall_margin is None else f"; {planner.wall_margin:g} m before walls"


def _choices(planner: Planner, fitted: str) -> list[str]:
    """Say what was chosen and why, a line each."""
    name = describe(planner.robot).get("type", type(planner.robot).__name__)
    predictor, region, level, solver, cost = (
        describe(getattr(planner, part))["type"]
        for part in ("predictor", "region", "level", "solver", "cost")
    )
    tail, weights = describe(planner.level).get("tail", 0.05), getattr(planner.cost, "weights", "")
    ahead, speed = planner.horizon * planner.dt, planner.reference_speed
    if isinstance(weights, Weights):
        weights = (
            f" of position {weights.position:g}, speed {weights.speed:.4g}, acceleration "
            f"{weights.acceleration:.4g}, yaw acceleration {weights.yaw_acceleration:.4g}: the "
            "paper's at 0.5 m/s, less for a faster robot"
        )
    rows = {
        "robot": f"{name} of radius {planner.robot.radius:g} m",
        "speed": f"{speed:g} m/s along the path",
        "limits": fitted or "its own",
        "predictor": f"{predictor}: where people may be, with a spread that covers what they do",
        "region": f"{region}: {100 * (1 - tail):g} % of where an obstacle may be, and both radii",
        "level": f"{level}: gives way at a price where that is worth it",
        "margin": f"{planner.margin:g} m: regions hold at the steps alone{_at_walls(planner)}",
        "cost": f"{cost}{weights}",
        "horizon": f"{planner.horizon} steps of {planner.dt:.3g} s, {ahead:.3g} s and "
        f"{ahead * speed:.3g} m ahead; call it every {planner.period:.3g} s",
        "solver": solver,
        "beware": "; ".join(filter(None, (slow_aside(planner.robot, speed), *doubts(planner)))),
    }
    return [f"{key:<10}{text}" for key, text in rows.items() if text]
