"""The suite of asv: each measure does its work, and asv finds it."""

import json
import subprocess
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

import wideberth

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def speed(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Import the suite, which adds the checkout to where the package is found."""
    monkeypatch.setattr(wideberth, "__path__", list(wideberth.__path__))
    monkeypatch.syspath_prepend(str(FOLDER / "history"))
    import speed as suite  # type: ignore[import-not-found]

    yield suite


def cases(measure: Any) -> list[tuple[Any, ...]]:
    """Return the first and the last case of a measure."""
    several = getattr(measure, "params", [])
    several = several if not several or isinstance(several[0], list) else [several]
    found = list(product(*several))
    return [found[0], found[-1]] if len(found) > 1 else found


@pytest.mark.parametrize("name", ["Solves", "Decisions", "Forecasts", "Risks", "Episode"])
def test_work_is_done(name: str, speed: ModuleType) -> None:
    measure = getattr(speed, name)
    for case in cases(measure):
        made = measure()
        made.setup(*case)
        for work in (work for work in dir(measure) if work.startswith("time_")):
            getattr(made, work)(*case)


def test_starts_are_code(speed: ModuleType) -> None:
    starts = speed.Start()
    for name in (name for name in dir(starts) if name.startswith("timeraw_")):
        subprocess.run([sys.executable, "-c", getattr(starts, name)()], check=True, timeout=120,
                       stdout=subprocess.DEVNULL)  # fmt: skip


def test_asv_finds_the_suite() -> None:
    config = json.loads((FOLDER / "asv.conf.json").read_text())
    assert (FOLDER / config["benchmark_dir"] / "speed.py").is_file()
    assert (FOLDER / config["repo"] / "pyproject.toml").is_file()
