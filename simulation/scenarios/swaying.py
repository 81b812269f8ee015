"""People whose motion is uncertain: white noise on the velocity of any controller."""

from dataclasses import dataclass, field, replace
from typing import Any, cast, final

import numpy as np

from ...framework.controller import Controller
from ...framework.values.arrays import positive, whole
from ...framework.values.motion import Command, Observation
from ...framework.values.path import Path
from ...framework.values.plan import Plan
from ..engine.agents import RobotAgent

HEAD_ROOM = 5.0
"""Standard deviations by which a body that sways may be faster than without.

The plant clips what is faster: of two axes, at most exp(-5^2 / 2), four draws in a million.
"""


@final
@dataclass(eq=False)
class Swaying(Controller):
    """Another controller, with white noise on the velocity that it commands.

    ::

        v_k = v(controller)_k + n_k,    n_k ~ N(0, s^2 I),    s^2 T = process_noise^2 update

    with T the controller's period: a position then spreads as that of a body which is moved by
    noise of ``process_noise`` every ``update`` s, process_noise sqrt(update t) per axis after
    t s. The noise hangs on the seed and the time alone.

    Parameters
    ----------
    controller : decides.
    process_noise : m/s per axis, standard deviation.
    seed : of the noise.
    update : s between two draws of the noise that is stood for.

    Raises
    ------
    WideberthError : a number out of range.
    """

    controller: Controller
    process_noise: float
    seed: int
    update: float = 0.05
    period: float = field(init=False)

    def __post_init__(self) -> None:
        positive("swaying.process_noise", self.process_noise, zero=True)
        positive("swaying.update", self.update)
        whole("swaying.seed", self.seed, least=0)
        self.period = self.controller.period

    @property
    def deviation(self) -> float:
        """Standard deviation of the noise on one command, s, per axis, m/s."""
        return float(self.process_noise * np.sqrt(self.update / self.period))

    def reset(self) -> None:
        """Forget everything but the settings."""
        self.controller.reset()

    def set_path(self, path: Path) -> None:
        """Follow this path from now on."""
        self.controller.set_path(path)

    def remember(self, observation: Observation) -> None:
        """Pass the observation on."""
        self.controller.remember(observation)

    def command(self, observation: Observation) -> Command:
        """Decide, and sway; without noise where the observation is useless."""
        command = self.controller.command(observation)
        if observation.flaw:
            return command  # its stop
        rng = np.random.default_rng((self.seed, abs(round(1e6 * observation.stamp))))
        noise = self.deviation * rng.standard_normal(len(command.linear))
        return replace(
            command, linear=tuple(v + float(n) for v, n in zip(command.linear, noise, strict=True))
        )

    @property
    def plan(self) -> Plan | None:
        """The plan of the controller, without the noise."""
        return self.controller.plan


def made_to_sway(person: RobotAgent, process_noise: float, seed: int) -> RobotAgent:
    """Return a person with velocity noise and the top speed for it; see `Swaying`."""
    made = Swaying(person.controller, process_noise, seed)
    body = cast(Any, person.robot)
    fastest = body.max_speed + HEAD_ROOM * made.deviation
    return replace(person, robot=replace(body, max_speed=fastest), controller=made)
