"""The benchmarks' dry run writes its tables; how they boil times down has oracles."""

import doctest
import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from wideberth.framework import names
from wideberth.framework.io import read_table

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand where the scripts stand: they import each other by their plain names."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return FOLDER


@pytest.fixture
def measuring(bench: Path) -> ModuleType:
    return import_module("measuring")


def start(*arguments: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, str(FOLDER / "run.py"), *arguments]
    environment = {**os.environ, "NO_COLOR": "1", "COLUMNS": "120"}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )


def test_dry_run_writes_and_prints_every_table(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "bench"
    done = start("--quick", "--out", str(out), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    tables = {path.stem: read_table(path) for path in out.glob("*.csv")}
    assert set(tables) == {
        "solves", "solvers", "quality", "obstacles", "plugins", "predictors", "risks",
        "startup",
    }  # fmt: skip
    text = (out / "bench.md").read_text(encoding="utf-8")
    assert "Machine:" in text and "Spread:" in text
    for name, rows in tables.items():
        assert rows, name
        if name != "solves":
            assert "| " + " | ".join(rows[0]) + " |" in text
        for row in rows:
            times = [row[key] for key in ("ms", "median_ms", "ratio") if key in row]
            assert all(0 < value < np.inf for value in times)
    set_ups = {row["set-up"] for row in tables["solvers"]}
    assert set_ups == {"ipopt sx", "ipopt mx, 450 ms", *names("solvers")} - {"ipopt"}
    assert {row["predictor"] for row in tables["predictors"]} == set(names("predictors"))
    assert {row["solver"] for row in tables["plugins"]} == {"ipopt", "fatrop"}
    assert {row["target"] for row in tables["risks"]} == {None, 1e5}
    assert all(row["per_second_per_core"] > 0 for row in tables["risks"])
    assert "wideberth --help" in {row["command"] for row in tables["startup"]}
    assert "wideberth --help" in done.stdout and str(out.name) in done.stdout
    assert not list(tmp_path.glob("*.csv"))  # nothing beside the folder that was named


def test_solutions_are_judged_by_the_independent_check(bench: Path) -> None:
    speed = import_module("solver_speed")
    sample = FOLDER.parent / "tests" / "data" / "mpc_instances.npz"
    instances = speed.chosen(sample, 2)
    assert len(instances) == 2
    seen: list[str] = []
    solves = speed.measure(instances, 2, seen.append)
    assert len(seen) == speed.steps(instances, 2)
    count = len(speed.set_ups())
    assert len(solves) == 2 * 2 * count
    for row in speed.quality(solves):
        assert row["converged"] == row["feasible"] == row["both"] == 1.0
        assert row["gap_max"] < speed.NEAR
    for row in speed.times(solves):
        assert row["solves"] == 4
        assert row["median_ms"] <= row["p95_ms"] <= row["p99_ms"] <= row["max_ms"]
    reference = speed.times(solves)[0]
    assert reference["set-up"] == speed.REFERENCE
    assert reference["ratio"] == reference["ratio_p95"] == 1.0
    broken = [{**row, "violation": 1.0} for row in solves]
    assert all(row["both"] == 0.0 for row in speed.quality(broken))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--instances", "nowhere.npz"], "nowhere.npz: No such file"),
        (["--instances", "text.npz"], "is no file of recorded instances"),
        (["--instances", "other.npz"], "lacks"),
        (["--instances", "array.npy"], "is no file of recorded instances"),
        (["--out", "text.npz"], "File exists"),
        (["--rounds", "0"], "wanted a whole number of at least 1"),
    ],
)
def test_bad_input_ends_before_the_work(arguments: list[str], words: str, tmp_path: Path) -> None:
    (tmp_path / "text.npz").write_text("not an archive")
    np.savez(tmp_path / "other.npz", count=np.ones(3))
    np.save(tmp_path / "array.npy", np.ones(3))
    before = sorted(tmp_path.iterdir())
    out = [] if "--out" in arguments else ["--out", "new"]
    done = start(*arguments, *out, cwd=tmp_path)
    assert done.returncode == 2
    assert words in done.stderr and "Traceback" not in done.stderr
    assert sorted(tmp_path.iterdir()) == before


def test_ratio_pairs_the_same_work(measuring: ModuleType) -> None:
    """Work b is three times as long for both: the ratios are 2 and 4, whatever the noise."""
    reference = {"a": [5.0, 1.0], "b": [3.0, 3.5]}
    times = {"a": [2.0, 9.0], "b": [12.0, 12.5]}
    found = measuring.ratio(times, reference)
    assert found["ratio"] == pytest.approx(3.0)
    assert found["ratio_p5"] == pytest.approx(2.1)
    assert found["ratio_p95"] == pytest.approx(3.9)


def test_brief_takes_the_least_disturbed_repeat(measuring: ModuleType) -> None:
    found = measuring.brief([4.0, 2.0, 90.0], [1.0, 8.0])
    assert found == {"median_ms": 4.0, "best_ms": 2.0, "ratio": 2.0}


def test_spread_of_a_known_sample(measuring: ModuleType) -> None:
    """0..100: the q-th percentile is q."""
    found = measuring.spread(np.arange(101.0))
    assert found == {"median_ms": 50.0, "p95_ms": 95.0, "p99_ms": 99.0, "max_ms": 100.0}


def test_repeat_spread_ignores_what_was_not_repeated(measuring: ModuleType) -> None:
    repeats = {1: [2.0, 3.0], 2: [1.0, 1.1], 3: [1.0, 1.2], 4: [7.0]}
    assert measuring.repeat_spread(repeats) == pytest.approx(0.2)
    assert np.isnan(measuring.repeat_spread({1: [1.0]}))


def test_everybody_begins_once(measuring: ModuleType) -> None:
    orders = [measuring.rotated(["a", "b", "c"], turn) for turn in range(3)]
    assert sorted(order[0] for order in orders) == ["a", "b", "c"]
    assert all(sorted(order) == ["a", "b", "c"] for order in orders)


def test_markdown_has_a_row_per_row(measuring: ModuleType) -> None:
    text = measuring.markdown("T", [{"x": 1.23456, "y": None}, {"x": 1e-5, "y": "word"}])
    assert text.splitlines() == [
        "## T", "", "| x | y |", "| --- | --- |", "| 1.23 |  |", "| 1e-05 | word |",
    ]  # fmt: skip


def test_examples_in_docstrings_run(measuring: ModuleType) -> None:
    failed, tried = doctest.testmod(measuring)
    assert tried and not failed
