"""Measure speed and write tables: ``python benchmarks/run.py``; see README.md beside it."""

import os

# One thread each: the planner shares its robot with everything else, and a pool of threads
# makes times depend on who else runs. Must stand before NumPy and CasADi are imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import plugin_speed
import predictor_speed
import risk_speed
import solver_speed
import startup
from measuring import Row, cell, markdown
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from wideberth.experiments.provenance import provenance
from wideberth.framework import WideberthError
from wideberth.framework.io import write_table, write_text
from wideberth.framework.mpc.recorded import Instance

ROOT = Path(__file__).resolve().parents[1]
SAMPLE = ROOT / "tests" / "data" / "mpc_instances.npz"


@dataclass(frozen=True)
class Extent:
    """How much is measured.

    Attributes
    ----------
    instances : of the file; None for all.
    rounds : over the instances.
    plugins : regions and robots taken, in alphabetical order; None for all.
    repeats : of each pair of region and robot, of each predictor, of each start.
    counts : obstacles that predictors are given.
    risks : collision probabilities per call.
    """

    instances: int | None = None
    rounds: int = 3
    plugins: int | None = None
    repeats: tuple[int, int, int] = (15, 9, 5)
    counts: tuple[int, ...] = (1, 10, 100, 1000)
    risks: int = 50_000


QUICK = Extent(instances=3, rounds=1, plugins=2, repeats=(2, 1, 1), counts=(1, 3), risks=500)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write, print; 2 where the input is of no use."""
    options = _options(arguments)
    extent = QUICK if options.quick else Extent(rounds=options.rounds)
    try:
        instances = solver_speed.chosen(options.instances, extent.instances)
        if not instances:
            return _refuse(f"{options.instances} holds no instance; wanted one at least")
        options.out.mkdir(parents=True, exist_ok=True)
        write_text(options.out / ".writable", "").unlink()
    except OSError as error:
        return _refuse(f"{error.filename}: {error.strerror}; check --instances and --out")
    except WideberthError as error:
        return _refuse(error)
    except (ValueError, TypeError, BadZipFile):  # NumPy on files of another kind
        return _refuse(f"{options.instances} is no file of recorded instances; wanted a .npz")
    console = Console()
    paper = Console(width=max(console.width, 116))  # the widest table is not cut
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    try:
        tables, solves = _measure(instances, extent, console)
    except KeyboardInterrupt:
        return _refuse("stopped; nothing was written")
    write_table(options.out / "solves.csv", solves)
    head = _header(options, extent, len(instances), load, solver_speed.reference_spread(solves))
    text = [f"# Benchmarks\n\n{head}"]
    for name, (title, rows) in tables.items():
        write_table(options.out / f"{name}.csv", rows)
        text.append(markdown(title, rows))
        _print(paper, title, rows)
    write_text(options.out / "bench.md", "\n".join(text))
    files = ", ".join(f"{name}.csv" for name in ("solves", *tables))
    paper.print(head, f"written to {options.out}: bench.md, {files}", sep="\n", highlight=False)
    return 0


def _measure(
    instances: list[Instance], extent: Extent, console: Console
) -> tuple[dict[str, tuple[str, list[Row]]], list[Row]]:
    """Take all times under one progress bar."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    total = solver_speed.steps(instances, extent.rounds) + len(extent.counts)
    total += len(plugin_speed.pairs(extent.plugins)) + extent.repeats[2] + 2
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("starting", total=total)

        def tick(description: str) -> None:
            progress.update(task, description=description[:44].ljust(44), advance=1)

        starts = startup.measure(extent.repeats[2], tick)
        solves = solver_speed.measure(instances, extent.rounds, tick)
        plugins = plugin_speed.measure(extent.plugins, extent.repeats[0], tick)
        predictors = predictor_speed.measure(extent.counts, extent.repeats[1], tick)
        risks = risk_speed.measure(extent.risks, extent.repeats[1], tick)
    tables = {
        "solvers": ("Solver set-ups on recorded instances", solver_speed.times(solves)),
        "quality": ("What they return", solver_speed.quality(solves)),
        "obstacles": ("The same by number of obstacles", solver_speed.by_obstacles(solves)),
        "plugins": ("Region x robot, one obstacle", plugins),
        "predictors": ("Predictors, one call for all obstacles", predictors),
        "risks": ("Collision probability, one call for all pairs", risks),
        "startup": ("Start-up", starts),
    }
    return tables, solves


def _header(
    options: argparse.Namespace, extent: Extent, count: int, load: float, spread: float
) -> str:
    """Machine and protocol, as a Markdown list."""
    origin = provenance()
    versions = ", ".join(
        f"{name} {origin['versions'][name]}" for name in ("casadi", "numpy", "statsmodels")
        if origin["versions"].get(name)
    )  # fmt: skip
    plugins, predictors, starts = extent.repeats
    known = "an unknown amount, in a single round" if spread != spread else f"{100 * spread:.0f} %"
    return "\n".join(
        [
            f"- Machine: {origin['cpu']}, {os.cpu_count()} cores, {origin['system']}, load "
            f"average {load:.1f} at the start; {os.environ['OMP_NUM_THREADS']} thread(s).",
            f"- Software: Python {origin['python']}, {versions}, commit {origin['commit']}, "
            f"source {origin['source']}.",
            f"- Instances: {count} of {options.instances.name}, {extent.rounds} round(s); "
            f"repeats: {plugins} per region and robot, {predictors} per predictor, {starts} per "
            "start.",
            "- Ratios: best repeat over the best repeat of the reference that README.md names, "
            "of the same work in the same run.",
            f"- Spread: repeats of one instance by {solver_speed.REFERENCE!r} differ by {known} "
            "(max over min, median over instances).",
            "",
        ]
    )


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Measure speed and write tables.")
    parser.add_argument(
        "--instances", type=Path, default=SAMPLE, help="recorded instances (default: the sample)"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "bench", help="folder")
    parser.add_argument(
        "--rounds", type=_rounds, default=Extent.rounds, help="over the instances (default: 3)"
    )
    parser.add_argument("--quick", action="store_true", help="a dry run: no figure means anything")
    return parser.parse_args(arguments)


def _rounds(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r}; wanted a whole number of at least 1")
    return int(text)


def _refuse(why: object) -> int:
    print(f"benchmarks: {why}", file=sys.stderr)
    return 2


def _print(console: Console, title: str, rows: list[Row]) -> None:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    for name in rows[0]:
        number = any(isinstance(row[name], int | float) for row in rows)
        heading = name.replace("_", "\n")
        table.add_column(heading, justify="right" if number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(cell(value) for value in row.values()))
    console.print(table)


if __name__ == "__main__":
    sys.exit(main())
