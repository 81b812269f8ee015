"""CrowdSimPlus: draws, the head start, and every row that its own code gave."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.engine.closed_loop import play
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation
from wideberth.packages.arenas.tests.oracles.crowd_robots import CrowdSimPlusOrca, simple_row
from wideberth.simulation.crowds.hall import Layout
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.sensing.channel import Channel
from wideberth_arenas.crowds.crowdsimplus import (
    CrowdSimPlusCrowd,
    Kind,
    hall_of,
)
from wideberth_arenas.scenarios.crowdsimplus import CrowdSimPlus

pytest.importorskip("pyrvo")
QUIET = Settings(time_limit=16.0, plant_step=0.25, history=0.0, channel=Channel(noise=0.0))


def read(folder: Path, name: str) -> Any:
    return json.loads((folder / f"crowdsimplus_{name}.json").read_text(encoding="utf-8"))


def test_walls_are_those_of_the_original_in_its_order(dense_folder: Path) -> None:
    for layout, golden in read(dense_folder, "golden")["layouts"].items():
        np.testing.assert_allclose(hall_of(layout).lines(), golden["walls"], rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("attributes", [True, False])
def test_draws_and_the_state_at_time_0(dense_folder: Path, attributes: bool) -> None:
    key = "attributes_drawn" if attributes else "attributes_fixed"
    for layout, golden in read(dense_folder, "golden")["layouts"].items():
        for one in golden[key]:
            drawn = one["people"]
            kinds: tuple[tuple[Kind, float], ...] = (("sfm", 1e-9), ("orca_plus", 1e-6))
            for kind, exact in kinds:
                crowd = CrowdSimPlusCrowd(one["case"], layout, kind, attributes=attributes)
                for mine, name in (
                    (crowd.starts, "start"), (crowd.goals, "goal"), (crowd.speeds, "v_pref"),
                ):  # fmt: skip
                    np.testing.assert_allclose(
                        mine, [person[name] for person in drawn], rtol=0.0, atol=1e-11
                    )
                people = one["at_time_0"][kind]
                for mine, name in (
                    (crowd.positions, "position"),
                    (crowd.velocities, "velocity"),
                    (crowd.heads, "heads_for"),
                ):
                    np.testing.assert_allclose(
                        mine, [person[name] for person in people], rtol=0.0, atol=exact
                    )


def test_every_row_of_the_reference(dense_folder: Path) -> None:
    """All cases of all rows, and their summaries to the printed digit."""
    reference = read(dense_folder, "reference")
    columns = reference["columns"]
    assert reference["rows"]
    for key, expected in reference["rows"].items():
        layout, kind = key.split()
        scenario = CrowdSimPlus(layout=layout, people_kind=kind)
        rows = [simple_row(scenario, case) for case in range(len(expected))]
        assert [[int(row[name]) if name != "nav_time_s" else row[name] for name in columns]
                for row in rows] == expected  # fmt: skip
        times = [row["nav_time_s"] for row in rows if row["success"]]
        summary = reference["summaries"][key]
        found = {
            "success": np.mean([row["success"] for row in rows]),
            "nav_time": np.mean(times),
            "nav_time_all": np.mean([row["nav_time_s"] for row in rows]),
            "coll_cases": 1.0 - np.mean([row["clean"] for row in rows]),
            "wall_cases": np.mean([row["num_wall_collisions"] > 0 for row in rows]),
            "coll_freq": np.mean([row["coll_freq"] for row in rows]),
            "wall_freq": np.mean([row["wall_coll_freq"] for row in rows]),
            "frozen_freq": np.mean([row["frozen_freq"] for row in rows]),
        }
        for name, value in found.items():
            assert value == pytest.approx(summary[name], abs=6e-5), (key, name)


@dataclass
class Scripted(Controller):
    """Commands what is written down, the last of it for ever."""

    commands: list[Command]
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
        return self.commands[min(len(self.seen), len(self.commands)) - 1]


def driven(
    scenario: CrowdSimPlus, seed: int, robot: Robot, commands: list[Command], settings: Settings
) -> Episode:
    """An episode of a robot that follows a list of commands."""
    cast = scenario.cast(seed)
    agent = cast.placements[0].agent(robot, Scripted(commands), truth=False)
    run = cast.begin([agent], settings, seed)
    run.advance()
    return run.episode()


@pytest.mark.parametrize(
    ("layout", "kind", "case"),
    [("squeeze", "orca_plus", 5), ("static", "sfm", 3), ("bottleneck", "orca_plus", 1)],
)
def test_an_episode_is_the_case(layout: Layout, kind: Kind, case: int) -> None:
    """The reference robot's own commands, in the engine: the same row, the same places."""
    scenario = CrowdSimPlus(layout=layout, people_kind=kind)
    crowd, robot, commands = CrowdSimPlusCrowd(case, layout, kind), CrowdSimPlusOrca(), []
    while not crowd.verdict.outcome:
        velocity = robot.act(crowd)
        commands.append(Command((float(velocity[0]), float(velocity[1]))))
        wanted = crowd.robot + 0.25 * velocity
        reached = crowd.stop(crowd.robot, wanted, 0.25)
        crowd.step(reached, stopped=bool(reached[0] != wanted[0]))
    body = build("robots", {"type": "holonomic_velocity", "radius": 0.25, "max_speed": 1.1})
    episode = driven(scenario, case, body, commands, QUIET)
    assert scenario.judge(episode) == crowd.verdict_row() == simple_row(scenario, case)
    assert episode.ended == ("goals" if crowd.verdict.outcome == "success" else "time limit")
    np.testing.assert_allclose(episode.robots[0].positions[-1], crowd.robot, atol=1e-9)
    for slot, place in enumerate(crowd.positions, start=1):
        log = episode.agent(f"person {slot}")
        np.testing.assert_allclose(log.positions[-1], place, atol=1e-6)


@pytest.mark.parametrize("plant_step", [0.25, 0.05])
def test_walls_stop_a_robot_with_a_heading(plant_step: float) -> None:
    """It drives into the wall beside it: no nearer than its radius, its speed gone."""
    limits = {"max_yaw_rate": 2.0, "max_acceleration": 2.0, "max_yaw_acceleration": 20.0}
    robot = build("robots", {"type": "unicycle", "radius": 0.25, "max_speed": 0.95, **limits})
    scenario = CrowdSimPlus(layout="open", people_kind="sfm")
    settings = Settings(
        time_limit=6.0, plant_step=plant_step, history=0.0, channel=Channel(noise=0.0)
    )
    turn, ahead = Command((0.3, 0.0), -2.0), Command((0.9, 0.0), 0.0)
    episode = driven(scenario, 0, robot, [turn, turn, turn, ahead], settings)
    (log,) = episode.robots
    assert log.positions[:, 0].max() <= 0.75 + 1e-9
    assert log.positions[-1, 0] > 0.7 and log.speeds[-1] < 0.05
    judged = scenario.judge(episode)
    assert judged["num_wall_collisions"] >= 5 and judged["num_frozen"] >= 5
    assert not judged["success"]


def stopped_by_steps(crowd: CrowdSimPlusCrowd, place: np.ndarray, wanted: np.ndarray) -> float:
    """Share of the way that keeps the disc off every wall, by trying small steps."""
    shares = np.linspace(0.0, 1.0, 2001)
    ways = (place + shares[:, None] * (wanted - place))[:, None]
    begin, along = crowd.lines[:, 0], crowd.lines[:, 1] - crowd.lines[:, 0]
    foot = np.clip(((ways - begin) * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    apart = np.linalg.norm(begin + foot[..., None] * along - ways, axis=-1).min(axis=1)
    inside = apart < 0.3 - 1e-6
    return float(shares[inside.argmax()]) if inside.any() else 1.0


@pytest.mark.parametrize("layout", ["static", "bottleneck", "squeeze"])
def test_a_way_is_shortened_to_where_the_wall_is_met(layout: Layout) -> None:
    """Against small steps along the way, from free places.

    The rule knows the nearest pair of points alone: where a corner and a side follow each other
    it may stop earlier, never later.
    """
    rng = np.random.default_rng(5)
    crowd = CrowdSimPlusCrowd(0, layout, "sfm")
    exact = met = 0
    while met < 40:
        place, angle = rng.uniform([-0.6, -1.8], [0.6, 1.8]), rng.uniform(0.0, 2.0 * np.pi)
        wanted = place + 0.375 * np.array([np.cos(angle), np.sin(angle)])
        if stopped_by_steps(crowd, place, place) < 1.0:
            continue  # in a wall
        share = stopped_by_steps(crowd, place, wanted)
        end = crowd.stop(place, wanted, 0.3)
        gone = float(np.linalg.norm(end - place) / 0.375)
        if share == 1.0:
            assert end is wanted
            continue
        met += 1
        assert gone <= share + 1e-3
        exact += gone >= share - 2e-3
    assert exact >= 30


def test_bad_input_gives_one_clear_error() -> None:
    for config, words in (
        ({"layout": "funnel"}, "layout"),
        ({"people_kind": "orca"}, "people_kind"),
        ({"attributes": "drawn"}, "attributes"),
        ({"persons": 4}, "persons"),
    ):
        with pytest.raises(WideberthError, match=words):
            build("scenarios", {"type": "crowdsimplus", **config})
    robot = build("robots", {"type": "unicycle", "radius": 0.25})
    planner = {"type": "mpc", "robot": "unicycle", "predictor": "kalman", "solver": "fatrop",
               "region": "mahalanobis_ellipse", "level": "fixed"}  # fmt: skip
    with pytest.raises(WideberthError, match="static_region"):
        play(CrowdSimPlus(), robot, build("controllers", planner), QUIET, 0)
