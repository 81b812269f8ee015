"""How much faster two workers finish a sweep than one: ``python benchmarks/sweep_speed.py``.

Whole runs of the command line are timed, start-up and table included, in turn: one worker, two
workers, and a loop of pure arithmetic in one process and in two, which says what the machine
itself gives for a second process at that moment (two threads of one core are not two cores).
"""

import os
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from measuring import Row, Tick, bare_loop, cell, rotated, timed

from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.comparison import Comparison
from wideberth.framework.plugins.config import describe
from wideberth.framework.plugins.yamlfile import dump

TARGET = 1.7
"""Times as fast with two workers as with one, in the best of three rounds."""
_CLI = "from wideberth.experiments.cli.app import main; main()"
_STEPS = 30_000_000
"""Of the bare loop: seconds, like a sweep of some size."""


def sweep(episodes: int) -> Comparison:
    """Return a sweep of our planner in the invisible circle of CrowdNav, one task per episode."""
    shipped, _ = read_experiment("crowdnav", [])
    assert isinstance(shipped, Comparison)
    return replace(
        shipped,
        scenarios={"circle": shipped.scenarios["circle"]},
        controllers={"ours": shipped.controllers["ours"]},
        baseline="ours",
        seeds=episodes,
        show=(),
    )


def measure(episodes: int, rounds: int, tick: Tick) -> list[Row]:
    """Return one line per round: seconds with one and two workers, and the ratios."""
    rows: list[Row] = []
    with TemporaryDirectory() as folder:
        config = Path(folder) / "sweep.yaml"
        config.write_text(dump(describe(sweep(episodes))), encoding="utf-8")
        _run(config, Path(folder) / "warm", 2)  # whatever is compiled is compiled here
        tables = [(Path(folder) / "warm" / "table.csv").read_bytes()]
        for turn in range(rounds):
            seconds: dict[str, float] = {}
            for workers in (1, 2):
                tick(f"sweep, round {turn + 1}, bare loop x {workers}")
                seconds[f"loop {workers}"] = _timed(partial(bare_loop, workers, _STEPS))
            for workers in map(int, rotated(["1", "2"], turn)):
                tick(f"sweep, round {turn + 1}, {workers} workers")
                out = Path(folder) / f"{turn}-{workers}"
                seconds[f"sweep {workers}"] = _timed(partial(_run, config, out, workers))
                tables.append((out / "table.csv").read_bytes())
            rows.append(_row(turn, episodes, seconds))
    if any(table != tables[0] for table in tables):
        raise RuntimeError("runs of the same sweep made different tables")
    return rows


def ticks(rounds: int) -> int:
    """Return how often `measure` reports progress."""
    return 4 * rounds


def _row(turn: int, episodes: int, seconds: Mapping[str, float]) -> Row:
    ratio = seconds["sweep 1"] / seconds["sweep 2"]
    return {
        "round": turn + 1,
        "episodes": episodes,
        "one_s": seconds["sweep 1"],
        "two_s": seconds["sweep 2"],
        "ratio": ratio,
        "loop_ratio": 2 * seconds["loop 1"] / seconds["loop 2"],
        "target": TARGET,
        "met": ratio >= TARGET,
    }


def _timed(work: partial[None]) -> float:
    return timed(work)[0] / 1e3


def _run(config: Path, out: Path, workers: int) -> None:
    options = ["--out", str(out), "--workers", str(workers), "--no-figures"]
    command = [sys.executable, "-c", _CLI, "run", str(config), *options]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "NO_COLOR": "1"})


def main() -> None:
    """Measure and print."""
    parser = ArgumentParser(description="Compare a sweep with one worker and with two.")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    rows = measure(options.episodes, options.rounds, partial(print, file=sys.stderr))
    for row in rows:
        print(", ".join(f"{name} {cell(value)}" for name, value in row.items()))
    best = max(row["ratio"] for row in rows)
    print(f"best of {len(rows)}: {best:.2f} (wanted {TARGET})")


if __name__ == "__main__":
    main()
