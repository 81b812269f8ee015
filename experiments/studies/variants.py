"""Variants of one planner: the same settings but for the predictor or the region."""

from ...framework import Controller, WideberthError
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
