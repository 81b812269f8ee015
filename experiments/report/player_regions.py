"""The sets that the plans of an episode keep out of, for the player."""

from dataclasses import dataclass
from pathlib import Path
from typing import final

from ...framework.mpc.planner.planner import Planner
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.plan import Plan
from ...simulation.log.episode_log import AgentLog, Episode
from ..drawing.kept_out import kept_out_of, planner_behind
from ..engine.closed_loop import log_name
from ..engine.runner import reopen
from ..engine.showing import told

_OUTLINES = 4_000  # in a page: some seconds of work and 0.3 MB
_APART = (1, 2, 3, 5, 8, 12)  # kept steps from one outline to the next


@final
@dataclass(frozen=True, eq=False)
class Shown:
    """What of the forecasts is shown.

    Attributes
    ----------
    tail : 1 - content of the ellipses.
    every : steps from one kept one to the next.
    planner : whose regions are outlined; None where it is not known.
    apart : kept steps from one outline to the next.
    """

    tail: float
    every: int
    planner: Planner | None
    apart: int


def episode_planner(path: Path) -> Planner | None:
    """Return the planner behind a kept episode, read from the result that keeps it.

    None where the file lies elsewhere, its result cannot be opened, or its robots had another
    controller.
    """
    try:
        with told():
            experiment, _ = reopen(path.resolve().parent.parent)
            task = next((one for one in experiment.tasks() if log_name(one) == path.name), None)
    except WideberthError:
        return None
    if task is None:
        return None
    for label, room in (("controller", "controllers"), ("planner", "planners")):
        found = planner_behind(getattr(experiment, room, {}).get(task.settings.get(label)))
        if found is not None:
            return found
    return None


def spacing(episode: Episode, every: int) -> int:
    """How many kept steps lie between kept outlines, where one step in ``every`` is kept."""
    plans = [plan for log in episode.robots for plan in log.plans if plan.forecast is not None]
    entries = sum(plan.level.size for plan in plans) / every
    return next((apart for apart in _APART if entries <= apart * _OUTLINES), _APART[-1])


def outlined(
    episode: Episode, log: AgentLog, plan: Plan, shown: Shown, steps: list[int]
) -> dict[tuple[int, int], list[Array | None]]:
    """`kept_out_of` at the last of some steps and every so manieth before; None at the others."""
    if shown.planner is None:
        return {}
    chosen = range((len(steps) - 1) % shown.apart, len(steps), shown.apart)
    found = kept_out_of(episode, log, plan, shown.planner, [steps[i] for i in chosen])
    kept: dict[tuple[int, int], list[Array | None]] = {}
    for key, rims in found.items():
        kept[key] = [None] * len(steps)
        for i, rim in zip(chosen, rims, strict=True):
            kept[key][i] = rim
    return kept
