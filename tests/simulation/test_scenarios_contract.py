"""The laws of every registered scenario, and one short episode in each."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import pytest

from wideberth.experiments.engine.closed_loop import play
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot
from wideberth.framework.testing.laws import Law
from wideberth.framework.values.path import Path
from wideberth.routes.walls import box
from wideberth.simulation.engine.agents import Bystander, ReplayAgent, ScriptedAgent
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.measures.summary import summarise
from wideberth.simulation.scenarios import BUILT_IN
from wideberth.simulation.scenarios.antipodal_swap import AntipodalSwap
from wideberth.simulation.scenarios.base import Placement, Scenario
from wideberth.simulation.scenarios.checking import check_scenario
from wideberth.simulation.scenarios.overtaking import Overtaking
from wideberth.simulation.sensing.channel import Channel

RECORDED = {"start": [-9.0, 0.0, 0.0], "goal": [9.0, 0.0], "rows": [10, 30]}
CASES = {
    **{name: {} for name in BUILT_IN},
    "recorded_scene": {"robot_radius": 0.2, **RECORDED},
    "antipodal_swap, twenty": {"robots": 20},
    "corridor, narrow": {"width": 2.0, "persons": 4},
    "doorway, two robots": {"oncoming": "robot"},
    "pedestrian_corridor, both ways": {"layout": "both_ways"},
    "pedestrian_corridor, sixteen": {"layout": "16_random", "respawn": True},
    "pedestrian_corridor, gaussian": {"layout": "8_gaussian", "process_noise": 0.3},
    "random_crowd, dense": {"persons": 30, "density": 0.3},
    "sudden_change, stop": {"change": "stop"},
    "sudden_change, turn": {"change": "turn"},
    **{
        f"hallway, {layout}": {"layout": layout}
        for layout in ("static", "static_with_back", "bottleneck", "squeeze")
    },
}
EXCEPTIONS = {
    (
        "pedestrian_corridor, both ways",
        "other seeds, other situations",
    ): "its fields fix everything",
}
LAWS = [law.name for law in check_scenario.laws(Overtaking())]
QUIET = Settings(time_limit=2.0, plant_step=0.1, history=1.0, channel=Channel(noise=0.0))


def made(name: str) -> Scenario:
    if name.startswith(("random_crowd", "crowdnav")):
        pytest.importorskip("pyrvo")
    found = build("scenarios", {"type": name.partition(",")[0], **CASES[name]})
    assert isinstance(found, Scenario)
    return found


@lru_cache(maxsize=2)
def scenario_laws(name: str) -> dict[str, Law]:
    seeds = range(2) if name.startswith(("crossing_field", "hallway")) else range(6)
    return {law.name: law for law in check_scenario.laws(made(name), seeds)}


@pytest.mark.parametrize(("name", "law"), [(name, law) for name in CASES for law in LAWS])
def test_laws_hold(name: str, law: str) -> None:
    reason = EXCEPTIONS.get((name, law))
    if reason:
        pytest.skip(reason)
    scenario_laws(name)[law].check()


@pytest.mark.parametrize("name", CASES)
def test_an_episode_runs(name: str) -> None:
    scenario = made(name)
    robot: Robot = build("robots", {"type": "unicycle", "radius": scenario.robot_radius or 0.3})
    if name == "crossing_3d":
        pytest.skip("controllers without a horizon drive in the plane")
    controller = build("controllers", {"type": "constant_velocity", "robot": robot})
    episode = play(scenario, robot, controller, QUIET, 1)
    assert len(episode.robots) == len(scenario.cast(1).placements)
    assert all(np.isfinite(log.positions).all() for log in episode.robots)
    assert np.isfinite(summarise(episode)["duration"])


@dataclass(frozen=True)
class Broken(Scenario):
    """Every seed the same way, and what a test wants to be wrong."""

    forgetful: bool = False
    names: tuple[str, str] = ("one", "two")
    second: tuple[float, float] = (0.0, 3.0)
    block: tuple[float, float] = (9.0, 9.0)
    within: tuple[Bystander, ...] = ()

    def bystanders(self, rng: np.random.Generator, placements: tuple[Placement, ...]):
        return self.within

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        start = np.random.default_rng().random() if self.forgetful else 0.0
        ways = ([[start, 0.0], [5.0, 0.0]], [self.second, [5.0, 3.0]])
        return tuple(
            Placement(name, Path(np.array(way)), 0.5)
            for name, way in zip(self.names, ways, strict=True)
        )

    def polygons(self, rng: np.random.Generator):
        x, y = self.block
        return (box((x - 0.5, y - 0.5), (x + 0.5, y + 0.5), "block"),)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"forgetful": True}, "two casts"),
        ({"names": ("one", "one")}, "several"),
        ({"names": ("one", "block")}, "several"),
        ({"second": (0.5, 0.0)}, "one and two overlap by 0.1 m"),
        ({"block": (0.0, 0.7)}, "one is 0.1 m deep"),
        ({"block": (5.0, 0.7)}, "the goal of one"),
        ({}, "same situation"),
    ],
)
def test_check_finds_what_is_wrong(changes, message) -> None:
    check_scenario(Broken(), robot_radius=0.3, varied=False)
    with pytest.raises(AssertionError, match=message):
        check_scenario(replace(Broken(), **changes), robot_radius=0.3)


def test_only_a_recording_may_be_in_a_wall() -> None:
    places = np.full((2, 2), 9.0)
    recorded = ReplayAgent("recorded", np.array([-5.0, 5.0]), places, 0.3)
    check_scenario(Broken(within=(recorded,)), robot_radius=0.3, varied=False)
    walks = ScriptedAgent("walks", Path(np.array([(9.0, 9.0), (9.0, 5.0)])), 0.5, 0.3)
    with pytest.raises(AssertionError, match="walks is"):
        check_scenario(Broken(within=(walks,)), robot_radius=0.3, varied=False)


def test_other_fields_change_nothing_that_hangs_on_other_generators() -> None:
    one, wide = (Overtaking(width=width).cast(3) for width in (3.0, 4.0))
    assert np.array_equal(one.placements[0].path.points, wide.placements[0].path.points)
    few, many = (AntipodalSwap(robots=n).cast(3) for n in (4, 6))
    assert few.placements[0].phase == many.placements[0].phase
