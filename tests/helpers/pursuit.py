"""A stub controller, robots that it drives, and settings of short episodes."""

import time

import numpy as np

from wideberth.framework.controller import Controller
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung, Status
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.settings import Settings

EAST = Path(np.array([[0.0, 0.0], [5.0, 0.0]]))

QUICK = Settings(history=2.0, time_limit=30.0)


class Pursuit(Controller):
    """Pure pursuit: aims at a point ahead on the path; its plan goes straight there."""

    def __init__(self, robot, period=0.5, speed=0.5, seconds=0.0, planning=True):
        self.robot, self.period, self.speed = robot, period, speed
        self.seconds, self.planning = seconds, planning
        self.reset()

    def reset(self):
        self.path, self._plan = None, None
        self.remembered, self.asked = [], []

    def set_path(self, path):
        self.path = path

    def remember(self, observation):
        self.remembered.append(observation)

    @property
    def last_plan(self):
        return self._plan

    def command(self, observation):
        time.sleep(self.seconds)
        self.asked.append(observation)
        if self.path is None:
            return Command((0.0, 0.0))
        pose = self.robot.pose(observation.state)
        here = np.array(pose.position)
        ahead = self.path.at(self.path.project(here) + 1.0) - here
        if self.planning:
            self._plan = self._straight(observation, here, ahead)
        if np.linalg.norm(self.path.goal - here) < 0.1:
            return Command((0.0, 0.0), 0.0, self.period)
        if pose.heading is None:
            toward = self.speed * ahead / np.linalg.norm(ahead)
            return Command((float(toward[0]), float(toward[1])), 0.0, self.period)
        side = -np.sin(pose.heading) * ahead[0] + np.cos(pose.heading) * ahead[1]
        omega = 2 * self.speed * side / (ahead @ ahead)
        return Command((self.speed, 0.0), float(omega), self.period)

    def _straight(self, observation, here, ahead):
        unit = ahead / max(np.linalg.norm(ahead), 1e-9)
        ids = tuple(d.ident for d in observation.detections)
        steps = np.arange(4)[:, None] * self.speed * 0.5
        mean = np.array([d.position for d in observation.detections]).reshape(-1, 1, 2)
        mean = mean.repeat(3, axis=1)
        wide = np.broadcast_to(np.eye(2), (*mean.shape, 2))
        return Plan(
            stamp=observation.stamp,
            dt=0.5,
            states=np.tile(observation.state, (4, 1)),
            inputs=np.zeros((3, 2)),
            positions=here + steps * unit,
            reference=np.zeros((3, 2)),
            auxiliaries=np.zeros((3, len(ids), 0)),
            level=np.full((3, len(ids)), 2.0),
            target=np.full((3, len(ids)), 2.4),
            content=np.full((3, len(ids)), 0.9),
            ids=ids,
            tracked=ids,
            status=Status.SOLVED,
            rung=Rung.OPTIMAL,
            seconds=self.seconds,
            iterations=7,
            forecast=Forecast.single(mean, wide, 0.5),
        )


def agent(name, path=EAST, robot=None, **keys):
    robot = robot or Unicycle()
    own = {key: keys.pop(key) for key in ("period", "seconds", "planning") if key in keys}
    return RobotAgent(name, robot, Pursuit(robot, **own), path, **keys)


def opposite(offset=0.0, length=5.0):
    return Path(np.array([[length, offset], [0.0, offset]]))
