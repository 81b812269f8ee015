"""Training of a social attention network, in JAX."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from ...framework.tracking.windows import windows_of
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.tracks import Tracks
from . import adam
from .density_network import STANDING, cubic, decode, features, frames, output_count
from .density_training import FLOOR, layer_of, loss, noisy
from .history import IntArray
from .social_network import (
    AHEAD,
    HEADS,
    PAIR_FEATURES,
    PAIR_HIDDEN,
    WIDTH,
    People,
    SocialNetwork,
    outputs,
    pairs,
    straight,
)

HIDDEN = (48, 48)
"""Width of the tanh layers that see a person and his company."""
NEIGHBOURS = 16
"""Nearest others of each person that the training sees."""
STRIDE = 2
"""Every so many-th window is learnt from: successive ones tell nearly the same."""
BLIND = 0.2
"""Share of the windows in which the robot is not told of: forecasts may be asked for without its
plan."""
PIECES, HELD_OUT = 96, 8
"""The windows, in the order of scenes, tracks and rows, are cut into so many pieces; every eighth
piece is held out."""
WANTED = 100
"""Fewest windows to fit to."""
DISTANCE = 1.0
"""Weight of the mean error of the path, in units of scale x 1 s, beside the negative log
likelihood: without it those who are hard to forecast count for little in the mean."""


@dataclass(frozen=True, eq=False)
class Material:
    """All windows of all scenes.

    Attributes
    ----------
    past : (W, observed, 2), m. future : (W, predicted, 2), m.
    row : (W,), row of the person in ``people``. others : (W, NEIGHBOURS), rows of the nearest
        others, -1 where there are fewer.
    people : everybody at every moment, (R,).
    held : (W,), held out.
    dt : s. scale : m/s, root mean square speed.
    """

    past: Array
    future: Array
    row: IntArray
    others: IntArray
    people: People
    held: BoolArray
    dt: float
    scale: float

    def parts(
        self, past: Array, chosen: IntArray, flip: Array, told: BoolArray
    ) -> tuple[Any, ...]:
        """Return what the losses are given of windows, see `_program`.

        Parameters
        ----------
        past : (B, observed, 2), m, of the windows ``chosen`` (B,), perhaps with noise.
        flip : (B,), -1 for those to be mirrored, otherwise 1.
        told : (B,), those in which the robot is told of.
        """
        mirror = np.stack([np.ones_like(flip), flip], axis=1)[:, None]
        origin = past[:, -1:]
        past, future = (past - origin) * mirror, (self.future[chosen] - origin) * mirror
        velocities = np.diff(past, axis=1) / self.dt
        known = np.ones(velocities.shape[:2], dtype=np.bool_)
        own = frames(velocities, known, self.dt, STANDING * self.scale)
        times = self.dt * np.arange(1, future.shape[1] + 1)[:, None]
        residual = (future - times * own.velocity[:, None]) @ own.turn.swapaxes(1, 2)
        company = self.others[chosen]
        others = People(**{name: value[company] for name, value in vars(self.people).items()})
        present = (company >= 0) & ((others.robot == 0) | told[:, None])
        others = replace(
            others,
            courses=(others.courses - origin[:, None]) * mirror[:, None],
            velocity=others.velocity * mirror,
            bend=others.bend * mirror,
        )
        inputs = features(velocities, own, self.scale)
        radius = self.people.radius[self.row[chosen]]
        frame = own.velocity, own.turn, own.certain
        return inputs, present, residual, radius, *frame, *vars(others).values()

    def draw(self, rng: np.random.Generator, count: int) -> tuple[Any, ...]:
        """Draw training windows; half of them with noise, half of them mirrored."""
        chosen = rng.choice(np.flatnonzero(~self.held), size=count)
        past = noisy(rng, self.past[chosen], self.scale * self.dt)
        flip = np.where(rng.random(count) < 0.5, -1.0, 1.0)
        return self.parts(past, chosen, flip, rng.random(count) >= BLIND)


def material_of(
    scenes: Sequence[Tracks], observed: int, predicted: int, robot: str, who: str
) -> Material:
    """Collect the windows of scenes in the plane, all of one dt.

    Parameters
    ----------
    observed, predicted : samples of a window.
    robot : identity of the robot in the scenes, whose way is told as its plan; nobody's future
        is learnt from it.
    who : name of the predictor, for messages.

    Raises
    ------
    WideberthError : fewer than `WANTED` windows, `STRIDE` not yet regarded.
    """
    walkers = [[i for i, ident in enumerate(one.ids) if ident != robot] for one in scenes]
    some = [scene.select(index) for scene, index in zip(scenes, walkers, strict=True)]
    windows = windows_of(some, observed, predicted, wanted=WANTED, who=who)
    parts, people, begin = [], [], 0
    for scene, index, found in zip(scenes, walkers, windows, strict=True):
        obstacle = np.array(index, dtype=np.int64)[found.obstacle[::STRIDE]]
        row = found.row[::STRIDE]
        table = _table(scene, observed, robot)
        rows = scene.positions.shape[1]
        nearest = _nearest(table.courses[:, :, 0], obstacle, row)
        others = np.where(nearest >= 0, begin + nearest * rows + row[:, None], -1)
        past, future = found.tracks.positions[::STRIDE], found.future[::STRIDE]
        parts.append((past, future, begin + obstacle * rows + row, others))
        people.append(table)
        begin += len(scene) * rows
    past, future, row, others = map(np.concatenate, zip(*parts, strict=True))
    flat = [np.concatenate(column) for column in zip(*map(_flat, people), strict=True)]
    held = np.arange(len(past)) * PIECES // len(past) % HELD_OUT == HELD_OUT - 1
    dt = scenes[0].dt
    speed = float(np.sqrt((np.diff(past, axis=1) ** 2).sum(axis=2).mean())) / dt
    return Material(past, future, row, others, People(*flat), held, dt, max(speed, 1e-3))


def _flat(people: People) -> list[Array]:
    """Return the parts of people (O, T) with one axis of O T rows in place of two."""
    return [part.reshape(-1, *part.shape[2:]) for part in vars(people).values()]


def _table(scene: Tracks, observed: int, robot: str) -> People:
    """Everybody at every row of a scene, (O, T); places are NaN where less than two were seen."""
    positions, dt = scene.positions, scene.dt
    count, rows = positions.shape[:2]
    before = np.full((count, observed - 1, 2), np.nan)
    steps = np.diff(np.concatenate([before, positions], axis=1), axis=1) / dt
    seen = np.lib.stride_tricks.sliding_window_view(steps, observed - 1, axis=1)
    seen = seen[:, :rows].swapaxes(2, 3).reshape(count * rows, observed - 1, 2)
    known = np.asarray(np.isfinite(seen).all(axis=2), dtype=np.bool_)
    seen = np.where(known[..., None], seen, 0.0)
    mean = frames(seen, known, dt, 1.0).velocity.reshape(count, rows, 2)
    bend = seen[:, -1].reshape(count, rows, 2) - mean
    there = known[:, -1].reshape(count, rows, 1, 1)
    courses = positions[:, :, None] + np.array(AHEAD)[:, None] * mean[:, :, None]
    for index in (place for place, ident in enumerate(scene.ids) if ident == robot):
        courses[index] = _future(positions[index], courses[index], dt)
        step = np.diff(positions[index], axis=0, append=np.nan) / dt
        mean[index] = np.where(np.isfinite(step), step, mean[index])
        bend[index] = 0.0
    return People(
        np.where(there, courses, np.nan),
        mean,
        bend,
        np.broadcast_to(scene.radius[:, None], (count, rows)),
        np.broadcast_to(np.array([[float(one == robot)] for one in scene.ids]), (count, rows)),
    )


def _future(path: Array, straight: Array, dt: float) -> Array:
    """Where the robot was at the times `AHEAD` after each row, (T, len(AHEAD), 2), m.

    Beyond the end it goes on as in its last step, as plans do; where it was not seen it goes
    ``straight`` on.
    """
    more = np.arange(1.0, np.ceil(AHEAD[-1] / dt) + 1.0)[:, None]
    path = np.concatenate([path, path[-1] + more * np.diff(path[-2:], axis=0).sum(axis=0)])
    times = dt * np.arange(len(path))
    wanted = times[: len(straight), None] + np.array(AHEAD)
    there = np.stack([np.interp(wanted, times, axis) for axis in path.T], axis=-1)
    return np.where(np.isfinite(there), there, straight)


def _nearest(places: Array, obstacle: IntArray, row: IntArray) -> IntArray:
    """Return the nearest others of each window, (W, NEIGHBOURS); -1 for nobody."""
    found = np.full((len(row), NEIGHBOURS), -1, dtype=np.int64)
    for moment in np.unique(row):
        here = places[:, moment]
        windows = np.flatnonzero(row == moment)
        away = np.linalg.norm(here[obstacle[windows], None] - here, axis=2)
        away[np.arange(len(windows)), obstacle[windows]] = np.inf
        away = np.where(np.isfinite(away), away, np.inf)
        order = np.argsort(away, axis=1, kind="stable")[:, :NEIGHBOURS]
        chosen = np.where(np.isfinite(np.take_along_axis(away, order, axis=1)), order, -1)
        found[windows, : order.shape[1]] = chosen
    return found


def train(data: Material, *, rounds: int, seed: int) -> SocialNetwork:
    """Train a network on windows by Adam; the round with the lowest held-out loss is kept.

    Same windows and seed, same network.

    Parameters
    ----------
    data : see `material_of`.
    rounds : of `adam.UPDATES` updates each. seed : of all that is drawn.
    """
    rng = np.random.default_rng(seed)
    ahead = data.future.shape[1]
    first = data.draw(rng, adam.UPDATES * adam.BATCH)[0]
    centre, width = first.mean(axis=0), first.std(axis=0) + 1e-3
    kept = np.flatnonzero(data.held)
    plain = np.ones(len(kept))
    held = _scaled(data.parts(data.past[kept], kept, plain, plain > 0), centre, width)
    sizes = np.float32(data.scale * data.dt * ahead), np.float32(FLOOR * data.scale)
    layers = adam.descend(
        _program,
        _start(rng, len(centre)),
        (*sizes, np.float32(data.scale)),
        lambda count: _scaled(data.draw(rng, count), centre, width),
        held,
        plain / len(kept),
        rounds,
    )
    return SocialNetwork(
        dt=data.dt,
        observed=data.past.shape[1],
        horizon=data.dt * ahead,
        scale=data.scale,
        centre=tuple(centre.tolist()),
        width=tuple(width.tolist()),
        layers=tuple(layer_of(weight, bias) for weight, bias in layers),
    )


def _scaled(parts: tuple[Any, ...], centre: Array, width: Array) -> tuple[Any, ...]:
    """Return the parts as float32, the inputs centred."""
    inputs, *rest = parts
    every = ((inputs - centre) / width, *rest)
    return tuple(np.nan_to_num(part).astype(np.float32) for part in every)


def _start(rng: np.random.Generator, inputs: int) -> adam.Layers:
    """Draw the initial layers; the last one is small: nearly constant velocity to begin with."""
    company = HEADS * (WIDTH + 1)
    chains = (
        [PAIR_FEATURES, PAIR_HIDDEN, company],
        [inputs + company, *HIDDEN, output_count(1)],
    )
    layers = []
    for sizes in chains:
        for before, after in pairwise(sizes):
            weight = rng.standard_normal((before, after)) / np.sqrt(before)
            layers.append((weight.astype(np.float32), np.zeros(after, dtype=np.float32)))
    weight, bias = layers[-1]
    layers[-1] = np.float32(0.1) * weight, bias
    return layers


@cache
def _program() -> adam.Program:
    """Compile a round of Adam, and the loss of held-out windows; once for all fits."""
    import jax.numpy as jnp

    def losses(
        layers: Any, sizes: Any, inputs: Any, present: Any, residual: Any, radius: Any,
        velocity: Any, turn: Any, certain: Any, *others: Any,
    ) -> Any:  # fmt: skip
        length, floor, unit = sizes
        told, seen = pairs(jnp, straight(jnp, velocity, radius), People(*others), turn, certain)
        raw = outputs(jnp, layers, inputs, told, seen * present)
        likelihood = loss(jnp, raw, certain, residual, 1, length, floor)
        return likelihood + DISTANCE / unit * path_error(
            jnp, raw, certain, residual, length, floor
        )

    return adam.compiled(losses)


def path_error(xp: Any, raw: Any, certain: Any, residual: Any, length: float, floor: float) -> Any:
    """Return the mean distance of the one mode's path from the truth, (W,), m.

    Parameters
    ----------
    raw, certain, length : as `decode` takes them.
    residual : (W, N, 2), m, truth less the straight line, in the own frame.
    floor : m, added in quadrature to each distance: the slope at 0 is finite.
    """
    _, path, _ = decode(xp, raw, certain, 1, length)
    share = xp.arange(1, residual.shape[1] + 1) / residual.shape[1]
    error = residual - cubic(xp, share) @ path[:, 0]
    return xp.sqrt((error**2).sum(axis=-1) + floor**2).mean(axis=1)
