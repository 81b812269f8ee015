"""The problems of one planner, one for each number of obstacles and polygons that it has met."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..assembly import assemble
from ..instance.polygons import Walls
from ..ocp.problem import Parameters, Problem

if TYPE_CHECKING:
    from .planner import Planner


@dataclass(frozen=True)
class Size:
    """What a problem has room for: Gaussian slots, polygon slots, and corners of each polygon."""

    capacity: int
    statics: int
    corners: int

    @classmethod
    def of(cls, parameters: Parameters, walls: Walls) -> "Size":
        """Return the size that an instance was filled for."""
        return cls(len(parameters.active), len(parameters.static_active), walls.parts.shape[1])


class ProblemCache:
    """Assembles a planner's problem of each size once.

    Parameters
    ----------
    planner : whose plug-ins and settings are used.
    """

    def __init__(self, planner: "Planner") -> None:
        self._planner = planner
        self._made: dict[Size, Problem] = {}

    def __bool__(self) -> bool:
        """Whether any has been made."""
        return bool(self._made)

    def of(self, size: Size) -> Problem:
        """Return the problem of a size."""
        if size not in self._made:
            own = self._planner
            self._made[size] = assemble(
                own.robot,
                own.region,
                own.level,
                horizon=own.horizon,
                dt=own.dt,
                capacity=size.capacity,
                cost=own.cost,
                penalty=own.penalty,
                static_region=own.static_region,
                statics=size.statics,
                corners=size.corners,
                stop_at_end=own.stop_at_end,
            )
        return self._made[size]
