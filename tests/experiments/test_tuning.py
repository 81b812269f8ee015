"""One factor at a time: which settings are played, and which of them nothing beats."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.tuning import Tuning, draw_fronts, worded
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework.values.errors import WideberthError
from wideberth.metrics.statistics import pareto
from wideberth.simulation.scenarios.recorded_scene import RecordedScene


@pytest.fixture(scope="module")
def shipped() -> Tuning:
    experiment, _ = read_experiment("tuning", [])
    assert isinstance(experiment, Tuning)
    return experiment


def test_one_setting_changes_at_a_time(shipped: Tuning) -> None:
    base = planner_of(shipped.variant("base", ""))
    longer = planner_of(shipped.variant("horizon", "24"))
    assert longer.horizon == 24 and base.horizon == 15
    assert longer.level == base.level and longer.cost == base.cost
    heavy = planner_of(shipped.variant("cost.weights.acceleration", "100000"))
    assert heavy.cost.weights.acceleration == 1e5  # type: ignore[attr-defined]
    assert heavy.cost.weights.position == base.cost.weights.position  # type: ignore[attr-defined]


def test_the_base_is_played_once(shipped: Tuning) -> None:
    few = replace(shipped, factors={"horizon": (15, 8), "margin": (0.1, 0.2)}, seeds=2)
    assert list(few.variants()) == [("base", ""), ("horizon", "8"), ("margin", "0.2")]
    assert len(few.tasks()) == 6 == len({task.name for task in few.tasks()})


def test_any_key_of_the_planner_can_be_a_factor(shipped: Tuning) -> None:
    other = {"type": "kalman", "acceleration_density": 0.1}
    wide = replace(shipped, factors={"predictor": ("static", other)})
    assert list(wide.variants())[1:] == [
        ("predictor", "static"),
        ("predictor", "type kalman acceleration_density 0.1"),
    ]
    assert worded(1e5) == "100000" and worded(0.05) == "0.05" and worded(None) == "None"


def test_factors_that_make_no_planner_are_refused(shipped: Tuning) -> None:
    with pytest.raises(WideberthError, match="factors is empty"):
        replace(shipped, factors={})
    with pytest.raises(WideberthError, match=r"factors \['horizon'\] have no values"):
        replace(shipped, factors={"horizon": ()})
    with pytest.raises(WideberthError, match=r"factors.level.tial.*did you mean 'tail'"):
        replace(shipped, factors={"level.tial": (0.1,)})
    with pytest.raises(WideberthError, match=r"factors.horizon.x: horizon is 15, which has no"):
        replace(shipped, factors={"horizon.x": (1,)})
    with pytest.raises(WideberthError, match=r"factors.level.tail.*\(0, 1\)"):
        replace(shipped, factors={"level.tail": (2.0,)})


def test_a_robot_that_does_not_fit_is_refused(shipped: Tuning) -> None:
    with pytest.raises(WideberthError, match=r"scenario has room for .* 0\.4 m, and robot has"):
        replace(shipped, scenario=RecordedScene())
    slow = replace(planner_of(shipped.base).robot, max_speed=0.5)  # type: ignore[type-var]
    with pytest.raises(WideberthError, match=r"^planner drives Unicycle.*, unlike robot: write"):
        replace(shipped, robot=slow)


def test_pareto_against_brute_force() -> None:
    rng = np.random.default_rng(1)
    costs = rng.integers(0, 4, (40, 3)).astype(float)
    costs[0, 1] = np.nan
    found = pareto(costs)
    for i, own in enumerate(costs):
        beaten = any((other <= own).all() and (other < own).any() for other in costs)
        assert found[i] == (not beaten and bool(np.isfinite(own).all()))
    assert pareto([[1.0, 1.0], [1.0, 1.0]]).all()  # alike: neither beats the other
    assert pareto([[np.nan], [5.0]]).tolist() == [False, True]


def made(factor: str, value: object, seed: int, time: float, clearance: float) -> Row:
    row: Row = dict.fromkeys(
        ("length_ratio_worst", "intrusion_share", "freeze_share", "jerk_rms", "social_work",
         "coverage", "fallbacks", "deadline_misses", "feasible_successors",
         "infeasible_successors", "aimed_successors", "lowered_successors"), 0.0,
    )  # fmt: skip
    success = np.isfinite(time)
    row |= {"factor": factor, "value": value, "seed": seed, "success": bool(success)}
    row |= {"outcome": "success" if success else "timeout", "success_time": time}
    row |= {"errors": None, "contact_kind": None}
    row |= {"penalised_time": time if success else 60.0, "clearance": clearance}
    return row | {"plans": 10, "frozen": False}


def test_settings_that_nothing_beats_are_marked(shipped: Tuning) -> None:
    table = [
        made(factor, value, seed, time, clearance)
        for seed in range(3)
        for factor, value, time, clearance in (
            ("base", None, 20.0, 0.3),
            ("margin", 0.2, 22.0, 0.4),  # slower and further away
            ("margin", 0.05, 21.0, 0.2),  # slower and nearer
            ("horizon", 5, np.nan, 0.9),  # never there
        )
    ]
    lines = shipped.summary(table)
    assert [line["pareto"] for line in lines] == [True, True, False, False]
    assert [line["value"] for line in lines] == ["", "0.2", "0.05", "5"]
    assert [line["time_difference_s"] for line in lines[1:3]] == [2.0, 1.0]
    assert np.isnan([lines[0]["time_difference_s"], lines[0]["p_success"]]).all()  # the base
    assert lines[3]["only_baseline"] == 3


def test_values_at_one_place_are_all_seen(shipped: Tuning) -> None:
    """Two of them change nothing, and stand where the base stands."""
    table = [
        made(factor, value, seed, time, clearance)
        for seed in range(3)
        for factor, value, time, clearance in (
            ("base", None, 20.0, 0.3),
            ("margin", 0.2, 20.0, 0.3),
            ("margin", 0.3, 20.0, 0.3),
            ("margin", 0.05, 21.0, 0.2),
        )
    ]
    panel = draw_fronts(table).axes[0]
    markers = [line for line in panel.lines if line.get_marker() != "None"]
    here = [line for line in markers if np.ravel(line.get_data()).tolist() == [20.0, 0.3]]
    assert [line.get_marker() for line in here] == ["o", "s", "D"]  # the later ones on top
    assert len({line.get_zorder() for line in here}) == 1
    sizes = [float(line.get_markersize()) for line in here]
    assert sizes[0] > sizes[1] > sizes[2]


def test_the_shipped_sweep_runs_and_draws(shipped: Tuning, tmp_path: Path) -> None:
    brief = replace(shipped, settings=replace(shipped.settings, time_limit=3.0))
    result = run(brief, tmp_path / "out", quick=True)
    assert [row["factor"] for row in result.rows] == ["base", "cost.weights.position"]
    assert {path.name for path in draw(tmp_path / "out")} == {"tuning.png", "tuning.pdf"}
