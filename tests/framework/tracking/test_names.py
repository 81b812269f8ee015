"""A repeated name and a name that changes its owner hide no obstacle; no motion is a jump."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from wideberth.controllers.reactive import Neighbours
from wideberth.controllers.recommended import recommended
from wideberth.framework.plugins.config import build
from wideberth.framework.tracking.history import History
from wideberth.framework.tracking.names import FASTEST, LEAP
from wideberth.framework.tracking.perception import Perception
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path

DT = 0.1
SHARED = ("", "0", "person")
"""Identities that several obstacles of one message have: unset, a constant, a class."""


def seen(ident: str, *place: float, age: float = 0.0) -> Detection:
    return Detection(ident, place, 1e-4 * np.eye(len(place)), 0.3, age)


def empty(fastest: float = FASTEST) -> History:
    return History(0.5, 10, 3.0, 1.25, fastest)


def newest(history: History) -> dict[str, list[float]]:
    return {name: log.position.tolist() for name, log in history.logs.items()}


@pytest.mark.parametrize("ident", SHARED)
@pytest.mark.parametrize("size", [2, 3])
def test_obstacles_of_one_identity_are_told_apart_by_where_they_are(ident: str, size: int) -> None:
    """Five walkers on lines of their own, in any order, for 3 s."""
    rng = np.random.default_rng(1)
    start, velocity = rng.uniform(-6.0, 6.0, (5, size)), rng.normal(0.0, 0.8, (5, size))
    history = empty()
    for k in range(31):
        places = start + DT * k * velocity
        order = rng.permutation(5)
        history = history.add(DT * k, [seen(ident, *places[i]) for i in order])
    assert len(history.logs) == 5
    logs = sorted(history.logs.values(), key=lambda log: log.position.tolist())
    ends = np.array(sorted(places.tolist()))
    np.testing.assert_array_equal([log.position for log in logs], ends)
    rank = [int(np.argmin(np.abs(places - log.position).sum(axis=1))) for log in logs]
    for log, i in zip(logs, rank, strict=True):
        truth = start[i] + log.times[:, None] * velocity[i]
        np.testing.assert_allclose(log.positions, truth, atol=1e-12)


def test_a_class_name_stays_one_when_a_single_obstacle_is_left() -> None:
    history = empty()
    for k in range(5):
        history = history.add(DT * k, [seen("person", 1.0, 0.0), seen("person", 4.0, 0.0)])
    history = history.add(0.5, [seen("person", 4.0, 0.0)])
    assert len(history.logs) == 2 and history.reported(0.5) == {"#2"}
    assert newest(history)["#2"] == [4.0, 0.0]


def test_a_name_that_a_sender_gave_is_not_given_to_another_obstacle() -> None:
    history = empty().add(0.0, [seen("", 1.0, 0.0), seen("", 4.0, 0.0), seen("#1", 8.0, 0.0)])
    assert sorted(newest(history).values()) == [[1.0, 0.0], [4.0, 0.0], [8.0, 0.0]]


@pytest.mark.parametrize("lag", [0.0, 1e-3, 0.25, 2.0])
@pytest.mark.parametrize("fastest", [FASTEST, 15.0])
def test_the_limit_of_a_motion(lag: float, fastest: float) -> None:
    limit = LEAP + fastest * lag
    for distance, count in ((0.999 * limit, 1), (1.001 * limit, 2)):
        history = empty(fastest).add(0.0, [seen("a", 0.0, 0.0)])
        history = history.add(lag, [seen("a", distance, 0.0)])
        assert len(history.logs) == count and bool(history.notes) == (count == 2)
    moved = seen("a", 1.001 * limit, 0.0)
    again = empty(fastest).add(0.0, [seen("a", 0.0, 0.0)]).add(lag, [moved])
    assert newest(again) == {"a": [0.0, 0.0], "a#2": [1.001 * limit, 0.0]}


def test_a_name_used_for_two_obstacles_in_turn_has_two_histories() -> None:
    """A sender of one message per obstacle, all under the same name."""
    history = empty()
    for k in range(40):
        place = (0.05 * k, 0.0) if k % 2 else (8.0, 0.05 * k)
        history = history.add(0.05 * k, [seen("a", *place)])
    assert {name: len(log.times) for name, log in history.logs.items()} == {"a": 20, "a#2": 20}
    assert newest(history)["a"] == pytest.approx([8.0, 1.9])
    assert newest(history)["a#2"] == pytest.approx([1.95, 0.0])


def test_the_new_owner_keeps_the_name_after_the_former_one_is_forgotten() -> None:
    history = empty().add(0.0, [seen("a", 0.0, 0.0)])
    for k in range(1, 60):
        history = history.add(0.1 * k, [seen("a", 9.0, 0.0)])
    assert set(history.logs) == {"a#2"} and len(history.logs["a#2"].times) == 59


def test_a_correction_of_the_frame_starts_no_new_obstacle() -> None:
    before = [seen("a", 1.0, 0.0), seen("b", 4.0, 2.0), seen("c", -3.0, 1.0)]
    shift = np.array([5.0, -2.0])
    after = [replace(one, position=one.position + shift + 0.1) for one in before]
    history = empty().add(0.0, before).add(DT, after)
    assert set(history.logs) == {"a", "b", "c"} and not history.notes
    # one alone, two that change places, and one of three that stays: these are jumps
    for found in (after[:1], [replace(before[0], position=before[2].position),
                              replace(before[2], position=before[0].position)],
                  [*after[:2], before[2]]):  # fmt: skip
        history = empty().add(0.0, before).add(DT, found)
        assert history.notes and len(history.logs) > 3
        assert {tuple(one.position) for one in found} <= {
            tuple(place) for place in newest(history).values()
        }


def test_velocities_of_controllers_without_a_predictor_are_of_one_obstacle() -> None:
    known = Neighbours()
    for k, place in enumerate([(0.0, 20.0)] * 3 + [(1.8, 0.0)] * 2):
        known.take(Observation(0.25 * k, np.zeros(5), (seen("a", *place),)))
    names, places, velocities, _ = known.now()
    assert names == ("a", "a#2") and not velocities.any()
    assert places.tolist() == [[0.0, 20.0], [1.8, 0.0]]
    known.take(Observation(1.0, np.zeros(5), (seen("a", 2.0, 0.1),)))  # the same stamp again
    assert known.now()[1].tolist() == [[0.0, 20.0], [2.0, 0.1]]


@pytest.mark.parametrize("robot", ["unicycle", "holonomic_velocity"])
def test_the_newest_report_counts_however_close_in_time(robot: str) -> None:
    """Seen far away, then in contact in front of the robot, in two messages of one stamp."""
    for lag in (0.0, 1e-3):
        planner = recommended(robot, speed=0.5, quiet=True)
        planner.set_path(Path([(0, 0), (12, 0)]))
        rest = np.zeros(len(planner.robot.states))
        for k in range(3):
            planner.command(Observation(0.5 * k, rest, (seen("p", 9.0, 3.0),)))
        command = planner.command(Observation(1.0 + lag, rest, (seen("p", 0.9, 0.0),)))
        assert command.linear[0] <= 0.0 and "p#2" in planner.plan.reason
        assert "p" in planner.plan.tracked


def test_measurements_in_any_order_are_those_of_a_history_in_order() -> None:
    rng = np.random.default_rng(3)
    times = 0.07 * np.arange(40) + rng.uniform(0.0, 0.05, 40)
    order = rng.permutation(40)
    last = float(times[-1])

    def added(history: History, index: Sequence[int] | np.ndarray) -> History:
        for i in index:
            history = history.add(last, [seen("a", times[i], 1.0, age=last - times[i])])
        return history

    straight, mixed = (added(empty(), index) for index in (np.arange(40), order))
    np.testing.assert_array_equal(mixed.logs["a"].times, straight.logs["a"].times)
    np.testing.assert_array_equal(mixed.logs["a"].positions, straight.logs["a"].positions)
    assert added(mixed, order).logs["a"].positions.shape == (40, 2)


@pytest.mark.parametrize("predictor", ["kalman", "imm", "var", "adaptive_conformal", "turning"])
def test_a_brief_sighting_between_two_instants_is_forecast(predictor: str) -> None:
    """Seen four times in 0.24 s while another person stays in view, then hidden."""
    perception = Perception.initial(build("predictors", predictor), 2, 0.3125, 80, 0.3125, 3.0)
    far, state = seen("far", 9.0, -20.0), np.zeros(5)
    for stamp in (0.02, 0.1, 0.18, 0.26):
        perception = perception.take(Observation(stamp, state, (far, seen("b", 3.0, stamp))))
    for k in range(1, 9):
        perception = perception.take(Observation(0.3125 * k, state, (far,)))
        tracks = perception.history.tracks()
        assert tracks is not None
        row = tracks.ids.index("b")
        forecast = perception.predictor.predict(tracks, 3)
        deviation = np.sqrt(forecast.covariance[row, 0, 0].diagonal().max())
        # he may walk at 1 m/s: neither is he where he was, nor anywhere
        assert np.abs(forecast.mean[row, 0, 0] - [3.0, 0.3 * k]).max() < 1.5
        assert deviation < 4.0 and "never" not in str(forecast.fallback[row])


@pytest.mark.parametrize("samples", [2, 4])
def test_a_short_history_still_reaches_back_over_the_memory(samples: int) -> None:
    perception = Perception.initial(build("predictors", "kalman"), 2, 0.5, samples, 0.5, 3.0)
    far, state = seen("far", 9.0, -20.0), np.zeros(5)
    perception = perception.take(Observation(0.0, state, (far, seen("b", 3.0, 0.0))))
    for k in range(1, 6):
        perception = perception.take(Observation(0.5 * k, state, (far,)))
        tracks = perception.history.tracks()
        assert tracks is not None and np.isfinite(tracks.positions[0]).any()
