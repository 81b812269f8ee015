"""The cascade: ideal stages are the truth, runs repeat to the byte, bad settings are refused."""

import hashlib
import subprocess
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError, recommended
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import Run, run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.summary import summarise
from wideberth.simulation.scenarios.crossing import Crossing
from wideberth_perception.cascade.cascade import SensingPipeline
from wideberth_perception.cascade.faults import Faults
from wideberth_perception.cascade.measures import perception_row
from wideberth_perception.cascade.world import WheeledWorld
from wideberth_perception.detection.discs import DiscDetector
from wideberth_perception.physics.body import SkidSteerBody
from wideberth_perception.physics.sensors import Lidar
from wideberth_perception.state.ekf import Ekf
from wideberth_perception.state.scan_matching import ScanMatching
from wideberth_perception.tracking.nearest import Nearest

pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
IDEAL = SensingPipeline(mechanics="kinematic", noise=0.0)
SHORT = Settings(history=0.0, time_limit=6.0)


def whole(**changes: Any) -> SensingPipeline:
    """Return a cascade that senses all that it knows."""
    return replace(
        SensingPipeline(
            state=Ekf(wheel_radius=0.165, noise="large"),
            detector=DiscDetector(shape=(0.75,)),
            tracker=Nearest(acceleration_density=0.02),
        ),
        **changes,
    )


class Bends(Controller):
    """Drives bends, and keeps what it was told."""

    period = 0.5

    def __init__(self) -> None:
        self.seen: list[Observation] = []
        self.told: list[Observation] = []

    def reset(self) -> None:
        self.seen, self.told = [], []

    def set_path(self, path: Path) -> None:
        pass

    def remember(self, observation: Observation) -> None:
        self.told.append(observation)

    def command(self, observation: Observation) -> Command:
        self.seen.append(observation)
        speed = min(0.1 * len(self.seen), 0.4)
        return Command((speed, 0.0), 0.02 * (-1.0) ** (len(self.seen) // 4), 0.5)

    @property
    def last_plan(self) -> Plan | None:
        return None


def bending(name: str, start: tuple[float, float], goal: tuple[float, float]) -> RobotAgent:
    way = Path(np.array([start, goal]))
    return RobotAgent(name, Unicycle(), Bends(), way, 0.0, reference_speed=0.5)


def pair() -> list[RobotAgent]:
    return [bending("one", (0.0, 0.0), (20.0, 0.0)), bending("two", (8.0, 2.0), (-9.0, 3.0))]


def run(
    cascade: SensingPipeline, agents: list[RobotAgent], **more: Any
) -> tuple[Episode, WheeledWorld]:
    settings = more.pop("settings", SHORT)
    world = WheeledWorld(cascade, settings)
    one = Run(agents, settings, more.get("seed", 0), (), (), more.get("polygons", ()), world)
    one.advance()
    return one.episode(), world


def observed(agent: RobotAgent) -> Bends:
    assert isinstance(agent.controller, Bends)
    return agent.controller


def test_with_ideal_stages_all_that_is_told_is_true() -> None:
    agents = pair()
    episode, _ = run(IDEAL, agents)
    for agent, other in (agents, agents[::-1]):
        log = episode.agent(agent.name)
        told = observed(agent).told
        assert len(told) == pytest.approx(10.0 * episode.duration, abs=1.0)  # turns of the LiDAR
        for one in (*observed(agent).seen, *told):
            instant = np.array([one.stamp])
            assert np.allclose(one.state[:2], episode.at(log, instant)[0], atol=1e-9)
            for seen in one.detections:
                assert seen.ident == other.name and 0.0 <= seen.age <= 0.1 + 1e-9
                then = max(one.stamp - seen.age, 0.0)
                truth = episode.at(episode.agent(other.name), np.array([then]))[0]
                assert np.allclose(seen.position, truth, atol=1e-9)


def test_the_newest_scan_is_told_with_the_place_it_was_made_at() -> None:
    agents = pair()
    episode, _ = run(whole(state=None), agents, settings=replace(SHORT, time_limit=3.0))
    log, other = episode.agent("one"), episode.agent("two")
    for one in observed(agents[0]).seen[1:]:
        assert one.scan is not None
        scan, pose = one.scan.scan, one.scan.pose
        then = (
            np.array([scan.stamp]) - whole().rest
        )  # the sensors' clock begins before the episode
        assert -0.1 - 1e-9 <= then - one.stamp <= 1e-9
        assert np.allclose(pose[:2], episode.at(log, then)[0], atol=5e-3)
        angle = pose[2] + scan.bearings[scan.met]
        ends = pose[:2] + scan.ranges[scan.met, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
        apart = np.linalg.norm(ends - episode.at(other, then)[0], axis=1)
        assert len(apart) > 5 and np.abs(apart - 0.75).max() < 0.12


def test_ideal_wheels_drive_as_the_planners_own_model() -> None:
    """The smoother's output is held for a step of 20 ms: half a step of the change of speed."""
    episode, _ = run(IDEAL, pair())
    exact = run_episode(pair(), SHORT)
    for log, other in zip(episode.agents, exact.agents, strict=True):
        apart = np.abs(episode.at(log, exact.times) - other.positions).max()
        assert apart < 0.5 * 0.02 * 0.4 + 1e-3
        assert np.abs(np.unwrap(log.headings)[-1] - np.unwrap(other.headings)[-1]) < 0.01


def crossing(cascade: SensingPipeline | None) -> dict[str, Any]:
    """Let the recommended planner cross; without a cascade positions are exchanged."""
    settings, cast = Settings(history=0.0), Crossing().cast(0)
    agents = []
    for place in cast.placements:
        agent = place.agent(Unicycle(), recommended(Unicycle(), 0.5), False)
        agents.append(replace(agent, speed=0.0, reference_speed=agent.reference))
    if cascade is None:
        return summarise(run_episode(agents, settings), 0.05)
    return summarise(run(cascade, agents, settings=settings)[0], 0.05)


def test_ideal_stages_cross_as_with_exchanged_positions() -> None:
    exact, ideal = crossing(None), crossing(IDEAL)
    assert exact["ended"] == ideal["ended"] == "goals"
    assert ideal["first"] == exact["first"] and not ideal["errors"]
    assert ideal["clearance"] == pytest.approx(exact["clearance"], abs=0.1)
    assert ideal["duration"] == pytest.approx(exact["duration"], abs=1.0)


def test_what_is_perceived_is_near_the_truth() -> None:
    row = perception_row(run(whole(), pair())[0])
    assert row["own_error"] < 0.05 and row["detection_error"] < 0.05
    assert row["track_error"] < 0.05 and row["speed_error"] < 0.2
    assert row["identities"] < 1.6 and row["false_tracks"] < 0.1


def digest() -> str:
    episode, _ = run(whole(), pair(), seed=3, settings=replace(SHORT, time_limit=3.0))
    written = episode.to_bytes()
    assert Episode.from_bytes(written).to_bytes() == written
    return hashlib.sha256(written).hexdigest()


def test_the_same_seed_gives_the_same_bytes_in_any_process() -> None:
    script = f"import sys; sys.path.insert(0, {sys.path[0]!r}); import {__name__} as one; "
    script += "print(one.digest())"
    other = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert other.stdout.split()[-1] == digest()


def test_walls_that_are_seen_are_kept_clear_of_as_those_that_are_known() -> None:
    """The way leads through a wall that is too wide for the planner to find around."""
    robot, stands = Unicycle(), []
    wall = Polygon(((3.0, -4.0), (3.5, -4.0), (3.5, 2.0), (3.0, 2.0)), "wall")
    for walls in ("known", "seen"):
        settings = describe(recommended(robot, 0.5, quiet=True))
        planner = build("controllers", {**settings, "static_region": "separating_line"})
        way = Path(np.array([[0.0, 0.0], [12.0, 0.0]]))
        agent = RobotAgent("one", robot, planner, way, 0.0, reference_speed=0.5)
        limit = Settings(history=0.0, time_limit=12.0)
        episode, _ = run(whole(walls=walls), [agent], settings=limit, polygons=[wall])
        assert not summarise(episode, 0.05)["errors"]
        stands.append(episode.robots[0].positions[-1])
    gaps = [3.0 - robot.radius - float(place[0]) for place in stands]
    assert all(0.05 < gap < 0.4 for gap in gaps)
    assert gaps[1] == pytest.approx(gaps[0], abs=0.05)


def test_a_map_bounds_the_drift_of_a_robot_that_is_told_of_the_others() -> None:
    wall = Polygon(((-3.0, -6.0), (12.0, -6.0), (12.0, -5.8), (-3.0, -5.8)), "long")
    end = Polygon(((9.0, -4.0), (9.2, -4.0), (9.2, 4.0), (9.0, 4.0)), "end")
    odometry = Ekf(wheel_radius=0.165, noise="large")
    errors = []
    for state in (odometry, ScanMatching((wall, end), odometry)):
        off = Faults(gyro_step=(0.0, 0.03))
        stages = SensingPipeline(state=state, faults=off)
        episode, world = run(stages, pair()[:1], polygons=[wall, end])
        last = episode.perception["one"].glances[-1]
        errors.append(float(np.linalg.norm(last.own.pose[:2] - last.truth.pose[:2])))
        assert last.own.frame == world.senses["one"].estimator.at(2.0).frame
    assert errors[1] < 0.03 < 2.0 * errors[1] + 0.03 < errors[0]


def test_who_comes_and_goes_is_seen_while_there() -> None:
    times = np.array([0.0, 2.0, 4.0, 6.0])
    places = np.array([[np.nan] * 2, [4.0, -1.0], [4.0, 1.0], [np.nan] * 2])
    other = ReplayAgent("other", times, places, 0.75)
    world = WheeledWorld(whole(), SHORT)
    one = Run([bending("one", (0.0, 0.0), (20.0, 0.0))], SHORT, 0, (other,), (), (), world)
    one.advance()
    tracked = {
        round(glance.truth.time, 1): [name for name in glance.names.values() if name]
        for glance in one.episode().perception["one"].glances
    }
    assert any(tracked[time] == ["other"] for time in tracked if 2.5 < time < 3.9)
    assert not any(names for time, names in tracked.items() if time < 2.0 or time > 5.5)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"walls": "felt"}, "cascade.walls is 'felt'"),
        ({"walls": "seen"}, "give the cascade a detector"),
        ({"body": "larg"}, "did you mean 'large'"),
        ({"mechanics": "hover"}, "wanted one of physics, slip, kinematic"),
        ({"mechanics": "slip", "body": SkidSteerBody(mass=20.0)}, "no slip model was fitted"),
        ({"noise": -1.0}, "cascade.noise is -1"),
        ({"rest": 0.0}, "cascade.rest is 0"),
        ({"lidar": Lidar(rate=4.0)}, "lidar.rate is 4 Hz; wanted more than two samples"),
        ({"handover": "smoothed"}, "cascade.handover is 'smoothed'"),
    ],
    ids=lambda one: next(iter(one)) if isinstance(one, dict) else "",
)
def test_bad_stages_are_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        SensingPipeline(**changes)


def test_settings_that_stand_for_sensors_are_refused() -> None:
    with pytest.raises(WideberthError, match="set history: 0"):
        WheeledWorld(IDEAL, Settings())


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speed": 0.5}, "begin at rest"),
        ({"robot": Unicycle(radius=0.3)}, "give the robot radius: 0.75"),
    ],
    ids=["speed", "radius"],
)
def test_robots_that_cannot_be_there_are_refused(changes: dict[str, Any], words: str) -> None:
    one, two = pair()
    with pytest.raises(WideberthError, match=words):
        run(IDEAL, [replace(one, **changes), two])
