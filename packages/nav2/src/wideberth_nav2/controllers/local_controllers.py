"""The local controllers by name, their limits, and what Nav2 ships for its own robot."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, final

from wideberth.framework.plugins.registry import named
from wideberth.framework.values.arrays import positive
from wideberth.framework.values.errors import WideberthError, nearest

from ..parameters import NAMES, Limited, effective, made, marks_of, names_of
from .local_controller import CompositeController, LocalController
from .mppi import MPPI

LOCAL: dict[str, str] = {
    "dwb": "wideberth_nav2.controllers.dwb:DWB",
    "graceful": "wideberth_nav2.controllers.graceful:Graceful",
    "mppi": "wideberth_nav2.controllers.mppi:MPPI",
    "mppi_foresight": "wideberth_nav2.controllers.people_forecasts:PeopleForecasts",
    "regulated_pure_pursuit": (
        "wideberth_nav2.controllers.regulated_pure_pursuit:RegulatedPurePursuit"
    ),
    "rotation_shim": "wideberth_nav2.controllers.rotation_shim:RotationShim",
    "teb": "wideberth_nav2.controllers.teb:TEB",
    "vector_pursuit": "wideberth_nav2.controllers.vector_pursuit:VectorPursuit",
}
"""Name -> where the class is; another one is named as "module:Class"."""

_PRIMARY, _USUAL = "primary_controller", "regulated_pure_pursuit"


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
    reverse_speed : m/s, backwards, 0 for never; None for as fast as forwards.

    Raises
    ------
    WideberthError : one that is not above zero; a speed backwards below it.
    """

    speed: float
    yaw_rate: float
    acceleration: float
    yaw_acceleration: float
    reverse_speed: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            back = field.name == "reverse_speed"
            if not back or self.reverse_speed is not None:
                positive(f"limits.{field.name}", getattr(self, field.name), zero=back)

    @property
    def backwards(self) -> float:
        """Speed backwards, m/s."""
        return self.speed if self.reverse_speed is None else self.reverse_speed

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
            kind = MPPI if one == "mppi_foresight" else _imported(one)
            for parameter, mark in marks_of(kind, Limited).items():
                most = getattr(self, mark.limit)
                value = float(given.get(parameter, getattr(kind, parameter)))
                within = min(max(value, -most), most)
                found[parameter] = 0.0 + mark.sign * most if mark.sign else within
        return found


def shipped_parameters(name: str) -> dict[str, Any]:
    """Return what Nav2 has shipped for its own robot beside the defaults in the code.

    There are parameters of controllers, of the server and of the velocity smoother. MPPI is the
    controller that Nav2 ships now, DWB the one that it shipped before.
    """
    return dict(NAMES["shipped"].get(name, {}))


def together(local: str, parameters: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of a controller and, behind a rotation shim, of its primary one."""
    inner = (str(parameters.get(_PRIMARY, _USUAL)),) if local == "rotation_shim" else ()
    return (local, *inner)


def timed(local: str) -> bool:
    """Return whether a local controller has to know the frequency of its ticks."""
    return "controller_frequency" in names_of(_imported(local)) or local == "mppi_foresight"


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
    if issubclass(found, CompositeController):
        return found.from_parameters(parameters)
    return made(found, local, parameters)


def _shim(found: type[LocalController], parameters: Mapping[str, Any]) -> LocalController:
    """Return a rotation shim; what it and its primary controller both know goes to both."""
    inner = together("rotation_shim", parameters)[1]
    own, known = names_of(found).keys() - {"primary"}, names_of(_imported(inner))
    primary = {
        name: value
        for name, value in parameters.items()
        if name != _PRIMARY and (name not in own or name in known)
    }
    kept = {name: value for name, value in parameters.items() if name in own}
    return made(found, "rotation_shim", kept, primary=built(inner, primary))


def _imported(local: str) -> type[LocalController]:
    """Import the class of a local controller."""
    target = LOCAL.get(local, local)
    if ":" not in target:
        known = f"{nearest(local, LOCAL)} Known: {', '.join(sorted(LOCAL))}"
        raise WideberthError(f"there is no local controller {local!r}{known}, or 'module:Class'")
    found = named(target, LOCAL.values())
    if not (isinstance(found, type) and issubclass(found, LocalController)):
        raise WideberthError(f"local controller {local!r} is no LocalController")
    return found
