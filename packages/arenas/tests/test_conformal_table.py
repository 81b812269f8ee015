"""The table of conformal planners: its starts, its bound, its files, and its quick run."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.experiments.engine.runner import run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.conformal import Conformal
from wideberth.predictors.data.recordings import Recording
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.scenarios.recorded_scene import FILES
from wideberth_arenas.controllers.acp import AdaptiveConformalPlanner
from wideberth_arenas.studies.conformal_forecasts import PublishedForecasts
from wideberth_arenas.studies.conformal_protocol import STANDING, RecordedCourse, drive
from wideberth_arenas.studies.conformal_table import (
    STARTS,
    ConformalTable,
    Contender,
    compared,
)
from wideberth_arenas.studies.field_rows import calibrated, unbroken
from wideberth_arenas.studies.least_hits import least_hits


def shipped(*overrides):
    experiment, _ = read_experiment("conformal_table", list(overrides))
    assert isinstance(experiment, ConformalTable)
    return experiment


def standing(place, rows=60):
    """Return a course whose only person stands; the robot wants 6 m along x."""
    positions = np.broadcast_to(np.array(place, dtype=float), (1, rows, 2))
    recording = Recording(0.4, 0.4 * np.arange(rows), ("1",), positions, (None,))
    return RecordedCourse(recording, (0.0, 0.0, 0.0), (6.0, 0.0))


def test_least_hits_of_one_who_stands_on_the_start():
    """Straight away at 0.32 m a row the robot is at 0, 0.32, 0.64 and 0.96 m, below 1.107 m."""
    course = standing((0.0, 0.0))
    found = least_hits(course, course.episode(1))
    assert found.low <= 4.0 <= found.high and found.high - found.low <= 1.0


def test_least_hits_where_nothing_is_in_the_way():
    course = standing((3.0, 0.0))  # there is room beside
    assert least_hits(course, course.episode(1)).low == 0.0
    assert least_hits(course, course.episode(1)).high == 0.0
    short = least_hits(course, course.episode(1, 10))
    assert short.low == 0.0 and short.high == np.inf  # too few rows to arrive


def test_a_person_on_the_goal_is_met_by_those_who_arrive():
    """Who stands on the goal is hit from 1.107 m away to the arrival at 0.6 m."""
    course = standing((6.0, 0.0))
    found = least_hits(course, course.episode(1))
    # A robot that stays away has none; one that arrives crosses 0.507 m: 1 or 2 rows.
    assert found.low == 0.0 and 1.0 <= found.high <= 2.0


def folder_of(tmp_path, rows=320):
    """Write recordings under their usual names: one walks far away, and for rows a second one."""
    for name in FILES.values():
        lines = [f"{10 * k} 1 {40 + 0.1 * k} 40" for k in range(rows)]
        lines += [f"{10 * k} 2 50 {50 + 0.1 * k}" for k in range(120)]
        lines.sort(key=lambda line: int(line.split()[0]))
        (tmp_path / name).write_text("\n".join(lines))
    return str(tmp_path)


def test_starts_are_the_published_ones_and_every_nth_row(tmp_path):
    table = shipped(f"recordings={folder_of(tmp_path, 1800)}", "every=100")
    for name in ("acp_published", "cc"):
        some = [task.settings for task in table.tasks() if task.settings["contender"] == name]
        published = {(one["scene"], one["start"]) for one in some if one["set"] == "published"}
        assert published == {(scene, start) for scene in FILES for start in STARTS[scene]}
        more = [one["start"] for one in some if one["set"] == "more" and one["scene"] == "eth"]
        # Of rows 1 to 1799: 1, 101, ..., with 100 rows left.
        assert more == list(range(1, 1701, 100))


def test_published_draws_go_on_from_start_to_start(tmp_path):
    table = shipped(f"recordings={folder_of(tmp_path)}")
    acp = table.contenders["acp_published"]
    made = [table._prepared(acp, "published", "eth", start) for start in STARTS["eth"]]
    assert [one.earlier for one in made] == [0, 1, 2]
    assert table._prepared(acp, "more", "eth", 732).earlier == 0


def test_forecasts_are_given_to_those_that_sample_paths(tmp_path):
    folder = folder_of(tmp_path)
    np.savez(tmp_path / "eth.npz", row=[1], person=[1], forecast=np.zeros((1, 12, 2)))
    table = shipped(f"recordings={folder}", f"forecasts={folder}")
    ecp, ours = (table.contenders[name] for name in ("ecp", "recorded_scene"))
    made = table._prepared(ecp, "published", "eth", 732).predictor
    assert isinstance(made, PublishedForecasts) and made.file.endswith("eth.npz")
    assert table._prepared(ecp, "published", "hotel", 1001).predictor == ecp.controller.predictor
    assert table._prepared(ours, "published", "eth", 732).predictor == ours.controller.predictor
    assert sorted(path.name for path in table.inputs()) == sorted([*FILES.values(), "eth.npz"])


def test_a_predictor_is_fitted_to_the_other_scenes(tmp_path, monkeypatch):
    table, fitted = shipped(f"recordings={folder_of(tmp_path)}"), []

    def fit(self, dataset):
        fitted.append(len(dataset))
        return replace(self, tail=0.25)

    monkeypatch.setattr(Conformal, "fit", fit)
    made = table._prepared(table.contenders["joint_plan"], "more", "eth", 1)
    assert made.predictor.tail == 0.25 and fitted == [4]
    with pytest.raises(WideberthError, match="wanted an mpc whose predictor can be fitted"):
        Contender(table.contenders["cc"].controller, fitted=True)
    with pytest.raises(WideberthError, match="person"):
        Contender(table.contenders["cc"].controller, person=0.0)


def test_missing_files_are_named(tmp_path):
    folder = folder_of(tmp_path)
    (tmp_path / "students003.txt").unlink()
    with pytest.raises(WideberthError, match=r"holds no 'students003\.txt', the scene 'univ'"):
        shipped(f"recordings={folder}").inputs()
    with pytest.raises(WideberthError, match="state the folder of the recordings"):
        shipped(f"forecasts={folder}")
    with pytest.raises(WideberthError, match="is no folder"):
        shipped(f"recordings={folder}", f"forecasts={tmp_path / 'none'}")._forecast_file("eth")
    with pytest.raises(WideberthError, match="ours is 'nobody'; wanted one of"):
        shipped("ours=nobody")


def test_differences_are_paired_by_start():
    ours = [{"rate": 0.1 * k, "block": f"eth {k}"} for k in range(20)]
    rows = [{**one, "rate": one["rate"] + 0.02} for one in ours]
    found = compared(rows, ours)
    assert found["difference"] == pytest.approx(0.02) and found["p_difference"] < 0.001
    assert found["difference_low"] == pytest.approx(0.02)
    assert compared(rows[:1], ours[:1])["p_difference"] == 1.0


def test_quick_run(tmp_path):
    table = shipped().quick()
    names = ["acp_published", "cc", "recommended", "joint_plan", "ours"]
    table = replace(table, contenders={name: table.contenders[name] for name in names})
    result = run(table, tmp_path / "out")
    lines = table.summary(result.rows)
    assert [line["contender"] for line in lines] == [
        *names[:3],
        "ours",
    ]  # the plaza is too short for a fit
    for line in lines:
        assert line["starts"] == len(STARTS["plaza"]) == line["arrivals"] + line["timeouts"]
        assert line["hits"] == sum(line[kind] for kind in ("newcomers", "standing", "own"))
        assert line["unavoidable"] <= line["hits"] or line["timeouts"]
    assert lines[-1]["difference"] == 0.0 and lines[-1]["p_difference"] == 1.0


@pytest.mark.parametrize("name", ["fcp_soft_published", "fcp_soft", "fcp_hard"])
def test_fcp_is_calibrated_for_its_episode_and_as_published_begins_at_once(name):
    table = shipped().quick()
    contender, (start, _) = table.contenders[name], STARTS["plaza"]
    (task,) = [one for one in table.tasks() if one.settings == {
        "contender": name, "set": "published", "scene": "plaza", "start": start}]  # fmt: skip
    (row,) = table.measure(task).rows
    course, published = table._course("plaza"), name.endswith("published")
    rows = unbroken(course, start) if published else course.episode(start)
    made = calibrated(contender.controller, course, rows, start)
    assert (made.envelope is None) == (not published)  # 150 rows are too few beside an episode
    found = drive(made, course, rows, standing=0 if published else STANDING)
    assert row["hits"] == found.hits.sum() and row["arrived"] == (found.arrival() is not None)
    assert row["rows"] == len(found.hits)
    assert row["steps"] == (found.arrival() if row["arrived"] else len(rows))


def test_a_timeout_lasts_as_long_as_the_episode(tmp_path):
    """A robot among people who never come near, without a path of its own, stands to the end."""
    slow = AdaptiveConformalPlanner(Unicycle(0.4, 0.01, 0.7, 1e3, 1e3), paths=5)
    table = ConformalTable({"slow": Contender(slow)}, "slow")
    (line,) = table.summary([row for task in table.tasks() for row in table.measure(task).rows])
    assert (line["steps"], line["timeouts"], line["arrivals"]) == (100.0, 2, 0)
