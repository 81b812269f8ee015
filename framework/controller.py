"""The Controller interface: our planner is one, every rival is another."""

from abc import ABC, abstractmethod
from dataclasses import fields, is_dataclass
from typing import cast

from .errors import WideberthError
from .motion import Command, Observation
from .path import Path
from .plan import Plan


class Controller(ABC):
    """Turns observations into velocity commands at a fixed rate.

    The paper's planner is a controller plug-in of Nav2 in ROS 2; this one is plain Python.

    Laws, checked by `wideberth.framework.testing.check_controller`: `command` never raises
    and always returns finite numbers; after `reset` it behaves as new.
    """

    period: float
    """s between two calls of `command`."""

    @abstractmethod
    def reset(self) -> None:
        """Forget everything but the settings."""

    @abstractmethod
    def set_path(self, path: Path) -> None:
        """Follow this path from now on; what is known of obstacles is kept."""

    @abstractmethod
    def remember(self, observation: Observation) -> None:
        """Take note of what is seen without deciding anything (before the start, say)."""

    @abstractmethod
    def command(self, observation: Observation) -> Command:
        """Decide. Whatever a plug-in throws becomes a status, and the command a safe one."""

    @property
    @abstractmethod
    def plan(self) -> Plan | None:
        """The plan behind the last command; None before the first, or without a horizon."""


def fresh(controller: Controller) -> Controller:
    """Return another controller with the same settings: every robot needs one of its own."""
    if not is_dataclass(controller):
        raise WideberthError(
            f"{type(controller).__name__} is no dataclass; a controller's settings are its "
            "fields, so that it can be built again for every robot"
        )
    settings = {f.name: getattr(controller, f.name) for f in fields(controller) if f.init}
    return cast(Controller, type(controller)(**settings))
