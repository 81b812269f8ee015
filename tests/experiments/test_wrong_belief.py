"""The study of wrong beliefs: planners, pairs, the bar, and that the quick setting runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped import read_experiment
from wideberth.experiments.studies.variants import planner_of
from wideberth.experiments.studies.wrong_belief import (
    Place,
    WrongBelief,
    contacts_against,
    with_courtesy,
)
from wideberth.framework.plugins.io import read_table
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors import Kalman


@pytest.fixture(scope="module")
def shipped() -> WrongBelief:
    experiment, _ = read_experiment("wrong_belief", [])
    assert isinstance(experiment, WrongBelief)
    return experiment


def test_planners_are_those_of_the_benchmarks_but_for_the_predictor(shipped: WrongBelief) -> None:
    for place, name in (("crowd", "random_crowd"), ("door", "hallway")):
        other, _ = read_experiment(name, [])
        wanted = planner_of(other.controllers["ours"])  # type: ignore[attr-defined]
        own = planner_of(shipped.places[place].planner)
        for part in ("robot", "level", "solver", "cost", "penalty", "margin", "horizon", "dt"):
            assert getattr(own, part) == getattr(wanted, part)


def test_certainty_is_measured_once(shipped: WrongBelief) -> None:
    assert shipped.planners == [
        (0.0, "certain"), (0.25, "fixed"), (0.25, "updated"), (0.5, "fixed"), (0.5, "updated"),
        (1.0, "certain"),
    ]  # fmt: skip
    assert len(shipped.tasks()) == 2 * 4 * 6 * shipped.seeds
    assert len({task.name for task in shipped.tasks()}) == len(shipped.tasks())


def test_a_belief_changes_the_predictor_alone(shipped: WrongBelief) -> None:
    planner = shipped.places["crowd"].planner
    held = with_courtesy(planner, 0.25, "fixed").predictor
    assert (held.courtesy, held.update_courtesy) == (0.25, False)  # type: ignore[attr-defined]
    assert with_courtesy(planner, 0.5, "updated").predictor == planner_of(planner).predictor


def test_contacts_are_compared_seed_by_seed() -> None:
    def rows(*touched: bool) -> list[Row]:
        return [{"seed": k, "collision": one} for k, one in enumerate(touched)]

    found = contacts_against(rows(True, True, False, True), rows(False, False, False, True))
    assert (found["more_contacts"], found["fewer_contacts"]) == (2, 0)
    assert found["contact_difference"] == 0.5
    assert found["contacts_p"] == 0.5  # two of two: 2 (1 / 2)^2
    assert found["contact_difference_low"] <= 0.5 <= found["contact_difference_high"]
    same = contacts_against(rows(True, False), rows(True, False))
    assert same["contacts_p"] == 1.0 and same["contact_difference_high"] == 0.0


def test_quick_run(shipped: WrongBelief, tmp_path: Path) -> None:
    """A door for two seconds: planners that assume 0 and 1, paired, and the figure."""
    door = shipped.places["door"]
    short = replace(door, settings=replace(door.settings, time_limit=2.0))
    result = run(replace(shipped, places={"door": short}), tmp_path / "out", quick=True)
    assert [row["assumed"] for row in result.rows] == [0.0, 1.0]
    lines = read_table(tmp_path / "out" / "summary.csv")
    assert lines[0]["contact_difference"] == 0.0
    assert all(np.isfinite(line["clearance_median_m"]) for line in lines)
    assert {path.name for path in draw(tmp_path / "out")} == {
        "wrong_belief.png", "wrong_belief.pdf",
    }  # fmt: skip


def test_settings_that_make_no_experiment_are_refused(shipped: WrongBelief) -> None:
    door = shipped.places["door"]
    other = replace(planner_of(door.planner), predictor=Kalman())
    for words, changes in {
        "places is empty": {"places": {}},
        "wanted 0 among them": {"assumed": (0.5, 1.0)},
        "each of them once": {"true": (0.5, 0.5)},
        "courtesy is 1.5": {"true": (1.5,)},
        "wanted `type: reacting_people`": {"places": {"door": Place(door.scenario, other)}},
    }.items():
        with pytest.raises(WideberthError, match=words):
            replace(shipped, **changes)  # type: ignore[arg-type]
