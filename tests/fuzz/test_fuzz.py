"""The fuzz run: its dry run finds nothing, and it finds what is planted."""

import sys
import time
import warnings
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from wideberth.experiments.engine.csv_tables import read_table


@pytest.fixture
def fuzz(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Stand where the script stands: it imports its neighbours by their plain names."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # set where the run is imported
        monkeypatch.setenv(name, "1")
    return import_module("fuzz")


def test_the_dry_run_finds_nothing(
    fuzz: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fuzz.main(["--quick", "--out", str(tmp_path)]) == 0, capsys.readouterr().out
    rows = {row["what"]: row for row in read_table(tmp_path / "fuzz.csv")}
    assert rows["rival orca"]["calls"] == 25
    assert rows["predictor imm"]["calls"] == 50
    assert rows["detector discs"]["calls"] == 50
    assert rows["node, dynamic_window, detector discs: speak"]["calls"] == 25
    assert all(row[fault] == 0 for row in rows.values() for fault in fuzz.FAULTS)
    assert not (tmp_path / "faults.csv").exists()


def test_a_case_is_the_same_every_time(fuzz: ModuleType) -> None:
    cases = import_module("fuzz_cases")
    first, second = ([(c.what, c.fault) for c in cases.cases("rival", 1, 3)] for _ in range(2))
    assert first == second
    drawn = [cases.draw_world(cases.np.random.default_rng(5))[0].positions for _ in range(2)]
    assert cases.np.array_equal(*drawn, equal_nan=True)


def test_the_default_run_covers_what_it_promises(fuzz: ModuleType) -> None:
    from wideberth.framework.plugins.config import build
    from wideberth.framework.plugins.registry import names

    cases = import_module("fuzz_cases")
    made = cases.setups()
    assert {one["region"] for one in made} == set(names("regions"))
    assert {one["robot"] for one in made} == set(names("robots"))
    assert {one["solver"] for one in made} == {"riccati", "fatrop", "ipopt"}
    rivals = {one["type"] for one in cases.rivals() if build("controllers", one)}
    assert rivals == set(names("controllers")) - {"mpc"}
    with_each = {what: one for what, one in cases.optional()}
    assert {one["solver"] for one in with_each.values()} == set(names("solvers"))
    for option, settings in cases.OPTIONS.items():
        for solver in ("riccati", "fatrop"):
            assert settings.items() <= with_each[f"{solver} with {option}"].items()
    optional = {name for one in cases.OPTIONS.values() for name in one}
    wanted = {
        "further_kinds",
        "withdraw",
        "fallback",
        "latency",
        "own_uncertainty",
        "starts",
        "deadline",
    }
    assert wanted <= optional
    scans = import_module("fuzz_scans")
    assert {name for _, name, _, _ in scans.sensing()} == set(names("detectors"))
    assert {name for _, _, _, name in scans.sensing()} == set(names("trackers"))
    amounts = {kind: least for kind, (least, _) in fuzz.AMOUNTS.items()}
    assert set(amounts) == {"node", "detector", "optional", "planner", "rival", "predictor",
                            "config"}  # fmt: skip
    todo = [case for chunk in fuzz.chunks(amounts) for case in chunk]
    for kind, (least, size) in fuzz.AMOUNTS.items():
        assert sum(size for case in todo if case[0] == kind) >= least
    assert len(set(todo)) == len(todo)


def planted(fault: str) -> tuple[str, str]:
    if fault == "raised":
        raise ArithmeticError("planted")
    if fault == "warned":
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    until = time.process_time() + 0.03 * (fault == "late")
    while time.process_time() < until:
        pass
    return "", ""


@pytest.mark.parametrize(
    ("fault", "found"),
    [("none", ""), ("raised", "raised"), ("warned", "raised"), ("late", "late")],
)
def test_what_is_planted_is_found(fuzz: ModuleType, fault: str, found: str) -> None:
    timed = import_module("fuzz_cases").timed
    assert (
        timed("a part", lambda: planted(fault), 0.01 if found == "late" else 10.0).fault == found
    )


def stuck(chunk: list[Any], pipe: Connection) -> None:
    """Hang at the first case of the first chunk, die at the one of the second."""
    pipe.send(("begin", chunk[0]))
    pipe.send(("ready", chunk[0]))
    if chunk[0][2] == 0:
        time.sleep(600.0)
    if chunk[0][2] == 1:
        sys.exit(3)
    pipe.send(("end",))


def test_what_hangs_is_killed_and_the_rest_goes_on(
    fuzz: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fuzz, "HANGS", 0.5)
    chunk = [("planner", 4, seed) for seed in range(3)]
    pool = fuzz.Pool([chunk], 1, time.monotonic() + 120.0, stuck)
    pool.run()
    assert [(one["only"], one["fault"]) for one in pool.faults] == [
        ("planner.4.0", "hangs"),
        ("planner.4.1", "hangs"),
    ]
    assert "died with 3" in pool.faults[1]["detail"]
    assert not pool.todo and not pool.running and not pool.unfinished
