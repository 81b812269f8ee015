"""A world whose robot is driven from elsewhere: what it shows, and how its time passes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.controller import Controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Detection
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.log.episode_log import Episode
from wideberth.tests.oracles.ray_casting import cast
from wideberth_perception.physics.sensors import Lidar
from wideberth_ros.cli import ros_world
from wideberth_ros.cli.ros_world import (
    RemoteController,
    ScanningLidar,
    WorldSettings,
    run_world,
    sentence,
)
from wideberth_ros.from_outside import chosen_task, play_from_outside
from wideberth_ros.simulated_robot import ReceivedVelocity

EASY = ["scenarios.circle.humans=1"]
FORWARD = Command((0.0, 0.5))


@dataclass
class Wire:
    """The topics of a robot, in memory; ``answer`` is asked whenever the world waits."""

    answer: Callable[["Wire"], Command | None]
    newest: ReceivedVelocity | None = None
    outcome: Callable[[], Any] = dict
    time: float = 0.0
    epoch: int = 0
    waited: list[float] = field(default_factory=list)
    shown: list[tuple[int, np.ndarray, np.ndarray]] = field(default_factory=list)
    people: list[tuple[float, Sequence[Detection], np.ndarray]] = field(default_factory=list)
    scans: list[Scan] = field(default_factory=list)
    placed: list[tuple[np.ndarray, OccupancyGrid, Any]] = field(default_factory=list)

    @property
    def now(self) -> int:
        return self.epoch + round(self.time * 10**9)

    def begin(self) -> None:
        self.epoch, self.time, self.newest = self.now + 10**9, 0.0, None

    def hold(self, seconds: float) -> None:
        self.epoch += round(seconds * 10**9)

    def place(self, points: np.ndarray, grid: OccupancyGrid, mount: Any) -> None:
        self.placed.append((points, grid, mount))

    def show(self, time: float, pose: np.ndarray, twist: np.ndarray) -> None:
        self.time = time
        self.shown.append((self.now, pose, twist))

    def show_people(self, time: float, seen: Sequence[Detection], moves: np.ndarray) -> None:
        self.people.append((time, seen, moves))

    def show_scan(self, scan: Scan) -> None:
        self.scans.append(scan)

    def wait(self, seconds: float) -> None:
        self.waited.append(seconds)
        if (command := self.answer(self)) is not None:
            self.newest = ReceivedVelocity(command, self.now, self.time)


def played(
    wire: Wire, settings: WorldSettings, overrides: Sequence[str] = EASY, config: str = "crowdnav",
    case: Sequence[str] = ("controller=pure_pursuit",),
) -> tuple[Row, Episode]:  # fmt: skip
    """Play an episode whose robot is driven over a wire."""
    experiment, _ = read_experiment(config, list(overrides))
    entered: list[RemoteController] = []

    def enter(run: Run, agent: RobotAgent) -> Controller:
        entered.append(RemoteController(run, agent, wire, settings))  # type: ignore[arg-type]
        return entered[0]

    task = chosen_task(experiment, case)
    return play_from_outside(experiment, task, enter, lambda run: entered[0].look(run))


@pytest.fixture
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock on the wall that goes on by what is waited for."""
    begin = [0.0]

    def monotonic() -> float:
        begin[0] += 0.001
        return begin[0]

    monkeypatch.setattr(ros_world.time, "monotonic", monotonic)


def test_time_that_is_stepped_waits_for_the_velocity_of_the_instant() -> None:
    asked: list[float] = []

    def answer(wire: Wire) -> Command | None:
        asked.append(wire.time)
        return FORWARD if asked.count(wire.time) == 3 else None  # slow, but it comes

    wire = Wire(answer)
    row, episode = played(wire, WorldSettings(stepped=True))
    ticks = episode.robots[0].commands.stamp
    assert ticks == pytest.approx(0.25 * np.arange(len(ticks)))
    assert [asked.count(time) for time in ticks] == [3] * len(ticks)
    assert {time for time, *_ in wire.people} == {*ticks}
    assert row["outcome"] == "success" or row["outcome"] == "collision"


def test_a_velocity_of_another_instant_does_not_count_when_stepped() -> None:
    def answer(wire: Wire) -> Command | None:
        late = [one for one in wire.waited if one]
        wire.newest = ReceivedVelocity(Command((9.0, 9.0)), wire.now - 10**8, wire.time)
        return FORWARD if len(late) % 2 else None

    _, episode = played(Wire(answer), WorldSettings(stepped=True))
    assert (episode.robots[0].commands.linear == FORWARD.linear).all()


def test_the_clock_goes_on_while_the_first_velocity_is_waited_for(fast: None) -> None:
    def answer(wire: Wire) -> Command | None:
        return FORWARD if len(wire.shown) > 40 else None

    wire = Wire(answer)
    _, episode = played(wire, WorldSettings(rate=50.0))
    stamps = [stamp for stamp, *_ in wire.shown]
    assert (np.diff(stamps) >= 0).all() and stamps[0] == 10**9
    places = np.array([pose for _, pose, _ in wire.shown])
    assert (places[:41] == places[0]).all() and places[60, 1] > places[0, 1]
    assert stamps[40] - stamps[0] == pytest.approx(40 * 0.05e9, abs=2)
    assert episode.robots[0].commands.stamp[0] == 0.0
    points, grid, mount = wire.placed[0]
    assert mount is None and grid.cells.max() == 0 and grid.inside(points).all()


def test_who_falls_silent_lets_the_robot_stand(fast: None) -> None:
    def answer(wire: Wire) -> Command | None:
        return FORWARD if wire.time < 2.0 else None

    settings = [*EASY, "settings.crowdnav.deadlock_after=2", "settings.crowdnav.time_limit=20"]
    row, episode = played(Wire(answer), WorldSettings(rate=50.0), settings)
    log = episode.robots[0].commands
    assert (log.linear[log.stamp < 2.0] == FORWARD.linear).all()
    assert (log.linear[log.stamp > 2.6] == 0.0).all()
    assert row["outcome"] == "deadlock" and episode.duration < 5.0


def test_people_are_shown_with_their_velocities_or_not_at_all() -> None:
    def answer(wire: Wire) -> Command | None:
        return Command((0.0, 0.0))

    wire = Wire(answer)
    settings = ["scenarios.circle.humans=3", "settings.crowdnav.time_limit=4"]
    _, episode = played(wire, WorldSettings(stepped=True), settings)
    for time, seen, moves in wire.people[2:]:
        row = int(np.searchsorted(episode.times, time - 1e-9))
        for one, velocity in zip(seen, moves, strict=True):
            way = episode.agent(one.ident).positions
            step = (way[row] - way[row - 1]) / (episode.times[row] - episode.times[row - 1])
            assert velocity == pytest.approx(step, abs=1e-9)
    assert max(np.linalg.norm(moves, axis=1).max() for *_, moves in wire.people) > 0.5
    blind = Wire(answer)
    played(blind, WorldSettings(stepped=True, people=False), settings)
    assert blind.people == [] and len(blind.shown) == len(wire.shown)


def test_an_added_lidar_sees_discs_and_walls_where_they_are_at_each_beam() -> None:
    wire, lidar = Wire(lambda wire: Command((0.5, 0.0))), Lidar(deviation=1e-9, lost=0.0)
    experiment, _ = read_experiment("doorway", [])
    entered: list[tuple[ScanningLidar, Controller, RobotAgent]] = []
    seen: dict[float, tuple[np.ndarray, list[np.ndarray], list[float]]] = {}
    scans: list[tuple[Scan, Run]] = []

    def enter(run: Run, agent: RobotAgent) -> Controller:
        remote = RemoteController(run, agent, wire, WorldSettings(stepped=True))  # type: ignore[arg-type]
        entered.append((ScanningLidar(run, agent, lidar), remote, agent))
        return remote

    def look(run: Run) -> None:
        own = next(one for one in run.drivers if one.name == entered[0][2].name)
        pose = own.agent.robot.pose(own.states[-1])
        drivers = [one for one in run.drivers if one is not own]
        places = [np.array(one.positions[-1]) for one in drivers]
        places += [one.at(np.array(run.clock[-1:]))[0] for one in run.others]
        where = np.array([*pose.position, pose.heading])
        seen[run.clock[-1]] = where, places, [one.radius for one in (*drivers, *run.others)]
        scans.extend((scan, run) for scan in entered[0][0].turns())
        if len(scans) > 80:
            raise EOFError

    with pytest.raises(EOFError):
        play_from_outside(experiment, chosen_task(experiment, []), enter, look)
    met = 0
    for scan, run in scans[1::8]:
        at = [seen[time] for time in scan.times.tolist()]
        poses, radii = np.array([one[0] for one in at]), at[0][2]
        discs = [(np.array([one[1][i] for one in at]), radius) for i, radius in enumerate(radii)]
        walls = [one.points for one in run.polygons]
        wanted = cast(poses, scan.bearings, discs, walls)
        assert scan.ranges == pytest.approx(wanted, abs=1e-6)
        assert np.isfinite(wanted).any()
        met += int((cast(poses, scan.bearings, [], walls) != wanted).sum())
    assert met > 10, "beams on the walker"


@pytest.mark.skipif(not find_spec("mujoco"), reason="the extra `perception` is missing")
def test_scans_of_the_experiment_are_shown_once_each_by_the_clock_of_the_episode() -> None:
    settings = ["settings.nominal={history: 0.0, time_limit: 3}", "cascades.box.rest=1.0"]
    wire = Wire(lambda wire: FORWARD)
    _, episode = played(wire, WorldSettings(stepped=True), settings, "cascade_crossing", ())
    ends = [scan.stamp for scan in wire.scans]
    assert len(ends) >= 29 and np.diff(ends) == pytest.approx(0.1, abs=0.005)
    assert 0.0 <= ends[0] < 0.11 and episode.duration - 0.11 < ends[-1] <= episode.duration
    assert wire.placed[0][2].tolist() == wire.scans[0].mount.tolist()


def test_what_cannot_be_is_refused_before_ros_is_joined() -> None:
    for words, given in (
        ("unknown scenario", ("crowdnav", [], ["scenario=line"])),
        ("drives no robot", ("region_gallery", [], [])),
        ("unknown config 'crowdnaw'", ("crowdnaw", [], [])),
        ("rclpy.* of ROS 2 is not found", ("crowdnav", [], [])),
    ):
        with pytest.raises(WideberthError, match=words):
            run_world(*given, None, "", WorldSettings(), ())
    with pytest.raises(WideberthError, match="--rate"):
        WorldSettings(rate=0.0)


def test_the_verdict_in_words() -> None:
    row = {"outcome": "success", "duration": 9.25, "clearance": 0.2134}
    assert sentence(row) == "success after 9.25 s, least clearance 0.213 m"
