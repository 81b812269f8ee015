"""Detections between agents: noisy, delayed, at jittering instants, sometimes lost."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final
from zlib import crc32

import numpy as np

from ...framework.values.arrays import Array, positive
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Detection


@final
@dataclass(frozen=True)
class Channel:
    """Exchange of positions between the agents of an episode.

    The paper's robots tell each other their positions, which mimics perception and
    tracking; its text has neither noise nor loss. A noise above zero matters: a VAR model
    fitted to noise-free straight driving is singular.

    Parameters
    ----------
    noise : m, standard deviation of each coordinate.
    dropout : probability that one robot does not get one position.
    delay : s between measurement and arrival.
    jitter : s; detections are up to this much older than ``delay``. A robot measures all that it
        detects at a tick at one instant, whose age is drawn uniformly: delay + jitter U(0, 1).
    stated : whether detections carry the covariance of this noise. If not, a planner estimates
        how noisy what it sees is; of recorded people that includes the recording's own noise.

    Raises
    ------
    WideberthError : noise, delay or jitter below 0, dropout outside [0, 1).
    """

    noise: float = 0.01
    dropout: float = 0.0
    delay: float = 0.0
    stated: bool = True
    jitter: float = 0.0

    def __post_init__(self) -> None:
        positive("channel.noise", self.noise, zero=True)
        positive("channel.dropout", self.dropout, zero=True)
        positive("channel.delay", self.delay, zero=True)
        positive("channel.jitter", self.jitter, zero=True)
        if self.dropout >= 1.0:
            raise WideberthError(
                f"channel.dropout is {self.dropout:g}; wanted a probability below 1"
            )

    @property
    def exact(self) -> bool:
        """Whether detections have neither noise nor jitter nor loss."""
        return not (self.noise or self.dropout or self.jitter)

    @property
    def largest_age(self) -> float:
        """Upper bound of the age of a detection, s."""
        return self.delay + self.jitter

    def age(self, seed: int, observer: str, tick: int) -> float:
        """Age of all that a robot detects at a tick, s.

        The age depends on the seed, the observer's name and the tick, and not on who is there.
        """
        if not self.jitter:
            return self.delay
        return self.delay + self.jitter * float(noise_of(seed, observer, "", tick).random())

    def detections(
        self, seed: int, observer: str, tick: int, bodies: Sequence[tuple[str, Array, float]]
    ) -> tuple[Detection, ...]:
        """Detect bodies (name, position (D,), radius); a NaN position is absent.

        The positions are those at the instant of the measurement, `age` s before the tick.

        The noise hangs on the seed, the two names and the tick alone, not on who else is
        there or in which order they are listed. Ticks before time 0 are negative.
        """
        seen, age = [], self.age(seed, observer, tick)
        for name, position, radius in bodies:
            if not np.isfinite(position).all():
                continue
            size, noisy = len(position), position
            if not self.exact:
                rng = noise_of(seed, observer, name, tick)
                if rng.random() < self.dropout:
                    continue
                noisy = position + self.noise * rng.standard_normal(size)
            covariance = self.noise**2 * np.eye(size) if self.stated else None
            seen.append(Detection(name, noisy, covariance, radius, age))
        return tuple(seen)


def noise_of(seed: int, observer: str, name: str, tick: int) -> np.random.Generator:
    """Return the random generator of one agent's measurement of another (or itself) at a tick."""
    key = (seed, _number(observer), _number(name), 2 * abs(tick) + (tick < 0))
    return np.random.default_rng(key)


def _number(name: str) -> int:
    return crc32(name.encode())
