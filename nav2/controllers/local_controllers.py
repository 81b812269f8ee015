"""The local controllers by name, their limits, and what Nav2 ships for its own robot."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import import_module
from typing import Any, final

from ...framework.values.arrays import positive
from ...framework.values.errors import WideberthError, nearest
from ..parameters.parameters import effective, names_of, refuse_unknown
from .local_controller import LocalController

LOCAL: dict[str, str] = {
    "dwb": "wideberth.nav2.controllers.dwb:DWB",
    "graceful": "wideberth.nav2.controllers.graceful:Graceful",
    "mppi": "wideberth.nav2.controllers.mppi:MPPI",
    "mppi_foresight": "wideberth.nav2.controllers.foresight:PeopleForecasts",
    "own": "wideberth.nav2.controllers.own_controller:OwnController",
    "regulated_pure_pursuit": (
        "wideberth.nav2.controllers.regulated_pure_pursuit:RegulatedPurePursuit"
    ),
    "rotation_shim": "wideberth.nav2.controllers.rotation_shim:RotationShim",
    "teb": "wideberth.nav2.controllers.teb:TEB",
    "vector_pursuit": "wideberth.nav2.controllers.vector_pursuit:VectorPursuit",
}
"""Name -> where the class is; another one is named as "module:Class"."""

_RENAMED = {
    "lambda": "lambda_", "desired_linear_vel": "max_linear_vel",
    "footprint_model.radius": "robot_radius",
}  # fmt: skip
"""Names that Nav2 uses or has used -> fields, where the class lacks the former."""
_PRIMARY, _USUAL = "primary_controller", "regulated_pure_pursuit"
_FROM_PARAMETERS = {"dwb", "mppi", "mppi_foresight", "own"}
"""Controllers that are made of parts: critics, whose parameters are named ``Critic.name``, or
plug-ins."""


@final
@dataclass(frozen=True)
class VelocityLimits:
    """Bounds on velocity and acceleration that a controller is given.

    Attributes
    ----------
    speed : m/s, forwards.
    yaw_rate : rad/s.
    acceleration : m/s^2.
    yaw_acceleration : rad/s^2.

    Raises
    ------
    WideberthError : one that is not above zero.
    """

    speed: float
    yaw_rate: float
    acceleration: float
    yaw_acceleration: float

    def __post_init__(self) -> None:
        for field in fields(self):
            positive(f"limits.{field.name}", getattr(self, field.name))

    def parameters(self, local: str, given: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the limits by the names of a controller, as far as it has such parameters.

        A rotation shim has those of its primary controller, too. A speed backwards that is below
        the limit stays.

        Parameters
        ----------
        local : name of the controller.
        given : its parameters so far, of which the primary controller and speeds backwards count.
        """
        given, found = given or {}, {}
        for one in together(local, given):
            name = "mppi" if one == "mppi_foresight" else one
            for names, sign in ((_POSITIVE, 1.0), (_NEGATIVE, -1.0)):
                for parameter, source in names.get(name, {}).items():
                    found[parameter] = sign * getattr(self, source)
            for parameter, usual in _BACKWARDS.get(name, {}).items():
                value = float(given.get(parameter, usual))
                found[parameter] = min(max(value, -self.speed), self.speed)
        return found


_POSITIVE = {
    "regulated_pure_pursuit": {
        "max_linear_vel": "speed", "max_angular_vel": "yaw_rate",
        "rotate_to_heading_angular_vel": "yaw_rate", "max_linear_accel": "acceleration",
        "max_angular_accel": "yaw_acceleration",
    },
    "graceful": {
        "v_linear_max": "speed", "v_angular_max": "yaw_rate", "deceleration_max": "acceleration",
    },
    "vector_pursuit": {
        "desired_linear_vel": "speed", "rotate_to_heading_angular_vel": "yaw_rate",
        "max_linear_accel": "acceleration", "max_angular_accel": "yaw_acceleration",
    },
    "dwb": {
        "max_vel_x": "speed", "max_speed_xy": "speed", "max_vel_theta": "yaw_rate",
        "acc_lim_x": "acceleration", "acc_lim_theta": "yaw_acceleration",
    },
    "mppi": {
        "vx_max": "speed", "wz_max": "yaw_rate", "ax_max": "acceleration",
        "az_max": "yaw_acceleration",
    },
    "teb": {
        "max_vel_x": "speed", "max_vel_theta": "yaw_rate", "acc_lim_x": "acceleration",
        "acc_lim_theta": "yaw_acceleration",
    },
    "rotation_shim": {
        "rotate_to_heading_angular_vel": "yaw_rate", "max_angular_accel": "yaw_acceleration",
    },
}  # fmt: skip
_NEGATIVE = {
    "regulated_pure_pursuit": {
        "min_linear_vel": "speed", "min_angular_vel": "yaw_rate",
        "max_linear_decel": "acceleration", "max_angular_decel": "yaw_acceleration",
    },
    "dwb": {"decel_lim_x": "acceleration", "decel_lim_theta": "yaw_acceleration"},
    "mppi": {"ax_min": "acceleration"},
}  # fmt: skip
_BACKWARDS = {
    "dwb": {"min_vel_x": 0.0}, "mppi": {"vx_min": -0.35}, "teb": {"max_vel_x_backwards": 0.2},
}  # fmt: skip
"""Speeds backwards and their defaults, m/s: robots that reverse slower than they drive."""

_SHIPPED_DWB: dict[str, Any] = {
    "critics": [
        "RotateToGoal", "Oscillation", "BaseObstacle", "GoalAlign", "PathAlign", "PathDist",
        "GoalDist",
    ],
    "max_vel_x": 0.26, "max_vel_theta": 1.0, "max_speed_xy": 0.26,
    "acc_lim_x": 2.5, "acc_lim_theta": 3.2, "decel_lim_x": -2.5, "decel_lim_theta": -3.2,
    "linear_granularity": 0.05, "BaseObstacle.scale": 0.02,
    "PathAlign.scale": 32.0, "PathAlign.forward_point_distance": 0.1,
    "GoalAlign.scale": 24.0, "GoalAlign.forward_point_distance": 0.1,
    "PathDist.scale": 32.0, "GoalDist.scale": 24.0, "RotateToGoal.scale": 32.0,
}  # fmt: skip


def shipped_parameters(local: str) -> dict[str, Any]:
    """Return what Nav2 has shipped for its own robot beside the defaults in a controller's code.

    MPPI is the controller that it ships now, DWB the one that it shipped before.
    """
    if local in ("mppi", "mppi_foresight"):
        from .mppi import BRINGUP

        return dict(BRINGUP)
    return dict(_SHIPPED_DWB) if local == "dwb" else {}


def together(local: str, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of a controller and, behind a rotation shim, of its primary one."""
    inner = (str(parameters.get(_PRIMARY, _USUAL)),) if local == "rotation_shim" else ()
    return (local, *inner)


def timed(local: str) -> bool:
    """Tell whether a local controller has to know the frequency of its ticks."""
    found = {one.name for one in fields(_imported(local))}
    return "controller_frequency" in found or local == "mppi_foresight"


def built(local: str, parameters: Mapping[str, Any]) -> LocalController:
    """Return a local controller with parameters by Nav2's names.

    Parameters
    ----------
    local : a key of `LOCAL`, or "module:Class".
    parameters : name -> value; of a critic ``Critic.name``; of a rotation shim, besides,
        ``primary_controller`` (its name) and the parameters of that one, which come without a
        prefix, as in Nav2. Those without effect here are passed over, see `parameters.effective`.

    Raises
    ------
    WideberthError : an unknown controller, or a name that it does not know.
    """
    found, parameters = _imported(local), effective(parameters)
    if local == "rotation_shim":
        return _shim(found, parameters)
    if local in _FROM_PARAMETERS:
        return _checked(found.from_parameters(parameters))
    known = names_of(found)
    former = [old for old, new in _RENAMED.items() if new in known]
    refuse_unknown(local, parameters, [*known, *former])
    renamed = {
        (_RENAMED.get(name, name) if name not in known else name): value
        for name, value in parameters.items()
    }
    return _checked(found(**renamed))


def _shim(found: Any, parameters: Mapping[str, Any]) -> LocalController:
    """Return a rotation shim; what it and its primary controller both know goes to both."""
    inner = together("rotation_shim", parameters)[1]
    own = {field.name for field in fields(found)} - {"primary"}
    known = {field.name for field in fields(_imported(inner))}
    primary = {
        name: value
        for name, value in parameters.items()
        if name != _PRIMARY and (name not in own or name in known)
    }
    kept = {name: value for name, value in parameters.items() if name in own}
    return _checked(found(primary=built(inner, primary), **kept))


def _checked(made: Any) -> LocalController:
    if not isinstance(made, LocalController):
        raise WideberthError(f"{type(made).__name__} is no LocalController")
    return made


def _imported(local: str) -> Any:
    """Import the class of a local controller."""
    target = LOCAL.get(local, local)
    module, colon, name = target.partition(":")
    if not colon:
        known = f"{nearest(local, LOCAL)} Known: {', '.join(sorted(LOCAL))}"
        raise WideberthError(f"there is no local controller {local!r}{known}, or 'module:Class'")
    try:
        return getattr(import_module(module), name)
    except (ImportError, AttributeError) as error:
        raise WideberthError(f"local controller {local!r} cannot be imported: {error}") from None
