"""Mixture density network from newest velocities to the modes of each obstacle's future.

The network sees velocities in the obstacle's own frame (x along its heading) and answers in that
frame, so that its answer turns and shifts with the world whatever its weights are.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, final

import numpy as np

from ...framework.values.arrays import Array, BoolArray, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast
from ...framework.values.tracks import Tracks
from .history import Histories, measurement_noise

MEMORY = 0.6
"""s, time constant of the weighted mean velocity d that gives the straight path and the heading.
On recorded people (8 + 12 samples of 0.4 s) the straight path along d alone has a mean error of
0.435 m, against 0.455 m along the last velocity and 0.494 m along the plain mean."""
STANDING = 0.02
"""Speed, in units of the network's scale, at which half of the heading is believed."""
POWERS = 3
"""Powers of time in a mode's path and in its variance: s, s^2, s^3."""
FEATURES = 2
"""Inputs besides the velocities: log speed and log jitter."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of each obstacle's future, in continuous time.

    In mode k the obstacle moves by d t + sum_b path_b s^b with s = t / horizon; after the
    horizon the mode's last velocity is held. The error about it is the sum of three
    independent processes, which are a random walk, an unknown constant velocity, and a
    velocity under white acceleration:

        Cov(p(s), p(u)) = min(s, u) growth_1 + s u growth_2 + (3 max(s, u) - min(s, u))
        min(s, u)^2 / 2 growth_3

    so that the covariance at s is s growth_1 + s^2 growth_2 + s^3 growth_3: PSD and growing.

    Attributes
    ----------
    weight : (O, K).
    velocity : (O, 2), m/s, d, see `frames`.
    path : (O, K, 3, 2), m.
    growth : (O, K, 3, 2, 2), m^2, PSD.
    horizon : s.
    """

    weight: Array
    velocity: Array
    path: Array
    growth: Array
    horizon: float

    def displacements(self, times: Array) -> Array:
        """Mean displacement of each mode at times (O, N), s; (O, K, N, 2), m."""
        share = times / self.horizon
        past = np.maximum(share - 1.0, 0.0)[..., None] * np.arange(1.0, POWERS + 1.0)
        bend = _each_mode(cubic(np, np.minimum(share, 1.0)) + past, self.path)
        return np.asarray(bend + times[:, None, :, None] * self.velocity[:, None, None])

    def covariances(self, times: Array) -> Array:
        """Covariance of each mode's position at times (O, N); (O, K, N, 2, 2), m^2."""
        flat = _each_mode(cubic(np, times / self.horizon), self.growth)
        return flat.reshape(*flat.shape[:3], 2, 2)

    def joint(self, times: Array) -> Array:
        """Joint covariance over times (O, N) for each mode, (O, K, N*2, N*2), m^2."""
        share = times / self.horizon
        less = np.minimum(share[:, :, None], share[:, None])
        more = np.maximum(share[:, :, None], share[:, None])
        kernels = np.stack([less, less * more, 0.5 * (3 * more - less) * less**2], axis=1)
        joint = np.einsum("opnm,okpij->oknimj", kernels, self.growth, optimize=True)
        obstacles, modes, size = *self.weight.shape, 2 * times.shape[1]
        return np.asarray(joint.reshape(obstacles, modes, size, size))


def cubic(xp: Any, share: Any) -> Any:
    """Return s, s^2, s^3, (..., 3). ``xp`` is the array library: NumPy, or JAX in training."""
    return xp.stack([share, share**2, share**3], axis=-1)


def _each_mode(basis: Array, weight: Array) -> Array:
    """Sum (O, N, 3) times (O, K, 3, ...) over the powers: (O, K, N, ...), the rest flattened.

    One product per obstacle: thousands of smaller ones cost more than all their numbers.
    """
    obstacles, modes, powers = weight.shape[:3]
    size = int(np.prod(weight.shape[3:]))
    columns = weight.reshape(obstacles, modes, powers, size).swapaxes(1, 2)
    product = basis @ columns.reshape(obstacles, powers, modes * size)
    return product.reshape(obstacles, basis.shape[1], modes, size).swapaxes(1, 2)


@dataclass(frozen=True, eq=False)
class Frames:
    """Coordinate frame of each obstacle.

    Attributes
    ----------
    velocity : (O, 2), m/s, weighted mean of the newest velocities; its direction is the heading.
    turn : (O, 2, 2), takes vectors of the world into the frame.
    certain : (O,), trust in the heading, from 0 (standing) to 1. What is said in the frame
        is blended with what has no direction, so that nothing jumps when an obstacle stops.
    """

    velocity: Array
    turn: Array
    certain: Array


def frames(velocities: Array, known: BoolArray, dt: float, standing: float) -> Frames:
    """Align each obstacle's frame with the weighted mean of its velocities.

    d = sum_j w_j v_j,  w_j ~ exp(-age_j / MEMORY),  certain = |d|^2 / (|d|^2 + standing^2)

    Parameters
    ----------
    velocities : (O, T, 2), m/s, oldest first.
    known : (O, T), velocities that count.
    dt : s. standing : m/s.
    """
    age = dt * np.arange(velocities.shape[1])[::-1]
    weight = np.where(known, np.exp(-age / MEMORY), 0.0)
    weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    mean = np.einsum("ot,otd->od", weight, velocities)
    speed = np.linalg.norm(mean, axis=1)
    ahead = np.where(speed[:, None] > 0, mean, [1.0, 0.0])
    ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    certain = speed**2 / (speed**2 + standing**2)
    return Frames(mean, np.stack([ahead, aside], axis=1), certain)


def features(velocities: Array, own: Frames, scale: float) -> Array:
    """Return the network's inputs for each obstacle, (O, 2 T + 2).

    Velocities in the own frame in units of ``scale``, oldest first; then the logarithms of the
    speed and of the root mean square of the velocity's steps, both blunted near 0.
    """
    turned = velocities @ own.turn.swapaxes(1, 2) * np.sqrt(own.certain)[:, None, None]
    steps = np.diff(velocities, axis=1)
    jitter = np.sqrt((steps**2).sum(axis=2).mean(axis=1))
    speed = np.linalg.norm(own.velocity, axis=1)
    logs = np.log(np.stack([speed, jitter], axis=1) / scale + STANDING)
    flat = turned.reshape(len(velocities), 2 * velocities.shape[1])
    return np.concatenate([flat / scale, logs], axis=1)


def forward(xp: Any, layers: Any, inputs: Any) -> Any:
    """Return the outputs of a perceptron with tanh layers and a linear last one, (O, outputs).

    Layers are pairs of weight and bias.
    """
    for weight, bias in layers[:-1]:
        inputs = xp.tanh(inputs @ weight + bias)
    weight, bias = layers[-1]
    return inputs @ weight + bias


def output_count(modes: int) -> int:
    """Return the number of outputs of the network: per mode a weight, a path and a growth."""
    return modes * (1 + 5 * POWERS)


def decode(xp: Any, raw: Any, certain: Any, modes: int, length: float) -> tuple[Any, Any, Any]:
    """Turn the network's outputs into modes in each obstacle's frame.

    Each growth matrix is G G' with G = [[a, 0], [b c, b]] of bounded entries, so that it is PSD
    and an input far from all training data gives a finite forecast. Without a certain heading
    the path shrinks to 0 and the growth turns into a circle of the same trace.

    Parameters
    ----------
    raw : (O, outputs). certain : (O,), see `Frames`.
    length : m, scale times horizon.

    Returns
    -------
    Logarithms of the weights (O, K); path (O, K, 3, 2), m; growth (O, K, 3, 2, 2), m^2.
    """
    count, bends = len(raw), 2 * POWERS * modes
    scores = raw[:, :modes] - raw[:, :modes].max(axis=1, keepdims=True)
    weight = scores - xp.log(xp.exp(scores).sum(axis=1, keepdims=True))
    path = length * raw[:, modes : modes + bends].reshape(count, modes, POWERS, 2)
    path = path * xp.sqrt(certain)[:, None, None, None]
    bounded = 5.0 * xp.tanh(0.2 * raw[:, modes + bends :])
    entries = bounded.reshape(count, modes, POWERS, 3)
    first, second = length * xp.exp(entries[..., 0] - 2), length * xp.exp(entries[..., 1] - 2)
    cross = first * second * entries[..., 2]
    last = second**2 * (1 + entries[..., 2] ** 2)
    growth = xp.stack([first**2, cross, cross, last], axis=-1).reshape(*entries.shape[:3], 2, 2)
    circle = 0.5 * (first**2 + last)[..., None, None] * xp.eye(2)
    trust = certain[:, None, None, None, None]
    return weight, path, trust * growth + (1 - trust) * circle


@final
@dataclass(frozen=True)
class Layer:
    """One layer, y = x W + b.

    Attributes
    ----------
    weight : (inputs, outputs).
    bias : (outputs,).
    """

    weight: tuple[tuple[float, ...], ...]
    bias: tuple[float, ...]


@final
@dataclass(frozen=True)
class DensityNetwork:
    """A trained network as plain numbers, so that a config can contain it.

    Attributes
    ----------
    dt : s between the positions that it sees.
    observed : how many positions it sees.
    horizon : s, how far it was trained to look ahead.
    scale : m/s, the unit of speed.
    modes : K.
    centre, width : of each input; the network sees (input - centre) / width.
    layers : see `Layer`.

    Raises
    ------
    WideberthError : sizes that do not fit together.
    """

    dt: float
    observed: int
    horizon: float
    scale: float
    modes: int
    centre: tuple[float, ...]
    width: tuple[float, ...]
    layers: tuple[Layer, ...]

    def __post_init__(self) -> None:
        for name in ("dt", "horizon", "scale"):
            positive(f"density_network.{name}", getattr(self, name))
        whole("density_network.observed", self.observed, least=3)
        whole("density_network.modes", self.modes)
        inputs = 2 * (self.observed - 1) + FEATURES
        sizes = [inputs, *(len(layer.bias) for layer in self.layers)]
        fits = bool(self.layers) and sizes[-1] == output_count(self.modes)
        for layer, (before, after) in zip(self.layers, pairwise(sizes), strict=True):
            fits = fits and len(layer.weight) == before
            fits = fits and all(len(row) == after for row in layer.weight)
        if not (fits and len(self.centre) == len(self.width) == inputs):
            raise WideberthError(
                f"density_network has layers of {sizes} numbers; wanted {inputs} inputs for "
                f"{self.observed} positions, {output_count(self.modes)} outputs for {self.modes} "
                "modes, and rows, centre and width of the same lengths: fit it again"
            )

    @cached_property
    def arrays(self) -> list[tuple[Array, Array]]:
        """Layers as arrays; the first one includes the inputs' centre and width."""
        layers = [(np.array(layer.weight), np.array(layer.bias)) for layer in self.layers]
        weight, bias = layers[0]
        weight = weight / np.array(self.width)[:, None]
        layers[0] = (weight, bias - np.array(self.centre) @ weight)
        return layers

    def foresee(self, positions: Array) -> Modes:
        """Return the modes of obstacles from their newest positions, (O, observed, 2), m."""
        velocities = np.diff(positions, axis=1) / self.dt
        known = np.ones(velocities.shape[:2], dtype=np.bool_)
        own = frames(velocities, known, self.dt, STANDING * self.scale)
        raw = forward(np, self.arrays, features(velocities, own, self.scale))
        length = self.scale * self.horizon
        decoded = decode(np, raw, own.certain, self.modes, length)
        return in_world(*decoded, own, self.horizon)


def in_world(scores: Array, path: Array, growth: Array, own: Frames, horizon: float) -> Modes:
    """Turn decoded modes, see `decode`, from each obstacle's frame into the world."""
    count, modes = scores.shape
    both = np.einsum("oia,ojb->oijab", own.turn, own.turn).reshape(count, 4, 4)
    growth = (growth.reshape(count, modes * POWERS, 4) @ both).reshape(growth.shape)
    share = np.exp(scores)
    share = share / share.sum(axis=1, keepdims=True)
    return Modes(share, own.velocity, path @ own.turn[:, None], growth, horizon)


def rows_that_span(observed: int, own: float, dt: float) -> int:
    """Count the samples of ``dt`` s that span ``observed`` samples of ``own`` s."""
    return int(np.ceil((observed - 1) * own / dt - 1e-9)) + 1


def resampled(positions: Array, dt: float, wanted: float, count: int) -> Array:
    """Read histories, (O, T, D), ``count`` times at steps of ``wanted`` s up to the newest."""
    rows = positions.shape[1]
    place = rows - 1 - wanted / dt * np.arange(count - 1.0, -1.0, -1.0)
    place = np.clip(
        np.where(np.abs(place - np.rint(place)) < 1e-9, np.rint(place), place), 0, None
    )
    below = np.minimum(place.astype(np.int64), max(rows - 2, 0))
    share = (place - below)[:, None]
    after = np.minimum(below + 1, rows - 1)
    return np.asarray((1 - share) * positions[:, below] + share * positions[:, after])


def forecast_of(
    seen: Modes, past: Histories, tracks: Tracks, steps: int, noise_floor: float
) -> Forecast:
    """Return the forecast of modes that begin at each obstacle's newest sample.

    The measurement noise and ``noise_floor`` (m, in quadrature) are added to all covariances.
    """
    times = tracks.dt * (past.late[:, None] + np.arange(1.0, steps + 1))
    noise = measurement_noise(tracks, noise_floor)
    return Forecast(
        past.origin[:, None, None] + seen.displacements(times),
        seen.covariances(times) + noise[:, None, None],
        seen.weight,
        tracks.dt,
        (None,) * len(tracks),
        partial(_joint, seen, times, noise),
    )


def _joint(seen: Modes, times: Array, noise: Array) -> Array:
    """Joint covariance of modes and of the measured position that all steps start from."""
    steps = times.shape[1]
    return seen.joint(times) + np.tile(noise, (1, steps, steps))[:, None]
