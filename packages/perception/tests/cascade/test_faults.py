"""Every fault ends in a safe stop with its reason, never in an exception."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError, recommended
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.sensing import Scan
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.sensing.perceived import WheelSample
from wideberth_perception.cascade.cascade import SensingPipeline
from wideberth_perception.cascade.faults import Faults
from wideberth_perception.cascade.senses import Watchdog
from wideberth_perception.cascade.world import WheeledWorld
from wideberth_perception.detection.discs import DiscDetector
from wideberth_perception.state.ekf import Ekf
from wideberth_perception.tracking.nearest import Nearest

pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")


class Ahead(Controller):
    """Drives straight on at 0.4 m/s, and keeps what it was told."""

    period = 0.5

    def reset(self) -> None:
        self.seen: list[Observation] = []

    def set_path(self, path: Path) -> None:
        pass

    def remember(self, observation: Observation) -> None:
        pass

    def command(self, observation: Observation) -> Command:
        self.seen.append(observation)
        return Command((min(0.1 * len(self.seen), 0.4), 0.0), ramp=0.5)

    @property
    def last_plan(self) -> Plan | None:
        return None


def run(faults: Faults, seconds: float, **stages: Any) -> tuple[Episode, list[Observation]]:
    """Two robots drive side by side; the faults are those of the first."""
    cascade = SensingPipeline(
        state=Ekf(wheel_radius=0.165, noise="large"),
        detector=DiscDetector(shape=(0.75,)),
        tracker=Nearest(acceleration_density=0.02),
        faults=replace(faults, robots=("one",)),
    )
    cascade = replace(cascade, **stages)
    settings = Settings(history=0.0, time_limit=seconds, plant_step=0.04)
    agents = [
        RobotAgent(name, Unicycle(), Ahead(), Path(np.array([[0.0, y], [50.0, y]])), 0.0)
        for name, y in (("one", 0.0), ("two", 4.0))
    ]
    agents = [replace(agent, reference_speed=0.4) for agent in agents]
    one = Run(agents, settings, 0, (), (), (), WheeledWorld(cascade, settings))
    one.advance()
    first = agents[0].controller
    assert isinstance(first, Ahead)
    return one.episode(), first.seen


def standing(episode: Episode, time: float) -> bool:
    """Whether the first robot stands at a time, s."""
    speeds = episode.agents[0].speeds
    return bool(np.interp(time, episode.times, speeds) < 0.02)


BLIND = "lidar: nothing of use for more than 0.5 s"


@pytest.mark.parametrize(
    ("faults", "stages", "reason"),
    [
        (Faults(blind=(3.0, 5.0)), {}, BLIND),
        (Faults(silent=("lidar", 3.0, 5.0)), {}, BLIND),
        (Faults(silent=("imu", 3.0, 5.0)), {}, "imu: nothing of use for more than 0.5 s"),
        (Faults(silent=("encoders", 3.0, 5.0)), {}, "encoders: nothing of use for more than"),
        (Faults(silent=("encoders", 3.0, 5.0)), {"detector": None}, "encoders: nothing of use"),
    ],
    ids=["NaN", "no scans", "no inertial unit", "no wheels", "no wheels, positions told"],
)
def test_a_robot_without_a_sensor_stops_and_drives_on_with_it(
    faults: Faults, stages: dict[str, Any], reason: str
) -> None:
    episode, _ = run(faults, 8.0, **stages)
    (stop, *more), others = episode.perception["one"].stops, episode.perception["two"].stops
    assert stop.reason.startswith(reason) and not others
    assert stop.begin == pytest.approx(3.5, abs=0.15) and stop.end == pytest.approx(5.0, abs=0.15)
    assert standing(episode, stop.end) and not standing(episode, 3.0)
    assert not more and not standing(episode, 8.0)


@pytest.mark.parametrize("jump", [5.0, -5.0, 0.7], ids=["ahead", "back", "a little"])
def test_a_clock_that_is_set_stops_the_robot_until_it_knows_its_motion(jump: float) -> None:
    episode, seen = run(Faults(jump=(3.0, jump)), 9.0)
    log = episode.perception["one"]
    set_, again = log.stops
    assert set_.reason == f"the clock was set by {jump:g} s" and set_.begin < 3.1
    assert again.reason == "the gyroscope is calibrated anew"
    assert standing(episode, again.begin) and not standing(episode, 9.0)
    last = log.glances[-1]
    assert len(last.obstacles) == 1 and last.names[last.obstacles[0].ident] == "two"
    assert abs(last.own.time - last.truth.time) < 0.01
    assert np.linalg.norm(last.own.pose[:2] - last.truth.pose[:2]) < 0.5  # the way of braking
    assert all(0.0 <= d.age < 1.0 for one in seen for d in one.detections)
    assert log.notes and len(log.notes) < 10  # hundreds of samples came at a wrong time


def test_a_robot_that_is_pushed_over_stays_where_it_lies() -> None:
    episode, _ = run(Faults(push=(2.0, 20.0)), 5.0)
    (stop,) = episode.perception["one"].stops
    assert stop.reason.startswith("pushed over: ") and stop.begin < 3.5 and stop.end == 5.0
    assert standing(episode, 5.0) and not episode.perception["two"].stops


def test_a_wheel_without_grip_is_felt_and_the_robot_still_knows_its_way() -> None:
    episode, _ = run(Faults(grip=(0.02, 1.0, 1.0, 1.0)), 6.0)
    whole, _ = run(Faults(), 6.0)
    ways = [one.agents[0].positions for one in (episode, whole)]
    assert 0.005 < np.abs(ways[0] - ways[1]).max() < 0.5
    last = episode.perception["one"].glances[-1]
    assert np.linalg.norm(last.own.pose[:2] - last.truth.pose[:2]) < 0.1


def test_a_gyroscope_that_errs_turns_the_robot_and_its_belief_apart() -> None:
    episode, _ = run(Faults(gyro_step=(1.0, 0.02)), 6.0)
    last = episode.perception["one"].glances[-1]
    assert last.own.pose[2] - last.truth.pose[2] == pytest.approx(0.02 * 5.0, abs=0.04)


def test_late_detections_say_how_old_they_are() -> None:
    soon, seen_soon = run(Faults(), 5.0, handover="measured")
    late, seen_late = run(Faults(), 5.0, handover="measured", latency=0.3)
    ages = [
        np.mean([d.age for one in seen[4:] for d in one.detections])
        for seen in (seen_soon, seen_late)
    ]
    assert ages[1] - ages[0] == pytest.approx(0.3, abs=0.06)
    for episode in (soon, late):
        glance = episode.perception["one"].glances[-1]
        body, place = glance.truth.bodies[0], glance.to_world.points(glance.obstacles[0].state[:2])
        lag = glance.truth.time - glance.obstacles[0].time
        assert np.linalg.norm(place - (body.position - lag * body.velocity)) < 0.05


def test_stamps_that_are_late_put_obstacles_in_the_wrong_place() -> None:
    episode, _ = run(Faults(late_stamps=0.3), 5.0)
    glance = episode.perception["one"].glances[-1]
    assert glance.sightings.time == pytest.approx(glance.truth.time + 0.3, abs=0.05)


def test_scans_of_a_time_that_nobody_knows_stop_the_robot() -> None:
    episode, seen = run(Faults(late_stamps=3.0), 2.0)
    log = episode.perception["one"]
    assert log.stops[0].reason.startswith("lidar: ") and log.stops[0].end == 2.0
    assert standing(episode, 2.0) and not any(one.detections for one in seen)
    assert any(reason.startswith("a scan is of a time") for reason in log.notes)


@pytest.mark.parametrize(
    ("faults", "words"),
    [
        ({"grip": (1.0, 1.0)}, "wanted a factor of each wheel"),
        ({"grip": (0.0, 1.0, 1.0, 1.0)}, "faults.grip is 0"),
        ({"push": (1.0, np.inf)}, "faults.push holds inf"),
        ({"blind": (2.0, 1.0)}, "wanted a later end"),
        ({"silent": ("imu", 2.0, 2.0)}, "wanted a later end"),
        ({"jump": (np.nan, 1.0)}, "faults.jump holds nan"),
        ({"late_stamps": np.inf}, "faults.late_stamps is inf"),
    ],
    ids=str,
)
def test_bad_faults_are_refused(faults: dict[str, Any], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        Faults(**faults)


def test_wheels_cannot_slip_where_there_are_none() -> None:
    with pytest.raises(WideberthError, match="needs physics"):
        SensingPipeline(mechanics="kinematic", faults=Faults(push=(1.0, 1.0)))


def test_a_watchdog_minds_what_is_of_no_use() -> None:
    dog = Watchdog(("lidar", "encoders"), 0.0)
    empty = Scan("lidar", np.zeros(0), np.zeros(0), np.zeros(0))
    far = Scan("lidar", np.zeros(1), np.zeros(1), np.array([np.inf]))
    assert dog.jumped(0.4, 0.4) == 0.0
    for sample in (far, WheelSample("encoders", 0.4, np.zeros(4))):
        dog.note(sample)
    assert dog.jumped(0.8, 0.4) == 0.0 and not dog.reason()
    dog.note(empty)
    dog.note(WheelSample("encoders", 0.8, np.full(4, np.nan)))
    dog.note(WheelSample("others", 0.8, np.zeros(4)))
    assert dog.jumped(1.0, 0.2) == 0.0 and dog.reason().startswith("lidar: ")
    dog.note(far)
    assert dog.reason().startswith("encoders: ")
    assert dog.jumped(4.2, 0.2) == pytest.approx(3.0)


@dataclass(frozen=True)
class Fails(Predictor):
    """Forecasts until one obstacle has been seen for two seconds."""

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        if np.isfinite(tracks.positions).all(axis=2).sum() > 4:
            raise RuntimeError("the model file is gone")
        return ConstantVelocity().predict(tracks, steps, scene)


def test_a_planner_whose_predictor_fails_stops_the_robot_and_says_why() -> None:
    robot = Unicycle()
    settings = describe(recommended(robot, 0.5, quiet=True))
    planner = build("controllers", {**settings, "predictor": Fails()})
    agents = [
        RobotAgent("one", robot, planner, Path(np.array([[0.0, 0.0], [20.0, 0.0]])), 0.0),
        RobotAgent("two", robot, Ahead(), Path(np.array([[8.0, 4.0], [50.0, 4.0]])), 0.0),
    ]
    agents = [replace(agent, reference_speed=0.5) for agent in agents]
    limit = Settings(history=0.0, time_limit=8.0, plant_step=0.04)
    cascade = SensingPipeline(mechanics="kinematic", noise=0.0)
    one = Run(agents, limit, 0, (), (), (), WheeledWorld(cascade, limit))
    one.advance()
    log = one.episode().robots[0]
    assert "the model file is gone" in log.plans[-1].reason
    assert log.speeds.max() > 0.2 and log.speeds[-1] < 0.02


@pytest.mark.parametrize("jump", [5.0, -5.0], ids=["ahead", "back"])
def test_a_clock_that_is_set_does_no_harm_to_who_knows_the_truth(jump: float) -> None:
    episode, _ = run(Faults(jump=(3.0, jump)), 5.0, state=None, detector=None, tracker=None)
    last = episode.perception["one"].glances[-1]
    assert np.linalg.norm(last.own.pose - last.truth.pose) < 1e-9


@pytest.mark.parametrize("jump", [20.0, -20.0], ids=["ahead", "back"])
def test_a_robot_at_rest_waits_as_long_whichever_way_its_clock_is_set(jump: float) -> None:
    """Half a second at rest and two for the gyroscope, and no more."""
    episode, _ = run(Faults(jump=(0.02, jump)), 4.0)
    stops = episode.perception["one"].stops
    assert stops[-1].reason == "the gyroscope is calibrated anew"
    assert 2.0 < stops[-1].end < 3.2


def test_physics_that_diverges_is_a_stop_with_its_reason() -> None:
    for stages in ({}, {"state": None, "detector": None, "tracker": None}):
        episode, _ = run(Faults(push=(0.5, 1e9)), 2.0, **stages)
        (stop,) = episode.perception["one"].stops
        assert stop.reason.startswith("the physics has no finite solution")
        assert all(np.abs(agent.positions).max() < 10.0 for agent in episode.agents)


def test_the_yaw_rate_loop_follows_the_gyroscope_that_errs() -> None:
    """Told to drive straight it turns at the rate by which the gyroscope's bias has changed."""
    episode, _ = run(Faults(gyro_step=(1.0, 0.05)), 7.0)
    agent = episode.agents[0]
    turned = np.interp([4.0, 7.0], episode.times, np.unwrap(agent.headings))
    assert np.diff(turned)[0] / 3.0 == pytest.approx(-0.05, abs=0.015)


def test_names_in_faults_are_of_somebody() -> None:
    with pytest.raises(WideberthError, match=r"cascade.faults.silent: .*lidr.*lidar"):
        SensingPipeline(faults=Faults(silent=("lidr", 1.0, 2.0)))
    settings = Settings(history=0.0)
    world = WheeledWorld(SensingPipeline(faults=Faults(robots=("nobody",))), settings)
    path = Path(np.array([[0.0, 0.0], [5.0, 0.0]]))
    agent = RobotAgent("one", Unicycle(), Ahead(), path, 0.0)
    with pytest.raises(WideberthError, match=r"cascade.faults.robots: .*nobody"):
        Run([agent], settings, 0, (), (), (), world)
