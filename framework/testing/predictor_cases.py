"""Tracks and scenes that the check of predictors draws: ordinary ones and every odd one."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..values.arrays import Array
from ..values.forecast import Scene
from ..values.measurements import Measurements
from ..values.motion import Truth
from ..values.tracks import Tracks

STEPS = 6
SAMPLES = 30
DT = 0.5
NEVER = "never observed"
ORDINARY = ("ordinary", "straight line", "stopped")


def draw_tracks(size: int, rng: np.random.Generator) -> Tracks:
    """Return ordinary tracks and every degenerate one, named by what is odd about it."""
    time = DT * np.arange(SAMPLES)[:, None]
    along = np.linspace(1.0, 0.3, size)
    walk = np.cumsum(along * DT + 0.05 * rng.standard_normal((SAMPLES, size)), axis=0)
    hollow, ended, single, pair, triple = (walk.copy() for _ in range(5))
    hollow[[5, 6, 11, 20]] = np.nan
    hollow[15, 0] = np.nan
    ended[-4:] = np.nan
    single[:-1], pair[:-2], triple[:-3] = np.nan, np.nan, np.nan
    long_gap = walk.copy()
    long_gap[8:22] = np.nan
    stopped = np.concatenate([walk[:20], np.repeat(walk[19:20], SAMPLES - 20, axis=0)])
    growing = walk + 0.02 * 1.35 ** np.arange(SAMPLES)[:, None] * along
    paths = {
        "ordinary": walk,
        "gaps": hollow,
        "long gap": long_gap,
        "not seen lately": ended,
        "one sample": single,
        "two samples": pair,
        "three samples": triple,
        NEVER: np.full((SAMPLES, size), np.nan),
        "standing still": np.tile(along, (SAMPLES, 1)),
        "straight line": time * along,
        "along one axis": time * np.eye(size)[0],
        "on a diagonal": time * np.ones(size),  # all its differences are exact
        "stopped": stopped,
        "explosive": growing,
        "far away": walk + 1e6,
        "jumping": 20.0 * rng.standard_normal((SAMPLES, size)),
    }
    count = len(paths)
    root = 0.02 * (np.eye(size) + 0.3 * rng.standard_normal((count, size, size)))
    return Tracks(
        np.stack(list(paths.values())),
        DT,
        tuple(paths),
        np.full(count, 0.3),
        root @ np.swapaxes(root, 1, 2),
        stamp=12.0,
    )


def draw_scene(tracks: Tracks, rng: np.random.Generator) -> Scene:
    """Return a scene with goals, a plan, and the truth for some obstacles."""
    size = tracks.dimension
    times = np.asarray(tracks.stamp + DT * np.arange(-2, 2 * STEPS), dtype=np.float64)
    future = {
        ident: rng.standard_normal((len(times), size)).cumsum(axis=0) for ident in tracks.ids[::2]
    }
    goals = 10.0 * rng.standard_normal((len(tracks), size))
    plan = rng.standard_normal((STEPS, size)).cumsum(axis=0)
    return Scene(plan=plan, goals=goals, truth=Truth(times, future))


def draw_rotation(size: int, rng: np.random.Generator) -> Array:
    """Return a random rotation matrix, (D, D)."""
    basis, _ = np.linalg.qr(rng.standard_normal((size, size)))
    basis[:, 0] *= np.sign(np.linalg.det(basis))
    return np.asarray(basis)


def move_tracks(tracks: Tracks, turn: Array, shift: Array) -> Tracks:
    """Turn and shift tracks."""
    sightings = tracks.sightings
    if sightings is not None:
        sightings = Measurements(
            sightings.times,
            [places @ turn.T + shift for places in sightings.positions],
            [_turned(noise, turn) for noise in sightings.noise],
            sightings.log,
        )
    return replace(
        tracks,
        positions=tracks.positions @ turn.T + shift,
        noise=_turned(tracks.noise, turn),
        sightings=sightings,
    )


def _turned(noise: Array, turn: Array) -> Array:
    turned = turn @ noise @ turn.T
    return np.asarray(0.5 * (turned + np.swapaxes(turned, 1, 2)))


def move_scene(scene: Scene, turn: Array, shift: Array) -> Scene:
    """Turn and shift what the scene holds; the ego state's layout is the robot's own."""
    truth, plan, goals = scene.truth, scene.plan, scene.goals
    if truth is not None:
        paths = {key: path @ turn.T + shift for key, path in truth.positions.items()}
        truth = Truth(truth.times, paths)
    return replace(
        scene,
        truth=truth,
        plan=None if plan is None else plan @ turn.T + shift,
        goals=None if goals is None else goals @ turn.T + shift,
    )


def draw_recordings(size: int, rng: np.random.Generator, rows: int = 60) -> list[Tracks]:
    """Return recordings to fit to: people who bend their way, walk on or stand, with gaps."""
    count, dt = 12, 0.4
    drawn = []
    for place in range(2):
        bends = np.cumsum(rng.normal(0, 0.06, (count, rows, size)), axis=1)
        velocity = rng.normal(0, 0.8, (count, 1, size)) + bends
        velocity[1] = velocity[1, :1]
        velocity[2, rows // 2 :] = 0.0
        start = rng.uniform(-5.0, 5.0, (count, 1, size))
        paths = start + np.cumsum(dt * velocity, axis=1) + rng.normal(0, 0.02, velocity.shape)
        paths[::5, 30:34] = np.nan
        noise = np.tile(0.02**2 * np.eye(size), (count, 1, 1))
        ids = tuple(f"{place}.{index}" for index in range(count))
        drawn.append(Tracks(paths, dt, ids, np.full(count, 0.3), noise))
    return drawn


def odd_worlds(tracks: Tracks) -> dict[str, Tracks]:
    """Return the same tracks in worlds of their own, named by what is odd about them."""
    worlds = {f"{rows} rows": replace(tracks, positions=tracks.positions[:, SAMPLES - rows :])
              for rows in range(4)}  # fmt: skip
    return worlds | {
        "no noise": replace(tracks, noise=np.zeros_like(tracks.noise)),
        "dt = 1 ms": replace(tracks, dt=1e-3),
        "dt = 1000 s": replace(tracks, dt=1e3),
    }


ABSURD = "absurd"


def absurd_worlds(tracks: Tracks, rng: np.random.Generator) -> dict[str, Tracks]:
    """Return worlds in which the obstacle `ABSURD` has numbers of an absurd magnitude.

    It comes last, after ordinary ones, and 100 km from them.
    """
    size = tracks.dimension
    some = tracks.select([tracks.ids.index(name) for name in ORDINARY])
    ids = (*some.ids, ABSURD)
    away = some.positions[0] + 1e5 * np.eye(size)[0]
    basis = draw_rotation(size, rng)
    flat = (basis * np.logspace(200, -200, size)) @ basis.T
    single, leaping = away.copy(), away + 1e8 * (-1.0) ** np.arange(SAMPLES)[:, None]
    single[SAMPLES // 2] = 1e300
    places = {
        "positions of 1e308 m": np.full_like(away, 1e308),
        "positions of 1e-300 m": 1e-300 * some.positions[0],
        "one position of 1e300 m": single,
        "leaps of 1e8 m": leaping,
    }
    spreads = {f"noise of {spread:g} m^2": spread * np.eye(size)
               for spread in (1e308, 1e200, 1e30, 1e12, 1e-30, 1e-300, 5e-324)}  # fmt: skip
    spreads["noise from 1e-200 to 1e200 m^2"] = 0.5 * (flat + flat.T)
    worlds = {}
    for name in (*places, *spreads, "a radius of 1e308 m", "a tracker's 1e300"):
        place = places[name] if name in places else away
        spread = spreads[name] if name in spreads else some.noise[0]
        radius = 1e308 if "radius" in name else 0.3
        tracker = None
        if "tracker" in name:
            small = np.tile(1e-4 * np.eye(2 * size), (len(ids) - 1, 1, 1))
            tracker = np.concatenate([small, 1e300 * np.eye(2 * size)[None]])
        worlds[name] = Tracks(
            np.concatenate([some.positions, place[None]]),
            DT,
            ids,
            np.append(some.radius, radius),
            np.concatenate([some.noise, spread[None]]),
            some.stamp,
            tracker,
        )
    steps = {f"dt = {dt:g} s": replace(tracks, dt=dt) for dt in (1e-300, 1e-6, 1e4, 1e300)}
    return worlds | steps


def draw_run(tracks: Tracks) -> list[Tracks]:
    """Return what an adapting predictor sees row by row; obstacles come, pause and go."""
    run = []
    for end in range(8, SAMPLES + 1):
        seen = tracks.positions[:, end - 8 : end]
        whole = np.asarray(np.isfinite(seen).all(axis=2), dtype=np.bool_)
        index = [int(i) for i in np.flatnonzero(np.any(whole, axis=1))]
        part = tracks.select(index)
        stamp = tracks.stamp - DT * (SAMPLES - end)
        run.append(replace(part, positions=seen[index], stamp=stamp))
    return run


def draw_sighted(size: int, rng: np.random.Generator) -> Tracks:
    """Return obstacles that are measured at times of their own, named by what is odd about them.

    Each measurement has a covariance of its own. The first obstacle is measured at the newest
    instant.
    """
    often, seldom = 0.13 * np.arange(20.0), np.arange(12.0)
    ages = {
        "newest": seldom + np.append(0.0, rng.uniform(-0.1, 0.1, 11)),
        "any times": 0.2 + np.cumsum(rng.uniform(0.1, 2.4, 12)),
        "often": 0.05 + often,
        "after a pause": np.concatenate([0.3 + often[:5], 7.9 + seldom[:6]]),
        "over a pause": np.concatenate([0.4 + seldom[:3], 8.3 + seldom[:6]]),
        "seen once": np.array([0.6]),
        "seen twice": np.array([0.3, 0.8]),
        "not seen lately": 3.3 + np.cumsum(rng.uniform(0.4, 1.6, 9)),
        "standing still": 0.1 + seldom,
        "far away": 0.7 + seldom,
        NEVER: np.empty(0),
    }
    times, places, noise = [], [], []
    for name, age in ages.items():
        clock = 12.0 - DT * age[::-1]
        walk = np.cumsum(0.05 * rng.standard_normal((len(age), size)), axis=0)
        place = clock[:, None] * rng.uniform(-1.5, 1.5, size) + walk
        still = name == "standing still"
        root = 0.03 * (np.eye(size) + 0.3 * rng.standard_normal((len(age), size, size)))
        times.append(clock)
        places.append(1e6 * (name == "far away") + (np.ones_like(place) if still else place))
        noise.append(root @ np.swapaxes(root, 1, 2))
    count = len(ages)
    sightings = Measurements(times, places, noise, range(count))
    spread = np.tile(1e-3 * np.eye(size), (count, 1, 1))
    return sighted_tracks(sightings, tuple(ages), np.full(count, 0.3), spread)


def sighted_tracks(
    sightings: Measurements, ids: Sequence[str], radius: Array, noise: Array
) -> Tracks:
    """Return tracks with these sightings, and with what a history puts on the grid of them."""
    stamp = float(sightings.newest.max())
    grid = stamp - DT * np.arange(SAMPLES - 1.0, -1.0, -1.0)
    rows = []
    for times, places in zip(sightings.times, sightings.positions, strict=True):
        row = np.full((SAMPLES, places.shape[1]), np.nan)
        if len(times):
            after = np.clip(times.searchsorted(grid), 1, max(len(times) - 1, 1))
            width = times[np.minimum(after, len(times) - 1)] - times[after - 1]
            between = (grid >= times[0]) & (grid <= times[-1]) & (width <= 2.5 * DT)
            for axis, place in enumerate(places.T):
                row[between, axis] = np.interp(grid[between], times, place)
            nearest = int(np.argmin(np.abs(grid - times[-1])))
            if np.isnan(row[nearest]).any():
                row[nearest] = places[-1]
        rows.append(row)
    return Tracks(np.stack(rows), DT, ids, radius, noise, stamp, sightings=sightings)


def seen_until(tracks: Tracks, time: float) -> Tracks:
    """Return the tracks as they were at a time, s, of those who had been measured."""
    sightings = tracks.measured.part([times <= time for times in tracks.measured.times])
    index = [int(i) for i in np.flatnonzero(sightings.count)]
    names = tuple(tracks.ids[i] for i in index)
    return sighted_tracks(
        sightings.select(index), names, tracks.radius[index], tracks.noise[index]
    )


def with_sightings(tracks: Tracks) -> Tracks:
    """Return the tracks with the observed samples of the grid as sightings, `DT` apart."""
    rows = tracks.positions.shape[1]
    times = tracks.stamp - DT * np.arange(rows - 1.0, -1.0, -1.0)
    seen = np.asarray(np.isfinite(tracks.positions).all(axis=2), dtype=np.bool_)
    return replace(
        tracks,
        sightings=Measurements(
            [times[row] for row in seen],
            [places[row] for places, row in zip(tracks.positions, seen, strict=True)],
            [np.tile(spread, (int(row.sum()), 1, 1))
             for spread, row in zip(tracks.noise, seen, strict=True)],
            range(len(tracks)),
        ),
    )  # fmt: skip


def absurd_clocks(tracks: Tracks) -> dict[str, Tracks]:
    """Return sighted tracks at absurd times, and with one measured an absurd time ago."""
    sightings = tracks.measured
    parts = sightings.positions, sightings.noise, sightings.log
    worlds = {}
    for factor in (1e-300, 1e-6, 1e9, 1e300):
        times = [factor * one for one in sightings.times]
        stamp = factor * tracks.stamp
        worlds[f"a clock of {stamp:g} s"] = replace(
            tracks, stamp=stamp, sightings=Measurements(times, *parts)
        )
    for later in (1e6, 1e300):
        worlds[f"measured {later:g} s ago"] = replace(tracks, stamp=tracks.stamp + later)
    return worlds
