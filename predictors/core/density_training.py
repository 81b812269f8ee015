"""Training of a mixture density network, in JAX."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from ...framework.values.arrays import Array, BoolArray
from ..data.windows import Windows
from . import adam
from .density_network import (
    POWERS,
    STANDING,
    DensityNetwork,
    Layer,
    cubic,
    decode,
    features,
    forward,
    frames,
    output_count,
)

HIDDEN = (48, 48)
"""Width of the tanh layers."""
HELD_OUT = 8
"""One window in so many is held out: the last tracks of each scene."""
BENT = 0.5
"""Distance aside between the outermost modes to begin with, in units of scale x horizon."""
FLOOR = 1e-2
"""Smallest standard deviation that the likelihood knows, in units of scale x one second."""
NOISE = (0.0025, 0.25)
"""Noise added to the observed positions of half of the windows, in units of scale x dt: the
network learns what velocities are worth whose differences are rough."""


def log_densities(xp: Any, residual: Any, path: Any, growth: Any, floor: float) -> Any:
    """Return the logarithm of each mode's Gaussian density at each step, (W, K, N).

    Parameters
    ----------
    residual : (W, N, 2), m, truth less the straight line, in the own frame; steps are equal
        and end at the horizon.
    path, growth : as `decode` returns them.
    floor : m, added in quadrature to the standard deviation.
    """
    steps = residual.shape[1]
    share = xp.arange(1, steps + 1) / steps
    basis = cubic(xp, share)
    error = residual[:, None] - basis @ path
    spread = basis @ growth.reshape(*growth.shape[:3], 4)
    first, second = spread[..., 0] + floor**2, spread[..., 3] + floor**2
    cross, x, y = spread[..., 1], error[..., 0], error[..., 1]
    determinant = first * second - cross**2
    square = (second * x**2 - 2 * cross * x * y + first * y**2) / determinant
    return -0.5 * square - 0.5 * xp.log(determinant) - np.log(2 * np.pi)


def loss(
    xp: Any, raw: Any, certain: Any, residual: Any, modes: int, length: float, floor: float
) -> Any:
    """Return the negative log likelihood of each window, (W,), nat per step.

    -log sum_k w_k prod_h N(x_h; mu_kh, Sigma_kh)^(1/N)

    A mode stands for a whole trajectory: its density is the geometric mean over the N steps,
    since errors of successive steps are far from independent (a product of all N would take
    one trajectory for N witnesses and make the weights overconfident). By Jensen's inequality
    it is never below the mean over steps of the mixture's marginal negative log likelihood, a
    proper score, and equal to it where all steps speak for the modes alike.
    """
    weight, path, growth = decode(xp, raw, certain, modes, length)
    total = weight + log_densities(xp, residual, path, growth, floor).mean(axis=2)
    top = total.max(axis=1, keepdims=True)
    return -(top[:, 0] + xp.log(xp.exp(total - top).sum(axis=1)))


@dataclass(frozen=True, eq=False)
class Examples:
    """Training examples: inputs, certainty of the heading, residual futures."""

    inputs: Array
    certain: Array
    residual: Array


@dataclass(frozen=True, eq=False)
class Material:
    """All windows of all scenes.

    Attributes
    ----------
    past : (W, observed, 2), m. future : (W, predicted, 2), m.
    share : (W,), probability of being drawn: each scene counts with the square root of its
        windows, so that one long recording does not drown the others.
    held : (W,), held out.
    dt : s. scale : m/s, root mean square speed.
    """

    past: Array
    future: Array
    share: Array
    held: BoolArray
    dt: float
    scale: float

    @classmethod
    def of(cls, scenes: Sequence[Windows]) -> "Material":
        """Collect the windows of all scenes; all have the same dt."""
        scenes = [scene for scene in scenes if len(scene)]
        past = np.concatenate([scene.tracks.positions for scene in scenes])
        future = np.concatenate([scene.future for scene in scenes])
        share = np.concatenate([np.full(len(scene), len(scene) ** -0.5) for scene in scenes])
        held = np.concatenate(
            [np.arange(len(scene)) >= len(scene) - -(-len(scene) // HELD_OUT) for scene in scenes]
        )
        dt = scenes[0].tracks.dt
        speed = float(np.sqrt((np.diff(past, axis=1) ** 2).sum(axis=2).mean())) / dt
        return cls(past, future, share / share.sum(), held, dt, max(speed, 1e-3))

    def examples(self, past: Array, future: Array) -> Examples:
        """Turn windows into the network's inputs and residual futures."""
        velocities = np.diff(past, axis=1) / self.dt
        known = np.ones(velocities.shape[:2], dtype=np.bool_)
        own = frames(velocities, known, self.dt, STANDING * self.scale)
        times = self.dt * np.arange(1, future.shape[1] + 1)[:, None]
        residual = future - past[:, -1:] - times * own.velocity[:, None]
        turned = residual @ own.turn.swapaxes(1, 2)
        return Examples(features(velocities, own, self.scale), own.certain, turned)

    def draw(self, rng: np.random.Generator, count: int) -> Examples:
        """Draw training windows; half of them with noise, half of them mirrored."""
        share = np.where(self.held, 0.0, self.share)
        chosen = rng.choice(len(share), size=count, p=share / share.sum())
        past, future = self.past[chosen], self.future[chosen]
        past = noisy(rng, past, self.scale * self.dt)
        mirror = np.where(rng.random(count) < 0.5, -1.0, 1.0)[:, None, None]
        flip = np.concatenate([np.ones_like(mirror), mirror], axis=2)
        return self.examples(past * flip, future * flip)


def noisy(rng: np.random.Generator, past: Array, unit: float) -> Array:
    """Add noise to the positions (W, T, 2), m, of half of the windows: `NOISE` x ``unit`` m."""
    low, high = np.log(np.array(NOISE) * unit)
    deviation = np.exp(rng.uniform(low, high, len(past))) * (rng.random(len(past)) < 0.5)
    return np.asarray(past + deviation[:, None, None] * rng.standard_normal(past.shape))


def train(scenes: Sequence[Windows], *, modes: int, rounds: int, seed: int) -> DensityNetwork:
    """Train a network on windows by Adam; the round with the lowest held-out loss is kept.

    Same windows and seed, same network.

    Parameters
    ----------
    scenes : windows of plane tracks, all of one dt, `observed` and `predicted`.
    modes : K. rounds : of `adam.UPDATES` updates each. seed : of all that is drawn.
    """
    rng = np.random.default_rng(seed)
    data = Material.of(scenes)
    ahead = data.future.shape[1]
    first = data.draw(rng, adam.UPDATES * adam.BATCH).inputs
    centre, width = first.mean(axis=0), first.std(axis=0) + 1e-3
    held = _scaled(data.examples(data.past[data.held], data.future[data.held]), centre, width)
    worth = data.share[data.held] / data.share[data.held].sum()
    sizes = np.float32(data.scale * data.dt * ahead), np.float32(FLOOR * data.scale)
    layers = adam.descend(
        lambda: _program(modes),
        _start(rng, len(centre), modes),
        sizes,
        lambda count: _scaled(data.draw(rng, count), centre, width),
        held,
        worth,
        rounds,
    )
    return DensityNetwork(
        dt=data.dt,
        observed=data.past.shape[1],
        horizon=data.dt * ahead,
        scale=data.scale,
        modes=modes,
        centre=tuple(centre.tolist()),
        width=tuple(width.tolist()),
        layers=tuple(layer_of(weight, bias) for weight, bias in layers),
    )


def _scaled(drawn: Examples, centre: Array, width: Array) -> tuple[Any, Any, Any]:
    """Return the parts as float32, the inputs centred."""
    parts = ((drawn.inputs - centre) / width, drawn.certain, drawn.residual)
    first, second, third = (part.astype(np.float32) for part in parts)
    return first, second, third


def _start(rng: np.random.Generator, inputs: int, modes: int) -> list[tuple[Any, Any]]:
    """Draw the initial layers.

    All modes begin alike, but for a bend from right to left: modes that begin the same may
    part one way for slow obstacles and the other way for fast ones, and meet in between.
    """
    sizes = [inputs, *HIDDEN, output_count(modes)]
    layers = []
    for before, after in pairwise(sizes):
        weight = rng.standard_normal((before, after)) / np.sqrt(before)
        layers.append((weight.astype(np.float32), np.zeros(after, dtype=np.float32)))
    weight, bias = layers[-1]
    aside = np.arange(modes) - 0.5 * (modes - 1)
    bends = bias[modes : modes * (1 + 2 * POWERS)].reshape(modes, POWERS, 2)
    bends[:, 1, 1] = BENT * aside / max(modes - 1, 1)
    layers[-1] = np.float32(0.1) * weight, bias
    return layers


@cache
def _program(modes: int) -> adam.Program:
    """Compile a round of Adam, and the loss of held-out windows; once for all fits."""
    import jax.numpy as jnp

    def losses(layers: Any, sizes: Any, inputs: Any, certain: Any, residual: Any) -> Any:
        raw = forward(jnp, layers, inputs)
        return loss(jnp, raw, certain, residual, modes, *sizes)

    return adam.compiled(losses)


def layer_of(weight: Array, bias: Array) -> Layer:
    """Turn arrays into plain numbers; float32 values are exact as float64."""
    rows = tuple(tuple(map(float, row)) for row in weight)
    return Layer(rows, tuple(map(float, bias)))
