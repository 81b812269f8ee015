"""A planner that drives on at one speed, and fails for a while: of configs in these tests."""

from dataclasses import dataclass
from typing import final

from wideberth import Command, Observation, Path
from wideberth.framework.controller import Controller
from wideberth.framework.robot import Robot

SPEED = 0.6
"""m/s"""
FAILS = (1.0, 3.0)
"""s after the first command, between which it fails."""


@final
@dataclass
class Moody(Controller):
    """Drives straight on."""

    robot: Robot
    period: float = 0.1
    last_plan = None
    begin: float | None = None

    def reset(self) -> None: ...

    def set_path(self, path: Path) -> None: ...

    def remember(self, observation: Observation) -> None: ...

    def command(self, observation: Observation) -> Command:
        self.begin = observation.stamp if self.begin is None else self.begin
        if FAILS[0] < observation.stamp - self.begin < FAILS[1]:
            raise RuntimeError("in a mood")
        return Command((SPEED, 0.0), 0.0)
