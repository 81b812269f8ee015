"""From a tracker's obstacles to the detections of an observation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, final

from wideberth.framework.values.arrays import checked_choice, number
from wideberth.framework.values.motion import Detection
from wideberth.simulation.sensing.perceived import TrackedObstacle

Batch = tuple[Detection, ...]


@final
@dataclass(frozen=True, eq=False)
class Handover:
    """Turns tracked obstacles into detections: a value that `detections` replaces.

    A planner takes the earlier batches by `remember`, oldest first, and the present one by
    `command`, all at the same stamp: the age of each detection says when it was.

    Parameters
    ----------
    kind : "measured" hands on the measurements that the tracker took to be of an obstacle. The
        predictor filters them itself; filtered positions would err alike at neighbouring
        instants, which it takes for independent. At confirmation it gets all earlier ones, so
        that it has a history at once. "filtered" hands on position, velocity and their
        covariance at the present instant, for predictors that start from a state (`kalman`,
        `constant_velocity`); they then filter nothing a second time. A tracker that keeps no
        measurements is always handed on so.
    newest : instant of the newest measurement of each obstacle that was handed on, s.

    Raises
    ------
    WideberthError : another kind.
    """

    kind: Literal["measured", "filtered"]
    newest: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checked_choice("handover.kind", self.kind, Literal["measured", "filtered"])

    def detections(
        self, obstacles: Sequence[TrackedObstacle], now: float
    ) -> tuple["Handover", tuple[Batch, ...], Batch]:
        """Return the measurements that were not handed on yet, as detections.

        Parameters
        ----------
        obstacles : `Tracker.at` of ``now``.
        now : s.

        Returns
        -------
        The next handover; earlier measurements that were not handed on yet, one batch per
        instant, oldest first; and one detection of each obstacle, the newest.
        """
        number("now", now)
        earlier: dict[float, list[Detection]] = {}
        present, newest = [], {}
        for one in obstacles:
            if self.kind == "filtered" or not len(one.times):
                present.append(_state(one, now))
                continue
            known = self.newest.get(one.ident, -float("inf"))
            for row, time in enumerate(one.times[:-1].tolist()):
                if time > known:
                    earlier.setdefault(time, []).append(_measurement(one, row, now))
            present.append(_measurement(one, -1, now))
            newest[one.ident] = float(one.times[-1])
        batches = tuple(tuple(earlier[time]) for time in sorted(earlier))
        return replace(self, newest=newest), batches, tuple(present)


def _measurement(obstacle: TrackedObstacle, row: int, now: float) -> Detection:
    """Return one measurement of an obstacle as a detection."""
    age = max(now - float(obstacle.times[row]), 0.0)
    place, noise = obstacle.measured[row], obstacle.noise[row]
    return Detection(obstacle.ident, place, noise, obstacle.radius, age)


def _state(obstacle: TrackedObstacle, now: float) -> Detection:
    """Return an obstacle's state as a detection."""
    place, velocity = obstacle.state[:2], obstacle.state[2:]
    spread, age = obstacle.covariance[:2, :2], max(now - obstacle.time, 0.0)
    return Detection(
        obstacle.ident,
        place,
        spread,
        obstacle.radius,
        age,
        velocity=velocity,
        state_covariance=obstacle.covariance,
    )
