"""Social forces between walkers and their integration over time."""

from dataclasses import dataclass
from typing import final

import numpy as np

from ...framework.values.arrays import Array, BoolArray, positive
from ...framework.values.forecast import Scene
from .history import IntArray

LONGEST_STEP = 0.1
"""s, step of the integration, as long as `MOST` of them span a step of the forecast."""
MOST = 50
"""Steps of the integration per step of the forecast, at most: steps of minutes are no walk."""
TINY = 1e-3
"""m and m/s; what keeps a division finite where two stand in one place, or stand still."""
FAR = 6.0
"""Surfaces farther apart than this times the force's reach do not push: it is down to 1/400."""


@final
@dataclass(frozen=True)
class Force:
    """How neighbour j pushes walker i, m/s^2.

        f_ij = A c_ij w_ij exp(-max(|d| - r_ij, 0) / B) d / max(|d|, r_ij, B)

    - d: p_i - p_j as it will be if both keep their velocities, r_ij / |v_i - v_j| before they
      are nearest (when they touch, if head-on), yet at most ``anticipation`` s ahead and not
      in the past: people act on what is about to happen;
    - c_ij: the speed at which they approach each other, m/s. Who walks side by side, follows
      or leaves is not pushed. Without it, as in the circular force (Helbing's), groups fall
      apart, and recorded people are forecast worse than by constant velocity;
    - w_ij = (1 + cos phi) / 2, phi between v_i and the way to j: what is behind is not seen;
    - r_ij: sum of the radii. Within it the force no longer grows, and it vanishes at d = 0, so
      that discs in one place do not turn rounding errors into directions.

    With the defaults two people who meet nearly head-on nearly clear each other. Errors on
    recorded people hardly depend on A in 0.5 to 4 and B in 0.1 to 0.5.

    Parameters
    ----------
    strength : A, 1/s.
    reach : B, m.
    anticipation : s.

    Raises
    ------
    WideberthError : a number out of range.
    """

    strength: float = 2.0
    reach: float = 0.3
    anticipation: float = 1.0

    def __post_init__(self) -> None:
        positive("force.reach", self.reach)
        positive("force.strength", self.strength, zero=True)
        positive("force.anticipation", self.anticipation, zero=True)

    def between(self, apart: Array, velocity: Array, other: Array, touch: Array) -> Array:
        """Push of the neighbours, (..., P, 2), m/s^2.

        Parameters
        ----------
        apart : (..., P, 2), m, from the neighbour to the walker.
        velocity, other : (..., P, 2), m/s, of walker and neighbour.
        touch : (P,), m, sum of the radii.
        """
        relative = velocity - other
        inward = -_dot(apart, relative)
        speed = _dot(relative, relative)
        approach = np.maximum(inward, 0.0) / (_length(apart) + TINY)
        contact = (inward - touch * np.sqrt(speed)) / (speed + TINY**2)
        then = apart + np.clip(contact, 0.0, self.anticipation)[..., None] * relative
        distance = _length(then)
        ahead = -_dot(then, velocity)
        cosine = ahead / (distance * _length(velocity) + TINY**2)
        fading = np.exp(-np.maximum(distance - touch, 0.0) / self.reach)
        size = self.strength * approach * (1.0 + cosine) / 2.0 * fading
        return np.asarray(
            (size / np.maximum(distance, np.maximum(touch, self.reach)))[..., None] * then
        )


@dataclass(frozen=True, eq=False)
class RobotCourse:
    """The robot's expected positions over time.

    Attributes
    ----------
    times : (N,), s after the newest sample of the tracks, increasing; N is at least 2.
    positions : (N, 2), m.
    radius : m.
    """

    times: Array
    positions: Array
    radius: float

    def at(self, time: Array) -> tuple[Array, Array]:
        """Positions and velocities (..., 2) at times (...), straight lines before and beyond."""
        last = len(self.times) - 2
        index = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, last)
        span = self.times[index + 1] - self.times[index]
        velocity = (self.positions[index + 1] - self.positions[index]) / span[..., None]
        since = np.asarray(time - self.times[index])[..., None]
        return self.positions[index] + since * velocity, velocity


def course_of(scene: Scene | None, dt: float, stamp: float) -> RobotCourse | None:
    """Return the robot's own plan as a course; None if the scene has no plan.

    A plan without times is taken to be on the grid of the forecast, its first row one step
    of ``dt`` s after ``stamp``.
    """
    if scene is None or scene.plan is None or len(scene.plan) < 2:
        return None
    if scene.plan_times is None:
        times = dt * np.arange(1, len(scene.plan) + 1, dtype=np.float64)
    else:
        times = np.asarray(scene.plan_times) - stamp
        if (np.diff(times) <= 0).any():  # so long ago that the clock cannot tell its rows apart
            return None
    return RobotCourse(times, np.asarray(scene.plan), scene.radius)


@dataclass(frozen=True, eq=False)
class SocialWalkers:
    """Walkers and their desired velocities.

    Attributes
    ----------
    position, velocity : (O, 2), m and m/s, now.
    radius : (O,), m.
    known : (O,), False where nothing is known: neither pushes nor is pushed.
    goals : (O, 2), m, or None: all want to go on as now.
    """

    position: Array
    velocity: Array
    radius: Array
    known: BoolArray
    goals: Array | None

    def wanted(self, position: Array, soon: float) -> Array:
        """Desired velocity of each walker at these positions (..., O, 2), m/s.

        Towards a goal it slows down as soon as it would be there within ``soon`` s.
        """
        if self.goals is None:
            return self.velocity
        way = self.goals - position
        speed = _length(self.velocity)
        left = np.maximum(_length(way), soon * speed)
        return np.asarray((speed / np.maximum(left, TINY * soon))[..., None] * way)


def roll_out(
    walkers: SocialWalkers,
    robot: RobotCourse | None,
    force: Force,
    relaxation: float,
    factors: Array,
    dt: float,
    steps: int,
) -> Array:
    """Integrate the motion of all walkers under several assumptions on their desired velocities.

    dv_i/dt = (u_i - v_i) / tau + sum over j of f_ij,   dp_i/dt = v_i

    with the forces held over one step of the integration and the rest solved exactly. Under
    every assumption a walker meets the others as they move under the first one.

    Parameters
    ----------
    walkers, robot, force : who moves, and how they push.
    relaxation : tau, s.
    factors : (K, 2); u_i is the wanted velocity times 1 + the first, plus the second times
        the wanted velocity turned left by a right angle. The first row is (0, 0).
    dt, steps : grid of what is returned.

    Returns
    -------
    positions : (K, O, N, 2), m.
    """
    parts = int(np.clip(np.ceil(dt / LONGEST_STEP - 1e-9), 1, MOST))
    kept = float(np.exp(-dt / parts / relaxation))
    place = np.repeat(walkers.position[None], len(factors), axis=0)
    velocity = np.repeat(walkers.velocity[None], len(factors), axis=0)
    courses = np.empty((*place.shape[:2], steps, 2))
    for row in range(steps):
        pairs = _meeting(walkers, robot, place, velocity, force, dt)
        for part in range(parts):
            wanted = walkers.wanted(place, relaxation)
            turned = np.stack([-wanted[..., 1], wanted[..., 0]], axis=-1)
            wanted = wanted + factors[:, :1, None] * wanted + factors[:, 1:, None] * turned
            others = _with_robot(place[0], velocity[0], robot, dt * (row + part / parts))
            wanted += relaxation * _pushes(place, velocity, others, force, pairs)
            place = place + dt / parts * wanted
            place += relaxation * (1.0 - kept) * (velocity - wanted)
            velocity = wanted + kept * (velocity - wanted)
        courses[:, :, row] = place
    return courses


def _with_robot(
    place: Array, velocity: Array, robot: RobotCourse | None, time: float
) -> tuple[Array, Array]:
    """Positions and velocities of the walkers, followed by those of the robot."""
    if robot is None:
        return place, velocity
    where, how_fast = robot.at(np.asarray(time))
    return np.vstack([place, where]), np.vstack([velocity, how_fast])


def _pushes(
    place: Array, velocity: Array, others: tuple[Array, Array], force: Force, pairs: "_Pairs"
) -> Array:
    """Sum of the forces on each walker, (K, O, 2), m/s^2."""
    walker, neighbour = pairs.walker, pairs.neighbour
    total = np.zeros_like(place)
    if not walker.size:
        return total
    apart = place.take(walker, axis=1) - others[0].take(neighbour, axis=0)
    relative = velocity.take(walker, axis=1) - others[1].take(neighbour, axis=0)
    # Who does not come nearer is not pushed, whatever the rest of the force.
    row, pair = np.nonzero(_dot(apart, relative) < 0)
    walker, neighbour = walker[pair], neighbour[pair]
    pushes = force.between(
        apart[row, pair], velocity[row, walker], others[1][neighbour], pairs.touch[pair]
    )
    pushed = row * place.shape[1] + walker
    for axis in range(2):
        sums = np.bincount(pushed, pushes[:, axis], minlength=total[..., axis].size)
        total[..., axis] = sums.reshape(total.shape[:2])
    return total


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs that may interact, sorted by walker; the robot is neighbour O.

    Attributes
    ----------
    walker, neighbour : (P,), indices.
    touch : (P,), m, sum of the radii.
    """

    walker: IntArray
    neighbour: IntArray
    touch: Array


def _meeting(
    walkers: SocialWalkers,
    robot: RobotCourse | None,
    place: Array,
    velocity: Array,
    force: Force,
    dt: float,
) -> _Pairs:
    """Find the pairs that can interact during the next ``dt`` s, under any assumption."""
    known = np.flatnonzero(walkers.known)
    place, velocity, radius = place[:, known], velocity[:, known], walkers.radius[known]
    astray = _length(place - place[0]).max(axis=0)
    fastest = _length(velocity).max(axis=0) * (dt + force.anticipation)
    room = np.add.outer(radius + fastest + astray, radius + fastest) + FAR * force.reach
    near = _length(place[0][:, None] - place[0]) < room
    np.fill_diagonal(near, val=False)
    radius, others = walkers.radius, known
    if robot is not None:
        near = np.concatenate([near, np.ones((len(known), 1), dtype=np.bool_)], axis=1)
        radius = np.append(radius, robot.radius)
        others = np.append(known, len(walkers.radius))
    row, column = np.nonzero(near)
    walker, neighbour = known[row], others[column]
    return _Pairs(walker, neighbour, radius[walker] + radius[neighbour])


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(_dot(vectors, vectors)))


def _dot(first: Array, second: Array) -> Array:
    """Inner products of vectors (..., 2); sums over axes this short are slow in NumPy."""
    return np.asarray(first[..., 0] * second[..., 0] + first[..., 1] * second[..., 1])
