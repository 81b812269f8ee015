"""The study of guarantees: who promises what, what it is fitted to, and that it runs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.guarantees import Guarantees, SimulatedPlace, promised
from wideberth.experiments.studies.variants import planner_of
from wideberth.framework.values.coverage import Event
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.scenarios.recorded_scene import RecordedScene


@pytest.fixture(scope="module")
def shipped() -> Guarantees:
    experiment, _ = read_experiment("guarantees", [])
    assert isinstance(experiment, Guarantees)
    return experiment


def test_every_planner_promises_an_event(shipped: Guarantees) -> None:
    found = {name: promised(planner_of(one)) for name, one in shipped.planners.items()}
    events = {name: (coverage.event, tail) for name, (coverage, tail, _) in found.items()}
    assert events["marginal"] == (Event.STEP, 0.05)
    assert events["recommended"][0] is Event.LONG_RUN
    assert events["boole"] == (Event.PLAN, 0.1)
    assert events["conformal_per_step"] == (Event.STEP, 0.1)


def test_exact_model_keeps_what_it_promises(shipped: Guarantees) -> None:
    """Walkers of the filter's own model are missed as often as it says, within the interval."""
    exact = {"exact": shipped.places["exact"]}
    small = replace(
        shipped, places=exact, planners={"marginal": shipped.planners["marginal"]}, seeds=25,
        as_given=("marginal",),
    )  # fmt: skip
    task = next(task for task in small.tasks() if task.settings["place"] == "exact")
    (line,) = small.summary(small.measure(task).rows)
    assert line["missed_low"] < line["promise"] < line["missed_high"]
    assert line["missed"] == line["steps_missed"] < line["persons_missed"] < line["plans_missed"]
    assert line["radius_first_m"] < line["radius_middle_m"] < line["radius_last_m"]


def test_calibration_sees_other_episodes(shipped: Guarantees) -> None:
    """What is fitted learns from as many episodes as stated, none of them one that counts."""
    place = replace(shipped.places["exact"], learning=2)
    watched = place.watched(shipped.robot, 0.4)
    assert len(watched) == 2 and all(tracks.dt == 0.4 for tracks in watched)
    counted = place.scenario.cast(0).bystanders
    where = [one.at(np.zeros(1))[0] for one in counted]
    for tracks in watched:
        now = tracks.positions[:, 0]
        assert tracks.positions.shape[1] == round(place.settings.time_limit / 0.4) + 1
        assert not np.isclose(now[:, None], np.array(where)[None], atol=0.1).all(axis=2).any()


def test_recorded_places_leave_themselves_out(shipped: Guarantees) -> None:
    """Each of the shipped recordings is fitted to the other, and begun where people are."""
    fitted, text = shipped._fitted("plaza", "conformal_per_step")
    assert text.startswith("fitted to 1 recording") and fitted.predictor != (
        planner_of(shipped.planners["conformal_per_step"]).predictor
    )
    assert shipped._fitted("plaza", "marginal")[1] == "as given"
    scenario, settings = shipped._place("plaza")
    assert isinstance(scenario, RecordedScene) and settings == shipped.settings
    for seed in (0, 1):
        people = scenario.cast(seed).bystanders
        assert any(np.isfinite(one.at(np.zeros(1))).all() for one in people)
    assert shipped._block(scenario, 0) == scenario.rows[0] // 100


def test_quick_run(shipped: Guarantees, tmp_path: Path) -> None:
    result = run(shipped, tmp_path / "out", quick=True)
    assert {row["planner"] for row in result.rows} == set(list(shipped.planners)[:3])
    lines = read_table(tmp_path / "out" / "summary.csv")
    assert all(0.0 <= line["missed_low"] <= line["missed_high"] <= 1.0 for line in lines)
    assert {path.suffix for path in draw(tmp_path / "out")} == {".png", ".pdf"}


def test_chosen_places(shipped: Guarantees) -> None:
    for chosen in (("exact",), ("plaza",), ("livelier", "crowd")):
        tasks = replace(shipped, only=chosen).tasks()
        assert {task.settings["place"] for task in tasks} == set(chosen)


def test_settings_that_make_no_experiment_are_refused(shipped: Guarantees) -> None:
    with pytest.raises(WideberthError, match="planners is empty"):
        replace(shipped, planners={})
    with pytest.raises(WideberthError, match=r"as_given: .*did you mean 'boole'"):
        replace(shipped, as_given=("bool",))
    with pytest.raises(WideberthError, match=r"only: .*did you mean 'plaza'"):
        replace(shipped, only=("plaza", "plasa")).tasks()
    with pytest.raises(WideberthError, match="learning"):
        SimulatedPlace(shipped.places["exact"].scenario, learning=0)
    with pytest.raises(WideberthError, match=r"places\.plaza is named like a scene"):
        replace(shipped, places={"plaza": shipped.places["exact"]}).check()
