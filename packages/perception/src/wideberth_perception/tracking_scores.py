"""How well a tracker follows: GOSPA, identity switches, latency and NEES."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wideberth.framework.values.arrays import Array, checked, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.sensing.perceived import TrackedObstacle

IntArray: TypeAlias = NDArray[np.int64]

NINETY_FIVE = 9.488
"""95 % quantile of chi-square with four degrees of freedom."""


@final
@dataclass(frozen=True)
class Gospa:
    """The error of a set of positions, and what it is made of.

    Attributes
    ----------
    value : m, the whole: (located^p + cut^p (missed + false) / 2)^(1/p).
    located : m, (sum of d^p over the pairs)^(1/p).
    pairs : of a true position and an estimate, closer than the cut.
    missed : true positions without an estimate.
    false : estimates without a true position.
    """

    value: float
    located: float
    pairs: int
    missed: int
    false: int


def gospa(
    truth: ArrayLike, estimates: ArrayLike, *, cut: float = 1.0, order: float = 2.0
) -> Gospa:
    """Generalised optimal sub-pattern assignment metric, with alpha = 2.

        GOSPA^p = min over assignments  sum_pairs d(x_i, y_j)^p + c^p / 2 (|X| + |Y| - 2 |pairs|)

    with c the ``cut`` and p the ``order``. A pair costs at most as much as a missed position and
    a false one together.

    Parameters
    ----------
    truth : (N, D), m. estimates : (M, D), m.
    cut : c, m. order : p, at least 1.

    Raises
    ------
    WideberthError : positions that are not finite or of other dimensions, a cut that is not
        positive, an order below 1.

    References
    ----------
    Rahmathullah, García-Fernández, Svensson, "Generalized optimal sub-pattern assignment
    metric", FUSION 2017.

    Examples
    --------
    >>> found = gospa([[0.0, 0.0], [5.0, 0.0]], [[0.3, 0.0], [9.0, 0.0]])
    >>> round(found.value, 3), found.pairs, found.missed, found.false
    (1.044, 1, 1, 1)
    """
    true, found = _places("truth", truth, None), _places("estimates", estimates, None)
    if len(true) and len(found):
        found = _places("estimates", estimates, true.shape[1])
    positive("cut", cut)
    if positive("order", order) < 1.0:
        raise WideberthError(f"order is {order:g}; wanted at least 1")
    distance = np.zeros((len(true), len(found)))
    if distance.size:
        distance = np.linalg.norm(true[:, None] - found[None], axis=2)
    rows, columns = _assigned(distance, cut, order)
    paired = distance[rows, columns]
    missed, false = len(true) - len(rows), len(found) - len(rows)
    located = _norm(paired, np.ones(len(rows)), order)
    shares = np.append(np.ones(len(rows)), (missed + false) / 2.0)
    return Gospa(_norm(np.append(paired, cut), shares, order), located, len(rows), missed, false)


def _norm(lengths: Array, weights: Array, order: float) -> float:
    """(sum_i w_i l_i^p)^(1/p); scaled, so that no power over- or underflows."""
    scale = float(lengths[weights > 0.0].max(initial=0.0))
    if scale == 0.0:
        return 0.0
    powers = np.minimum(lengths / scale, 1.0) ** order
    return scale * float((weights * powers).sum() ** (1.0 / order))


def _places(name: str, values: ArrayLike, size: int | None) -> Array:
    """Return positions, (N, D); an empty list is none."""
    array = np.asarray(values)
    return checked(name, array if array.size else np.zeros((0, size or 2)), (None, size))


def _assigned(distance: Array, cut: float, order: float) -> tuple[IntArray, IntArray]:
    """Rows and columns of the cheapest pairs that are closer than the cut."""
    columns = _cheapest(np.minimum(distance, cut), cut, cut, order)
    rows = np.flatnonzero(columns >= 0)
    near = distance[rows, columns[rows]] < cut
    return rows[near], columns[rows[near]]


NEGLIGIBLE = 1e-12
"""Share of the largest cost of an assignment below which rounding hides a cost."""


def _cheapest(distance: Array, cut: float, scale: float, order: float) -> IntArray:
    """Column of each row at the least sum of distance^order; -1 for a row without one.

    Costs that rounding would hide behind larger ones are minimised in a second assignment, of the
    rows and columns that the larger ones leave.
    """
    from scipy.optimize import linear_sum_assignment

    largest_cost = 1.0 + min(distance.shape)  # more than all pairs of the length `scale`
    with np.errstate(over="ignore"):
        costs = np.minimum((distance / scale) ** order, largest_cost)
    rows, columns = linear_sum_assignment(costs)
    pairs = np.full(len(distance), -1)
    pairs[rows] = columns
    lengths = distance[rows, columns]
    hidden = costs[rows, columns] < NEGLIGIBLE
    longest = float(lengths[hidden].max(initial=0.0))
    if longest > 0.0:
        settled = ~hidden & (lengths < cut)
        rest = np.delete(np.arange(distance.shape[0]), rows[settled])
        left = np.delete(np.arange(distance.shape[1]), columns[settled])
        again = _cheapest(distance[np.ix_(rest, left)], cut, longest, order)
        pairs[rest] = np.where(again >= 0, left[again], -1)
    return pairs


@final
@dataclass(frozen=True, eq=False)
class TrackScores:
    """How well obstacles were followed over a run.

    Attributes
    ----------
    gospa : m, mean over the instants.
    located : m, root mean square distance of the nearest pairs.
    missed, false : share of the true obstacles without a track, and tracks without an obstacle
        per instant.
    switches : how often an obstacle went on under another identity.
    latency : s, mean time from an obstacle's appearance to its first track; NaN without one.
    followed : share of the obstacles that ever had a track.
    speed_error : m/s, root mean square error of the velocity.
    nees : mean of e' P^-1 e over the nearest pairs, e the error of position and velocity; 4 is
        honest. Pairs with a singular P do not count; NaN without others.
    inside : share of these pairs whose error lies in the 95 % region that the track states.
    pairs, obstacles, instants : that these were taken over.
    """

    gospa: float
    located: float
    missed: float
    false: float
    switches: int
    latency: float
    followed: float
    speed_error: float
    nees: float
    inside: float
    pairs: int
    obstacles: int
    instants: int


@dataclass
class _Tally:
    """What is counted on the way."""

    values: list[float] = field(default_factory=list)
    errors: list[Array] = field(default_factory=list)
    nees: list[float] = field(default_factory=list)
    missed: int = 0
    false: int = 0
    true: int = 0
    switches: int = 0
    began: dict[str, float] = field(default_factory=dict)
    found: dict[str, float] = field(default_factory=dict)
    last: dict[str, str] = field(default_factory=dict)
    holds: dict[str, str] = field(default_factory=dict)


def track_scores(
    run: Iterable[tuple[float, Mapping[str, Array], Iterable[TrackedObstacle]]],
    *,
    cut: float = 1.0,
    near: float = 0.5,
) -> TrackScores:
    """Score tracks against the true obstacles, instant by instant.

    GOSPA of each instant with p = 2. To count, an obstacle keeps the track that it had, and that
    no other obstacle had since, while that is closer than ``near``; the others are paired at the
    least sum of squares, where closer than ``near`` (CLEAR MOT). Errors are those of the pairs
    at the least sum of squares, whichever tracks they had before: where two tracks change
    places, that is two switches, and no error of a position.

    Parameters
    ----------
    run : time, s; true states by name, (4,), position and velocity; and the tracks at that time.
    cut : m, of GOSPA.
    near : m, beyond which a track is not of an obstacle; about the width of one.

    Raises
    ------
    WideberthError : a distance that is not positive.

    References
    ----------
    Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT
    metrics", EURASIP J. Image Video Process. 2008.
    """
    positive("cut", cut)
    positive("near", near)
    tally = _Tally()
    for time, states, obstacles in run:
        truth = dict(sorted(states.items()))  # whose order decides between equal distances
        tracks = _apart(sorted(obstacles, key=lambda obstacle: obstacle.ident))
        places = np.reshape([state[:2] for state in truth.values()], (-1, 2))
        seen = np.reshape([one.state[:2] for one in tracks.values()], (-1, 2))
        tally.values.append(gospa(places, seen, cut=cut).value)
        _count(tally, time, truth, tracks, _continued(truth, tracks, tally.holds, near))
        for name, ident in _continued(truth, tracks, {}, near).items():
            error = np.asarray(truth[name]) - tracks[ident].state
            tally.errors.append(error)
            tally.nees.append(nees(error, tracks[ident].covariance))
    errors = np.reshape(tally.errors, (-1, 4))
    squares = [value for value in tally.nees if np.isfinite(value)]
    waits = [tally.found[name] - tally.began[name] for name in tally.found]
    return TrackScores(
        gospa=_mean(tally.values),
        located=_root(errors[:, :2]),
        missed=tally.missed / max(tally.true, 1),
        false=tally.false / max(len(tally.values), 1),
        switches=tally.switches,
        latency=_mean(waits),
        followed=len(tally.found) / max(len(tally.began), 1),
        speed_error=_root(errors[:, 2:]),
        nees=_mean(squares),
        inside=_mean(value <= NINETY_FIVE for value in squares),
        pairs=len(errors),
        obstacles=len(tally.began),
        instants=len(tally.values),
    )


def _apart(obstacles: Iterable[TrackedObstacle]) -> dict[str, TrackedObstacle]:
    """Return the tracks by name; the second one of a name counts as another track."""
    tracks: dict[str, TrackedObstacle] = {}
    for obstacle in obstacles:
        count, name = 1, obstacle.ident
        while name in tracks:
            count += 1
            name = f"{obstacle.ident}#{count}"
        tracks[name] = obstacle if count == 1 else replace(obstacle, ident=name)
    return tracks


def _continued(
    truth: Mapping[str, Array],
    tracks: Mapping[str, TrackedObstacle],
    holds: Mapping[str, str],
    near: float,
) -> dict[str, str]:
    """Return obstacle -> track: those that go on, then the nearest of the others."""
    pairs: dict[str, str] = {}
    for name, state in truth.items():
        track = tracks.get(holds.get(name, ""))
        if track is not None and np.hypot(*(state[:2] - track.state[:2])) < near:
            pairs[name] = track.ident
    names = [name for name in truth if name not in pairs]
    idents = [ident for ident in tracks if ident not in pairs.values()]
    true = np.reshape([truth[name][:2] for name in names], (-1, 2))
    found = np.reshape([tracks[ident].state[:2] for ident in idents], (-1, 2))
    distance = np.linalg.norm(true[:, None] - found[None], axis=2)
    rows, columns = _assigned(distance, near, 2.0)
    chosen = zip(rows.tolist(), columns.tolist(), strict=True)
    return pairs | {names[row]: idents[column] for row, column in chosen}


def _count(
    tally: _Tally,
    time: float,
    truth: Mapping[str, Array],
    tracks: Mapping[str, TrackedObstacle],
    pairs: Mapping[str, str],
) -> None:
    """Count what one instant adds."""
    tally.true += len(truth)
    tally.missed += len(truth) - len(pairs)
    tally.false += len(tracks) - len(pairs)
    for name in truth:
        tally.began.setdefault(name, time)
    for name, ident in pairs.items():
        tally.found.setdefault(name, time)
        tally.switches += tally.last.get(name, ident) != ident
        tally.last[name] = ident
    lost = {name: ident for name, ident in tally.holds.items() if ident not in pairs.values()}
    tally.holds = lost | dict(pairs)


def nees(error: Array, covariance: Array) -> float:
    """Normalised estimation error squared, e' P^-1 e; on average the number of entries.

    NaN where P is singular, as the covariance of a state that is known exactly is.

    Examples
    --------
    >>> nees([0.3, 0.0], [[0.09, 0.0], [0.0, 1.0]])
    1.0
    """
    if np.linalg.matrix_rank(covariance, hermitian=True) < len(error):
        return float("nan")
    return float(np.asarray(error) @ np.linalg.solve(covariance, error))


def _mean(values: Iterable[float]) -> float:
    found = list(values)
    return float(np.mean(found)) if found else float("nan")


def _root(errors: Array) -> float:
    """Root mean square length of vectors, (n, D)."""
    return float(np.sqrt((errors**2).sum(axis=1).mean())) if len(errors) else float("nan")
