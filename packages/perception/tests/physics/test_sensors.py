"""Sensors of the physical world against geometry, against MuJoCo, and against their noise."""

from math import pi, tau

import numpy as np
import pytest
import shapely

from wideberth import WideberthError
from wideberth.framework.values.motion import Twist
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample, WheelSample
from wideberth_perception.physics.body import LARGE, SkidSteerBody
from wideberth_perception.physics.scene import PhysicalPerson, PhysicalRobot, PhysicalScene
from wideberth_perception.physics.sensors import (
    GRAVITY,
    BodyState,
    InertialUnit,
    Lidar,
    Sensor,
    WheelEncoders,
)
from wideberth_perception.physics.world import PhysicsWorld

EXACT = Lidar(deviation=1e-12, lost=0.0)
CRATE = Polygon(((-4, 1), (-3, 0.5), (-2.5, 2), (-3.5, 2.5)), "crate")
TRIANGLE = Polygon(((-1, -4), (1, -3), (0, -2)), "triangle")
WALL = Polygon(((-6, 5), (6, 4), (6.2, 6), (-5.8, 7)), "wall")  # a rectangle, turned


def nothing(origin: np.ndarray, directions: np.ndarray, longest: float) -> np.ndarray:
    return np.full(len(directions), -1.0)


def state(time: float, **known: np.ndarray) -> BodyState:
    """Return a robot that stands upright at the origin but for what is known."""
    still = {
        "position": np.zeros(3), "attitude": np.eye(3), "velocity": np.zeros(3),
        "rates": np.zeros(3), "wheels": np.zeros(4),
    }  # fmt: skip
    return BodyState(time, **{**still, **known})


def scans(world: PhysicsWorld, duration: float) -> list[Scan]:
    world.advance(duration)
    return [sample for sample in world.samples_due()["a"] if isinstance(sample, Scan)]


def scene(*sensors: Sensor, body: SkidSteerBody = LARGE) -> PhysicalScene:
    return PhysicalScene(
        (
            PhysicalRobot("a", body, (0.3, -0.2, 0.7), sensors),
            PhysicalRobot("b", SkidSteerBody(), (4.0, 1.0, 0.0)),
            PhysicalRobot("c", SkidSteerBody(hull="box"), (3.0, -3.0, 0.4)),
        ),
        (PhysicalPerson("ann", (1.0, 2.5)),),
        (CRATE, TRIANGLE, WALL),
    )


def world(*sensors: Sensor, **kind: object) -> PhysicsWorld:
    pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    return PhysicsWorld(scene(*sensors, **kind), np.random.default_rng(1))  # type: ignore[arg-type]


def by_geometry(scan: Scan, pose: np.ndarray, bodies: list[shapely.Geometry]) -> np.ndarray:
    """Return the ranges that the beams of a robot at a pose have to these outlines."""
    found = []
    x, y, heading = pose + np.array([0.0, 0.0, scan.mount[2]])
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    x += cosine * scan.mount[0] - sine * scan.mount[1]
    y += sine * scan.mount[0] + cosine * scan.mount[1]
    for bearing in scan.bearings + heading:
        reach = scan.longest
        ray = shapely.LineString(
            [(x, y), (x + reach * np.cos(bearing), y + reach * np.sin(bearing))]
        )
        gaps = [shapely.Point(x, y).distance(ray.intersection(body)) for body in bodies]
        found.append(np.nanmin([*gaps, np.inf]))
    return np.array(found)


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.3, -0.1, 0.5)])
def test_ranges_are_those_of_plane_geometry(mount: tuple[float, float, float]) -> None:
    lidar = Lidar(deviation=1e-12, lost=0.0, longest=6.0, mount=mount)
    one = world(lidar)
    one.advance(0.3)
    one.samples_due()
    (scan,) = scans(one, 0.1)
    box = one.truth("c").pose
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [0.25, 0.215]
    turn = np.array([[np.cos(box[2]), -np.sin(box[2])], [np.sin(box[2]), np.cos(box[2])]])
    bodies = [
        *(shapely.Polygon(wall.vertices) for wall in (CRATE, TRIANGLE, WALL)),
        shapely.Point(one.truth("b").pose[:2]).buffer(SkidSteerBody().radius, quad_segs=2000),
        shapely.Point(1.0, 2.5).buffer(0.3, quad_segs=2000),
        shapely.Polygon(corners @ turn.T + box[:2]),
    ]
    with np.errstate(all="ignore"):
        wanted = by_geometry(scan, one.truth("a").pose, bodies)
    assert 100 < np.isfinite(wanted).sum() < 360
    assert (np.isfinite(wanted) == np.isfinite(scan.ranges)).mean() > 0.99
    both = np.isfinite(wanted) & np.isfinite(scan.ranges)
    # Corners and edges may be met or just missed: the plane of the beams is a hair off level.
    close = np.abs(wanted[both] - scan.ranges[both]) < 1e-4
    assert close.mean() > 0.99


def test_ranges_equal_single_rays_and_never_meet_the_robot_itself() -> None:
    library = pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    one = world(EXACT, body=SkidSteerBody())
    one.command("a", Twist((0.4, 0.0), 0.3))
    one.advance(2.0)
    chassis = one._model.body("robot0").id
    angle = np.linspace(-pi, pi, 360, endpoint=False)
    level = np.stack([np.cos(angle), np.sin(angle), np.zeros(360)], axis=-1)
    one._robots["a"].sense(one.time, one._cast)
    # At the height of the wheels too, which belong to bodies of their own.
    for height in (0.05, 0.10, 0.35):
        origin = np.array([*one.truth("a").pose[:2], height])
        met = np.empty(360, dtype=np.int32)
        many = np.empty(360)
        library.mj_multiRay(
            one._model, one._data, origin, level.ravel(), one._groups, True, chassis, met, many,
            None, 360, 15.0,
        )  # fmt: skip
        assert np.array_equal(many, one._cast(chassis, origin, level, 15.0))
        owners = {one._names[one._owners[geom]] for geom in met if geom >= 0}
        assert owners <= {"b", "c", "ann", "crate", "triangle", "wall"} and owners
        for direction, found in zip(level, many, strict=True):
            geom = np.array([-1], dtype=np.int32)
            single = library.mj_ray(
                one._model, one._data, origin, direction, one._groups, True, chassis, geom, None
            )
            assert (single if 0 <= single <= 15.0 else -1.0) == found


def test_alone_a_robot_sees_nothing() -> None:
    pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    low = Lidar("low", height=0.05, lost=0.0)
    scene = PhysicalScene((PhysicalRobot("a", sensors=(EXACT, low)),))
    one = PhysicsWorld(scene, np.random.default_rng(0))
    one.command("a", Twist((0.5, 0.0), 0.3))
    found = scans(one, 1.0)
    assert len(found) == 20 and all(np.isposinf(scan.ranges).all() for scan in found)


def test_a_turning_robot_smears_its_scan() -> None:
    """Each beam is the ray from where the robot was at the beam's own time."""
    one = world(EXACT, body=SkidSteerBody())
    one.command("a", Twist((0.0, 0.0), 0.8))
    one.advance(1.0)
    one.samples_due()
    wanted = np.full(360, np.nan)
    at: dict[float, np.ndarray] = {}
    for _ in range(25):
        one.advance(0.004)
        at[one.time] = one.truth("a").pose
    (scan,) = (sample for sample in one.samples_due()["a"] if isinstance(sample, Scan))
    assert len(set(scan.times)) == 25 and scan.times.tolist() == sorted(scan.times)
    assert scan.stamp == pytest.approx(1.1)
    for beam, (time, bearing) in enumerate(zip(scan.times, scan.bearings, strict=True)):
        x, y, heading = at[min(at, key=lambda known: abs(known - time))]
        angle = heading + bearing
        origin = np.array([x, y, 0.35])
        ray = np.array([[np.cos(angle), np.sin(angle), 0.0]])
        wanted[beam] = one._cast(one._model.body("robot0").id, origin, ray, 15.0)[0]
    seen = np.isfinite(scan.ranges) & (wanted > 0.0)
    assert seen.sum() > 150
    assert np.median(np.abs(scan.ranges - wanted)[seen]) < 1e-3
    # Were all beams cast at the end, the first ones would be turned by 0.08 rad.
    turn = at[max(at)][2] - at[min(at)][2]
    assert 0.05 < turn < 0.1


def test_noise_and_lost_beams_are_as_many_as_stated() -> None:
    rng = np.random.default_rng(2)
    lidar = Lidar(beams=1000, deviation=0.02, lost=0.05)
    sampler = lidar.sampler(rng, 0.1)
    found = []
    for k in range(1, 21):
        found += sampler.sample(state(0.1 * k), lambda o, d, r: np.full(len(d), 5.0))
    ranges = np.concatenate([scan.ranges for scan in found])
    count = len(ranges)
    assert count == 20_000
    lost = np.isnan(ranges)
    assert lost.mean() == pytest.approx(0.05, abs=3 * np.sqrt(0.05 * 0.95 / count))
    error = ranges[~lost] - 5.0
    assert error.mean() == pytest.approx(0.0, abs=3 * 0.02 / np.sqrt(count))
    assert error.std() == pytest.approx(0.02, abs=3 * 0.02 / np.sqrt(2 * count))


def test_part_of_a_turn_has_a_beam_at_either_end() -> None:
    assert Lidar(beams=3, field=pi).bearings.tolist() == [-pi / 2, 0.0, pi / 2]
    whole = Lidar(beams=4).bearings
    assert whole.tolist() == [-pi, -pi / 2, 0.0, pi / 2]


def test_samples_are_due_where_the_number_of_periods_changes() -> None:
    for rate, phase in ((100.0, 0.0), (30.0, 0.0), (50.0, 0.01), (250.0, 0.0)):
        sampler = WheelEncoders(rate=rate, phase=phase).sampler(np.random.default_rng(0), 0.1)
        times = []
        for step in range(1, 751):  # 3 s
            for sample in sampler.sample(state(step * 0.004), nothing):
                times.append(sample.time)  # type: ignore[union-attr]
        assert 3.0 * rate - 1 <= len(times) <= 3.0 * rate
        ideal = phase + np.arange(len(times)) / rate
        ideal += 0.0 if phase else 1.0 / rate
        late = np.array(times) - ideal
        assert (late > -1e-9).all() and (late < 0.004 - 1e-9).all()


def test_encoders_are_within_half_a_tick() -> None:
    one = world(WheelEncoders(rate=250.0, ticks=1000), body=SkidSteerBody())
    one.command("a", Twist((0.5, 0.0), 0.2))
    error = []
    for _ in range(500):
        one.advance(0.004)
        (sample,) = one.samples_due()["a"]
        assert isinstance(sample, WheelSample)
        error.append(sample.angles - one.truth("a").wheels)
    tick = tau / 1000
    assert np.abs(error).max() <= tick / 2 + 1e-12
    # Evenly spread over the tick, once the wheels turn.
    assert np.std(error[50:]) == pytest.approx(tick / np.sqrt(12), rel=0.1)


def test_encoders_tell_the_way_and_the_gyroscope_the_turn() -> None:
    quiet = InertialUnit(rate=250.0, rate_deviation=0.0, rate_bias=0.0, rate_walk=0.0)
    one = world(quiet, WheelEncoders(), body=SkidSteerBody())
    one.advance(0.2)
    one.samples_due()
    start = one.truth("a")
    one.command("a", Twist((0.4, 0.0), 0.2))
    turned = 0.0
    one.advance(3.0)
    for sample in one.samples_due()["a"]:
        if isinstance(sample, InertialSample):
            turned += 0.004 * sample.yaw_rate
    end = one.truth("a")
    assert turned == pytest.approx(end.pose[2] - start.pose[2], abs=2e-3)
    way = 0.1 * (end.wheels - start.wheels).mean()
    chord = np.hypot(*(end.pose - start.pose)[:2])
    arc = chord * (turned / 2.0) / np.sin(turned / 2.0)
    assert way == pytest.approx(arc, rel=0.02)


def test_the_accelerometer_feels_the_change_of_speed() -> None:
    exact = InertialUnit(
        rate=50.0, acceleration_deviation=0.0, acceleration_bias=0.0, acceleration_walk=0.0
    )
    one = world(exact, body=SkidSteerBody())
    one.advance(0.5)
    one.samples_due()
    one.command("a", Twist((0.6, 0.0), 0.0))
    felt = []
    for _ in range(50):
        before = one.truth("a").twist[0]
        one.advance(0.02)
        (sample,) = one.samples_due()["a"]
        assert isinstance(sample, InertialSample)
        felt.append((sample.acceleration[0], (one.truth("a").twist[0] - before) / 0.02))
    ours, change = np.transpose(felt)
    assert ours.max() > 1.0
    assert 0.02 * ours.sum() == pytest.approx(0.6, abs=0.02)  # to the speed that it reached
    # Braking and pulling pitch the body by a thousandth: a share of gravity is felt.
    assert ours == pytest.approx(change, abs=0.05)


def test_a_leaning_robot_feels_gravity_and_one_on_a_circle_the_pull_outwards() -> None:
    exact = InertialUnit(acceleration_deviation=0.0, acceleration_bias=0.0, acceleration_walk=0.0)
    lean = 0.1
    up = np.array([[np.cos(lean), 0, np.sin(lean)], [0, 1, 0], [-np.sin(lean), 0, np.cos(lean)]])
    sampler = exact.sampler(np.random.default_rng(0), 0.1)
    sampler.sample(state(0.0, attitude=up), nothing)
    (felt,) = sampler.sample(state(0.01, attitude=up), nothing)
    assert isinstance(felt, InertialSample)  # nose down: the floor pushes it backwards
    assert felt.acceleration == pytest.approx([-GRAVITY * np.sin(lean), 0.0])

    sampler = exact.sampler(np.random.default_rng(0), 0.1)
    speed, rate, found = 0.5, 0.4, []
    for k in range(101):
        angle = rate * 0.01 * k
        cosine, sine = np.cos(angle), np.sin(angle)
        turned = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
        found += sampler.sample(
            state(0.01 * k, attitude=turned, velocity=speed * turned[:, 0]), nothing
        )
    pull = np.mean([sample.acceleration for sample in found], axis=0)  # type: ignore[union-attr]
    # The mean over a period is that of its middle; seen in the axes of its end.
    assert pull == pytest.approx([0.0, speed * rate], abs=speed * rate * 0.01)


def test_inertial_noise_and_bias_are_as_stated() -> None:
    unit = InertialUnit(
        rate_deviation=0.002, rate_bias=0.01, rate_walk=1e-3, acceleration_deviation=0.05,
        acceleration_bias=0.04, acceleration_walk=1e-2,
    )  # fmt: skip
    count, samples = 400, 50
    read = np.empty((count, samples, 3))
    for k in range(count):
        sampler = unit.sampler(np.random.default_rng(k), 0.1)
        sampler.sample(state(0.0), nothing)
        for j in range(samples):
            (sample,) = sampler.sample(state(0.01 * (j + 1)), nothing)
            assert isinstance(sample, InertialSample)
            read[k, j] = sample.yaw_rate, *sample.acceleration
    noise = np.array([0.002, 0.05, 0.05])
    walk, bias = np.array([1e-3, 1e-2, 1e-2]), np.array([0.01, 0.04, 0.04])
    differences = np.diff(read, axis=1)
    # Two white noises and a step of the walk.
    wanted = 2 * noise**2 + 0.01 * walk**2
    measured = differences.reshape(-1, 3).var(axis=0)
    assert measured == pytest.approx(wanted, rel=3 * np.sqrt(3.0 / (count * samples)))
    for instant in (0, samples - 1):
        spread = bias**2 + noise**2 + walk**2 * 0.01 * (instant + 1)
        assert read[:, instant].var(axis=0) == pytest.approx(spread, rel=3 * np.sqrt(2 / count))
        assert (np.abs(read[:, instant].mean(axis=0)) < 3 * np.sqrt(spread / count)).all()
    # The walk by itself: means of ten samples, 0.4 s apart.
    moved = read[:, -10:].mean(axis=1) - read[:, :10].mean(axis=1)
    grown = 2 * noise**2 / 10 + walk**2 * 0.01 * (40 - 10 / 3)
    assert moved.var(axis=0) == pytest.approx(grown, rel=3 * np.sqrt(2 / count))


def test_sensors_that_cannot_be_are_refused() -> None:
    for wrong, message in (
        ({"rate": 0.0}, "lidar.rate is 0"),
        ({"phase": 0.1}, "lidar.phase is 0.1 s; wanted less than the period, 0.1 s"),
        ({"beams": 0}, "lidar.beams is 0"),
        ({"field": 7.0}, "lidar.field is 7 rad; a turn has 2 pi"),
        ({"lost": 1.5}, "lidar.lost is 1.5; wanted a probability"),
    ):
        with pytest.raises(WideberthError, match=message):
            Lidar(**wrong)  # type: ignore[arg-type]
    with pytest.raises(WideberthError, match=r"encoders\.ticks is 0"):
        WheelEncoders(ticks=0)
    with pytest.raises(WideberthError, match=r"imu\.rate_walk is -1"):
        InertialUnit(rate_walk=-1.0)
