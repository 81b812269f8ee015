"""A social-force roll-out of all obstacles and the robot's own plan."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, final

import numpy as np

from ..framework.predictor import Predictor
from ..framework.values.arrays import Array, positive
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import both_reasons
from .core.social_rollout import Force, SocialWalkers, course_of, roll_out
from .kalman import Kalman

GRID = np.sqrt(3.0) * np.array([(a, b) for a in (0, 1, -1) for b in (0, 1, -1)], dtype=np.float64)
"""(9, 2), in standard deviations of speed and direction; the first is the expected one."""
WEIGHTS = np.prod(np.where(GRID == 0, 2.0 / 3.0, 1.0 / 6.0), axis=1)
"""(9,) of the three-point Gauss-Hermite rule in both: exact up to the fifth moment."""


@final
@dataclass(frozen=True)
class SocialForce(Predictor):
    """All obstacles walk towards their goals and step aside for one another and the robot.

    dv_i/dt = (u_i - v_i) / tau + sum over j of f_ij,    dp_i/dt = v_i

    with u_i the velocity that obstacle i wants (its own, as estimated; where ``scene.goals``
    has a goal, as fast towards that) and f_ij the force of neighbour j, see
    `wideberth.predictors.core.social_rollout.Force`. The robot is a neighbour that follows its
    current plan (``scene.plan``), straight on beyond its end; the others cannot move it. It
    is not seen where no plan is given.

    Spread: each obstacle is rolled out with nine wanted velocities (three speeds times three
    directions, quadrature points in its own frame, which turn with the world), each time among
    the others' expected motions. Mean and covariance are those of the weighted nine; added to
    it is the covariance of ``estimate``, for the error of position and velocity and for what
    happens without any reason. How an encounter bends that second part is left out.

    An obstacle that meets no other goes straight on. With three coordinates the forecast is that
    of ``estimate``, with the reason; so it is for an obstacle of which nothing is known.

    Parameters
    ----------
    force : between two bodies.
    relaxation : tau, s, in which a velocity comes back to the wanted one.
    speed_spread : standard deviation of the wanted speed, as a share of it.
    direction_spread : rad, standard deviation of the wanted direction.
    estimate : filter that estimates position, velocity and their covariance.

    Raises
    ------
    WideberthError : a number out of range.

    References
    ----------
    Helbing and Molnar, "Social force model for pedestrian dynamics", Phys. Rev. E 1995.
    """

    force: Force = field(default_factory=Force)
    relaxation: float = 0.5
    speed_spread: float = 0.1
    direction_spread: float = 0.1
    estimate: Kalman = field(default_factory=Kalman)

    reference: ClassVar[str] = "helbing1995social"

    def __post_init__(self) -> None:
        positive("social_force.relaxation", self.relaxation)
        for name in ("speed_spread", "direction_spread"):
            positive(f"social_force.{name}", getattr(self, name), zero=True)

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        if tracks.dimension != 2:
            reason = f"social_force: {tracks.dimension} coordinates, made for 2"
            forecast = self.estimate.predict(tracks, steps, scene)
            said = tuple(both_reasons(reason, deeper) for deeper in forecast.fallback)
            return replace(forecast, fallback=said)
        ahead = self.estimate.predict(tracks, max(steps, 2), scene)
        walkers = _walkers(tracks, ahead, scene)
        factors = GRID * (self.speed_spread, self.direction_spread)
        robot = course_of(scene, tracks.dt, tracks.stamp)
        courses = roll_out(walkers, robot, self.force, self.relaxation, factors, tracks.dt, steps)
        mean = np.einsum("k,kond->ond", WEIGHTS, courses)
        apart = np.sqrt(WEIGHTS)[:, None, None, None] * (courses - mean)
        covariance = np.einsum("koni,konj->onij", apart, apart) + ahead.covariance[:, 0, :steps]
        joint = partial(_joint, ahead, apart)
        return Forecast.single(mean, covariance, tracks.dt, ahead.fallback, joint)


def _walkers(tracks: Tracks, ahead: Forecast, scene: Scene | None) -> SocialWalkers:
    """Where all people are now, and where to: an estimate goes straight on."""
    first, second = ahead.mean[:, 0, 0], ahead.mean[:, 0, 1]
    velocity = (second - first) / tracks.dt
    seen = np.asarray(np.isfinite(tracks.positions).all(axis=2), dtype=np.bool_)
    known = np.asarray(seen.any(axis=1), dtype=np.bool_)
    goals = None if scene is None else scene.goals
    return SocialWalkers(first - tracks.dt * velocity, velocity, tracks.radius, known, goals)


def _joint(ahead: Forecast, apart: Array) -> Array:
    """Joint covariance (O, 1, N*D, N*D), of the wanted velocities and of the estimate."""
    hypotheses, obstacles, steps, size = apart.shape
    flat = apart.reshape(hypotheses, obstacles, steps * size)
    known = ahead.joint
    assert known is not None
    wanted = np.einsum("koi,koj->oij", flat, flat)
    return np.asarray(known[:, :, : steps * size, : steps * size] + wanted[:, None])
