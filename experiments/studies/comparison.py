"""Controllers in the same situations: who arrives, who touches, how fast; and chance."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from textwrap import fill
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller, driving
from ...framework.mpc.planner.planner import planner_behind
from ...framework.plugins.io import write_bytes, write_table
from ...framework.robot import Robot
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...metrics.statistics import bootstrap_interval, clopper_pearson, known_mean, mcnemar
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.measures.episode_measures import measures
from ...simulation.scenarios.base import Scenario
from ..drawing.plotting import ENOUGH, PAGE, few, number, paper_style, save, subplots
from ..drawing.trade_off_markers import (
    front_legend,
    front_looks,
    mark,
    say_empty,
    widen,
    widen_time,
)
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    EPISODE_CAPTIONS,
    check_settings,
    check_shown,
    check_starts,
    column,
    could_avoid,
    first_of,
    grid,
    group,
    inputs_of,
    log_name,
    outcome,
    play,
    seeds_of,
)

AXES = {
    "scenario": "scenarios",
    "robot": "robots",
    "settings": "settings",
    "controller": "controllers",
}
"""Column of the table -> field of the experiment."""
SOURCES = (
    "clopper1934use,mcnemar1947note,efron1993introduction,perezhigueras2023hunavsim,"
    "biswas2022socnavbench,balasubramanian2015analysis"
)
"""Keys of what the columns of `measured`, `condensed` and `against` are taken from."""

ANSWERS = (
    *("episodes", "success", "collision", "time_mean_s", "clearance_median_m", "intrusion_share"),
    *("time_difference_s", "p_value", "price_of_uncertainty_s", "judged_outcome", "errors"),
)
"""Columns of the summary that say who arrives, who touches, how fast, how near, and by chance."""


@final
@dataclass(frozen=True)
class Comparison(Experiment):
    """Every controller in every scenario with every robot under all settings, on the same seeds.

    A controller with a field ``robot`` is given the robot that it drives; its own must be one
    of ``robots`` (a planner made for another one is a mistake). At one seed all controllers
    meet the same situation and the same noise, so that they are compared in pairs. Columns are
    defined in docs/metrics.md; a scenario with rules of its own (`Scenario.judge`) adds
    ``judged_...``.

    Parameters
    ----------
    scenarios : by name; each seed draws the same situation for every controller.
    robots : models of the plants, by name.
    controllers : by name.
    settings : clock, noise and end of the episodes, by name; a sweep over faults has several.
    seeds : number of episodes of each combination.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    baseline : controller that the others are compared with in pairs; empty for the first.
    oracle : controller that knows the future; the extra time against it is the
        ``price_of_uncertainty_s``. Empty for none.
    show : seeds whose episodes are kept and drawn; one of each scenario is animated.
    tail : 1 - content that forecasts and regions are measured against.
    """

    claim: ClassVar[str] = (
        "In the same situations: which controller arrives without touching anybody, how fast, "
        "how near to others, and is the difference more than chance?"
    )
    reference: ClassVar[str] = SOURCES
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "outcomes": (
            "Share of the episodes in which each controller arrived, waited too long, stood "
            "still or touched something."
        ),
        "clearance_against_time": (
            "Least clearance against time to the goals: upper left is better, and hollow "
            "markers had failures."
        ),
        "paired_times": (
            "Time beyond the baseline's at the seeds at which both arrived: right of 0 is slower."
        ),
        "trends": "Success, time and clearance over the places that the study compares.",
        **EPISODE_CAPTIONS,
    }
    headline: ClassVar[tuple[str, ...]] = ("success", "collision", "time_mean_s")
    printed: ClassVar[tuple[str, ...]] = ANSWERS

    scenarios: dict[str, Scenario]
    robots: dict[str, Robot]
    controllers: dict[str, Controller]
    settings: dict[str, Settings] = field(default_factory=lambda: {"nominal": Settings()})
    seeds: int = 20
    first_seed: int = 0
    baseline: str = ""
    oracle: str = ""
    show: tuple[int, ...] = ()
    tail: float = 0.05

    def __post_init__(self) -> None:
        check_settings(self, **{name: getattr(self, name) for name in AXES.values()})
        for name in ("baseline", "oracle"):
            named = getattr(self, name)
            if named and named not in self.controllers:
                raise WideberthError(
                    f"{name} is {named!r}; the controllers are {sorted(self.controllers)}"
                )
        check_shown(self.show, self.first_seed, self.seeds)
        check_robots(
            {f"scenarios.{name}": one for name, one in self.scenarios.items()},
            {f"robots.{name}": one for name, one in self.robots.items()},
            {f"controllers.{name}": one for name, one in self.controllers.items()},
        )

    def tasks(self) -> list[Task]:
        """One per scenario, robot, settings, controller and seed."""
        axes = {column: getattr(self, name) for column, name in AXES.items()}
        return grid(axes, seeds_of(self))

    def inputs(self) -> list[Path]:
        """Return the files that the scenarios read."""
        return inputs_of(self.scenarios.values())

    def check(self) -> None:
        """Begin an episode of the first seed in every scenario with every robot and controller."""
        for robot in self.robots.values():
            driven = {name: driving(one, robot) for name, one in self.controllers.items()}
            check_starts(self.scenarios, robot, driven, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        scenario, robot, settings, controller = (
            getattr(self, name)[task.settings[column]] for column, name in AXES.items()
        )
        driven = driving(controller, robot)
        return measured(scenario, robot, driven, settings, task, self.tail, self.show)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per scenario, robot, settings and controller, paired with the baseline.

        Of scenario, robot and settings those are named of which there are several.
        """
        places = [name for name in AXES if name != "controller"]
        lines = []
        for labels, some in group(rows, *places).items():
            known = dict(zip(places, labels, strict=True))
            head = {name: known[name] for name in places if len(getattr(self, AXES[name])) > 1}
            played = {name: own for (name,), own in group(some, "controller").items()}
            for name, own in played.items():
                line = {**head, "controller": name, **condensed(own)}
                line |= against(own, played[self._baseline()])
                if self.oracle:
                    price = against(own, played[self.oracle])["time_difference_s"]
                    line["price_of_uncertainty_s"] = price
                lines.append(line)
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw outcomes, times against clearances, pairs and trends, and the shown episodes."""
        kept = [task for task in self.tasks() if task.seed in self.show]
        return [
            *draw_summary(self.summary(result.rows), result.rows, self._baseline(), folder),
            *draw_episodes(result, kept, self.controllers, self.tail, folder),
        ]

    def quick(self) -> Self:
        """Play one seed to its end, in the first scenario with the first robot and settings.

        Cut short, no episode would have an arrival, and there would be nothing to compare.
        """
        return replace(
            self,
            scenarios=first_of(self.scenarios),
            robots=first_of(self.robots),
            settings=first_of(self.settings),
            seeds=1,
            show=tuple(seed for seed in self.show if seed == self.first_seed),
        )

    def _baseline(self) -> str:
        return self.baseline or next(iter(self.controllers))


def measured(
    scenario: Scenario,
    robot: Robot,
    controller: Controller,
    settings: Settings,
    task: Task,
    tail: float,
    show: Sequence[int] = (),
) -> TaskOutcome:
    """Play the episode of a task and measure all there is; keep it where its seed is shown."""
    episode = play(scenario, robot, controller, settings, task.seed)
    made = outcome(episode, task, tail, keep=task.seed in show)
    made.rows[0].update(measures(episode, tail, settings.time_limit))
    made.rows[0].update(could_avoid(episode, scenario, robot, controller, settings))
    judged = scenario.judge(episode)
    made.rows[0].update({f"judged_{name}": value for name, value in judged.items()})
    return made


def check_robots(
    scenarios: Mapping[str, Scenario],
    robots: Mapping[str, Robot],
    controllers: Mapping[str, Controller],
) -> None:
    """Refuse robots for which scenarios have no room, and controllers made for other robots.

    Parameters
    ----------
    scenarios, robots, controllers : by where they stand in the config ("robots.unicycle").

    Raises
    ------
    WideberthError : a robot larger than a scenario's ``robot_radius``; a controller whose own
        robot is none of these, or that refuses one of them.
    """
    for place, scenario in scenarios.items():
        room = scenario.robot_radius or float("inf")
        for name, robot in robots.items():
            if robot.radius > room + 1e-9:
                raise WideberthError(
                    f"{place} has room for a robot of radius {room:g} m, and {name} has "
                    f"{robot.radius:g} m: set the scenario's robot_radius"
                )
    for name, controller in controllers.items():
        own = getattr(controller, "robot", None)
        if own is not None and own not in robots.values():
            raise WideberthError(
                f"{name} drives {own}, unlike {' and '.join(robots)}: write the robot once with a "
                "YAML anchor"
            )
        for robot in robots.values():
            driving(controller, robot)


MEANS = {
    "length_ratio": "length_ratio_worst",
    "intrusion_share": "intrusion_share",
    "freeze_share": "freeze_share",
    "jerk_rms": "jerk_rms",
    "social_work": "social_work",
    "coverage": "coverage",
}
"""Column of the summary -> column of the table whose mean over the episodes it is."""

COULD = "avoidable_"
"""Beginning of the columns that are shares of the first contacts, where there are any."""

LABELS = ("scenario", "robot", "settings", "controller", "seed")
"""Columns that say which episode it was."""

_SEED = 0
"""Of the bootstrap's draws: the same table gives the same summary."""


def shares(rows: Sequence[Row]) -> Row:
    """Share of each outcome; of success and collision with intervals of 95 %."""
    line: Row = {}
    outcomes = [row["outcome"] for row in rows]
    for name in ("success", "collision"):
        count = outcomes.count(name)
        low, high = clopper_pearson(count, len(rows))
        line |= {name: count / len(rows), f"{name}_low": low, f"{name}_high": high}
    return line | {name: outcomes.count(name) / len(rows) for name in ("timeout", "deadlock")}


def condensed(rows: Sequence[Row]) -> Row:
    """Condense the episodes of one controller in one place into a line; see docs/metrics.md."""
    times = column(rows, "success_time")
    clearance = column(rows, "clearance")
    plans = column(rows, "plans").sum()
    line = {
        "episodes": len(rows),
        **shares(rows),
        "time_mean_s": known_mean(times),
        "time_median_s": _median(times),
        "time_penalised_s": float(column(rows, "penalised_time").mean()),
        "clearance_min_m": float(clearance.min()),
        "clearance_median_m": float(np.median(clearance)),
        **{name: known_mean(column(rows, source)) for name, source in MEANS.items()},
        "frozen": float(column(rows, "frozen").mean()),
        "fallback_plans": float(column(rows, "fallbacks").sum() / plans) if plans else 0.0,
        "deadline_misses": int(column(rows, "deadline_misses").sum()),
        "errors": next((str(row["errors"]) for row in rows if row["errors"]), ""),
    }
    line |= {name: known_mean(column(rows, name)) for name in rows[0] if name.startswith(COULD)}
    judged = [name for name in rows[0] if name.startswith("judged_")]
    found = {name: _judgement([row[name] for row in rows]) for name in judged}
    return line | {name: value for name, value in found.items() if value is not None}


def against(rows: Sequence[Row], others: Sequence[Row]) -> Row:
    """Compare a controller with another one, seed by seed.

    ``only_this`` and ``only_baseline`` count the seeds at which one succeeded alone,
    ``p_value`` is McNemar's; ``time_difference_s`` is the mean of this one's time minus the
    other's over the seeds at which both succeeded, with its bootstrap interval of 95 %.
    """
    this, other = paired(rows, others, "success"), paired(others, rows, "success")
    gap = paired(rows, others, "success_time") - paired(others, rows, "success_time")
    low, high = bootstrap_interval(gap[np.isfinite(gap)], np.random.default_rng(_SEED))
    return {
        "only_this": int(np.sum(this > other)),
        "only_baseline": int(np.sum(other > this)),
        "p_value": mcnemar(this, other),
        "time_difference_s": known_mean(gap),
        "time_difference_low_s": low,
        "time_difference_high_s": high,
    }


def paired(rows: Sequence[Row], others: Sequence[Row], name: str) -> Array:
    """One column at the seeds that both played, in order of the seed."""
    common = {row["seed"] for row in rows} & {row["seed"] for row in others}
    kept = sorted((row for row in rows if row["seed"] in common), key=lambda row: row["seed"])
    return column(kept, name)


def means(rows: Sequence[Row]) -> Row:
    """Mean over the episodes of every column of numbers or truths, of what is known."""
    skipped = (*LABELS, "judged")
    numbers = [
        name
        for name in rows[0]
        if not name.startswith(skipped) and not any(isinstance(row[name], str) for row in rows)
    ]
    return {"episodes": len(rows), **{name: known_mean(column(rows, name)) for name in numbers}}


def promised(rows: Sequence[Row]) -> Row:
    """Hold what plans promised against what happened; NaN for controllers without plans.

    Per step the means over the episodes, with bootstrap intervals of 95 % of what happened (the
    episode is the unit: its steps depend on each other); per episode the share in which a first
    step, the one that is driven, would have touched, with its Clopper-Pearson interval.
    """
    line: Row = {"episodes": len(rows)}
    for promise, kept in (("tail_nominal", "tail_observed"), ("step_risk", "step_touched")):
        values = column(rows, kept)
        rng = np.random.default_rng(_SEED)
        low, high = bootstrap_interval(values[np.isfinite(values)], rng)
        line |= {promise: known_mean(column(rows, promise)), kept: known_mean(values)}
        line |= {f"{kept}_low": low, f"{kept}_high": high}
    touched = column(rows, "episode_touched")
    touched = touched[np.isfinite(touched)]
    low, high = clopper_pearson(int(touched.sum()), len(touched))
    line |= {"episode_risk": known_mean(column(rows, "episode_risk"))}
    line |= {"episode_touched": known_mean(touched)}
    return line | {"episode_touched_low": low, "episode_touched_high": high}


def _median(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _judgement(values: Sequence[Any]) -> float | str | None:
    """Mean of numbers and truths; how often each text occurs; None where nothing was judged."""
    if all(value is None for value in values):
        return None
    if any(isinstance(value, str) for value in values):
        words = [str(value) for value in values]
        return ", ".join(f"{word} {words.count(word)}" for word in sorted(set(words)))
    return known_mean(np.array([np.nan if v is None else v for v in values], dtype=np.float64))


PLACES = ("scenario", "robot", "settings")
"""Where controllers are compared; a panel each."""
PARTS = {
    "success": {"color": "0.88"},
    "timeout": {"color": "white", "hatch": "//////"},
    "deadlock": {"color": "white", "hatch": "xxxxxx"},
    "collision": {"color": "0.25"},
}
"""Outcome -> how its part of a bar looks."""
TRENDS = {
    "success": "share that arrives\nwithout touching",
    "time_median_s": "time to the goals (s),\nmedian",
    "clearance_median_m": "least clearance (m),\nmedian",
}
"""Column of the summary -> label of its panel of trends."""


def draw_summary(
    lines: Sequence[Row], rows: Sequence[Row], baseline: str, folder: Path
) -> list[Path]:
    """Draw all figures of the table and write it condensed: all means, and promises kept.

    Parameters
    ----------
    lines : of the summary.
    rows : of the table.
    baseline : controller that the others are paired with.
    folder : for the figures.
    """
    names = list(dict.fromkeys(str(row["controller"]) for row in rows))
    with paper_style():
        files = save(_outcomes(rows), folder, "outcomes")
        files += save(_front(rows, names), folder, "clearance_against_time")
        if len(names) > 1:
            files += save(_pairs(rows, names, baseline), folder, "paired_times")
        if len(_panels(rows)) > 2:
            files += save(_trends(rows, lines, names), folder, "trends")
    groups = group(rows, *PLACES, "controller")
    labels = [dict(zip((*PLACES, "controller"), key, strict=True)) for key in groups]
    every = [{**one, **means(own)} for one, own in zip(labels, groups.values(), strict=True)]
    files.append(write_table(folder / "means.csv", every))
    kept = [{**one, **promised(own)} for one, own in zip(labels, groups.values(), strict=True)]
    return [*files, write_table(folder / "promises.csv", kept)]


def draw_episodes(
    result: Result,
    kept: Sequence[Task],
    controllers: Mapping[str, Controller],
    tail: float,
    folder: Path,
) -> list[Path]:
    """Draw the run of every kept episode, and animate the first one of each scenario."""
    from ..drawing.animation import animate
    from ..drawing.episodes import draw_run

    files: list[Path] = []
    animated: set[str] = set()
    for task in kept:
        episode = Episode.from_bytes(result.read(log_name(task)))
        name = log_name(task).removesuffix(".npz").replace(" ", "_")
        with paper_style():
            files += save(draw_run(episode), folder, f"run_{name}")
        if task.settings["scenario"] not in animated:
            animated.add(task.settings["scenario"])
            planner = planner_behind(controllers[task.settings["controller"]])
            film = animate(episode, tail=tail, planner=planner)
            files.append(write_bytes(folder / f"animation_{name}.gif", film))
    return files


def _panels(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of each place by its title, which names what differs between the places."""
    varying = [name for name in PLACES if len({row[name] for row in rows}) > 1]
    return {
        ", ".join(map(str, key)).replace("_", " "): some
        for key, some in group(rows, *varying).items()
    }


def _grid(count: int, height: float, **options: Any) -> tuple[Any, list[Any]]:
    """Return a figure with so many panels, at most three in a row, and the panels."""
    wide = min(count, 3)
    deep = -(-count // wide)
    figure, axes = subplots(
        deep, wide, figsize=(PAGE * (0.4 + 0.2 * wide), 0.7 + height * deep), squeeze=False,
        layout="constrained", **options,
    )  # fmt: skip
    for panel in axes.flat[count:]:
        panel.set_visible(False)
    return figure, list(axes.flat[:count])


def _outcomes(rows: Sequence[Row]) -> Any:
    """Draw a bar per controller, a panel per place; of one controller a bar per place."""
    panels = _panels(rows)
    own = {title: group(some, "controller") for title, some in panels.items()}
    bars = {
        title: {str(name): some for (name,), some in found.items()} for title, found in own.items()
    }
    if len({row["controller"] for row in rows}) == 1:
        bars = {str(rows[0]["controller"]): panels}
    most = max(map(len, bars.values()))
    figure, axes = _grid(len(bars), 0.5 + 0.24 * most, sharey=True)
    for panel, (title, found) in zip(axes, bars.items(), strict=True):
        panel.set_title(title)
        for i, some in enumerate(found.values()):
            _bar(panel, -i, some)
        labels = [name.replace("_", " ") for name in found]
        panel.set_yticks(-np.arange(len(found)), labels)
        panel.set_xlim(0.0, 1.0)
        panel.grid(visible=False)
    for panel in axes[-3:]:
        panel.set_xlabel("share of episodes")
    handles, names = axes[0].get_legend_handles_labels()
    played = [len(some) for found in bars.values() for some in found.values()]
    figure.legend(
        handles[: len(PARTS)], names[: len(PARTS)], loc="outside lower center", ncols=4,
        title=few(played) or "whiskers: intervals of 95 %, above of success, below of collision",
        title_fontsize=7,
    )  # fmt: skip
    return figure


def _bar(panel: Any, place: float, rows: Sequence[Row]) -> None:
    """Draw outcomes from left to right; above and below the intervals of first and last.

    Fewer than `ENOUGH` episodes have no intervals.
    """
    found = shares(rows)
    left = 0.0
    for name, look in PARTS.items():
        panel.barh(
            place, found[name], 0.7, left, edgecolor="black", linewidth=0.5, label=name, **look
        )
        left += found[name]
    if len(rows) < ENOUGH:
        return
    for name, aside in (("success", 0.17), ("collision", -0.17)):
        ends = np.array([found[f"{name}_low"], found[f"{name}_high"]])
        ends = ends if name == "success" else 1.0 - ends
        for width, colour in ((2.2, "white"), (1.0, "black")):
            panel.plot(
                ends, [place + aside] * 2, "|-", color=colour, linewidth=width, markersize=4
            )


def _front(rows: Sequence[Row], names: Sequence[str]) -> Any:
    """Draw median clearance against median time, a panel per place."""
    looks, drawn = front_looks(names), set()
    panels = _panels(rows)
    figure, axes = _grid(len(panels), 2.2)
    for panel, (title, some) in zip(axes, panels.items(), strict=True):
        panel.set_title(title)
        places = {
            str(name): mark(panel, own, "success_time", looks[str(name)])
            for (name,), own in group(some, "controller").items()
        }
        never = [name.replace("_", " ") for name, place in places.items() if place is None]
        missing = [fill(f"(no success: {', '.join(never)})", 36)] if never else []
        if len(never) == len(places):
            missing = []
            say_empty(panel)
        else:
            panel.axhline(0.0, color="black", linewidth=0.8)
            panel.margins(y=0.14)
            widen(panel)
        drawn |= {name for name, place in places.items() if place is not None}
        panel.set_xlabel("\n".join(["time to the goals (s)", *missing]))
    for panel in axes[:: min(len(axes), 3)]:
        panel.set_ylabel("least clearance (m)")
    known = {name: look for name, look in looks.items() if name in drawn}
    front_legend(figure, known, [len(own) for own in group(rows, *PLACES, "controller").values()])
    return figure


def _pairs(rows: Sequence[Row], names: Sequence[str], baseline: str) -> Any:
    """Draw a dot per seed at which both arrived, the mean and its interval.

    Fewer than `ENOUGH` such seeds have no interval; where there is none, the figure says so.
    """
    others = [name for name in names if name != baseline]
    panels = _panels(rows)
    figure, axes = _grid(len(panels), 0.7 + 0.3 * len(others), sharey=True)
    counts: list[int] = []
    for panel, (title, some) in zip(axes, panels.items(), strict=True):
        panel.set_title(title)
        played = {str(name): own for (name,), own in group(some, "controller").items()}
        for i, name in enumerate(others):
            counts.append(_difference(panel, -i, played[name], played[baseline]))
        if any(counts[-len(others) :]):
            panel.axvline(0.0, color="black", linewidth=0.8)
            widen_time(panel)
        else:
            panel.set_xticks([])
            panel.grid(visible=False)
        panel.set_yticks(-np.arange(len(others)), [name.replace("_", " ") for name in others])
        panel.set_ylim(0.5 - len(others), 0.55)
        panel.set_xlabel(f"time beyond that of {baseline.replace('_', ' ')} (s)")
    _pairs_legend(figure, [count for count in counts if count])
    return figure


def _pairs_legend(figure: Any, counts: Sequence[int]) -> None:
    """Say what is drawn, if there is anything."""
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], linestyle="", marker=".", color="0.6", markersize=4, label="one seed"),
        Line2D([], [], linestyle="", marker="D", color="black", markersize=3, label="mean"),
    ]
    if any(count >= ENOUGH for count in counts):
        entries.append(Line2D([], [], color="black", linewidth=1.2, label="its interval of 95 %"))
    words = "seeds at which both arrived"
    if not counts:
        entries, words = [], "there is no seed at which both arrived: no times to compare"
    elif min(counts) < ENOUGH:
        words += f" (no interval of fewer than {ENOUGH})"
    figure.legend(
        handles=entries, loc="outside lower center", ncols=3, title=words, title_fontsize=7
    )


def _difference(panel: Any, place: float, own: Sequence[Row], base: Sequence[Row]) -> int:
    """Draw one controller against the baseline; return at how many seeds both arrived."""
    gap = paired(own, base, "success_time") - paired(base, own, "success_time")
    known = gap[np.isfinite(gap)]
    found = against(own, base)
    spread = np.linspace(-0.14, 0.14, len(known)) if len(known) > 1 else np.zeros(len(known))
    ends = [found["time_difference_low_s"], found["time_difference_high_s"]]
    if len(known) >= ENOUGH:
        panel.plot(ends, [place] * 2, "-", color="black", linewidth=1.2)
    if len(known):
        panel.plot(known, place - 0.25 + 0.7 * spread, ".", color="0.6", markersize=2.5)
        panel.plot(found["time_difference_s"], place, "D", color="black", markersize=3)
    count = f"{found['only_this']} to {found['only_baseline']}"
    chance = number(found["p_value"], ".2g")
    alone = f"both arrived: {len(known)}; one alone: {count}, p = {chance}"
    panel.annotate(
        alone, (1.0, place), xycoords=("axes fraction", "data"), xytext=(-2, 3),
        textcoords="offset points", ha="right", va="bottom", fontsize=5.5,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5},
    )  # fmt: skip
    return len(known)


def _trends(rows: Sequence[Row], lines: Sequence[Row], names: Sequence[str]) -> Any:
    """Draw a line per controller over the places."""
    places = list(_panels(rows))
    found = {name: [line for line in lines if line["controller"] == name] for name in names}
    figure, axes = subplots(1, 3, figsize=(PAGE, 2.7), layout="constrained")
    for panel, (quantity, text) in zip(axes, TRENDS.items(), strict=True):
        for i, (name, some) in enumerate(found.items()):
            at = np.arange(len(places)) + 0.06 * (i - 0.5 * (len(names) - 1))
            values = column(some, quantity)
            (drawn,) = panel.plot(at, values, marker=".", label=name.replace("_", " "))
            if quantity == "success" and min(column(some, "episodes")) >= ENOUGH:
                low, high = column(some, "success_low"), column(some, "success_high")
                panel.vlines(at, low, high, color=drawn.get_color(), linewidth=0.7)
        panel.set_xticks(range(len(places)), places, rotation=90)
        panel.grid(axis="x", visible=False)
        panel.set_ylabel(text)
    axes[0].set_ylim(-0.03, 1.03)
    handles, labels = axes[0].get_legend_handles_labels()
    words = few(int(line["episodes"]) for line in lines)
    figure.legend(
        handles, labels, loc="outside lower center", ncols=4, title_fontsize=7,
        title=words or "bars: intervals of 95 % of the share",
    )  # fmt: skip
    return figure
