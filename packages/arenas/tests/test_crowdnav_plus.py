"""CrowdNav++: draws, trajectories, and every outcome of the original's own logs."""

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.engine.closed_loop import play
from wideberth.framework.controller import Controller, fresh
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation
from wideberth.packages.arenas.tests.oracles.crowd_robots import (
    CrowdNavPlusOrca,
    SocialForceRobot,
    plus_row,
)
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.sensing.channel import Channel
from wideberth_arenas.crowds import crowdnav_plus as rules
from wideberth_arenas.crowds.crowdnav_plus import CrowdNavPlusCrowd
from wideberth_arenas.scenarios.crowdnav_plus import CrowdNavPlus

pytest.importorskip("pyrvo")
QUIET = Settings(
    time_limit=50.0, plant_step=0.25, history=0.0, channel=Channel(noise=0.0), goal_tolerance=0.3
)
ROBOTS = {"orca": "orca", "sf": "social_force"}
WORDS = {"S": "success", "C": "collision", "T": "timeout"}


def read(folder: Path, name: str) -> Any:
    return json.loads((folder / f"crowdnavpp_{name}.json").read_text(encoding="utf-8"))


def driver(
    name: str, variant: rules.Variant, seed: int = 425
) -> CrowdNavPlusOrca | SocialForceRobot:
    return CrowdNavPlusOrca(variant, seed) if name == "orca" else SocialForceRobot()


@pytest.mark.parametrize("variant", ["plain", "random"])
def test_draws_are_those_of_the_original(variant: rules.Variant, dense_folder: Path) -> None:
    golden = read(dense_folder, "golden")[f"draws_{variant}"]
    assert golden
    for one in golden:
        crowd = CrowdNavPlusCrowd(one["case"], variant, one["seed"] - 1000 - one["case"])
        pairs = {
            "robot_start": crowd.robot,
            "robot_goal": crowd.robot_goal,
            "people_start": crowd.positions,
            "seen_at_0": crowd.seen,
            "v_pref": crowd.speeds,
            "radius": crowd.radii,
            "neighbour_distance_drawn": crowd.neighbour_distances,
        }
        for name in pairs.keys() & one.keys():
            np.testing.assert_allclose(pairs[name], one[name], rtol=0.0, atol=1e-11)
        np.testing.assert_array_equal(crowd.goals, -crowd.positions)


def test_trajectories_are_those_of_the_replica(dense_folder: Path) -> None:
    for one in read(dense_folder, "golden")["trajectories"]:
        crowd = CrowdNavPlusCrowd(one["case"], one["variant"], 425)
        robot, velocity = driver(one["robot"], one["variant"]), np.zeros(2)
        states = {state["time_s"]: state["robot_and_people"] for state in one["states"]}
        met = 0
        while True:
            if crowd.time in states:
                there = np.vstack([crowd.robot[None], crowd.positions])
                np.testing.assert_allclose(there, states[crowd.time], rtol=0.0, atol=1e-5)
                met += 1
            if crowd.verdict.outcome:
                break
            velocity = robot.act(crowd, velocity)
            crowd.step(crowd.robot + 0.25 * velocity)
        assert met == len(states)
        row = crowd.verdict_row()
        assert [row[name] for name in ("outcome", "time_s", "steps", "danger_steps")] == [
            one[name] for name in ("outcome", "time_s", "steps", "danger_steps")
        ]


def reference(key: str, seed: int, evaluations: range) -> list[dict[str, Any]]:
    """Rows of the robot and variant of a key such as ``sf_plain``."""
    robot, variant = key.split("_")
    scenario = build("scenarios", {"type": "crowdnav_plus", "variant": variant, "seed": seed})
    return [plus_row(scenario, k, ROBOTS[robot]) for k in evaluations]


def check_rows(folder: Path, key: str, evaluations: range) -> list[dict[str, Any]]:
    """Every case equal to the replica's, and its outcome to that of the original's log."""
    expected = read(folder, "expected")
    known, log = expected["replica"]["rows"][key], expected["logs"].get(key)
    rows = reference(key, known["seed"], evaluations)
    for k, row in zip(evaluations, rows, strict=True):
        case = 2 * k % 500
        assert row["outcome"] == WORDS[known["outcomes"][case]], case
        assert round(4 * row["time_s"]) == known["quarter_seconds"][case], case
        assert row["steps"] == known["steps"][case], case
        assert row["danger_steps"] == known["danger_steps"][case], case
        if log:
            assert (row["outcome"] == "collision") == (k in log["collision_cases"])
            assert (row["outcome"] == "timeout") == (k in log["timeout_cases"])
    return rows


def replicated(folder: Path) -> list[str]:
    return list(read(folder, "expected")["replica"]["rows"])


def test_first_cases_end_as_in_the_logs(dense_folder: Path) -> None:
    assert replicated(dense_folder)
    for key in replicated(dense_folder):
        check_rows(dense_folder, key, range(30))


@pytest.mark.slow
def test_the_published_rows_to_the_printed_digit(dense_folder: Path) -> None:
    """All 250 cases: means, counts, and that the second half of a log repeats the first."""
    expected = read(dense_folder, "expected")
    for key in replicated(dense_folder):
        rows = check_rows(dense_folder, key, range(250))
        log = expected["logs"][key]
        times = [row["time_s"] for row in rows if row["outcome"] == "success"]
        near = [row["intrusion_distance_m"] or 0.0 for row in rows]
        steps = [row["danger_steps"] for row in rows]
        found = {
            "success": np.mean([row["outcome"] == "success" for row in rows]),
            "collision": np.mean([row["outcome"] == "collision" for row in rows]),
            "timeout": np.mean([row["outcome"] == "timeout" for row in rows]),
            "nav_time_s": np.mean(times),
            "intrusion_percent": np.mean([row["intrusion_percent"] for row in rows]),
            "min_distance_m": np.average(near, weights=steps),
        }
        for name, value in found.items():
            assert round(float(value), 2) == log[name], name
        for name in ("collision_cases", "timeout_cases"):
            first = [k for k in log[name] if k < 250]
            assert sorted(log[name]) == first + [k + 250 for k in first]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variant", "cases", "robot", "numbers"),
    [
        ("random", "evaluated", "orca_informed", (0.796, 0.188, 0.016, 17.89)),
        ("plain", "all", "orca", (0.776, 0.222, 0.002, 15.60)),
    ],
)
def test_rows_that_no_log_has(
    variant: rules.Variant, cases: Any, robot: str, numbers: tuple[float, ...]
) -> None:
    """Known from an independent replica: a robot that knows the radii, and ORCA in "plain"."""
    scenario = CrowdNavPlus(variant=variant, cases=cases)
    count = 250 if cases == "evaluated" else 500
    rows = [plus_row(scenario, k, robot) for k in range(count)]
    outcomes = [row["outcome"] for row in rows]
    shares = [outcomes.count(name) / count for name in ("success", "collision", "timeout")]
    times = [row["time_s"] for row in rows if row["outcome"] == "success"]
    assert (*shares, round(float(np.mean(times)), 2)) == pytest.approx(numbers, abs=1e-9)


@dataclass
class Recorded(Controller):
    """Commands the velocities that are written down, and keeps what it observes."""

    velocities: list[np.ndarray]
    period: float = 0.25
    seen: list[Observation] = field(default_factory=list)

    @property
    def last_plan(self) -> None:
        return None

    def reset(self) -> None:
        self.seen = []

    def set_path(self, path: Any) -> None:
        pass

    def remember(self, observation: Observation) -> None:
        pass

    def command(self, observation: Observation) -> Command:
        self.seen.append(observation)
        x, y = self.velocities[len(self.seen) - 1]
        return Command((float(x), float(y)))


def driven(
    variant: rules.Variant, name: str, evaluation: int, settings: Settings = QUIET
) -> tuple[Episode, CrowdNavPlusCrowd, Recorded]:
    """One case in the engine, on the velocities of one of the original's robots."""
    scenario = CrowdNavPlus(variant=variant)
    crowd = CrowdNavPlusCrowd(2 * evaluation, variant, 425)
    robot, velocity, velocities = driver(name, variant), np.zeros(2), []
    while not crowd.verdict.outcome:
        velocity = robot.act(crowd, velocity)
        velocities.append(velocity)
        crowd.step(crowd.robot + 0.25 * velocity)
    body = build("robots", {"type": "holonomic_velocity", "radius": 0.3, "max_speed": 1.1})
    (placement,) = scenario.cast(evaluation).placements
    recorded = Recorded(velocities)
    agent = placement.agent(body, recorded, truth=False)
    run = scenario.cast(evaluation).begin([agent], settings, evaluation)
    run.advance()
    return run.episode(), crowd, recorded


@pytest.mark.parametrize(
    ("variant", "name", "evaluation"), [("random", "orca", 14), ("plain", "sf", 11)]
)
@pytest.mark.parametrize("plant_step", [0.25, 0.1])
def test_an_episode_is_the_case(
    variant: rules.Variant, name: str, evaluation: int, plant_step: float
) -> None:
    settings = Settings(
        time_limit=50.0, plant_step=plant_step, history=1.0, channel=Channel(noise=0.0)
    )
    episode, crowd, recorded = driven(variant, name, evaluation, settings)
    ends = {"success": "goals", "collision": "collision", "timeout": "time limit"}
    assert episode.ended == ends[crowd.verdict.outcome]
    assert episode.duration == pytest.approx(crowd.time, abs=1e-12)
    judged = CrowdNavPlus(variant=variant).judge(episode)
    for column, value in crowd.verdict_row().items():
        assert judged[column] == pytest.approx(value, abs=1e-9), column
    assert crowd.arrivals.any()
    assert len(episode.agents) == 21 + crowd.arrivals.sum()
    for slot, place in enumerate(crowd.positions, start=1):
        again = crowd.arrivals[slot - 1]
        log = episode.agent(f"person {slot} ({again + 1})" if again else f"person {slot}")
        np.testing.assert_allclose(log.positions[-1], place, atol=1e-9)
    check_sight(episode, recorded)
    assert Episode.from_bytes(episode.to_bytes()).verdict == episode.verdict


def check_sight(episode: Episode, recorded: Recorded) -> None:
    """Whoever was there before the instant is seen up to 5 m away, nobody else."""
    for seen in recorded.seen:
        asked, before = np.array([seen.stamp]), np.array([seen.stamp - 0.05])
        here = episode.at(episode.robots[0], asked)[0]
        near = set()
        for log in episode.agents:
            there = episode.at(log, asked)[0]
            was = seen.stamp == 0.0 or np.isfinite(episode.at(log, before)).all()
            if log.kind == "person" and was and np.hypot(*(there - here)) - 0.3 <= log.radius + 5:
                near.add(log.name)
        assert {one.ident for one in seen.detections} == near


def test_people_do_not_see_the_robot_but_places_are_drawn_around_it() -> None:
    """Until somebody comes anew, the crowd is the same whatever the robot does."""
    one, other = (CrowdNavPlusCrowd(0, "plain", 425) for _ in range(2))
    for _ in range(20):
        one.step(one.robot)
        other.step(other.robot + np.array([0.2, 0.0]))
        if one.arrivals.any():
            break
        np.testing.assert_array_equal(one.positions, other.positions)


def test_bad_input_gives_one_clear_error() -> None:
    for config, words in (
        ({"variant": "Random"}, "variant"),
        ({"cases": "even"}, "cases"),
        ({"phase": "train"}, "phase"),
        ({"shift": "running"}, "shift"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**31}, "seed"),
        ({"seed": 0.5}, "seed"),
    ):
        with pytest.raises(WideberthError, match=words):
            build("scenarios", {"type": "crowdnav_plus", **config})
    robot = build("robots", {"type": "holonomic_velocity", "radius": 0.3})
    controller = build("controllers", {"type": "orca", "robot": robot})
    with pytest.raises(WideberthError, match=r"channel\.delay"):
        play(CrowdNavPlus(), robot, controller, Settings(channel=Channel(delay=0.1)), 0)
    cast = CrowdNavPlus().cast(0)
    agent = cast.placements[0].agent(robot, controller, False)
    second = replace(agent, name="second", controller=fresh(controller))
    with pytest.raises(WideberthError, match="one robot"):
        cast.begin([agent, second], QUIET, 0)
