"""Who is told what of whom, with and without noise."""

from dataclasses import dataclass

import numpy as np
import pytest

from wideberth.framework.controller import Controller
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
        return Command((1.0, 0.0))


def watched(noise, delay, dropout=0.0):
    """Observations of two robots at y = 0 and y = 5 with a bystander who is there from 1 s on."""
    ways = [Path(np.array([[0.0, y], [9.0, y]])) for y in (0.0, 5.0)]
    robots = [
        RobotAgent(name, BODY, Watcher(), way, 1.0, phase=phase)
        for name, way, phase in zip("ab", ways, (0.0, 0.1), strict=True)
    ]
    walker = ReplayAgent("w", np.array([1.0, 9.0]), np.array([[2.0, 2.0], [2.0, 6.0]]), 0.2)
    settings = Settings(
        time_limit=3.0, plant_step=0.1, history=1.0, channel=Channel(noise, dropout, delay)
    )
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
