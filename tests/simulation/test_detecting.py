"""Who is told what of whom, with and without noise."""

from dataclasses import dataclass

import numpy as np
import pytest

from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.controller import Controller
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel

BODY = HolonomicVelocity(radius=0.3, max_speed=1.0)


@dataclass(eq=False)
class Watcher(Controller):
    """Drives east at 1 m/s and keeps all that it is shown."""

    period: float = 0.25
    size: int = 2

    def reset(self):
        self.seen = []

    def set_path(self, path):
        pass

    def remember(self, observation):
        self.seen.append(observation)

    @property
    def last_plan(self):
        return None

    def command(self, observation):
        self.seen.append(observation)
        return Command((1.0, *(self.size - 1) * [0.0]))


def watched(noise, delay, dropout=0.0, jitter=0.0):
    """Observations of two robots at y = 0 and y = 5 with a bystander who is there from 1 s on."""
    ways = [Path(np.array([[0.0, y], [9.0, y]])) for y in (0.0, 5.0)]
    robots = [
        RobotAgent(name, BODY, Watcher(), way, 1.0, phase=phase)
        for name, way, phase in zip("ab", ways, (0.0, 0.1), strict=True)
    ]
    walker = ReplayAgent("w", np.array([1.0, 9.0]), np.array([[2.0, 2.0], [2.0, 6.0]]), 0.2)
    channel = Channel(noise, dropout, delay, jitter=jitter)
    settings = Settings(time_limit=3.0, plant_step=0.1, history=1.0, channel=channel)
    run_episode(robots, settings, seed=4, others=[walker])
    return [robot.controller.seen for robot in robots]


@pytest.mark.parametrize("noise", [0.0, 1e-9])
@pytest.mark.parametrize("delay", [0.0, 0.3])
def test_positions_are_those_of_the_time_of_measurement(noise, delay):
    for observations, other, y in zip(watched(noise, delay), "ba", (5.0, 0.0), strict=True):
        assert len(observations) >= 16
        for observation in observations:
            measured = observation.stamp - delay
            seen = {one.ident: one for one in observation.detections}
            assert set(seen) == ({other, "w"} if measured >= 1.0 else {other})
            np.testing.assert_allclose(seen[other].position, (measured, y), atol=1e-7)
            assert (seen[other].radius, seen[other].age) == (0.3, delay)
            if "w" in seen:
                place = (2.0, 2.0 + 0.5 * (measured - 1.0))
                np.testing.assert_allclose(seen["w"].position, place, atol=1e-7)


def test_noise_is_each_observers_own():
    one, other = watched(0.05, 0.0)
    errors = [
        [seen.position[1] - (5.0 if seen.ident == "b" else 0.0)
         for look in looks for seen in look.detections if seen.ident != "w"]
        for looks in (one, other)
    ]  # fmt: skip
    assert np.std(errors[0]) == pytest.approx(0.05, rel=0.6)
    assert errors[0][:5] != errors[1][:5]
    lost = [len(look.detections) for look in watched(0.0, 0.0, 0.5)[0]]
    assert 0 in lost and max(lost) >= 1


@pytest.mark.parametrize("noise", [0.0, 1e-9])
def test_jitter_is_in_the_age_and_in_the_place(noise):
    """One instant for all that a robot detects at a tick, between plant steps too."""
    looks = watched(noise, 0.1, jitter=0.2)
    ages = []
    for observations, other, y in zip(looks, "ba", (5.0, 0.0), strict=True):
        for observation in observations:
            seen = {one.ident: one for one in observation.detections}
            (age,) = {one.age for one in observation.detections}
            measured = observation.stamp - age
            assert set(seen) == ({other, "w"} if measured >= 1.0 else {other})
            np.testing.assert_allclose(seen[other].position, (measured, y), atol=1e-7)
            ages.append(age)
    assert 0.1 <= min(ages) < 0.15 and 0.25 < max(ages) <= 0.3
    assert len(set(ages)) == len(ages)  # of each robot and tick
    again = [
        observation.detections[0].age
        for observations in watched(noise, 0.1, jitter=0.2)
        for observation in observations
    ]
    assert again == ages


def test_ages_are_uniform_and_change_no_noise():
    exact, jittering = Channel(0.1, 0.25, 0.3), Channel(0.1, 0.25, 0.3, jitter=0.06)
    ages = np.array([jittering.age(3, "a", tick) for tick in range(-1000, 3000)])
    assert ages.min() >= 0.3 and ages.max() <= jittering.largest_age == 0.36
    assert abs(ages.mean() - 0.33) < 3 * 0.06 / np.sqrt(12 * ages.size)
    assert ages.std() == pytest.approx(0.06 / np.sqrt(12), rel=0.05)
    assert len({exact.age(3, "a", tick) for tick in range(9)}) == 1
    here = [("x", np.zeros(2), 0.3), ("y", np.ones(2), 0.3)]
    for tick in range(20):
        pairs = zip(
            exact.detections(3, "a", tick, here),
            jittering.detections(3, "a", tick, here),
            strict=True,
        )
        assert all((one.position == other.position).all() for one, other in pairs)
    with pytest.raises(WideberthError, match=r"channel\.jitter"):
        Channel(jitter=-0.01)


@pytest.mark.parametrize(
    ("name", "robot"),
    [
        ("random_crowd", "holonomic_velocity"),
        ("recorded_scene", "holonomic_velocity"),
        ("crowdnav_plus", "holonomic_velocity"),
        ("crossing_3d", "holonomic_3d"),
    ],
)
def test_stamps_jitter_in_scenarios_of_every_kind(name, robot):
    """The log holds the true motion: places detected are on it, at the instant of measurement."""
    if name in ("random_crowd", "crowdnav_plus"):
        pytest.importorskip("pyrvo")
    settings = Settings(
        time_limit=4.0, plant_step=0.05, history=0.0, channel=Channel(0.0, jitter=0.2)
    )
    cast, body = build("scenarios", name).cast(1), build("robots", {"type": robot, "radius": 0.3})
    agents = [place.agent(body, Watcher(size=body.dimension), False) for place in cast.placements]
    run = cast.begin(agents, settings, 1)
    run.advance()
    log = {one.name: one.positions for one in run.episode().agents}
    times, errors, late = run.episode().times, [], []
    for observation in agents[0].controller.seen:
        for one in observation.detections:
            if observation.stamp > 0.2:
                for instant, found in (
                    (observation.stamp - one.age, errors),
                    (observation.stamp, late),
                ):
                    true = [np.interp(instant, times, column) for column in log[one.ident].T]
                    found.append(np.linalg.norm(one.position - true))
    assert len(errors) >= 15
    assert np.nanmax(errors) < 3e-3 < 0.05 < np.nanmax(late)


def test_a_config_sets_the_jitter():
    study, _ = read_experiment("fault_sweep", ["settings.none.channel.jitter=0.01"])
    assert study.settings["none"].channel == Channel(0.0, jitter=0.01)
    assert study.settings["noise_5_cm"].channel == Channel(0.05)
