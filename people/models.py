"""Models of people: the next velocity of walkers who meet others, walls and a robot.

The rules are those of the people in simulations, `wideberth.controllers.social_force` and
`wideberth.controllers.orca`, for many walkers at once.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, TypeVar, final

import numpy as np

from ..framework.values.arrays import Array, BoolArray, positive, whole
from ._half_planes import compiled

LARGEST_EXPONENT = 50.0
"""Exponents are held below this: the speed is at its limit long before, and exp stays finite."""
COINCIDENT = 1e-3
"""m between centres below which a circular force fades: in one place there is no direction."""


@dataclass(frozen=True, eq=False)
class Walkers:
    """B walkers, none of whom sees another one of them; whom they see is the `Company`.

    Leading axes (...) are worlds apart, each with its own walkers and its own company.

    Attributes
    ----------
    place, velocity : (..., B, 2), m and m/s.
    wanted : (..., B, 2), m/s, the velocity of a walker who is alone; none walks faster.
    radius : (..., B), m.
    """

    place: Array
    velocity: Array
    wanted: Array
    radius: Array


@dataclass(frozen=True, eq=False)
class Company:
    """Bodies and walls around walkers.

    Attributes
    ----------
    place, velocity : (..., Q, 2), m and m/s, of the bodies.
    radius : (..., Q), m.
    seen : (..., B, Q), which of them each walker sees.
    walls : (..., B, W, 3), m: distance of each wall from the walker's centre, negative inside, and
        the unit vector away from its nearest point.
    """

    place: Array
    velocity: Array
    radius: Array
    seen: BoolArray
    walls: Array


class PersonModel(ABC):
    """Says how walkers change their velocity; laws: pure, and each walker by himself.

    Turning or shifting the world turns or shifts the result with it.
    """

    name: ClassVar[str]
    """Name of the model in a belief about a person."""
    avoids: ClassVar[bool] = True
    """Whether others play a part."""
    inertia: ClassVar[bool] = False
    """Whether the present velocity matters, and not the wanted one alone."""
    directions: ClassVar[int] = 1
    """Wanted directions that a belief should hold apart: more than one where avoidance hides the
    wanted velocity altogether, so that no single Gaussian describes what is known of it."""

    @abstractmethod
    def next_velocity(self, walkers: Walkers, company: Company, duration: float) -> Array:
        """Return the velocity for the next ``duration`` s, (..., B, 2), m/s."""


@final
@dataclass(frozen=True)
class Straight(PersonModel):
    """Walks as wanted and never makes way: v' = v*."""

    name: ClassVar[str] = "straight"
    avoids: ClassVar[bool] = False

    def next_velocity(self, walkers: Walkers, company: Company, duration: float) -> Array:
        """Return the wanted velocity."""
        return walkers.wanted


@final
@dataclass(frozen=True)
class CircularForce(PersonModel):
    """Helbing's force in its circular form.

    ::

        a = K (v* - v) + sum_j A exp((r + r_j + GAP - d_j) / B) n_j
                       + sum_w A_w exp((r + GAP - d_w) / B_w) n_w
        v' = v + t a,   |v'| <= |v*|

    n_j points from neighbour j to the walker, d_j is the distance of the centres, d_w that from
    wall w and n_w away from its nearest point.

    Parameters
    ----------
    stiffness : K, 1/s.
    strength, reach : A, m/s^2, and B, m, of neighbours.
    wall_strength, wall_reach : A_w and B_w, of walls.

    Raises
    ------
    WideberthError : a number out of range.
    """

    name: ClassVar[str] = "social_force"
    inertia: ClassVar[bool] = True
    GAP: ClassVar[float] = 0.01
    """m, added to the radii."""

    stiffness: float = 1.0
    strength: float = 3.0
    reach: float = 0.18
    wall_strength: float = 2.0
    wall_reach: float = 0.025

    def __post_init__(self) -> None:
        for name in ("stiffness", "reach", "wall_reach"):
            positive(f"circular_force.{name}", getattr(self, name))
        for name in ("strength", "wall_strength"):
            positive(f"circular_force.{name}", getattr(self, name), zero=True)

    def next_velocity(self, walkers: Walkers, company: Company, duration: float) -> Array:
        """Return the velocity that the forces leave."""
        apart = walkers.place[..., :, None, :] - company.place[..., None, :, :]
        room = walkers.radius[..., :, None] + company.radius[..., None, :] + self.GAP
        push = circular_force(apart, room, self.strength, self.reach, company.seen)
        wall = self.wall_strength * exponential(
            (walkers.radius[..., :, None] + self.GAP - company.walls[..., 0]) / self.wall_reach
        )
        push += (wall[..., None] * company.walls[..., 1:]).sum(axis=-2)
        later = walkers.velocity + duration * (
            self.stiffness * (walkers.wanted - walkers.velocity) + push
        )
        return shortened(later, np.hypot(walkers.wanted[..., 0], walkers.wanted[..., 1]))


def shortened(velocity: Array, fastest: Array) -> Array:
    """Return velocities (..., B, 2) brought down to the highest speeds (..., B), m/s."""
    speed = np.hypot(velocity[..., 0], velocity[..., 1])
    share = np.where(speed > fastest, fastest / np.where(speed > 0.0, speed, 1.0), 1.0)
    return np.asarray(velocity * share[..., None])


def circular_force(
    apart: Array,
    room: Array,
    strength: float | Array,
    reach: float | Array,
    seen: BoolArray | None = None,
) -> Array:
    """Sum of circular forces, sum_j A exp((room_j - d_j) / B) n_j, (..., 2), m/s^2.

    Parameters
    ----------
    apart : (..., Q, 2), m, from each neighbour to the walker; d_j is its length, n_j its
        direction.
    room : (..., Q), m, distance at which a force is A.
    strength, reach : A, m/s^2, and B, m, of all or of each, (Q,).
    seen : (..., Q), which neighbours count; all by default.
    """
    distance = np.hypot(apart[..., 0], apart[..., 1])
    push = strength * exponential((room - distance) / reach)
    if seen is not None:
        push = push * seen
    away = apart / np.maximum(distance, COINCIDENT)[..., None]
    return np.asarray((push[..., None, :] @ away)[..., 0, :])


def exponential(values: Array) -> Array:
    """Return exp of exponents, which are clipped at `LARGEST_EXPONENT`."""
    return np.asarray(np.exp(np.minimum(values, LARGEST_EXPONENT)))


@final
@dataclass(frozen=True)
class Reciprocal(PersonModel):
    """ORCA: each of two takes half of the smallest velocity change that avoids a collision.

    Of the velocities with |v'| <= |v*| that keep every half-plane (v' - (v + u_j / 2)) . n_j >= 0,
    the nearest to v*; see `wideberth.controllers.orca.Orca`, which asks the library RVO2 in
    single precision. This is double precision and the same to its rounding, but for two things:
    of who stands in the same place with the same velocity there is no half-plane (the library
    then has a direction of the world), and a wall is the half-plane of its nearest point,
    v' . n >= -gap / tau_w, where the library has the wall's outline.

    Parameters
    ----------
    neighbour_distance : m within which others count.
    most_neighbours : how many of them, nearest first.
    time_horizon : s, of others.
    obstacle_horizon : tau_w, s, of walls.
    safety_space : m, added to every radius, own and others'.

    Raises
    ------
    WideberthError : a number out of range.
    """

    name: ClassVar[str] = "orca"
    inertia: ClassVar[bool] = True
    directions: ClassVar[int] = 12

    neighbour_distance: float = 10.0
    most_neighbours: int = 10
    time_horizon: float = 5.0
    obstacle_horizon: float = 5.0
    safety_space: float = 0.01

    def __post_init__(self) -> None:
        whole("reciprocal.most_neighbours", self.most_neighbours)
        for name in ("neighbour_distance", "time_horizon", "obstacle_horizon"):
            positive(f"reciprocal.{name}", getattr(self, name))
        positive("reciprocal.safety_space", self.safety_space, zero=True)

    def next_velocity(self, walkers: Walkers, company: Company, duration: float) -> Array:
        """Return the best velocity within all half-planes, or the one that enters them least."""
        if walkers.place.ndim > 2:
            return np.stack(
                [
                    self.next_velocity(_world(walkers, index), _world(company, index), duration)
                    for index in range(len(walkers.place))
                ]
            )
        wider = company.radius[:, None] + self.safety_space
        others = np.concatenate([company.place, company.velocity, wider], axis=1)
        radius = walkers.radius + self.safety_space
        walls = company.walls - radius[:, None, None] * np.array([1.0, 0.0, 0.0])
        sight = self.neighbour_distance, self.most_neighbours
        settings = np.array([*sight, self.time_horizon, self.obstacle_horizon, duration])
        wanted = walkers.wanted
        fastest = np.hypot(wanted[:, 0], wanted[:, 1])
        found = compiled()(
            walkers.place, walkers.velocity, wanted, fastest, radius, others, company.seen, walls,
            settings,
        )  # fmt: skip
        return np.asarray(found)


Parts = TypeVar("Parts", Walkers, Company)


def _world(parts: Parts, index: int) -> Parts:
    """Return one world of several."""
    return type(parts)(**{name: value[index] for name, value in vars(parts).items()})
