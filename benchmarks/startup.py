"""How long a user waits before anything happens: ``wideberth --help`` and imports."""

import os
import subprocess
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from measuring import Row, Tick, brief, rotated, timed

REFERENCE = "python -c pass"
TARGET = {"wideberth --help": 500.0}
"""ms, by median."""


def commands() -> Mapping[str, list[str]]:
    """Return what is started, by its label."""
    python = sys.executable
    script = Path(python).with_name("wideberth")
    cli = [str(script)] if script.exists() else [python, "-m", "wideberth.experiments.cli.app"]
    return {
        REFERENCE: [python, "-c", "pass"],
        "wideberth --help": [*cli, "--help"],
        "import wideberth": [python, "-c", "import wideberth"],
        "import the planner": [python, "-c", "import wideberth.framework.mpc.planner.planner"],
    }


def measure(rounds: int, tick: Tick) -> list[Row]:
    """Start each command ``rounds`` times after one start that fills the file cache."""
    table = commands()
    times: dict[str, list[float]] = {label: [] for label in table}
    for turn in range(rounds + 1):
        tick(f"start-up, round {turn}")
        for label in rotated(list(table), turn):
            time, _ = timed(partial(_start, table[label]))
            if turn:
                times[label].append(time)
    rows = []
    for label in table:
        row = {"command": label, **brief(times[label], times[REFERENCE])}
        target = TARGET.get(label)
        met = None if target is None else row["median_ms"] < target
        rows.append(row | {"target_ms": target, "met": met})
    return rows


def _start(command: list[str]) -> None:
    # No colours and no terminal: the time to write to a terminal is not ours.
    environment = {**os.environ, "NO_COLOR": "1"}
    subprocess.run(command, check=True, capture_output=True, env=environment, timeout=60)
