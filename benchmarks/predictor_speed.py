"""Every registered predictor on 1 to 1000 obstacles, beside statsmodels and filterpy.

A call is `predict`; of those that adapt while they run, `update` is another. Both filter every
sample.
Of those that filter, `decision` is what a planner asks for when all obstacles have been measured
once more: learn and forecast, going on with what was filtered before.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from measuring import Row, Tick, brief, rotated, timed

from wideberth.framework import Predictor, Scene, Tracks, names
from wideberth.framework.plugins.config import build
from wideberth.framework.predictor import Adaptive, Filtering, Fittable
from wideberth.framework.tracking.perception import FORGET, Perception
from wideberth.framework.values.measurements import Measurements
from wideberth.framework.values.motion import Truth

REFERENCE = "constant_velocity"
SAMPLES, STEPS, DT = 20, 15, 0.5
NOISE = 0.02
"""m, standard deviation of a measured position."""
BUDGET = 3000.0
"""ms. At each number of obstacles a candidate takes turns until it has used as much, and none if a
single call is expected to use it: as much more than at the last number as that was more than at
the one before, and at least in proportion."""
BRIEF_TRAINING: dict[str, dict[str, Any]] = {
    "functional_constant": {"tail": 0.2},
    "mixture_density": {"rounds": 1},
    "single_gaussian": {"base": {"type": "mixture_density", "rounds": 1}},
}
"""Training of predictors that learn, for a short time or from few recordings: the quality of a fit
does not change the speed."""
Call: TypeAlias = Callable[[], float | None]
"""A timed call; a forecast returns the share of obstacles that fell back."""


@dataclass
class Candidate:
    """A predictor and its timed calls.

    Attributes
    ----------
    name : of the predictor.
    engine : "own", or the library whose plain loop over the obstacles it is.
    prepare : returns the call for these obstacles; what it does itself is not timed.
    call : "predict", "update" or "decision".
    history : (obstacles, best time in ms) at the numbers measured so far.
    """

    name: str
    engine: str
    prepare: Callable[[Tracks, Scene], Call]
    call: str = "predict"
    history: list[tuple[int, float]] = field(default_factory=list)

    def expected(self, count: int) -> float:
        """Expect this many ms of one call for ``count`` obstacles; 0 where nothing is known."""
        if not self.history:
            return 0.0
        number, time = self.history[-1]
        growth = count / number
        if len(self.history) > 1:
            growth = max(growth, time / self.history[-2][1])
        return time * growth


def walkers(count: int, seed: int, length: int = SAMPLES + STEPS) -> tuple[Tracks, Scene]:
    """Return tracks of people whose velocity drifts, the truth behind them, and a robot.

    v_h - v = 0.9 (v_{h-1} - v) + u_h with v drawn once, |v| about 1 m/s, and
    u_h ~ N(0, (0.1 m/s)^2 I). The robot stands in their midst and plans to cross.
    """
    rng = np.random.default_rng(seed)
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
    truth = Truth(DT * np.arange(length, dtype=np.float64), dict(zip(ids, places, strict=True)))
    plan = 0.5 * DT * np.arange(1, STEPS + 1)[:, None] * np.eye(2)[0]
    return tracks, Scene(ego=np.array([0.0, 0.0, 0.0, 0.5, 0.0]), plan=plan, truth=truth)


def scenes(seed: int) -> list[Tracks]:
    """Return recordings to fit to; half of one is enough for what predictors cut in time."""
    made = []
    for number in range(2):
        tracks, scene = walkers(20, seed + number, length=2 * (SAMPLES + STEPS))
        assert scene.truth is not None
        whole = np.stack([scene.truth.positions[ident] for ident in tracks.ids])
        made.append(Tracks(whole, DT, tracks.ids, tracks.radius, tracks.noise))
    return made


def candidates() -> list[Candidate]:
    """Return every registered predictor, fitted where it learns, and the libraries' loops."""
    recordings = scenes(seed=100)
    found = []
    for name in names("predictors"):
        predictor: Predictor = build("predictors", {"type": name, **BRIEF_TRAINING.get(name, {})})
        if isinstance(predictor, Fittable):
            predictor = predictor.fit(recordings)
        found.append(Candidate(name, "own", partial(_predicting, predictor)))
        if isinstance(predictor, Adaptive):
            found.append(Candidate(name, "own", partial(_updating, predictor), "update"))
        if isinstance(predictor, Filtering):
            found.append(Candidate(name, "own", partial(_deciding, predictor), "decision"))
    found.append(Candidate("var", "statsmodels", partial(_looping, _statsmodels)))
    found.append(Candidate("kalman", "filterpy", partial(_looping, _filterpy)))
    return found


def _predicting(predictor: Predictor, tracks: Tracks, scene: Scene) -> Call:
    return partial(_predict, predictor, tracks, scene)


def _predict(predictor: Predictor, tracks: Tracks, scene: Scene) -> float:
    forecast = predictor.predict(tracks, STEPS, scene)
    return float(np.mean([why is not None for why in forecast.fallback]))


def _updating(predictor: Adaptive, tracks: Tracks, scene: Scene) -> Call:
    """Return the update with the newest sample, after one with each sample before it.

    By then forecasts of every age wait for their truth, as they do while a robot drives.
    """
    for count in range(1, SAMPLES):
        seen = replace(tracks, positions=tracks.positions[:, :count], stamp=DT * (count - 1))
        predictor = predictor.update(seen, scene)
    return partial(_update, predictor, tracks, scene)


def _update(predictor: Adaptive, tracks: Tracks, scene: Scene) -> None:
    predictor.update(tracks, scene)


def _deciding(predictor: Predictor, tracks: Tracks, scene: Scene) -> Call:
    """Return what a planner asks for at the newest sample, after it has learnt at each before."""
    perception = Perception.initial(predictor, tracks.dimension, DT, SAMPLES, DT, FORGET)
    for count in range(1, SAMPLES):
        perception = perception.learnt(_measured(tracks, count), scene)
    return partial(_decide, perception, _measured(tracks, SAMPLES), scene)


def _decide(perception: Perception, tracks: Tracks, scene: Scene) -> float:
    times = DT * np.arange(1.0, STEPS + 1)
    forecast = perception.learnt(tracks, scene).forecast(tracks, tracks.stamp, times, scene)
    assert forecast is not None
    return float(np.mean([why is not None for why in forecast.fallback]))


def _measured(tracks: Tracks, count: int) -> Tracks:
    """Return the oldest samples, each of them as a measurement in the log of its obstacle."""
    places, times = tracks.positions[:, :count], DT * np.arange(count, dtype=np.float64)
    noise = np.repeat(tracks.noise[:, None], count, axis=1)
    logs = range(len(tracks))
    sightings = Measurements([times] * len(tracks), list(places), list(noise), logs)
    return replace(tracks, positions=places, stamp=DT * (count - 1), sightings=sightings)


def _looping(loop: Callable[[Tracks], None], tracks: Tracks, scene: Scene) -> Call:
    return partial(loop, tracks)


def _statsmodels(tracks: Tracks) -> None:
    """Fit VAR(2), forecast and say the covariance, one obstacle after the other."""
    from statsmodels.tsa.api import VAR

    for positions in tracks.positions:
        velocities = np.diff(positions, axis=0) / tracks.dt
        result = VAR(velocities).fit(maxlags=2, trend="n")
        result.forecast(velocities[-2:], STEPS)
        result.mse(STEPS)


def _filterpy(tracks: Tracks) -> None:
    """Filter at constant velocity and roll out, one obstacle after the other."""
    from filterpy.kalman import KalmanFilter

    dt, eye, zero = tracks.dt, np.eye(2), np.zeros((2, 2))
    for positions, noise in zip(tracks.positions, tracks.noise, strict=True):
        engine = KalmanFilter(dim_x=4, dim_z=2)
        engine.F = np.block([[eye, dt * eye], [zero, eye]])
        engine.Q = 0.02 * np.block(
            [[dt**3 / 3 * eye, dt**2 / 2 * eye], [dt**2 / 2 * eye, dt * eye]]
        )
        engine.H, engine.R = np.eye(2, 4), noise
        engine.x = np.concatenate([positions[0], np.zeros(2)])
        engine.P = np.block([[noise, zero], [zero, eye]])
        for position in positions[1:]:
            engine.predict()
            engine.update(position)
        for _ in range(STEPS):
            engine.predict()


def measure(counts: tuple[int, ...], rounds: int, tick: Tick) -> list[Row]:
    """Time one call for all obstacles together: one row per candidate and number."""
    found = candidates()
    for one in found:  # imports what it needs: no part of any time, whatever it costs
        one.prepare(*walkers(1, seed=0))()
    rows = []
    for count in counts:
        tick(f"predictors, {count} obstacles")
        rows += _at(count, [one for one in found if one.expected(count) <= BUDGET], rounds)
    return rows


def _at(count: int, found: list[Candidate], rounds: int) -> list[Row]:
    """Time the candidates in turn, each until its budget is used up."""
    tracks, scene = walkers(count, seed=1)
    times: dict[str, list[float]] = {_key(one): [] for one in found}
    fell_back: dict[str, float | None] = {}
    by_key = {_key(one): one for one in found}
    calls = {key: one.prepare(tracks, scene) for key, one in by_key.items()}
    for turn in range(rounds + 1):
        for key in rotated(list(by_key), turn):
            if sum(times[key]) > BUDGET:
                continue
            time, fell_back[key] = timed(calls[key])
            # the first call imports what the predictor needs: it counts if that is little of it
            if turn or time > BUDGET:
                times[key].append(time)
    rows = []
    for key, one in by_key.items():
        best = min(times[key])
        one.history.append((count, best))
        row: dict[str, Any] = {"obstacles": count, "predictor": one.name, "engine": one.engine}
        row |= {"call": one.call} | brief(times[key], times[f"{REFERENCE}, own, predict"])
        for library in ("var, statsmodels", "kalman, filterpy"):
            known = times.get(f"{library}, predict")
            row[f"over_{library.split()[1]}"] = best / min(known) if known else None
        row["us_per_obstacle"] = 1e3 * row["median_ms"] / count
        rows.append(row | {"fell_back": fell_back[key]})
    return rows


def _key(one: Candidate) -> str:
    return f"{one.name}, {one.engine}, {one.call}"
