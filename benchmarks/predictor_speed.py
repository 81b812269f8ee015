"""Every registered predictor on 1, 10 and 100 obstacles."""

from functools import partial

import numpy as np
from measuring import Row, Tick, brief, rotated, timed

from wideberth.framework import Predictor, Scene, Tracks, names
from wideberth.framework.config import build
from wideberth.framework.motion import Truth

REFERENCE = "constant_velocity"
SAMPLES, STEPS, DT = 80, 15, 0.5
NOISE = 0.02
"""m, standard deviation of a measured position."""


def walkers(count: int, seed: int) -> tuple[Tracks, Scene]:
    """Return tracks of people whose velocity drifts, and the truth behind them.

    v_h - v = 0.9 (v_{h-1} - v) + u_h with v drawn once, |v| about 1 m/s, and
    u_h ~ N(0, (0.1 m/s)^2 I).
    """
    rng = np.random.default_rng(seed)
    length = SAMPLES + STEPS
    deviation = np.zeros((count, length, 2))
    push = rng.normal(scale=0.1, size=deviation.shape)
    for h in range(1, length):
        deviation[:, h] = 0.9 * deviation[:, h - 1] + push[:, h]
    velocity = rng.normal(scale=0.7, size=(count, 1, 2)) + deviation
    places = rng.uniform(-20, 20, (count, 1, 2)) + DT * np.cumsum(velocity, axis=1)
    seen = places[:, :SAMPLES] + rng.normal(scale=NOISE, size=(count, SAMPLES, 2))
    ids = tuple(f"walker {i}" for i in range(count))
    noise = np.tile(NOISE**2 * np.eye(2), (count, 1, 1))
    tracks = Tracks(seen, DT, ids, np.full(count, 0.3), noise, DT * (SAMPLES - 1))
    truth = Truth(DT * np.arange(length), dict(zip(ids, places, strict=True)))
    return tracks, Scene(truth=truth)


def measure(counts: tuple[int, ...], rounds: int, tick: Tick) -> list[Row]:
    """Time one call for all obstacles together: one row per predictor and number."""
    predictors: dict[str, Predictor] = {
        name: build("predictors", name) for name in names("predictors")
    }
    rows = []
    for count in counts:
        tick(f"predictors, {count} obstacles")
        times: dict[str, list[float]] = {name: [] for name in predictors}
        fell_back: dict[str, float] = {}
        tracks, scene = walkers(count, seed=1)
        for turn in range(rounds + 1):
            for name in rotated(list(predictors), turn):
                work = partial(predictors[name].predict, tracks, STEPS, scene)
                time, forecast = timed(work)
                if turn:  # the first call imports what the predictor needs
                    times[name].append(time)
                fell_back[name] = float(np.mean([why is not None for why in forecast.fallback]))
        for name in predictors:
            row = {"obstacles": count, "predictor": name, **brief(times[name], times[REFERENCE])}
            row["ms_per_obstacle"] = row["median_ms"] / count
            rows.append(row | {"fell_back": fell_back[name]})
    return rows
