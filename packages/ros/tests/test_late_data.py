"""A node on a busy computer: scans and decisions come late, and no wall is touched."""

from collections import deque
from typing import Any

import numpy as np
import pytest

from wideberth import Command, Observation
from wideberth.framework.controller import Controller
from wideberth.framework.values.plan import Plan
from wideberth.packages.ros.tests.test_goal_heading import Drive
from wideberth.packages.ros.tests.test_node import EPOCH, Scripted
from wideberth.packages.ros.tests.test_obstacle_sources import SCAN, Hall
from wideberth.tests.helpers import hall as the_hall
from wideberth.tests.helpers.bags import header, transform
from wideberth.tests.helpers.rays import ranges
from wideberth_ros.in_time import VelocityInTime
from wideberth_ros.messages import messages
from wideberth_ros.obstacle_sources import ScanTopic
from wideberth_ros.path_sources import PathTopic

MOST = 1.0
"""s, by which decisions and scans are late at most."""


def gap(place: np.ndarray) -> float:
    """Gap between the robot at a place of the hall and the walls, m."""
    begin, edge = the_hall.walls()[:, 0], np.diff(the_hall.walls(), axis=1)[:, 0]
    share = np.clip(((place - begin) * edge).sum(axis=1) / (edge**2).sum(axis=1), 0.0, 1.0)
    away = np.linalg.norm(begin + share[:, None] * edge - place, axis=1)
    return float(away.min()) - the_hall.WIDE


class Blind(Drive):
    """A robot whose controller drives straight on, in the hall, with scans that come late."""

    def __init__(self, seed: int) -> None:
        super().__init__(Scripted(), sees=ScanTopic(), follows=PathTopic())
        self.rng = np.random.default_rng(seed)
        self.waiting: deque[tuple[float, Any]] = deque()
        self.come("/tf_static", transform(EPOCH, "base_link", "laser", (0.0, 0.0, 0.0)))
        self.path(points=((0.0, 0.0), (30.0, 0.0)))
        self.gap = np.inf

    def scan(self) -> None:
        """Cast a scan; a third is lost, and some come up to 1 s later, with those after them."""
        bearings = -np.pi + 2.0 * np.pi / 360 * np.arange(360)
        place = self.pose[:2] + the_hall.START
        found = ranges(place, self.pose[2] + bearings, np.zeros((0, 2)), 0.3, the_hall.walls())
        message = messages().make(
            SCAN, header=header(self.stamp(), "laser"), angle_min=-np.pi,
            angle_max=float(bearings[-1]), angle_increment=2.0 * np.pi / 360, range_max=12.0,
            ranges=found.astype(np.float32),
        )  # fmt: skip
        late = self.rng.uniform(0.0, MOST) if self.rng.random() < 0.3 else 0.0
        if self.rng.random() > 0.3:
            self.waiting.append((self.now + late, message))

    def drive_on(self, seconds: float) -> None:
        for k in range(round(seconds / 0.05)):
            if k % 2 == 0:
                self.scan()
            while self.waiting and self.waiting[0][0] <= self.now:
                self.come("/scan", self.waiting.popleft()[1])
            self.move(people=False)
            self.gap = min(self.gap, gap(self.pose[:2] + the_hall.START))


@pytest.mark.parametrize("seed", range(3))
def test_a_controller_that_sees_no_wall_stands_before_it(seed: int) -> None:
    """It used to drive through it at 0.5 m/s."""
    blind = Blind(seed)
    blind.drive_on(20.0)
    assert 0.0 < blind.gap < 0.3 and blind.pose[0] > 3.3


class Slow(Controller):
    """A controller whose decisions take long: the world goes on meanwhile."""

    def __init__(self, controller: Any, hall: "LateHall") -> None:
        self.controller, self._hall = controller, hall
        self.period, self.static_region = controller.period, controller.static_region

    @property
    def last_plan(self) -> Plan | None:
        return self.controller.last_plan  # type: ignore[no-any-return]

    def reset(self) -> None:
        self.controller.reset()

    def set_path(self, path: Any) -> None:
        self.controller.set_path(path)

    def remember(self, observation: Observation) -> None:
        self.controller.remember(observation)

    def command(self, observation: Observation) -> Command:
        found: Command = self.controller.command(observation)
        for _ in range(round(self._hall.rng.uniform(0.0, MOST) / 0.02)):
            self._hall.tick()
        return found


class LateHall(Hall):
    """The shipped example in the hall; decisions and scans come late, and scans are lost."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.rng = np.random.default_rng(seed)
        self.begin, self.count, self.shift = self.now, 0, self.rng.uniform(0.0, 20.0)
        self.node.controller = Slow(self.node.controller, self)
        self.gap = np.inf

    def tick(self) -> None:
        """Odometry at 50 Hz, scans at 10 Hz, commands at 25 Hz."""
        time = self.now - self.begin + self.shift
        self.gap = min(self.gap, gap(self.place))
        self.show(time)
        if self.count % 5 == 0 and self.rng.random() > 0.3:
            self.scan(time)
        self.network.deliver()
        self.move(self.count)
        self.count += 1

    def drive(self, seconds: float) -> None:
        """Plans at up to 5 Hz."""
        due = 0.0
        while self.now - self.begin < seconds:
            self.tick()
            if self.now >= due:
                due = self.now + 0.2
                self.node.plan()
            if self.count > 100 and self.node.status == "waiting for a goal" and self.node.stands:
                break


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 5])
def test_late_decisions_lead_to_the_goal_and_touch_nothing(seed: int) -> None:
    """Of twenty drives ten used to touch a wall, and most a walker."""
    hall = LateHall(seed)
    hall.drive(90.0)
    assert hall.gap > 0.0 and hall.nearest > 0.0
    assert np.linalg.norm(hall.place - the_hall.GOAL) < 0.5


def test_a_node_follows_a_late_plan_in_its_own_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plan that came reaches what is published, and the time at which it came."""
    taken = []
    aim = VelocityInTime.aim

    def noting(self: Any, command: Command, time: float, plan: Plan | None = None) -> None:
        taken.append((time, plan))
        aim(self, command, time, plan)

    monkeypatch.setattr(VelocityInTime, "aim", noting)
    hall = LateHall(0)
    hall.drive(1.5)
    plans = [(time, plan) for time, plan in taken if plan is not None]
    assert plans and all(time >= plan.stamp - 0.2 - 1e-9 for time, plan in plans)
    assert max(time - plan.stamp for time, plan in plans) > 0.1
