"""Ways of a robot that are drawn at random, and what each costs among people who react to it."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..control.command_limits import FAST, attained
from ..metrics.episode import approach
from ..robot import Robot
from ..values.arrays import Array
from ..values.motion import Twist
from ..values.number_limits import bounded
from ..values.tracks import Tracks
from .models import PersonModel, Walkers
from .reactions import reactions
from .walls import WallField

CORRELATION = 0.8
"""Of the noise on a twist with that on the one a step earlier: samples are smooth."""
NEAREST = 20
"""People who are rolled out; who is farther away goes straight on, so that work is bounded."""
MOST_PARTS = 8
"""Of a step at which walls are looked at: only a state beyond all limits would need more."""
BACKWARDS = 0.5
"""Share of its speed at which a robot with a heading is tried in reverse."""
MOST_SAMPLES = 100
"""Samples of a track, the newest ones, from which it is read what somebody wants."""


def drawn(
    robot: Robot,
    state: Array,
    rng: np.random.Generator,
    about: Array,
    fastest: float,
    spread: float,
    samples: int,
) -> Array:
    """Draw sequences of twists for a robot, (K, T, 3), m/s and rad/s.

    Half of them are the given sequence with noise on it, smooth in time; of these the first is the
    sequence itself, and the second stands. The others hold one random twist and then another.

    Parameters
    ----------
    robot, state : whose twists, and its state, (n,).
    rng : draws.
    about : (T, 3), the given sequence, m/s and rad/s.
    fastest : m/s, of all of them.
    spread : deviation of the noise over the robot's speed and yaw rate.
    samples : K, at least 4.
    """
    scale, steps = _scale(robot, state, fastest), len(about)
    old, fresh = samples // 2, samples - samples // 2
    noise = rng.standard_normal((old, steps, 3))
    for row in range(1, steps):
        kept = np.sqrt(1.0 - CORRELATION**2)
        noise[:, row] = CORRELATION * noise[:, row - 1] + kept * noise[:, row]
    near = about + spread * scale * noise
    near[0] = about
    near[1] = 0.0
    held = rng.uniform(-1.0, 1.0, (fresh, 2, 3))
    if robot.pose(tuple(state)).heading is not None:
        held[..., 0] = 0.5 * (1.0 + BACKWARDS) * held[..., 0] + 0.5 * (1.0 - BACKWARDS)
    changed = rng.integers(1, steps, fresh)
    later = np.arange(steps) >= changed[:, None]
    anew = scale * np.where(later[..., None], held[:, 1:], held[:, :1])
    found = np.concatenate([near, anew])
    speed = np.hypot(found[..., 0], found[..., 1])
    found[..., :2] *= np.minimum(1.0, fastest / np.maximum(speed, 1e-9))[..., None]
    return np.asarray(found)


def _scale(robot: Robot, state: Array, fastest: float) -> Array:
    """Return the largest twist, (3,): speeds along and across, m/s, and yaw rate, rad/s."""
    if robot.pose(tuple(state)).heading is None:
        return np.array([fastest, fastest, 0.0])
    turning = attained(robot, state, [Twist((fastest, 0.0), FAST)])[0, 2]
    return np.array([fastest, 0.0, abs(float(turning))])


@final
@dataclass(frozen=True, eq=False)
class Neighbourhood:
    """People who react to a robot, and walls.

    Attributes
    ----------
    model : the rule of the people.
    people : as they are now.
    walls : where nobody walks.
    nearest : how many of the people are rolled out; the others go straight on.
    """

    model: PersonModel
    people: Walkers
    walls: WallField
    nearest: int = NEAREST

    def gaps(self, ways: Array, radius: float, dt: float) -> Array:
        """Return the gaps between surfaces beside each way, (K, N + W, T), m.

        They are the smallest within each step: of N people, who see the robot of that way, see
        `reactions`, and of W walls at points a radius apart.

        Parameters
        ----------
        ways : (K, T + 1, 2), m, places of the robot every ``dt`` s, the first one now.
        radius : m, of the robot.
        """
        away = np.linalg.norm(self.people.place - ways[0, 0], axis=1)
        order = np.argsort(away, kind="stable")
        near, far = (
            _some(self.people, rows) for rows in (order[: self.nearest], order[self.nearest :])
        )
        others = reactions(self.model, near, ways, radius, self.walls, dt)
        times = dt * np.arange(ways.shape[1])[:, None]
        straight = far.place[:, None] + times * far.wanted[:, None]
        met = [
            approach(ways[:, None], places) - radius - some.radius[:, None]
            for some, places in ((near, others), (far, straight))
        ]
        return np.concatenate([*met, self._beside(ways, radius)], axis=1)

    def _beside(self, ways: Array, radius: float) -> Array:
        """Return the gaps to each wall in each step, (K, W, T), m; at points a radius apart."""
        moves = np.diff(ways, axis=1)
        longest = float(np.linalg.norm(moves, axis=-1).max(initial=0.0))
        parts = int(np.clip(np.ceil(longest / radius), 1, MOST_PARTS))
        shares = np.arange(1.0, parts + 1)[:, None] / parts
        places = ways[:, :-1, None] + shares * moves[:, :, None]  # (K, T, parts, 2)
        shape = *places.shape[:3], len(self.walls.polygons)
        gaps = self.walls.beside(places.reshape(-1, 2))[..., 0].reshape(shape).min(axis=2)
        return np.asarray(np.moveaxis(gaps, -1, 1) - radius)


def _some(people: Walkers, rows: NDArray[np.intp]) -> Walkers:
    """Return some of the people."""
    return Walkers(*(getattr(people, name)[rows] for name in vars(people)))


@final
@dataclass(frozen=True)
class WayCost:
    """What a way costs, m.

    ::

        J = mean_t |p_t - c_t| + C (T + 1 - t_touch) / T
            + Q dt sum_t sum_i max(0, 1 - gap_ti / m)^2

    c_t is where the robot is wanted; t_touch is the first step with a contact (none costs
    nothing), and gaps are those of `Neighbourhood.gaps`.

    Parameters
    ----------
    contact, closeness, margin : C, m; Q, m/s; m, m.
    """

    contact: float
    closeness: float
    margin: float

    def of(
        self, around: Neighbourhood, ways: Array, radius: float, wanted: Array, dt: float
    ) -> Array:
        """Return J of each way, (K,), m.

        Parameters
        ----------
        around : people and walls.
        ways : (K, T + 1, 2), m, every ``dt`` s, the first place now.
        radius : m, of the robot.
        wanted : c, (2,) or (T, 2), m.
        """
        steps = ways.shape[1] - 1
        gaps = around.gaps(ways, radius, dt)
        touched = gaps.min(axis=1, initial=np.inf) < 0.0
        left = np.where(touched.max(axis=1), steps - touched.argmax(axis=1), 0)
        close = (np.clip(1.0 - gaps / self.margin, 0.0, None) ** 2).sum(axis=(1, 2))
        off = np.linalg.norm(ways[:, 1:] - wanted, axis=-1).mean(axis=1)
        return np.asarray(off + self.contact * left / steps + self.closeness * dt * close)


def averaged(before: Array, velocity: Array, duration: float | Array, memory: float) -> Array:
    """Return what somebody is believed to want after a while, m/s: the mean velocity lately.

    ::

        u <- u + (1 - exp(-t / memory)) (v - u)

    Parameters
    ----------
    before, velocity : u and v, (..., 2), m/s.
    duration : t, s, a number or (..., 1).
    memory : s.
    """
    share = 1.0 - np.exp(-duration / memory)
    return np.asarray(velocity + (1.0 - share) * (before - velocity))


def walkers_of(tracks: Tracks, stamp: float, memory: float) -> Walkers:
    """Return the people of some tracks as they are at a time, with what they seem to want.

    The velocity is the difference of the last two samples over the time between them, 0 at first
    sight; what is wanted is its mean lately, see `averaged`. All walk straight on from their last
    sample to ``stamp``. Who was not seen within the newest `MOST_SAMPLES` is left out.

    Parameters
    ----------
    tracks : in the plane.
    stamp : s, on their clock.
    memory : s.
    """
    known = bounded(tracks, None)
    tracks = tracks if known is None else known.tracks
    positions = tracks.positions[:, -MOST_SAMPLES:]
    count, samples, _ = positions.shape
    place, velocity, wanted = np.zeros((3, count, 2))
    last, moved = np.full(count, -1), np.zeros(count, dtype=np.bool_)
    for row in range(samples):
        here = positions[:, row]
        seen = np.isfinite(here).all(axis=1)
        again = seen & (last >= 0)
        span = tracks.dt * (row - last[again])[:, None]
        velocity[again] = (here[again] - place[again]) / span
        mean = averaged(wanted[again], velocity[again], span, memory)
        wanted[again] = np.where(moved[again, None], mean, velocity[again])
        moved |= again
        place[seen], last[seen] = here[seen], row
    since = stamp - tracks.stamp + tracks.dt * (samples - 1 - last)
    place += since[:, None] * velocity
    kept = np.flatnonzero(last >= 0)
    return _some(Walkers(place, velocity, wanted, tracks.radius), kept)
