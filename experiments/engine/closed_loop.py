"""Closed-loop studies: settings, tasks, one episode played, many condensed."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ...controllers.reactive import Reactive
from ...controllers.recommended import slow_aside
from ...framework.controller import Controller, fresh
from ...framework.mpc.planner.planner import planner_behind
from ...framework.mpc.planner.standing import misfit
from ...framework.robot import Robot
from ...framework.values.arrays import Array
from ...framework.values.passage import passable
from ...metrics.statistics import known_mean
from ...simulation.engine.episode import Run
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.measures.avoidable import avoidable
from ...simulation.measures.first_contact import contact_columns
from ...simulation.measures.summary import summarise, time_rows
from ...simulation.scenarios.base import Cast, Scenario
from .base import Experiment, Row, Task, TaskOutcome
from .errors import as_user_error

LOG = logging.getLogger("wideberth.experiments")


def play(
    scenario: Scenario, robot: Robot, controller: Controller, settings: Settings, seed: int
) -> Episode:
    """Play one episode in which every robot that is examined has the same controller.

    The seed draws the situation and all noise, so that planners compared at one seed meet
    the same situation.
    """
    run = _begun(scenario.cast(seed), robot, controller, settings, seed)
    run.advance()
    return run.episode()


def about_first_contact(
    episode: Episode, scenario: Scenario, robot: Robot, controller: Controller, settings: Settings
) -> Row:
    """Return how the first contact of an episode came about; other arguments as of `play`."""
    cast = scenario.cast(episode.seed)
    robots = [one.agent(robot, controller, truth=False) for one in cast.placements]
    agents = [*robots, *cast.people]
    could = avoidable(episode, agents, settings, cast.bystanders, (), cast.polygons)
    return {**could, **contact_columns(episode, {one.name: robot for one in robots}, could)}


def controllers_of(experiment: Experiment) -> dict[str, Controller]:
    """Return the controllers of a config by name: the key in a mapping, else the field's name."""
    found: dict[str, Controller] = {}
    for entry in fields(experiment):  # type: ignore[arg-type]  # every plug-in is a dataclass
        value = getattr(experiment, entry.name)
        some = value if isinstance(value, Mapping) else {entry.name: value}
        found |= {str(key): one for key, one in some.items() if isinstance(one, Controller)}
    return found


def check_starts(
    scenarios: Mapping[str, Scenario],
    robot: Robot,
    controllers: Mapping[str, Controller],
    seed: int = 0,
) -> None:
    """Initialise every controller in every scenario without stepping.

    A warning is logged where a planner's robot is slow for the people of a scenario, see
    `slow_aside`, or does not fit between the polygons along its path.

    Parameters
    ----------
    scenarios : by the names of the config; "" where it has one only.

    Raises
    ------
    WideberthError : the scenario finds no room for all, or does not fit to robot or controller.
    """
    for label, scenario in scenarios.items():
        place = f"{'scenarios.' if label else 'scenario'}{label}, seed {seed}"
        with as_user_error(f"{place}: no situation can be drawn: "):
            cast = scenario.cast(seed)
        for name, controller in controllers.items():
            with as_user_error(f"{place}: no episode of {name} can begin: "):
                _begun(cast, robot, controller, Settings(history=0.0), seed)
        others = cast.people or cast.bystanders or cast.rules is not None
        planners = [one for each in controllers.values() if (one := planner_behind(each))]
        speeds = {one.reference_speed for one in planners} if others else set()
        tight = [
            misfit(room)
            for path in (one.path for one in cast.placements if robot.dimension == 2)
            for room in sorted({one.room_at_walls for one in planners})
            if not passable(path, 0.0, path.length, room, (), cast.polygons)
        ]
        for words in filter(
            None, [*(slow_aside(robot, speed) for speed in sorted(speeds)), *tight]
        ):
            LOG.warning("%s: %s", place, words)


def inputs_of(scenarios: Iterable[Scenario]) -> list[Path]:
    """Return the files that scenarios read."""
    return [file for scenario in scenarios for file in scenario.inputs()]


def _begun(cast: Cast, robot: Robot, controller: Controller, settings: Settings, seed: int) -> Run:
    """Return an episode at its start."""
    truth = not isinstance(controller, Reactive)  # which could not use it
    robots = [one.agent(robot, fresh(controller), truth) for one in cast.placements]
    return cast.begin(robots, settings, seed)


KEPT_BY = (
    *("scenario", "robot", "settings", "planner", "controller"),
    *("predictor", "region", "level", "cost"),
)
"""Settings of a task that make up the name of a kept episode, where it has them."""


def log_name(task: Task) -> str:
    """Name of the file in which the episode of a task is kept."""
    labels = [str(task.settings[name]) for name in KEPT_BY if name in task.settings]
    return "-".join([*labels, str(task.seed)]) + ".npz"


def outcome(
    episode: Episode, task: Task, tail: float, more: Row | None = None, keep: bool = False
) -> TaskOutcome:
    """Return the row and the measured times of an episode.

    Parameters
    ----------
    episode, task : what was played, and at which point of the grid.
    tail : 1 - content that the plans are measured against.
    more : further columns.
    keep : whether the episode itself is kept.
    """
    labels = {**task.settings, "seed": task.seed}
    return TaskOutcome(
        rows=[{**labels, **summarise(episode, tail), **(more or {})}],
        times=[{**labels, **row} for row in time_rows(episode)],
        files={log_name(task): episode.to_bytes()} if keep else {},
    )


def group(rows: Sequence[Row], *keys: str) -> dict[tuple[Any, ...], list[Row]]:
    """Rows by the values of some columns, in the order in which they first appear."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row)
    return groups


def column(rows: Sequence[Row], name: str) -> Array:
    """One column as numbers; empty cells are NaN."""
    values = [np.nan if row[name] is None else row[name] for row in rows]
    return np.array(values, dtype=np.float64)


def condense(rows: Sequence[Row]) -> Row:
    """Condense episodes into one line; definitions in `wideberth.metrics.episode`.

    ``goals_in_time`` is the share of episodes in which every robot reached its goal within
    twice its free time; ``time_ratio`` the median over episodes of the slowest robot's time
    over its free time, ``extra_time_s`` of what it took beyond that: NaN, all three, where a
    robot arrived whose reference speed is unknown. ``below_reference`` is the
    share of plans that hold less content than the reference, ``least_content`` the least that any
    holds, and ``gave_way`` says when and for whom; ``coverage`` is the share of later positions
    inside the forecasts' regions.
    """
    ratio = column(rows, "time_ratio_worst")
    clearance = column(rows, "clearance")
    plans = column(rows, "plans").sum()
    return {
        "episodes": len(rows),
        "collisions": int(column(rows, "collision").sum()),
        "deadlocks": int(column(rows, "deadlock").sum()),
        "goals_in_time": float(np.where(np.isnan(ratio), np.nan, ratio <= 2.0).mean()),
        "clearance_min_m": float(clearance.min()),
        "clearance_median_m": float(np.median(clearance)),
        "time_ratio": float(np.median(ratio)),
        "extra_time_s": float(np.median(column(rows, "extra_time_worst"))),
        "length_ratio": float(np.median(column(rows, "length_ratio_worst"))),
        "below_reference": float(np.mean(column(rows, "below_reference"))),
        **_given_way(rows),
        "fallback_plans": float(column(rows, "fallbacks").sum() / plans) if plans else 0.0,
        "deadline_misses": int(column(rows, "deadline_misses").sum()),
        "errors": next((str(row["errors"]) for row in rows if row["errors"]), ""),
        "named_forecasts": known_mean(column(rows, "named_forecasts")),
        "coverage": known_mean(column(rows, "coverage")),
    }


def _given_way(rows: Sequence[Row]) -> Row:
    """Least content of all episodes, and how that plan gave way."""
    held = column(rows, "least_content")
    if np.isnan(held).all():
        return {"least_content": float("nan"), "gave_way": ""}
    least = int(np.nanargmin(held))
    return {"least_content": float(held[least]), "gave_way": rows[least]["gave_way"] or ""}


def pick(row: Mapping[str, Any], names: Sequence[str]) -> Row:
    """Return some columns of a line, in this order."""
    return {name: row[name] for name in names}
