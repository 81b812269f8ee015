"""Count decisions that ignore a person who was measured within the last seconds.

    python benchmarks/brief_sightings.py --recordings FOLDER
    python benchmarks/brief_sightings.py          # the synthetic plaza of the package

A robot drives among recorded people who do not give way. Detections have 1 cm of noise, their
stamps jitter, and some are dropped (`Channel`). A decision ignores a person whose newest
measurement is less than `FORGET` s old if the forecast behind the plan lacks the person, or has a
standard deviation above `WIDEST` at its first step. The share of such decisions must be 0.
"""

import argparse
import logging
from collections.abc import Iterator, Sequence

import numpy as np
from measuring import Row, markdown

from wideberth import Observation, Plan, recommended
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.tracking.perception import FORGET
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.scenarios.base import Scenario
from wideberth.simulation.scenarios.recorded_scene import SCENES, RecordedScene
from wideberth.simulation.sensing.channel import Channel

PREDICTORS = ("adaptive_conformal", "kalman")
"""The recommended planner's, and the one that it is recommended with among robots."""
JITTERS, DROPOUTS = (0.0, 0.01, 0.05), (0.0, 0.2)
"""s, and share of detections that are lost."""
WIDEST = 5.0
"""m, standard deviation along the widest axis."""
ROBOT = {
    **{"type": "unicycle", "radius": 0.3, "max_speed": 1.12, "max_yaw_rate": 1.2},
    **{"max_acceleration": 1.0, "max_yaw_acceleration": 2.0},
}
SPEED = 0.8
"""m/s, reference speed."""


def decisions(
    scenario: Scenario, planner: Planner, channel: Channel, seed: int, seconds: float
) -> Iterator[tuple[Observation, Plan | None]]:
    """Drive one episode, with the robot of the first placement; yield each decision."""
    settings = Settings(time_limit=seconds, history=0.0, goal_tolerance=0.6, channel=channel)
    cast = scenario.cast(seed)
    agents = [place.agent(planner.robot, planner, False) for place in cast.placements[:1]]
    run = cast.begin(agents, settings, seed)
    observation = run.advance(agents[0].name)
    while observation is not None:
        following = run.advance(agents[0].name)  # decides first
        yield observation, planner.last_plan
        observation = following


def ignored(
    episode: Iterator[tuple[Observation, Plan | None]],
) -> list[tuple[int, int, int]]:
    """Return for each decision the people measured lately, and of them the absent and the wide."""
    measured: dict[str, float] = {}
    counts = []
    for observation, plan in episode:
        now = observation.stamp
        measured |= {one.ident: now - one.age for one in observation.detections}
        recent = [name for name, time in measured.items() if now - time < FORGET - 1e-6]
        deviations = {} if plan is None else first_deviations(plan)
        absent = sum(name not in deviations for name in recent)
        wide = sum(deviations.get(name, 0.0) > WIDEST for name in recent)
        counts.append((len(recent), absent, wide))
    return counts


def first_deviations(plan: Plan) -> dict[str, float]:
    """Name -> largest standard deviation at the forecast's first step, m, of any mode."""
    if plan.forecast is None:
        return {}
    variances = np.linalg.eigvalsh(plan.forecast.covariance[:, :, 0])
    widest = np.sqrt(variances[..., -1].max(axis=1))
    return dict(zip(plan.tracked, widest.tolist(), strict=True))


def row_of(
    predictor: str, scenarios: Sequence[Scenario], channel: Channel, seeds: int, seconds: float
) -> Row:
    """Drive one planner through all scenarios with one channel; return what was counted."""
    counts = []
    for scenario in scenarios:
        for seed in range(seeds):
            planner = recommended(ROBOT, SPEED, predictor=predictor, quiet=True)
            counts += ignored(decisions(scenario, planner, channel, seed, seconds))
    people, absent, wide = np.array(counts).T
    return {
        "predictor": predictor,
        "jitter_ms": 1e3 * channel.jitter,
        "dropout": channel.dropout,
        "decisions": len(counts),
        "people": float(people.mean()),
        "absent": int(absent.sum()),
        "wide": int(wide.sum()),
        "share_of_decisions": float(np.mean(absent + wide > 0)),
    }


def scenarios_of(recordings: str | None) -> list[Scenario]:
    """Return the scenes of a folder of recordings, or the synthetic plaza."""
    if recordings is None:
        return [RecordedScene()]
    return [RecordedScene(recordings, scene=scene) for scene in SCENES]  # type: ignore[arg-type]


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Print the table, and return its rows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--recordings", help="folder of the ETH and UCY recordings")
    parser.add_argument("--seeds", type=int, default=1, help="episodes of each scene")
    parser.add_argument("--seconds", type=float, default=40.0, help="longest episode")
    parser.add_argument("--quick", action="store_true", help="a dry run of two seconds")
    options = parser.parse_args(words)
    logging.getLogger("wideberth").setLevel(logging.ERROR)  # not each plan that gives way
    seeds, seconds = (1, 2.0) if options.quick else (options.seeds, options.seconds)
    scenarios = scenarios_of(options.recordings)
    rows = [
        row_of(predictor, scenarios, Channel(0.01, dropout, jitter=jitter), seeds, seconds)
        for predictor in PREDICTORS
        for dropout in DROPOUTS
        for jitter in JITTERS
    ]
    print(markdown("People who were measured and are ignored", rows))
    return rows


if __name__ == "__main__":
    main()
