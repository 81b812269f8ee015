"""Whether those who take part in an episode fit together."""

from collections.abc import Sequence

from ...framework.values.errors import WideberthError
from ...framework.values.polygon import Polygon
from .agents import Bystander, PathChange, ReplayAgent, RobotAgent


def check_cast(
    robots: Sequence[RobotAgent],
    others: Sequence[Bystander],
    changes: Sequence[PathChange],
    polygons: Sequence[Polygon],
) -> None:
    """Refuse an episode that cannot be run, before any of it is.

    Raises
    ------
    WideberthError : as `run_episode`.
    """
    if all(one.person for one in robots):
        raise WideberthError("the episode has no robot; give at least one RobotAgent")
    names = [one.name for one in (*robots, *others, *polygons) if one.name]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise WideberthError(f"agents share the name(s) {repeated}; every agent needs its own")
    sizes = {agent.robot.dimension for agent in robots}
    sizes |= {o.positions.shape[1] for o in others if isinstance(o, ReplayAgent)}
    sizes |= {o.path.points.shape[1] for o in others if not isinstance(o, ReplayAgent)}
    if len(sizes) > 1:
        raise WideberthError(
            f"agents move in {sorted(sizes)} dimensions; one episode has one number of them"
        )
    blind = [agent.name for agent in robots if not _knows_polygons(agent)] if polygons else []
    if blind:
        raise WideberthError(
            f"there are polygons, and the planner of {blind} has no static_region; set it, for "
            "example to separating_line"
        )
    if polygons and sizes != {2}:
        raise WideberthError(f"polygons lie in the plane; the agents move in {sizes} dimensions")
    known = [agent.name for agent in robots]
    for change in changes:
        if change.agent not in known:
            raise WideberthError(f"a path change names {change.agent!r}; the robots are {known}")
    if len({id(agent.controller) for agent in robots}) < len(robots):
        raise WideberthError("two robots share one controller; each needs one of its own")


def _knows_polygons(agent: RobotAgent) -> bool:
    """Whether what keeps it clear of polygons is there.

    Who has the setting `static_region` needs it. The others read polygons as they are, or say in
    their docstrings that they do not.
    """
    return getattr(agent.controller, "static_region", True) is not None
