"""How far are forecasts of simulated people off? Prints a table of docs/people.md.

    python benchmarks/crowd_forecasts.py

People of `random_crowd` walk among each other and a robot that avoids by ORCA. From 6 s on every
2 s each predictor forecasts all of them, from positions every 0.2 s measured with an error of
1 cm, and (one that asks for it) from where the robot goes in the next 5 s. The error is the
mean distance over the first 2 s, and the time is processor time of one call, `update` included.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import process_time
from typing import Any

import numpy as np

from wideberth.framework.metrics.scoring import reached_tail
from wideberth.framework.plugins.config import build
from wideberth.framework.predictor import Adaptive, Predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.scenarios.random_crowd import RandomCrowd
from wideberth.simulation.sensing.channel import Channel

DT, NOISE, PAST, STEPS, SCORED = 0.2, 0.01, 20, 25, 10
"""s, m, and numbers of samples: seen, forecast, and scored."""
BEGIN, EVERY, LIMIT = 6.0, 2.0, 16.0
"""s: of the first forecast, between two, and of an episode."""
ROBOT = {
    "type": "unicycle", "radius": 0.3, "max_speed": 1.0, "max_yaw_rate": 1.0,
    "max_acceleration": 0.7, "max_yaw_acceleration": 1.0,
}  # fmt: skip
PREDICTORS: dict[str, Any] = {
    "kalman": "kalman",
    "kalman, q = 0.005": {"type": "kalman", "acceleration_density": 0.005},
    "kalman, q = 0.1": {"type": "kalman", "acceleration_density": 0.1},
    "reacting_people": "reacting_people",
    "calibrated": {"type": "adaptive_conformal", "base": "reacting_people"},
    "social_attention": "social_attention",
}


@dataclass
class Scores:
    """Of one predictor and one crowd: errors (m) by seed and by kind, inside 95 %, and s."""

    seeds: list[float] = field(default_factory=list)
    kinds: dict[str, list[float]] = field(default_factory=dict)
    inside: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)


def crowd(persons: int, density: float, seed: int) -> tuple[Episode, tuple[str, ...]]:
    """Return an episode, the robot first, and the kinds of the people."""
    cast = RandomCrowd(persons=persons, density=density).cast(seed)
    pilot = build("controllers", {"type": "orca", "robot": ROBOT, "reference_speed": 0.7}, "robot")
    robots = [place.agent(pilot.robot, pilot, False) for place in cast.placements]
    settings = Settings(time_limit=LIMIT, history=4.0, channel=Channel(noise=NOISE))
    episode = run_episode([*robots, *cast.people], settings, seed=seed)
    return episode, tuple(type(one.controller).__name__ for one in cast.people)


def sampled(episode: Episode, seed: int) -> tuple[Array, Array, Array]:
    """Return times (T,), s, and where everybody was and was measured then, (O, T, 2), m."""
    grid = DT * np.arange(int(episode.times[-1] / DT) + 1)
    true = np.array([
        np.stack([np.interp(grid, episode.times, axis) for axis in one.positions.T], axis=1)
        for one in episode.agents
    ])  # fmt: skip
    return grid, true, true + NOISE * np.random.default_rng(seed).standard_normal(true.shape)


def measure(
    predictors: Mapping[str, Predictor], episode: Episode, kinds: Sequence[str], seed: int
) -> dict[str, Scores]:
    """Let each predictor forecast one episode."""
    grid, true, seen = sampled(episode, seed)
    radius = np.array([one.radius for one in episode.agents])
    found = {name: Scores() for name in predictors}
    for name, first in predictors.items():
        current, errors = first, list[Array]()
        for row in range(1, len(grid) - STEPS):
            ids = tuple(one.name for one in episode.agents[1:])
            noise = np.tile(NOISE**2 * np.eye(2), (len(ids), 1, 1))
            past = seen[1:, max(0, row + 1 - PAST) : row + 1]
            tracks = Tracks(past, DT, ids, radius[1:], noise, float(grid[row]))
            ahead = slice(row, row + STEPS + 1)
            scene = Scene(plan=true[0, ahead], plan_times=grid[ahead], radius=float(radius[0]))
            begin = process_time()
            if isinstance(current, Adaptive):
                current = current.update(tracks, scene)
            if grid[row] < BEGIN or row % round(EVERY / DT):
                continue
            said = current.predict(tracks, STEPS, scene)
            found[name].seconds.append(process_time() - begin)
            mean, wanted = said.mean[:, 0], true[1:, row + 1 : row + 1 + STEPS]
            errors.append(np.linalg.norm(mean - wanted, axis=2)[:, :SCORED].mean(axis=1))
            tail = reached_tail(said.mean, said.covariance, said.weight, wanted)
            found[name].inside.append(float((tail[:, SCORED - 1] >= 0.05).mean()))
        if errors:
            table = np.array(errors)
            found[name].seeds.append(float(table.mean()))
            for kind, column in zip(kinds, table.T, strict=True):
                found[name].kinds.setdefault(kind, []).extend(column.tolist())
    return found


def compare(
    persons: int, density: float, seeds: Sequence[int], names: Mapping[str, Any]
) -> dict[str, Scores]:
    """Measure all predictors on all seeds of one density."""
    predictors = {name: build("predictors", value, name) for name, value in names.items()}
    total = {name: Scores() for name in predictors}
    for seed in seeds:
        episode, kinds = crowd(persons, density, seed)
        for name, one in measure(predictors, episode, kinds, seed).items():
            total[name].seeds += one.seeds
            total[name].inside += one.inside
            total[name].seconds += one.seconds
            for kind, values in one.kinds.items():
                total[name].kinds.setdefault(kind, []).extend(values)
    return total


def interval(first: Sequence[float], second: Sequence[float]) -> tuple[float, float, float]:
    """Relative difference of the means, and its 95 % bootstrap interval over the seeds."""
    one, two = np.array(first), np.array(second)
    draws = np.random.default_rng(0).integers(len(one), size=(2000, len(one)))
    ratios = one[draws].mean(axis=1) / two[draws].mean(axis=1) - 1.0
    low, high = np.quantile(ratios, (0.025, 0.975))
    return float(one.mean() / two.mean() - 1.0), float(low), float(high)


def main(
    cells: Sequence[tuple[int, float]] = ((5, 0.05), (10, 0.1), (20, 0.2)),
    seeds: Sequence[int] = range(200, 220),
) -> None:
    """Print a line for each predictor and density."""
    kinds = ("ConstantVelocity", "SocialForce", "Orca")
    print("people, predictor, error (m), against kalman, by kind (m), inside 95 %, ms per call")
    for persons, density in cells:
        found = compare(persons, density, seeds, PREDICTORS)
        for name, one in found.items():
            share, low, high = interval(one.seeds, found["kalman"].seeds)
            parts = ", ".join(f"{np.mean(one.kinds.get(kind, [np.nan])):.3f}" for kind in kinds)
            words = f"{persons:3d}  {name:20s} {np.mean(one.seeds):.3f}"
            words += f"  {100 * share:+.0f} % ({100 * low:+.0f} to {100 * high:+.0f})  {parts}"
            words += f"  {100 * np.mean(one.inside):.0f} %  {1e3 * np.median(one.seconds):.1f}"
            print(words, flush=True)


if __name__ == "__main__":
    main()
