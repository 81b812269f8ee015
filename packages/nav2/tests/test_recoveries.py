"""Recoveries: their order, when they end, and when they fail."""

import numpy as np
import pytest

from wideberth.framework.values.costmap import Costmap
from wideberth.packages.nav2.tests.ticks import FREE, ROBOT, walls
from wideberth_nav2.server.recoveries import (
    Recoveries,
    Recovery,
    RecoveryOutcome,
)
from wideberth_nav2.server.server import ServerView

PERIOD = 0.05


def situation(time: float, pose: np.ndarray, costmap: Costmap = FREE) -> ServerView:
    return ServerView(time, pose, np.zeros(3), costmap, time, ROBOT)


def driven(
    robin: Recoveries, costmap: Costmap = FREE, most: float = 30.0
) -> tuple[np.ndarray, float, RecoveryOutcome, list[Recovery | None]]:
    """Run a recovery on a robot that does what it is told; say where and when it ends."""
    pose, time, names = np.zeros(3), 0.0, [robin.begin(situation(0.0, np.zeros(3), costmap))]
    while time < most:
        twist, outcome = robin.velocity(situation(time, pose, costmap))
        if outcome is not RecoveryOutcome.RUNNING:
            return pose, time, outcome, names
        if robin.now is not names[-1]:
            names.append(robin.now)
        speed = float(twist.linear[0])
        rate = [speed * np.cos(pose[2]), speed * np.sin(pose[2]), float(twist.angular)]
        pose = pose + PERIOD * np.array(rate)
        time += PERIOD
    raise AssertionError("it does not end")


def test_they_follow_in_turn_and_end_as_wanted() -> None:
    robin = Recoveries()
    assert driven(robin)[3] == [Recovery.CLEAR]
    pose, _, outcome, names = driven(robin)
    assert names == [Recovery.SPIN] and outcome is RecoveryOutcome.SUCCEEDED
    assert pose[2] == pytest.approx(1.57, abs=1.0 * PERIOD) and not pose[:2].any()
    pose, time, outcome, names = driven(robin)
    assert names == [Recovery.WAIT] and time == pytest.approx(5.0, abs=0.06) and not pose.any()
    pose, time, outcome, names = driven(robin)
    assert names == [Recovery.BACK_UP] and outcome is RecoveryOutcome.SUCCEEDED
    assert pose[0] == pytest.approx(-0.30, abs=0.15 * PERIOD) and time == pytest.approx(
        2.0, abs=0.06
    )
    assert driven(robin)[3] == [Recovery.CLEAR]
    assert robin.tried == 5


def test_after_all_retries_there_is_none_left() -> None:
    robin = Recoveries(number_of_retries=2)
    here = situation(0.0, np.zeros(3))
    assert robin.begin(here) is Recovery.CLEAR and robin.begin(here) is Recovery.SPIN
    assert robin.begin(here) is None
    robin.reset()
    assert robin.begin(here) is Recovery.CLEAR


def test_where_one_is_blocked_the_next_one_follows() -> None:
    behind = walls((-0.5, -0.5, -0.3, 0.5))
    robin = Recoveries(wait_duration=0.2)
    for _ in range(3):
        driven(robin)
    pose, _, outcome, names = driven(robin, behind)
    assert names == [Recovery.BACK_UP, Recovery.CLEAR] and outcome is RecoveryOutcome.SUCCEEDED
    assert pose[0] > -0.1


def test_a_spin_between_walls_fails_for_a_long_robot() -> None:
    from wideberth_nav2.costmap.footprint import RobotFootprint

    long = RobotFootprint.of([(0.5, 0.1), (-0.5, 0.1), (-0.5, -0.1), (0.5, -0.1)])
    beside = walls((-1.0, 0.3, 1.0, 0.4))
    robin = Recoveries()
    robin.begin(situation(0.0, np.zeros(3)))
    robin.begin(situation(0.0, np.zeros(3)))
    seen = ServerView(0.0, np.zeros(3), np.zeros(3), beside, 0.0, long)
    assert robin.velocity(seen)[1] is RecoveryOutcome.RUNNING and robin.now is Recovery.WAIT


def test_what_takes_too_long_fails() -> None:
    robin = Recoveries()
    for _ in range(2):
        robin.begin(situation(0.0, np.zeros(3)))
    assert robin.velocity(situation(10.0, np.zeros(3)))[1] is RecoveryOutcome.RUNNING
    assert robin.now is Recovery.SPIN
    robin.velocity(situation(10.1, np.zeros(3)))
    assert robin.now is Recovery.WAIT
