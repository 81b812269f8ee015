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

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.framework import names
from wideberth.framework.plugins.registry import load
from wideberth.framework.predictor import Adaptive, Filtering

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand where the scripts stand: they import each other by their plain names."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return FOLDER


@pytest.fixture
def threads(bench: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Have the number of threads set already, which importing the run would change."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        monkeypatch.setenv(name, "1")
    return bench


@pytest.fixture
def measuring(bench: Path) -> ModuleType:
    return import_module("measuring")


def start(*arguments: str, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, str(FOLDER / "run.py"), *arguments]
    environment = {**os.environ, "NO_COLOR": "1", "COLUMNS": "120"}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=900
    )


def test_dry_run_writes_and_prints_every_table(tmp_path: Path, bench: Path) -> None:
    out = tmp_path / "deep" / "bench"
    done = start("--quick", "--out", str(out), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    tables = {path.stem: read_table(path) for path in out.glob("*.csv")}
    raw = {"solves", "hard_solves", "scaling_solves"}
    unable = import_module("exported").missing()  # no compiler, or no object that fits
    assert set(tables) - raw | ({"export"} if unable else set()) == {
        "startup", "solvers", "speedups", "quality", "obstacles", "hard", "safe", "scaling",
        "slopes", "plugins", "plugin_totals", "batches", "predictors", "risks", "stages",
        "threads", "export", "targets", "whole", "crowds", "tracking", "nav2",
    }  # fmt: skip
    assert raw < set(tables)
    for name in ("times", "growth", "hard", "stages"):
        assert (out / f"bench_{name}.png").exists() and (out / f"bench_{name}.pdf").exists()
    text = (out / "bench.md").read_text(encoding="utf-8")
    assert "Machine:" in text and "Spread:" in text
    for name, rows in tables.items():
        assert rows, name
        if name not in raw:
            assert "| " + " | ".join(rows[0]) + " |" in text
        for row in rows:
            times = [row[key] for key in ("ms", "median_ms", "ratio") if key in row]
            idle = name == "stages" and not row["calls"]  # see below
            assert all(0 < value < np.inf or idle for value in times)
    set_ups = {row["set-up"] for row in tables["solvers"]}
    assert {"paper_mx", "paper_mx, 450 ms", "ipopt_sx"} < set_ups
    solvers = set(names("solvers"))
    assert {*solvers, *(f"{name}, exact" for name in solvers)} < set_ups
    peers = import_module("peers")
    assert set(peers.peers(1e-6)) < set_ups  # all that are installed here
    assert all(f"{name} ({why})" in text for name, why in peers.missing().items())
    assert len({row["kind"] for row in tables["hard"]}) == 9
    for name in ("plugins", "scaling"):
        key = "solver" if name == "plugins" else "set-up"
        assert {row[key] for row in tables[name]} == solvers
    assert {row["predictor"] for row in tables["predictors"]} == set(names("predictors"))
    updated = {row["predictor"] for row in tables["predictors"] if row["call"] == "update"}
    adaptive = {n for n in names("predictors") if issubclass(load("predictors", n), Adaptive)}
    assert updated == adaptive and "adaptive_conformal" in adaptive
    decided = {row["predictor"] for row in tables["predictors"] if row["call"] == "decision"}
    filtering = {n for n in names("predictors") if issubclass(load("predictors", n), Filtering)}
    assert decided == filtering and {"adaptive_conformal", "kalman"} < filtering
    assert {row["target"] for row in tables["risks"]} == {None, 1e5}
    assert all(row["per_second_per_core"] > 0 for row in tables["risks"])
    assert unable in text and all(row["equal"] for row in tables.get("export", ()))
    assert [(row["predictor"], row["seen"]) for row in tables["whole"]] == [
        (predictor, seen) for predictor in ("recommended", "kalman") for seen in (1, 3, 10, 40)
    ]
    assert sum(row["share"] for row in tables["stages"]) == pytest.approx(len(tables["whole"]))
    idle = {(row["predictor"], row["stage"]) for row in tables["stages"] if not row["share"]}
    assert idle == {("kalman", "calibration")}  # so is a function that is no longer called
    assert "wideberth --help" in {row["command"] for row in tables["startup"]}
    assert "wideberth --help" in done.stdout and str(out.name) in done.stdout
    assert not list(tmp_path.glob("*.csv"))  # nothing beside the folder that was named


def test_stages_of_a_decision_are_functions(bench: Path) -> None:
    decision = import_module("decision")
    for name in [name for names_ in decision.STAGES.values() for name in names_]:
        owner, attribute, function = decision.stage_function(name)
        assert callable(getattr(owner, attribute)), name
        assert getattr(function, "__func__", function).__name__ == attribute
    with pytest.raises(KeyError):
        decision.stage_function("predictors.core.kalman_filter:roll_out")


def test_one_drive_of_each_predictor_has_its_own_forecasts(bench: Path) -> None:
    """The recommended planner is the one of the README, and `kalman` differs in its predictor."""
    decision = import_module("decision")
    drives = {name: decision.Drive(name, 1, 0) for name in decision.PREDICTORS}
    kinds = {name: type(drive.planner.predictor).__name__ for name, drive in drives.items()}
    assert kinds == {"recommended": "AdaptiveConformal", "kalman": "Kalman"}
    shares = decision.Shares()
    with decision.timers(shares):
        taken, (_, plan) = drives["recommended"].decide(shares)
    assert taken > 0.0 and plan.forecast is not None
    assert all(shares.calls[stage] for stage in ("filter", "forecast", "calibration"))


def test_one_question_alone(threads: Path, tmp_path: Path) -> None:
    out = str(tmp_path / "new")
    assert import_module("run").main(["--quick", "--only", "risks", "--out", out]) == 0
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [
        "bench.md",
        "risks.csv",
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--instances", "nowhere.npz"], "nowhere.npz cannot be read: No such file"),
        (["--instances", "text.npz"], "text.npz is no npz archive"),
        (["--instances", "other.npz"], "lacks"),
        (["--instances", "array.npy"], "array.npy is no npz archive"),
        (["--hard", "nowhere.npz"], "nowhere.npz cannot be read: No such file"),
        (["--hard", "text.npz"], "text.npz is no npz archive"),
        (["--out", "text.npz"], "File exists"),
        (["--people", "nowhere"], "nowhere is no folder"),
        (["--rounds", "0"], "wanted a whole number of at least 1"),
    ],
)
def test_bad_input_ends_before_the_work(
    arguments: list[str],
    words: str,
    threads: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.npz").write_text("not an archive")
    np.savez(tmp_path / "other.npz", count=np.ones(3))
    np.save(tmp_path / "array.npy", np.ones(3))
    before = sorted(tmp_path.iterdir())
    out = [] if "--out" in arguments else ["--out", "new"]
    try:
        code = import_module("run").main([*arguments, *out])
    except SystemExit as left:  # as argparse does
        code = left.code
    assert code == 2
    assert words in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before


def test_speedup_pairs_the_same_work(measuring: ModuleType) -> None:
    """Best repeats are 2 and 12 against 20 and 60: 10 and 5 times as fast, whatever the noise."""
    times = {"a": [2.0, 9.0], "b": [12.0, 12.5]}
    found = measuring.speedup(times, {"a": [20.0, 31.0], "b": [70.0, 60.0], "c": [1.0]})
    assert found["each"] == pytest.approx(7.5)
    assert found["each_p5"] == pytest.approx(5.25)
    assert found["each_p95"] == pytest.approx(9.75)
    assert found["of_medians"] == pytest.approx(40.0 / 7.0)


def test_slope_is_the_exponent(measuring: ModuleType) -> None:
    sizes = [1, 5, 10, 20, 50, 100]
    assert measuring.slope(sizes, [3.0 * size**1.3 for size in sizes]) == pytest.approx(1.3)


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
