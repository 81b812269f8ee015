"""The physical world: how robots drive, touch and fall, and that runs repeat to the byte."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth import Command, WideberthError
from wideberth.framework.values.motion import Twist
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth_perception.physics.body import LARGE, SkidSteerBody
from wideberth_perception.physics.mujoco_module import mujoco
from wideberth_perception.physics.scene import PhysicalPerson, PhysicalRobot, PhysicalScene
from wideberth_perception.physics.sensors import InertialUnit, Lidar, WheelEncoders
from wideberth_perception.physics.world import PhysicsWorld

pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
SMALL = SkidSteerBody()
SOFT = replace(SMALL, servo_gain=10.0, armature=0.0)
WALL = Polygon(((3, -2), (3.2, -2), (3.2, 2), (3, 2)), "wall")


def world(*robots: PhysicalRobot, seed: int = 0, **scene: object) -> PhysicsWorld:
    return PhysicsWorld(PhysicalScene(robots, **scene), np.random.default_rng(seed))  # type: ignore[arg-type]


def driven(body: SkidSteerBody, forward: float, turn: float, **kind: object) -> np.ndarray:
    """Return means of 4 s after 4 s: forward and lateral speed, yaw rate, speeds of the rims."""
    one = world(PhysicalRobot("a", body, **kind))  # type: ignore[arg-type]
    one.command("a", Twist((forward, 0.0), turn))
    one.advance(4.0)
    found = []
    before = one.truth("a").pose[2]
    for _ in range(100):
        one.advance(0.04)
        truth = one.truth("a")
        found.append([*truth.twist, *truth.wheel_speeds])
    mean = np.mean(found, axis=0)
    mean[2] = (truth.pose[2] - before) / 4.0  # the rate itself jitters
    return mean


@pytest.mark.parametrize(
    ("body", "gains"),
    [
        (SMALL, {(0, 0.3): 0.546, (0.5, 0.3): 0.538, (0.5, 0.1): 0.506, (0.5, 0.02): 0.482}),
        (SOFT, {(0, 0.3): 0.190, (0.5, 0.3): 0.187, (0.5, 0.1): 0.233, (0.5, 0.02): 0.233}),
        (
            replace(SMALL, servo_gain=1000.0),
            {(0, 0.3): 0.568, (0.5, 0.3): 0.557, (0.5, 0.1): 0.551, (0.5, 0.02): 0.539},
        ),
        (
            replace(LARGE, servo_gain=4000.0),
            {(0, 0.3): 0.646, (0.5, 0.3): 0.616, (0.5, 0.1): 0.588, (0.5, 0.02): 0.599},
        ),
    ],
    ids=["small", "soft servo, no armature", "stiff servo", "large"],
)
def test_yaw_gain_is_that_of_the_reference_table(
    body: SkidSteerBody, gains: dict[tuple[float, float], float]
) -> None:
    for (forward, turn), gain in gains.items():
        reached = driven(replace(body, yaw_gain=1.0), forward, turn)[2] / turn
        assert reached == pytest.approx(gain, abs=0.03), (forward, turn)


def test_with_an_elliptic_cone_it_does_not_matter_where_a_robot_looks() -> None:
    for cone, same in (("elliptic", True), ("pyramidal", False)):
        turned = []
        for heading in (0.0, np.pi / 4.0):
            one = world(PhysicalRobot("a", start=(0.0, 0.0, heading)), cone=cone)
            one.command("a", Twist((0.5, 0.0), 0.5))
            one.advance(0.5)
            turned.append(one.truth("a").pose[2] - heading)
        assert (abs(turned[1] - turned[0]) < 1e-6) == same


@pytest.mark.parametrize("body", [SMALL, LARGE], ids=["small", "large"])
def test_wheels_keep_their_speed_while_they_skid(body: SkidSteerBody) -> None:
    for forward, turn, error in ((0.5, 0.0, 0.02), (0.5, 0.3, 0.02), (0.0, 0.3, 0.025)):
        rims = driven(body, forward, turn)[3:]
        left, right = body.rim_speeds(forward, turn)
        assert rims == pytest.approx([left, left, right, right], rel=error), (forward, turn)


def test_theory_needs_a_stiff_servo_and_armature() -> None:
    stiff = replace(SMALL, servo_gain=1000.0, yaw_gain=1.0)
    assert SMALL.theoretical_yaw_gain == pytest.approx(0.548, abs=1e-3)
    assert LARGE.theoretical_yaw_gain == pytest.approx(0.623, abs=1e-3)
    for forward in (0.0, 0.5):
        gain = driven(stiff, forward, 0.3)[2] / 0.3
        assert gain == pytest.approx(SMALL.theoretical_yaw_gain, abs=0.03)
        assert driven(replace(SOFT, yaw_gain=1.0), forward, 0.3)[2] / 0.3 < 0.25


@pytest.mark.parametrize("body", [SMALL, LARGE], ids=["small", "large"])
def test_the_yaw_rate_loop_takes_the_rest(body: SkidSteerBody) -> None:
    quiet = InertialUnit(rate_deviation=0.0, rate_bias=0.0, rate_walk=0.0)
    for forward, turn in ((0.5, 0.3), (0.5, 0.02), (0.0, -0.3)):
        moved = driven(body, forward, turn, sensors=(quiet,))
        assert moved[2] == pytest.approx(turn, abs=0.003)
        assert moved[0] == pytest.approx(forward, abs=0.005)


def test_a_known_gyro_bias_is_taken_off() -> None:
    unit = InertialUnit(rate_deviation=0.0, rate_bias=0.05, rate_walk=0.0)
    one = world(PhysicalRobot("a", sensors=(unit,)))
    one.advance(0.1)
    bias = one.samples_due()["a"][-1].yaw_rate  # type: ignore[union-attr]
    assert abs(bias) > 0.005
    one.command("a", Command((0.5, 0.0), 0.1), gyro_bias=bias)
    one.advance(5.0)
    before = one.truth("a").pose[2]
    one.advance(2.0)
    assert (one.truth("a").pose[2] - before) / 2.0 == pytest.approx(0.1, abs=0.002)


def test_standing_still_the_wheels_stand() -> None:
    one = world(PhysicalRobot("a", sensors=(InertialUnit(rate_bias=0.1),)))
    one.command("a", Twist((0.5, 0.0), 0.3))
    one.advance(2.0)
    one.command("a", Twist((0.0, 0.0), 0.0))
    one.advance(1.0)
    stood = one.truth("a").pose
    one.advance(2.0)
    assert one.truth("a").pose == pytest.approx(stood, abs=1e-3)


def test_time_passes_in_whole_steps_and_none_is_lost() -> None:
    one = world(PhysicalRobot("a"))
    for k in range(1, 91):
        one.advance(1.0 / 30.0)
        assert one.time == pytest.approx(k / 30.0, abs=0.002 + 1e-9)
        assert one.truth("a").time == one.time
    assert one.time == pytest.approx(3.0)


def test_sensors_see_the_place_of_the_step_not_the_one_before() -> None:
    ahead = Lidar(rate=250.0, beams=1, field=1e-6, deviation=1e-12, lost=0.0)
    one = world(PhysicalRobot("a", sensors=(ahead,)), walls=(WALL,))
    one.command("a", Twist((0.5, 0.0), 0.0))
    one.advance(2.0)
    one.samples_due()
    one.advance(0.004)
    (scan,) = one.samples_due()["a"]
    assert isinstance(scan, Scan)
    truth = one.truth("a")
    assert truth.twist[0] * 0.004 > 1e-3  # what a place one step old would be off by
    assert scan.ranges[0] == pytest.approx(3.0 - truth.pose[0], abs=2e-5)


def test_contacts_name_who_touches_whom() -> None:
    one = world(
        PhysicalRobot("a"), PhysicalRobot("b", start=(0.0, 3.0, 0.0)),
        people=(PhysicalPerson("ann", (2.0, 3.0)),), walls=(WALL,),
    )  # fmt: skip
    for name in ("a", "b"):
        one.command(name, Twist((0.8, 0.0), 0.0))
    one.advance(1.0)
    assert one.contacts == []
    one.advance(4.0)
    assert one.contacts == [("a", "wall"), ("ann", "b")]
    assert one.truth("a").pose[0] == pytest.approx(3.0 - SMALL.radius, abs=0.02)
    assert one.truth("b").pose[0] == pytest.approx(1.7 - SMALL.radius, abs=0.05)
    one.move_person("ann", (20.0, 3.0))
    one.advance(1.0)
    assert one.contacts == [("a", "wall")]
    assert one.truth("b").pose[0] > 1.7


def test_a_crate_that_is_no_rectangle_stops_a_robot_too() -> None:
    bent = Polygon(((2, -1), (3, -1), (3, 1), (2, 1), (2.5, 0)))  # not convex: two parts
    one = world(PhysicalRobot("a", replace(SMALL, hull="box")), walls=(bent,))
    one.command("a", Twist((0.8, 0.0), 0.0))
    one.advance(6.0)
    assert one.contacts == [("a", "wall 0")]
    assert 1.9 < one.truth("a").pose[0] + SMALL.half_length < 2.5


def test_a_robot_pushed_over_says_so_and_stops() -> None:
    one = world(PhysicalRobot("a"), PhysicalRobot("b", start=(5.0, 0.0, 0.0)))
    one.command("a", Twist((0.5, 0.0), 0.0))
    one.advance(1.0)
    assert one.status("a") == ""
    chassis = one._model.body("robot0").id
    one._data.xfrc_applied[chassis, 2:4] = 100.0, 250.0  # lifted and rolled
    one.advance(0.3)
    one._data.xfrc_applied[chassis] = 0.0
    one.advance(3.0)
    assert one.status("a").startswith("pushed over: ")
    assert one.truth("a").wheel_speeds == pytest.approx([0.0] * 4, abs=0.01)
    assert one.status("b") == ""


def test_a_world_without_a_finite_solution_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo would write MUJOCO_LOG.TXT where it stands
    one = world(PhysicalRobot("a", sensors=(Lidar(), InertialUnit())))
    one.advance(0.2)
    one._data.qvel[0] = np.nan
    one.advance(0.2)
    assert one.time == pytest.approx(0.4)
    first = "the physics has no finite solution after 0.204 s (Nan, Inf or huge value in QVEL"
    assert one.status("a").startswith(first)
    one.advance(0.2)
    assert one.status("a").startswith(first) and one.status("a").count("(") == 1
    assert not list(tmp_path.iterdir())


def test_without_mujoco_a_world_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    mujoco.cache_clear()
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(WideberthError, match=r"MuJoCo, .* pip install 'wideberth\[perception\]'"):
        world(PhysicalRobot("a"))


def test_a_command_that_is_not_finite_stops_the_robot() -> None:
    one = world(PhysicalRobot("a"))
    one.command("a", Twist((0.5, 0.0), 0.0))
    one.advance(1.0)
    one.command("a", Twist((np.nan, 0.0), 0.0))
    one.advance(1.0)
    assert one.status("a") == "the command (nan, 0.0), gyro bias 0.0, is not finite"
    assert one.truth("a").twist == pytest.approx([0.0, 0.0, 0.0], abs=0.01)
    one.command("a", Twist((0.5, 0.0), 0.0))
    one.advance(1.0)
    assert one.status("a") == "" and one.truth("a").twist[0] == pytest.approx(0.5, abs=0.02)


def record(*, extra: bool = False, seed: int = 3) -> dict[str, bytes]:
    """Return the bytes of what the sensors of a run report, by name."""
    carried = (Lidar(phase=0.03), WheelEncoders(), InertialUnit())
    second = (InertialUnit("spare", rate=50.0),) if extra else ()
    one = world(
        PhysicalRobot("a", sensors=(*second, *carried)),
        PhysicalRobot("b", LARGE, (-2.0, 0.5, 1.0), carried[1:]),
        seed=seed, walls=(WALL,),
    )  # fmt: skip
    one.command("a", Twist((0.3, 0.0), 0.2))
    found: dict[str, bytes] = {}
    for _ in range(20):
        one.advance(0.05)
        for name, samples in one.samples_due().items():
            for sample in samples:
                key = f"{name}/{sample.sensor}"
                values = [
                    getattr(sample, entry)
                    for entry in ("time", "times", "ranges", "angles", "yaw_rate", "acceleration")
                    if hasattr(sample, entry)
                ]
                found[key] = found.get(key, b"") + b"".join(
                    np.asarray(v).tobytes() for v in values
                )
    return found


def test_runs_repeat_to_the_byte_and_sensors_draw_alone() -> None:
    first = record()
    assert first == record()
    more = record(extra=True)
    assert {key: more[key] for key in first} == first and len(more) == len(first) + 1
    assert all(other != first[key] for key, other in record(seed=4).items() if "enc" not in key)
    assert first["a/imu"] != first["b/imu"]


def test_scenes_that_cannot_be_are_refused() -> None:
    with pytest.raises(WideberthError, match="two of the sensors of a are called 'imu'"):
        PhysicalRobot("a", sensors=(InertialUnit(), InertialUnit(rate=50.0)))
    with pytest.raises(WideberthError, match="two of the scene are called 'a'"):
        PhysicalScene((PhysicalRobot("a"),), (PhysicalPerson("a", (3.0, 0.0)),))
    with pytest.raises(WideberthError, match="'imu' of a has rate 400 Hz; the world steps at 250"):
        PhysicalScene((PhysicalRobot("a", sensors=(InertialUnit(rate=400.0),)),))
    with pytest.raises(WideberthError, match="a and wall overlap at the start"):
        world(PhysicalRobot("a", start=(3.1, 0.0, 0.0)), walls=(WALL,))
    with pytest.raises(WideberthError, match="a and b overlap at the start"):
        world(PhysicalRobot("a"), PhysicalRobot("b", start=(0.6, 0.0, 0.0)))
    with pytest.raises(WideberthError, match=r"start has shape \(2,\); wanted \(3,\)"):
        PhysicalRobot("a", start=(0.0, 0.0))
    with pytest.raises(WideberthError, match="cone is 'round'; wanted one of pyramidal, elliptic"):
        PhysicalScene((PhysicalRobot("a"),), cone="round")  # type: ignore[arg-type]
    with pytest.raises(WideberthError, match="mass is 0"):
        SkidSteerBody(mass=0.0)
    with pytest.raises(WideberthError, match="hull is 'ball'; wanted one of cylinder, box"):
        SkidSteerBody(hull="ball")  # type: ignore[arg-type]
    one = world(PhysicalRobot("anna"))
    with pytest.raises(WideberthError, match="no robot 'ana': did you mean 'anna'"):
        one.command("ana", Twist((0.0, 0.0), 0.0))
    with pytest.raises(WideberthError, match="no person 'bob'; the world has none"):
        one.move_person("bob", (0.0, 0.0))
    with pytest.raises(WideberthError, match="duration is 0"):
        one.advance(0.0)
