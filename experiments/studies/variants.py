"""Variants of one planner: the same settings but for the predictor or the region."""

from dataclasses import Field, fields, is_dataclass, replace
from typing import Any

from ...framework import Controller, WideberthError
from ...framework.controller import WrapsController
from ...framework.mpc.planner.planner import Planner


def planner_of(controller: Controller) -> Planner:
    """Return the controller as the planner whose parts can be exchanged.

    Raises
    ------
    WideberthError : another controller, which has no predictor or region to exchange.
    """
    if not isinstance(controller, Planner):
        raise WideberthError(
            f"planner is a {type(controller).__name__}; wanted `type: mpc`, whose predictor "
            "and region this experiment exchanges"
        )
    return controller


def exchanged(controller: Controller, **parts: Any) -> Controller:
    """Return a controller with other parts; those of the wrapped one, where it wraps one.

    Raises
    ------
    WideberthError : a controller that takes no such parts.
    """
    made: Any = controller
    if isinstance(controller, WrapsController):
        wrapped: Controller = replace(made, controller=exchanged(controller.controller, **parts))
        return wrapped
    every: tuple[Field[Any], ...] = fields(controller) if is_dataclass(controller) else ()
    own = {entry.name for entry in every if entry.init}
    if missing := " and ".join(sorted({*parts} - own)):
        raise WideberthError(
            f"planner is a {type(controller).__name__}, without {missing}; wanted one that takes "
            f"{missing}, such as `type: mpc`, be it wrapped"
        )
    changed: Controller = replace(made, **parts)
    return changed
