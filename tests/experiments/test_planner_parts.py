"""Each predictor with each region: what is played, what is compared, what is drawn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies import episodes
from wideberth.experiments.studies.comparison import Comparison
from wideberth.experiments.studies.planner_parts import PlannerParts
from wideberth.experiments.studies.tuning import Tuning
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError


@pytest.fixture(scope="module")
def shipped() -> PlannerParts:
    experiment, _ = read_experiment("crowdnav_parts", [])
    assert isinstance(experiment, PlannerParts)
    return experiment


def test_a_pair_differs_in_predictor_and_region_alone(shipped: PlannerParts) -> None:
    base = planner_of(shipped.planner)
    pair = planner_of(shipped.pair("kalman", "half_plane"))
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
    names = {path.name for path in draw(tmp_path)}
    assert names == {"planner_parts.png", "planner_parts.pdf"}


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
        WideberthError, match=r"^scenario has room for .* 0\.3 m, and robot has 0\.6"
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
    with pytest.raises(WideberthError, match=r"regions is empty"):
        replace(shipped, regions={})
