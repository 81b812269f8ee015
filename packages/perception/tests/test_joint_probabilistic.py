"""Stone Soup's joint probabilistic data association beside `nearest`."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.benchmarks.joint_probabilistic import JointProbabilistic
from wideberth.simulation.sensing.perceived import Sightings
from wideberth_perception.tracker import Tracker
from wideberth_perception.tracking.nearest import Nearest
from wideberth_perception.tracking_scores import TrackScores, track_scores

pytest.importorskip("stonesoup", reason="compares with Stone Soup, of the dependency group bench")


def walked(
    rng: np.random.Generator, apart: float
) -> list[tuple[Sightings, dict[str, np.ndarray]]]:
    """Two who walk towards each other and pass, each met at an instant of its own in each scan."""
    run = []
    for number in range(1, 61):
        time = 0.1 * number
        times = time - np.array([0.03, 0.07])
        places = np.array([[-3.0 + times[0], 0.0], [3.0 - times[1], apart]])
        places = places + 0.01 * rng.standard_normal((2, 2))
        spread, radius = np.tile(1e-4 * np.eye(2), (2, 1, 1)), np.full(2, 0.25)
        truth = {
            "a": np.array([-3.0 + time, 0.0, 1.0, 0.0]),
            "b": np.array([3.0 - time, apart, -1.0, 0.0]),
        }
        run.append((Sightings(time, places, spread, radius, times=times), truth))
    return run


def scored(tracker: Tracker, apart: float, seed: int) -> TrackScores:
    steps = []
    for seen, truth in walked(np.random.default_rng(seed), apart):
        tracker.update(seen)
        steps.append((seen.time, truth, tracker.at(seen.time)))
    return track_scores(steps)


def test_where_nobody_can_be_mistaken_both_are_the_same_filter() -> None:
    """Far apart, every association is sure: our Kalman filters and the mixture agree."""
    ours, theirs = Nearest(), JointProbabilistic(clutter=1e-9)
    for seen, _ in walked(np.random.default_rng(0), 3.0):
        ours.update(seen)
        theirs.update(seen)
        found = [
            sorted(one.at(seen.time + 0.04), key=lambda track: track.state[1])
            for one in (ours, theirs)
        ]
        assert len(found[0]) == len(found[1])
        for mine, other in zip(*found, strict=True):
            np.testing.assert_allclose(mine.state, other.state, atol=1e-9)
            np.testing.assert_allclose(mine.covariance, other.covariance, atol=1e-9)
    assert len(found[0]) == 2


@pytest.mark.parametrize("apart", [0.5, 0.2])
def test_two_who_pass_keep_their_names_under_both(apart: float) -> None:
    """They are told apart by their motion alone; neither tracker takes one for the other."""
    for tracker in (Nearest(), JointProbabilistic()):
        scores = [scored(tracker.__class__(), apart, seed) for seed in range(3)]
        assert sum(one.switches for one in scores) == 0
        assert max(one.missed for one in scores) < 0.05
        assert 1.0 < np.mean([one.nees for one in scores]) < 6.0


def test_a_single_assignment_is_no_worse_on_sightings_of_nobody() -> None:
    """Three sightings of nobody per scan in 10 m by 10 m."""
    rng = np.random.default_rng(5)
    found = {}
    for kind in (Nearest, JointProbabilistic):
        tracker, steps = kind(), []
        for seen, truth in walked(np.random.default_rng(1), 1.0):
            ghosts = rng.uniform(-5.0, 5.0, (3, 2))
            tracker.update(
                replace(
                    seen,
                    positions=np.concatenate([seen.positions, ghosts]),
                    covariance=np.tile(1e-4 * np.eye(2), (5, 1, 1)),
                    radius=np.full(5, 0.25),
                    times=np.concatenate([seen.times, np.full(3, seen.time)]),
                )
            )
            steps.append((seen.time, truth, tracker.at(seen.time)))
        found[kind] = track_scores(steps)
    assert found[Nearest].switches == 0
    assert found[Nearest].gospa < found[JointProbabilistic].gospa + 0.05
