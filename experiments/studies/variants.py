"""Variants of one planner: the same settings but for the predictor or the region."""

from collections.abc import Mapping
from dataclasses import replace

from ...framework.controller import Controller
from ...framework.mpc.planner.planner import Planner
from ...framework.predictor import Predictor
from ...framework.region import Region
from ...framework.values.errors import WideberthError


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


def by_predictor(
    controller: Controller, predictors: Mapping[str, Predictor]
) -> dict[str, Controller]:
    """Return the planner with each of the predictors in turn."""
    planner = planner_of(controller)
    return {name: replace(planner, predictor=one) for name, one in predictors.items()}


def by_region_and_predictor(
    controller: Controller,
    regions: Mapping[str, Region],
    predictors: Mapping[str, Predictor],
) -> dict[tuple[str, str], Controller]:
    """Return the planner with each pair of region and predictor."""
    planner = planner_of(controller)
    return {
        (region, rule): replace(planner, region=shape, predictor=predictor)
        for region, shape in regions.items()
        for rule, predictor in predictors.items()
    }
