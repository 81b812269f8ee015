"""CrowdNav's verdict on logs of which the answer is known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from wideberth.framework.controller import Controller
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.measures.summary import clearances
from wideberth.simulation.sensing.channel import Channel
from wideberth_arenas.scenarios.crowdnav import verdict

BODY = HolonomicVelocity(radius=0.3, max_speed=1.0)


@dataclass(eq=False)
class East(Controller):
    """Goes along the x axis, whatever happens."""

    speed: float = 1.0
    period: float = 0.25

    def reset(self):
        pass

    def set_path(self, path):
        pass

    def remember(self, observation):
        pass

    @property
    def last_plan(self):
        return None

    def command(self, observation):
        return Command((self.speed, 0.0))


def episode(*others, step=0.25, limit=24.0, speed=1.0):
    """A robot drives 2 m along the x axis at 1 m/s, arriving (within 0.3 m) at 1.75 s."""
    quiet = Settings(
        time_limit=limit, plant_step=step, history=0.0, channel=Channel(noise=0.0),
        goal_tolerance=0.3, deadlock_after=30.0,
    )  # fmt: skip
    way = Path(np.array([[0.0, 0.0], [2.0, 0.0]]))
    robot = RobotAgent("robot", BODY, East(speed), way, 0.0)
    times = np.arange(0.0, 30.0, 0.25)
    people = [ReplayAgent(f"p{i}", times, one(times), 0.3) for i, one in enumerate(others)]
    return run_episode([robot], quiet, others=people)


def still(x, y):
    return lambda times: np.tile([x, y], (len(times), 1)).astype(float)


@pytest.mark.parametrize("step", [0.25, 0.05])
def test_success_and_when(step):
    assert verdict(episode(step=step)) == {
        "outcome": "success", "time_s": 1.75, "danger_share": 0.0, "distance_m": None,
    }  # fmt: skip


def test_danger_is_counted_and_measured_on_the_way():
    judged = verdict(episode(still(1.0, 0.7)))  # passes 0.1 m beside it, without a touch
    assert judged["outcome"] == "success"
    # Nearer than 0.8 m, the sum of radii and 0.2 m, where |x - 1| < sqrt(0.15) = 0.387.
    gaps = [np.hypot(x, 0.7) - 0.6 for x in (0.25, 0.0, 0.0, 0.25)]
    assert judged["danger_share"] == pytest.approx(4 / 7)
    assert judged["distance_m"] == pytest.approx(np.mean(gaps))
    assert verdict(episode(still(1.0, 0.9)))["danger_share"] == 0.0  # 0.3 m beside it


def test_nobody_has_a_velocity_before_the_first_step():
    assert verdict(episode(still(-1.0, -1.0)))["outcome"] == "success"


def test_collision_comes_before_the_goal():
    judged = verdict(episode(still(2.0, 0.5)))
    assert judged["outcome"] == "collision"
    assert judged["time_s"] == 1.75  # |x - 2| < sqrt(0.11) = 0.33 first on the way to 1.75


def test_a_collision_is_by_the_previous_velocity():
    """Somebody comes at 2 m/s and jumps back: no touch, and yet a collision; and the reverse."""

    def shies(times):  # beside the robot at 0.75 s, from where it goes back
        y = np.where(times <= 0.75, 2.3 - 2.0 * times, 0.8 + 2.0 * (times - 0.75))
        return np.stack([np.full_like(times, 0.9), y], axis=1)

    log = episode(shies)
    assert min(clearances(log).values()) > 0.0
    assert verdict(log)["outcome"] == "collision"
    assert verdict(log)["time_s"] == 1.0


def test_timeout():
    assert verdict(episode(limit=30.0, speed=0.01))["outcome"] == "timeout"
    assert verdict(episode(limit=30.0, speed=0.01))["time_s"] == 24.25
    brief = episode(limit=5.0, speed=0.01)
    assert verdict(brief)["outcome"] == "timeout" and verdict(brief)["time_s"] == 5.0
    longer = replace(brief, times=brief.times * 1.0002)  # 1 ms of a further step
    assert verdict(longer)["time_s"] == 5.25
    assert verdict(episode(limit=0.25, speed=0.01))["time_s"] == 0.25
