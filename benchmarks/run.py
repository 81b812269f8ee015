"""Measure speed and write tables: ``python benchmarks/run.py``; see README.md beside it."""

import os

# One thread each: the planner shares its robot with everything else, and a pool of threads
# makes times depend on who else runs. Must stand before NumPy and CasADi are imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import logging
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import report
import solver_speed
import targets
from questions import BRIEF, NAMES, QUICK, Extent, Question, Tables, questions
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from set_ups import set_ups

from wideberth.framework import WideberthError
from wideberth.framework.plugins.io import write_text

ROOT = Path(__file__).resolve().parents[1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write, print; 2 where the input is of no use."""
    options = _options(arguments)
    logging.getLogger("wideberth").setLevel(logging.CRITICAL)  # the tables count the same
    extent = QUICK if options.quick else replace(Extent(), rounds=options.rounds)
    extent = replace(extent, crowds=replace(extent.crowds, folder=options.people))
    file = options.instances
    try:
        instances = solver_speed.by_region(options.instances, extent.instances, set_ups())
        count = len(next(iter(instances.values())))
        if not count:
            return _refuse(f"{options.instances} holds no instance; wanted one at least")
        file = options.hard
        asked = questions(instances, options.hard, extent)
        options.out.mkdir(parents=True, exist_ok=True)
        write_text(options.out / ".writable", "").unlink()
    except OSError as error:
        return _refuse(f"{error.filename}: {error.strerror}; check --instances, --hard and --out")
    except WideberthError as error:
        return _refuse(error)
    except (ValueError, TypeError):  # the right names, arrays of other shapes
        return _refuse(f"{file} is no file of recorded instances; wanted a .npz")
    console = Console()
    paper = Console(width=max(console.width, 180))  # the widest table is not cut
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    try:
        tables = _measure({name: asked[name] for name in options.only}, console)
    except KeyboardInterrupt:
        return _refuse("stopped; nothing was written")
    head = report.header(options, extent, count, load, tables)
    written = report.write(tables, head, options.out)
    for title, rows in tables.values():
        if title:
            report.show(paper, title, rows)
    paper.print(head, f"written to {options.out}: {', '.join(written)}", sep="\n", highlight=False)
    return 0


def _measure(asked: dict[str, Question], console: Console) -> Tables:
    """Ask all questions under one progress bar."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    tables: Tables = {}
    with Progress(*columns, console=console, transient=True) as progress:
        total = sum(question.ticks for question in asked.values())
        task = progress.add_task("starting", total=total)

        def tick(description: str) -> None:
            progress.update(task, description=description[:44].ljust(44), advance=1)

        for question in asked.values():
            tables |= question.ask(tick)
    aims = targets.table({name: rows for name, (_, rows) in tables.items()})
    return tables | ({"targets": ("What was aimed at", aims)} if aims else {})


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Measure speed and write tables.")
    sample = solver_speed.SAMPLE
    parser.add_argument(
        "--instances", type=Path, default=sample, help="recorded instances (default: the sample)"
    )
    parser.add_argument("--hard", type=Path, help="hard instances (default: made of the sample)")
    parser.add_argument(
        "--people",
        default=Extent().crowds.folder,
        help="folder of recordings, `frame id x y`, for tracking (default: synthetic crowds)",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "bench", help="folder")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=NAMES,
        default=BRIEF,
        help="questions (default: all but sweeps, endurance and decisions, which take long)",
    )
    parser.add_argument(
        "--rounds", type=_rounds, default=Extent.rounds, help="over the instances (default: 5)"
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


if __name__ == "__main__":
    sys.exit(main())
