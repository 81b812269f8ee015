"""Measure and write tables: ``python benchmarks/run.py QUESTION``; see README.md beside it."""

import os

# One thread each: the planner shares its robot with everything else, and a pool of threads
# makes times depend on who else runs. Must stand before NumPy and CasADi are imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import logging
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from measuring import Tables, markdown

from wideberth.benchmarks.recorded_instances import SAMPLE
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.provenance import provenance
from wideberth.framework import WideberthError
from wideberth.framework.plugins.io import write_text

ROOT = Path(__file__).resolve().parents[1]


QUESTIONS = {
    "solvers": "solver_speed", "scaling": "scaling", "tracking": "tracking", "nav2": "nav2_speed",
    "endurance": "endurance", "decisions": "endurance",
}  # fmt: skip
"""Question -> module whose ``tables`` answers it."""


def main(words: Sequence[str] | None = None) -> int:
    """Write a CSV of each table and ``bench.md``, and print; 2 where the input is of no use."""
    parser = argparse.ArgumentParser(description="Measure and write tables.")
    parser.add_argument("question", choices=QUESTIONS)
    parser.add_argument("--instances", type=Path, default=SAMPLE, help="recorded instances")
    parser.add_argument("--people", default="shipped:", help="recordings, `frame id x y`")
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "bench", help="folder")
    parser.add_argument("--rounds", type=int, default=3, help="over the instances")
    parser.add_argument("--quick", action="store_true", help="a dry run: no number means anything")
    options = parser.parse_args(words)
    logging.getLogger("wideberth").setLevel(logging.CRITICAL)  # the tables count the same
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        tables: Tables = import_module(QUESTIONS[options.question]).tables(options)
    except (WideberthError, OSError, ValueError, TypeError) as error:
        print(f"benchmarks: {error}", file=sys.stderr)
        return 2
    shown = [markdown(title, rows) for title, rows in tables.values() if title]
    text = "\n".join([f"# Benchmarks\n\n{header(options)}", *shown])
    for name, (_, rows) in tables.items():
        write_table(options.out / f"{name}.csv", rows)
    write_text(options.out / "bench.md", text)
    print(text)
    return 0


def header(options: argparse.Namespace) -> str:
    """Machine and software, as a Markdown list."""
    origin, load = provenance(), os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    versions = ", ".join(f"{name} {origin['versions'].get(name)}" for name in ("casadi", "numpy"))
    lines = [
        f"- Machine: {origin['cpu']}, {os.cpu_count()} cores, {origin['system']}, load average "
        f"{load:.1f}; {os.environ['OMP_NUM_THREADS']} thread(s).",
        f"- Software: Python {origin['python']}, {versions}, commit {origin['commit']}, source "
        f"{origin['source']}.",
    ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())
