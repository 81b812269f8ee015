"""Tracks and scenes that the check of predictors draws: ordinary ones and every odd one."""

from dataclasses import replace

import numpy as np

from ..values.arrays import Array
from ..values.forecast import Scene
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
    noise = turn @ tracks.noise @ turn.T
    return replace(
        tracks,
        positions=tracks.positions @ turn.T + shift,
        noise=0.5 * (noise + np.swapaxes(noise, 1, 2)),
    )


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
