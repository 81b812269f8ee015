"""The endurance run: its dry run writes tables; its field and its counts have oracles."""

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.framework import WideberthError
from wideberth.framework.values.plan import Rung


@pytest.fixture
def endurance(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Stand where the script stands: it imports its neighbours by their plain names."""
    folder = Path(__file__).resolve().parents[2] / "benchmarks"
    monkeypatch.syspath_prepend(str(folder))
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # set where the run is imported
        monkeypatch.setenv(name, "1")
    return import_module("endurance")


def test_decisions_with_a_deadline(endurance: ModuleType, tmp_path: Path) -> None:
    out = str(tmp_path / "new")
    assert import_module("run").main(["decisions", "--quick", "--out", out]) == 0
    rows = {row["solver"]: row for row in read_table(tmp_path / "new" / "decisions.csv")}
    assert set(rows) == {"riccati", "fatrop"}
    for row in rows.values():
        assert (row["calls"], row["deadline"], row["exceptions"]) == (60, 0.05, 0)
        assert 0.0 < row["cpu_median_ms"] <= row["cpu_p99_ms"] <= row["cpu_max_ms"]


def test_dry_run_writes_a_row_for_each_solver(
    endurance: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "new")
    assert import_module("run").main(["endurance", "--quick", "--out", out]) == 0
    rows = {row["solver"]: row for row in read_table(tmp_path / "new" / "endurance.csv")}
    assert set(rows) == {"riccati", "fatrop"}
    ends = read_table(tmp_path / "new" / "endurance_ends.csv")
    for solver, row in rows.items():
        assert row["exceptions"] == 0
        assert row["calls"] == round(row["simulated_s"] / 0.05)
        assert 0.0 < row["median_ms"] <= row["p95_ms"] <= row["p99_ms"] <= row["max_ms"]
        assert sum(row[str(rung)] for rung in Rung) == pytest.approx(1.0)
        assert 0.0 < row["solve_median_ms"] <= row["solve_max_ms"] < row["max_ms"]
        own = [end for end in ends if end["solver"] == solver]
        assert sum(end["count"] for end in own if end["rung"]) == row["calls"]
        assert sum(end["count"] for end in own if not end["rung"]) == row["solves"]
        assert row["solves"] >= row["calls"]
    assert "A robot among ten walkers" in capsys.readouterr().out


def test_walkers_sway_as_they_should(endurance: ModuleType) -> None:
    """Var(v) = q tau / 2 per axis, correlated by exp(-t / tau): 4000 walkers, 5 sigma."""
    field = endurance.Field(np.random.default_rng(0), walkers=4000, reach=1e6, pause=0.0)
    for _ in range(200):
        field.advance(0.25)
    before = field.sway.copy()
    for _ in range(20):
        field.advance(0.25)
    variance, count = 0.01 * 5.0 / 2.0, field.sway.size
    error = 5.0 * variance * np.sqrt(2.0 / count)
    assert field.sway.var() == pytest.approx(variance, abs=error)
    shared = (before * field.sway).mean() / variance
    assert shared == pytest.approx(np.exp(-1.0), abs=5.0 / np.sqrt(count))


def test_walkers_come_and_go(endurance: ModuleType) -> None:
    field = endurance.Field(np.random.default_rng(1))
    seen: dict[str, list[int]] = {}
    for k in range(4000):
        field.advance(0.1)
        there = field.present()
        assert len({name for name, _, _ in there}) == len(there) <= 10
        for name, place, _ in there:
            assert np.linalg.norm(place) < field.reach + 0.2
            seen.setdefault(name, []).append(k)
    assert len(seen) > 50
    for name, times in seen.items():  # nobody returns under an old name
        assert times == list(range(times[0], times[-1] + 1)), name


def test_gaps_are_between_surfaces(endurance: ModuleType) -> None:
    field = endurance.Field(np.random.default_rng(2), walkers=2)
    field.place, field.away = np.array([[3.0, 4.0], [0.1, 0.0]]), np.array([0.0, 1.0])
    assert field.gaps(np.zeros(2), 0.75).tolist() == [5.0 - 0.4 - 0.75, np.inf]


def test_the_same_seed_is_the_same_run(endurance: ModuleType) -> None:
    runs = [endurance.Run("fatrop", 30, seed) for seed in (3, 3, 4)]
    for run in runs:
        for k in range(30):
            run.step(k)
    first, again, other = runs
    assert np.array_equal(first.gap, again.gap) and first.ends == again.ends
    assert first.plant.state == again.plant.state != other.plant.state


def test_what_is_thrown_is_counted(endurance: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    run = endurance.Run("fatrop", 3, 0)

    def fail(*_: Any) -> None:
        raise WideberthError("a number of 12.5 for 'somebody'")

    run.step(0)
    monkeypatch.setattr("wideberth.framework.mpc.planner.cycle._filled", fail)
    run.step(1)
    run.step(2)
    row = endurance.summary(run)
    assert row["exceptions"] == 2
    assert row["brake"] == pytest.approx(2.0 / 3.0)
    assert ("brake", "not run", "WideberthError: a number of # for '...'") in run.ends


def test_memory_that_is_held_shows(endurance: ModuleType) -> None:
    before = endurance.resident()
    held = np.ones(8 * 2**20)  # 64 MiB
    after = endurance.resident()
    if not np.isfinite(after):
        pytest.skip("this system does not tell")
    assert after > before + 32.0 and held.size
    assert before > 20.0 or sys.platform != "linux"


def test_growth_is_from_a_twelfth_on(endurance: ModuleType) -> None:
    run = endurance.Run("fatrop", 72_000, 0)
    run.step(0)
    run.memory[:] = np.nan
    run.memory[:181] = 100.0 + np.arange(181.0)
    run.gap[7:9] = run.gap[20] = -0.1
    row = endurance.summary(run)
    assert row["memory_settled_MiB"] == 115.0
    assert row["growth"] == pytest.approx(280.0 / 115.0 - 1.0)
    assert row["touches"] == 2 and row["touched"] == pytest.approx(3.0 / 72_000)
