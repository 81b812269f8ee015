"""What is believed of people: kind, wanted velocity, turns and courtesy, by Bayes' rule."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, final

import numpy as np

from ...framework.tracking.names import FASTEST as RUNNING
from ...framework.tracking.names import LEAP
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.roots import reduced
from ...people.models import Company, PersonModel, Walkers
from .history import IntArray

SMALL = 0.2
"""m/s, by which velocities are varied for derivatives: wide, because a model that keeps between
half-planes has edges, and a derivative at one says little of what lies beyond it."""
STEEPEST = 2.0
"""Frobenius norm that derivatives are held below: at an edge of two half-planes there are none."""
SLOWEST, FASTEST = 0.3, 2.5
"""m/s, speeds of new wanted velocities."""
SURPRISE, PULL = 0.3, 0.5
"""m/s per axis: how far a first velocity may be from the motion, and the wish from it."""
EXACT = 0.1
"""m^2/s^2 per axis: a first velocity counts as independent of the error of the first place up to
this variance, which is small beside those of `SURPRISE` and `PULL`."""
STILL = 1e-6
"""m; a way shorter than this has no direction."""
LIKELY = 0.02
"""Weight from which on a hypothesis may expect a sample, as long as it takes no turn for that."""
TURN_RATE = 0.25
"""1/s, at which a person takes a new direction, any."""
SHAKE = 0.08
"""m/s, standard deviation of what a step adds to a velocity beside the model."""
WANDER = 0.02
"""m/s per root of s, of the wanted velocity."""
FORGET = 0.02
"""Share of the prior that a second adds to the probabilities of the groups."""
LEAST_DENSITY = 1e-3
"""1/m^2, added to every likelihood: no sample alone rules a hypothesis out."""
HALF_TIME = 2.0
"""s, in which what was strange about a walker is forgotten to 1/e."""


@dataclass(frozen=True, eq=False)
class HypothesisSlots:
    """Hypotheses on one person, in a fixed order: kind, courtesy and direction of the wish.

    Attributes
    ----------
    models : the kinds. Who avoids others has two groups of hypotheses: making way for the robot,
        and not.
    courtesy : prior probability that a person who avoids others makes way for the robot.
    """

    models: tuple[PersonModel, ...]
    courtesy: float

    @cached_property
    def groups(self) -> tuple[tuple[int, bool, float], ...]:
        """Kind, courtesy and prior probability of each group."""
        share = 1.0 / len(self.models)
        found: list[tuple[int, bool, float]] = []
        for kind, model in enumerate(self.models):
            if model.avoids:
                found += [(kind, True, share * self.courtesy)]
                found += [(kind, False, share * (1.0 - self.courtesy))]
            else:
                found += [(kind, False, share)]
        return tuple(found)

    @cached_property
    def group(self) -> IntArray:
        """Number of the group of each hypothesis, (S,)."""
        sizes = [self.models[kind].directions for kind, _, _ in self.groups]
        return np.repeat(np.arange(len(sizes)), sizes)

    @cached_property
    def kind(self) -> IntArray:
        """Model of each hypothesis, (S,)."""
        return np.array([kind for kind, _, _ in self.groups])[self.group]

    @cached_property
    def courteous(self) -> BoolArray:
        """Whether each hypothesis makes way for the robot, (S,)."""
        return np.array([courteous for _, courteous, _ in self.groups])[self.group]

    @cached_property
    def size(self) -> IntArray:
        """Number of hypotheses in the group of each one, (S,)."""
        return np.asarray(np.bincount(self.group)[self.group], dtype=np.int64)

    @cached_property
    def angle(self) -> Array:
        """Direction of each hypothesis from the person's first one, (S,), rad."""
        first = np.searchsorted(self.group, self.group)
        return np.asarray(2.0 * np.pi * (np.arange(len(self.group)) - first) / self.size)

    @cached_property
    def prior(self) -> Array:
        """Prior probability of each hypothesis, (S,)."""
        return np.array([share for _, _, share in self.groups])[self.group] / self.size

    @cached_property
    def several(self) -> BoolArray:
        """Whether the hypothesis is one of several directions, (S,)."""
        return np.asarray(self.size > 1, dtype=np.bool_)

    def per_group(self, values: Array) -> Array:
        """Sum (N, S) values over each group, and give each hypothesis its group's sum, (N, S)."""
        return np.asarray(self.in_groups(values)[:, self.group])

    def in_groups(self, values: Array) -> Array:
        """Sum (N, S) values over each group, (N, G)."""
        starts = np.flatnonzero(np.diff(self.group, prepend=-1))
        return np.asarray(np.add.reduceat(values, starts, axis=1))


@final
@dataclass(frozen=True, eq=False)
class PersonBeliefs:
    """What is believed of N people at one instant.

    Attributes
    ----------
    stamp : s. dt : s, of the tracks.
    ids : N identities.
    state : (N, S, 6), mean of place, velocity and wanted velocity under each hypothesis.
    covariance : (N, S, 6, 6).
    weight : (N, S), probabilities.
    frame : (N, 2), unit vector of the first direction.
    samples : (N,), seen since the person began; 0 who has not.
    strange : (N,), recent share of samples that no hypothesis had expected.
    robot : (5,), place, velocity and radius of the robot at that instant; None if unknown.
    """

    stamp: float
    dt: float
    ids: tuple[str, ...]
    state: Any
    covariance: Any
    weight: Any
    frame: Any
    samples: Any
    strange: Any
    robot: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp", float(self.stamp))
        for name in ("state", "covariance", "weight", "frame", "samples", "strange", "robot"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, np.asarray(value, dtype=np.float64))

    @classmethod
    def none(
        cls, slots: HypothesisSlots, ids: Sequence[str], stamp: float, dt: float
    ) -> "PersonBeliefs":
        """Return those of people of whom nothing was seen."""
        count, size = len(ids), len(slots.group)
        return cls(
            stamp, dt, tuple(ids),
            np.zeros((count, size, 6)),
            np.zeros((count, size, 6, 6)),
            np.tile(slots.prior, (count, 1)),
            np.tile([1.0, 0.0], (count, 1)),
            np.zeros(count),
            np.zeros(count),
        )  # fmt: skip

    def of(self, slots: HypothesisSlots, ids: Sequence[str]) -> "PersonBeliefs":
        """Return those of these people, in this order; of strangers nothing is believed."""
        if tuple(ids) == self.ids:
            return self
        fresh = PersonBeliefs.none(slots, ids, self.stamp, self.dt)
        place = {ident: row for row, ident in enumerate(self.ids)}
        known = [row for row, ident in enumerate(ids) if ident in place]
        old = [place[ids[row]] for row in known]
        for name in ("state", "covariance", "weight", "frame", "samples", "strange"):
            getattr(fresh, name)[known] = getattr(self, name)[old]
        return replace(fresh, robot=self.robot)

    @property
    def mean(self) -> Array:
        """Expected place, velocity and wanted velocity, (N, 6)."""
        return np.asarray(np.einsum("ns,nsd->nd", self.weight, self.state))


@dataclass(frozen=True, eq=False)
class PeopleAround:
    """Bodies of N people and the walls beside them: radius (N,), m, and walls, see `Company`."""

    radius: Array
    walls: Array


def stepped(
    slots: HypothesisSlots,
    before: PersonBeliefs,
    measured: Array,
    noise: Array,
    around: PeopleAround,
    duration: float,
) -> PersonBeliefs:
    """Return the beliefs one step later: predicted by each model, then corrected.

    Each hypothesis is an extended Kalman filter on (p, v, u), u the wanted velocity:

        v' = f(p, v, u | all others),   p' = p + t v',   u' = u + wander

    with f of the hypothesis' model. With probability 1 - exp(-rate t) u is a new one of the same
    length and any direction. Weights follow Bayes' rule, w' ~ w p(z).

    Parameters
    ----------
    measured, noise : (N, 2), m, NaN where not seen, and (N, 2, 2), m^2.
    around : walls are those of their expected places.
    duration : t, s.
    """
    now = replace(before, stamp=before.stamp + duration, robot=_carried(before.robot, duration))
    rows = np.flatnonzero(before.samples >= 2)
    if not len(rows):
        return _begun(slots, now, rows, measured, noise, duration)
    some = _taken(before, rows)
    turn = _Turn.of(slots, some, duration)
    near = PeopleAround(around.radius[rows], around.walls[rows])
    ahead, slope = _predicted(slots, some, near, before.mean[rows], duration)
    ahead = replace(ahead, weight=turn.weight)
    later = _corrected(slots, ahead, turn, slope, measured[rows], noise[rows], duration)
    leap = np.hypot(*(measured[rows] - ahead.mean[:, :2]).T) > LEAP + RUNNING * duration
    now = _put(now, rows, later)
    return _begun(slots, now, rows[leap], measured, noise, duration)


def _carried(robot: Any, duration: float) -> Any:
    """Where the robot is after a step, straight on."""
    if robot is None:
        return None
    return np.concatenate([robot[:2] + duration * robot[2:4], robot[2:]])


def _taken(beliefs: PersonBeliefs, rows: IntArray) -> PersonBeliefs:
    ids = tuple(beliefs.ids[row] for row in rows)
    names = ("state", "covariance", "weight", "frame", "samples", "strange")
    return replace(beliefs, ids=ids, **{name: getattr(beliefs, name)[rows] for name in names})


def _put(beliefs: PersonBeliefs, rows: IntArray, some: PersonBeliefs) -> PersonBeliefs:
    names = ("state", "covariance", "weight", "samples", "strange")
    changed = {name: getattr(beliefs, name).copy() for name in names}
    for name, values in changed.items():
        values[rows] = getattr(some, name)
    return replace(beliefs, **changed)


def _begun(
    slots: HypothesisSlots,
    now: PersonBeliefs,
    leapt: IntArray,
    measured: Array,
    noise: Array,
    duration: float,
) -> PersonBeliefs:
    """Begin those who are seen for the first time or have leapt, and those seen a second time.

    The first sample is a place; the second, somewhere else, a velocity and a frame.
    """
    seen = np.asarray(np.isfinite(measured).all(axis=1), dtype=np.bool_)
    samples = now.samples.copy()
    samples[leapt] = 0
    state, strange = now.state.copy(), now.strange.copy()
    way = measured - state[:, 0, :2]
    length = np.hypot(way[:, 0], way[:, 1])
    moved = (length > STILL) & (length <= LEAP + RUNNING * duration)
    again = seen & (samples == 1) & moved
    first = seen & (samples <= 1) & ~again
    samples[first], samples[again] = 1, 2
    state[first, :, :2] = measured[first, None]
    strange[first] = 0.0
    found = replace(now, state=state, samples=samples, strange=strange)
    rows = np.flatnonzero(again)
    return _moving(slots, found, rows, way[rows], noise[rows], duration) if len(rows) else found


def _moving(
    slots: HypothesisSlots,
    now: PersonBeliefs,
    rows: IntArray,
    way: Array,
    noise: Array,
    duration: float,
) -> PersonBeliefs:
    """Give these people the velocity of their way (R, 2), m, since the first sample.

    Both places err by R, so that Cov(p, v) = R / t and Cov(v) = 2 R / t^2 + surprise. A wanted
    velocity u = v + pull errs with p as v does, Cov(p, u) = R / t. The part of R up to `EXACT`
    t^2 is left out of it; without the rest the covariance would have a negative eigenvalue.
    """
    state, covariance = now.state.copy(), now.covariance.copy()
    weight, frame = now.weight.copy(), now.frame.copy()
    length = np.hypot(way[:, 0], way[:, 1])
    weight[rows], frame[rows] = slots.prior, way / length[:, None]
    velocity = way / duration
    speed = np.tile(length[:, None] / duration, (1, len(slots.group)))
    centre, width = _fresh(slots, frame[rows], speed)
    several = slots.several[:, None]
    state[rows, :, :2] += way[:, None]
    state[rows, :, 2:4] = velocity[:, None]
    state[rows, :, 4:] = np.where(several, centre, velocity[:, None])
    spread = 2.0 * noise[:, None] / duration**2 + SURPRISE**2 * np.eye(2)
    wide = (width**2 + SURPRISE**2)[..., None, None] * np.eye(2)
    joint = np.zeros((len(rows), len(slots.group), 6, 6))
    joint[..., :2, :2] = noise[:, None]
    joint[..., :2, 2:4] = joint[..., 2:4, :2] = noise[:, None] / duration
    joint[..., 2:4, 2:4] = spread
    coarse = reduced(noise, EXACT * duration**2)[:, None] / duration
    joint[..., :2, 4:] = joint[..., 4:, :2] = np.where(several[..., None], 0.0, coarse)
    joint[..., 2:4, 4:] = joint[..., 4:, 2:4] = np.where(several[..., None], 0.0, spread)
    joint[..., 4:, 4:] = np.where(several[..., None], wide, spread + PULL**2 * np.eye(2))
    covariance[rows] = joint
    return replace(now, state=state, covariance=covariance, weight=weight, frame=frame)


def _fresh(slots: HypothesisSlots, frame: Array, speed: Array) -> tuple[Array, Array]:
    """Mean, (N, S, 2), and standard deviation per axis, (N, S), of new wanted velocities, m/s."""
    cosine, sine = np.cos(slots.angle), np.sin(slots.angle)
    left = np.stack([-frame[:, 1], frame[:, 0]], axis=1)
    direction = cosine[:, None] * frame[:, None] + sine[:, None] * left[:, None]
    speed = np.clip(speed, SLOWEST, FASTEST)
    width = 0.8 * speed * np.sin(np.pi / np.maximum(slots.size, 2)) + 0.05
    return speed[..., None] * direction, width


@dataclass(frozen=True, eq=False)
class _Turn:
    """A new wanted velocity under each hypothesis.

    Attributes
    ----------
    odds : (N, S), probability of it, given the hypothesis.
    weight : (N, S), of the hypotheses after people may have turned from one into another.
    shift : (N, S, 2), m/s, new mean minus the old one.
    width : (N, S), m/s, standard deviation per axis.
    """

    odds: Array
    weight: Array
    shift: Array
    width: Array

    @classmethod
    def of(cls, slots: HypothesisSlots, some: PersonBeliefs, duration: float) -> "_Turn":
        """Spread the weight of those who turn over the directions of each group.

        Where a group has one direction only, the new velocity is as long as the old one and
        anywhere about it.
        """
        turns = 1.0 - np.exp(-TURN_RATE * duration)
        total = slots.per_group(some.weight)
        coming = turns * total / slots.size
        weight = (1.0 - turns) * some.weight + coming
        wanted = some.state[..., 4:]
        speed = np.sqrt((wanted**2).sum(axis=-1))
        typical = slots.per_group(some.weight * speed) / np.maximum(total, 1e-300)
        centre, width = _fresh(slots, some.frame, typical)
        shift = np.where(slots.several[:, None], centre - wanted, 0.0)
        wide = np.where(slots.several, width, np.sqrt(speed**2 + SLOWEST**2))
        return cls(coming / np.maximum(weight, 1e-300), weight, shift, wide)


def _predicted(
    slots: HypothesisSlots,
    some: PersonBeliefs,
    around: PeopleAround,
    expected: Array,
    duration: float,
) -> tuple[PersonBeliefs, Array]:
    """Return the beliefs before the next sample, and their derivative by u, (N, S, 6, 2).

    The others are where they are ``expected``, (N, 6).
    """
    state = some.state.copy()
    transition = np.zeros((*state.shape, 6))
    transition[...] = np.eye(6)
    transition[..., 2:4, 2:4] = 0.0
    moving = _Moving(some, around, expected, duration)
    for kind, model in enumerate(slots.models):
        mine = slots.kind == kind
        velocity, slopes = moving.under(model, slots.courteous[mine], state[:, mine])
        state[:, mine, 2:4] = velocity
        for column, slope in slopes.items():
            transition[:, mine, 2:4, column : column + 2] = slope
    transition[..., :2, 2:] = duration * transition[..., 2:4, 2:]
    state[..., :2] += duration * state[..., 2:4]
    push = np.concatenate([0.5 * duration * np.eye(2), np.eye(2), np.zeros((2, 2))])
    process = SHAKE**2 * push @ push.T
    process[4:, 4:] = WANDER**2 * duration * np.eye(2)
    covariance = transition @ some.covariance @ np.swapaxes(transition, -1, -2) + process
    return replace(some, state=state, covariance=covariance), transition[..., 4:]


@dataclass(frozen=True, eq=False)
class _Moving:
    """People about to take one step among each other's expected motions."""

    some: PersonBeliefs
    around: PeopleAround
    expected: Array
    duration: float

    def under(
        self, model: PersonModel, courteous: BoolArray, state: Array
    ) -> tuple[Array, dict[int, Array]]:
        """Return next velocities (N, S', 2) and their derivatives by column of the state."""
        count, size = state.shape[:2]
        axes = self._axes(state)
        varied = [(4, 0), (4, 1), *([(2, 0), (2, 1)] if model.inertia else [])]
        tried = np.repeat(state[None], 1 + len(varied), axis=0)
        for row, (column, axis) in enumerate(varied, start=1):
            tried[row, ..., column : column + 2] += SMALL * axes[axis]
        flat = tried.reshape(-1, 6)
        owner = np.tile(np.repeat(np.arange(count), size), len(tried))
        radius = self.around.radius
        walkers = Walkers(flat[:, :2], flat[:, 2:4], flat[:, 4:], radius[owner])
        others = company_of(self.expected, radius, self.some.robot)
        seen = sight(others, count)[owner]
        if self.some.robot is not None:
            seen[:, -1] &= np.tile(courteous, len(flat) // size)
        near = self.around.walls[owner]
        company = Company(others[:, :2], others[:, 2:4], others[:, 4], seen, near)
        found = model.next_velocity(walkers, company, self.duration)
        found = found.reshape(len(tried), count, size, 2)
        slopes: dict[int, Array] = {}
        for row, (column, axis) in enumerate(varied, start=1):
            change = (found[row] - found[0]) / SMALL
            part = change[..., :, None] * axes[axis][..., None, :]
            slopes[column] = slopes.get(column, 0.0) + part
        return found[0], {column: _bounded(slope) for column, slope in slopes.items()}

    def _axes(self, state: Array) -> tuple[Array, Array]:
        """Return unit vectors along and across each wanted velocity, (N, S', 2) each."""
        wanted = state[..., 4:]
        length = np.sqrt((wanted**2).sum(axis=-1, keepdims=True))
        first = np.where(length > STILL, wanted, self.some.frame[:, None])
        first = first / np.where(length > STILL, length, 1.0)
        return first, np.stack([-first[..., 1], first[..., 0]], axis=-1)


def company_of(bodies: Array, radius: Array, robot: Array | None) -> Array:
    """Return the bodies that people see, (Q, 5): place, velocity and radius, the robot last."""
    around = np.concatenate([bodies[:, :4], radius[:, None]], axis=1)
    return around if robot is None else np.concatenate([around, robot[None]])


def sight(bodies: Array, count: int) -> BoolArray:
    """Whom the first ``count`` of the bodies (Q, 5) see: (count, Q).

    A body sees neither itself nor one of which more than half is inside its own: two people
    never are, so that this is one person, reported twice.
    """
    apart = bodies[:count, None, :2] - bodies[:, :2]
    room = 0.5 * (bodies[:count, None, 4] + bodies[:, 4])
    seen = np.hypot(apart[..., 0], apart[..., 1]) > room
    np.fill_diagonal(seen, val=False)
    return np.asarray(seen, dtype=np.bool_)


def _bounded(slope: Array) -> Array:
    size = np.sqrt((slope**2).sum(axis=(-1, -2), keepdims=True))
    return np.asarray(slope * np.minimum(1.0, STEEPEST / np.maximum(size, 1e-300)))


def _corrected(
    slots: HypothesisSlots,
    ahead: PersonBeliefs,
    turn: _Turn,
    slope: Array,
    measured: Array,
    noise: Array,
    duration: float,
) -> PersonBeliefs:
    """Return the beliefs after a sample; who was not seen stays as predicted."""
    seen = np.asarray(np.isfinite(measured).all(axis=1), dtype=np.bool_)
    place = np.where(seen[:, None], measured, ahead.mean[:, :2])
    first = _updated(ahead.state, ahead.covariance, place, noise)
    turned = ahead.state + (slope @ turn.shift[..., None])[..., 0]
    wider = ahead.covariance + turn.width[..., None, None] ** 2 * (
        slope @ np.swapaxes(slope, -1, -2)
    )
    other = _updated(turned, wider, place, noise)
    state, covariance, density = _merged(first, other, turn.odds)
    best = first[2].max(axis=1, where=ahead.weight > LIKELY, initial=0.0)
    weight = ahead.weight * density
    weight /= weight.sum(axis=1, keepdims=True)
    total = slots.per_group(weight)
    prior = slots.per_group(np.broadcast_to(slots.prior, weight.shape))
    kept = 1.0 - np.exp(-FORGET * duration)
    weight *= ((1.0 - kept) * total + kept * prior) / np.maximum(total, 1e-300)
    weight /= weight.sum(axis=1, keepdims=True)
    fade = 1.0 - np.exp(-duration / HALF_TIME)
    strange = ahead.strange + fade * ((best < 2.0 * LEAST_DENSITY) - ahead.strange)
    missing = ~seen
    state[missing], covariance[missing] = ahead.state[missing], ahead.covariance[missing]
    weight[missing], strange[missing] = ahead.weight[missing], ahead.strange[missing]
    samples = ahead.samples + seen
    return replace(
        ahead, state=state, covariance=covariance, weight=weight, strange=strange, samples=samples
    )


def _updated(
    state: Array, covariance: Array, place: Array, noise: Array
) -> tuple[Array, Array, Array]:
    """Kalman update with a place (N, 2); its density, (N, S), 1/m^2, and `LEAST_DENSITY`."""
    spread = covariance[..., :2, :2] + noise[:, None]
    a, b, d = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    determinant = a * d - b * b
    inverse = np.empty_like(spread)
    inverse[..., 0, 0], inverse[..., 1, 1] = d, a
    inverse[..., 0, 1] = inverse[..., 1, 0] = -b
    inverse /= determinant[..., None, None]
    error = place[:, None] - state[..., :2]
    gain = covariance[..., :2] @ inverse
    moved = state + (gain @ error[..., None])[..., 0]
    left = covariance - gain @ covariance[..., :2, :]
    left = 0.5 * (left + np.swapaxes(left, -1, -2))
    square = (error[..., None, :] @ inverse @ error[..., None])[..., 0, 0]
    density = np.exp(-0.5 * np.minimum(square, 1400.0)) / (2.0 * np.pi * np.sqrt(determinant))
    return moved, left, density + LEAST_DENSITY


def _merged(
    first: tuple[Array, Array, Array], second: tuple[Array, Array, Array], odds: Array
) -> tuple[Array, Array, Array]:
    """Moments of a mixture of two Gaussians, the second of prior probability ``odds``."""
    one, two = (1.0 - odds) * first[2] + 1e-300, odds * second[2] + 1e-300
    share = (two / (one + two))[..., None]
    apart = second[0] - first[0]
    state = first[0] + share * apart
    both = (1.0 - share[..., None]) * first[1] + share[..., None] * second[1]
    between = (share * (1.0 - share))[..., None] * apart[..., :, None] * apart[..., None, :]
    return state, both + between, one + two
