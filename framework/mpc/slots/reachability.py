"""Leaves out discs that no plan can meet, which changes no plan.

**Statement.** Let p_0 be the place of the robot now, T_i a bound on how far it is from p_0 at
step i of any plan that keeps dynamics and limits (`Travel`), b how far its bodies reach from its
position, and R_i a radius around the mean mu_i of a disc within which its region lies at the
level aimed at (`Bounded.outer_radius`), at least the radii of both bodies. If

    |mu_i - p_0| > T_i + sqrt(D) b + R_i        at every step i = 1..N,

the problem without this disc has the same optima, local ones too, as the problem with it.

**Proof.** At step i of a plan that keeps dynamics and limits every place of the bodies, and of
the boxes around them, is at most T_i + sqrt(D) b from p_0, so more than R_i from mu_i: outside
the region, by a distance that does not depend on the plan. So the constraint of the disc holds
with room to spare at every point that keeps the others, with some auxiliary of its own and
without slack. The sets of trajectories, levels s <= s_ref, slacks and other auxiliaries that are
feasible are the same, and so is the cost. What is left are levels s > s_ref, where the level is
a decision variable. No optimum has one: regions grow with the level, so that lowering s to s_ref
keeps every constraint, and saves w (s - s_ref)^2. QED.

**What it rests on.** (1) Regions grow with the level from 0 on: where a shared level may be
negative or costs nothing, and where a level aimed at is negative, nothing is left out. (2) The
robot has a largest speed (`SpeedLimited`) and the region an outer radius (`Bounded`), with the
laws that `check_robot` and `check_region` hold them against; without either, nothing is left
out. Limits of acceleration are not used: they would take at most v^2 / (2 a) off T. (3) Solvers
and re-check keep constraints to a tolerance, for which T has room. (4) Where a region has
auxiliaries, the cost has a term that draws each to its guess, 1e-6 to 1e-5 times the squared
distance; it goes with the disc. It is 0 at the optimum wherever the guess suffices, so that a
plan is the same but for that.

An interior point method sees constraints that are far from active too, so that iterates differ
in their last digits, and in principle may lead to another local optimum.

A disc near which the reference passes is kept even where the robot cannot follow it: from such
discs the planner concludes that something is in the way, see `planner.multistart`.
"""

from dataclasses import dataclass
from functools import cached_property
from math import hypot, inf, sqrt
from typing import final

import numpy as np

from ...region import Bounded
from ...robot import Robot, SpeedLimited
from ...values.arrays import Array, BoolArray
from ...values.plan import TOLERANCE
from ..levels.base import LevelPolicy, SharedLevel

SURPLUS = 1e-3
"""By how much an outer radius is enlarged, in m and relative: the regions' own roundings."""


@final
@dataclass(frozen=True)
class Travel:
    """How far a robot can get.

    Attributes
    ----------
    robot : whom.
    steps, dt : N and s.
    speed : its largest, m/s; infinite where it is not known.
    """

    robot: Robot
    steps: int
    dt: float
    speed: float

    @classmethod
    def of(cls, robot: Robot, steps: int, dt: float) -> "Travel":
        """Look the largest speed up."""
        return cls(robot, steps, dt, robot.max_speed if isinstance(robot, SpeedLimited) else inf)

    def bounds(self, start: Array) -> Array:
        """Distance from where it starts at which it can be at steps 1..N, at most, (N,), m.

        In a step from speed v to speed w, which both keep the limit but for the first, it gets
        no farther than dt max(v, w). A tolerance of squares is sqrt(`TOLERANCE`) in the speed.
        """
        still = (0.0,) * len(self.robot.inputs)
        now = hypot(*self.robot.twist(tuple(start.tolist()), still).linear)
        return self.dt * max(now - self.speed, 0.0) + self._from_limit

    @cached_property
    def _from_limit(self) -> Array:
        """Return `bounds` of a robot that starts no faster than its limit, (N,), m."""
        each = self.dt * (self.speed + 2.0 * sqrt(TOLERANCE)) + TOLERANCE
        return each * np.arange(1, self.steps + 1, dtype=np.float64)


def leaves_out(policy: LevelPolicy) -> bool:
    """Whether levels of a policy let anything be left out, see (1) above."""
    return not isinstance(policy, SharedLevel) or (policy.minimum >= 0.0 and policy.weight > 0.0)


def out_of_reach(
    region: Bounded,
    mean: Array,
    covariance: Array,
    margin: Array,
    level: Array,
    places: Array,
    allowed: Array,
) -> BoolArray:
    """Which discs neither the robot nor its reference can meet, (O,).

    Parameters
    ----------
    region : of every disc.
    mean, covariance : (N, O, D), m, and (N, O, D, D), m^2, as the problem holds them.
    margin : (O,), m, radii of both bodies and what is added.
    level : (N, O), aimed at.
    places : (R, N, D), m.
    allowed : (R, N), m, how far from each of the places bodies can be.
    """
    apart = lengths(mean - places[:, :, None])
    room = (apart - allowed[:, :, None]).min(axis=0)
    far: BoolArray = (room > margin).all(axis=0) & (level >= 0.0).all(axis=0)
    distant = far.nonzero()[0]
    if distant.size:
        with np.errstate(all="ignore"):  # a radius that is no number leaves nothing out
            level, wide = level.take(distant, axis=1), margin[distant]
            deviations = _deviations(covariance.take(distant, axis=1))
            radius = region.outer_radius(deviations, np.broadcast_to(wide, level.shape), level)
            radius = np.maximum(radius, wide) * (1.0 + SURPLUS) + SURPLUS
            far[distant] = (room.take(distant, axis=1) > radius).all(axis=0)
    return far


def _deviations(covariance: Array) -> Array:
    """Square roots of the eigenvalues, from large to small, (..., D)."""
    if covariance.shape[-1] != 2:
        values = np.linalg.eigvalsh(covariance)[..., ::-1]
    else:
        a, b, c = covariance[..., 0, 0], covariance[..., 1, 0], covariance[..., 1, 1]
        apart, values = np.hypot(a - c, 2.0 * b), np.empty((*a.shape, 2))
        values[..., 0], values[..., 1] = a + c + apart, a + c - apart
        values *= 0.5
    return np.asarray(np.sqrt(np.maximum(values, 0.0)))


def lengths(vectors: Array) -> Array:
    """Lengths of vectors (..., D); NumPy is slow over an axis this short."""
    squares = vectors * vectors
    total = squares[..., 0]
    for axis in range(1, vectors.shape[-1]):
        total = total + squares[..., axis]
    return np.asarray(np.sqrt(total))
