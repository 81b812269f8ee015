"""Trackers on obstacles whose motion is known, and against filters in another form."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from filterpy.kalman import KalmanFilter
from scipy.linalg import expm

from wideberth import Observation, WideberthError
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.tracking.history import History, admitted
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import Scan
from wideberth.predictors.kalman import Kalman
from wideberth.simulation.sensing.perceived import Sightings, TrackedObstacle
from wideberth.tests.helpers.contracts import Contract
from wideberth.tests.oracles.ray_casting import box_corners, scan_of
from wideberth_perception.detection.discs import DiscDetector
from wideberth_perception.detector import Detector
from wideberth_perception.handover import Handover
from wideberth_perception.testing.tracker import check_tracker
from wideberth_perception.tracker import Tracker
from wideberth_perception.tracking import nearest
from wideberth_perception.tracking.kf_hungarian import KfHungarian
from wideberth_perception.tracking.motion import carried, corrected
from wideberth_perception.tracking.nearest import Nearest
from wideberth_perception.tracking.obstacle_tracker import ObstacleTracker
from wideberth_perception.tracking_scores import nees, track_scores

KINDS = {name: load("trackers", name) for name in names("trackers")}
CONTRACT = Contract(KINDS, check_tracker.laws)


@pytest.mark.parametrize(("tracker", "law"), CONTRACT.cases())
def test_contract(tracker: str, law: str) -> None:
    CONTRACT.check(tracker, law)


def test_the_contract_finds_a_tracker_that_takes_what_comes_late() -> None:
    class Careless(Tracker):
        def __init__(self) -> None:
            self.inner = Nearest()

        def reset(self) -> None:
            self.inner.reset()

        def update(self, sightings: Sightings) -> str:
            return self.inner.update(sightings) and ""

        def at(self, time: float) -> tuple[TrackedObstacle, ...]:
            return self.inner.at(time)

    with pytest.raises(AssertionError, match=r"late sightings: .* without a word"):
        check_tracker(Careless())


def sightings(
    time: float,
    places: Sequence[Sequence[float]],
    *,
    deviation: float = 0.01,
    radius: float = 0.3,
    static: Sequence[Sequence[float]] = (),
    origin: Sequence[float] | None = None,
) -> Sightings:
    count = len(places)
    return Sightings(
        *(time, np.reshape(places, (count, 2)), np.tile(deviation**2 * np.eye(2), (count, 1, 1))),
        *(np.full(count, radius), np.reshape(static, (-1, 2))),
        origin=None if origin is None else np.array(origin),
    )


def test_the_filter_equals_its_information_form() -> None:
    """P_+^-1 = P^-1 + H' R^-1 H; the motion by Van Loan's matrix exponential."""
    rng = np.random.default_rng(0)
    state, spread = rng.standard_normal(4), np.diag([0.1, 0.2, 1.0, 2.0])
    mean, information = state.copy(), np.linalg.inv(spread)
    drift, white = np.eye(4, k=2), 0.02 * np.diag([0.0, 0.0, 1.0, 1.0])
    for _ in range(50):
        dt, place = float(rng.uniform(0.01, 0.3)), rng.standard_normal(2)
        root = 0.1 * rng.standard_normal((2, 2))
        noise = root @ root.T + 1e-4 * np.eye(2)
        block = expm(dt * np.block([[-drift, white], [np.zeros((4, 4)), drift.T]]))
        moved = block[4:, 4:].T
        carried_on = moved @ np.linalg.inv(information) @ moved.T + moved @ block[:4, 4:]
        information = np.linalg.inv(carried_on)
        vector = information @ moved @ mean
        information[:2, :2] += np.linalg.inv(noise)
        vector[:2] += np.linalg.solve(noise, place)
        mean = np.linalg.solve(information, vector)
        state, spread = carried(state, spread, dt, 0.02)
        state, spread = corrected(state, spread, place, noise)
        np.testing.assert_allclose(state, mean, rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(spread, np.linalg.inv(information), rtol=1e-7, atol=1e-11)


def test_a_measurement_without_spread_changes_nothing() -> None:
    """filterpy would go on with NaN; a track must be there at the next scan."""
    state, spread = np.array([1.0, 2.0, 0.5, -0.5]), np.diag([0.0, 0.0, 0.2, 0.2])
    for noise in (np.zeros((2, 2)), np.diag([0.01, 0.0]), np.full((2, 2), np.nan)):
        found = corrected(state, spread, np.array([3.0, 4.0]), noise)
        np.testing.assert_array_equal(found[0], state)
        np.testing.assert_array_equal(found[1], spread)


def test_time_backwards_undoes_the_motion_and_adds_noise() -> None:
    state, spread = np.array([1.0, 2.0, 0.5, -0.5]), np.diag([0.1, 0.1, 0.2, 0.2])
    back, wide = carried(*carried(state, spread, 0.3, 0.0), -0.3, 0.0)
    np.testing.assert_allclose(back, state)
    np.testing.assert_allclose(wide, spread, atol=1e-15)
    _, noisy = carried(state, spread, -0.3, 0.02)
    assert np.linalg.eigvalsh(noisy - carried(state, spread, -0.3, 0.0)[1]).min() > -1e-15


def wander(
    rng: np.random.Generator, scans: int, density: float, deviation: float
) -> tuple[list[Sightings], list[Array]]:
    """One body under white acceleration, measured at an instant of its own in each scan."""
    state, time = np.array([0.0, 0.0, 0.5, 0.2]), 0.0
    found, truth = [], []
    for number in range(1, scans + 1):
        for instant in sorted((0.1 * number - rng.uniform(0.0, 0.1), 0.1 * number)):
            moved, process = carried(state, np.zeros((4, 4)), instant - time, density)
            state = moved + np.linalg.cholesky(process + 1e-18 * np.eye(4)) @ rng.normal(size=4)
            time = instant
            if instant < 0.1 * number:
                place = state[:2] + deviation * rng.standard_normal(2)
                one = sightings(0.1 * number, [place], deviation=deviation)
                found.append(replace(one, times=np.array([instant])))
        truth.append(state)
    return found, truth


def test_tracks_are_as_sure_as_they_say() -> None:
    """Four degrees of freedom, NEES 4 on average with variance 8 / n over independent runs."""
    values, runs = [], 60
    for seed in range(runs):
        found, truth = wander(np.random.default_rng(seed), 40, 0.02, 0.02)
        tracker = Nearest(acceleration_density=0.02)
        for one in found:
            assert tracker.update(one) == ""
        (track,) = tracker.at(found[-1].time)
        values.append(nees(truth[-1] - track.state, track.covariance))
    assert abs(np.mean(values) - 4.0) < 3.0 * np.sqrt(8.0 / runs)


def test_a_track_is_confirmed_by_the_third_sighting_in_five_scans() -> None:
    tracker = Nearest()
    for number, seen in enumerate([True, False, True, True], start=1):
        tracker.update(sightings(0.1 * number, [[2.0, 0.0]] if seen else []))
        assert len(tracker.at(0.1 * number)) == (number == 4)
    tracker.reset()
    for number, seen in enumerate([True, False, False, True, True], start=1):
        tracker.update(sightings(0.1 * number, [[2.0, 0.0]] if seen else []))
    assert not tracker.at(0.5)  # two misses in a row ended it; this is another one's second
    tracker.update(sightings(0.6, [[2.0, 0.0]]))
    assert [one.ident for one in tracker.at(0.6)] == ["2"]


def followed(tracker: Tracker, seconds: float = 1.0) -> float:
    """Let a tracker follow one that walks at 0.5 m/s along x from (2, 0)."""
    for number in range(1, round(10 * seconds) + 1):
        tracker.update(sightings(0.1 * number, [[2.0 + 0.05 * number, 0.0]]))
    return 0.1 * round(10 * seconds)


def test_a_confirmed_track_is_kept_for_a_second() -> None:
    tracker = Nearest()
    now = followed(tracker)
    for number in range(1, 14):
        tracker.update(sightings(now + 0.1 * number, []))
        assert len(tracker.at(now + 0.1 * number)) == (number <= 10)


@pytest.mark.parametrize("by", ["wall", "body"])
def test_a_hidden_track_is_kept_for_longer_and_goes_on(by: str) -> None:
    """Somebody walks behind a pillar, or behind somebody else, for 1.7 s."""
    tracker = Nearest()
    now = followed(tracker)
    origin, number = (2.0, -5.0), 0
    hidden: list[list[float]] = []
    for number in range(1, 18):
        x = 2.5 + 0.05 * number  # where it is, and what stands in the line of sight
        place = [2.0 + 0.4 * (x - 2.0), -3.0]
        hidden = [[8.0, 8.0]] if by == "wall" else [[8.0, 8.0], place]
        static = [place] if by == "wall" else []
        tracker.update(sightings(now + 0.1 * number, hidden, static=static, origin=origin))
    now += 1.8
    tracker.update(sightings(now, [[2.5 + 0.05 * 18, 0.0]], origin=origin))
    near = [one for one in tracker.at(now) if abs(one.state[1]) < 1.0]
    assert [one.ident for one in near] == ["1"] and near[0].seen == now
    tracker.update(sightings(now + 1.1, [[8.0, 8.0]], origin=origin))  # nothing before it now
    assert all(abs(one.state[1]) > 1.0 for one in tracker.at(now + 1.1))


def test_after_a_long_gap_nobody_is_taken_for_somebody_else() -> None:
    """The sensor was off for 30 s, or the clock was set: then any sighting would fit any track."""
    tracker = Nearest()
    now = followed(tracker) + 30.0
    for number in range(3):
        assert tracker.update(sightings(now + 0.1 * number, [[9.0, 9.0]])) == ""
    (one,) = tracker.at(now + 0.2)
    assert one.ident != "1" and np.hypot(*one.state[2:]) < 0.1


def test_all_sightings_are_assigned_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The nearest pair taken first would leave the other track without a sighting."""
    monkeypatch.setattr(nearest, "GATE", 1e4)
    tracker = Nearest()
    for number in range(1, 6):
        tracker.update(sightings(0.1 * number, [[0.0, 0.0], [1.0, 0.0]], deviation=0.2))
    tracker.update(sightings(0.6, [[0.55, 0.0], [1.9, 0.0]], deviation=0.2))
    one, two = tracker.at(0.6)
    assert one.state[0] > 0.1 and two.state[0] > 1.1  # 0.55 is nearer to the second one


def test_a_sure_track_is_preferred_to_a_vague_one() -> None:
    """ln det S: at the same d^2 the sighting is likelier to be of the surer track."""
    tracker = Nearest(acceleration_density=0.02)
    for number in range(1, 21):
        tracker.update(sightings(0.1 * number, [[0.0, 0.0]]))
    tracker.update(sightings(2.1, [[0.0, 0.0], [0.5, 0.0]], deviation=0.3))  # a vague one is born
    (sure,) = tracker.at(2.1)
    seen = sightings(2.2, [[0.1, 0.0]], deviation=0.05)
    costs = [tracker._costs(track, seen)[0] for track in tracker._tracks]
    total = [
        carried(track.state, track.covariance, 2.2 - track.time, 0.02)[1][:2, :2]
        + seen.covariance[0]
        for track in tracker._tracks
    ]
    for track, cost, spread in zip(tracker._tracks, costs, total, strict=True):
        gap = seen.positions[0] - track.state[:2] - (2.2 - track.time) * track.state[2:]
        wanted = gap @ np.linalg.solve(spread, gap) + np.log(np.linalg.det(spread))
        np.testing.assert_allclose(cost, wanted, rtol=1e-9)
    tracker.update(seen)
    assert tracker.at(2.2)[0].seen == 2.2 and tracker.at(2.2)[0].ident == sure.ident


def test_the_radius_is_averaged() -> None:
    tracker, rng = Nearest(), np.random.default_rng(1)
    radii = 0.3 + 0.05 * rng.standard_normal(15)
    for number, radius in enumerate(radii, start=1):
        tracker.update(sightings(0.1 * number, [[2.0, 0.0]], radius=radius))
    assert tracker.at(1.5)[0].radius == pytest.approx(radii.mean())


def test_measurements_are_handed_on_as_of_the_instant_of_their_scan() -> None:
    """Two that move alike but were met at other instants of each scan have one age."""
    tracker = Nearest(acceleration_density=0.02)
    for number in range(1, 21):
        scan = 0.1 * number
        times = scan - np.array([0.02, 0.08])
        places = np.stack([0.5 * times, [0.0, 3.0]], axis=-1)
        tracker.update(replace(sightings(scan, places), times=times))
    two, one = tracker.at(2.03)  # what was met first in the first scan was born first
    np.testing.assert_array_equal(one.times, two.times)
    np.testing.assert_allclose(one.measured[-5:, 0], 0.5 * one.times[-5:], atol=2e-3)
    np.testing.assert_allclose(two.measured[-5:, 0], 0.5 * one.times[-5:], atol=2e-3)
    drift = two.covariance[2:, 2:] - 0.02 * 0.11 * np.eye(2)  # as of its last sighting
    np.testing.assert_allclose(two.noise[-1], 1e-4 * np.eye(2) + 0.08**2 * drift)
    # The buffer of before the confirmation is brought there with the velocity known then.
    assert np.abs(two.measured[:3, 0] - 0.5 * two.times[:3]).max() < 0.04
    assert one.state[2] == pytest.approx(0.5, abs=0.01)


def test_history_is_bounded() -> None:
    tracker = Nearest()
    followed(tracker, 12.0)
    (one,) = tracker.at(12.0)
    assert len(one.times) == 101 and one.times[0] == pytest.approx(2.0)


def drive(
    detector: Detector, tracker: Nearest, half: tuple[float, float] | None, seed: int
) -> Array:
    """NEES of the track of a robot that passes at 0.5 m/s, one value per run, and its errors."""
    rng = np.random.default_rng(seed)
    start, speed = np.array([6.0, rng.uniform(-3.0, 3.0)]), 0.5
    turn = rng.uniform(-np.pi, np.pi)
    velocity = speed * np.array([np.cos(turn), np.sin(turn)])
    time = 0.0
    for number in range(30):
        times = 0.1 * (number + np.arange(1, 361) / 360)
        poses = np.stack([0.3 * times, 0 * times, 0.2 * times], axis=-1)
        places, time = start + times[:, None] * velocity, float(times[-1])
        if half is None:
            scan = scan_of(poses, rng, [(places, 0.75)], end=time, dropped=0.01)
        else:
            scan = scan_of(poses, rng, [], [box_corners(places[180], half, turn)], end=time)
            scan = replace(scan, times=np.full(360, times[180]))  # a box that stands in a scan
        tracker.update(detector.detect(scan, poses))
    (track,) = tracker.at(time)
    truth = np.concatenate([start + velocity * time, velocity])
    return np.append(truth - track.state, nees(truth - track.state, track.covariance))


def test_from_ranges_to_tracks() -> None:
    """Open floor, a cylinder of 0.75 m at 4 to 8 m: millimetres, and no more sure than it is."""
    found = np.array(
        [
            drive(DiscDetector((0.75,)), Nearest(acceleration_density=0.02), None, seed)
            for seed in range(25)
        ]
    )
    assert np.sqrt((found[:, :2] ** 2).sum(axis=1).mean()) < 0.012
    assert np.sqrt((found[:, 2:4] ** 2).sum(axis=1).mean()) < 0.05
    assert 0.1 < found[:, 4].mean() < 5.0


def broken(scan: Scan, kind: str) -> Scan:
    """A scan as a sensor that fails gives it."""
    half = np.arange(len(scan.ranges)) < 180
    return {
        "empty": Scan("lidar", np.zeros(0), np.zeros(0), np.zeros(0)),
        "blind": replace(scan, ranges=np.full(len(scan.ranges), np.inf)),
        "lost": replace(scan, ranges=np.full(len(scan.ranges), np.nan)),
        "negative": replace(scan, ranges=-scan.ranges),
        "half lost": replace(scan, ranges=np.where(half, np.nan, scan.ranges)),
        "late": replace(scan, times=scan.times - 0.3),
        "twice": scan,
        "clock back": replace(scan, times=scan.times - 500.0),
        "clock on": replace(scan, times=scan.times + 500.0),
    }[kind]


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(
    ("kind", "lives"),
    [("empty", True), ("blind", True), ("lost", True), ("negative", True), ("half lost", True),
     ("late", True), ("twice", True), ("clock back", False), ("clock on", False)],
)  # fmt: skip
def test_a_bad_scan_neither_raises_nor_ends_what_it_should_not(
    name: str, kind: str, lives: bool
) -> None:
    """One bad scan after 2 s; then ten sound ones on the clock that the bad one had."""
    rng, tracker, detector = np.random.default_rng(8), KINDS[name](), DiscDetector((0.3,))
    poses, notes = np.zeros((360, 3)), []
    shift = {"clock back": -500.0, "clock on": 500.0}.get(kind, 0.0)
    idents: list[set[str]] = []
    for number in range(1, 32):
        time = 0.1 * number
        places = np.stack([np.full(360, 3.0), np.full(360, -1.0 + 0.5 * time)], axis=-1)
        scan = scan_of(poses, rng, [(places, 0.3)], end=time)
        if number == 21:
            bad = broken(scan, kind)
            if kind == "twice":
                tracker.update(detector.detect(bad, poses))
            seen = detector.detect(bad, np.zeros((len(bad.times), 3)))
        else:
            later = shift if number > 21 else 0.0
            seen = detector.detect(replace(scan, times=scan.times + later), poses)
        notes.append((seen.note, tracker.update(seen)))
        now = seen.time if np.isfinite(seen.time) else time
        idents.append({one.ident for one in tracker.at(now)})
    assert len(idents[19]) == 1 and len(idents[-1]) == 1
    counts_scans = name == "kf_hungarian" and kind == "clock on"  # and no seconds, as published
    assert (idents[19] == idents[-1]) == (lives or counts_scans)
    assert all(note == ("", "") for note in (*notes[:20], *notes[21:]))
    said = any(notes[20])
    assert said == (kind not in ("half lost", "clock on"))


def test_the_error_of_a_box_lasts() -> None:
    """A box keeps its heading, so its error does not average away; the detector says so."""
    half = (0.6, 0.45)

    class Forgetful(Detector):
        """Leaves out what lasts."""

        def reset(self) -> None: ...

        def detect(self, scan: Scan, poses: Array) -> Sightings:
            return replace(DiscDetector(half).detect(scan, poses), lasting=0.0)

    plain = np.array([drive(Forgetful(), Nearest(0.02), half, seed)[4] for seed in range(20)])
    aware = np.array(
        [drive(DiscDetector(half), Nearest(0.02), half, seed)[4] for seed in range(20)]
    )
    assert aware.mean() < 0.6 * plain.mean() and 1.0 < aware.mean() < 4.0
    assert DiscDetector((0.3,)).detect(scan_of(np.zeros((4, 3)), np.random.default_rng(0), []),
                                np.zeros((4, 3))).lasting == 0.0  # fmt: skip


def test_what_is_handed_on() -> None:
    tracker, handover = Nearest(), Handover("measured")
    for number in range(1, 4):
        tracker.update(sightings(0.1 * number, [[0.05 * number, 0.0], [0.05 * number, 4.0]]))
    handover, earlier, present = handover.detections(tracker.at(0.35), 0.35)
    assert [len(batch) for batch in earlier] == [2, 2]
    assert [batch[0].age for batch in earlier] == pytest.approx([0.25, 0.15])
    assert [one.age for one in present] == pytest.approx([0.05, 0.05])
    assert all(one.velocity is None for one in present)
    tracker.update(sightings(0.4, [[0.2, 0.0]]))
    handover, earlier, present = handover.detections(tracker.at(0.42), 0.42)
    assert not earlier and [one.age for one in present] == pytest.approx([0.02, 0.12])
    # What is handed on reaches a planner's history, all of it.
    history = History(0.1, 10, 5.0, 1.0)
    handover, earlier, present = Handover("measured").detections(tracker.at(0.42), 0.42)
    for batch in (*earlier, present):
        kept, refused, _ = admitted(Observation(0.42, np.zeros(3), batch), 2, 5.0, None)
        assert not refused
        history = history.add(0.42, kept)
    tracks = history.tracks()
    assert tracks is not None and np.isfinite(tracks.positions[0, -4:]).all()


def test_filtered_states_are_handed_on_with_their_covariance() -> None:
    tracker = Nearest()
    followed(tracker, 2.0)
    (one,) = tracker.at(2.04)
    _, earlier, (given,) = Handover("filtered").detections((one,), 2.04)
    assert not earlier and given.age == 0.0 and not given.flaw
    np.testing.assert_array_equal(given.position, one.state[:2])
    np.testing.assert_array_equal(given.velocity, one.state[2:])
    np.testing.assert_array_equal(given.state_covariance, one.covariance)
    tracks = History(0.5, 10, 5.0, 1.0).add(2.04, (given,)).tracks()
    assert tracks is not None
    forecast = Kalman().predict(tracks, 2)
    np.testing.assert_allclose(forecast.mean[0, 0, 1], one.state[:2] + 1.0 * one.state[2:])
    with pytest.raises(WideberthError, match=r"handover\.kind is 'raw'; wanted one of measured"):
        Handover("raw")  # type: ignore[arg-type]


def test_a_published_tracker_hands_on_its_state() -> None:
    tracker = KfHungarian()
    followed(tracker, 2.0)
    _, earlier, present = Handover("measured").detections(tracker.at(2.0), 2.0)
    assert not earlier and len(present) == 1 and present[0].velocity is not None


def test_kf_hungarian_forgets_whoever_stands() -> None:
    tracker = KfHungarian()
    now = followed(tracker, 3.0)
    (one,) = tracker.at(now)
    assert one.state[2] == pytest.approx(0.5, abs=0.05)
    for number in range(1, 60):
        tracker.update(sightings(now + 0.1 * number, [[3.5, 0.0]]))
    assert not tracker.at(now + 6.0)
    ours = Nearest()
    followed(ours, 3.0)
    for number in range(1, 60):
        ours.update(sightings(now + 0.1 * number, [[3.5, 0.0]]))
    assert len(ours.at(now + 5.9)) == 1


@pytest.mark.parametrize("gap", [1e6, 1e9, 1e11])
def test_kf_hungarian_carries_nobody_over_ages(gap: float) -> None:
    """Found by `make fuzz`: the covariance had negative eigenvalues, and `at` raised."""
    tracker = KfHungarian()
    now = followed(tracker, 3.0)
    for number in range(4):
        place = [3.5 + 0.05 * number, 0.01 * number]
        tracker.update(sightings(now + gap + 0.1 * number, [place]))
        for one in tracker.at(now + gap + 0.1 * number):
            assert one.covariance.max() < 100.0


def test_kf_hungarian_equals_its_filter() -> None:
    other = KalmanFilter(dim_x=4, dim_z=2)
    other.x, other.P = np.array([2.05, 0.0, 0.0, 0.0]), np.diag([1.0, 1.0, 10.0, 10.0])
    other.H, other.R = np.eye(2, 4), np.eye(2)
    tracker = KfHungarian()
    tracker.update(sightings(0.1, [[2.05, 0.0]]))
    axis = Q_discrete_white_noise(2, dt=0.1, var=2.0)
    for number in range(2, 30):
        tracker.update(sightings(0.1 * number, [[2.0 + 0.05 * number, 0.0]]))
        other.predict(F=np.eye(4) + 0.1 * np.eye(4, k=2), Q=np.kron(axis, np.eye(2)))
        other.update(np.array([2.0 + 0.05 * number, 0.0]))
    (one,) = tracker.at(2.9)
    np.testing.assert_allclose(one.state, other.x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.covariance, other.P, rtol=1e-9, atol=1e-12)


def test_obstacle_tracker_loses_whoever_is_fast_and_fades_after_two_seconds() -> None:
    tracker = ObstacleTracker()
    now = followed(tracker, 3.0)
    (one,) = tracker.at(now)
    assert one.state[2] == pytest.approx(0.5, abs=0.2)  # the filter lags behind
    for number in range(1, 24):
        tracker.update(sightings(now + 0.1 * number, []))
    assert not tracker.at(now + 2.3) and len(tracker.at(now + 1.9)) == 0
    tracker.reset()
    for number in range(1, 11):  # 0.4 m a scan is beyond the gate
        tracker.update(sightings(0.1 * number, [[0.4 * number, 0.0]]))
    assert not tracker.at(1.0)


def test_obstacle_tracker_fuses_and_splits_under_new_identities() -> None:
    tracker = ObstacleTracker()
    for number in range(1, 11):
        tracker.update(sightings(0.1 * number, [[0.0, 0.0], [0.4, 0.0]]))
    before = {one.ident for one in tracker.at(1.0)}
    tracker.update(sightings(1.1, [[0.2, 0.0]]))
    fused = {one.ident for one in tracker.at(1.1)}
    assert len(before) == 2 and len(fused) == 1 and not before & fused
    tracker.update(sightings(1.2, [[0.1, 0.0], [0.3, 0.0]]))
    split = {one.ident for one in tracker.at(1.2)}
    assert len(split) == 2 and not split & fused
    tracker.update(sightings(1.3, [[5.0, 0.0]]))
    assert len(tracker.at(1.3)) == 2  # one sighting alone makes none


def test_obstacle_tracker_equals_its_loop() -> None:
    """One axis by hand: 100 steps a second, each corrected by the last measurement."""
    tracker = ObstacleTracker()
    tracker.update(sightings(0.1, [[2.0, 0.0]]))
    tracker.update(sightings(0.2, [[2.05, 0.0]]))
    state, spread, guess = np.array([2.0, 0.0]), np.eye(2), np.array([2.0, 0.0])
    moved, noise = np.array([[1.0, 0.01], [0.0, 1.0]]), np.diag([0.01, 0.1])

    def correct(place: float) -> None:
        nonlocal state, spread
        gain = spread[:, 0] / (spread[0, 0] + 1.0)
        state = guess + gain * (place - guess[0])
        spread = (np.eye(2) - np.outer(gain, [1.0, 0.0])) @ spread

    def loop() -> None:
        nonlocal guess, spread
        for _ in range(10):
            guess, spread = moved @ state, moved @ spread @ moved.T + noise
            correct(2.05)

    correct(2.05)
    loop()  # it is born a tenth of a second old
    for number in (3, 4):
        tracker.update(sightings(0.1 * number, [[2.05, 0.0]]))
        loop()
        correct(2.05)
    (one,) = tracker.at(0.4)
    assert one.state[[0, 2]] == pytest.approx(state)
    np.testing.assert_allclose(one.covariance[::2, ::2], spread, rtol=1e-12)


def test_two_who_cross_keep_their_identities() -> None:
    """They pass 0.5 m apart; ours and the published ones on the same sightings."""
    rng = np.random.default_rng(3)
    switches = {}
    for name, kind in KINDS.items():
        tracker, run = kind(), []
        for number in range(1, 81):
            time = 0.1 * number
            truth = {
                "a": np.array([-4.0 + time, 0.0, 1.0, 0.0]),
                "b": np.array([4.0 - time, 0.5, -1.0, 0.0]),
            }
            places = [state[:2] + 0.01 * rng.standard_normal(2) for state in truth.values()]
            tracker.update(sightings(time, places))
            run.append((time, truth, tracker.at(time)))
        switches[name] = track_scores(run).switches
    assert switches["nearest"] == 0


def test_bad_settings_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"nearest\.window is 2; wanted a whole number of at"):
        Nearest(window=2)
    with pytest.raises(WideberthError, match=r"obstacle_tracker\.rate is 0"):
        ObstacleTracker(rate=0.0)
    with pytest.raises(WideberthError, match=r"time is nan; wanted the instant"):
        Nearest().at(np.nan)
