"""How an episode is run."""

from dataclasses import dataclass, field
from typing import Literal, final

from ...framework.values.arrays import positive, whole
from ...framework.values.errors import WideberthError
from ..sensing.channel import Channel
from ..sensing.localisation import Localisation

STILL = 0.02
"""m/s; a robot below it stands."""


@final
@dataclass(frozen=True)
class Settings:
    """Clock, noise and end of an episode.

    Parameters
    ----------
    time_limit : s.
    plant_step : s, the plant's step. Events between two steps cut a step in two.
    history : s before time 0 during which the robots see each other come.
    goal_tolerance : m; a robot within it has reached its goal.
    solve_time : when a command takes effect: "zero" (at once), a number of seconds later,
        or as much later as the call took ("measured", which no second run repeats). A
        controller that is busy lets its ticks pass; meanwhile the robot follows its last
        plan and stops at the plan's end (without a plan it keeps to the command before).
        The paper's robots drive on while they compute, as with "measured".
    channel : what the robots learn of each other.
    localisation : how well they know where they are themselves.
    deadlock_after : s; when all robots that are not at their goals have stood this long,
        the episode ends as a deadlock.
    stop_on_collision : end at the first collision of a robot (by default it goes on).
    truth_span : s into the future that the oracle is given. People are simulated for as long
        whenever it asks, which takes most of its time.
    truth_passes : how often a robot with an oracle plans per decision; each time but the first it
        is given what people do in answer to the plan before.

    Raises
    ------
    WideberthError : a number out of range.
    """

    time_limit: float = 120.0
    plant_step: float = 0.02
    history: float = 40.0
    goal_tolerance: float = 0.25
    solve_time: float | Literal["zero", "measured"] = "zero"
    channel: Channel = field(default_factory=Channel)
    localisation: Localisation = field(default_factory=Localisation)
    deadlock_after: float = 10.0
    stop_on_collision: bool = False
    truth_span: float = 12.0
    truth_passes: int = 1

    def __post_init__(self) -> None:
        for name in ("time_limit", "plant_step", "goal_tolerance", "deadlock_after", "truth_span"):
            positive(f"settings.{name}", getattr(self, name))
        positive("settings.history", self.history, zero=True)
        whole("settings.truth_passes", self.truth_passes)
        if isinstance(self.solve_time, str):
            if self.solve_time not in ("zero", "measured"):
                raise WideberthError(
                    f"settings.solve_time is {self.solve_time!r}; wanted 'zero', 'measured' or "
                    "a number of seconds"
                )
        else:
            positive("settings.solve_time", self.solve_time, zero=True)

    def latency(self, measured: float) -> float:
        """Seconds until a command takes effect, given how long it took to compute."""
        if self.solve_time == "measured":
            return measured
        return 0.0 if self.solve_time == "zero" else float(self.solve_time)
