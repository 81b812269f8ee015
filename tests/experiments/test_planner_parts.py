"""Each combination of parts: what is played, what is compared, what is drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies import episodes
from wideberth.experiments.studies.comparison import Comparison
from wideberth.experiments.studies.planner_parts import PlannerParts
from wideberth.experiments.studies.tuning import Tuning
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework import names
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError


@pytest.fixture(scope="module")
def shipped() -> PlannerParts:
    experiment, _ = read_experiment("crowdnav_parts", [])
    assert isinstance(experiment, PlannerParts)
    return experiment


def test_a_pair_differs_in_predictor_and_region_alone(shipped: PlannerParts) -> None:
    base = planner_of(shipped.planner)
    pair = planner_of(shipped.variant({"predictor": "kalman", "region": "half_plane"}))
    assert pair.predictor == shipped.predictors["kalman"]
    assert pair.region == shipped.regions["half_plane"]
    same = ("robot", "level", "solver", "cost", "horizon", "dt", "penalty", "margin", "starts")
    assert all(getattr(pair, name) == getattr(base, name) for name in same)


def test_every_pair_meets_the_same_seeds(shipped: PlannerParts) -> None:
    few = replace(shipped, seeds=3, first_seed=5)
    seeds: dict[tuple[str, str], list[int]] = {}
    for task in few.tasks():
        seeds.setdefault((task.settings["predictor"], task.settings["region"]), []).append(
            task.seed
        )
    assert len(seeds) == len(few.predictors) * len(few.regions)
    assert set(map(tuple, seeds.values())) == {(5, 6, 7)}


def test_the_first_pair_is_ours_of_the_comparison(shipped: PlannerParts, tmp_path: Path) -> None:
    """The first pair is `ours` of crowdnav.yaml: the same episode, number for number."""
    comparison, _ = read_experiment("crowdnav", [])
    small = shipped.quick()
    result = run(small, tmp_path)
    row = result.rows[0]
    task = next(
        task for task in comparison.tasks()
        if (task.settings["scenario"], task.settings["controller"]) == ("circle", "ours")
    )  # fmt: skip
    expected = comparison.measure(task).rows[0]
    same = ("outcome", "success_time", "clearance", "plans", "judged_outcome", "judged_distance_m")
    assert [row[name] for name in same] == [expected[name] for name in same]
    lines = small.summary(result.rows)
    first = lines[0]["predictor"], lines[0]["region"]
    assert first == ("constant_velocity", "mahalanobis_ellipse")
    assert len(lines) == 4 and np.isnan(lines[0]["p_success"])  # against itself
    assert all(0.0 < line["p_success"] <= 1.0 for line in lines[1:])
    assert {path.name for path in draw(tmp_path)} == {"planner_parts.png", "planner_parts.pdf"}


def test_every_part_begins_once_before_the_work(
    shipped: PlannerParts, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[str] = []

    def note(scenarios: object, robot: object, controllers: dict[str, object], seed: int) -> None:
        begun.extend(controllers)

    monkeypatch.setattr(episodes, "check_starts", note)
    shipped.check()
    first, region = "constant_velocity", "mahalanobis_ellipse"
    expected = {f"{name} and {region}" for name in shipped.predictors}
    expected |= {f"{first} and {name}" for name in shipped.regions}
    assert set(begun) == expected and len(begun) == len(expected)


def test_a_robot_that_does_not_fit_is_refused(shipped: PlannerParts) -> None:
    wide = replace(shipped.robot, radius=0.6)  # type: ignore[type-var]
    with pytest.raises(
        WideberthError, match=r"^scenarios.circle has room for .* 0\.3 m, and robot has 0\.6"
    ):
        replace(shipped, robot=wide)
    slow = replace(shipped.robot, max_speed=0.5)  # type: ignore[type-var]
    with pytest.raises(WideberthError, match=r"^planner drives Holonomic.*, unlike robot: write"):
        replace(shipped, robot=slow)


def test_the_columns_have_one_list_of_sources() -> None:
    assert PlannerParts.reference == Tuning.reference == Comparison.reference


def test_a_controller_without_a_region_is_refused(shipped: PlannerParts) -> None:
    straight = build("controllers", {"type": "constant_velocity", "robot": shipped.robot})
    with pytest.raises(WideberthError, match=r"without predictor and region; wanted one that"):
        replace(shipped, planner=straight)
    with pytest.raises(WideberthError, match=r"levels and costs are empty; name at least one"):
        replace(shipped, predictors={}, regions={})
    with pytest.raises(WideberthError, match=r"relative_to: unknown part 'regions'"):
        replace(shipped, relative_to={"regions": "park"})


@pytest.fixture(scope="module")
def levels() -> PlannerParts:
    experiment, _ = read_experiment("level_policies", [])
    assert isinstance(experiment, PlannerParts)
    return experiment


def test_every_registered_policy_is_played(levels: PlannerParts) -> None:
    kinds = {type(level).__name__.lower() for level in levels.levels.values()}
    assert kinds == {name.replace("_", "") for name in names("levels")}
    assert len(levels.tasks()) == 3 * 2 * len(levels.levels) * levels.seeds


def test_planner_is_that_of_the_crossing(levels: PlannerParts) -> None:
    crossing, _ = read_experiment("crossing", [])
    costs, _ = read_experiment("cost_comparison", [])
    usual = crossing.planners["default"]  # type: ignore[attr-defined]
    for name in ("solver", "penalty", "margin", "horizon"):
        assert getattr(planner_of(levels.planner), name) == getattr(usual, name)
    for name in ("region", "predictor", "solver", "penalty", "margin", "horizon"):
        assert getattr(planner_of(costs.planner), name) == getattr(usual, name)  # type: ignore[attr-defined]


def test_who_may_give_way_does_and_who_holds_its_level_does_not(
    levels: PlannerParts, tmp_path: Path
) -> None:
    """One seed among the walkers."""
    kept = ("relaxed", "discounted")
    small = replace(levels, levels={name: levels.levels[name] for name in kept})
    small = replace(small, predictors={"kalman": levels.predictors["kalman"]})
    result = run(small, tmp_path / "out", quick=True)
    assert [row["level"] for row in result.rows] == list(kept)
    assert {row["scenario"] for row in result.rows} == {"field"}
    lines = {line["level"]: line for line in read_table(tmp_path / "out" / "summary.csv")}
    for line in lines.values():
        assert line["entered"] <= line["fallback_plans"] + 1e-9
        assert 0.0 <= line["driven_below"] <= 1.0
    assert lines["relaxed"]["driven_below"] > 0.3
    last = result.rows[1]  # but for plans that enter a region
    assert last["driven_below"] <= last["fallbacks"]
    assert {path.suffix for path in draw(tmp_path / "out")} == {".png", ".pdf"}


def test_a_crossing_with_each_cost(tmp_path: Path) -> None:
    experiment, _ = read_experiment("cost_comparison", [])
    assert isinstance(experiment, PlannerParts) and experiment.seeds >= 20
    alone = replace(experiment, scenarios={"crossing": experiment.scenarios["crossing"]})
    result = run(alone, tmp_path / "out", quick=True)
    lines = alone.summary(result.rows)
    assert [line["cost"] for line in lines] == ["tracking", "contouring"]
    assert lines[0]["extra_time"] == 0.0  # the first is the reference
    for line in lines:
        assert line["episodes"] == line["goals_in_time"] == 1
        assert line["collisions"] == 0 and line["clearance_min_m"] > 0.2
        assert 0.49 < line["peak_speed"] <= 0.7 + 1e-6
        assert 0.0 < line["deviation"] < 2.0


def test_the_reference_differs_in_the_named_parts_alone() -> None:
    experiment, _ = read_experiment("conservativeness", [])
    assert isinstance(experiment, PlannerParts)
    assert experiment.relative_to == {"predictor": "oracle"}
    small = experiment.quick()
    assert [*small.predictors] == ["oracle", "exact+estimation"] and len(small.regions) == 2


def test_every_registered_region_has_its_price(tmp_path: Path) -> None:
    """Kalman forecasts are round: there the paper's ellipse is the exact sum."""
    experiment, _ = read_experiment("region_price", [])
    assert isinstance(experiment, PlannerParts) and experiment.seeds >= 10
    kinds = {type(region).__name__.lower() for region in experiment.regions.values()}
    assert kinds == {name.replace("_", "") for name in names("regions")}
    ellipse, exact = "mahalanobis_ellipse", "minkowski_sum"
    round_ones = {"kalman": experiment.predictors["kalman"]}
    result = run(replace(experiment, predictors=round_ones), tmp_path / "out", quick=True)
    rows = {row["region"]: row for row in result.rows}
    assert [*rows] == [ellipse, exact]
    for name in ("clearance", "time_ratio_worst", "length_ratio_worst"):
        assert rows[exact][name] == pytest.approx(rows[ellipse][name], abs=1e-3)
    lines = {line["region"]: line for line in read_table(tmp_path / "out" / "summary.csv")}
    assert lines[ellipse]["extra_time"] == lines[ellipse]["extra_path"] == 0.0
    assert lines[exact]["area_ratio"] == 1.0
    assert lines[ellipse]["area_ratio"] == pytest.approx(1.0, abs=1e-9)
