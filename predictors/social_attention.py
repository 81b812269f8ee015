"""A small network that attends to each person's neighbours and to the robot's plan."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import ClassVar, Self, final

import numpy as np

from ..framework.plugins.config import load_plugin
from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import BoolArray, positive, whole
from ..framework.values.errors import WideberthError
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import both_reasons, refuse_adaptive, with_fallback
from .core.density_network import STANDING, forecast_of, frames, resampled, rows_that_span
from .core.history import Histories, gather, too_short
from .core.social_network import AHEAD, People, SocialNetwork
from .core.social_rollout import course_of
from .kalman import Kalman

SHIPPED = "social_attention.json"
"""The network beside this file, trained on simulated people."""


@final
@dataclass(frozen=True)
class SocialAttention(Fittable):
    """A small network forecasts each person from his way, the others and the robot's plan.

    a_hj = seen_j exp(s_h(x_j)),   y_h = sum_j a_hj v_h(x_j) / (1 + sum_j a_hj)
    mu(t), Sigma(t) = network(own velocities, y, log(1 + sum_j a_hj))

    x_j describes neighbour j: where he will be now and 1, 2 and 3 s from now if all walk straight
    on, how close that is, how he moves, and whether he is the robot, which follows its plan
    (``scene.plan``). Four heads h attend to the neighbours; sums make their order irrelevant, and
    the number of neighbours free. All is told in the person's own frame, see
    `wideberth.predictors.core.social_network`. The forecast is one Gaussian, whose mean is the
    straight line plus a cubic in time and whose covariance grows from 0, see
    `wideberth.predictors.core.density_network.Modes`; the measurement noise is added. With all
    weights 0 the mean is constant velocity.

    The idea, attention over the others, is that of Vemula et al.; the network is not theirs: it
    has no memory and sees a person's last positions instead, and it says a whole Gaussian path.

    Not fitted, it uses the network shipped with the package. That was trained on simulated people
    alone, who walk between drawn goals in a square (`random_crowd`), and it expects such turns. On
    recorded people, who walk through a place, its error is up to twice that of `kalman`: `fit` it
    to recordings of the place. Errors on both are in docs/people.md. It is blind to walls.

    `fit` trains it with JAX; a forecast needs NumPy alone. Scenes of another dt are brought to
    ``dt`` by straight lines between samples, in `fit` and in forecasts. In scenes to learn from,
    the track called ``robot`` is the robot: its recorded way is told as its plan.

    Parameters
    ----------
    dt : s, between the positions that a network to be trained sees.
    observed : how many of them. Shorter histories go to ``fallback``, and so do those of which
        more than half was filled in, and everything in three dimensions.
    predicted : steps that it is trained to look ahead; beyond them the last velocity is held.
    rounds : of training, of 50 updates.
    seed : of the training.
    robot : identity of the robot in scenes to learn from.
    most : nearest others of a person that count, so that work is bounded; the robot is one more.
    noise_floor : m, added in quadrature to the measurement noise.
    fallback : predictor for those who cannot be served.
    fitted : the trained network, as `fit` leaves it; None for the shipped one.

    Raises
    ------
    WideberthError : a number out of range, or a fallback that adapts.

    References
    ----------
    A. Vemula, K. Muelling, J. Oh, "Social Attention: Modeling Attention in Human Crowds", ICRA
    2018.
    """

    dt: float = 0.2
    observed: int = 15
    predicted: int = 24
    rounds: int = 120
    seed: int = 0
    robot: str = "robot"
    most: int = 16
    noise_floor: float = 0.01
    fallback: Predictor = field(default_factory=Kalman)
    fitted: SocialNetwork | None = None

    reference: ClassVar[str] = "vemula2018social"

    def __post_init__(self) -> None:
        refuse_adaptive("social_attention.fallback", self.fallback)
        for name in ("dt", "noise_floor"):
            positive(f"social_attention.{name}", getattr(self, name))
        whole("social_attention.observed", self.observed, least=3)
        for name in ("predicted", "rounds", "most"):
            whole(f"social_attention.{name}", getattr(self, name))
        whole("social_attention.seed", self.seed, least=0)

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Train the network on scenes; see `Fittable.fit`.

        Raises
        ------
        WideberthError : other than two coordinates, or fewer than 100 windows of
            ``observed + predicted`` samples of ``dt`` s.
        """
        from .core.social_training import material_of, train

        if any(scene.dimension != 2 for scene in dataset):
            raise WideberthError("social_attention.fit: a scene has 3 coordinates; wanted 2")
        scenes = [on_step(scene, self.dt) for scene in dataset]
        data = material_of(scenes, self.observed, self.predicted, self.robot, "social_attention")
        return replace(self, fitted=train(data, rounds=self.rounds, seed=self.seed))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        if tracks.dimension != 2:
            reason = f"social_attention: {tracks.dimension} coordinates, made for 2"
            forecast = self.fallback.predict(tracks, steps, scene)
            said = tuple(both_reasons(reason, deeper) for deeper in forecast.fallback)
            return replace(forecast, fallback=said)
        network = shipped() if self.fitted is None else self.fitted
        needed = rows_that_span(network.observed, network.dt, tracks.dt)
        past = gather(tracks, length=needed)
        missing = too_short(past, needed, "social_attention")
        positions = resampled(past.positions, tracks.dt, network.dt, network.observed)
        velocities = np.diff(positions, axis=1) / network.dt
        walked = _walked(past, tracks.dt, network)
        own = frames(velocities, walked, network.dt, STANDING * network.scale)
        here = past.origin + (tracks.dt * past.late)[:, None] * own.velocity
        bend = velocities[:, -1] - own.velocity
        courses = here[:, None] + np.array(AHEAD)[:, None] * own.velocity[:, None]
        seen = past.length >= 2
        everybody = People(courses, own.velocity, bend, tracks.radius, np.zeros(len(tracks)))
        others = _company(everybody, seen, _robot(scene, tracks), self.most)
        modes = network.foresee(velocities, own, everybody, others)
        forecast = forecast_of(modes, past, tracks, steps, self.noise_floor)
        return with_fallback(forecast, missing, self.fallback, tracks, scene)


@cache
def shipped() -> SocialNetwork:
    """Return the network that was trained on simulated people."""
    saved = load_plugin(Path(__file__).with_name(SHIPPED), "predictor")
    assert isinstance(saved, SocialAttention) and saved.fitted is not None
    return saved.fitted


def _walked(past: Histories, dt: float, network: SocialNetwork) -> BoolArray:
    """Which velocities on the network's grid lie within each history, (O, observed - 1)."""
    rows = past.positions.shape[1]
    place = rows - 1 - network.dt / dt * np.arange(network.observed - 1.0, 0.0, -1.0)
    return np.asarray(place >= past.began[:, None] - 1e-9, dtype=np.bool_)


def _robot(scene: Scene | None, tracks: Tracks) -> People | None:
    """Return the robot on its plan; None without one."""
    course = course_of(scene, tracks.dt, tracks.stamp)
    if course is None:
        return None
    places, _ = course.at(np.array(AHEAD))
    _, velocity = course.at(np.zeros(1))
    return People(places[None], velocity, np.zeros((1, 2)), np.array([course.radius]), np.ones(1))


def _company(people: People, seen: BoolArray, robot: People | None, most: int) -> People:
    """Return the nearest others of each, (O, M), the robot among them; NaN for nobody."""
    count = len(seen)
    apart = people.courses[:, None, 0] - people.courses[None, :, 0]
    away = (apart**2).sum(axis=2)
    away[np.arange(count), np.arange(count)] = np.inf
    away = np.where(seen, away, np.inf)
    if count > most:
        order = np.argpartition(away, most - 1, axis=1)[:, :most]
    else:
        order = np.tile(np.arange(count), (count, 1))
    courses = people.courses[order]
    nobody = ~np.isfinite(np.take_along_axis(away, order, axis=1))
    courses = np.where(nobody[..., None, None], np.nan, courses)
    parts = [courses, *(value[order] for name, value in vars(people).items() if name != "courses")]
    if robot is not None:
        alone = (np.broadcast_to(one, (count, *one.shape)) for one in vars(robot).values())
        parts = [np.concatenate(pair, axis=1) for pair in zip(parts, alone, strict=True)]
    return People(*parts)


def on_step(scene: Tracks, dt: float) -> Tracks:
    """Return a recording on another grid, by straight lines between successive samples."""
    if abs(scene.dt - dt) < 1e-9 * dt:
        return scene
    old = scene.positions.shape[1]
    count = int(np.floor((old - 1) * scene.dt / dt + 1e-9)) + 1
    place = np.arange(count) * dt / scene.dt
    near = np.rint(place)
    place = np.where(np.abs(place - near) < 1e-9, near, place)
    below = np.minimum(place.astype(np.int64), max(old - 2, 0))
    after = np.minimum(below + 1, old - 1)
    share = (place - below)[:, None]
    first, second = scene.positions[:, below], scene.positions[:, after]
    between = np.where(share == 0.0, first, (1 - share) * first + share * second)
    return replace(scene, positions=between, dt=dt, state_covariance=None, velocity=None)
