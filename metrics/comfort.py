"""Comfort metrics: distances to others and the social forces on them. Plain arrays.

Distances are between surfaces (centres less both radii) unless a name says centre. Others are
all who move, be they people, recorded or robots; polygons do not count. Arrays over O others
and K instants are (O, K), NaN where one is absent.
"""

import numpy as np

from ..framework.values.arrays import Array
from .motion import velocities
from .social_force import interaction_force

ZONES = {"intimate": 0.45, "personal": 1.2, "social": 3.6, "public": np.inf}
"""Upper ends of the proxemic zones, m, between surfaces (Hall; the limits are HuNavSim's)."""
COMFORT = 0.2
"""m between surfaces, below which the robot intrudes (CrowdNav's discomfort distance)."""
TOUCH = 0.01
"""m between surfaces, below which two are in contact (HuNavSim)."""
SOCIAL = 5.1
"""m/s^2, factor of the social force (PySocialForce)."""


def nearest(distances: Array) -> Array:
    """Distance to the nearest of the others at each instant, (O, K) -> (K,), m; inf if alone."""
    known = np.where(np.isnan(distances), np.inf, distances)
    return np.asarray(known.min(axis=0, initial=np.inf))


def mean_distance(closest: Array) -> float:
    """Mean of the `nearest` distance over the instants with others present, m."""
    there = closest[np.isfinite(closest)]
    return float(there.mean()) if there.size else float("nan")


def proxemics(closest: Array) -> dict[str, float]:
    """Share of time that the nearest one is in each zone, see `ZONES`; they sum to 1.

    A zone holds its lower end; an instant without others counts as public.
    """
    zone = np.searchsorted(list(ZONES.values())[:-1], closest, side="right")
    counts = np.bincount(zone, minlength=len(ZONES)) / max(len(closest), 1)
    return dict(zip(ZONES, map(float, counts), strict=True))


def intrusion(closest: Array, comfort: float = COMFORT) -> tuple[float, float]:
    """Share of time nearer than ``comfort`` m, and its mean depth (comfort - distance), m.

    The depth is NaN where none ever comes that near.
    """
    depth = comfort - closest[closest < comfort]
    share = depth.size / max(closest.size, 1)
    return share, float(depth.mean()) if depth.size else float("nan")


def time_to_collision(towards: Array, approach: Array, radii: Array) -> Array:
    """Seconds until two discs touch if both keep their velocity, (...).

    The smaller root of |p - w t| = R, 0 where they overlap, inf where they never touch; NaN
    where an entry is.

    Parameters
    ----------
    towards : p, (..., D), m, centre of the other minus the own.
    approach : w, (..., D), m/s, own velocity minus the other's.
    radii : R, (...), m, sum of both radii.

    Examples
    --------
    >>> float(time_to_collision(np.array([5.0, 0.0]), np.array([2.0, 0.0]), np.array(1.0)))
    2.0
    """
    gap = np.sum(towards**2, axis=-1) - np.square(radii)
    closing = np.sum(towards * approach, axis=-1)
    square = np.sum(approach**2, axis=-1)
    root = closing**2 - square * gap
    hits = (closing > 0.0) & (root >= 0.0)
    # gap / (b + sqrt) instead of (b - sqrt) / a: no digits are lost where they nearly touch.
    below = np.where(hits, closing + np.sqrt(np.maximum(root, 0.0)), 1.0)
    found = np.where(hits, gap / below, np.inf)
    return np.asarray(np.where(np.isnan(gap + root), np.nan, np.where(gap < 0.0, 0.0, found)))


def contacts(first: Array, second: Array, gaps: Array, reach: float = TOUCH) -> tuple[int, int]:
    """How often the first ran into the second, and the second into the first.

    A contact begins in an interval in which the surfaces come nearer than ``reach`` m after they
    were further apart (or absent, or at the start). Who closes in faster, by the velocity along
    the line between the centres at the interval's beginning, ran into the other; of two equally
    fast ones both did.

    Parameters
    ----------
    first, second : (T, D), m, centres.
    gaps : (T - 1,), m, smallest distance of the surfaces in each interval.
    """
    touching = np.asarray(gaps < reach)
    begins = np.flatnonzero(touching & ~np.concatenate([[False], touching[:-1]]))
    towards = (second - first)[begins]
    one = np.sum((first[begins + 1] - first[begins]) * towards, axis=1)
    two = -np.sum((second[begins + 1] - second[begins]) * towards, axis=1)
    equal = np.isclose(one, two, rtol=1e-6, atol=1e-12)
    return int(np.sum((one > two) | equal)), int(np.sum((two > one) | equal))


def personal_space(towards: Array, moving: Array) -> Array:
    """Asymmetric Gaussian of a person's personal space at the robot's centre, (...), at most 1.

    With v the person's speed, sigma is max(2 v, 1/2) ahead, 2/3 of that aside and 1/2 behind
    (m; Kirby 2010, as SocNavBench has it); along the person's velocity and across::

        exp(-x^2 / (2 sigma_x^2) - y^2 / (2 sigma_y^2))

    Of a person who stands the shape is taken along the line to the robot, in front.

    Parameters
    ----------
    towards : (..., D), m, from the person's centre to the robot's.
    moving : (..., D), m/s, the person's velocity.
    """
    speed = np.linalg.norm(moving, axis=-1)
    distance = np.linalg.norm(towards, axis=-1)
    stands = speed < 1e-6
    along = np.sum(towards * moving, axis=-1) / np.where(stands, 1.0, speed)
    along = np.where(stands, distance, along)
    across = np.maximum(distance**2 - along**2, 0.0)
    ahead = np.maximum(2.0 * speed, 0.5)
    sigma = np.where(along >= 0.0, ahead, ahead / 2.0)
    return np.asarray(
        np.exp(-0.5 * (along / sigma) ** 2 - 0.5 * across / (2.0 * ahead / 3.0) ** 2)
    )


def social_work(robot: Array, others: Array, step: float) -> float:
    """Social work of robot and others in the plane, m/s (a force on a unit of mass over time).

    HuNavSim's W = W_r + sum_p W_p: the magnitude of the social force that all others together
    put on the robot, plus those of the forces that the robot puts on each, summed over time::

        W = sum_k step (|sum_p f_{p -> r}| + sum_p |f_{r -> p}|)

    The force is Moussaïd's with `SOCIAL` as factor; walls, goals and groups do not count.

    Parameters
    ----------
    robot : (K, 2), m.
    others : (O, K, 2), m, NaN where absent.
    """
    own = velocities(robot, step)
    theirs = np.diff(others, axis=1) / step
    towards, approach = (others - robot)[:, :-1], own - theirs
    on_robot = np.nan_to_num(interaction_force(towards, approach))
    on_others = np.nan_to_num(interaction_force(-towards, -approach))
    total = np.linalg.norm(on_robot.sum(axis=0), axis=-1).sum()
    total += np.linalg.norm(on_others, axis=-1).sum()
    return float(SOCIAL * step * total)
