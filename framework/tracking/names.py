"""Names of obstacles: a name that a sender repeats, or uses again, never hides an obstacle."""

from collections import Counter
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from math import dist
from typing import NamedTuple, Protocol, TypeAlias, final

import numpy as np

from ..values.arrays import Array
from ..values.motion import Detection
from .identities import Identities

FASTEST = 5.0
"""m/s, speed that no person exceeds."""
LEAP = 1.0
"""m, by which a reported position may be off beside the motion."""
DEVIATION = 0.1
"""m per axis, standard deviation of positions that are reported without names."""
MOST_SHARED = 200
"""Identities that are known to be of several obstacles; beyond that all are forgotten."""

Named: TypeAlias = list[tuple[str, Detection]]


class KnownObstacle(Protocol):
    """The newest measurement of an obstacle that a controller remembers."""

    @property
    def measured(self) -> float:
        """Time of the newest measurement, s."""
        ...

    @property
    def position(self) -> Array:
        """Newest measured position, (D,), m."""
        ...


@final
@dataclass(frozen=True, eq=False)
class Names:
    """Gives each detection the name of its obstacle: a value that `assigned` replaces.

    A detection is unnamed if its identity is empty or has ever occurred twice in one observation:
    `Identities` assigns it to an obstacle "#1", "#2", and so on. Another detection belongs to the
    obstacle of its identity as long as

    |p - p_last| <= `LEAP` + fastest |t - t_last|.

    Beyond that no obstacle of this kind can have moved. The detection is then of another obstacle,
    named "a#2" for the identity "a", and the obstacle "a" is no longer reported. Where all
    obstacles that are reported again, two at least, have moved that far by the same vector, the
    frame of the positions was corrected, and they keep their names.

    Parameters
    ----------
    fastest : m/s, speed that no obstacle exceeds.
    """

    fastest: float = FASTEST
    _unnamed: Identities = field(default_factory=lambda: Identities(DEVIATION), repr=False)
    _shared: frozenset[str] = field(default=frozenset(), repr=False)
    _reused: frozenset[str] = field(default=frozenset(), repr=False)

    def assigned(
        self, stamp: float, detections: Sequence[Detection], known: Mapping[str, KnownObstacle]
    ) -> tuple["Names", Named, tuple[str, ...]]:
        """Return the names after an observation, each detection with its name, and notes.

        Parameters
        ----------
        stamp : s, of the observation.
        detections : with finite positions and ages.
        known : remembered obstacles by name.
        """
        idents = [detection.ident for detection in detections]
        shared = self._shared
        if len(set(idents)) < len(idents):
            shared = _with(shared, [name for name, count in Counter(idents).items() if count > 1])
        unnamed = [k for k, ident in enumerate(idents) if not ident or ident in shared]
        chosen, identities = list(idents), self._unnamed
        if unnamed:
            identities = copy(identities)
            numbers = _numbers(identities, stamp, [detections[k] for k in unnamed])
            for k, number in zip(unnamed, numbers, strict=True):
                chosen[k] = f"#{number}"
                while chosen[k] in idents:
                    chosen[k] = "#" + chosen[k]
        owners = {
            k: owner
            for k, detection in enumerate(detections)
            if chosen[k] is detection.ident and (owner := self._owner(stamp, detection, known))
        }
        jumped = [k for k, owner in owners.items() if owner.share > 1.0]
        if jumped and _frame_moved(detections, owners, jumped):
            jumped = []
        for k, owner in owners.items():
            if k not in jumped and owner.name not in chosen[:k]:
                chosen[k] = owner.name
            elif k not in jumped:
                jumped.append(k)
        notes = []
        for k in jumped:
            ident, moved = detections[k].ident, dist(owners[k].position, detections[k].position)
            chosen[k] = _free(ident, {*known, *chosen})
            notes.append(
                f"detection {ident!r} is {moved:.3g} m from its last position, farther than an "
                f"obstacle of at most {self.fastest:g} m/s moves: it is a new one, {chosen[k]!r}"
            )
        reused = _with(self._reused, [detections[k].ident for k in jumped])
        names = Names(self.fastest, identities, shared, reused)
        return names, list(zip(chosen, detections, strict=True)), tuple(notes)

    def _owner(
        self, stamp: float, detection: Detection, known: Mapping[str, KnownObstacle]
    ) -> "_Owner | None":
        """Return the obstacle that a named detection is of; None where it is not known."""
        ident = detection.ident
        family = [ident] if ident in known else []
        if ident in self._reused:
            family += [name for name in known if name.startswith(f"{ident}#")]
        owners = [self._candidate(stamp, detection, name, known[name]) for name in family]
        return min(owners, key=lambda owner: owner.share, default=None)

    def _candidate(
        self, stamp: float, detection: Detection, name: str, former: KnownObstacle
    ) -> "_Owner":
        """Compare where an obstacle is detected with how far it can have moved."""
        reach = LEAP + self.fastest * abs(stamp - detection.age - former.measured)
        return _Owner(
            name, former.position, reach, dist(detection.position, former.position) / reach
        )


class _Owner(NamedTuple):
    """An obstacle that a detection may be of.

    Attributes
    ----------
    name, position : of the obstacle; (D,), m.
    reach : m, distance that it can have moved since then.
    share : of the reach, that the detection is away.
    """

    name: str
    position: Array
    reach: float
    share: float


def _frame_moved(
    detections: Sequence[Detection], owners: Mapping[int, _Owner], jumped: Sequence[int]
) -> bool:
    """Whether all known obstacles have moved by the same vector, but for their own motion."""
    if len(jumped) < max(2, len(owners)):
        return False
    moved = np.array([detections[k].position - owners[k].position for k in jumped])
    apart = np.linalg.norm(moved - np.median(moved, axis=0), axis=1)
    return bool((apart <= [owners[k].reach for k in jumped]).all())


def _with(known: frozenset[str], further: Sequence[str]) -> frozenset[str]:
    """Add identities; begin anew beyond `MOST_SHARED` of them."""
    if not further:
        return known
    return (known if len(known) < MOST_SHARED else frozenset()) | frozenset(further)


def _numbers(identities: Identities, stamp: float, detections: Sequence[Detection]) -> list[str]:
    """Return the numbers of the obstacles that unnamed detections are of."""
    size = len(detections[0].position)
    stated = [
        np.full(size, np.nan) if detection.velocity is None else detection.velocity
        for detection in detections
    ]
    places = [detection.position for detection in detections]
    return [obstacle.ident for obstacle in identities.named(stamp, places, stated)]


def _free(ident: str, taken: set[str]) -> str:
    """Return the first name of a further obstacle with an identity that is not taken."""
    count = 2
    while f"{ident}#{count}" in taken:
        count += 1
    return f"{ident}#{count}"
