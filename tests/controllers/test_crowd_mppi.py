"""Sampling control among people who react: its cost by hand, its draws, and what it drives."""

from dataclasses import replace
from math import exp

import numpy as np
import pytest

from wideberth.controllers.crowd_mppi import CrowdMppi
from wideberth.framework.mpc.fallback.rollout import drive_along, steer
from wideberth.framework.people.models import Straight, Walkers
from wideberth.framework.people.ways import NEAREST
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent, ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel

EAST = Path(np.array([[0.0, 0.0], [6.0, 0.0]]))
BALL = HolonomicVelocity(radius=0.3, max_speed=1.0)
WHEELS = Unicycle(
    radius=0.3, max_speed=1.0, max_yaw_rate=1.5, max_acceleration=1.0, max_yaw_acceleration=3.0
)


LOOP = Settings(time_limit=25.0, history=1.0, channel=Channel(noise=0.005))


def made(robot=BALL, **settings):
    controller = CrowdMppi(robot, samples=60, steps=8, **settings)
    controller.set_path(EAST)
    return controller


def person(place=(3.0, 0.0), pace=(0.0, 0.0)):
    return Walkers(*(np.array([one]) for one in (place, pace, pace)), np.array([0.25]))


def seen(stamp, place, state=None, polygons=()):
    found = (Detection("p", np.array(place), np.zeros((2, 2)), 0.25),)
    return Observation(stamp, np.zeros(2) if state is None else state, found, polygons=polygons)


def test_the_cost_by_hand():
    """Straight on at 1 m/s towards one who stands: surfaces are 2.45 m - 0.25 k apart."""
    controller = made(model=Straight(), contact=100.0, closeness=2.0, margin=0.3)
    twists = np.tile([1.0, 0.0, 0.0], (2, 8, 1))
    twists[1] = 0.0
    wall = Polygon(((-0.4, 1.5), (2.4, 1.5), (2.4, 2.0), (-0.4, 2.0)))
    observation = Observation(0.0, np.zeros(2), polygons=(wall,))
    carrot = np.array([3.0, 0.0])
    found = controller.cost(observation, person((2.1, 0.0)), carrot, twists)
    gaps = 1.55 - 0.25 * np.arange(1, 9)  # the seventh is the first below 0
    close = 2.0 * 0.25 * (np.clip(1.0 - gaps / 0.3, 0.0, None) ** 2).sum()
    off = np.abs(3.0 - 0.25 * np.arange(1, 9)).mean()
    assert found == pytest.approx([off + 100.0 * 2 / 8 + close, 3.0])


def test_a_wall_counts_as_a_body_does():
    controller = made(model=Straight(), contact=10.0, closeness=0.0)
    twists = np.tile([0.0, 1.0, 0.0], (1, 8, 1))
    wall = Polygon(((-1.0, 0.9), (1.0, 0.9), (1.0, 2.5), (-1.0, 2.5)))
    nobody = Walkers(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    carrot = np.zeros(2)
    free = controller.cost(Observation(0.0, np.zeros(2)), nobody, carrot, twists)
    held = controller.cost(Observation(0.0, np.zeros(2), polygons=(wall,)), nobody, carrot, twists)
    assert held - free == pytest.approx(10.0 * 6 / 8)  # 0.6 m are free: touched from step 3 on


def test_a_wall_thinner_than_a_step_is_not_passed_unseen():
    fast = HolonomicVelocity(radius=0.2, max_speed=2.0)
    controller = CrowdMppi(fast, samples=4, steps=4, model=Straight(), contact=10.0, closeness=0.0)
    twists = np.tile([2.0, 0.0, 0.0], (1, 4, 1))
    wall = Polygon(((0.73, -1.0), (0.77, -1.0), (0.77, 1.0), (0.73, 1.0)))
    nobody = Walkers(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    seen = [Observation(0.0, np.zeros(2), polygons=walls) for walls in ((), (wall,))]
    free, held = (controller.cost(one, nobody, np.zeros(2), twists)[0] for one in seen)
    assert held - free == pytest.approx(10.0 * 3 / 4)  # passed in the second step


def test_who_is_far_away_goes_straight_on():
    rng = np.random.default_rng(0)
    near = np.stack([np.full(NEAREST, -3.0), np.linspace(-3.0, 3.0, NEAREST)], axis=1)
    place = np.concatenate([near, [[0.0, 6.0]]])
    pace = np.concatenate([np.zeros((NEAREST, 2)), [[0.0, -2.0]]])
    order = rng.permutation(NEAREST + 1)
    people = Walkers(place[order], pace[order], pace[order], np.full(NEAREST + 1, 0.2))
    controller = CrowdMppi(BALL, samples=4, steps=12, contact=10.0, closeness=0.0)
    found = controller.cost(
        Observation(0.0, np.zeros(2)), people, np.zeros(2), np.zeros((1, 12, 3))
    )
    assert found == pytest.approx([10.0 * 1 / 12])  # his surface is there after 5.5 m of 6


def test_what_somebody_wants_is_his_mean_velocity():
    controller = made(memory=1.0, period=0.2)
    for step in range(12):
        pace = 1.0 if step < 6 else 0.0
        place = (2.0 + 0.2 * min(step, 5) * 1.0, 2.0)
        controller.command(seen(0.2 * step, place))
        wanted = controller._wanted["p"]
        if step == 5:
            before = wanted
        if step > 5 and pace == 0.0:
            assert wanted == pytest.approx(exp(-0.2 * (step - 5)) * before)


@pytest.mark.parametrize("robot", [BALL, WHEELS, Bicycle()], ids=lambda one: type(one).__name__)
def test_twists_are_driven_as_one_by_one(robot):
    rng = np.random.default_rng(0)
    twists = rng.uniform(-1.0, 1.0, (3, 4, 3))
    start = np.array(robot.state_at(robot.pose((0.0,) * len(robot.states)), Twist((0.4, 0.0))))
    found = drive_along(robot, start, twists, 0.2)
    for sequence, states in zip(twists, found, strict=True):
        state = start
        for row, (vx, vy, omega) in enumerate(sequence.tolist()):
            state = steer(robot, state, Twist((vx, vy), omega), 1, 0.2)[0][-1]
            assert states[row + 1] == pytest.approx(state, abs=1e-12)


def test_samples_keep_the_speed_and_hold_the_last_sequence_and_standing():
    controller = made(WHEELS)
    state = np.zeros(len(WHEELS.states))
    controller.command(seen(0.0, (3.0, 1.0), state))
    last = controller._shifted()
    drawn = controller._drawn(state, 1.0)
    assert np.array_equal(drawn[0], last)
    assert not drawn[1].any()
    assert np.abs(drawn[..., 0]).max() <= 1.0 + 1e-12
    assert not drawn[..., 1].any()
    assert drawn[30:, :, 0].min() < -0.3  # backwards as well, at half of its speed
    assert drawn[30:, :, 0].min() >= -0.5


def arrival(robot, others=()):
    """When the robot is at its goal, and the least gap to the others on its way, m."""
    controller = CrowdMppi(robot, samples=150)
    agent = RobotAgent("robot", robot, controller, EAST, 0.0)
    log = run_episode([agent], LOOP, others=others)
    gaps = [
        float(np.linalg.norm(log.robots[0].positions - one.positions, axis=1).min())
        - robot.radius - one.radius
        for one in log.agents[1:]
    ]  # fmt: skip
    return log.robots[0].reached, min(gaps, default=np.inf)


@pytest.mark.parametrize("robot", [BALL, WHEELS], ids=lambda one: type(one).__name__)
def test_it_arrives_alone_and_round_somebody_who_stands(robot):
    assert arrival(robot)[0] < 10.0
    still = ScriptedAgent("person", Path(np.array([[3.0, 0.05], [3.0, 9.0]])), 1e-3, 0.25)
    reached, gap = arrival(robot, [still])
    assert reached < 12.0
    assert gap > 0.0


def test_the_same_seed_gives_the_same_commands_and_another_one_others():
    def commands(controller):
        return [controller.command(seen(0.2 * i, (3.0 - 0.1 * i, 0.1))) for i in range(4)]

    first = made()
    once = commands(first)
    first.reset()
    assert commands(first) == once == commands(made())
    assert commands(made(seed=1)) != once


def test_numbers_out_of_range_are_refused():
    for name, value in {"samples": 3, "steps": 1, "temperature": 0.0, "seed": -1}.items():
        with pytest.raises(WideberthError, match=name):
            replace(made(), **{name: value})
