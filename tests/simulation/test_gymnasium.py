"""The Gymnasium environment: its own checker, the same numbers as an episode, seeds, rewards."""

import subprocess
import sys
import warnings
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path as File

import numpy as np
import pytest

from wideberth.controllers.policy_observer import ObservationSpec
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.gym.reward import CrowdNavReward, Transition
from wideberth.simulation.scenarios.base import Placement, Scenario
from wideberth.simulation.sensing.channel import Channel

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402

from wideberth.simulation.gym.environment import ID, NavigationEnv  # noqa: E402

ROBOTS = ("unicycle", "bicycle", "differential_drive", "holonomic", "holonomic_velocity")
PARTICLE = HolonomicVelocity(radius=0.3)
SHORT = Settings(time_limit=15.0, history=3.0)


@dataclass(frozen=True)
class Meeting(Scenario):
    """A robot goes from 0 to 4 m along x; somebody stands or walks there, beside a wall."""

    place: float = 2.0
    aside: float = 0.0
    speed: float = 0.0
    wall: bool = False
    robots: int = 1
    phase: float = 0.0

    def build(self, rng):
        return tuple(
            Placement(f"robot {i}", Path([[0.0, 3.0 * i], [4.0, 3.0 * i]]), 0.5, self.phase)
            for i in range(self.robots)
        )

    def bystanders(self, rng, placements):
        times = np.linspace(-50.0, 50.0, 101)
        way = np.stack([self.place + self.speed * times, np.full(101, self.aside)], axis=1)
        return (ReplayAgent("other", times, way, 0.4),)

    def polygons(self, rng):
        return (Polygon(((0, -2), (4, -2), (4, -1), (0, -1)), "wall"),) if self.wall else ()


@pytest.fixture
def policies(monkeypatch):
    monkeypatch.syspath_prepend(str(File(__file__).parents[1] / "helpers"))
    return import_module("sample_policies").__name__


def strict_check(environment):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment.unwrapped)


@pytest.mark.parametrize("robot", ROBOTS)
def test_own_checker_of_gymnasium_has_nothing_to_say(robot):
    scenario = {"type": "crossing_field", "walkers": 2}
    strict_check(gymnasium.make(ID, scenario=scenario, robot=robot, settings=SHORT))


def test_checker_with_all_that_can_be_shown():
    sight = ObservationSpec(3, walls=2, predictor=build("predictors", "kalman"), steps=4)
    made = gymnasium.make(
        ID, scenario=Meeting(wall=True), robot="unicycle", sight=sight, settings=SHORT
    )
    strict_check(made)
    shown, _ = made.reset(seed=1)
    assert shown["forecast_mean"].shape == (3, 4, 2)
    assert made.observation_space["walls"].shape == (2, 2)


@pytest.mark.parametrize("space", ["holonomic_3d"])
def test_checker_in_space(space):
    strict_check(gymnasium.make(ID, scenario="crossing_3d", robot=space, companion={
        "type": "mpc", "robot": space, "region": "minkowski_sum", "predictor": "kalman",
        "level": "fixed", "solver": "fatrop", "horizon": 5}, settings=SHORT))  # fmt: skip


def replayed(environment, episode, seed):
    """Send the commands of an episode's robot through `step`."""
    log = episode.robots[0]
    box = environment._actor.view.box
    environment.reset(seed=seed)
    for linear, omega in zip(log.commands.linear, log.commands.omega, strict=True):
        action = box.action(Command(tuple(linear), omega))
        _, _, terminated, truncated, info = environment.step(action)
        if terminated or truncated:
            break
    return environment.episode, info


SPEED_CASES = [
    ("orca", PARTICLE),
    ("constant_velocity", Unicycle(radius=0.3, max_speed=1.3, max_yaw_rate=2.1)),
    ("wideberth.controllers.policy:Policy", PARTICLE),
]


@pytest.mark.parametrize(("kind", "robot"), SPEED_CASES)
@pytest.mark.parametrize("phase", [0.0, 0.37])
def test_same_commands_give_the_same_bytes(kind, robot, phase, policies):
    settings = replace(SHORT, channel=Channel(noise=0.01, dropout=0.1, delay=0.1))
    extra = {"policy": f"{policies}:pushed"} if ":" in kind else {}
    controller = build("controllers", {"type": kind, "robot": robot, "period": 0.3, **extra})
    scenario = Meeting(place=6.0, speed=-0.4, aside=0.9, phase=phase)
    cast = scenario.cast(3)
    one = cast.placements[0]
    agent = RobotAgent(one.name, robot, controller, one.path, one.speed, phase * 0.3)
    wanted = run_episode([agent], settings, seed=3, others=cast.bystanders)
    environment = NavigationEnv(scenario, robot, period=0.3, settings=settings)
    got, info = replayed(environment, wanted, 3)
    assert wanted.ended == "goals" and info["outcome"] == "goal"
    assert got.to_bytes() == wanted.to_bytes()


def test_the_plans_of_a_planner_replayed():
    """Commands with ramps cannot be actions; without them the states agree to the byte."""
    robot = PARTICLE
    planner = build("controllers", {
        "type": "mpc", "robot": robot, "region": "minkowski_sum", "predictor": "kalman",
        "level": "fixed", "solver": "fatrop", "horizon": 6})  # fmt: skip
    scenario = Meeting(place=6.0, speed=-0.4, aside=0.9)
    cast = scenario.cast(4)
    one = cast.placements[0]
    agent = RobotAgent(one.name, robot, planner, one.path, one.speed)
    wanted = run_episode([agent], SHORT, seed=4, others=cast.bystanders)
    assert (wanted.robots[0].commands.ramp == 0.0).all()
    got, _ = replayed(NavigationEnv(scenario, robot, period=0.5, settings=SHORT), wanted, 4)
    assert np.array_equal(got.times, wanted.times)
    for first, second in zip(got.agents, wanted.agents, strict=True):
        assert first.positions.tobytes() == second.positions.tobytes()
        assert first.speeds.tobytes() == second.speeds.tobytes()


def test_policy_sees_in_an_episode_what_the_environment_shows(policies):
    """The way back: trained there, compared here; float32 is what the environment rounds to."""
    target = f"{policies}:to_goal"
    settings = {"type": "wideberth.controllers.policy:Policy", "robot": PARTICLE, "period": 0.25}
    controller = build("controllers", {**settings, "policy": target})
    module = sys.modules[policies]
    scenario, seed = Meeting(place=3.0, aside=1.2), 5
    environment = NavigationEnv(scenario, PARTICLE, settings=SHORT)
    seen, _ = environment.reset(seed=seed)
    over = False
    while not over:
        seen, _, terminated, truncated, _ = environment.step(module.to_goal(seen))
        over = terminated or truncated
    cast = scenario.cast(seed)
    agent = RobotAgent("robot 0", PARTICLE, controller, cast.placements[0].path, 0.5)
    played = run_episode([agent], SHORT, seed=seed, others=cast.bystanders)
    ours, theirs = played.robots[0].positions, environment.episode.robots[0].positions
    assert controller.reason == ""
    np.testing.assert_allclose(ours, theirs, atol=1e-5)


def rollout(environment, seed, steps=6):
    environment.action_space.seed(1)
    shown = [environment.reset(seed=seed)[0]]
    return shown + [environment.step(environment.action_space.sample())[0] for _ in range(steps)]


def test_a_seed_is_the_seed_of_the_scenario_and_repeats():
    environment = gymnasium.make(ID, settings=SHORT)
    one, two, other = (rollout(environment, seed) for seed in (7, 7, 8))
    for first, second in zip(one, two, strict=True):
        assert all(first[name].tobytes() == second[name].tobytes() for name in first)
    assert any((first["positions"] != third["positions"]).any()
               for first, third in zip(one, other, strict=True))  # fmt: skip
    environment.reset(seed=7)
    drawn = [environment.reset()[1]["seed"] for _ in range(3)]
    environment.reset(seed=7)
    assert drawn == [environment.reset()[1]["seed"] for _ in range(3)]
    assert len(set(drawn)) == 3


def drive(environment, action, seed=0):
    environment.reset(seed=seed)
    rewards = []
    while True:
        _, reward, terminated, truncated, info = environment.step(np.array(action))
        rewards.append(reward)
        if terminated or truncated:
            return rewards, terminated, truncated, info


ENDS = [
    (Meeting(place=2.0), [0.7, 0.0], "collision", -0.25),
    (Meeting(place=2.0, aside=3.0), [0.7, 0.0], "goal", 1.0),
    (Meeting(place=0.0, aside=3.0), [0.0, 0.7], "collision", -0.25),
    (Meeting(aside=9.0, wall=True), [0.0, -0.7], "collision", -0.25),
    (Meeting(aside=3.0), [-0.7, 0.0], "time limit", 0.0),
    (Meeting(aside=3.0), [0.0, 0.0], "deadlock", 0.0),
]


@pytest.mark.parametrize(("scenario", "action", "outcome", "last"), ENDS)
def test_ends_and_their_rewards(scenario, action, outcome, last):
    environment = NavigationEnv(scenario, PARTICLE, settings=SHORT)
    rewards, terminated, truncated, info = drive(environment, action)
    assert info["outcome"] == outcome and rewards[-1] == last
    assert all(-0.025 <= reward <= 0.0 for reward in rewards[:-1])  # too near, at most
    assert (terminated, truncated) == ((True, False) if last else (False, True))
    assert environment.episode.duration == info["time"]


def test_reward_near_somebody_is_crowdnavs():
    """0.1 m beside somebody who stands: 0.5 (0.1 - 0.2) 0.25 in the steps that pass him."""
    rewards, _, _, _ = drive(
        NavigationEnv(Meeting(place=2.0, aside=0.8), PARTICLE, settings=SHORT), [0.7, 0.0]
    )
    assert min(rewards) == pytest.approx(0.5 * (0.1 - 0.2) * 0.25, abs=1e-9)
    far = Transition(0.25, np.inf, np.inf, 0.1, reached=False, collided=False)
    assert CrowdNavReward()(far) == 0.0
    environment = NavigationEnv(
        Meeting(aside=3.0), PARTICLE, settings=SHORT, reward=lambda t: t.advance
    )
    rewards, _, _, _ = drive(environment, [0.7, 0.0])
    assert sum(rewards) == pytest.approx(4.0 - 0.25, abs=0.02)


def test_pictures_show_the_robot_moving():
    environment = NavigationEnv(Meeting(), PARTICLE, settings=SHORT, render_mode="rgb_array")
    environment.reset(seed=0)
    first = environment.render()
    environment.step(np.array([0.7, 0.0]))
    second = environment.render()
    assert first.shape == (480, 480, 3) and first.dtype == np.uint8
    assert (first != second).any() and np.array_equal(second, environment.render())


def test_a_window_is_drawn_by_step_and_says_where_it_cannot_open(capsys):
    from matplotlib import pyplot

    pyplot.switch_backend("agg")
    before = pyplot.get_fignums()
    environment = gymnasium.make(ID, scenario=Meeting(), robot=PARTICLE, render_mode="human")
    environment.reset(seed=0)
    assert "no window: the backend 'agg'" in capsys.readouterr().err
    shown = environment.unwrapped._window._image
    first = np.array(shown.get_array())
    environment.step(np.array([0.7, 0.0]))
    same = NavigationEnv(Meeting(), PARTICLE, render_mode="rgb_array")
    same.reset(seed=0)
    same.step(np.array([0.7, 0.0]))
    assert (first != shown.get_array()).any()
    assert np.array_equal(shown.get_array(), same.render()) and environment.render() is None
    environment.close()
    assert pyplot.get_fignums() == before


def test_make_finds_the_environment_by_name_alone(tmp_path: File):
    script = (
        "import gymnasium\n"
        f"made = gymnasium.make('wideberth.simulation.gym:{ID}')\n"
        "shown, _ = made.reset(seed=3)\n"
        "for name, space in made.observation_space.items():\n"
        "    assert space.contains(shown[name]), name\n"
        "    assert (space.low.min() >= 0) == (name in ('radii', 'present')), name\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_other_robots_need_a_companion_and_get_it():
    with pytest.raises(WideberthError, match="give a companion"):
        NavigationEnv(Meeting(robots=2), PARTICLE).reset(seed=0)
    with pytest.raises(WideberthError, match="no robot is called 'x'"):
        NavigationEnv(Meeting(), PARTICLE, name="x").reset(seed=0)
    companion = {"type": "constant_velocity", "robot": PARTICLE}
    environment = NavigationEnv(
        Meeting(aside=9.0, robots=2), PARTICLE, name="robot 1", companion=companion, settings=SHORT
    )
    _, terminated, _, info = drive(environment, [0.7, 0.0])
    assert terminated and info["outcome"] == "goal"
    assert environment.episode.agent("robot 0").positions[-1, 0] > 2.0


def test_misuse_is_named():
    environment = NavigationEnv(Meeting(), PARTICLE)
    with pytest.raises(WideberthError, match="call reset before step"):
        environment.step(np.zeros(2))
    with pytest.raises(WideberthError, match="call reset first"):
        _ = environment.episode
    environment.reset(seed=0)
    with pytest.raises(WideberthError, match="action"):
        environment.step(np.array([np.nan, 0.0]))
    with pytest.raises(WideberthError, match="render_mode"):
        NavigationEnv(Meeting(), PARTICLE, render_mode="ansi")
    with pytest.raises(WideberthError, match="unknown scenario"):
        NavigationEnv("nowhere")


def test_without_gymnasium_the_message_says_what_to_install(tmp_path: File):
    script = (
        "import sys\nsys.modules['gymnasium'] = None\nimport wideberth.simulation.gym.environment"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True
    )
    assert "MissingLibraryError" in done.stderr
    assert "pip install 'wideberth[learning]'" in done.stderr
