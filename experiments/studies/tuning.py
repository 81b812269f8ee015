"""One factor at a time: what each setting of our planner does to clearance and time."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

from ...framework import Controller, WideberthError, build, describe
from ...framework.controller import driving
from ...framework.plugins.yamlfile import assign
from ...metrics.statistics import pareto
from ..engine.closed_loop import group
from ..engine.text_tables import format_cell
from .comparison_figures import draw_front
from .episode_statistics import SOURCES, against, condensed
from .episodes import OnePlaceStudy, check_robots, measured
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, labelled

BASE = "base"
"""Name of the setting that is varied."""


@final
@dataclass(frozen=True)
class Tuning(OnePlaceStudy):
    """A planner with one setting changed at a time, on the same seeds.

    ``pareto`` marks the settings that none beats: no other one has at least their share of
    success, their median least clearance and their median time to the goal, and more (less) of
    one. The changes are held against the unchanged planner in pairs, seed by seed.

    Parameters
    ----------
    planner : config of the base setting, any controller; it stays as it is stated, so that what
        our recommended planner derives from robot, speed and step follows a factor that changes
        them.
    factors : dotted key of the planner's config, as for ``--set``, and the values it takes; its
        value in the base is left out where it stands among them.

    Attributes
    ----------
    base : the controller that the config makes.
    """

    claim: ClassVar[str] = (
        "Which settings of the planner buy clearance with time, and which buy it for nothing?"
    )
    reference: ClassVar[str] = SOURCES
    printed: ClassVar[tuple[str, ...]] = (
        *("value", "episodes", "success", "p_success", "collision", "time_median_s"),
        *("time_difference_s", "clearance_median_m", "pareto", "judged_outcome", "errors"),
    )

    planner: dict[str, Any] | str
    factors: dict[str, tuple[Any, ...]]
    base: Controller = field(init=False, repr=False)

    def validate(self) -> None:
        """Refuse settings that make no study."""
        if not self.factors:
            raise WideberthError("factors is empty; name a key of the planner and its values")
        if not all(self.factors.values()):
            empty = sorted(key for key, values in self.factors.items() if not values)
            raise WideberthError(f"factors {empty} have no values")
        base: Controller = build("controllers", self.planner, "planner")
        object.__setattr__(self, "base", base)
        check_robots({"scenario": self.scenario}, {"robot": self.robot}, {"planner": base})
        self.variants()

    def variants(self) -> dict[tuple[str, str], Controller]:
        """Factor and value -> the planner with it; the base first."""
        base = driving(self.base, self.robot)
        found = {(BASE, ""): base}
        for factor, values in self.factors.items():
            for value in values:
                assign(describe(base), factor, value, f"factors.{factor}")  # is there such a key?
                changed = self._changed(factor, value)
                if describe(changed) != describe(base):
                    found[factor, worded(value)] = changed
        return found

    def variant(self, factor: str, value: str) -> Controller:
        """Return the planner with one setting changed."""
        if factor == BASE:
            return driving(self.base, self.robot)
        named = {worded(one): one for one in self.factors[factor]}
        return self._changed(factor, named[value])

    def _changed(self, factor: str, value: Any) -> Controller:
        """Return the planner that the config makes with another value of a factor."""
        stated = {"type": self.planner} if isinstance(self.planner, str) else self.planner
        config, place = deepcopy(stated), f"factors.{factor}"
        assign(config, factor, deepcopy(value), place)
        made: Controller = build("controllers", config, place)
        return driving(made, self.robot)

    def axes(self) -> Axes:
        """Each setting."""
        return {("factor", "value"): list(self.variants()), "seed": self.seed_range}

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planner with every setting."""
        return {" ".join(key).strip(): made for key, made in self.variants().items()}

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        planner = self.variant(task.settings["factor"], task.settings["value"])
        return measured(self.scenario, self.robot, planner, self.settings, task, self.tail)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per setting, paired with the base."""
        played = group(rows, "factor", "value")
        base = next(iter(played.values()))
        lines = [condensed(own) | against(own, base) for own in played.values()]
        costs = [
            (-line["success"], -line["clearance_median_m"], line["time_median_s"])
            for line in lines
        ]
        return [
            {"factor": factor, "value": format_cell(value), "pareto": bool(good), **line}
            for (factor, value), line, good in zip(played, lines, pareto(costs), strict=True)
        ]

    def pictures(self, result: Result) -> Pictures:
        """Draw the clearance-against-time front, a panel per factor."""
        yield "tuning", draw_fronts(result.rows)

    def quick(self) -> Self:
        """Play one seed to its end with the first value of the first factor."""
        (key, values), *_ = self.factors.items()
        return replace(self, factors={key: values[:1]}, seeds=1)


def worded(value: Any) -> str:
    """Return a value as a label: numbers short, a plug-in by its type and settings."""
    if isinstance(value, Mapping):
        return " ".join(f"{key} {worded(entry)}" for key, entry in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def draw_fronts(rows: Sequence[Row]) -> Any:
    """Draw the values of each factor beside the base, a panel per factor."""
    base, *others = labelled(rows, "factor", "value")
    shown: list[Row] = []
    for factor in dict.fromkeys(labels["factor"] for labels, _ in others) or [BASE]:
        panel = [(BASE, base[1])]
        panel += [
            (format_cell(one["value"]), own) for one, own in others if one["factor"] == factor
        ]
        place = {"scenario": factor, "robot": "", "settings": ""}
        shown += [{**row, **place, "controller": name} for name, own in panel for row in own]
    return draw_front(shown, list(dict.fromkeys(row["controller"] for row in shown)))
