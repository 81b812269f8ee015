"""Histories of any sightings: any rates, late and reordered messages, people who come and go."""

from dataclasses import dataclass, replace
from random import Random

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from wideberth.framework.tracking.history import DENSEST, MOST, History
from wideberth.framework.tracking.perception import FORGET, Perception
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.kalman import Kalman

REPEATABLE = settings(max_examples=150, derandomize=True, deadline=None, database=None)
NOISE = 1e-4 * np.eye(2)
PEOPLE = {
    "a": ((3.0, 0.0), (0.0, 0.0)),
    "b": ((9.0, -20.0), (-1.0, 0.5)),
    "c": ((-2.0, 4.0), (0.3, -1.7)),
}
"""Name -> position at time 0, m, and constant velocity, m/s."""


@dataclass(frozen=True)
class Message:
    """One message of a sensor.

    Attributes
    ----------
    stamp : s, when it arrives.
    ages : name -> s since the measurement, of the people in it.
    """

    stamp: float
    ages: dict[str, float]

    def detections(self) -> tuple[Detection, ...]:
        """Measure the people without an error."""
        return tuple(
            Detection(name, place(name, self.stamp - age), NOISE, 0.3, age)
            for name, age in self.ages.items()
        )


def place(name: str, time: float | Array) -> Array:
    """Where a person is at a time, s, or at times (T,); (2,) or (T, 2), m."""
    start, velocity = PEOPLE[name]
    return np.asarray(start + np.multiply.outer(time, velocity))


def pauses(longest: float) -> st.SearchStrategy[float]:
    """Seconds between two messages: none, a regular tick with jitter, or any up to the longest."""
    ticks = st.sampled_from([0.0, 0.02, 0.1, 0.25, 0.3125, 0.5])
    jitter = st.sampled_from([0.0, 0.0, 0.01, -0.01, 1e-9, 1e-4])
    regular = st.builds(lambda tick, off: max(tick + off, 0.0), ticks, jitter)
    return regular | st.floats(0.0, longest)


AGES = st.sampled_from([0.0, 0.0, 0.0, 0.01, 0.3]) | st.floats(0.0, FORGET + 0.5)


@st.composite
def messages(draw: st.DrawFn, *, backwards: bool) -> list[Message]:
    """Draw what several sensors report, each with its own delay, people, rate and jitter.

    Parameters
    ----------
    backwards : whether messages may arrive with a stamp earlier than that of the one before.
    """
    stamp, found = draw(st.sampled_from([0.0, 37.5, 1.7e9])), []
    for _ in range(draw(st.integers(1, 16))):
        step = draw(pauses(2 * FORGET))
        if backwards and draw(st.integers(0, 4)) == 0:
            step = -draw(st.floats(0.0, 0.5))
        stamp += step
        names = draw(st.lists(st.sampled_from(sorted(PEOPLE)), unique=True, max_size=3))
        common = draw(AGES)
        ages = {name: common if draw(st.booleans()) else draw(AGES) for name in names}
        found.append(Message(stamp, ages))
    return found


@st.composite
def histories(draw: st.DrawFn) -> History:
    """Draw an empty history whose grid reaches back as far as its memory, as a planner's does."""
    dt = draw(st.sampled_from([0.1, 0.2, 0.25, 0.3125, 0.5, 1.0]))
    samples = int(np.ceil(FORGET / dt)) + draw(st.integers(1, 8))
    return History(dt, samples, FORGET, 2.5 * max(dt, draw(st.floats(0.05, 1.0))))


def filled(history: History, received: list[Message]) -> History:
    """Return a history with all messages added in the order of arrival."""
    for message in received:
        history = history.add(message.stamp, message.detections())
    return history


def newest_measurements(received: list[Message]) -> dict[str, float]:
    """Name -> time of the newest admissible measurement, s."""
    newest: dict[str, float] = {}
    for message in received:
        for name, age in message.ages.items():
            if age <= FORGET:
                newest[name] = max(newest.get(name, -np.inf), message.stamp - age)
    return newest


def unsampled(tracks: Tracks) -> list[str]:
    """Names of the tracks without any finite sample: predictors call them never observed."""
    observed = np.any(np.isfinite(tracks.positions).all(axis=2), axis=1)
    return [name for name, known in zip(tracks.ids, observed, strict=True) if not known]


def is_sampled_near(tracks: Tracks, name: str, time: float) -> bool:
    """Whether a track has a sample within a step of a time, s, unless that is before all."""
    clock = tracks.stamp + tracks.dt * np.arange(1.0 - tracks.positions.shape[1], 1.0)
    observed = np.isfinite(tracks.positions[tracks.ids.index(name)]).all(axis=1)
    slack = 1e-6 + np.spacing(abs(tracks.stamp))
    return time < clock[0] or bool((np.abs(clock[observed] - time) <= tracks.dt + slack).any())


def assert_same(first: Tracks | None, second: Tracks | None) -> None:
    """Two tracks are equal to the last bit."""
    if first is None or second is None:
        assert first is second
        return
    assert first.ids == second.ids and first.stamp == second.stamp
    for field in ("positions", "radius", "noise"):
        np.testing.assert_array_equal(getattr(first, field), getattr(second, field))


ALL_SEE_B = {"b": 0.0}
BETWEEN_INSTANTS = [
    Message(0.0, {"a": 0.0, "b": 0.0}),
    *(Message(stamp, ALL_SEE_B) for stamp in (0.51, 1.02, 1.53)),
]
"""One sighting of a, off the grid as soon as b is measured 10 ms late."""
FOUR_BETWEEN = [
    *(Message(stamp, {"a": 0.0, "b": 0.0}) for stamp in (0.02, 0.1, 0.18, 0.26)),
    *(Message(0.3125 * tick, ALL_SEE_B) for tick in (1, 2, 3)),
]
"""Four sightings of a between two instants of a grid of 0.3125 s."""
SEEN_AGAIN = [
    *(Message(0.3125 * tick, {"a": 0.0, "b": 0.0}) for tick in range(4)),
    *(Message(0.3125 * tick, ALL_SEE_B) for tick in range(4, 10)),
    Message(3.0, {"a": 0.0}),
    Message(3.125, ALL_SEE_B),
]
"""A person who is seen off the grid after a gap that is longer than a history bridges."""
SEEN_BETWEEN_GAPS = [
    Message(0.0, {"a": 0.0, "b": 0.0}),
    Message(1.6, {"a": 0.0}),
    Message(3.5, {"a": 0.0, "b": 0.0}),
]
HALF_SECOND = History(0.5, 20, FORGET, 1.25)
PLANNERS = History(0.3125, 20, FORGET, 0.78125)


@REPEATABLE
@given(histories(), messages(backwards=False))
@example(HALF_SECOND, BETWEEN_INSTANTS)
@example(PLANNERS, FOUR_BETWEEN)
def test_a_person_measured_lately_has_a_sample(history: History, received: list[Message]) -> None:
    now, empty = received[-1].stamp, history
    tracks = filled(empty, received).tracks()
    slack = 1e-6 * max(1.0, abs(now) / 1e6)  # of a clock that counts from 1970
    remembered = {
        name for name, time in newest_measurements(received).items() if now - time < FORGET - slack
    }
    assert remembered <= set(() if tracks is None else tracks.ids)
    assert tracks is None or unsampled(tracks) == []


@REPEATABLE
@given(histories(), messages(backwards=False))
@example(PLANNERS, SEEN_AGAIN)
def test_the_newest_measurement_has_a_sample_near(
    history: History, received: list[Message]
) -> None:
    """The newest measurement counts after a gap that is longer than a history bridges."""
    tracks = filled(history, received).tracks()
    for name, time in newest_measurements(received).items():
        if tracks is not None and name in tracks.ids:
            assert is_sampled_near(tracks, name, time)


@REPEATABLE
@given(histories(), messages(backwards=False))
@example(HALF_SECOND, SEEN_BETWEEN_GAPS)
def test_every_measurement_in_order_has_a_sample_near(
    history: History, received: list[Message]
) -> None:
    """As long as a person is remembered, none of the recent measurements is lost."""
    tracks, newest = filled(history, received).tracks(), dict.fromkeys(PEOPLE, -np.inf)
    recent = received[-1].stamp - FORGET + 1e-3
    for message in received:
        for name, age in message.ages.items():
            time = message.stamp - age
            if age <= FORGET and time > newest[name]:
                newest[name] = time
                if time > recent:
                    assert tracks is not None and is_sampled_near(tracks, name, time)


@REPEATABLE
@given(histories(), messages(backwards=True))
def test_no_message_order_leaves_a_track_without_a_sample(
    history: History, received: list[Message]
) -> None:
    """A message of an earlier stamp neither hides a person nor shortens the memory of one."""
    now = received[-1].stamp
    tracks = filled(history, received).tracks()
    longest = max(message.stamp for message in received)
    remembered = {
        name
        for name, time in newest_measurements(received).items()
        if longest - time < FORGET - 1e-3 and now <= longest
    }
    assert remembered <= set(() if tracks is None else tracks.ids)
    assert tracks is None or unsampled(tracks) == []


@REPEATABLE
@given(histories(), messages(backwards=True))
@example(HALF_SECOND, BETWEEN_INSTANTS)
def test_samples_lie_on_a_straight_line_or_are_measured_within_half_a_step(
    history: History, received: list[Message]
) -> None:
    """A sample is interpolated, or it is a measurement at most half a step off its instant."""
    tracks = filled(history, received).tracks()
    if tracks is None:
        return
    clock = tracks.stamp + history.dt * np.arange(1.0 - history.samples, 1.0)
    rounding = 1e-6 + 20 * float(np.spacing(abs(tracks.stamp)))
    for name, positions in zip(tracks.ids, tracks.positions, strict=True):
        measured = [one.stamp - one.ages[name] for one in received if name in one.ages]
        for instant, position in zip(clock, positions, strict=True):
            near = [time for time in measured if abs(time - instant) <= 0.5 * history.dt + 1e-6]
            possible = place(name, np.array([instant, *near]))
            off = np.linalg.norm(position - possible, axis=1)
            assert np.isnan(off).all() or off.min() <= rounding


@REPEATABLE
@given(histories(), messages(backwards=True))
@example(PLANNERS, FOUR_BETWEEN)
def test_sightings_are_the_measurements(history: History, received: list[Message]) -> None:
    """At their own times and places, none twice, and the newest of each person always."""
    tracks = filled(history, received).tracks()
    if tracks is None:
        return
    sightings, newest = tracks.measured, newest_measurements(received)
    assert len(set(sightings.log)) == len(tracks) and (sightings.newest <= tracks.stamp).all()
    for name, times, places in zip(tracks.ids, sightings.times, sightings.positions, strict=True):
        measured = {one.stamp - one.ages[name] for one in received if name in one.ages}
        assert len(times) and set(times.tolist()) <= measured and (np.diff(times) > 0).all()
        np.testing.assert_allclose(places, place(name, times), rtol=1e-12, atol=1e-9)
        assert times[-1] <= newest[name]


@settings(REPEATABLE, max_examples=40)
@given(histories(), messages(backwards=True))
@example(PLANNERS, SEEN_AGAIN)
def test_what_was_filtered_before_changes_no_forecast(
    history: History, received: list[Message]
) -> None:
    """Whatever came late, twice or in any order, and whatever the clock did.

    The history is long enough that no measurement leaves it: a filter that goes on knows more.
    """
    history = replace(history, samples=int(200.0 / history.dt))
    perception = Perception(Kalman(), 2, history, FORGET, history.dt)
    grid = history.dt * np.arange(1.0, 5.0)
    for message in received:
        seen = Observation(message.stamp, np.zeros(3), message.detections())
        perception = perception.take(seen)
        tracks = perception.history.tracks()
        perception = perception.learnt(tracks, Scene())
        if tracks is None:
            continue
        found = perception.forecast(tracks, tracks.stamp, grid, Scene())
        wanted = Kalman().predict(tracks, 4)
        assert found is not None and found.fallback == wanted.fallback
        scale = 1.0 + np.abs(wanted.mean).max()
        np.testing.assert_allclose(found.mean, wanted.mean, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(found.covariance, wanted.covariance, rtol=1e-9, atol=1e-12)


@REPEATABLE
@given(histories(), messages(backwards=False), st.randoms(use_true_random=False))
def test_the_order_within_a_message_does_not_matter(
    history: History, received: list[Message], random: Random
) -> None:
    shuffled = []
    for message in received:
        names = list(message.ages)
        random.shuffle(names)
        shuffled.append(Message(message.stamp, {name: message.ages[name] for name in names}))
    assert_same(filled(history, received).tracks(), filled(history, shuffled).tracks())


@REPEATABLE
@given(histories(), messages(backwards=False), st.floats(0.0, FORGET))
def test_an_empty_message_changes_nothing_but_who_is_forgotten(
    history: History, received: list[Message], pause: float
) -> None:
    before = filled(history, received)
    assert_same(before.tracks(), before.add(received[-1].stamp, ()).tracks())
    later = before.add(received[-1].stamp + pause, ())
    first, second = before.tracks(), later.tracks()
    assert set(() if second is None else second.ids) <= set(() if first is None else first.ids)
    assert all(later.logs[name] is before.logs[name] for name in later.logs)


@REPEATABLE
@given(histories(), st.floats(0.0, 0.6), st.integers(1, 3), st.booleans())
@example(PLANNERS, 0.0, 1, True)
@example(PLANNERS, 1e-10, 1, False)
def test_the_newest_of_equal_stamps_counts(
    history: History, pause: float, repeats: int, common: bool
) -> None:
    """The last report of a person counts, however close in time it follows another one."""
    away = Detection("a", (1.5, 0.4), NOISE, 0.3)
    history = history.add(1.0, (away,)).add(1.0 + pause, (away,))
    for repeat in range(repeats):
        near = Detection("a", (0.9, float(repeat)), NOISE, 0.3)
        other = Detection("b", (5.0, 5.0), NOISE, 0.3)
        history = history.add(1.0 + pause, (near, other) if common else (near,))
    tracks = history.tracks()
    assert tracks is not None
    assert tracks.positions[0, -1].tolist() == [0.9, repeats - 1.0]


@pytest.mark.parametrize("pause", [0.0, 1e-9, 1e-4, 0.01, 0.3])
def test_memory_is_bounded(pause: float) -> None:
    """No rate makes a log grow without bound, and no number of names the list of people."""
    history, stamp = History(0.25, 13, FORGET, 0.625), 0.0
    longest = int(DENSEST * (history.samples + history.gap / history.dt)) + 2
    for tick in range(1500):
        stamp += pause
        fleeting = Detection(str(tick), (1.0, 1.0), NOISE, 0.3)
        late = Detection("late", (1.0, 1.0), NOISE, 0.3, 0.01 * (tick % 3))
        history = history.add(stamp, (Detection("a", (1.0, 0.0), NOISE, 0.3), late, fleeting))
        assert len(history.logs) <= MOST
    assert max(len(log.times) for log in history.logs.values()) <= longest
    tracks = history.tracks()
    assert tracks is not None and tracks.positions.shape == (len(tracks), 13, 2)
