"""Positions and velocities of detected neighbours, by finite differences."""

from dataclasses import dataclass

import numpy as np

from ..framework.tracking.history import MOST, admitted, named_apart
from ..framework.values.arrays import Array
from ..framework.values.magnitudes import SHORTEST
from ..framework.values.motion import Detection, Observation


@dataclass(frozen=True, eq=False)
class _Sight:
    """What is known of one neighbour: measured when and where, how fast, and last reported."""

    measured: float
    position: Array
    velocity: Array
    radius: float
    reported: float


class Neighbours:
    """Remembers detections in the plane by identity; a controller that reacts needs no more.

    The velocity is the difference of the last two measurements over the time between them,
    zero at first sight. It is as noisy as that says: sqrt(2) sigma / dt.

    Parameters
    ----------
    forget : s after which somebody who is no longer reported is dropped.
    """

    def __init__(self, forget: float) -> None:
        self._forget = forget
        self.reset()

    def reset(self) -> None:
        """Drop all neighbours."""
        self._stamp = -np.inf
        self._sights: dict[str, _Sight] = {}

    def take(self, observation: Observation, here: Array | None = None) -> list[str]:
        """Record the detections seen from ``here``, (2,), m; return a reason per refused one.

        A measurement less than a microsecond newer than the last one of that identity changes
        nothing but the radius. A clock that goes back starts anew. See `admitted`.
        """
        if not np.isfinite(observation.stamp):
            return []
        if observation.stamp < self._stamp:
            self.reset()
        self._stamp = observation.stamp
        plane, refused = admitted(observation, 2, self._forget, here)
        for name, detection in named_apart(plane):
            self._sights[name] = self._updated(self._sights.get(name), detection)
        self._sights = {
            name: sight
            for name, sight in self._sights.items()
            if self._stamp - sight.reported <= self._forget
        }
        if len(self._sights) > MOST:
            newest = sorted(self._sights, key=lambda name: self._sights[name].reported)[-MOST:]
            self._sights = {name: self._sights[name] for name in self._sights if name in newest}
        return refused

    def now(self) -> tuple[tuple[str, ...], Array, Array, Array]:
        """Return positions, velocities and radii of all neighbours at the newest stamp.

        Returns
        -------
        ids : O identities, in the order in which they were first seen.
        positions : (O, 2), m, carried on from the measurement at constant velocity.
        velocities : (O, 2), m/s.
        radii : (O,), m.
        """
        sights = self._sights.values()
        places = [s.position + (self._stamp - s.measured) * s.velocity for s in sights]
        positions = np.array(places, dtype=np.float64).reshape(-1, 2)
        velocities = np.array([s.velocity for s in sights], dtype=np.float64).reshape(-1, 2)
        radii = np.array([s.radius for s in sights], dtype=np.float64)
        return tuple(self._sights), positions, velocities, radii

    def _updated(self, before: _Sight | None, detection: Detection) -> _Sight:
        measured = self._stamp - detection.age
        if before is None:
            known = measured, detection.position, np.zeros(2)
        elif measured - before.measured >= SHORTEST:
            moved = detection.position - before.position
            known = measured, detection.position, moved / (measured - before.measured)
        else:
            known = before.measured, before.position, before.velocity
        return _Sight(*known, detection.radius, self._stamp)
