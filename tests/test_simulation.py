"""Episodes with stub controllers: clock, plant, channel, ends, determinism."""

import time
from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.controller import Controller
from wideberth.framework.errors import WideberthError
from wideberth.framework.forecast import Forecast
from wideberth.framework.metrics import deadlock_time
from wideberth.framework.motion import Command
from wideberth.framework.path import Path
from wideberth.framework.plan import Plan, Rung, Status
from wideberth.framework.robot import start_state
from wideberth.framework.testing import check_controller
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.agents import PathChange, ReplayAgent, RobotAgent, ScriptedAgent
from wideberth.simulation.channel import Channel
from wideberth.simulation.episode import run_episode
from wideberth.simulation.log import Episode
from wideberth.simulation.plant import Plant
from wideberth.simulation.settings import Settings
from wideberth.simulation.summary import robot_rows, summarise, time_rows

EAST = Path(np.array([[0.0, 0.0], [5.0, 0.0]]))


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
    def plan(self):
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


QUICK = Settings(history=2.0, time_limit=30.0)


def test_stub_keeps_the_controller_contract():
    check_controller(Pursuit(Unicycle()), cycles=3)
    with pytest.raises(WideberthError, match="needs the robot"):
        check_controller(Pursuit(None))


def test_check_controller_finds_what_is_broken(monkeypatch):
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((np.nan, 0.0)))
    with pytest.raises(AssertionError, match="finite"):
        check_controller(Pursuit(Unicycle()))
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: 1 / 0)
    with pytest.raises(AssertionError, match="ZeroDivisionError"):
        check_controller(Pursuit(Unicycle()))
    drawn = iter(range(1000))
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((next(drawn), 0.0)))
    with pytest.raises(AssertionError, match="after reset"):
        check_controller(Pursuit(Unicycle()))


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


def test_plant_follows_the_ramp_exactly():
    """Ramping v from 0.2 to 0.6 within 0.5 s covers the trapezium's area."""
    state, twist = start_state(Unicycle(), (0.0, 0.0), (0.0, 1.0), 0.2)
    plant = Plant(Unicycle(max_acceleration=2.0), state, twist)
    plant.command(Command((0.6, 0.0), ramp=0.5), 0.0)
    for k in range(50):
        plant.advance(0.01 * k, 0.01)
    assert plant.position == pytest.approx((0.0, 0.5 * 0.4), abs=1e-12)
    assert plant.speed == pytest.approx(0.6)
    plant.command(Command((9.0, 0.0)), 0.5)
    plant.advance(0.5, 0.1)
    assert plant.speed == pytest.approx(0.7)


def test_history_shows_the_others_coming():
    first, second = agent("a", phase=0.2), agent("b", opposite(), phase=0.3)
    settings = Settings(history=4.0, time_limit=1.0, channel=Channel(noise=0.0))
    run_episode([first, second], settings)
    seen = first.controller.remembered
    assert [o.stamp for o in seen] == pytest.approx(np.arange(-3.8, 0.0, 0.5))
    for observation in seen:
        assert observation.detections[0].position[0] == pytest.approx(5 - 0.5 * observation.stamp)
        assert observation.state[0] == pytest.approx(0.5 * observation.stamp)
        assert observation.state[3] == pytest.approx(0.5)
    assert [o.stamp for o in first.controller.asked] == pytest.approx([0.2, 0.7])


def test_delay_shows_where_it_was():
    settings = Settings(history=1.0, time_limit=3.0, channel=Channel(noise=0.0, delay=0.33))
    first = agent("a", phase=0.1)
    run_episode([first, agent("b", opposite())], settings)
    for observation in first.controller.asked:
        detection = observation.detections[0]
        assert detection.age == 0.33
        expected = 5 - 0.5 * (observation.stamp - 0.33)
        assert detection.position[0] == pytest.approx(expected, abs=1e-9)


def test_noise_has_its_size_and_does_not_hang_on_order():
    channel = Channel(noise=0.1, dropout=0.25)
    here = [("x", np.zeros(2), 0.3), ("y", np.ones(2), 0.3), ("gone", np.full(2, np.nan), 0.3)]
    draws = [channel.detections(3, "a", tick, here) for tick in range(-500, 1500)]
    errors = np.array([d.position - (d.ident == "y") for seen in draws for d in seen])
    count = errors.size
    assert abs(len(errors) / 4000 - 0.75) < 3 * np.sqrt(0.75 * 0.25 / 4000)
    assert abs(errors.mean()) < 3 * 0.1 / np.sqrt(count)
    assert abs(errors.std() - 0.1) < 3 * 0.1 / np.sqrt(2 * count)
    assert draws[0][0].covariance == pytest.approx(0.01 * np.eye(2))
    other = channel.detections(3, "a", 7, here[::-1])
    assert {d.ident: tuple(d.position) for d in other} == {
        d.ident: tuple(d.position) for d in channel.detections(3, "a", 7, here)
    }
    assert {d.ident for seen in draws for d in seen} == {"x", "y"}


def test_same_seed_same_bytes():
    def once(seed):
        pair = [agent("a", phase=0.1), agent("b", opposite(0.4), phase=0.35)]
        return run_episode(pair, QUICK, seed=seed).to_bytes()

    assert once(1) == once(1)
    assert once(1) != once(2)


def test_order_of_robots_does_not_matter():
    def once(turned):
        pair = [agent("a"), agent("b", opposite(0.4), robot=Holonomic())]
        return run_episode(pair[::-1] if turned else pair, QUICK)

    one, two = once(False), once(True)
    for name in ("a", "b"):
        assert np.array_equal(one.agent(name).positions, two.agent(name).positions)
        for first, second in zip(one.agent(name).plans, two.agent(name).plans, strict=True):
            assert np.array_equal(first.forecast.mean, second.forecast.mean)


def test_head_on_collides_and_can_stop_there():
    pair = [agent("a"), agent("b", opposite())]
    episode = run_episode(pair, QUICK)
    row = summarise(episode)
    assert row["collision"] and not row["success"] and episode.ended == "goals"
    assert row["clearance"] == pytest.approx(-1.5, abs=1e-6)
    pair = [agent("a"), agent("b", opposite())]
    stopped = run_episode(pair, replace(QUICK, stop_on_collision=True))
    assert stopped.ended == "collision"
    # Surfaces meet when 5 - 2 * 0.5 t = 1.5.
    assert stopped.duration == pytest.approx(3.5, abs=0.021)


def test_constant_solve_time_delays_commands():
    episode = run_episode([agent("a")], replace(QUICK, solve_time=0.3))
    log = episode.agent("a").commands
    assert log.effect - log.stamp == pytest.approx(0.3)
    assert np.diff(log.stamp) == pytest.approx(0.5)
    assert episode.agent("a").skipped == 0


def test_late_commands_are_misses_and_the_old_one_holds():
    """Solving takes 0.7 s at a period of 0.5 s: every other tick passes by."""
    corner = Path(np.array([[0.0, 0.0], [0.0, 5.0]]))
    change = PathChange(0.0, "a", corner)
    slow = agent("a", robot=Holonomic())
    episode = run_episode([slow], replace(QUICK, solve_time=0.7), changes=[change])
    log = episode.agent("a")
    assert np.diff(log.commands.stamp) == pytest.approx(1.0)
    assert robot_rows(episode)[0]["deadline_misses"] == len(log.commands)
    assert log.skipped == len(log.commands)
    before = episode.times <= 0.7
    assert log.positions[before, 0] == pytest.approx(0.5 * episode.times[before])
    assert abs(log.positions[before, 1]).max() < 1e-12


def test_measured_solve_time_is_what_it_took():
    slow = agent("a", seconds=0.02)
    episode = run_episode([slow], replace(QUICK, solve_time="measured", time_limit=2.0))
    log = episode.agent("a").commands
    assert log.effect - log.stamp == pytest.approx(episode.plan_seconds["a"])
    assert (episode.plan_seconds["a"] >= 0.02).all()
    assert [row["seconds"] for row in episode.times_rows()] == list(episode.plan_seconds["a"])
    assert time_rows(episode)[0]["max"] == max(episode.plan_seconds["a"])
    assert all(plan.seconds == 0.0 for plan in episode.agent("a").plans)


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


def test_standing_still_is_a_deadlock(monkeypatch):
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((0.0, 0.0), ramp=0.5))
    episode = run_episode([agent("a"), agent("b", opposite())], QUICK)
    assert episode.ended == "deadlock" and summarise(episode)["deadlock"]
    speeds = np.array([log.speeds for log in episode.robots])
    done = np.zeros(speeds.shape, bool)
    assert deadlock_time(episode.times, speeds, done) == pytest.approx(episode.duration)
    creeping = replace(QUICK, time_limit=5.0)
    assert run_episode([agent("a"), agent("b", opposite())], creeping).ended == "time limit"


def test_oracle_is_told_paths_plans_and_recordings():
    """Before a plan: the path at reference speed. After: the plan, then straight on."""
    walker = ReplayAgent("w", np.arange(0.0, 20.0), np.full((20, 2), 9.0), 0.3)
    first = agent("a", truth=True, phase=0.2)
    second = agent("b", opposite(1.0), phase=0.4)
    blind = agent("c", opposite(-2.0), planning=False)
    run_episode([first, second, blind], replace(QUICK, time_limit=2.0), others=[walker])
    asked = first.controller.asked
    assert [o.truth is None for o in first.controller.remembered] == [True] * 4
    assert second.controller.asked[0].truth is None
    for observation in asked:
        truth = observation.truth
        assert truth.times[0] <= observation.stamp - 1 < observation.stamp + 12 <= truth.times[-1]
        straight = 5 - 0.5 * truth.times
        ends = np.maximum(straight, 0.0) if observation.stamp < 0.4 else straight
        assert truth.positions["b"][:, 0] == pytest.approx(ends, abs=1e-6)
        assert truth.positions["c"][:, 0] == pytest.approx(np.maximum(5 - 0.5 * truth.times, 0.0))
        assert (truth.positions["w"][truth.times > 0.01] == 9.0).all()
        assert np.isnan(truth.positions["w"][truth.times < -0.01]).all()


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


def test_saved_episode_reads_back_whole():
    walker = ScriptedAgent("s", opposite(2.0), 0.4, 0.3)
    pair = [agent("a"), agent("b", opposite(0.5), planning=False)]
    episode = run_episode(pair, QUICK, seed=4, others=[walker])
    again = Episode.from_bytes(episode.to_bytes())
    assert again.to_bytes() == episode.to_bytes()
    assert np.array_equal(again.times, episode.times)
    plan, other = episode.agent("a").plans[3], again.agent("a").plans[3]
    assert plan.ids == other.ids and plan.iterations == other.iterations == 7
    assert np.array_equal(plan.forecast.covariance, other.forecast.covariance)
    assert again.agent("b").plans == () and len(again.agent("b").commands) > 5
    assert again.times_rows() == []
    assert repr(summarise(again)) == repr(summarise(episode))


def test_other_files_are_refused():
    with pytest.raises(WideberthError, match="not a saved episode"):
        Episode.from_bytes(b"frame id x y")
    with pytest.raises(WideberthError, match="not a saved episode"):
        Episode.from_bytes(b"")
    whole = run_episode([agent("a")], replace(QUICK, time_limit=1.0)).to_bytes()
    with pytest.raises(WideberthError, match="not a saved episode"):
        Episode.from_bytes(whole[: len(whole) // 2])


def test_a_newer_version_is_refused(monkeypatch):
    from wideberth.simulation import codec

    episode = run_episode([agent("a")], replace(QUICK, time_limit=1.0))
    monkeypatch.setattr(codec, "VERSION", 2)
    data = episode.to_bytes()
    monkeypatch.setattr(codec, "VERSION", 1)
    with pytest.raises(WideberthError, match="version 2"):
        Episode.from_bytes(data)


def test_coverage_and_forecast_share_come_from_the_log():
    """The stub says "it stays where it is, +- 1 m": right for a scripted agent at rest."""
    still = ScriptedAgent("s", opposite(9.0), 0.0, 0.3)
    episode = run_episode([agent("a")], QUICK, others=[still])
    row = summarise(episode)
    assert row["coverage"] == row["coverage_first"] == row["coverage_last"] == 1.0
    assert row["named_forecasts"] == 1.0
    assert row["below_reference"] == 1.0 and row["fallbacks"] == 0
    fast = ScriptedAgent("s", Path(np.array([[-50.0, 9.0], [50.0, 9.0]])), 4.0, 0.3)
    row = summarise(run_episode([agent("a")], QUICK, others=[fast]))
    assert row["coverage_first"] == 1.0 and row["coverage_last"] == 0.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: run_episode([], QUICK), "no robot"),
        (lambda: run_episode([agent("a"), agent("a")], QUICK), "'a'"),
        (lambda: agent("a", phase=0.5), "period"),
        (lambda: agent("a", Path(np.eye(3))), "dimensions"),
        (lambda: Settings(time_limit=0.0), "time_limit"),
        (lambda: Settings(solve_time="never"), "'measured'"),
        (lambda: Settings(solve_time=-0.1), "solve_time"),
        (lambda: Channel(noise=-1.0), "noise"),
        (lambda: Channel(dropout=1.0), "dropout"),
        (lambda: ReplayAgent("w", [0.0, 0.0], np.zeros((2, 2)), 0.3), "later"),
        (lambda: ReplayAgent("w", [0.0, 1.0], np.zeros((2, 2)), -0.3), "radius"),
        (lambda: run_episode([agent("a")], QUICK, seed=-1), "seed"),
        (lambda: run_episode([sharing("a"), sharing("b")], QUICK), "share one controller"),
    ],
)
def test_bad_input_names_the_cure(build, message):
    with pytest.raises(WideberthError, match=message):
        build()


SHARED = Pursuit(Unicycle())


def sharing(name):
    return RobotAgent(name, Unicycle(), SHARED, EAST)


def test_a_command_that_is_not_finite_stops_with_a_message(monkeypatch):
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((np.nan, 0.0)))
    with pytest.raises(WideberthError, match="controller of a"):
        run_episode([agent("a")], QUICK)


def test_start_state_of_both_kinds():
    state, twist = start_state(Unicycle(), (1.0, 2.0), (0.0, -1.0), 0.5)
    assert state == pytest.approx((1.0, 2.0, -np.pi / 2, 0.5, 0.0))
    assert twist.linear == (0.5, 0.0)
    assert start_state(Holonomic(), (1.0, 2.0), (0.0, -1.0), 0.5)[0] == (1.0, 2.0, 0.0, -0.5)
