"""What it costs to be wrong about people: true courtesy against assumed courtesy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, Self, TypeAlias, final

import numpy as np

from ...framework.controller import Controller
from ...framework.mpc.planner.planner import Planner
from ...framework.numerics.statistics import bootstrap_interval, known_mean, mcnemar
from ...framework.values.arrays import Array, probability
from ...framework.values.errors import WideberthError
from ...predictors.reacting_people import ReactingPeople
from ...simulation.engine.settings import Settings
from ...simulation.scenarios.base import Scenario
from ...simulation.scenarios.partly_courteous import PartlyCourteous
from ..drawing.plotting import PAGE, paper_style, save, subplots
from ..drawing.shaded_tables import shaded
from ..engine.base import Experiment, Outcome, Result, Row, Task
from ..engine.closed_loop import (
    check_settings,
    check_starts,
    column,
    first_of,
    group,
    inputs_of,
    pick,
    seeds_of,
)
from .comparison import against, condensed, measured, paired
from .variants import planner_of

Belief: TypeAlias = Literal["fixed", "updated"]
CERTAIN = "certain"
"""Belief where 0 or 1 is assumed, which no observation changes."""
AVOIDABLE = "avoidable_2s_reacting"
"""Column of a contact that the robot could have avoided 2 s before, among people who react."""
COLUMNS = ("episodes", "success", "success_low", "success_high")


@final
@dataclass(frozen=True)
class Place:
    """A scenario, and the planner that drives through it.

    Attributes
    ----------
    scenario : of which every person sees the robot; `PartlyCourteous` is put around it.
    planner : `mpc` with the predictor `reacting_people`, whose courtesy is exchanged.
    settings : how the episodes are run.
    """

    scenario: Scenario
    planner: Controller
    settings: Settings = field(default_factory=Settings)


@final
@dataclass(frozen=True)
class WrongBelief(Experiment):
    """The same planner with each assumed courtesy among people of each true courtesy.

    True courtesy is the probability that a person sees the robot, see `PartlyCourteous`; assumed
    courtesy is the prior of `reacting_people`, held (``fixed``) or followed by Bayes' rule
    (``updated``). Assumed 0 and 1 are the same either way. At one seed all planners meet the same
    situation, and at every true courtesy the same people. Each planner is compared in pairs with
    the one that assumes 0:

    - ``more_contacts`` and ``fewer_contacts`` count the seeds at which one alone touched;
      ``contacts_p`` is McNemar's; ``contact_difference`` the mean difference of the share of
      episodes with a contact, with its bootstrap interval of 95 %;
    - ``only_this``, ``only_baseline``, ``p_value`` and ``time_difference_s`` are those of
      `comparison`, of success and of the time where both arrived;
    - ``clearance_difference_m`` is that of the least clearance, with its interval.

    ``avoidable`` counts the contacts that the robot could have avoided 2 s before, while people
    react (`wideberth.simulation.measures.avoidable`).

    Parameters
    ----------
    places : by name.
    true, assumed : courtesies in [0, 1]; 0 must be among those assumed.
    beliefs : what becomes of an assumed courtesy other than 0 and 1.
    seeds : number of episodes of each combination.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content that forecasts and regions are measured against.
    """

    claim: ClassVar[str] = (
        "A planner that expects people to make way for it drives faster where they do; what does "
        "it cost where they do not?"
    )
    reference: ClassVar[str] = "helbing1995social,vandenberg2011reciprocal,mcnemar1947note"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "wrong_belief": (
            "Success, contacts, time and least clearance by the courtesy that people have (down) "
            "and the courtesy that the planner assumes (across): dark is better."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("success", "contacts", "contact_difference")
    printed: ClassVar[tuple[str, ...]] = (
        *("true", "assumed", "belief", "episodes", "success", "contacts", "contact_difference"),
        *("contacts_p", "time_mean_s", "clearance_median_m"),
    )

    places: dict[str, Place]
    true: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0)
    assumed: tuple[float, ...] = (0.0, 0.25, 0.5, 1.0)
    beliefs: tuple[Belief, ...] = ("fixed", "updated")
    seeds: int = 10
    first_seed: int = 0
    tail: float = 0.05

    def __post_init__(self) -> None:
        named = {name: getattr(self, name) for name in ("places", "true", "assumed", "beliefs")}
        check_settings(self, **named)
        for name in ("true", "assumed", "beliefs"):
            if len(set(named[name])) < len(named[name]):
                raise WideberthError(f"{name} is {named[name]}; wanted each of them once")
        for value in (*self.true, *self.assumed):
            probability("courtesy", value, closed=True)
        if 0.0 not in self.assumed:
            raise WideberthError(
                f"assumed is {self.assumed}; wanted 0 among them, which the others are compared "
                "with"
            )
        for place in self.places.values():
            with_courtesy(place.planner, 0.0, CERTAIN)

    @property
    def planners(self) -> list[tuple[float, str]]:
        """Assumed courtesy and belief of each planner."""
        return [
            (assumed, belief)
            for assumed in self.assumed
            for belief in ((CERTAIN,) if assumed in (0.0, 1.0) else self.beliefs)
        ]

    def tasks(self) -> list[Task]:
        """One per place, true courtesy, planner and seed."""
        return [
            Task(
                f"{place} {true:g} {assumed:g} {belief} {seed}",
                seed,
                {"place": place, "true": true, "assumed": assumed, "belief": belief},
            )
            for place in self.places
            for true in self.true
            for assumed, belief in self.planners
            for seed in seeds_of(self)
        ]

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(place.scenario for place in self.places.values())

    def check(self) -> None:
        """Begin an episode at every place with every planner."""
        for name, place in self.places.items():
            planners: dict[str, Controller] = {
                f"assumed {assumed:g}, {belief}": with_courtesy(place.planner, assumed, belief)
                for assumed, belief in self.planners
            }
            scenario = {name: PartlyCourteous(place.scenario, self.true[0])}
            check_starts(scenario, planner_of(place.planner).robot, planners, self.first_seed)

    def measure(self, task: Task) -> Outcome:
        """Play one episode."""
        labels = task.settings
        place = self.places[labels["place"]]
        planner = with_courtesy(place.planner, labels["assumed"], labels["belief"])
        scenario = PartlyCourteous(place.scenario, labels["true"])
        return measured(scenario, planner.robot, planner, place.settings, task, self.tail)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per place, true courtesy and planner, paired with the one that assumes 0."""
        lines: list[Row] = []
        keys = ("place", "true", "assumed", "belief")
        played = group(rows, *keys)
        for labels, own in played.items():
            none = played[*labels[:2], 0.0, CERTAIN]
            lines.append({**dict(zip(keys, labels, strict=True)), **_line(own, none)})
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw a table per place and measure, true courtesy down and planners across."""
        with paper_style():
            return save(draw(self.summary(result.rows)), folder, "wrong_belief")

    def quick(self) -> Self:
        """Play one seed at the first place, of true courtesy 0 with 0 and 1 assumed."""
        return replace(
            self, places=first_of(self.places), true=(0.0,), assumed=(0.0, 1.0), seeds=1
        )


def with_courtesy(controller: Controller, assumed: float, belief: str) -> Planner:
    """Return the planner with an assumed courtesy.

    Raises
    ------
    WideberthError : the controller is no `mpc`, or has another predictor than `reacting_people`.
    """
    planner = planner_of(controller)
    predictor = planner.predictor
    if not isinstance(predictor, ReactingPeople):
        raise WideberthError(
            f"planner.predictor is {type(predictor).__name__}; wanted `type: reacting_people`, "
            "whose courtesy this experiment exchanges"
        )
    held = replace(predictor, courtesy=assumed, update_courtesy=belief != "fixed")
    return replace(planner, predictor=held)


def _line(own: Sequence[Row], none: Sequence[Row]) -> Row:
    """Condense the episodes of a planner, and compare it with the one that assumes 0."""
    times, clearance = column(own, "success_time"), column(own, "clearance")
    avoidable = column(own, AVOIDABLE)
    return {
        **pick(condensed(own), COLUMNS),
        "contacts": int(column(own, "collision").sum()),
        "avoidable": int(np.nansum(avoidable)),
        "time_mean_s": known_mean(times),
        "clearance_median_m": float(np.median(clearance)),
        **against(own, none),
        **contacts_against(own, none),
        **_difference("clearance_difference", "m", _gap(own, none, "clearance")),
    }


def contacts_against(rows: Sequence[Row], others: Sequence[Row]) -> Row:
    """Compare the contacts of two planners seed by seed; the columns of `WrongBelief`."""
    this, other = paired(rows, others, "collision"), paired(others, rows, "collision")
    return {
        "more_contacts": int(np.sum(this > other)),
        "fewer_contacts": int(np.sum(other > this)),
        "contacts_p": mcnemar(this, other),
        **_difference("contact_difference", "", this - other),
    }


def _gap(rows: Sequence[Row], others: Sequence[Row], name: str) -> Array:
    return np.asarray(paired(rows, others, name) - paired(others, rows, name))


def _difference(name: str, unit: str, gap: Array) -> Row:
    """Mean of the known differences, and its bootstrap interval of 95 %."""
    low, high = bootstrap_interval(gap[np.isfinite(gap)], np.random.default_rng(0))
    end = f"_{unit}" if unit else ""
    return {f"{name}{end}": known_mean(gap), f"{name}_low{end}": low, f"{name}_high{end}": high}


SHOWN = (
    ("success", "arrived without a contact", ".2f", True),
    ("contacts", "episodes with a contact", ".0f", False),
    ("time_mean_s", "time of those who arrived (s)", ".1f", False),
    ("clearance_median_m", "least clearance, median (m)", ".2f", True),
)
"""Column of the summary, title and format of each table, and whether more is better."""


def draw(lines: Sequence[Row]) -> Any:
    """Draw a table for each place and measure; dark is better, and the number is in its cell."""
    places = group(lines, "place")
    true = list(dict.fromkeys(line["true"] for line in lines))
    planners = list(dict.fromkeys((line["assumed"], line["belief"]) for line in lines))
    wide = PAGE / 2 * len(SHOWN) / 2
    height = 0.9 + len(places) * 2 * (0.5 + 0.2 * len(true))
    figure, axes = subplots(
        2 * len(places), len(SHOWN) // 2, figsize=(wide, height), squeeze=False
    )  # fmt: skip
    for i, ((place,), own) in enumerate(places.items()):
        found = {(line["true"], line["assumed"], line["belief"]): line for line in own}
        for k, (name, title, form, more) in enumerate(SHOWN):
            panel = axes[2 * i + k // 2, k % 2]
            cells = [[found[one, *other][name] for other in planners] for one in true]
            table = np.array([[np.nan if v is None else float(v) for v in row] for row in cells])
            shaded(panel, table, form, better_high=more)
            panel.set_title(f"{str(place).replace('_', ' ')}: {title}", fontsize=7)
            panel.set_yticks(range(len(true)), [f"{one:g}" for one in true])
            panel.set_xticks(range(len(planners)), [_named(*one) for one in planners], fontsize=6)
    for panel in axes[:, 0]:
        panel.set_ylabel("true courtesy")
    for panel in axes[-1]:
        panel.set_xlabel("assumed courtesy")
    return figure


def _named(assumed: float, belief: str) -> str:
    return f"{assumed:g}" if belief == CERTAIN else f"{assumed:g}\n{belief}"
