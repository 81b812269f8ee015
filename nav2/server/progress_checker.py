"""When a robot counts as stuck: Nav2's SimpleProgressChecker."""

from dataclasses import dataclass
from typing import final

from ...framework.values.arrays import Array
from ..parameters.parameters import check_parameters
from ..poses import distance


@final
@dataclass(eq=False)
class ProgressChecker:
    """Decides whether a robot has moved far enough in the time that it is allowed.

    Parameters
    ----------
    required_movement_radius : m.
    movement_time_allowance : s.

    Raises
    ------
    WideberthError : a number that is not above zero.
    """

    required_movement_radius: float = 0.5
    movement_time_allowance: float = 10.0

    def __post_init__(self) -> None:
        above = ("required_movement_radius", "movement_time_allowance")
        check_parameters(self, "progress_checker", above)
        self._base: tuple[Array, float] | None = None

    def reset(self) -> None:
        """Begin anew at the next call of `progressing`."""
        self._base = None

    def progressing(self, pose: Array, time: float) -> bool:
        """Tell whether the robot, at a pose (3,) and a time (s), is not stuck."""
        moved = self._base is None or distance(pose, self._base[0]) > self.required_movement_radius
        if self._base is None or moved:
            self._base = (pose, time)
            return True
        return time - self._base[1] <= self.movement_time_allowance
