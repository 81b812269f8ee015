"""What a planner's settings have to keep, checked before any work."""

from typing import TYPE_CHECKING

from ...robot import Robot
from ...values.arrays import positive, whole
from ...values.errors import WideberthError
from ...values.path import Path
from ..slots.base import CAPACITIES
from .starting_points import checked_starts

MOST_STEPS, MOST_SAMPLES = 1000, 10_000
"""Of a plan, and of a track or a forecast: more means that a unit is wrong."""

if TYPE_CHECKING:
    from .planner import Planner


def check_settings(planner: "Planner") -> None:
    """Refuse settings out of range, and plug-ins that do not fit together.

    Raises
    ------
    WideberthError : a value out of range, or robot and regions of different dimensions.
    """
    whole("planner.horizon", planner.horizon)
    whole("planner.history", planner.history, least=2)
    whole("planner.most_obstacles", planner.most_obstacles, least=0)
    if planner.most_obstacles > CAPACITIES[-1]:
        raise WideberthError(
            f"planner.most_obstacles is {planner.most_obstacles}; wanted at most {CAPACITIES[-1]}"
        )
    for name in ("dt", "period", "reference_speed", "track_dt", "forget", "patience"):
        positive(f"planner.{name}", getattr(planner, name))
    for name in ("latency", "margin"):
        positive(f"planner.{name}", getattr(planner, name), zero=True)
    for name in ("deadline", "penalty"):
        if getattr(planner, name) is not None:
            positive(f"planner.{name}", getattr(planner, name))
    _check_sizes(planner)
    checked_starts(planner.starts)
    if planner.robot.dimension not in planner.region.dimensions:
        raise WideberthError(
            f"the robot moves in {planner.robot.dimension} dimensions; the region "
            f"{type(planner.region).__name__} is made for {planner.region.dimensions}"
        )
    planner.level.levels(planner.region, 1, 1, planner.robot.dimension)
    if planner.static_region is not None and planner.robot.dimension != 2:
        raise WideberthError(
            f"planner.static_region is {type(planner.static_region).__name__}, and the robot "
            f"moves in {planner.robot.dimension} dimensions; polygons lie in the plane: leave it "
            "out"
        )


def _check_sizes(planner: "Planner") -> None:
    """Refuse settings that ask for tracks, forecasts or plans of absurd length.

    Raises
    ------
    WideberthError : more steps than `MOST_STEPS`, or more samples than `MOST_SAMPLES`.
    """
    reach = 2 * planner.forget + planner.latency + planner.horizon * planner.dt
    counts = {
        "planner.horizon": (planner.horizon, MOST_STEPS),
        "planner.latency / 0.05 s": (planner.latency / 0.05, MOST_SAMPLES),
        "planner.history": (planner.history, MOST_SAMPLES),
        "steps of the forecast, (2 forget + latency + horizon dt) / track_dt,": (
            reach / planner.track_dt,
            MOST_SAMPLES,
        ),
    }
    for name, (count, most) in counts.items():
        if count > most:
            raise WideberthError(f"{name} is {count:.6g}; wanted at most {most}")


def checked_path(robot: Robot, path: Path) -> Path:
    """Return a path, which may come as its points, if the robot can move along it.

    Raises
    ------
    WideberthError : it has another dimension.
    """
    path = path if isinstance(path, Path) else Path(path)
    if path.points.shape[1] != robot.dimension:
        raise WideberthError(
            f"the path has {path.points.shape[1]} columns; the robot moves in "
            f"{robot.dimension} dimensions"
        )
    return path
