"""The loop of the conformal planners' comparison, against arithmetic; forecasts from files."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.controller import Controller
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.data.recordings import Recording
from wideberth_arenas.controllers.acp import AdaptiveConformalPlanner
from wideberth_arenas.controllers.cc import ConformalController
from wideberth_arenas.studies.conformal_forecasts import PublishedForecasts, read_forecasts
from wideberth_arenas.studies.conformal_protocol import (
    MOST,
    REACH,
    ROBOT,
    STANDING,
    RecordedCourse,
    drive,
)


def recorded(*tracks):
    """Return a recording of tracks, (T, 2), NaN where no one is."""
    positions = np.array(tracks, dtype=float)
    names = tuple(f"{k + 1}" for k in range(len(tracks)))
    times = 0.4 * np.arange(positions.shape[1])
    return Recording(0.4, times, names, positions, (None,) * len(tracks))


def walking(start, step, rows, first=0, last=None):
    track = np.array(start) + np.arange(rows)[:, None] * np.array(step)
    track[:first] = np.nan
    track[rows if last is None else last :] = np.nan
    return track


@dataclass(eq=False)
class Scripted(Controller):
    """Commands the same velocity, and notes what it sees."""

    linear: float
    omega: float = 0.0
    robot: Robot = ROBOT
    period: float = 0.4

    def __post_init__(self):
        self.seen, self.remembered = [], 0

    def reset(self):
        self.__post_init__()

    def set_path(self, path: Path):
        self.path = path

    def remember(self, observation: Observation):
        self.remembered += 1

    def command(self, observation: Observation):
        self.seen.append(observation)
        return Command((self.linear, 0.0), self.omega)

    @property
    def last_plan(self):
        return None


FAR = walking((50.0, 50.0), (0.0, 0.1), 200)


def test_robot_stands_then_moves_by_eulers_rule():
    course, driver = (
        RecordedCourse(recorded(FAR), (1.0, 2.0, 0.5), (30.0, 2.0)),
        Scripted(0.8, 0.7),
    )
    found = drive(driver, course, course.episode(0))
    assert len(found.rows) == MOST and found.rows[0] == 1  # seen from the second row on
    assert driver.remembered == STANDING and len(driver.seen) == MOST - STANDING
    x, y, heading = 1.0, 2.0, 0.5
    for k, pose in enumerate(found.poses):
        np.testing.assert_allclose(pose, (x, y, heading), atol=1e-12)
        if k >= STANDING:
            x, y = x + 0.32 * np.cos(heading), y + 0.32 * np.sin(heading)
            heading += 0.28
    assert found.judged == slice(STANDING, None) and len(found.hits) == MOST - STANDING
    np.testing.assert_allclose(found.speeds[STANDING + 1 :], 0.8)
    last = driver.seen[-1]
    np.testing.assert_allclose(last.state[:2], found.poses[-1, :2])
    assert last.detections[0].ident == "1" and last.stamp == pytest.approx(0.4 * found.rows[-1])


def test_rows_without_people_are_left_out():
    course = RecordedCourse(recorded(FAR, walking((9.0, 9.0), (0, 0), 200)), (0, 0, 0.0), (9, 0))
    assert course.rows == tuple(range(1, 200))
    some = walking((9.0, 9.0), (0.1, 0), 40, 5, 10)
    late = walking((9.0, 9.0), (0.1, 0), 40, 20, 30)
    course = RecordedCourse(recorded(some, late), (0, 0, 0.0), (9, 0))
    assert course.rows == (*range(6, 10), *range(21, 30))
    assert course.episode(8, 3) == (8, 9, 21)
    assert [one for one, _ in zip(*course.people(21), strict=True)] == [1]


def test_arrival_first_or_last():
    """The robot drives over its goal, and on: 0.6 m before and behind it are 4 rows of 0.32 m."""
    course = RecordedCourse(recorded(FAR), (0.0, 0.0, 0.0), (3.2, 0.0))
    found = drive(Scripted(0.8), course, course.episode(0), to_the_end=True)
    # The goal is at 10 steps; |x - 3.2| <= 0.6 at steps 9, 10 and 11.
    assert found.arrival() == STANDING + 9 and found.arrival(last=True) == STANDING + 11
    assert len(found.rows) == MOST and len(found.hits) == 9
    short = drive(Scripted(0.8), course, course.episode(0))
    assert len(short.rows) == STANDING + 10 and short.arrival() == STANDING + 9
    assert drive(Scripted(0.0), course, course.episode(0)).arrival() is None


def test_hits_by_kind():
    """One stands in the way all along, one appears where the robot stands, and stays."""
    ahead = walking((1.6, 0.0), (0, 0), 150)
    course = RecordedCourse(recorded(FAR[:150], ahead), (0, 0, 0.0), (60, 0))
    found = drive(Scripted(0.8), course, course.episode(0))
    gone = found.poses[STANDING:, 0]
    np.testing.assert_array_equal(found.hits, np.abs(gone - 1.6) < REACH)
    assert found.kinds(course) == {"newcomers": 0, "standing": 0, "own": int(found.hits.sum())}
    appears = walking((0.5, 0.0), (0, 0), 150, 30, 44)
    course = RecordedCourse(recorded(FAR[:150], appears), (0, 0, 0.0), (20, 0))
    found = drive(Scripted(0.0), course, course.episode(0))
    # There at rows 30 to 43, seen from 31 on; 2 s are 5 rows.
    assert found.kinds(course) == {"newcomers": 5, "standing": 8, "own": 0}


def test_failed_rows_are_those_without_a_path():
    near = [walking((x, 0.0), (0.0, 0.0), 150) for x in (1.0, -1.0)]
    course = RecordedCourse(recorded(*near), (0, 0, 0.0), (9, 0))
    found = drive(AdaptiveConformalPlanner(ROBOT, paths=20), course, course.episode(0, 20))
    assert found.failed[:STANDING].sum() == 0
    assert found.failed[STANDING:].all() and not found.poses[:, :2].any()


def test_forecasts_come_from_the_file_where_it_has_them(tmp_path):
    ahead = np.cumsum(np.ones((12, 2)), axis=0)
    np.savez(tmp_path / "a.npz", row=np.array([7, 7]), person=np.array([1, 4]),
             forecast=np.stack([ahead, 2 * ahead]))  # fmt: skip
    places = np.arange(12.0).reshape(2, 3, 2)
    known = PublishedForecasts(str(tmp_path / "a.npz"), ConstantVelocity(window=1))
    tracks = Tracks(places, 0.4, ("4", "5"), np.ones(2), np.zeros((2, 2, 2)), 2.8)
    found = known.predict(tracks, 12)
    np.testing.assert_array_equal(found.mean[0, 0], 2 * ahead)
    np.testing.assert_allclose(found.mean[1, 0, 0], places[1, -1] + (2.0, 2.0))


class Harmful:
    def __reduce__(self):
        return print, ("this ran",)


def test_pickled_forecasts_are_refused(tmp_path, capsys):
    for content in (Harmful(), np.ones(3)):
        file = tmp_path / "eth.pkl"
        file.write_bytes(pickle.dumps({"prediction": content}))
        with pytest.raises(WideberthError, match="is no npz archive"):
            read_forecasts(str(file))
    np.savez(tmp_path / "objects.npz", row=np.array([Harmful()]), person=[1], forecast=[[1.0]])
    with pytest.raises(WideberthError, match="damaged npz archive"):
        read_forecasts(str(tmp_path / "objects.npz"))
    assert "this ran" not in capsys.readouterr().out
    folders = [f"{name}={tmp_path}" for name in ("recordings", "forecasts")]
    table = read_experiment("conformal_table", folders)[0]
    with pytest.raises(WideberthError, match=r"eth\.pkl is a pickle"):
        table._forecast_file("eth")
    assert table._forecast_file("hotel") == ""


def test_forecasts_of_another_shape_are_refused(tmp_path):
    with pytest.raises(WideberthError, match="absent"):
        read_forecasts(str(tmp_path / "absent.npz"))
    np.savez(tmp_path / "a.npz", row=[1], person=[1], forecast=np.ones((1, 4, 3)))
    with pytest.raises(WideberthError, match="holds no forecasts"):
        read_forecasts(str(tmp_path / "a.npz"))
    np.savez(tmp_path / "a.npz", row=[1], person=[1])
    with pytest.raises(WideberthError, match="holds no forecasts"):
        read_forecasts(str(tmp_path / "a.npz"))


def test_published_decisions_count_rows_and_others_the_clock():
    """A gap of the recording is no time as published."""
    for published, row in ((True, 3), (False, 23)):
        made = ConformalController(ROBOT, paths=10, as_published=published)
        course = RecordedCourse(recorded(FAR), (0.0, 0.0, 0.0), (9.0, 0.0))
        drive(made, course, (10, 11, 12, 23), standing=2)
        assert made._row == row
