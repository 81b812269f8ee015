"""The simulator as a robot of ROS 2: a planner elsewhere drives it among people."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, final

import numpy as np

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.progress import say
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.controller import Controller
from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.motion import Command, Detection, Observation, Pose
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.sensing import Scan
from wideberth.routes.polygons import grid_of_polygons
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.driver import Driver
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.measures.summary import clearances
from wideberth_nav2.costmap.rays import ranges_along
from wideberth_perception.cascade.cascade import PATIENCE
from wideberth_perception.cascade.world import WheeledWorld
from wideberth_perception.physics.sensors import BodyState, Lidar

from ..from_outside import chosen_task, play_from_outside
from ..simulated_robot import Restart, SimulatedRobot, simulated_robot

FINEST = 0.05
"""s, longest time between two looks for commands in real time."""
SIGHT = 0.1
"""s between two messages with people."""
ROOM = 5.0
"""m, by which the map reaches beyond what stands there, and beyond the path."""
AGAIN = 1.0
"""s, after which a planner that has not answered is shown the same instant again."""
LATE = 1.0
"""s, by which the world may be behind the clock on the wall; it does not make up for more."""
LITTLE = 0.05
"""s, over which the velocity of a person is measured."""


@final
@dataclass(frozen=True)
class WorldSettings:
    """How an episode is shown, and how its time passes.

    Parameters
    ----------
    rate : s of the episode per second.
    stepped : time stands until a velocity that is stamped for the present instant has come, at
        each decision of the controller that the experiment has; otherwise it passes by the clock
        on the wall.
    people : whether those who move are shown as obstacles.
    lidar : whether the robot has a LiDAR where the experiment gives it none.
    resolution : m, of the map's cells.

    Raises
    ------
    WideberthError : a number not above 0.
    """

    rate: float = 1.0
    stepped: bool = False
    people: bool = True
    lidar: bool = False
    resolution: float = 0.05

    def __post_init__(self) -> None:
        positive("--rate", self.rate)
        positive("--resolution", self.resolution)


@final
class RemoteController(Controller):
    """Shows an episode to a planner elsewhere, and passes on the velocities that come from there.

    Parameters
    ----------
    run : the episode. agent : the robot.
    topics : of the robot. settings : how time passes.
    """

    def __init__(
        self, run: Run, agent: RobotAgent, topics: SimulatedRobot, settings: WorldSettings
    ) -> None:
        self._run, self._agent, self._topics, self._settings = run, agent, topics, settings
        self.period: float = min(run.settings.plant_step, FINEST)
        if settings.stepped:
            self.period = agent.controller.period
        self._lidar = ScanningLidar(run, agent, Lidar()) if settings.lidar else None
        self._scanned, self._seen_people = -np.inf, -np.inf
        self._due, self._late = np.inf, False
        topics.begin()
        topics.outcome = self._so_far

    def reset(self) -> None:
        """Do nothing: there is nothing to forget."""

    def set_path(self, path: Path) -> None:
        """Show the path, its end as the goal, and the map."""
        polygons, resolution = self._run.polygons, self._settings.resolution
        grid = grid_of_polygons(polygons, path.points, ROOM, resolution)
        self._topics.place(path.points, grid, self._mount())

    def remember(self, observation: Observation) -> None:
        """Do nothing: who decides keeps what was shown."""

    @property
    def last_plan(self) -> Plan | None:
        """None: who decides keeps it."""
        return None

    def command(self, observation: Observation) -> Command:
        """Return the newest velocity; wait for one at the first decision, or at each."""
        if self._settings.stepped:
            return self._answer(observation)
        if self._topics.newest is None:
            self.linger(observation, lambda: self._topics.newest is not None)
        newest = self._topics.newest
        assert newest is not None, "linger returns when there is one"
        silent = observation.stamp - newest.came > PATIENCE
        return Command((0.0, 0.0)) if silent else newest.command

    def look(self, run: Run) -> None:
        """Show a step of the episode, and let its time pass."""
        seen = run.look(self._agent.name)
        if self._settings.stepped:
            self._show_scans(seen)
        else:
            self._show(seen)
            self._pass(run.clock[-1] - run.clock[-2])

    def linger(self, seen: Observation, over: Callable[[], bool]) -> None:
        """Let the clock go on while the episode stands still."""
        while not over():
            self._show(seen, again=True)
            self._pass(self.period)
            self._topics.hold(self.period)

    def rest(self) -> None:
        """Let the clock go on after the end of the episode; time that is stepped stands."""
        seen = self._run.look(self._agent.name)
        while self._settings.stepped:
            self._topics.wait(AGAIN)
        self.linger(seen, lambda: False)

    def _answer(self, seen: Observation) -> Command:
        """Return the velocity that is stamped for this instant."""
        self._show(seen, again=True)
        shown = time.monotonic()
        while (newest := self._topics.newest) is None or newest.stamp != self._topics.now:
            if time.monotonic() - shown > AGAIN:
                self._show(seen, again=True)
                shown = time.monotonic()
            self._topics.wait(AGAIN)
        return newest.command

    def _pass(self, seconds: float) -> None:
        """Wait until so much of the episode has passed on the wall."""
        self._due = min(self._due, time.monotonic()) + seconds / self._settings.rate
        if (behind := time.monotonic() - self._due) > LATE:
            self._due += behind
            if not self._late:
                self._late = True
                say(f"the world cannot keep up with --rate {self._settings.rate:g}")
        while (left := self._due - time.monotonic()) > 0.0:
            self._topics.wait(left)
        self._topics.wait(0.0)

    def _show(self, seen: Observation, again: bool = False) -> None:
        """Show an instant; people each `SIGHT` s, or when all is shown again."""
        robot, state = self._agent.robot, tuple(seen.state.tolist())
        pose, twist = robot.pose(state), robot.twist(state, self._driver.plant.control)
        if self._settings.people and (again or seen.stamp - self._seen_people > SIGHT - 1e-9):
            self._seen_people, ones = seen.stamp, seen.detections
            self._topics.show_people(seen.stamp, ones, self._velocities(ones))
        self._show_scans(seen)
        where = np.array([*pose.position, _heading(pose)])
        self._topics.show(seen.stamp, where, np.array([*twist.linear, twist.angular]))

    def _show_scans(self, seen: Observation) -> None:
        """Show the turns that the LiDAR has ended."""
        for scan in self._lidar.turns() if self._lidar else self._own_scan(seen):
            self._topics.show_scan(scan)

    def _own_scan(self, seen: Observation) -> list[Scan]:
        """Return the newest turn of the experiment's own LiDAR, by the clock of the episode."""
        world, name = self._run.world, self._agent.name
        if seen.scan is None or not isinstance(world, WheeledWorld):
            return []
        scan = seen.scan.scan
        if scan.stamp == self._scanned:
            return []
        self._scanned = scan.stamp
        ahead = world.senses[name].clock(seen.stamp) - seen.stamp
        return [replace(scan, times=scan.times - ahead)]

    def _mount(self) -> Array | None:
        """Where the LiDAR is on the robot; None without one."""
        if self._lidar is not None:
            return np.array(self._lidar.lidar.mount)
        return self._run.world.lidar_mount if isinstance(self._run.world, WheeledWorld) else None

    def _velocities(self, seen: Sequence[Detection]) -> Array:
        """Return the velocities of those who are seen, (O, 2), m/s."""
        now, run = self._run.clock[-1], self._run
        instants = np.array([now - LITTLE, now])
        found = {one.name: np.diff(one.at(instants), axis=0)[0] for one in run.others}
        for one in run.drivers:
            places = [one.position_at(float(instant), run.clock) for instant in instants]
            found[one.name] = places[1] - places[0]
        unknown = np.zeros(2)
        ones = [
            found.get(one.ident, unknown) / LITTLE if one.velocity is None else one.velocity
            for one in seen
        ]
        known: Array = np.nan_to_num(np.array(ones).reshape(len(seen), 2))
        return known

    @property
    def _driver(self) -> Driver:
        return next(one for one in self._run.drivers if one.name == self._agent.name)

    def _so_far(self) -> Row:
        """Say how the episode stands."""
        gaps = clearances(self._run.episode()).values()
        return {
            "state": "waiting" if self._topics.newest is None else "driving",
            "seed": self._run.seed,
            "time": self._run.clock[-1],
            "clearance": min(gaps, default=np.inf),
        }


def _heading(pose: Pose) -> float:
    """Return the heading of a robot, rad; 0 of one that has none."""
    return 0.0 if pose.heading is None else float(pose.heading)


@final
class ScanningLidar:
    """A LiDAR on a robot of an episode, which sees bodies as discs, and polygons.

    Parameters
    ----------
    run : the episode. agent : the robot. lidar : what it carries.
    """

    def __init__(self, run: Run, agent: RobotAgent, lidar: Lidar) -> None:
        self.lidar: Lidar = lidar
        self._run, self._name = run, agent.name
        self._sampler = self.lidar.sampler(np.random.default_rng([run.seed, 11]), 0.0)

    def turns(self) -> list[Scan]:
        """Return the turns that have ended since the last call, up to the present instant."""
        run = self._run
        own = next(one for one in run.drivers if one.name == self._name)
        pose = own.agent.robot.pose(own.plant.state)
        heading = _heading(pose)
        turn = np.array([[np.cos(heading), -np.sin(heading), 0.0],
                         [np.sin(heading), np.cos(heading), 0.0], [0.0, 0.0, 1.0]])  # fmt: skip
        still = np.zeros(3)
        state = BodyState(
            run.clock[-1], np.array([*pose.position, 0.0]), turn, still, still, np.zeros(4)
        )
        return [one for one in self._sampler.sample(state, self._cast) if isinstance(one, Scan)]

    def _cast(self, origin: Array, directions: Array, longest: float) -> Array:
        now = np.array([self._run.clock[-1]])
        bodies = [(one.at(now)[0], one.radius) for one in self._run.others]
        bodies += [(np.array(one.plant.position), one.radius) for one in self._run.drivers
                   if one.present and one.name != self._name]  # fmt: skip
        centres = np.array([place for place, _ in bodies]).reshape(len(bodies), 2)
        radii = np.array([radius for _, radius in bodies])
        return ranges_along(origin[:2], directions[:, :2], centres, radii, self._run.polygons)


def run_world(
    config: str,
    overrides: Sequence[str],
    case: Sequence[str],
    seed: int | None,
    robot: str,
    settings: WorldSettings,
    arguments: Sequence[str],
) -> None:
    """Play one episode after the other, seed after seed, until it is stopped.

    Parameters
    ----------
    config, overrides : as of `read_experiment`.
    case, seed : as of `chosen_task`. robot : as of `play_from_outside`.
    settings : how time passes. arguments : for ROS.

    Raises
    ------
    WideberthError : no such config, case or robot, or ROS 2 is not found.
    """
    experiment, _ = read_experiment(config, list(overrides))
    task = chosen_task(experiment, case, seed)
    entered: list[RemoteController] = []

    def enter(run: Run, agent: RobotAgent) -> Controller:
        entered[:] = [RemoteController(run, agent, topics, settings)]
        return entered[0]

    def look(run: Run) -> None:
        entered[0].look(run)

    with suppress(KeyboardInterrupt), simulated_robot(arguments) as topics:
        while True:
            say(f"{task.name}, seed {task.seed}: waits for velocities")
            try:
                row, _ = play_from_outside(experiment, task, enter, look, robot)
                topics.outcome = partial(dict, {"state": "over", **row})
                say(f"{task.name}, seed {task.seed}: {sentence(row)}")
                entered[0].rest()
            except Restart:
                task = replace(task, seed=task.seed + 1)


def sentence(row: Mapping[str, Any]) -> str:
    """Say the verdict in words."""
    return (
        f"{row['outcome']} after {row['duration']:.4g} s, least clearance {row['clearance']:.3g} m"
    )
