"""The recommended planner for a robot and a speed, in one call."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import ceil
from typing import Any

from ...control.command_limits import broken_limit
from ...plugins.config import build, describe
from ...plugins.registry import load
from ...plugins.yamlfile import shared_settings
from ...robot import Robot, SpeedLimited, start_state
from ...values.arrays import positive
from ...values.errors import WideberthError, short
from ...values.motion import Command
from ..costs.base import Weights
from .planner import Planner
from .settings import PlannerSettings

SPEED, STEP = 0.5, 0.5
"""m/s and s: the speed and the step that the weights of `Weights` are made for (the paper's)."""
AHEAD = 5.0
"""s that a plan reaches ahead at least."""
HEADROOM = 1.4
"""Largest speed of a robot over its reference speed (the paper's 0.7 m/s over 0.5 m/s)."""
_POWERS = {
    **{"max_speed": 1, "max_wheel_speed": 1, "max_yaw_rate": 1, "max_steering_rate": 1},
    **{"max_acceleration": 1, "max_wheel_acceleration": 1, "max_yaw_acceleration": 2},
}
"""Limit of a robot -> the power of k with which it grows for a robot that is k times as fast."""


def recommended(
    robot: str | Mapping[str, Any] | Robot = "unicycle", speed: float = 1.0, *, quiet: bool = False
) -> Planner:
    """Return our recommended planner for a robot that drives at a speed.

    Predictor, region, level, solver, penalty and margin are those of
    ``framework/recommended.yaml``. The weights of the cost, the step and the horizon follow the
    speed. A robot that is k = speed / 0.5 m/s times as fast drives the same way in 1/k of the
    time, so that every weight is divided by the power of k that its unit has of time::

        k = max(speed / (0.5 m/s), 1)      dt = 0.5 s / k      N = max(15, 5 s / dt)
        w_p = 100     w_v = 10 / k^2       w_a = 1e4 / k^4     w_alpha = 500 / k^4

    At 0.5 m/s and below these are the paper's numbers, and the planner that the studies recommend.
    Kept at 1 m/s, they let the robot arrive too fast to stop, and it circles its goal. The horizon
    reaches 5 s ahead or more, as people who walk need it. The controller's period and the samples
    of tracks are one step long.

    Parameters
    ----------
    robot : a name, a config, or a `Robot`. A robot given by its name alone gets limits for the
        speed: where the largest speed is below 1.4 times the speed, all limits grow with it (the
        yaw acceleration with its square), so that the smallest turning circle stays. A config or
        a `Robot` is taken as it is.
    speed : m/s, along the path.
    quiet : print nothing; otherwise a line says each choice and its reason.

    Raises
    ------
    WideberthError : an unknown robot, a speed not above 0, or a robot that cannot drive at it.

    Examples
    --------
    >>> planner = recommended("unicycle", speed=1.0, quiet=True)
    >>> planner.dt, planner.horizon, planner.cost.weights.acceleration
    (0.25, 20, 625.0)
    """
    positive("speed", speed)
    model, fitted = _robot_for(robot, speed)
    _check_speed(model, speed)
    k = max(speed / SPEED, 1.0)
    dt = STEP / k
    weights = scaled_weights(k)
    settings = shared_settings("recommended") | {
        "robot": model,
        "reference_speed": float(speed),
        "cost": {"type": "tracking", "weights": weights},
        "dt": dt,
        "period": dt,
        "track_dt": dt,
        "horizon": max(PlannerSettings.horizon, ceil(AHEAD / dt - 1e-9)),
    }
    if model.dimension == 2:
        settings["static_region"] = "separating_line"
    planner: Planner = build("controllers", settings)
    if not quiet:
        print("\n".join(_choices(planner, settings, fitted)))
    return planner


def scaled_weights(k: float) -> Weights:
    """Return the paper's weights for a robot that is k times as fast, see `recommended`."""
    paper = Weights()
    return Weights(
        paper.position,
        paper.speed / k**2,
        paper.acceleration / k**4,
        paper.yaw_acceleration / k**4,
    )


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


def _check_speed(robot: Robot, speed: float) -> None:
    """Refuse a robot that cannot drive straight on at this speed.

    Raises
    ------
    WideberthError : it cannot.
    """
    ahead = (1.0, *(0.0,) * (robot.dimension - 1))
    _, twist = start_state(robot, (0.0,) * robot.dimension, ahead, speed)
    if broken_limit(robot, Command(tuple(float(v) for v in twist.linear))):
        limit = f"at most {robot.max_speed:g} m/s" if isinstance(robot, SpeedLimited) else "less"
        raise WideberthError(
            f"speed is {speed:g} m/s; {short(robot)} can drive {limit}: take a lower speed, or "
            "give the robot higher limits"
        )


def _choices(planner: Planner, settings: Mapping[str, Any], fitted: str) -> list[str]:
    """Say what was chosen and why, a line each."""
    name = describe(planner.robot).get("type", type(planner.robot).__name__)
    predictor = describe(planner.predictor)["type"]
    region, level = (describe(part)["type"] for part in (planner.region, planner.level))
    tail, weights = describe(planner.level).get("tail", 0.05), settings["cost"]["weights"]
    ahead = planner.horizon * planner.dt
    rows = {
        "robot": f"{name} of radius {planner.robot.radius:g} m",
        "speed": f"{planner.reference_speed:g} m/s along the path",
        "limits": fitted or "its own",
        "predictor": f"{predictor}: straight on, with a spread that covers what people do",
        "region": f"{region}: {100 * (1 - tail):g} % of where an obstacle may be, and both radii",
        "level": f"{level}: gives way at a high price where nothing else is possible",
        "margin": f"{planner.margin:g} m: regions hold at the steps alone",
        "weights": f"position {weights.position:g}, speed {weights.speed:.4g}, acceleration "
        f"{weights.acceleration:.4g}, yaw acceleration {weights.yaw_acceleration:.4g}: "
        "the paper's at 0.5 m/s, less for a faster robot",
        "horizon": f"{planner.horizon} steps of {planner.dt:.3g} s, {ahead:.3g} s and "
        f"{ahead * planner.reference_speed:.3g} m ahead; call it every {planner.period:.3g} s",
        "solver": f"{describe(planner.solver)['type']}",
    }
    return [f"{key:<10}{text}" for key, text in rows.items()]
