"""Who detects whom, and at which positions."""

from collections.abc import Sequence
from itertools import chain

import numpy as np

from ...framework.values.arrays import Array
from ...framework.values.motion import Detection
from ..sensing.channel import Channel
from .agents import Bystander
from .driver import Driver


class Detecting:
    """What the robots and people of one episode are told of each other.

    Parameters
    ----------
    channel : how well.
    seed : of its noise.
    drivers, others : who is there.
    """

    def __init__(
        self,
        channel: Channel,
        seed: int,
        drivers: Sequence[Driver],
        others: Sequence[Bystander],
    ) -> None:
        self._channel, self._seed = channel, seed
        self._drivers, self._others = drivers, others
        self._moment: tuple[float, int] | None = None
        self._known: list[tuple[Driver | None, tuple[Detection, ...]]] = []

    def of(
        self, driver: Driver, time: float, tick: int, clock: list[float]
    ) -> tuple[Detection, ...]:
        """Return what a driver detects at a time, s, up to the last instant of the clock.

        Without noise and loss everybody is told the same, which is made only once.
        """
        measured = time - self._channel.delay
        if not self._channel.exact:
            bodies = [body for one, body in self._bodies(measured, clock) if sees(driver, one)]
            return self._channel.detections(self._seed, driver.name, tick, bodies)
        if self._moment != (measured, len(clock)):
            self._moment = measured, len(clock)
            self._known = [
                (one, self._channel.detections(self._seed, "", tick, [body]))
                for one, body in self._bodies(measured, clock)
            ]
        return tuple(chain.from_iterable(seen for one, seen in self._known if sees(driver, one)))

    def _bodies(
        self, measured: float, clock: list[float]
    ) -> list[tuple[Driver | None, tuple[str, Array, float]]]:
        """Name, position and radius of all, with the driver of those who decide."""
        bodies: list[tuple[Driver | None, tuple[str, Array, float]]] = [
            (one, (one.name, one.position_at(measured, clock), one.radius))
            for one in self._drivers
        ]
        asked = np.array([measured])
        bodies += [(None, (one.name, one.at(asked)[0], one.radius)) for one in self._others]
        return bodies


def sees(driver: Driver, other: Driver | None) -> bool:
    """Whether a driver detects somebody; None is a bystander."""
    if other is None:
        return True
    return other is not driver and (other.agent.visible or not driver.agent.person)
