"""One factor at a time: what each setting of our planner does to clearance and time."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import Controller, WideberthError, build, describe
from ...framework.controller import driving
from ...framework.plugins.yamlfile import assign
from ...metrics.statistics import pareto
from ..drawing.plotting import COLOURS, PAGE, entry, subplots
from ..drawing.trade_off_markers import bars_note, mark, nest, say_empty, widen
from ..engine.closed_loop import group
from ..engine.text_tables import format_cell
from .episode_statistics import SOURCES, against, condensed
from .episodes import OnePlaceStudy, check_robots, measured
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome

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
        yield "tuning", draw_fronts(self.summary(result.rows), result.rows)

    def quick(self) -> Self:
        """Play one seed to its end with the first value of the first factor."""
        (key, values), *_ = self.factors.items()
        return replace(self, factors={key: values[:1]}, seeds=1)


def worded(value: Any) -> str:
    """Return a value as a label: numbers short, a plug-in by its type and settings."""
    if isinstance(value, Mapping):
        return " ".join(f"{key} {worded(entry)}" for key, entry in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


BEST = "0.75"
"""Grey of what no other setting beats."""


def draw_fronts(lines: Sequence[Row], rows: Sequence[Row]) -> Any:
    """Draw the settings of each factor beside the base.

    A star stands for the base; behind, in every panel, a grey step joins the settings that no
    other one beats in clearance and time among those that always arrived. Bars and hollow markers
    as in `trade_off_markers.mark`; values at one place share a label.
    """
    played = group(rows, "factor", "value")
    (first, *others) = played
    factors = list(dict.fromkeys(factor for factor, _ in others))
    wide = min(len(factors), 3)
    deep = -(-len(factors) // wide) if factors else 1
    figure, axes = subplots(
        deep, max(wide, 1), figsize=(PAGE * (0.4 + 0.2 * wide), 0.6 + 2.2 * deep), squeeze=False,
        sharex=True, sharey=True, layout="constrained",
    )  # fmt: skip
    for panel in axes.flat[len(factors) :]:
        panel.set_visible(False)
    front = _front(lines)
    for i, factor in enumerate(factors):
        panel, colour = axes.flat[i], COLOURS[1 + i % (len(COLOURS) - 1)]
        panel.set_title(factor)
        panel.plot(*front.T, "-", color=BEST, linewidth=2.5, zorder=0.5)
        place = mark(panel, played[first], "success_time", ("*", COLOURS[0]))
        _values(panel, {key[1]: own for key, own in played.items() if key[0] == factor}, colour)
        nest(panel)
        panel.margins(0.12)
        if place is not None:
            star = next(line for line in panel.lines if line.get_marker() == "*")
            star.set_markersize(star.get_markersize() + 4.0)
            widen(panel)
        if i + wide >= len(factors):  # nothing below it
            panel.tick_params(labelbottom=True)
            panel.set_xlabel("time to the goals (s)")
    if not any(row["success"] for row in rows):
        for panel in axes.flat[: len(factors)]:
            say_empty(panel)
    for panel in axes[:, 0]:
        panel.set_ylabel("least clearance (m)")
    _legend(figure, bars_note(map(len, played.values())))
    return figure


def _values(panel: Any, played: Mapping[Any, Sequence[Row]], colour: str) -> None:
    """Mark the values of a factor, with one label for those at one place."""
    labels: dict[tuple[float, float], list[str]] = {}
    for value, rows in played.items():
        place = mark(panel, rows, "success_time", ("o", colour))
        if place is not None:
            same = next((other for other in labels if np.allclose(other, place)), place)
            labels.setdefault(same, []).append(format_cell(value))
    for place, words in labels.items():
        text = ", ".join(words)
        panel.annotate(text, place, (3, -8), textcoords="offset points", fontsize=6)


def _front(lines: Sequence[Row]) -> Any:
    """Corners of the step that joins the best settings without failures, (K, 2)."""
    safe = [line for line in lines if line["success"] == 1.0]
    points = np.array([(line["time_median_s"], line["clearance_median_m"]) for line in safe])
    if not len(points):
        return np.zeros((0, 2))
    best = points[pareto(points * (1.0, -1.0))]
    best = best[np.argsort(best[:, 0])]
    corners = np.stack([np.append(best[1:, 0], best[-1, 0]), best[:, 1]], axis=1)
    return np.stack([best, corners], axis=1).reshape(-1, 2)


def _legend(figure: Any, words: str) -> None:
    best = {"color": BEST, "linestyle": "-", "linewidth": 2.5}
    entries = [
        entry("base", marker="*", color=COLOURS[0], markersize=9),
        entry("one setting changed", marker="o", color=COLOURS[1]),
        entry("front of those that always arrive", **best),
    ]
    figure.legend(
        handles=entries, loc="outside lower center", ncols=3, title=f"medians; {words}",
        title_fontsize=7,
    )  # fmt: skip
