"""People who walk straight on until they turn: a mode for each time of the turn and new way."""

from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import ClassVar, Self, final

import numpy as np

from ..framework.predictor import AdaptiveFiltering, Predictor
from ..framework.values.arrays import Array, BoolArray, positive, whole
from ..framework.values.beliefs import Beliefs
from ..framework.values.forecast import LIGHT, Forecast, Scene
from ..framework.values.measurements import NO_LOG, Measurements
from ..framework.values.polygon import convex_hull, width_across
from ..framework.values.tracks import Tracks
from ..people.convex_area import THIN, ConvexArea, Corners, checked_area
from .core.assembly import Gaussians, with_fallback
from .core.history import NOISE_FLOOR, gather, measurement_noise
from .core.kalman_filter import filtered
from .core.straight_stretch import LONGEST_STRETCH, since_jump
from .kalman import DriftingVelocity, Kalman

GOLDEN = 0.6180339887498949
"""Share of all directions from one mode to the next: any number of modes is spread evenly."""
CELL = 0.7
"""Part of its share of times and of directions that a mode's covariance covers."""
SECTORS = 16
"""Sectors into which new directions are divided."""
GIVEN_BORDER, LEARNT_BORDER = 0.1, 1.0
"""m by which people may leave an area that is given, and one that is learnt."""
SHARP = 45.0
"""degrees; a change of direction by more is a turn."""
COMPARED = 0.6
"""s before and after an instant over which the two directions of a turn are measured."""
STROLL = 0.3
"""m/s; who is slower has no direction that could change."""
SLOWEST = 1e-6
"""m/s, keeps divisions by the speed of an obstacle that stands finite."""
WALK = DriftingVelocity(density=0.02, speed=2.0)
"""How people walk between turns, and what is known of them at first."""
UNREST = 0.4
"""m/s, standard deviation that the velocity has in addition at a jump, and no more after
`LONGEST_STRETCH` steps."""
PRIOR = 4.0
"""Exposure that the prior of the tendency to turn is worth."""
ENCLOSED = 4.0
"""Evidence from which on people are taken not to leave the area around the places seen."""


@final
@dataclass(frozen=True, eq=False)
class WatchedTurns:
    """What has been learnt by watching people.

    Attributes
    ----------
    stamp : s, of the newest sample used.
    turns : seen so far.
    exposure : sum of dt / T of all who walked, T s before they would have left the area.
    corners : of the convex hull of all places where people were, m.
    evidence : that people do not leave this hull and 1 m more: one for each turn and each walk
        of its width, less one for each m by which a person exceeds the hull; at least 0.
    """

    stamp: float
    turns: int = 0
    exposure: float = 0.0
    corners: tuple[tuple[float, float], ...] = ()
    evidence: float = 0.0

    @cached_property
    def area(self) -> ConvexArea | None:
        """Area around all places where people were; None as long as they are on a line."""
        corners = np.reshape(self.corners, (-1, 2))
        if len(corners) < 3 or width_across(corners) < THIN:
            return None
        return ConvexArea.around(corners, LEARNT_BORDER)


@final
@dataclass(frozen=True)
class TurningPeople(AdaptiveFiltering):
    """Straight on until a turn, and then on in another direction at the same speed.

    In an area that people do not leave, a person who would leave it in T s turns at a rate of

    lambda(t) = k / (T - t),   so that   P(no turn before t) = (1 - t / T)^k,

    where k, the tendency to turn, is 1 for people whose next place is anywhere on their way to
    the border alike, and nearly 0 for people who walk out. The new direction leads to a place
    anywhere in the area: its density is proportional to r(angle)^2, with r the way to the
    border. Where no area is known the rate is ``hazard``, and all directions are alike.

    The first mode walks straight on, with the probability that there is no turn up to the last
    step. The others share the rest alike: with n of them the time of the turn of mode i is the
    quantile (i + 1/2) / n, its new direction the quantile that moves on by the golden ratio from
    mode to mode, counted from the person's own direction. There are as many as
    leaves each the weight that plans heed (`LIGHT`); others have weight 0. Turns are sudden,
    and there is one at most up to the last step.

    Place and velocity come from a Kalman filter of the measurements since the last jump of the
    velocity (`since_jump`, which looks at the grid of the tracks). Its covariance counts as alike
    along both axes; to it are added the white acceleration of the filter, what one mode leaves
    open of the time and direction that it stands for, and 0.4 m/s of the velocity at a jump, less
    with every step after it: who has just swerved swerves again. The joint covariance is exact for
    this model. A tracker's velocity lags behind a turn and is not used.

    `update` learns by watching. The convex hull of all places where people were, and 1 m
    more, is the area where none is given, as soon as people were seen to turn in it or to walk
    across it four times more often than to exceed it by 1 m: the hull of the first seconds is
    only a part of the place. For a prior k ~ Gamma(4 k_0, 4) with k_0 the
    ``tendency``, turns that come at the rate k / T and the sum E of dt / T over all who walk
    give the mean

    k = (4 k_0 + number of turns) / (4 + E)

    A turn is a change of direction by 45 degrees between the 0.6 s before and after.

    Left to ``fallback``, with the reason: three coordinates, and people of a single measurement.

    Parameters
    ----------
    modes : of each person.
    area : corners of the convex area that people do not leave, m; none if it is to be learnt.
    hazard : turns per s, where no area is known. Of 0.005, 0.01, 0.02 and 0.05 per s the default
        has the least mean error over the five scenes of ETH/UCY, cut into clips of 14 s.
    tendency : k before anyone was watched.
    fallback : predictor for the others.
    state : what `update` has learnt; None before.

    Raises
    ------
    WideberthError : fewer than two modes, a number that is not positive, corners without an area.

    References
    ----------
    C. Bettstetter, H. Hartenstein and X. Perez-Costa, "Stochastic Properties of the Random
    Waypoint Mobility Model", 2004, for people who walk from place to place in an area. That the
    tendency to turn is learnt is ours.
    """

    modes: int = 24
    area: Corners = ()
    hazard: float = 0.01
    tendency: float = 1.0
    fallback: Predictor = field(default_factory=Kalman)
    state: WatchedTurns | None = None

    reference: ClassVar[str] = "bettstetter2004stochastic"

    def __post_init__(self) -> None:
        whole("turning.modes", self.modes, least=2)
        for name in ("hazard", "tendency"):
            positive(f"turning.{name}", getattr(self, name))
        checked_area("turning.area", self.area)

    def filtered(self, tracks: Tracks, before: Beliefs | None = None) -> Beliefs:
        """Return place and velocity of all obstacles; see `Filtering.filtered`.

        The few measurements since the last jump are filtered every time, whatever ``before``.
        """
        if tracks.dimension != 2:
            return Beliefs.none()
        past = gather(tracks, length=LONGEST_STRETCH + 1)
        alike = measurement_noise(tracks, NOISE_FLOOR).trace(axis1=1, axis2=2) / 2
        stretch = since_jump(past, alike, tracks.dt, WALK.density)
        begin = np.asarray(tracks.clock - tracks.dt * (past.late + stretch.length - 0.5), float)
        since = replace(tracks, sightings=_since(begin, tracks.measured), stamp=tracks.clock)
        walk = filtered(since, None, WALK, NOISE_FLOOR)
        left = 1.0 - (stretch.length - 1) / LONGEST_STRETCH
        unrest = UNREST**2 * np.where(stretch.began > past.began, left, 0.0)
        log = (NO_LOG,) * len(tracks)
        return Beliefs(log, walk.newest, past.samples, (*walk.values, unrest))

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        count, size = len(tracks), tracks.dimension
        if size != 2:
            shape = count, steps, size
            empty = Gaussians(np.zeros(shape), np.zeros((*shape, size)), (None,) * count)
            flat = [f"turning: {size} coordinates, needs 2"] * count
            return with_fallback(empty, flat, self.fallback, tracks, scene)
        place, velocity, variance = _walks(beliefs)
        times = tracks.lag[:, None] + tracks.dt * np.arange(1.0, steps + 1)
        turns = self._turns(place, velocity, times.max(axis=1, initial=0))
        futures = _Futures(turns, times, variance, WALK.density)
        own = Forecast(
            futures.mean(),
            futures.covariance(),
            turns.weight,
            tracks.dt,
            (None,) * count,
            partial(_joint, futures),
        )
        missing = ["turning: 1 sample, needs 2" if n < 2 else None for n in beliefs.count]
        return with_fallback(own, missing, self.fallback, tracks, scene)

    @cached_property
    def _watched_area(self) -> ConvexArea | None:
        """The area that is given, or around all places seen."""
        if self.area:
            return ConvexArea.around(convex_hull(np.array(self.area)), GIVEN_BORDER)
        return None if self.state is None else self.state.area

    @property
    def _known_area(self) -> ConvexArea | None:
        """The area that people do not leave; None as long as a learnt one lacks evidence."""
        if not self.area and (self.state is None or self.state.evidence < ENCLOSED):
            return None
        return self._watched_area

    @property
    def learnt_tendency(self) -> float:
        """Mean of k after all that was watched."""
        if self.state is None:
            return self.tendency
        return (PRIOR * self.tendency + self.state.turns) / (PRIOR + self.state.exposure)

    def _turns(self, place: Array, velocity: Array, horizon: Array) -> "_Turns":
        """Return a straight mode and the turns of all others, up to the horizon (O,), s."""
        speed = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), SLOWEST)[:, None]
        heading, area = velocity / speed, self._known_area
        if area is None:
            law = _TurnLaw(None, self.hazard)
        else:
            left = area.way_left(place[:, None], heading[:, None])[:, 0]
            law = _TurnLaw(left / speed, self.learnt_tendency)
        chance, each = law.chance(horizon[:, None]), np.arange(self.modes - 1.0)
        number = np.minimum(np.floor(chance / LIGHT), self.modes - 1)
        few, active = np.maximum(number, 1.0), each < number
        middle, half = np.minimum((each + 0.5) / few, 1.0), 0.5 * CELL / np.sqrt(few)
        ends = (np.clip(middle + side, 0.0, 1.0) for side in (-half, 0.0 * half, half))
        early, time, late = (law.time(share * chance) for share in ends)
        turned = place[:, None] + time[..., None] * velocity[:, None]
        angle, width = _ways(area, turned, heading, ((each + 0.5) * GOLDEN) % 1.0, 2.0 * half)
        weight = active * (chance / few)
        straight = 1.0 - weight.sum(axis=1, keepdims=True)
        first = np.zeros_like(straight)
        return _Turns(
            place,
            velocity,
            np.concatenate([np.maximum(straight, 0.0), weight], axis=1),
            np.concatenate([first + horizon[:, None], time], axis=1),
            np.concatenate([first, late - early], axis=1),
            np.concatenate([first, angle], axis=1),
            np.concatenate([first, width], axis=1),
        )

    def update(
        self, tracks: Tracks, scene: Scene | None = None, beliefs: Beliefs | None = None
    ) -> Self:
        """Learn from the samples since the last update; see `Adaptive.update`."""
        positions, state = tracks.positions, self.state
        if tracks.dimension != 2 or not positions.size:
            return self
        rows = positions.shape[1]
        if state is None or tracks.stamp < state.stamp:
            state = WatchedTurns(tracks.stamp - rows * tracks.dt)
        fresh = int(min(round((tracks.stamp - state.stamp) / tracks.dt), rows))
        if fresh < 1:
            return self
        before = replace(self, state=state)._watched_area
        seen = positions[:, rows - fresh :].reshape(-1, 2)
        seen = seen[np.isfinite(seen).all(axis=1)]
        if not self.area and len(seen):
            hull = convex_hull(np.concatenate([np.reshape(state.corners, (-1, 2)), seen]))
            state = replace(state, corners=tuple((float(x), float(y)) for x, y in hull))
        learnt = replace(self, state=replace(state, stamp=tracks.stamp))
        return learnt._counted(tracks, fresh, before)

    def _counted(self, tracks: Tracks, fresh: int, before: ConvexArea | None) -> Self:
        """Return a copy that has counted turns, exposure and evidence at the newest rows.

        ``before`` is the area around what was seen before these rows.
        """
        area, state, seen = self._watched_area, self.state, _Seen.of(tracks, fresh)
        if area is None or state is None or seen is None:
            return self
        place = tracks.positions[seen.walking, -1]
        speed = np.hypot(*seen.velocity.T)[:, None]
        heading = (seen.velocity / speed)[:, None]
        left, behind = (area.way_left(place[:, None], way)[:, 0] for way in (heading, -heading))
        exposure = state.exposure + seen.span * float((speed / left).sum())
        across = seen.span * float((speed / (left + behind)).sum())
        evidence = state.evidence + seen.turns + across - _exceeded(before, tracks)
        counted = replace(
            state,
            turns=state.turns + seen.turns,
            exposure=exposure,
            evidence=max(evidence, 0.0),
        )
        return replace(self, state=counted)


def _since(begin: Array, sightings: Measurements) -> Measurements:
    """Return the measurements from times (O,), s, on, and at least the newest of each obstacle."""
    pairs = zip(sightings.times, begin, strict=True)
    first = [min(int(times.searchsorted(time)), max(len(times) - 1, 0)) for times, time in pairs]
    return sightings.part([slice(number, None) for number in first])


def _exceeded(area: ConvexArea | None, tracks: Tracks) -> float:
    """Return by how much people exceed the hull in a learnt area, sum in units of its border.

    Infinite where there was no area: how fast the first places spread is unknown.
    """
    if area is None:
        return np.inf
    newest = tracks.positions[:, -1]
    depth = area.depth(newest[np.isfinite(newest).all(axis=1)])
    return float(np.maximum(LEARNT_BORDER - depth, 0.0).sum() / LEARNT_BORDER)


def _walks(beliefs: Beliefs) -> tuple[Array, Array, Array]:
    """Place (O, 2), m, and velocity (O, 2), m/s, at the newest measurements.

    The third are variances, means of both axes, of place, of place with velocity, and of velocity,
    (O, 3). Who has just jumped jumps again: `UNREST` fades with the steps since then.
    """
    _, state, covariance, origin, unrest = beliefs.values
    alike = covariance.trace(axis1=1, axis2=3)[:, :, 0] / 2
    variance = np.stack([alike[0, 0], alike[0, 1], alike[1, 1] + unrest], axis=1)
    return (origin + state[0, :, 0]).T, state[1, :, 0].T, variance


def _ways(
    area: ConvexArea | None, place: Array, heading: Array, quantile: Array, cell: Array
) -> tuple[Array, Array]:
    """Choose new directions for those who turn at places (O, M, 2), m.

    Parameters
    ----------
    heading : (O, 2), old directions, unit vectors.
    quantile : (M,), of the new one.
    cell : (O, 1), share of all directions that each stands for.

    Returns
    -------
    angle, width : (O, M), rad, from the old direction, and of the sector that it stands for.
    """
    if area is None:
        angle = np.broadcast_to(2 * np.pi * quantile, place.shape[:2])
        return angle, np.broadcast_to(2 * np.pi * cell, angle.shape)
    sector = 2 * np.pi / SECTORS
    middle = sector * (np.arange(SECTORS) + 0.5)
    left = np.stack([-heading[:, 1], heading[:, 0]], axis=1)
    direction = (
        np.cos(middle)[:, None] * heading[:, None] + np.sin(middle)[:, None] * left[:, None]
    )
    density = area.way_left(place, direction) ** 2
    below = np.cumsum(density, axis=-1)
    wanted = quantile * below[..., -1]
    which = (below < wanted[..., None]).sum(axis=-1)[..., None]
    there, upto = (np.take_along_axis(one, which, axis=-1)[..., 0] for one in (density, below))
    angle = sector * (which[..., 0] + 1.0 - (upto - wanted) / there)
    return angle, np.minimum(sector * cell * below[..., -1] / there, np.pi)


@dataclass(frozen=True, eq=False)
class _TurnLaw:
    """When people turn.

    reach : (O, 1), s, until they would leave the area, T; None where no area is known.
    rate : k, or turns per s.
    """

    reach: Array | None
    rate: float

    def chance(self, time: Array) -> Array:
        """Probability of a turn before a time, (O, M), s."""
        if self.reach is None:
            return np.asarray(-np.expm1(-self.rate * time))
        return np.asarray(1.0 - np.maximum(1.0 - time / self.reach, 0.0) ** self.rate)

    def time(self, chance: Array) -> Array:
        """Time before which there is a turn with a probability, (O, M), s."""
        straight = np.log1p(-np.minimum(chance, 1.0 - 1e-12)) / self.rate
        return np.asarray(-straight if self.reach is None else -self.reach * np.expm1(straight))


@dataclass(frozen=True, eq=False)
class _Turns:
    """A turn in each mode.

    place, velocity : (O, 2), now.
    weight : (O, M).
    time, blur : (O, M), s, of the turn, and of all the times that it stands for.
    angle, width : (O, M), rad, of the turn, and of the sector that it stands for.
    """

    place: Array
    velocity: Array
    weight: Array
    time: Array
    blur: Array
    angle: Array
    width: Array


@dataclass(frozen=True, eq=False)
class _Futures:
    """Gaussians of the modes at times (O, N), s.

    p(t) = p + A v + errors,   A = b I + h R,   b = min(t, time),  h = t - b

    with R the turn. Errors are those of p and v, with ``variance`` (O, 3) along each axis as in
    `Stretches`; of the time of the turn, along v - R v; of its angle, across R v; and white
    acceleration.
    """

    turns: _Turns
    times: Array
    variance: Array
    density: float

    @cached_property
    def _spans(self) -> tuple[Array, Array]:
        """Times before and behind the turn, (O, M, N), s."""
        before = np.minimum(self.times[:, None], self.turns.time[..., None])
        return before, self.times[:, None] - before

    @cached_property
    def _new(self) -> Array:
        """Velocity behind the turn, (2, O, M), m/s."""
        cosine, sine = np.cos(self.turns.angle), np.sin(self.turns.angle)
        x, y = self.turns.velocity.T[..., None]
        return np.stack([cosine * x - sine * y, sine * x + cosine * y])

    @cached_property
    def _open(self) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """What time and angle leave open: directions (2, O, M) and factors (O, M, N)."""
        late = self.turns.velocity.T[..., None] - self._new
        aside = np.stack([-self._new[1], self._new[0]])
        behind = self._spans[1]
        blur = np.minimum(behind, self.turns.blur[..., None]) / np.sqrt(12.0)
        return (late, blur), (aside, behind * (self.turns.width / np.sqrt(12.0))[..., None])

    def mean(self) -> Array:
        """Return (O, M, N, 2), m."""
        before, behind = self._spans
        mean = np.empty((*before.shape, 2))
        for axis in range(2):
            place, velocity = self.turns.place[:, axis], self.turns.velocity[:, axis]
            mean[..., axis] = place[:, None, None] + before * velocity[:, None, None]
            mean[..., axis] += behind * self._new[axis][..., None]
        return mean

    def covariance(self) -> Array:
        """Return (O, M, N, 2, 2), m^2."""
        before, behind = self._spans
        first, cross, second = self.variance.T[..., None, None]
        cosine = np.cos(self.turns.angle)[..., None]
        along = before + behind * cosine
        alike = before * (along + behind * cosine) + behind**2
        alike = first + 2.0 * cross * along + second * alike
        alike += self.density / 3.0 * self.times[:, None] ** 3
        covariance = np.empty((*before.shape, 2, 2))
        for i in range(2):
            for j in range(i + 1):
                part = sum((way[i] * way[j])[..., None] * size**2 for way, size in self._open)
                covariance[..., i, j] = part + alike if i == j else part
        covariance[..., 0, 1] = covariance[..., 1, 0]
        return covariance


def _joint(futures: _Futures) -> Array:
    """Joint covariance of all steps, (O, M, N*2, N*2), m^2."""
    before, behind = futures._spans
    count, modes, steps = before.shape
    cosine, sine = np.cos(futures.turns.angle), np.sin(futures.turns.angle)
    turn = np.stack([np.stack([cosine, -sine]), np.stack([sine, cosine])])
    sway = np.eye(2)[..., None, None, None] * before + turn[..., None] * behind
    first, cross, second = futures.variance.T[:, :, None, None, None, None, None]
    joint = second * np.einsum("ikomn,jkomp->omnipj", sway, sway)
    single = sway.transpose(2, 3, 4, 0, 1)[..., None, :]
    joint += cross * (single + single.transpose(0, 1, 4, 5, 2, 3))
    short = np.minimum(futures.times[:, :, None], futures.times[:, None])
    long = np.maximum(futures.times[:, :, None], futures.times[:, None])
    growth = futures.density * short**2 * (3.0 * long - short) / 6.0
    alike = first[..., 0, 0] + growth[:, None]
    joint += alike[:, :, :, None, :, None] * np.eye(2)[:, None]
    for way, size in futures._open:
        error = (way[..., None] * size).transpose(1, 2, 3, 0)
        joint += np.einsum("omni,ompj->omnipj", error, error)
    return np.asarray(joint.reshape(count, modes, 2 * steps, 2 * steps))


@dataclass(frozen=True, eq=False)
class _Seen:
    """Turns at the newest rows, and who walks there.

    turns : number of them.
    span : s, time of the rows.
    walking : (O,), who walks at the newest one.
    velocity : (W, 2), m/s, of those.
    """

    turns: int
    span: float
    walking: BoolArray
    velocity: Array

    @classmethod
    def of(cls, tracks: Tracks, fresh: int) -> "_Seen | None":
        """Compare directions before and after each instant; None where rows are too few."""
        lag = max(round(COMPARED / tracks.dt), 1)
        rows = tracks.positions.shape[1]
        looks = min(fresh, rows - 2 * lag - 1)
        if looks < 1:
            return None
        recent = tracks.positions[:, rows - 2 * lag - 1 - looks :]
        moved = recent[:, lag:] - recent[:, :-lag]
        old, new = moved[:, :-lag], moved[:, lag:]
        lengths = np.linalg.norm(old, axis=2), np.linalg.norm(new, axis=2)
        walks = np.minimum(*lengths) > STROLL * lag * tracks.dt
        sharp = (old * new).sum(axis=2) < np.cos(np.radians(SHARP)) * lengths[0] * lengths[1]
        sharp &= walks
        began = sharp[:, 1:] & ~sharp[:, :-1] & walks[:, :-1]
        walking = np.asarray(walks[:, -1])
        velocity = new[walking, -1] / (lag * tracks.dt)
        return cls(int(began.sum()), looks * tracks.dt, walking, velocity)
