"""The problems of one planner, one for each number of things of each kind that it has met."""

from ..assembly import assemble
from ..ocp.problem import Problem
from ..slots.base import SlotSizes
from .settings import PlannerSettings


class ProblemCache:
    """Assembles the problem of each size once.

    Parameters
    ----------
    settings : the plug-ins and numbers of the problems.
    """

    def __init__(self, settings: PlannerSettings) -> None:
        self._settings = settings
        self._made: dict[tuple[SlotSizes, ...], Problem] = {}

    def __bool__(self) -> bool:
        """Whether any has been made."""
        return bool(self._made)

    def of(self, rooms: tuple[SlotSizes, ...]) -> Problem:
        """Return the problem with room for so many things of each kind."""
        if rooms not in self._made:
            own = self._settings
            self._made[rooms] = assemble(
                own.robot,
                own.kinds,
                own.level,
                horizon=own.horizon,
                dt=own.dt,
                rooms=rooms,
                cost=own.cost,
                penalty=own.penalty,
                stop_at_end=own.fallback.stop_at_end,
            )
        return self._made[rooms]
