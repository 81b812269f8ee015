"""The sets that the plans of an episode keep out of, from above."""

import numpy as np

from ...controllers.presets import Preset
from ...framework.controller import Controller
from ...framework.mpc.planner.planner import Planner
from ...framework.plugins.config import describe
from ...framework.region import Polygonal, Region
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.footprint import Discs, Outline
from ...framework.values.forecast import LIGHT, GaussianObstacle
from ...framework.values.plan import Plan
from ...simulation.log.episode_log import AgentLog, Episode

COUNT = 64
"""Points of an outline; a multiple of 8, so that the corners of a square are among them."""
_DOUBLINGS, _HALVINGS = 12, 13  # within a mm
_AT_ONCE = 500  # outlines whose points are tested in one call


def planner_behind(controller: Controller | None) -> Planner | None:
    """Return the planner that a controller is or wraps; None for one that plans otherwise."""
    if isinstance(controller, Preset):
        return controller.planner
    return controller if isinstance(controller, Planner) else None


def region_name(region: Region) -> str:
    """Name of a region in words."""
    return str(describe(region).get("type", type(region).__name__)).replace("_", " ")


def kept_out_of(
    episode: Episode, log: AgentLog, plan: Plan, planner: Planner, steps: list[int]
) -> dict[tuple[int, int], Array]:
    """Outlines of the set that a plan kept the robot's centre out of, from above.

    It is the planner's own region with the margin r + r_d + ``planner.margin`` at the level that
    the plan held at each step. Of a robot of discs it is that for each disc's centre; of one with
    corners, where the region knows them, that for the whole body (r = 0). The robot's own
    uncertainty, which a plan does not record, is left out.

    Parameters
    ----------
    log : of the robot that made the plan.
    steps : of the forecast, from 0.

    Returns
    -------
    (obstacle, mode) of the forecast -> (len(steps), COUNT, 2), m, of the obstacles that a
    constraint holds. Empty in space, where there is no outline, and where the region is not
    defined.
    """
    forecast, region = plan.forecast, planner.region
    if forecast is None or forecast.mean.shape[-1] != 2 or not plan.level.size:
        return {}
    keys = [
        (int(owner), int(mode))
        for owner, mode in zip(*np.nonzero(forecast.weight >= LIGHT), strict=True)
        if plan.tracked[owner] in plan.ids
    ]
    if not keys:
        return {}
    names = [plan.tracked[owner] for owner, _ in keys]
    owners, modes = (np.array(part) for part in zip(*keys, strict=True))
    obstacle = GaussianObstacle(
        forecast.mean[owners, modes][:, steps], forecast.covariance[owners, modes][:, steps]
    )
    # Modes of one obstacle share a name and a level.
    level = plan.level[steps][:, [plan.ids.index(name) for name in names]].T
    room = _body(log, region) + planner.margin
    margin = np.array([[episode.agent(name).radius + room] for name in names])
    try:
        found = outlines(region, obstacle, np.broadcast_to(margin, level.shape), level)
    except WideberthError:  # a region that a singular covariance leaves undefined
        return {}
    return dict(zip(keys, found, strict=True))


def _body(log: AgentLog, region: Region) -> float:
    """Radius of what keeps out of the region, m; 0 where its corners do."""
    if isinstance(log.footprint, Discs):
        return log.footprint.radius
    corners = isinstance(log.footprint, Outline) and isinstance(region, Polygonal)
    return 0.0 if corners else log.radius


def outlines(region: Region, obstacle: GaussianObstacle, margin: Array, level: Array) -> Array:
    """Outlines of many 2-D regions at once: batch (...,) -> (..., COUNT, 2), m.

    Where rays from the mean leave the region, by bisection with `Region.contains`:
    `Region.boundary` takes one region a call, and 0.1 s of some. The rays are stretched like the
    spread, so that thin regions are sampled as evenly as round ones. All points are the mean
    where the region is empty.
    """
    values, vectors = np.linalg.eigh(obstacle.covariance)
    reach = 3.0 * np.sqrt(np.clip(values, 0.0, None)) + margin[..., None]
    angle = np.linspace(0.0, 2.0 * np.pi, COUNT, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    rays = np.swapaxes((vectors * reach[..., None, :]) @ circle, -1, -2).reshape(-1, COUNT, 2)
    numbers = region.parameters(obstacle, margin)
    numbers = numbers.reshape(-1, 1, numbers.shape[-1])
    mean, held = obstacle.mean.reshape(-1, 1, 2), np.maximum(level.reshape(-1, 1), 0.0)
    share = np.zeros(rays.shape[:-1])
    for begin in range(0, len(rays), _AT_ONCE):
        some = slice(begin, begin + _AT_ONCE)
        share[some] = _left(region, mean[some], rays[some], numbers[some], held[some])
    return np.asarray((mean + share[..., None] * rays).reshape(*level.shape, COUNT, 2))


def _left(region: Region, mean: Array, rays: Array, numbers: Array, level: Array) -> Array:
    """Share of each ray at which it leaves the region, (K, COUNT)."""
    low, high = np.zeros(rays.shape[:-1]), np.ones(rays.shape[:-1])
    for _ in range(_DOUBLINGS):
        inside = region.contains(mean + high[..., None] * rays, numbers, level)
        if not inside.any():
            break
        high = np.where(inside, 2.0 * high, high)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        inside = region.contains(mean + middle[..., None] * rays, numbers, level)
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return low
