"""The questions that a run answers, each with its tables, and how long each is asked."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TypeAlias

import decision
import endurance
import exported
import hard_set
import many_solves
import nav2_speed
import perturbations
import plugin_speed
import predictor_speed
import risk_speed
import scaling
import solver_speed
import solver_tables
import startup
import sweep_speed
import threads
import tracking
from measuring import Row, Tick
from set_ups import SetUp, set_ups

from wideberth.benchmarks.recorded_instances import Instance

Tables: TypeAlias = dict[str, tuple[str, list[Row]]]
"""Name of the file -> title and rows. Without a title the rows are written and not shown."""
Instances: TypeAlias = dict[str, list[Instance]]
"""The same instances for each region."""


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    Attributes
    ----------
    instances : of the file; None for all.
    rounds : over the instances.
    hard : hard instances made of each kind, where no file of them is given.
    sizes : of the instances made for scaling.
    scaling : rounds over them.
    plugins : regions and robots taken, in alphabetical order; None for all.
    pair : instances of each pair of region and robot, and rounds over them.
    repeats : of each predictor and evaluator, of each start.
    counts : obstacles that predictors are given.
    risks : collision probabilities per call.
    batches : sizes of batches.
    drives : s that a robot drives among walkers with each of these solvers.
    decisions : of each solver with a deadline.
    stages : drives of the planner, and decisions in each.
    sweep : episodes of the sweep, and rounds.
    crowds : that detectors and trackers are shown.
    loops : drives with each of Nav2's controllers, and ticks in each.
    """

    instances: int | None = None
    rounds: int = 5
    hard: int = 4
    sizes: scaling.Sizes = field(default_factory=scaling.Sizes)
    scaling: int = 3
    plugins: int | None = None
    pair: tuple[int, int] = (3, 3)
    repeats: tuple[int, int] = (9, 5)
    counts: tuple[int, ...] = (1, 10, 100, 1000)
    risks: int = 50_000
    batches: tuple[int, ...] = (1, 16, 256, 1024)
    drives: endurance.Durations = field(
        default_factory=lambda: {"riccati": 3600.0, "fatrop": 300.0}
    )
    decisions: int = 20_000
    stages: tuple[int, int] = (3, 60)
    sweep: tuple[int, int] = (200, 3)
    crowds: tracking.Crowds = field(default_factory=tracking.Crowds)
    loops: tuple[int, int] = (1, 220)


QUICK = Extent(
    instances=1,
    rounds=1,
    hard=1,
    sizes=scaling.Sizes((1, 2), (5, 10), (1,), instances=1, seen=(2, 30), decisions=1),
    scaling=1,
    plugins=2,
    pair=(1, 1),
    repeats=(1, 1),
    counts=(1, 3),
    risks=500,
    batches=(1, 2),
    drives={"riccati": 3.0, "fatrop": 3.0},
    decisions=60,
    stages=(1, 3),
    sweep=(2, 1),
    crowds=tracking.Crowds(seconds=1.5),
    loops=(1, 24),
)


@dataclass(frozen=True)
class Question:
    """One piece of a run.

    Attributes
    ----------
    ticks : how often it reports progress.
    ask : measures and returns tables.
    """

    ticks: int
    ask: Callable[[Tick], Tables]


BRIEF = (
    *("startup", "solvers", "hard", "scaling", "plugins", "batches", "predictors", "risks"),
    *("stages", "threads", "export", "tracking", "nav2"),
)
"""Asked of every run."""
NAMES = (*BRIEF, "sweeps", "endurance", "decisions")
"""All of them: what takes half an hour by itself is asked by name alone."""


def questions(instances: Instances, hard: Path | None, extent: Extent) -> dict[str, Question]:
    """Return all questions, in the order in which they are asked."""
    plain = next(iter(instances.values()))
    _, starts = extent.repeats
    hard_instances = hard_ones(hard, extent)
    able = hard_set.candidates()
    pairs = len(plugin_speed.pairs(extent.plugins))
    found = {
        "startup": Question(starts + 1, partial(_startup, extent)),
        "solvers": Question(
            solver_speed.steps(set_ups(), plain, extent.rounds),
            partial(_solvers, instances, extent),
        ),
        "hard": Question(
            solver_speed.steps(able, next(iter(hard_instances.values())), 1),
            partial(_hard, able, hard_instances),
        ),
        "scaling": Question(
            scaling.ticks(extent.sizes, extent.scaling), partial(_scaling, extent)
        ),
        "plugins": Question(pairs, partial(_plugins, extent)),
        "batches": Question(many_solves.ticks(extent.batches), partial(_batches, extent, plain)),
        "predictors": Question(len(extent.counts), partial(_predictors, extent)),
        "risks": Question(1, partial(_risks, extent)),
        "stages": Question(decision.ticks(extent.stages[0]), partial(_stages, extent)),
        "threads": Question(threads.ticks(starts), partial(_threads, extent)),
        "export": Question(exported.ticks(), partial(_export, extent)),
        "tracking": Question(tracking.ticks(extent.crowds), partial(_tracking, extent)),
        "nav2": Question(nav2_speed.count(extent.loops[0]), partial(_nav2, extent)),
        "sweeps": Question(sweep_speed.ticks(extent.sweep[1]), partial(_sweeps, extent)),
        "endurance": Question(endurance.ticks(extent.drives), partial(_endurance, extent)),
        "decisions": Question(endurance.ticks(_decided(extent)), partial(_decisions, extent)),
    }
    return {name: found[name] for name in NAMES}


def hard_ones(path: Path | None, extent: Extent) -> Instances:
    """Read hard instances, or make them of the sample."""
    able = hard_set.candidates()
    if path is not None:
        return solver_speed.by_region(path, extent.instances, able)
    with TemporaryDirectory() as folder:
        made = Path(folder) / "hard.npz"
        perturbations.perturb(solver_speed.SAMPLE, made, extent.hard, seed=0)
        return solver_speed.by_region(made, None, able)


def _startup(extent: Extent, tick: Tick) -> Tables:
    return {"startup": ("Start-up", startup.measure(extent.repeats[1], tick))}


def _solvers(instances: Instances, extent: Extent, tick: Tick) -> Tables:
    solves = solver_speed.measure(set_ups(), instances, extent.rounds, tick)
    return {
        "solves": ("", solves),
        "solvers": ("Solver set-ups on recorded instances", solver_tables.times(solves)),
        "speedups": ("How many times as fast as a reference", solver_tables.speedups(solves)),
        "quality": ("What they return", solver_tables.quality(solves)),
        "obstacles": ("The same by number of obstacles", solver_tables.by_obstacles(solves)),
    }


def _hard(able: dict[str, SetUp], instances: Instances, tick: Tick) -> Tables:
    solves = solver_speed.measure(able, instances, 1, tick)
    return {
        "hard_solves": ("", solves),
        "hard": ("Hard instances, by kind", hard_set.by_kind(solves)),
        "safe": ("What comes back of hard instances", hard_set.safe(solves)),
    }


def _scaling(extent: Extent, tick: Tick) -> Tables:
    solves = scaling.measure(extent.sizes, extent.scaling, tick)
    rows = scaling.table(solves)
    return {
        "scaling_solves": ("", solves),
        "scaling": ("Growth with obstacles and horizon", rows),
        "slopes": ("Exponents of growth", scaling.slopes(rows)),
        "crowds": ("Decisions among growing crowds", scaling.crowds(extent.sizes, tick)),
    }


def _plugins(extent: Extent, tick: Tick) -> Tables:
    rows = plugin_speed.measure(extent.plugins, *extent.pair, tick)
    return {
        "plugins": ("Region x robot", rows),
        "plugin_totals": ("Region x robot, all pairs", plugin_speed.totals(rows)),
    }


def _batches(extent: Extent, instances: list[Instance], tick: Tick) -> Tables:
    rows = many_solves.measure(extent.batches, instances, tick)
    return {"batches": ("Solves per second", rows)}


def _predictors(extent: Extent, tick: Tick) -> Tables:
    rows = predictor_speed.measure(extent.counts, extent.repeats[0], tick)
    return {"predictors": ("Predictors, one call for all obstacles", rows)}


def _risks(extent: Extent, tick: Tick) -> Tables:
    rows = risk_speed.measure(extent.risks, extent.repeats[0], tick)
    return {"risks": ("Collision probability, one call for all pairs", rows)}


def _stages(extent: Extent, tick: Tick) -> Tables:
    whole, stages = decision.measure(*extent.stages, tick)
    return {
        "whole": ("Whole decisions, observation included", whole),
        "stages": ("Where their time goes", stages),
    }


def _threads(extent: Extent, tick: Tick) -> Tables:
    rows = threads.measure(extent.repeats[1], tick)
    return {"threads": ("An episode with one thread of BLAS and with the default", rows)}


def _export(extent: Extent, tick: Tick) -> Tables:
    if exported.missing():
        return {}
    return {
        "export": ("The exported solver and Python's call", exported.measure(extent.rounds, tick))
    }


def _tracking(extent: Extent, tick: Tick) -> Tables:
    rows = tracking.measure(extent.crowds, tick)
    return {"tracking": ("Detectors and trackers among people", rows)}


def _nav2(extent: Extent, tick: Tick) -> Tables:
    rows = nav2_speed.measure(*extent.loops, tick)
    return {"nav2": ("Ticks of Nav2's loop, ten people around", rows)}


def _sweeps(extent: Extent, tick: Tick) -> Tables:
    return {
        "sweeps": (
            "A sweep with two workers and with one",
            sweep_speed.measure(*extent.sweep, tick),
        )
    }


def _decided(extent: Extent) -> endurance.Durations:
    return dict.fromkeys(("riccati", "fatrop"), extent.decisions * endurance.PERIOD)


def _decisions(extent: Extent, tick: Tick) -> Tables:
    rows, ends = endurance.measure(_decided(extent), tick, endurance.PERIOD)
    return {
        "decisions": ("Decisions among ten walkers with a deadline of 50 ms", rows),
        "decisions_ends": ("How its plans came about", ends),
    }


def _endurance(extent: Extent, tick: Tick) -> Tables:
    rows, ends = endurance.measure(extent.drives, tick)
    return {
        "endurance": ("A robot among ten walkers at 20 Hz", rows),
        "endurance_ends": ("How its plans came about", ends),
    }
