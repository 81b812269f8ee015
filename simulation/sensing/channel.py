"""Detections between agents: noisy, delayed, sometimes lost."""

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
    stated : whether detections carry the covariance of this noise. If not, a planner estimates
        how noisy what it sees is; of recorded people that includes the recording's own noise.

    Raises
    ------
    WideberthError : noise or delay below 0, dropout outside [0, 1).
    """

    noise: float = 0.01
    dropout: float = 0.0
    delay: float = 0.0
    stated: bool = True

    def __post_init__(self) -> None:
        positive("channel.noise", self.noise, zero=True)
        positive("channel.dropout", self.dropout, zero=True)
        positive("channel.delay", self.delay, zero=True)
        if self.dropout >= 1.0:
            raise WideberthError(
                f"channel.dropout is {self.dropout:g}; wanted a probability below 1"
            )

    @property
    def exact(self) -> bool:
        """Whether detections have neither noise nor loss."""
        return not (self.noise or self.dropout)

    def detections(
        self, seed: int, observer: str, tick: int, bodies: Sequence[tuple[str, Array, float]]
    ) -> tuple[Detection, ...]:
        """Detect bodies (name, position (D,), radius); a NaN position is absent.

        The noise hangs on the seed, the two names and the tick alone, not on who else is
        there or in which order they are listed. Ticks before time 0 are negative.
        """
        seen = []
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
            seen.append(Detection(name, noisy, covariance, radius, self.delay))
        return tuple(seen)


def noise_of(seed: int, observer: str, name: str, tick: int) -> np.random.Generator:
    """Return the random generator of one agent's measurement of another (or itself) at a tick."""
    key = (seed, _number(observer), _number(name), 2 * abs(tick) + (tick < 0))
    return np.random.default_rng(key)


def _number(name: str) -> int:
    return crc32(name.encode())
