"""What the regions of a forecast or plan promise: which event, with what probability, and why."""

from dataclasses import dataclass
from enum import Enum
from typing import final

from .errors import WideberthError


class Event(Enum):
    """What happens with the promised probability, at the steps of one plan.

    None of them bounds an episode. A plan that keeps its people at all steps with probability
    1 - alpha says nothing of T plans one after the other: 1 - (1 - alpha)^T holds for plans
    whose misses are independent, which those of one recording are not. Only `TASK` counts
    the plans of a whole task, by a smaller share of alpha for each.
    """

    STEP = "one person is in the region of one step"
    LONG_RUN = "over a long time this share of persons and steps is in the region"
    PERSON = "one person is in the regions of all steps"
    PLAN = "all people are in their regions at all steps"
    FIELD = "no true person is nearer to any place at any step than the forecast says"
    TASK = "all people are in their regions at all steps of all plans of a task"


@final
@dataclass(frozen=True)
class Coverage:
    """The contract of a plug-in whose regions promise something.

    Attributes
    ----------
    event : what is promised.
    probability : with which it happens, in words and the class's own fields: "1 - tail".
    assumes : what has to be true or exchangeable for it.
    source : BibTeX key of where it is shown.

    Raises
    ------
    WideberthError : a text is empty.

    Examples
    --------
    >>> made = Coverage(Event.STEP, "1 - tail", "the forecast is right", "lindemann2023safe")
    >>> print(made)
    One person is in the region of one step, with probability 1 - tail, if the forecast is right.
    """

    event: Event
    probability: str
    assumes: str
    source: str

    def __post_init__(self) -> None:
        for name in ("probability", "assumes", "source"):
            if not getattr(self, name).strip():
                raise WideberthError(f"coverage.{name} is empty; wanted words")

    def __str__(self) -> str:
        """Return the promise as one sentence."""
        event = self.event.value
        return (
            f"{event[0].upper()}{event[1:]}, with probability {self.probability}, if "
            f"{self.assumes}."
        )
