"""Level policies in closed loop: what is counted, and that the quick setting runs."""

from dataclasses import replace
from pathlib import Path

import pytest

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.level_policies import LevelPolicies
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework import names
from wideberth.framework.values.errors import WideberthError


@pytest.fixture(scope="module")
def shipped() -> LevelPolicies:
    experiment, _ = read_experiment("level_policies", [])
    assert isinstance(experiment, LevelPolicies)
    return experiment


def test_every_registered_policy_is_played(shipped: LevelPolicies) -> None:
    kinds = {type(level).__name__.lower() for level in shipped.levels.values()}
    assert kinds == {name.replace("_", "") for name in names("levels")}
    assert len(shipped.tasks()) == 3 * 2 * len(shipped.levels) * shipped.seeds


def test_planner_is_that_of_the_crossing(shipped: LevelPolicies) -> None:
    crossing, _ = read_experiment("crossing", [])
    planner = planner_of(shipped.planner)
    for name in ("solver", "penalty", "margin", "horizon"):
        assert getattr(planner, name) == getattr(crossing.planners["default"], name)  # type: ignore[attr-defined]


def test_quick_run(shipped: LevelPolicies, tmp_path: Path) -> None:
    """One seed among the walkers: who may give way does, who holds its level does not."""
    kept = ("relaxed", "discounted")
    small = replace(shipped, levels={name: shipped.levels[name] for name in kept})
    result = run(small, tmp_path / "out", quick=True)
    assert [row["planner"] for row in result.rows] == list(kept)
    assert {row["scenario"] for row in result.rows} == {"field"}
    lines = {line["level"]: line for line in read_table(tmp_path / "out" / "summary.csv")}
    for line in lines.values():
        assert line["entered"] <= line["fallback_plans"] + 1e-9
        assert 0.0 <= line["driven_below"] <= 1.0
    assert lines["relaxed"]["driven_below"] > 0.3
    held = result.rows[1]  # but for plans that enter a region
    assert held["driven_below"] <= held["fallbacks"]
    assert {path.suffix for path in draw(tmp_path / "out")} == {".png", ".pdf"}


def test_settings_that_make_no_experiment_are_refused(shipped: LevelPolicies) -> None:
    with pytest.raises(WideberthError, match="levels is empty"):
        replace(shipped, levels={})
    with pytest.raises(WideberthError, match="seeds"):
        replace(shipped, seeds=0)
