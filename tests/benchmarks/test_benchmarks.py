"""The benchmarks' dry runs write their tables; how they boil times down has oracles."""

import doctest
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.framework import names

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Stand where the scripts stand: they import each other by their plain names."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # set where the run is imported
        monkeypatch.setenv(name, "1")
    monkeypatch.syspath_prepend(str(FOLDER))
    return import_module("run")


@pytest.fixture
def measuring(run: ModuleType) -> ModuleType:
    return import_module("measuring")


TABLES = {
    "solvers": {"solves", "solvers", "speedups", "quality", "obstacles", "kinds", "spread"},
    "scaling": {"scaling_solves", "scaling", "slopes"},
    "tracking": {"tracking"},
    "nav2": {"nav2"},
}


@pytest.mark.parametrize("question", TABLES)
def test_dry_run_writes_and_prints_every_table(
    question: str, run: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "bench"
    assert run.main([question, "--quick", "--out", str(out)]) == 0
    tables = {path.stem: read_table(path) for path in out.glob("*.csv")}
    lacking = import_module("set_ups").missing() if question == "solvers" else {}
    assert set(tables) == TABLES[question] | ({"peers"} if lacking else set())
    text = (out / "bench.md").read_text(encoding="utf-8")
    assert "Machine:" in text and text in capsys.readouterr().out
    assert all(f"| {name} | {why} |" in text for name, why in lacking.items())
    for name, rows in tables.items():
        assert rows, name
        if name not in ("solves", "scaling_solves"):
            assert "| " + " | ".join(rows[0]) + " |" in text
        assert all(0 < row[key] < np.inf for row in rows for key in ("ms", "median_ms")
                   if key in row)  # fmt: skip
    solvers = set(names("solvers"))
    if question == "solvers":
        peers = set(import_module("set_ups").peers(1e-6))
        assert {row["set-up"] for row in tables["solvers"]} == {
            "paper_mx", "paper_mx, 450 ms", "ipopt_sx", "riccati, several starts",
            *peers, *solvers, *(f"{name}, exact" for name in solvers),
        }  # fmt: skip
    if question == "scaling":
        assert {row["set-up"] for row in tables["scaling"]} == solvers


def test_hard_instances_are_solved_like_the_others(run: ModuleType, tmp_path: Path) -> None:
    speed, set_ups = import_module("solver_speed"), import_module("set_ups").set_ups()
    hard = import_module("perturbations").perturb(
        run.SAMPLE, tmp_path / "hard.npz", each=1, seed=0
    )
    taking = {name: set_ups[name] for name in ("paper_mx", "ipopt_sx", "riccati")}
    solves = speed.measure(taking, {"mahalanobis_ellipse": speed.chosen(hard, None)}, 1)
    rows = speed.divided(solves, "kind")
    assert len({row["kind"] for row in rows}) == 9 and len(rows) == 27
    assert len(speed.times(solves)) == 3


@pytest.mark.parametrize(
    ("words", "error"),
    [
        (["solvers", "--instances", "nowhere.npz"], "nowhere.npz cannot be read: No such file"),
        (["solvers", "--instances", "text.npz"], "text.npz is no npz archive"),
        (["solvers", "--instances", "other.npz"], "lacks"),
        (["solvers", "--instances", "array.npy"], "array.npy is no npz archive"),
        (["solvers", "--out", "text.npz"], "File exists"),
        (["tracking", "--people", "nowhere"], "nowhere is no folder"),
    ],
)
def test_bad_input_ends_before_the_work(
    words: list[str],
    error: str,
    run: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.npz").write_text("not an archive")
    np.savez(tmp_path / "other.npz", count=np.ones(3))
    np.save(tmp_path / "array.npy", np.ones(3))
    assert run.main(words if "--out" in words else [*words, "--out", "new"]) == 2
    assert error in capsys.readouterr().err
    assert not list(tmp_path.glob("**/*.csv"))


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
