"""The RoutePlanner interface: from a costmap, a start and a goal to a path for the controller."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, final

from numpy.typing import ArrayLike

from .values.costmap import Costmap
from .values.errors import WideberthError
from .values.path import Path


@final
@dataclass(frozen=True, eq=False)
class Route:
    """A route over a map, or the reason why there is none.

    Attributes
    ----------
    path : from the start to the goal or near it; None where there is no way.
    reason : why there is no path; with one, what the user should know of it, or "".

    Raises
    ------
    WideberthError : neither a path nor a reason.
    """

    path: Path | None
    reason: str = ""

    def __post_init__(self) -> None:
        if self.path is None and not self.reason:
            raise WideberthError("route has no path; wanted a reason for that")


class RoutePlanner(ABC):
    """How a path over a costmap is found, in the plane.

    Laws, checked by `wideberth.framework.testing.check_route_planner`: the same input gives the
    same route; a path leads from the start to the goal, to within a cell and what the planner
    tolerates, and touches no lethal cell; a map that is moved moves its routes along; a start or
    goal off the map, or behind walls, gives a reason and no exception.
    """

    reference: ClassVar[str] = ""

    @abstractmethod
    def plan(self, costmap: Costmap, start: ArrayLike, goal: ArrayLike) -> Route:
        """Find a route, (2,) m to (2,) m; where there is none, the route says why."""
