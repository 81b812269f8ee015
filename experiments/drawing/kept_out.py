"""The sets that the plans of an episode keep out of, from above."""

import numpy as np

from ...draw.plans import kept_out
from ...framework.mpc.planner.planner import Planner
from ...framework.plugins.config import describe
from ...framework.region import Polygonal, Region
from ...framework.values.arrays import Array
from ...framework.values.footprint import Discs, Outline
from ...framework.values.plan import Plan, Situation
from ...simulation.drawing.logged import DrawnAgent
from ...simulation.log.episode_log import Episode


def region_name(region: Region) -> str:
    """Name of a region in words."""
    return str(describe(region).get("type", type(region).__name__)).replace("_", " ")


def kept_out_of(
    episode: Episode, log: DrawnAgent, plan: Plan, planner: Planner, steps: list[int]
) -> dict[tuple[int, int], Array]:
    """Outlines of the set that a plan kept the robot's centre out of, from above.

    As `wideberth.draw.plans.kept_out`, with the region and the margin of a planner and
    the radii of the episode's agents, so that plans of older files are drawn as well.

    Parameters
    ----------
    log : of the robot that made the plan.
    steps : of the forecast, from 0.

    Returns
    -------
    (obstacle, mode) of the forecast -> (len(steps), C, 2), m, of the obstacles that a
    constraint holds. Empty in space, where there is no outline, and where the region is not
    defined.
    """
    if plan.positions.shape[1] != 2:
        return {}
    if plan.situation is not None and plan.situation.region is not None:
        return kept_out(plan, plan.situation, steps)
    radii = [episode.agent(name).radius if name in plan.ids else 0.0 for name in plan.tracked]
    room = _body(log, planner.region) + planner.margin
    situation = Situation(planner.region, room, np.array(radii), log.radius)
    return kept_out(plan, situation, steps)


def _body(log: DrawnAgent, region: Region) -> float:
    """Radius of what keeps out of the region, m; 0 where its corners do."""
    if isinstance(log.footprint, Discs):
        return log.footprint.radius
    corners = isinstance(log.footprint, Outline) and isinstance(region, Polygonal)
    return 0.0 if corners else log.radius
