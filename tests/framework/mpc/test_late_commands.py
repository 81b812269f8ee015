"""A solve that takes longer than the control period: the robot follows its last plan."""

import numpy as np
import pytest

from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.emergency import command_of_plan
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.values.path import Path
from wideberth.predictors.kalman import Kalman
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.solvers.fatrop import Fatrop


def drive(solve_time: float, latency: float) -> Episode:
    planner = Planner(
        Unicycle(),
        MahalanobisEllipse(),
        Kalman(),
        Relaxed(weight=1.0, minimum=0.0),
        Fatrop(),
        latency=latency,
    )
    path = Path(np.array([[0.0, 0.0], [6.0, 0.0]]))
    robot = RobotAgent("robot", Unicycle(), planner, path)
    return run_episode([robot], Settings(solve_time=solve_time, history=0.0, time_limit=40.0))


def test_late_commands_still_reach_the_goal() -> None:
    quick = drive(0.0, 0.0)
    assert quick.ended == "goals"
    late = drive(0.8, 0.8)
    assert late.ended == "goals"
    robot = late.robots[0]
    assert robot.skipped > 0
    assert np.abs(robot.positions[:, 1]).max() < 0.05
    assert robot.positions[:, 0].max() < 6.3


def test_between_late_commands_the_last_plan_is_followed() -> None:
    log = drive(0.8, 0.8).robots[0]
    episode = drive(0.8, 0.8)
    compared = 0
    for before, after in zip(log.plans[:-1], log.plans[1:], strict=True):
        # the tick at which the controller was busy with the plan `after`
        due = after.stamp - 0.8 + 0.5
        step = int((due - before.stamp) / before.dt + 1e-6)
        if step < 0 or after.stamp > episode.duration:
            continue
        index = int(np.searchsorted(episode.times, after.stamp - 1e-6)) - 1
        share = (episode.times[index] - due) / before.dt
        wanted = before.states[step + 1, 3]
        speed = log.speeds[index]
        begin = log.speeds[int(np.searchsorted(episode.times, due - 1e-6))]
        assert speed == pytest.approx(begin + share * (wanted - begin), abs=0.02)
        compared += 1
    assert compared > 5


def test_beyond_its_end_a_plan_means_stop() -> None:
    plan = drive(0.0, 0.0).robots[0].plans[0]
    robot = Unicycle()
    assert command_of_plan(robot, plan).linear[0] == pytest.approx(plan.states[1, 3])
    assert command_of_plan(robot, plan, 4).linear[0] == pytest.approx(plan.states[5, 3])
    assert command_of_plan(robot, plan, 15).linear == (0.0, 0.0)
