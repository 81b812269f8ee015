"""Robots that tell each other where they are: the world of the paper's text."""

from collections.abc import Sequence
from itertools import chain
from math import ceil
from typing import final

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.motion import Detection, Observation, Truth
from ...framework.values.polygon import Polygon
from ..sensing.channel import noise_of
from .agents import Bystander, RobotAgent
from .driver import Driver
from .plant import KinematicPlant, Plant
from .settings import Settings
from .world import Around, World


@final
class ExchangedPositions(World):
    """Plants without a modelling error, positions by a channel, states by a localisation.

    Parameters
    ----------
    settings : channel, localisation, and how much of the future an oracle is given.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._moment: tuple[float, int] | None = None
        self._known: list[tuple[Driver | None, tuple[Detection, ...]]] = []

    def plants(
        self,
        agents: Sequence[RobotAgent],
        others: Sequence[Bystander],
        polygons: Sequence[Polygon],
        seed: int,
    ) -> list[Plant]:
        """Return the planner's own model of each, at a finer step."""
        return [self.newcomer(agent) for agent in agents]

    def newcomer(self, agent: RobotAgent) -> Plant:
        """Return the planner's own model, at a finer step."""
        return KinematicPlant.at_start(agent)

    def clone(self) -> "ExchangedPositions":
        """Return another world with the same settings: there is nothing else to it."""
        return ExchangedPositions(self._settings)

    def observe(
        self, driver: Driver, time: float, tick: int, state: Array, around: Around
    ) -> Observation:
        """Return positions by the channel, and the state by the localisation."""
        settings = self._settings
        seen = self._detections(driver, time, tick, around)
        truth = self._truth(driver, time, around) if driver.agent.truth and time >= 0 else None
        if settings.localisation.exact:
            return Observation(time, state, seen, None, around.polygons, truth)
        rng = noise_of(around.seed, driver.name, driver.name, tick)
        robot, control = driver.agent.robot, driver.plant.control
        estimate, covariance = settings.localisation.measure(robot, state, control, rng)
        return Observation(time, estimate, seen, covariance, around.polygons, truth)

    def _detections(
        self, driver: Driver, time: float, tick: int, around: Around
    ) -> tuple[Detection, ...]:
        """Return the detections of a driver at a time, s, up to the last instant of the clock.

        Without noise, jitter and loss all agents observe the same, which is made only once.
        """
        channel = self._settings.channel
        measured = time - channel.age(around.seed, driver.name, tick)
        if not channel.exact:
            bodies = [body for one, body in _bodies(measured, around) if sees(driver, one)]
            return channel.detections(around.seed, driver.name, tick, bodies)
        if self._moment != (measured, len(around.clock)):
            self._moment = measured, len(around.clock)
            self._known = [
                (one, channel.detections(around.seed, "", tick, [body]))
                for one, body in _bodies(measured, around)
            ]
        return tuple(chain.from_iterable(seen for one, seen in self._known if sees(driver, one)))

    def _truth(self, driver: Driver, now: float, around: Around) -> Truth:
        """Past and future of the others on a grid of 0.1 s, from the largest age before now on."""
        past = ceil(10 * self._settings.channel.largest_age) + 10
        ahead = ceil(10 * self._settings.truth_span) + 1
        times = now + 0.1 * np.arange(-past, ahead + 1, dtype=np.float64)
        before = times < now
        positions: dict[str, Array] = {other.name: other.at(times) for other in around.others}
        for other in around.drivers:
            if other is not driver:
                seen = [other.position_at(float(time), around.clock) for time in times[before]]
                future = other.future(times[~before], now)
                positions[other.name] = np.concatenate([np.array(seen), future])
        return Truth(times, positions)


def _bodies(
    measured: float, around: Around
) -> list[tuple[Driver | None, tuple[str, Array, float]]]:
    """Name, position and radius of all, with the driver of those who decide."""
    bodies: list[tuple[Driver | None, tuple[str, Array, float]]] = [
        (one, (one.name, one.position_at(measured, around.clock), one.radius))
        for one in around.drivers
    ]
    asked = np.array([measured])
    bodies += [(None, (one.name, one.at(asked)[0], one.radius)) for one in around.others]
    return bodies


def sees(driver: Driver, other: Driver | None) -> bool:
    """Whether one driver detects another; None is a bystander."""
    if other is None or not driver.agent.person:
        return other is not driver
    courteous = driver.agent.courteous or other.agent.person
    return other is not driver and other.agent.visible and courteous
