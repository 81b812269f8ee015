"""Rivals in random crowds: which setting is the best one, what a verdict is, and what is kept."""

from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.engine.closed_loop import group
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.comparison import Comparison


@pytest.fixture
def rivals(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Stand where the script stands: it imports its neighbours by their plain names."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2] / "benchmarks"))
    return import_module("crowd_rivals")


def tried(setting: str, arrived: int, time: float, limits: str = "service") -> dict[str, Any]:
    return {
        "limits": limits,
        "controller": "orca",
        "setting": setting,
        "arrived": arrived,
        "time_mean_s": time,
    }


def test_the_best_arrives_most_often_and_then_soonest(
    rivals: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [
        tried("time_horizon=1 safety_space=0.1", 11, 9.0),
        tried("time_horizon=2 safety_space=0.1", 12, 15.0),
        tried("time_horizon=5 safety_space=0.1", 12, 14.0),
        tried("time_horizon=9 safety_space=0.1", 20, 10.0, limits="person"),
    ]
    monkeypatch.setattr(rivals, "TUNING", write_table(tmp_path / "tuning.csv", lines))
    assert rivals.best("service", "orca") == {"time_horizon": 5.0, "safety_space": 0.1}


def test_a_verdict_is_that_of_the_comparison(rivals: Any) -> None:
    """To end at the first contact changes no verdict, and arrivals take as long."""
    shipped, _ = read_experiment("random_crowd", ["first_seed=101", "seeds=2", "show=[]"])
    assert isinstance(shipped, Comparison)
    tasks = [
        task
        for task in shipped.tasks()
        if (task.settings["scenario"], task.settings["controller"])
        == ("people_10_per_100_m2", "orca")
    ]
    rows = [row for task in tasks for row in shipped.measure(task).rows]
    speed = {"reference_speed": 0.7}
    found = list(rivals.verdicts("shipped", 10, "orca", speed, range(101, 103)))
    words = {"success": "arrived", "collision": "contact"}
    assert [row["verdict"] for row in found] == [words[row["outcome"]] for row in rows]
    assert {row["verdict"] for row in found} == {"arrived", "contact"}
    times = [row["time_s"] for row in found]
    assert times == pytest.approx([row["success_time"] for row in rows], abs=0.006, nan_ok=True)


def test_the_shipped_tables_are_whole(rivals: Any) -> None:
    """What was counted has every seed once, and every setting of its grid was tried before."""
    tuned = group(rivals.read(rivals.TUNING), "controller", "limits")
    counted = group(rivals.read(rivals.ROWS), "controller", "people", "limits")
    assert ("orca", "10", "shipped") in counted
    for (name, _, limits), rows in counted.items():
        seeds = rivals.counted_seeds(name, limits)
        assert [row["seed"] for row in rows] == [str(seed) for seed in seeds]
        assert all((row["verdict"] == "arrived") is (row["time_s"] != "nan") for row in rows)
        if name in rivals.OURS:
            continue
        tried = {line["setting"] for line in tuned[name, limits]}
        assert tried >= {rivals.worded(given) for given in rivals.grid(name)}


def test_the_page_says_what_was_counted(rivals: Any) -> None:
    """Each row of the page's first table has the arrivals and the mean time of the rows."""
    page = (Path(__file__).resolve().parents[2] / "docs" / "random-crowds.md").read_text("utf-8")
    counted = group(rivals.read(rivals.ROWS), "controller", "people", "limits")
    cells = [[cell.strip(" *`") for cell in line.split("|")[1:-1]] for line in page.splitlines()]
    known = [row for row in cells if len(row) == 8 and tuple(row[:3]) in counted]
    assert {"ours", "ours_watching", "straight_on", "orca"} <= {row[0] for row in known}
    for name, people, limits, seeds, arrived, _, time, _ in known:
        first, last = (int(seed) for seed in seeds.split(" to "))
        own = [row for row in counted[name, people, limits] if first <= int(row["seed"]) <= last]
        found = rivals.condensed(own)
        assert (f"{found['arrived']} of {len(own)}", f"{found['time_mean_s']:.1f}") == (
            arrived,
            time,
        )
