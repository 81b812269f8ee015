"""Rows of fields from a recording, and FCP's calibration for an episode."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.predictors.data.recordings import Recording
from wideberth_arenas.controllers.fcp import FunctionalConformalPlanner
from wideberth_arenas.studies.conformal_protocol import ROBOT, RecordedCourse
from wideberth_arenas.studies.field_rows import (
    FieldRows,
    calibrated,
    episode_grid,
    scene_grid,
    unbroken,
)

STEADY = ConstantVelocity(window=1)


def recording(seed=0, rows=240, people=6):
    """People who come, walk with changing velocities, and leave."""
    rng = np.random.default_rng(seed)
    positions = np.full((people, rows, 2), np.nan)
    for track in positions:
        first = int(rng.integers(0, rows // 2))
        last = int(rng.integers(first + 40, rows))
        velocity = np.cumsum(0.05 * rng.standard_normal((last - first, 2)), axis=0)
        track[first:last] = rng.uniform(-4.0, 4.0, 2) + np.cumsum(0.4 * velocity, axis=0)
    names = tuple(f"{k}" for k in range(people))
    return Recording(0.4, 0.4 * np.arange(rows), names, positions, (None,) * people)


def course(seed=0):
    return RecordedCourse(recording(seed), (0.0, 0.0, 0.0), (3.0, 1.0))


def test_rows_hold_predictions_of_the_seen_and_truth_of_everyone():
    own = course()
    found = FieldRows.of(own, STEADY, 3)
    recorded = own.recording.positions
    assert found.rows.tolist() == list(own.rows)
    for place in (10, 60, 120):
        row = int(found.rows[place])
        who, now = own.people(row)
        straight = now + 3 * (now - recorded[who, row - 1])
        np.testing.assert_allclose(found.predicted[place, 2, who], straight)
        others = [k for k in range(6) if k not in who]
        assert np.isnan(found.predicted[place][:, others]).all()
        np.testing.assert_array_equal(found.actual[place, 2], recorded[:, row + 3])
    pairs = found.paired()
    np.testing.assert_array_equal(np.isfinite(pairs.predicted), np.isfinite(pairs.actual))
    # The future of the last rows is not recorded.
    last = FieldRows.of(replace(own, recording=cut(own.recording, found.rows[-1] + 1)), STEADY, 3)
    assert np.isnan(last.actual[-1]).all()


def cut(own, rows):
    return Recording(own.dt, own.times[:rows], own.ids, own.positions[:, :rows], own.unusable)


def test_rows_outside_share_no_sample_with_an_episode():
    found = FieldRows.of(course(), STEADY, 12)
    rest = found.outside(80, 99).rows
    # Row 67 sees up to row 79; row 99, the last one, up to row 111.
    assert 67 in rest and 68 not in rest and 111 not in rest and 112 in rest


def test_published_episodes_end_where_no_one_is_seen():
    own = course()
    gap = replace(own, recording=cut(own.recording, 120))
    gap.recording.positions.setflags(write=True)
    gap.recording.positions[:, 90:92] = np.nan
    assert unbroken(gap, 80) == tuple(range(80, 90))
    assert unbroken(gap, 60, 20) == tuple(range(60, 80))


def test_grids_hold_what_they_are_of():
    own = course()
    found = FieldRows.of(own, STEADY)
    cell, inside = scene_grid(own).nearest(np.nan_to_num(own.recording.positions))
    assert inside[np.isfinite(own.recording.positions[..., 0])].all()
    grid = episode_grid(own, found, 60)
    within = (found.rows >= 60) & (found.rows < 160)
    ahead = found.predicted[within]
    assert grid.nearest(np.nan_to_num(ahead))[1][np.isfinite(ahead[..., 0])].all()
    assert grid.nearest(np.array([own.goal, own.start[:2]]))[1].all()
    assert grid.cells == 128 and cell.shape == own.recording.positions.shape[:2]


@pytest.fixture
def coarse(monkeypatch):
    for name in ("CELLS", "SCENE_CELLS"):
        monkeypatch.setattr(f"wideberth_arenas.studies.field_rows.{name}", 12)


@pytest.mark.usefixtures("coarse")
def test_calibration_leaves_the_episode_out_unless_as_published():
    """People who jump about within the episode change the published envelope alone."""
    first, other = course(), course()
    rng, episode = np.random.default_rng(3), range(100, 160)
    other.recording.positions.setflags(write=True)
    middle = other.recording.positions[:, 100:160]
    middle += 0.05 * rng.standard_normal(middle.shape)
    for published in (False, True):
        planner = FunctionalConformalPlanner(ROBOT, STEADY, as_published=published)
        one, two = (calibrated(planner, own, episode, 100).envelope for own in (first, other))
        assert (one.upper == two.upper) == (not published)


@pytest.mark.usefixtures("coarse")
def test_as_published_the_first_grid_is_kept_under_another_one():
    own = course()
    planner = FunctionalConformalPlanner(ROBOT, STEADY, as_published=True)
    begun = calibrated(planner, own, range(60, 90), 60).envelope
    later = calibrated(planner, own, range(150, 180), 60).envelope
    assert begun.upper == later.upper and begun.grid != later.grid
