"""Detectors against rays on discs and boxes whose place is known."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth import Polygon, WideberthError
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Sightings
from wideberth.tests.helpers.contracts import Contract
from wideberth.tests.oracles.ray_casting import box_corners, cast, scan_of
from wideberth_perception.detection import discs
from wideberth_perception.detection.chords import Chords
from wideberth_perception.detection.disc_fit import box, cylinder, fit_disc
from wideberth_perception.detection.discs import DiscDetector
from wideberth_perception.detection.groups import at_notches, by_gap
from wideberth_perception.detection.hits import hits_of
from wideberth_perception.detection.outside_map import OutsideMap
from wideberth_perception.detection.over_time import OverTime
from wideberth_perception.detector import Detector
from wideberth_perception.testing.detector import check_detector

LARGE, SMALL = (0.60, 0.45), (0.25, 0.215)
CONTRACT = Contract.of(
    [load("detectors", name)() for name in names("detectors")], check_detector.laws
)
STANDING = np.zeros((360, 3))


@pytest.mark.parametrize(("detector", "law"), CONTRACT.cases())
def test_contract(detector: str, law: str) -> None:
    CONTRACT.check(detector, law)


def test_the_contract_finds_a_detector_that_does_not_turn() -> None:
    class Stiff(Detector):
        def reset(self) -> None: ...

        def detect(self, scan: Scan, poses: Array) -> Sightings:
            found = DiscDetector().detect(scan, poses)
            return replace(found, positions=np.round(found.positions, 1))

    with pytest.raises(AssertionError, match="turning and shifting: turned and shifted by"):
        check_detector(Stiff())


def away(distance: float, bearing: float) -> Array:
    return distance * np.array([np.cos(bearing), np.sin(bearing)])


def errors(
    detector: Detector,
    distance: float,
    bodies: int,
    seed: int,
    half: tuple[float, float] | float,
    beams: int = 360,
    dropped: float = 0.0,
) -> tuple[Array, Array]:
    """Errors along and across the line of sight, (n, 2), m, and NEES, (n,), of those found."""
    rng, poses = np.random.default_rng(seed), np.zeros((beams, 3))
    found, squares = [], []
    for bearing in rng.uniform(-np.pi, np.pi, bodies):
        centre = away(distance, bearing)
        if isinstance(half, float):
            scan = scan_of(poses, rng, [(centre, half)], dropped=dropped)
        else:
            corners = box_corners(centre, half, rng.uniform(-np.pi, np.pi))
            scan = scan_of(poses, rng, [], [corners], dropped=dropped)
        seen = detector.detect(scan, poses)
        if not len(seen.positions):
            continue
        assert dropped or len(seen.positions) == 1
        row = int(np.linalg.norm(seen.positions - centre, axis=1).argmin())
        error = seen.positions[row] - centre
        found.append([error @ away(1, bearing), error @ away(1, bearing + np.pi / 2)])
        squares.append(error @ np.linalg.solve(seen.covariance[row], error))
    return np.array(found), np.array(squares)


def exact_poses(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the poses within a scan not err."""
    monkeypatch.setattr(discs, "DRIFT", 0.0)
    monkeypatch.setattr(discs, "TURN", 0.0)


@pytest.mark.parametrize("radius", [0.3, 0.75])
@pytest.mark.parametrize("distance", [3.0, 8.0])
def test_cylinders_are_found_without_bias_and_as_sure_as_stated(
    radius: float, distance: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two degrees of freedom: NEES is 2 on average, with variance 4 / n."""
    exact_poses(monkeypatch)
    found, squares = errors(DiscDetector((radius,)), distance, 150, 1, radius)
    assert len(found) == 150
    assert np.abs(found.mean(axis=0)).max() < 1e-3
    assert abs(squares.mean() - 2.0) < 3.0 * 2.0 / np.sqrt(len(squares))
    assert found.std(axis=0).max() < 0.01


def test_poses_that_err_within_a_scan_widen_the_covariance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """1 mm in all directions, and 0.5 mrad of the distance across the line of sight."""
    scan = scan_of(STANDING, np.random.default_rng(2), [([0.0, 10.0], 0.75)])
    more = DiscDetector((0.75,)).detect(scan, STANDING).covariance[0]
    exact_poses(monkeypatch)
    more = more - DiscDetector((0.75,)).detect(scan, STANDING).covariance[0]
    np.testing.assert_allclose(more, np.diag([1e-6 + 0.005**2, 1e-6]), atol=1e-7)


@pytest.mark.parametrize("beams", [180, 360, 720])
@pytest.mark.parametrize("half", [0.3, 0.75, SMALL, LARGE])
def test_detections_are_as_sure_as_they_say(half: tuple[float, float] | float, beams: int) -> None:
    """Mean NEES between 0.7 and 3 (2 is exact), at all distances where bodies are seen."""
    for distance in (1.5, 4.0, 8.0, 12.0):
        detector = DiscDetector((half,) if isinstance(half, float) else half)
        _, squares = errors(detector, distance, 60, 15, half, beams, dropped=0.01)
        if len(squares) < 40:  # too few beams meet it
            assert distance * 2.0 * np.pi / beams > 0.2
            continue
        assert 0.7 < squares.mean() < 3.0, (distance, squares.mean())
        assert (squares < 5.991).mean() > 0.85, distance


@pytest.mark.parametrize(
    ("half", "bias", "deviation"),
    [(LARGE, 0.175, (0.042, 0.085)), (SMALL, 0.078, (0.013, 0.032))],
)
def test_a_box_taken_for_its_disc_is_found_too_far_away(
    half: tuple[float, float], bias: float, deviation: tuple[float, float]
) -> None:
    """The bias table of the specification at 5 and 8 m."""
    radius = float(np.hypot(*half))
    for distance in (5.0, 8.0):
        found, squares = errors(DiscDetector((radius,)), distance, 150, 3, half)
        assert abs(found[:, 0].mean() - bias) < 0.012
        np.testing.assert_allclose(found.std(axis=0), deviation, rtol=0.25)
        assert squares.mean() > 8.0  # what the fit alone states is far too sure


@pytest.mark.parametrize("half", [LARGE, SMALL])
@pytest.mark.parametrize("distance", [3.0, 8.0])
def test_a_box_taken_for_a_box_is_found_where_it_is(
    half: tuple[float, float], distance: float
) -> None:
    found, squares = errors(DiscDetector(half), distance, 150, 4, half)
    assert np.abs(found.mean(axis=0)).max() < 0.01
    assert 0.7 < squares.mean() < 2.5


def test_the_shape_of_a_box_follows_from_its_sides() -> None:
    shape = box(*LARGE)
    assert shape.rough == pytest.approx(0.073, abs=0.005)
    assert shape.radius == pytest.approx(0.75) and shape.fitted == pytest.approx(0.595, abs=0.005)
    np.testing.assert_allclose([shape.along, shape.across], [0.038, 0.051], atol=0.004)
    thin = box(0.4, 0.4)  # a square errs least: its corners are its only fault
    assert thin.along < shape.along
    spread = shape.spread(np.array([0.0, 3.0]))
    np.testing.assert_allclose(spread, np.diag([shape.across**2, shape.along**2]), atol=1e-12)
    assert cylinder(0.3).spread(np.array([1.0, 1.0])).max() == 0.0


def test_exact_points_give_the_exact_centre() -> None:
    angle = np.linspace(2.0, 4.0, 9)
    centre = np.array([5.0, 1.0])
    points = centre + 0.4 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    fit = fit_disc(points, np.zeros((9, 2)), 0.4, 0.01)
    np.testing.assert_allclose(fit.centre, centre, atol=1e-5)
    wide = fit_disc(points + 0.05 * (-1.0) ** np.arange(9)[:, None], np.zeros((9, 2)), 0.4, 0.01)
    assert np.trace(wide.covariance) > 5.0 * np.trace(fit.covariance)  # residuals widen it


def turning(rate: float, speed: float = 0.0) -> Array:
    """Poses of a robot that turns while it scans."""
    times = 0.1 * np.arange(360) / 360
    return np.stack([speed * times, 0 * times, rate * times], axis=-1)


def test_the_motion_within_a_scan_is_taken_out() -> None:
    """A robot turning at 0.3 rad/s before a standing cylinder sees it within 1 cm."""
    rng = np.random.default_rng(5)
    poses = turning(0.3, 0.5)
    centre = away(12.0, 2.9)  # near the end of the scan, where 0.1 s at 0.3 rad/s are 0.36 m
    scan = scan_of(poses, rng, [(centre, 0.75)], deviation=0.003)
    still = np.broadcast_to(poses[-1], poses.shape)
    error = DiscDetector((0.75,)).detect(scan, poses).positions[0] - centre
    assert np.hypot(*error) < 0.01
    early = scan_of(poses, rng, [(away(12.0, -2.6), 0.75)], deviation=0.003)
    smeared = DiscDetector((0.75,)).detect(early, still).positions[0] - away(12.0, -2.6)
    assert np.hypot(*smeared) > 0.2


def test_a_mounted_sensor_sees_the_same() -> None:
    """Ranges from 0.2 m ahead, turned by 1 rad, give the same place."""
    rng = np.random.default_rng(6)
    poses = np.tile([1.0, -2.0, 0.7], (360, 1))
    mount = np.array([0.2, 0.1, 1.0])
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    sensor = np.concatenate([poses[0, :2] + turn @ mount[:2], [1.7]])
    centre = np.array([4.0, 1.0])
    scan = replace(
        scan_of(np.tile(sensor, (360, 1)), rng, [(centre, 0.3)], deviation=0.002), mount=mount
    )
    seen = DiscDetector().detect(scan, poses)
    np.testing.assert_allclose(seen.positions, [centre], atol=0.005)
    assert seen.origin is not None
    np.testing.assert_allclose(seen.origin, sensor[:2])


def test_groups_split_at_gaps_that_grow_with_the_range() -> None:
    """Two cylinders 0.2 m apart are two at 3 m; one body at 13 m stays one."""
    rng = np.random.default_rng(7)
    near = scan_of(STANDING, rng, [([3.0, 0.4], 0.3), ([3.0, -0.4], 0.3)])
    assert len(DiscDetector().detect(near, STANDING).positions) == 2
    far = scan_of(STANDING, rng, [([13.0, 0.0], 0.75)])
    assert len(DiscDetector((0.75,)).detect(far, STANDING).positions) == 1
    hits, _ = hits_of(far, STANDING)
    assert len(by_gap(hits, 0.1, 0.00628)) > 1  # the published growth is another scanner's


def test_a_body_on_the_seam_of_the_scan_is_one() -> None:
    rng = np.random.default_rng(8)
    scan = scan_of(STANDING, rng, [([-4.0, 0.0], 0.3)])
    seen = DiscDetector().detect(scan, STANDING)
    assert len(seen.positions) == 1
    np.testing.assert_allclose(seen.positions[0], [-4.0, 0.0], atol=0.02)
    half = slice(60, 300)  # a scan that is no full turn has no seam
    part = Scan("lidar", scan.times[half], scan.bearings[half], scan.ranges[half])
    assert not len(DiscDetector().detect(part, STANDING[half]).positions)


def test_lost_beams_split_no_body_until_three_in_a_row() -> None:
    rng = np.random.default_rng(9)
    scan = scan_of(STANDING, rng, [([3.0, 0.0], 0.75)])
    for lost, count in ((slice(179, 181), 1), (slice(179, 182), 2)):
        ranges = scan.ranges.copy()
        ranges[lost] = np.nan
        assert len(by_gap(hits_of(replace(scan, ranges=ranges), STANDING)[0], 0.1)) == count


def test_two_who_touch_are_split_at_the_notch_between_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(discs, "GAP", 0.4)
    rng = np.random.default_rng(20)
    for bearing in np.linspace(-3.0, 3.0, 12):
        aside = 0.32 * away(1.0, bearing + np.pi / 2)
        both = [away(4.0, bearing) + aside, away(4.0, bearing) - aside]
        scan = scan_of(STANDING, rng, [(place, 0.3) for place in both])
        hits, _ = hits_of(scan, STANDING)
        (group,) = by_gap(hits, 0.4)
        assert [len(part) for part in at_notches(hits, group, 0.05)] == pytest.approx(
            [len(group) / 2] * 2, abs=1.5
        )
        seen = DiscDetector().detect(scan, STANDING)
        order = np.argsort((seen.positions - away(4.0, bearing)) @ -aside)
        np.testing.assert_allclose(seen.positions[order], both, atol=0.06)


def test_one_convex_body_has_no_notch() -> None:
    rng = np.random.default_rng(21)
    for bearing in rng.uniform(-np.pi, np.pi, 60):
        corners = box_corners(away(3.0, bearing), LARGE, rng.uniform(-np.pi, np.pi))
        hits, _ = hits_of(scan_of(STANDING, rng, [], [corners]), STANDING)
        (group,) = by_gap(hits, 1.5)  # sides along the line of sight have wide gaps
        assert len(at_notches(hits, group, 0.05)) == 1


def test_noise_on_many_points_is_no_notch() -> None:
    """Three hundred points of one cylinder: the innermost lies 7 deviations behind the hull."""
    rng, poses = np.random.default_rng(23), np.zeros((720, 3))
    for bearing in rng.uniform(-np.pi, np.pi, 60):
        scan = scan_of(poses, rng, [(away(1.5, bearing), 0.75)])
        assert len(DiscDetector((0.75,)).detect(scan, poses).positions) == 1


def test_lost_beams_on_a_slanting_side_split_no_box() -> None:
    """Points there are far apart; with two beams lost between, three times as far."""
    corners = box_corners(np.array([8.0, 0.0]), LARGE, np.pi / 4)
    scan = scan_of(STANDING, np.random.default_rng(24), [], [corners], deviation=0.001)
    ranges = scan.ranges.copy()
    ranges[181:183] = np.nan
    hits, _ = hits_of(replace(scan, ranges=ranges), STANDING)
    assert len(by_gap(hits, 0.1)) == 1
    ranges[181:183] = np.inf  # they passed through
    assert len(by_gap(hits_of(replace(scan, ranges=ranges), STANDING)[0], 0.1)) == 2


def test_a_lost_beam_splits_no_wall_wherever_it_is() -> None:
    """A wall along the robot's way: far ahead its points are farther and farther apart."""
    wall = box_corners(np.array([4.0, 2.2]), np.array([12.0, 0.4]), 0.0)
    scan = scan_of(STANDING, np.random.default_rng(25), [], [wall], deviation=0.001)
    hits, _ = hits_of(scan, STANDING)
    whole = max(by_gap(hits, 0.1), key=len)
    assert len(whole) > 50
    for lost in hits.ranges[whole[1:-1]]:
        ranges = np.where(scan.ranges == lost, np.nan, scan.ranges)
        found = by_gap(hits_of(replace(scan, ranges=ranges), STANDING)[0], 0.1)
        assert max(map(len, found)) == len(whole) - 1


def test_lost_beams_are_counted_over_the_seam() -> None:
    ranges = np.full(360, 5.0)
    ranges[[0, 1, 359, 100]] = np.nan
    ranges[[50, 200]] = np.inf
    bearings = -np.pi + 2.0 * np.pi * np.arange(360) / 360
    hits, _ = hits_of(Scan("lidar", np.linspace(0.0, 0.1, 360), bearings, ranges), STANDING)
    assert hits.lost.sum() == 4 and sorted(hits.lost[hits.lost > 0]) == [1, 3]
    first = int(hits.lost.argmax())
    assert np.arctan2(*hits.points[first, ::-1]) == pytest.approx(bearings[2])


def test_a_misfit_is_no_small_error() -> None:
    """Two who overlap, taken for one: the covariance reaches as far as the error."""
    rng, squares = np.random.default_rng(22), []
    for bearing in rng.uniform(-np.pi, np.pi, 60):
        aside = 0.2 * away(1.0, bearing + np.pi / 2)
        scan = scan_of(STANDING, rng, [(away(4.0, bearing) + k * aside, 0.3) for k in (-1, 1)])
        seen = DiscDetector().detect(scan, STANDING)
        for place, spread in zip(seen.positions, seen.covariance, strict=True):
            error = min(
                (place - away(4.0, bearing) - k * aside for k in (-1, 1)), key=np.linalg.norm
            )
            squares.append(error @ np.linalg.solve(spread, error))
    assert np.percentile(squares, 90) < 13.8


def test_wide_groups_stand_still() -> None:
    rng = np.random.default_rng(10)
    wall = np.array([[4.0, -3.0], [4.2, -3.0], [4.2, 3.0], [4.0, 3.0]])
    scan = scan_of(STANDING, rng, [([2.0, 2.8], 0.3)], [wall])
    seen = DiscDetector().detect(scan, STANDING)
    assert len(seen.positions) == 1 and len(seen.static) > 30
    assert np.abs(seen.static[:, 0] - 4.0).max() < 0.06


def test_the_published_rule() -> None:
    rng = np.random.default_rng(13)
    scan = scan_of(STANDING, rng, [([3.0, 0.0], 0.75), ([0.0, 2.0], 0.15)])
    seen = Chords().detect(scan, STANDING)
    # The paper's robot is never a circle; a leg-sized one is, 0.25 m larger.
    assert len(seen.positions) == 1 and len(seen.static) > 0
    assert 0.25 < seen.radius[0] < 0.25 + 0.3 / np.sqrt(3) + 0.02
    np.testing.assert_allclose(seen.positions[0], [0.0, 2.0], atol=0.08)


def test_an_exact_chord() -> None:
    """Five points on a line of 0.3 m: radius l / sqrt(3), centre l / (2 sqrt(3)) behind it."""
    bearings = np.arctan(np.linspace(-0.15, 0.15, 7) / 2.0)
    ranges = 2.0 / np.cos(bearings)
    scan = Scan("lidar", np.linspace(0.0, 0.1, 7), bearings, ranges)
    seen = Chords().detect(scan, np.zeros((7, 3)))
    np.testing.assert_allclose(seen.positions, [[2.0 + 0.3 / (2 * np.sqrt(3)), 0.0]], atol=1e-9)
    np.testing.assert_allclose(seen.radius, 0.3 / np.sqrt(3) + 0.25)


ROOM = np.array([[-6.0, -4.0], [8.0, -4.0], [8.0, 4.0], [-6.0, 4.0]])
CRATE = box_corners(np.array([3.0, 2.5]), (0.4, 0.3), 0.4)


def drive(detector: Detector, seconds: float, walker: bool, seed: int = 14) -> list[Sightings]:
    """A robot drives through a room with a crate; somebody walks for 4 s and then stands."""
    rng = np.random.default_rng(seed)
    found = []
    for number in range(round(10 * seconds)):
        times = 0.1 * (number + np.arange(1, 361) / 360)
        poses = np.stack([0.3 * times, 0.05 * times, 0.1 * np.sin(times)], axis=-1)
        discs = []
        if walker:
            place = np.stack([4.0 - 0.0 * times, -3.0 + np.minimum(times, 4.0)], axis=-1)
            discs = [(place, 0.3)]
        scan = scan_of(poses, rng, discs, [ROOM, CRATE], end=times[-1], dropped=0.01)
        found.append(detector.detect(scan, poses))
    return found


def test_what_stands_all_the_time_is_no_body() -> None:
    detector = OverTime(DiscDetector((0.3,)))
    found = drive(detector, 6.0, walker=False)
    assert max(len(one.positions) for one in found[:25]) > 0  # the crate, before 3 s have passed
    late = found[32:]
    assert sum(len(one.positions) for one in late) <= 2
    assert min(len(one.static) for one in late) > 320
    plain = drive(DiscDetector((0.3,)), 6.0, walker=False)[32:]
    assert sum(len(one.positions) for one in plain) > 20


def test_somebody_who_has_come_and_stands_still_stays_a_body() -> None:
    detector = OverTime(DiscDetector((0.3,)))
    found = drive(detector, 12.0, walker=True)
    for one in found[35:]:
        place = np.array([4.0, -3.0 + min(one.time, 4.0)])
        apart = np.linalg.norm(one.positions - place, axis=1)
        assert apart.min(initial=np.inf) < 0.1, one.time
    assert sum(len(one.positions) for one in found[35:]) <= 1.1 * len(found[35:])


def test_a_map_tells_from_the_first_scan() -> None:
    walls = [
        Polygon(tuple(map(tuple, box_corners(np.array(centre), half, 0.0))))
        for centre, half in (
            ([1.0, 4.1], (7.2, 0.1)), ([1.0, -4.1], (7.2, 0.1)),
            ([-6.1, 0.0], (0.1, 4.2)), ([8.1, 0.0], (0.1, 4.2)),
        )
    ]  # fmt: skip
    crate = Polygon(tuple(map(tuple, CRATE)))
    found = drive(OutsideMap(DiscDetector((0.3,)), (*walls, crate)), 1.0, walker=True)
    for one in found:
        assert len(one.positions) == 1 and len(one.static) > 300
        np.testing.assert_allclose(one.positions[0], [4.0, -3.0 + one.times[0]], atol=0.05)
    without = drive(OutsideMap(DiscDetector((0.3,)), tuple(walls)), 1.0, walker=False)
    assert all(len(one.positions) == 1 for one in without)  # the crate


def test_a_clock_that_goes_back_forgets_what_stood() -> None:
    detector = OverTime(DiscDetector((0.3,)))
    drive(detector, 4.0, walker=False)
    again = drive(detector, 0.3, walker=False)
    assert "clock went back by 3.9 s" in again[0].note and not again[1].note
    assert len(again[0].positions) > 0


def test_bad_settings_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"discs.shape is \(\); wanted \(radius,\)"):
        DiscDetector(())
    with pytest.raises(WideberthError, match="holds a str; wanted Polygon"):
        OutsideMap(polygons=("wall",))  # type: ignore[arg-type]


def test_the_oracle_of_rays() -> None:
    """A ray straight on a disc, one past it, and one on a box's side."""
    poses = np.zeros((3, 3))
    bearings = np.array([0.0, 0.5, np.pi / 2])
    square = box_corners(np.array([0.0, 5.0]), (1.0, 1.0), 0.0)
    ranges = cast(poses, bearings, [([4.0, 0.0], 1.0)], [square])
    np.testing.assert_allclose(ranges, [3.0, np.inf, 4.0])


@pytest.mark.parametrize("radius", [0.3, 0.75])
def test_bodies_of_several_sizes(radius: float) -> None:
    """Near ones are told apart; a detector of one size finds the other one elsewhere."""
    both, rng, poses = (
        DiscDetector(shape=(0.75,), others=((0.3,),)),
        np.random.default_rng(5),
        STANDING,
    )
    other = DiscDetector(shape=(1.05 - radius,))
    for bearing in rng.uniform(-np.pi, np.pi, 20):
        centre = away(rng.uniform(2.0, 6.0), bearing)
        scan = scan_of(poses, rng, [(centre, radius)])
        seen, elsewhere = both.detect(scan, poses), other.detect(scan, poses)
        assert seen.radius == pytest.approx([radius], abs=0.03)
        assert np.linalg.norm(seen.positions[0] - centre) < 0.05
        assert (np.linalg.norm(elsewhere.positions - centre, axis=1) > 0.2).all()


@pytest.mark.parametrize("distance", [3.0, 7.0, 11.0])
@pytest.mark.parametrize("radius", [0.3, 0.75])
def test_covariance_of_bodies_of_several_sizes(radius: float, distance: float) -> None:
    """It is honest, and says of far bodies that their size is unknown."""
    both = DiscDetector(shape=(0.75,), others=((0.3,),))
    _, squares = errors(both, distance, 80, 7, radius)
    assert len(squares) >= 75
    assert squares.mean() < 3.2


def test_a_second_shape_that_is_none() -> None:
    with pytest.raises(WideberthError, match=r"discs.shape is \(\); wanted"):
        DiscDetector(others=((),))


@pytest.mark.parametrize("late", [2e12, -1e300, 1.7e308])
def test_a_scan_of_absurd_times_is_refused(late: float) -> None:
    """Their mean left the range of a float."""
    with pytest.raises(WideberthError, match=r"scan\.times holds .*; wanted at most 1e\+12"):
        Scan("lidar", np.array([0.0, late]), np.zeros(2), np.ones(2))
