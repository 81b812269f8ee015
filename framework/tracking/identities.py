"""Identities for people whom another simulator reports without names."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..values.arrays import FARTHEST, LATEST, Array, checked, checked_rows, number, positive
from ..values.errors import WideberthError
from ..values.motion import Detection

Numbers = NDArray[np.int64]

MEMORY = 1.0
"""s for which a person is remembered who is not reported."""
CHANGE = 3.0
"""m/s, largest difference of a mean velocity from what was expected."""
LONGEST = 0.4
"""s beyond which the reach grows no farther: after longer gaps it would hold too many people."""
DENSITY = 0.5
"""m^2/s^3 of white acceleration; social-force people have about that, those of ORCA less."""
SPEED = 1.0
"""m/s per axis, standard deviation of a velocity that was never reported."""


class _People(NamedTuple):
    """People as they were reported last, a row for each.

    Attributes
    ----------
    name : (O,). seen : (O,), s. place, velocity : (O, D), m and m/s.
    spread : (O, 3), of each axis: m^2 of the place, m^2/s of both, (m/s)^2 of the velocity.
    """

    name: Numbers
    seen: Array
    place: Array
    velocity: Array
    spread: Array

    @classmethod
    def at(cls, time: float, places: Array, variance: float) -> "_People":
        """Return people without names who were seen once, at places (O, D)."""
        count, first = len(places), [variance, 0.0, SPEED**2]
        name, seen = np.zeros(count, dtype=np.int64), np.full(count, time)
        return cls(name, seen, places.copy(), np.zeros(places.shape), np.tile(first, (count, 1)))

    def rows(self, which: NDArray[np.bool_] | Numbers) -> "_People":
        """Return some of them."""
        return _People._make(part[which] for part in self)

    def and_those(self, others: "_People") -> "_People":
        """Return these and others."""
        return _People._make(map(np.concatenate, zip(self, others, strict=True)))

    def carried(self, time: float) -> "_People":
        """Carry all straight on to a time, s, under white acceleration."""
        dt = time - self.seen
        place, both, velocity = self.spread.T
        spread = [
            place + 2.0 * dt * both + dt**2 * velocity + DENSITY * dt**3 / 3.0,
            both + dt * velocity + DENSITY * dt**2 / 2.0,
            velocity + DENSITY * dt,
        ]
        moved = self.place + dt[:, None] * self.velocity
        return self._replace(place=moved, spread=np.stack(spread, axis=1))

    def corrected(self, time: float, places: Array, variance: float) -> "_People":
        """Correct each by a measured place, (O, D), by Kalman's update."""
        gain = self.spread[:, :2] / (self.spread[:, :1] + variance)
        gap = places - self.place
        left = self.spread - np.stack(
            [gain[:, 0] * self.spread[:, 0], gain[:, 0] * self.spread[:, 1],
             gain[:, 1] * self.spread[:, 1]], axis=1,
        )  # fmt: skip
        seen, place = np.full(len(places), time), self.place + gain[:, :1] * gap
        return _People(self.name, seen, place, self.velocity + gain[:, 1:] * gap, left)


@final
@dataclass(eq=False)
class Identities:
    """Names people whom a simulator reports as places alone, in any order.

    Each person is expected straight on, at p_i + dt (v_i + v_j) / 2 after dt s, with the reported
    velocity v_j of the report j that might be of him, or v_i where there is none. Reports are
    assigned to people at the least sum of

    min(gap, reach)^2 / S_i + 2 ln S_i,   reach = `CHANGE` min(dt, `LONGEST`) + 6 deviation

    with S_i the variance of the gap per axis: minus twice the log likelihood. Of a pair whose
    gap is not below the reach the person counts as absent and the report as that of a new one.
    Velocities that are not reported are estimated by a Kalman filter. Absent people keep their
    names for `MEMORY` s. A clock that goes back is that of another run: all names are new.
    Steps of at most `LONGEST` suit.

    Parameters
    ----------
    deviation : m per axis, standard deviation of the places. The default is for simulators that
        report them exactly.

    Raises
    ------
    WideberthError : a deviation that is not above zero.

    Examples
    --------
    >>> identities = Identities()
    >>> [one.ident for one in identities.named(0.0, [[2.0, 0.0], [5.0, 1.0]])]
    ['1', '2']
    >>> [one.ident for one in identities.named(0.1, [[5.0, 1.1], [1.9, 0.0], [9.0, 0.0]])]
    ['2', '1', '3']
    """

    deviation: float = 0.01
    _people: _People = field(init=False, repr=False)
    _now: float = field(init=False, repr=False)
    _born: int = field(init=False, repr=False)
    _paired: Callable[[Array], tuple[Numbers, Numbers]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        positive("identities.deviation", self.deviation)
        from scipy.optimize import linear_sum_assignment  # not in the first decision that needs it

        self._paired = linear_sum_assignment
        self.reset()

    def reset(self) -> None:
        """Forget all people; the next ones are counted from 1 again."""
        self._people, self._now, self._born = _People.at(0.0, np.empty((0, 2)), 1.0), 0.0, 0

    def named(
        self,
        stamp: float,
        positions: ArrayLike,
        velocities: ArrayLike | None = None,
        radius: ArrayLike = 0.4,
    ) -> tuple[Detection, ...]:
        """Return the people of one instant as detections, for an `Observation`.

        Parameters
        ----------
        stamp : s.
        positions : (K, D), m, in a frame that stands still. A row that is not finite is left out.
        velocities : (K, D), m/s, in the same frame; rows that are not finite are not used.
        radius : m, of all or (K,) of each.

        Returns
        -------
        detections : in the order of the positions, each where it was reported, with the stated
            covariance.

        Raises
        ------
        WideberthError : shapes that do not fit.
        """
        places, moving, radii = _checked(positions, velocities, radius)
        time = number("stamp", stamp)
        time = time if abs(time) <= LATEST else self._now  # NaN is not either
        if time < self._now or places.shape[1:] != self._people.place.shape[1:]:
            self._people = _People.at(0.0, places[:0], 1.0)
        self._now = time
        self._people = self._people.rows(time - self._people.seen <= MEMORY)
        expected = self._people.carried(time)
        before = self._before(expected, places, moving)
        found = self._updated(expected, before, places, moving)
        absent = np.setdiff1d(np.arange(len(expected.name)), before)
        self._people = self._people.rows(absent).and_those(found)
        spread = self.deviation**2 * np.eye(places.shape[1])
        return tuple(
            Detection(str(name), place, spread, size)
            for name, place, size in zip(found.name.tolist(), places, radii.tolist(), strict=True)
        )

    def _before(self, expected: _People, places: Array, moving: Array) -> Numbers:
        """Return the row of each report's person, (K,); -1 for a new one."""
        dt = self._now - self._people.seen
        turned = np.nan_to_num(0.5 * dt[:, None, None] * (moving - expected.velocity[:, None]))
        gap = places - expected.place[:, None] - turned
        reach = CHANGE * np.minimum(dt, LONGEST) + 6.0 * self.deviation
        far = np.minimum(np.hypot.reduce(gap, axis=-1), reach[:, None])
        variance = (expected.spread[:, 0] + self.deviation**2)[:, None]
        rows, columns = self._paired(far**2 / variance + 2.0 * np.log(variance))
        near = far[rows, columns] < reach[rows]
        before = np.full(len(places), -1)
        before[columns[near]] = rows[near]
        return before

    def _updated(
        self, expected: _People, before: Numbers, places: Array, moving: Array
    ) -> _People:
        """Return the people of the reports, in their order."""
        variance, old = self.deviation**2, before >= 0
        found = _People.at(self._now, places, variance)
        known = expected.rows(before[old]).corrected(self._now, places[old], variance)
        for part, own in zip(found, known, strict=True):
            part[old] = own
        given = np.isfinite(moving[:, 0])
        found.place[given], found.velocity[given] = places[given], moving[given]
        found.spread[given] = [variance, 0.0, 0.0]
        new = np.flatnonzero(~old)
        in_order = new[np.lexsort(places[new].T)]  # names do not depend on the order of reports
        found.name[in_order] = self._born + 1 + np.arange(len(new))
        self._born += len(new)
        return found


def _checked(
    positions: ArrayLike, velocities: ArrayLike | None, radius: ArrayLike
) -> tuple[Array, Array, Array]:
    """Return places and velocities (K, D), NaN where not known, and radii (K,) of sound rows."""
    size = 3 if np.shape(positions)[-1:] == (3,) else 2
    places = checked_rows("positions", positions, size, finite=False)
    count = len(places)
    moving = np.full((count, size), np.nan)
    if velocities is not None:
        moving = checked_rows("velocities", velocities, size, finite=False)
    if len(moving) != count:
        raise WideberthError(f"velocities has {len(moving)} rows; wanted {count}, as positions")
    each = np.full(count, radius) if np.ndim(radius) == 0 else radius
    radii = checked("radius", each, (count,), finite=False)
    sound = np.flatnonzero((np.abs(places) <= FARTHEST).all(axis=1))  # NaN is not
    known = np.asarray((np.abs(moving) <= FARTHEST).all(axis=1))
    return places[sound], np.where(known[:, None], moving, np.nan)[sound], radii[sound]
