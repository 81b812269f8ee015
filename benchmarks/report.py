"""Writes tables and figures, and prints them."""

import argparse
import os
from pathlib import Path

import exported
import figures
import solver_tables
from measuring import Row, cell, markdown
from peers import missing
from questions import Extent, Tables
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from set_ups import HONEST

from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.provenance import provenance
from wideberth.framework.plugins.io import write_text


def write(tables: Tables, head: str, out: Path) -> list[str]:
    """Write a CSV of each table, ``bench.md`` with all that are shown, and the figures."""
    text = [f"# Benchmarks\n\n{head}"]
    for name, (title, rows) in tables.items():
        write_table(out / f"{name}.csv", rows)
        if title:
            text.append(markdown(title, rows))
    write_text(out / "bench.md", "\n".join(text))
    drawn = figures.draw({name: rows for name, (_, rows) in tables.items()}, out)
    return ["bench.md", *(f"{name}.csv" for name in tables), *(path.name for path in drawn)]


def show(console: Console, title: str, rows: list[Row]) -> None:
    """Print a table; one wider than the terminal is cut into pieces that repeat its key."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    for name in rows[0]:
        number = any(isinstance(row[name], int | float) for row in rows)
        heading = name.replace("_", "\n")
        table.add_column(heading, justify="right" if number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(cell(value) for value in row.values()))
    console.print(table)


def header(
    options: argparse.Namespace, extent: Extent, count: int, load: float, tables: Tables
) -> str:
    """Machine and protocol, as a Markdown list."""
    origin = provenance()
    versions = ", ".join(
        f"{name} {origin['versions'][name]}"
        for name in ("casadi", "numba", "numpy", "statsmodels") if origin["versions"].get(name)
    )  # fmt: skip
    predictors, starts = extent.repeats
    instances, rounds = extent.pair
    hard = options.hard.name if options.hard else f"{extent.hard} made of each kind"
    lines = [
        f"- Machine: {origin['cpu']}, {os.cpu_count()} cores, {origin['system']}, load "
        f"average {load:.1f} at the start; {os.environ['OMP_NUM_THREADS']} thread(s).",
        f"- Software: Python {origin['python']}, {versions}, commit {origin['commit']}, "
        f"source {origin['source']}.",
        f"- Instances: {count} of {options.instances.name}, {extent.rounds} round(s); hard ones: "
        f"{hard}, 1 round; scaling: {extent.sizes.instances} of each size, {extent.scaling} "
        "round(s).",
        f"- Repeats: {instances} instance(s) and {rounds} round(s) per region and robot, "
        f"{predictors} per predictor, {starts} per start.",
        "- Ratios: best repeat over the best repeat of the reference that README.md names, "
        "of the same work in the same run.",
    ]
    if "solves" in tables:
        spread = solver_tables.reference_spread(tables["solves"][1])
        unknown = "an unknown amount, in a single round"
        known = unknown if spread != spread else f"{100 * spread:.0f} %"
        lines.append(
            f"- Spread: repeats of one instance by {HONEST!r} differ by {known} (max over min, "
            "median over instances)."
        )
    left_out = [f"{name} ({why})" for name, why in missing().items()]
    if left_out:
        lines.append(f"- Peers without a row: {'; '.join(left_out)}.")
    if exported.missing():
        lines.append(f"- Exported solver: not measured, since {exported.missing()}.")
    return "\n".join([*lines, ""])
