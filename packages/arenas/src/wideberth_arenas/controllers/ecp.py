"""Egocentric conformal prediction in a planner that samples paths (ECP)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, final

import numpy as np

from wideberth.framework.values.arrays import Array, positive, probability, whole

from .sampled_paths import SampledController, SampledPaths, SeenPeople, Singles, clearance

FASTEST, LARGEST = 1.5, 0.5
"""m/s, times the time ahead: the margin before there are scores, and the published one where
alpha has fallen to 0."""


class _Decision(NamedTuple):
    """Paths that were drawn, (P, N + 1, 2), m, and their margins, (P, N), m."""

    points: Singles
    margin: Array


@final
@dataclass(eq=False)
class EgocentricConformalPlanner(SampledController):
    """Keeps clear of forecasts by margins of each path's own, calibrated on what it would miss.

    Of a path's point x at step i, the score at an instant t in the past is how much nearer the
    nearest person was at t than the forecast of t - i said::

        s = max(min_o |x - forecast_o| - min_o |x - person_o|, 0)

    over those who are in both. The margin is the 1 - alpha_i quantile of the last ``window``
    scores, and a path is allowed where it is farther than both bodies' radii and the margin from
    the nearest forecast at every step. alpha_i follows the share of the paths drawn i steps ago
    whose margin was too small: alpha_i <- alpha_i + gamma (alpha - share).

    With ``as_published``, beside the fault of `SampledController`:

    - the loop passes the highest speed as the lowest one too: the robot drives at 0.8 m/s, or
      stands where no path is allowed, and cannot slow down or turn on the spot;
    - the oldest decision is never judged while there are at most N;
    - the quantile is interpolated; the finite-sample one has the rank ceil((n + 1)(1 - alpha_i));
    - where alpha_i <= 0 the margin is 0.5 m/s times the time ahead, a third of what it is before
      there are scores.

    Parameters
    ----------
    tail : alpha.
    rate : gamma.
    window : scores that a margin is made of.
    robot, predictor, period, steps, paths, seed, as_published : as in `SampledController`.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    J. Shin et al., Egocentric conformal prediction for safe and efficient navigation in dynamic
    cluttered environments, 2025; the code is that of CORE-SNU/FCP-MPC, which compares with it.
    """

    reference: ClassVar[str] = "shin2025egocentric"

    tail: float = 0.1
    rate: float = 0.02
    window: int = 15

    def __post_init__(self) -> None:
        probability("EgocentricConformalPlanner.tail", self.tail)
        positive("EgocentricConformalPlanner.rate", self.rate, zero=True)
        whole("EgocentricConformalPlanner.window", self.window)
        super().__post_init__()

    def forget(self) -> None:
        """Drop what was seen and decided."""
        self._alpha = np.full(self.steps, self.tail)
        self._seen: dict[int, SeenPeople] = {}
        self._decided_at: dict[int, _Decision] = {}
        self._decisions = 0

    def learn(self, seen: SeenPeople, place: Array) -> None:
        """Judge the margins of paths drawn before, and remember who is where."""
        most = min(self.steps, self._decisions - 1) if self.as_published else self.steps
        for step in range(1, most + 1):
            before, past = self._decided_at.get(seen.row - step), self._seen.get(seen.row - step)
            if before is None or past is None:
                continue
            score = _scores(before.points[:, step], [(seen, past)], step)[0]
            share = float(np.mean(before.margin[:, step - 1] < score))
            self._alpha[step - 1] += self.rate * (self.tail - share)
        self._seen[seen.row] = seen
        oldest = seen.row - self.steps - self.window
        self._seen = {row: one for row, one in self._seen.items() if row > oldest}
        oldest = seen.row - self.steps
        self._decided_at = {row: one for row, one in self._decided_at.items() if row > oldest}

    def slowest(self, fastest: float) -> float:
        """As fast backwards; as published as fast forwards."""
        return fastest if self.as_published else -fastest

    def cost(self, paths: SampledPaths, goal_cost: Array, seen: SeenPeople) -> Array:
        """Forbid paths that come too near to a forecast, each by its own margins."""
        margin = self._margins(paths.points, seen.row)
        self._decided_at[seen.row] = _Decision(paths.points, margin)
        self._decisions += 1
        room = clearance(paths.points[:, 1:], seen.ahead, seen.radius) - self.robot.radius
        return np.where((room >= margin).all(axis=1), goal_cost, np.inf)

    def _margins(self, points: Singles, now: int) -> Array:
        """Return the margin of each path and step, (P, N), m."""
        ahead = self.period * np.arange(1, self.steps + 1)
        margin: Array = np.tile(FASTEST * ahead, (len(points), 1)).astype(np.float64)
        # As many rows for every step: those for which all forecasts have fallen due.
        rows = [row for row in self._seen if all(row - i in self._seen for i in self._steps())]
        for step in self._steps() if rows else ():
            newest = sorted(rows)[-self.window :]
            pairs = [(self._seen[row], self._seen[row - step]) for row in newest]
            scores = _scores(points[:, step], pairs, step)
            margin[:, step - 1] = self._quantile(scores, step, margin[:, step - 1])
        return margin

    def _steps(self) -> range:
        return range(1, self.steps + 1)

    def _quantile(self, scores: Array, step: int, bound: Array) -> Array:
        """Return the margin from (n, P) scores of a step, (P,), m; ``bound`` for lack of them."""
        count, level = len(scores), 1.0 - float(self._alpha[step - 1])
        if level <= 0.0:
            return np.zeros(scores.shape[1])
        ordered = np.sort(scores, axis=0)
        if self.as_published:
            if level >= 1.0:
                return np.full(scores.shape[1], LARGEST * self.period * step)
            below, share = divmod((count - 1) * level, 1.0)
            low, high = ordered[int(below)], ordered[min(int(below) + 1, count - 1)]
            return np.asarray(low + share * (high - low))
        rank = int(np.ceil((count + 1) * level - 1e-9))
        return bound if rank > count else np.asarray(ordered[rank - 1])


def _scores(points: Singles, pairs: Sequence[tuple[SeenPeople, SeenPeople]], step: int) -> Array:
    """Return how much nearer people were to some points than was forecast, (n, P).

    Parameters
    ----------
    points : (P, 2), m. pairs : n instants, and what was seen ``step`` instants before.
    """
    scores = np.zeros((len(pairs), len(points)))
    found = [now.with_past(past, step) for now, past in pairs]
    known = [k for k, (now, _, _) in enumerate(found) if len(now)]
    if known:
        ends = np.cumsum([len(found[k][0]) for k in known])
        people = [np.concatenate([found[k][i] for k in known]) for i in range(3)]
        true, said = (_gaps(points, people[i], people[2]) for i in range(2))
        for k, first, last in zip(known, [0, *ends[:-1]], ends, strict=True):
            nearer = said[first:last].min(axis=0) - true[first:last].min(axis=0)
            scores[k] = np.maximum(nearer, 0.0)
    return scores


def _gaps(points: Singles, people: Array, radius: Array) -> Array:
    """Return distances from discs (K, 2) to points (P, 2), (K, P), m."""
    along, aside = (np.subtract.outer(people[:, i], points[:, i]) for i in range(2))
    along *= along  # in place: these are most of an episode's time
    aside *= aside
    along += aside
    np.sqrt(along, out=along)
    along -= radius[:, None]
    return np.asarray(along)
