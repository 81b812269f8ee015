"""Forecasts of people as a node of ROS 2, from a config."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy import quantile

from wideberth.experiments.engine.progress import say
from wideberth.framework import read_config
from wideberth.framework.plugins.config import build, construct, import_plugins
from wideberth.framework.plugins.registry import find_modules_beside, unknown
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.errors import WideberthError

from ..forecast_node import FixedArea, ForecastSettings, RobotArea, run_forecasts
from .ros_node import SEES, of_type

KEYS = ("plugins", "predictor", "forecast")
AREAS: Mapping[str, type[Any]] = {"robot": RobotArea, "fixed": FixedArea}
"""Name of a type in the config -> its settings."""


def read_forecast(path: Path, overrides: Sequence[str]) -> tuple[Predictor, ForecastSettings]:
    """Read the config of a node of forecasts.

    Parameters
    ----------
    path : a YAML file with ``predictor``, and ``forecast`` (see `ForecastSettings`).
    overrides : as in ``forecast.rate=5``.

    Raises
    ------
    WideberthError : no such file, a key that is not known, a value that does not fit.
    """
    find_modules_beside(path)
    config = read_config(path, list(overrides))
    for key in config:
        if key not in KEYS:
            raise WideberthError(f"{path}: {unknown('key', key, list(KEYS))}")
    if "predictor" not in config:
        raise WideberthError(f"{path} has no predictor; wanted one, as in predictor: kalman")
    import_plugins(config.get("plugins", []))
    predictor: Predictor = build("predictors", config["predictor"], "predictor")
    given = dict(config.get("forecast") or {})
    try:
        for name, kinds in (("sees", SEES), ("area", AREAS)):
            if name in given:
                given[name] = of_type(kinds, given[name], f"forecast.{name}")
        settings: ForecastSettings = construct(ForecastSettings, given, "forecast")
    except WideberthError as error:
        raise WideberthError(f"{path}: {error}") from None
    return predictor, settings


def run_forecast(
    path: Path,
    overrides: Sequence[str],
    arguments: Sequence[str] = (),
    seconds: float | None = None,
) -> None:
    """Run a node of forecasts until it is stopped.

    Parameters
    ----------
    path, overrides : as of `read_forecast`. arguments : for ROS.
    seconds : after which it stops; None for never.

    Raises
    ------
    WideberthError : as `read_forecast`, or ROS 2 is not found.
    """
    predictor, settings = read_forecast(path, overrides)
    counts = run_forecasts(predictor, settings, arguments, seconds).counts
    say(f"{counts.seen} messages of people, {counts.published} forecasts")
    if counts.spent:
        middle, high = (1e3 * quantile(counts.spent, share) for share in (0.5, 0.99))
        say(f"a forecast with its messages: median {middle:.1f} ms, 99 % in {high:.1f} ms")
