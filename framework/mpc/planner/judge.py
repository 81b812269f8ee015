"""The Judge interface: by what plans are compared, and where the solver starts."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

from ...robot import Robot
from ...values.arrays import Array
from ...values.forecast import Forecast
from ...values.path import Path
from ...values.plan import Rung
from ...values.polygon import Polygon
from ...values.tracks import Tracks
from ..ocp.transcription import Guess
from .instance import Instance
from .multistart import MultiStartResult
from .starts import Starts
from .verify import Candidate, totals

EXPECTED_CONTACT = "wideberth.controllers.judging.expected_contact:ExpectedContact"
"""What a config means by ``expected_contact``."""


@dataclass(frozen=True, eq=False)
class Judge(ABC):
    """What the plans of one planning cycle are judged by."""

    loyal: ClassVar[bool] = False
    """Whether the plan at hand is kept while it will do: the one that continues the last plan
    round what stays in the way, and braking straight on where that meets nothing."""
    reason: ClassVar[str] = ""
    """Why a plan that keeps every constraint did not become `Optimal`; "" leaves it to the
    solver's words."""

    @abstractmethod
    def starts(self, names: Starts) -> Starts:
        """Return the solver's further starting points, of those that the planner is set to."""

    @abstractmethod
    def first(self, instance: Instance, guess: Guess) -> Guess:
        """Return what the solver starts from first, given the last plan."""

    @abstractmethod
    def judged(self, instance: Instance, outcome: MultiStartResult) -> MultiStartResult:
        """Return the solver's outcome with the candidates that go on, and what each costs."""

    @abstractmethod
    def harm(self, candidates: Sequence[Candidate]) -> Array:
        """Return by what candidates that enter regions are compared, (C,)."""


@dataclass(frozen=True)
class Judging(ABC):
    """How a planner judges plans; a setting of it."""

    usual: ClassVar[frozenset[Rung]] = frozenset({Rung.OPTIMAL})
    """Rungs of plans that need no warning."""

    @abstractmethod
    def held_clear(self, forecast: Forecast) -> Forecast:
        """Return the forecast whose regions the problem holds."""

    @abstractmethod
    def judge(
        self,
        robot: Robot,
        dt: float,
        way: tuple[Path, float, float],
        seen: tuple[Forecast, Tracks] | None,
        walls: Sequence[Polygon],
        margins: tuple[float, float],
    ) -> Judge:
        """Return the judge of one cycle.

        Parameters
        ----------
        robot, dt : whose plans, and s per step.
        way : path, arc and speed, in m and m/s. seen : the forecast of the tracks; None for none.
        walls : polygons. margins : m, beside people and beside walls.
        """


@final
@dataclass(frozen=True, eq=False)
class CostJudge(Judge):
    """The cost of the problem alone decides, and how much regions are entered."""

    loyal: ClassVar[bool] = True

    def starts(self, names: Starts) -> Starts:
        """Return all of them."""
        return names

    def first(self, instance: Instance, guess: Guess) -> Guess:
        """Return the last plan."""
        return guess

    def judged(self, instance: Instance, outcome: MultiStartResult) -> MultiStartResult:
        """Return the outcome as it is."""
        return outcome

    def harm(self, candidates: Sequence[Candidate]) -> Array:
        """Return the sums of the deepest entries into regions."""
        return totals([one.found for one in candidates])


@final
@dataclass(frozen=True)
class ByCost(Judging):
    """Judges plans by the cost of the problem alone."""

    def held_clear(self, forecast: Forecast) -> Forecast:
        """Return all of it."""
        return forecast

    def judge(
        self,
        robot: Robot,
        dt: float,
        way: tuple[Path, float, float],
        seen: tuple[Forecast, Tracks] | None,
        walls: Sequence[Polygon],
        margins: tuple[float, float],
    ) -> Judge:
        """Return the same judge for every cycle."""
        return CostJudge()
