"""The Recorder interface: what keeps solves of a planner, to be looked at later."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

from .cycle import Solved
from .settings import PlannerSettings

SOLVE_FILES = "wideberth.controllers.diagnosis.solve_record:Record"
"""What a config means by ``record``."""
SOLVE_RECORD = "wideberth.controllers.diagnosis.explain:SolveRecord"
"""What explains a solve, see `Planner.explain`."""


@dataclass(frozen=True)
class Recorder(ABC):
    """Keeps some of the solves of a planner."""

    @abstractmethod
    def wants(self, solved: Solved) -> bool:
        """Whether this solve is to be kept."""

    @abstractmethod
    def keep(self, settings: PlannerSettings, solved: Solved) -> str:
        """Keep a solve; never raises. Returns why it could not be kept, or nothing."""
