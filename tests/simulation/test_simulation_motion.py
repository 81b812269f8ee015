"""Motion in an episode: start, plant, paths that change, recorded and scripted agents."""

import numpy as np
import pytest

from wideberth.framework.robot import start_state
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import PathChange, ReplayAgent, ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.plant import KinematicPlant
from wideberth.simulation.measures.summary import robot_rows, summarise
from wideberth.tests.helpers.pursuit import EAST, QUICK, agent


@pytest.mark.parametrize("robot", [Unicycle(), DifferentialDrive(), Bicycle(), Holonomic()])
def test_straight_drive_takes_the_free_time(robot):
    episode = run_episode([agent("a", robot=robot)], QUICK)
    assert episode.ended == "goals"
    log = episode.agent("a")
    # At 0.5 m/s from the start on, 0.25 m before the goal, on a grid of 0.02 s.
    assert log.reached == pytest.approx(4.75 / 0.5, abs=0.021)
    assert log.positions[-1] == pytest.approx([4.75, 0.0], abs=0.011)
    assert log.speeds == pytest.approx(0.5)
    row = robot_rows(episode)[0]
    assert row["time_ratio"] == pytest.approx(0.95, abs=0.01)
    assert row["deviation"] == pytest.approx(0.0, abs=1e-12)


def test_start_state_of_both_kinds():
    state, twist = start_state(Unicycle(), (1.0, 2.0), (0.0, -1.0), 0.5)
    assert state == pytest.approx((1.0, 2.0, -np.pi / 2, 0.5, 0.0))
    assert twist.linear == (0.5, 0.0)
    assert start_state(Holonomic(), (1.0, 2.0), (0.0, -1.0), 0.5)[0] == (1.0, 2.0, 0.0, -0.5)


def test_plant_follows_the_ramp_exactly():
    """Ramping v from 0.2 to 0.6 within 0.5 s covers the trapezium's area."""
    state, twist = start_state(Unicycle(), (0.0, 0.0), (0.0, 1.0), 0.2)
    plant = KinematicPlant(Unicycle(max_acceleration=2.0), state, twist)
    plant.command(Command((0.6, 0.0), ramp=0.5), 0.0)
    for k in range(50):
        plant.advance(0.01 * k, 0.01)
    assert plant.position == pytest.approx((0.0, 0.5 * 0.4), abs=1e-12)
    assert plant.speed == pytest.approx(0.6)
    plant.command(Command((9.0, 0.0)), 0.5)
    plant.advance(0.5, 0.1)
    assert plant.speed == pytest.approx(0.7)


def test_path_may_be_replaced_on_the_way():
    turn = Path(np.array([[2.0, 0.0], [2.0, 2.0]]))
    robot = agent("a", robot=Holonomic())
    episode = run_episode([robot], QUICK, changes=[PathChange(3.0, "a", turn)])
    log = episode.agent("a")
    assert [time for time, _ in log.paths] == [0.0, 3.0]
    assert log.positions[-1] == pytest.approx([2.0, 2.0], abs=0.3)
    with pytest.raises(WideberthError, match="'c'"):
        run_episode([agent("a")], QUICK, changes=[PathChange(3.0, "c", turn)])


def test_a_change_after_the_goal_keeps_the_episode_going():
    back = Path(np.array([[5.0, 0.0], [5.0, 2.0]]))
    robot = agent("a", robot=Holonomic())
    episode = run_episode([robot], QUICK, changes=[PathChange(14.0, "a", back)])
    assert episode.ended == "goals" and episode.agent("a").reached > 14.0


def test_recorded_and_scripted_agents_move_as_told():
    times = np.array([0.0, 1.0, 2.0, 3.0])
    recorded = np.array([[0.0, 0.0], [1.0, 0.0], [np.nan, np.nan], [3.0, 0.0]])
    walker = ReplayAgent("w", times, recorded, 0.3)
    found = walker.at(np.array([-0.1, 0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 3.1]))
    assert np.isnan(found[[0, 4, 5, 7], 0]).all()
    assert found[[1, 2, 3, 6], 0] == pytest.approx([0.0, 0.5, 1.0, 3.0])
    scripted = ScriptedAgent("s", EAST, 0.5, 0.3, start=2.0)
    assert scripted.at(np.array([0.0, 2.0, 4.0, 99.0]))[:, 0] == pytest.approx([-1, 0, 1, 5])
    own = agent("a", Path(np.array([[0.0, 3.0], [5.0, 3.0]])))
    episode = run_episode([own], QUICK, others=[walker, scripted])
    assert [log.kind for log in episode.agents] == ["robot", "replay", "scripted"]
    assert np.array_equal(episode.agent("s").positions, scripted.at(episode.times))
    seen = {o.stamp: {d.ident for d in o.detections} for o in own.controller.asked}
    assert seen[0.0] == seen[1.0] == {"w", "s"} and seen[1.5] == {"s"}
    assert summarise(episode)["clearance"] == pytest.approx(3.0 - 0.75 - 0.3, abs=1e-3)
