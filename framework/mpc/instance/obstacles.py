"""From path and forecast to the numbers of one MPC instance."""

from dataclasses import dataclass

import numpy as np

from ...region import Region
from ...values.arrays import Array
from ...values.forecast import LIGHT, Forecast, GaussianObstacle
from ..levels.base import LevelPolicy
from ..ocp.problem import Parameters
from ..ocp.reference import Reference

CAPACITIES = (0, 1, 2, 5, 10, 20, 50, 100)
"""Slots that problems are compiled for: one obstacle in a problem made for 20 costs IPOPT
twice and fatrop three times the time."""

FAR, WIDE = 1e6, 1e4
"""m; largest distance of a mean from the robot, and largest standard deviation and radius, that a
solver is given. Squares of larger numbers drown all others, and a solver may then never end.
Nothing is lost: what is farther off is out of reach, and what is wider is everywhere."""


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Gaussian discs on the plan's grid, one per obstacle and forecast mode.

    Attributes
    ----------
    mean : (N, O, D), m. covariance : (N, O, D, D), m^2.
    radius : (O,), m.
    ids : (O,) names; modes of one obstacle share a name.
    left_out : names that did not fit, or whose mode is too unlikely.
    tracked : names of all obstacles of the forecast, in its order.
    """

    mean: Array
    covariance: Array
    radius: Array
    ids: tuple[str, ...]
    left_out: tuple[str, ...] = ()
    tracked: tuple[str, ...] = ()

    @classmethod
    def none(cls, steps: int, dimension: int) -> "Obstacles":
        """No disc at all."""
        mean = np.zeros((steps, 0, dimension))
        return cls(mean, np.zeros((steps, 0, dimension, dimension)), np.zeros(0), ())

    def __len__(self) -> int:
        """Count the discs."""
        return len(self.ids)


def choose_obstacles(
    forecast: Forecast, ids: tuple[str, ...], radius: Array, route: Array, most: int
) -> Obstacles:
    """Keep the discs that come closest to the route, at most ``most`` of them.

    Parameters
    ----------
    forecast : on the plan's grid, N steps.
    ids, radius : of its obstacles.
    route : (R, N, D), m, places where the robot may be at each step (the reference, and
        where it is now).
    most : how many discs the problem can hold.
    """
    owner, mode = np.nonzero(forecast.weight >= LIGHT)
    # Modes of weight 0 only fill up the array; they are no modes.
    light = (forecast.weight < LIGHT) & (forecast.weight > 0)
    unlikely = [ids[o] for o in np.nonzero(light)[0]]
    mean = forecast.mean[owner, mode].swapaxes(0, 1)
    covariance = forecast.covariance[owner, mode].swapaxes(0, 1)
    apart = np.linalg.norm(mean[None] - route[:, :, None], axis=3)
    clearance = apart.min(axis=(0, 1)) - radius[owner]
    nearest = np.sort(np.argsort(clearance, kind="stable")[:most])
    far = sorted(set(range(len(owner))) - set(nearest.tolist()))
    left_out = tuple(unlikely + [ids[owner[i]] for i in far])
    kept = tuple(ids[owner[i]] for i in nearest)
    return Obstacles(
        mean[:, nearest], covariance[:, nearest], radius[owner[nearest]], kept, left_out, ids
    )


def fill(
    initial: Array,
    reference: Reference,
    obstacles: Obstacles,
    region: Region,
    level: LevelPolicy,
    radius: float,
    capacity: int,
    own: Array | None = None,
) -> Parameters:
    """Fill the parameters of a problem with room for ``capacity`` obstacles.

    Numbers of any size become such that a solver can calculate with them, see `FAR`.

    ``radius``, m, is that of the robot's bodies and what is added to it. ``own`` (N, D, D), m^2,
    is the covariance of the robot's own position, which is added to every obstacle's.
    Auxiliaries are filled in later, see `bodies.with_auxiliaries`.

    Empty slots hold a finite dummy, a unit disc at the origin: the mask multiplies it by
    zero, and zero times NaN would be NaN. Their level is that of the first obstacle.
    """
    steps, size = reference.position.shape
    used = len(obstacles)
    mean = np.zeros((steps, capacity, size))
    covariance = np.zeros((steps, capacity, size, size))
    covariance[:] = np.eye(size)
    margin = np.ones(capacity)
    here = reference.position[:1, None]
    mean[:, :used] = within_reach(obstacles.mean, here)
    covariance[:, :used] = obstacles.covariance
    if own is not None:
        with np.errstate(over="ignore"):
            covariance[:, :used] += own[:, None]
    covariance = not_wider(covariance)
    margin[:used] = np.minimum(obstacles.radius + radius, WIDE)
    spread = np.broadcast_to(margin, (steps, capacity))
    numbers = np.zeros((steps, 0, region.parameter_count(size)))
    if capacity:
        numbers = region.parameters(GaussianObstacle(mean, covariance), spread)
    return Parameters(
        initial=initial,
        reference=reference.position,
        direction=reference.direction,
        speed=reference.speed,
        regions=numbers,
        level=_levels(level, region, obstacles, capacity),
        active=(np.arange(capacity) < used).astype(np.float64),
        auxiliaries=np.zeros((steps, capacity, 0)),
        statics=np.zeros((steps, 0, 0)),
        static_active=np.zeros(0),
        static_auxiliaries=np.zeros((steps, 0, 0)),
        curve=reference.curve,
    )


def within_reach(mean: Array, here: Array) -> Array:
    """Return means no coordinate of which is farther than `FAR` from ``here``."""
    return np.clip(mean, here - FAR, here + FAR)


def not_wider(covariance: Array) -> Array:
    """Return covariances no standard deviation of which exceeds `WIDE`, (..., D, D).

    Those that are smaller are returned as they are. Others keep their axes; one whose numbers are
    too large to be decomposed becomes round.
    """
    size = covariance.shape[-1]
    wide = ~(np.abs(covariance).max(axis=(-2, -1), initial=0.0) <= WIDE**2 / size)
    if not wide.any():
        return covariance
    bounded = covariance.copy()
    for index in zip(*np.nonzero(wide), strict=True):
        one = covariance[index]
        largest = np.abs(one).max()
        if not np.isfinite(largest):
            bounded[index] = WIDE**2 * np.eye(size)
            continue
        values, vectors = np.linalg.eigh(one / largest)
        values = np.minimum(np.clip(values, 0.0, None), WIDE**2 / largest) * largest
        bounded[index] = (vectors * values) @ vectors.T
        bounded[index] = 0.5 * (bounded[index] + bounded[index].T)
    return bounded


def _levels(policy: LevelPolicy, region: Region, obstacles: Obstacles, capacity: int) -> Array:
    """Level of every slot, (N, capacity): one per obstacle, the same for all of its modes."""
    names = list(dict.fromkeys(obstacles.ids))
    steps, _, size = obstacles.mean.shape
    level = policy.levels(region, steps, max(len(names), 1), size)
    owner = [names.index(name) for name in obstacles.ids]
    return level[:, owner + [0] * (capacity - len(owner))]
