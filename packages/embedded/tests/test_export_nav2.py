"""The exported controller in a loop like that of Nav2's controller server, and its end of a path.

`nav2_server.cpp` has the server's loop, with headers of our own in place of ROS.
"""

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.framework.control.command_limits import attained
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path as Way
from wideberth.packages.embedded.tests.helpers.planner_library import (
    COMPILER,
    REPLAY,
    Library,
    exported,
    library,
    planner,
)
from wideberth_embedded.files import SOURCES
from wideberth_embedded.whole import whole_planner
from wideberth_ros.end_of_path import Approach, Arrival, Spin

CPP = shutil.which("c++")
pytestmark = pytest.mark.skipif(
    COMPILER is None or CPP is None,
    reason="the controller is compiled and run, and there is no compiler here",
)
HELPERS = REPLAY.parent
INCLUDED = (
    "geometry_msgs/msg/pose_stamped", "geometry_msgs/msg/twist_stamped", "nav2_core/controller",
    "nav2_core/controller_exceptions", "nav_msgs/msg/path", "pluginlib/class_list_macros",
    "pluginlib/exceptions", "rclcpp/rclcpp", "rclcpp_lifecycle/lifecycle_node",
    "nav2_dynamic_msgs/msg/obstacle_array",
)  # fmt: skip
LYRICAL = "nav2_ros_common/lifecycle_node"
SUCCESS, PATIENCE, CONTROL = 0, 104, 106
"""Results of Nav2's action FollowPath."""
NEAR = 0.25
"""m and rad, the tolerances of Nav2's goal checker."""
TIMEOUT, POSE_TIMEOUT, AHEAD, TICK = 1.0, 0.5, 0.2, 0.05
"""s, of the controller's parameters, and between two commands."""


@dataclass(frozen=True)
class Result:
    """How a goal ended; ``zeros`` counts the ticks in which the server commanded a stand."""

    code: int
    time: float
    place: Array
    heading: float
    travelled: float
    swept: float
    zeros: int
    reason: str


class Server:
    """A program of `nav2_server.cpp` around one export."""

    def __init__(self, place: Path, folder: Path, headers: tuple[str, ...]) -> None:
        self.program = folder / "drive"
        sources = [place / "wideberth_nav2.cpp", HELPERS / "nav2_server.cpp", place / "planner.so"]
        words = [*included(folder, headers), f"-I{place}", f"-Wl,-rpath,{place}"]
        compile_cpp(self.program, *words, *map(str, sources), "-ldl")

    def output(self, *words: object) -> list[str]:
        """Run a scenario; return its lines."""
        call = [str(self.program), *map(str, words)]
        done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 0, done.stdout[-500:] + done.stderr
        return done.stdout.splitlines()

    def results(self, *words: object) -> list[Result]:
        """Run a scenario; return how each of its goals ended."""
        found = []
        for line in self.output(*words):
            code, time, x, y, heading, travelled, swept, zeros, reason = line.split(" ", 8)
            place = np.array([float(x), float(y)])
            found.append(
                Result(int(code), float(time), place, float(heading), float(travelled),
                       float(swept), int(zeros), reason)
            )  # fmt: skip
        return found


def included(folder: Path, headers: tuple[str, ...]) -> list[str]:
    """Write headers that lead to our own; return the flags of the compiler."""
    for name in headers:
        stub = folder / f"{name}.hpp"
        stub.parent.mkdir(parents=True, exist_ok=True)
        stub.write_text('#include "nav2_stub.hpp"\n')
    return [f"-I{folder}", f"-I{HELPERS}", "-DWIDEBERTH_NAV2_DYNAMIC_MSGS"]


def compile_cpp(out: Path, *words: str) -> None:
    """Compile C++ sources to a file."""
    call = [str(CPP), "-O0", "-std=c++20", "-Wall", "-Wextra", "-Werror", "-o", str(out), *words]
    made = subprocess.run(call, capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return library(exported(planner(), tmp_path_factory.mktemp("nav2") / "export"))


@pytest.fixture(scope="module", params=[INCLUDED, (*INCLUDED, LYRICAL)], ids=["jazzy", "lyrical"])
def server(
    own: Library, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Server:
    return Server(own.place, tmp_path_factory.mktemp("server"), request.param)


# ---- The end of the path


@pytest.mark.parametrize("heading", [0.0, 1.5, -1.5, 3.1, -3.1])
def test_at_the_goal_it_faces_as_it_was_asked_to(server: Server, heading: float) -> None:
    """And back to the path's own heading, by a goal of one pose where it stands."""
    there, back = server.results("heading", heading)
    assert there.code == back.code == SUCCESS, there.reason
    assert np.linalg.norm(there.place - [3.0, 0.0]) <= NEAR
    assert abs(there.heading - heading) <= NEAR and there.swept <= abs(heading) + 0.1
    assert abs(back.heading) <= NEAR and (back.place == there.place).all()


@pytest.mark.parametrize("count", [1, 5])
@pytest.mark.parametrize("heading", [0.0, 1.5, -3.0])
def test_a_path_of_one_place_is_a_turn(server: Server, heading: float, count: int) -> None:
    """As Nav2's NavFn sends where start and goal share a cell of its costmap."""
    for away in (0.0, 0.2, -0.2):
        (found,) = server.results("point", away, heading, count)
        assert found.code == SUCCESS and found.travelled == 0.0, found.reason
        assert abs(found.heading - heading) <= NEAR


def test_a_path_of_one_place_ahead_is_driven_to(server: Server) -> None:
    (found,) = server.results("point", 0.8, 1.0, 1)
    assert found.code == SUCCESS and np.linalg.norm(found.place - [0.8, 0.0]) <= NEAR


@pytest.mark.parametrize("walk", [(10.0, 0.3, -0.6, 0.0), (12.0, 0.0, -0.8, 0.0)])
def test_it_does_not_circle_the_end_after_passing_a_person(server: Server, walk: Any) -> None:
    """It used to turn once round: 7.5 rad."""
    (found,) = server.results("passing", *walk)
    assert found.code == SUCCESS and found.swept < 2.0 * np.pi - 0.5
    assert abs(found.heading) <= NEAR


# ---- What is too old, or ahead


def test_a_frozen_pose_stops_the_robot(server: Server) -> None:
    (found,) = server.results("frozen", 3.0, np.inf, 1.0)
    assert found.code == PATIENCE and found.reason.startswith("the robot's pose is 1.5")
    (moving,) = server.results("frozen", 3.0, 3.0 + POSE_TIMEOUT - 0.1, 1.0)
    assert moving.code == SUCCESS and moving.zeros == 0
    assert found.travelled < 3.0 * 0.5 + 0.5 * POSE_TIMEOUT
    (again,) = server.results("frozen", 3.0, 4.0, 1.0)
    assert again.code == SUCCESS and 0 < again.zeros <= 0.5 / TICK + 1
    (at_once,) = server.results("frozen", 3.0, np.inf, 0.0)
    assert at_once.code == CONTROL and at_once.time == pytest.approx(3.0 + POSE_TIMEOUT, abs=0.1)


def test_late_obstacles_are_zero_commands_until_the_patience_ends(server: Server) -> None:
    (found,) = server.results("silent", 3.0, np.inf, 1.0)
    assert found.code == PATIENCE and found.time == pytest.approx(3.0 + TIMEOUT + 1.0, abs=0.1)
    assert found.zeros == pytest.approx(1.0 / TICK, abs=2)
    (again,) = server.results("silent", 3.0, 3.0 + TIMEOUT + 0.5, 1.0)
    assert again.code == SUCCESS and again.zeros > 5
    (at_once,) = server.results("silent", 3.0, np.inf, 0.0)
    assert at_once.code == CONTROL and at_once.time == pytest.approx(3.0 + TIMEOUT, abs=0.1)


@pytest.mark.parametrize(
    ("pose", "obstacles", "reason"),
    [
        (0.0, 0.0, ""),
        (0.0, -TIMEOUT + 0.01, ""),
        (0.0, -TIMEOUT - 0.01, "the message on obstacles is 1.01"),
        (0.0, -60.0, "the message on obstacles is 60"),
        (0.0, AHEAD - 0.01, ""),
        (0.0, AHEAD + 0.01, "the message on obstacles is stamped 0.21"),
        (0.0, 60.0, "the message on obstacles is stamped 60"),
        (-POSE_TIMEOUT + 0.01, 0.0, ""),
        (-POSE_TIMEOUT - 0.01, 0.0, "the robot's pose is 0.51"),
        (AHEAD - 0.01, 0.0, ""),
        (60.0, 0.0, "the robot's pose is stamped 60"),
    ],
)  # fmt: skip
def test_stamps_decide_how_old_a_pose_and_obstacles_are(
    server: Server, pose: float, obstacles: float, reason: str
) -> None:
    (found,) = server.results("stamped", pose, obstacles)
    assert found.reason.startswith(reason) and bool(found.reason) == bool(reason)
    if reason:
        assert found.code == PATIENCE and found.travelled == 0.0
    else:
        assert found.code == SUCCESS and found.zeros == 0


def test_obstacles_of_an_unknown_frame_stop_the_robot(server: Server) -> None:
    (found,) = server.results("placeless")
    assert found.code == PATIENCE and found.travelled == 0.0
    assert found.reason.startswith("obstacles cannot be placed")


# ---- Configuring


def test_a_failed_configuration_is_said_and_can_be_repeated(server: Server) -> None:
    """The program ends where `configure` throws what Nav2 does not catch."""
    *lines, driven = server.output("configure")
    said = [line for line in lines if line.startswith("ERROR FollowPath is not configured: ")]
    done = [line for line in lines if line not in said]
    wrong = ["integer", "integer again", *5 * ["out of range"], "not built", "bool"]
    wrong += ["pose", "radius"]
    failed = [f"{name}: failed" for name in wrong]
    assert done == [*failed, "right: configured", "node gone: failed", "right again: configured"]
    assert len(said) == len(wrong) + 1
    assert "obstacles_timeout is of type integer; wanted double" in said[0]
    assert "obstacles_timeout is -1" in said[2] and "costmap_converter_msgs" in said[7]
    assert driven.startswith("0 ")


# ---- Two exports in one process


def plugin(place: Path, package: str, folder: Path) -> Path:
    """Build the library of a package, with the flags of its CMakeLists.txt."""
    text = (place / "CMakeLists.txt").read_text()
    assert "C_VISIBILITY_PRESET hidden" in text
    assert all(f" {name}" in text for name in SOURCES)
    call = [str(COMPILER), *"-O0 -std=c99 -ffp-contract=off -fPIC -fvisibility=hidden -c".split()]
    subprocess.run([*call, *SOURCES], cwd=place, check=True)
    objects = [str(one) for one in place.glob("*.o")]
    words = [*included(folder, INCLUDED), f"-I{place}", "-shared", "-fPIC"]
    words += [str(place / f"{package}.cpp"), *objects]
    out = folder / f"lib{package}.so"
    compile_cpp(out, *words, "-lm")
    return out


def test_two_exports_drive_side_by_side(tmp_path: Path) -> None:
    """Each as it does alone; with all symbols of the libraries in one space."""
    settings: dict[str, Any] = {
        "hall_planner": {"period": 0.2, "dt": 0.25},
        "yard_planner": {"predictor": "kalman", "reference_speed": 0.4, "static_region": None},
    }
    files = [
        plugin(exported(planner(**given), tmp_path / name, name), name, tmp_path)
        for name, given in settings.items()
    ]
    program, names = tmp_path / "load", [f"{name}::Controller" for name in settings]
    words = [*included(tmp_path, INCLUDED), str(HELPERS / "nav2_server.cpp"), "-rdynamic", "-ldl"]
    compile_cpp(program, *words)

    def rows(*taken: int) -> Array:
        loaded = [str(files[k]) for k in taken] + [names[k] for k in taken]
        call = [str(program), "load", *loaded]
        done = subprocess.run(call, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 0, done.stdout + done.stderr
        return np.array([line.split() for line in done.stdout.splitlines()], float)

    both = rows(0, 1)
    assert (both[:, :2] == rows(0)).all() and (both[:, 2:] == rows(1)).all()
    assert np.abs(both[:, 0] - both[:, 2]).max() > 0.05


def test_a_name_is_that_of_package_library_and_class(tmp_path: Path) -> None:
    place = tmp_path / "export"
    words = ["export", "crossing", "--out", str(place), "--name", "hall_planner"]
    with pytest.raises(WideberthError, match="give --planner"):
        cli.app(words, standalone_mode=False)
    cli.app([*words, "--planner"], standalone_mode=False)
    texts = {one.name: one.read_text() for one in place.iterdir()}
    assert not [name for name, text in texts.items() if "wideberth_nav2" in name + text]
    assert "<name>hall_planner</name>" in texts["package.xml"]
    assert "add_library(hall_planner SHARED" in texts["CMakeLists.txt"]
    assert 'path="hall_planner"' in texts["hall_planner.xml"]
    assert 'plugin: "hall_planner::Controller"' in texts["hall_planner.yaml"]
    assert "namespace hall_planner\n" in texts["hall_planner.cpp"]


@pytest.mark.parametrize(
    "name", ["", "Hall", "hall planner", "2nd", "hall__a", "hall_", "package", "a-b"]
)
def test_a_name_that_no_package_can_have_is_refused(name: str) -> None:
    with pytest.raises(WideberthError, match="name is"):
        whole_planner(planner(), "test", package=name)


# ---- The end of a path is the one of Python


WAYS = {
    "straight": [(0.0, 0.0), (3.0, 0.0)],
    "bent": [(0.0, 0.0), (2.0, 0.0), (2.0, 1.5)],
    "over itself": [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0), (1.0, 0.0)],
}


@pytest.mark.parametrize("name", WAYS)
def test_approach_and_arrival_are_python_s(own: Library, name: str) -> None:
    """Along the path, beside it, and past its end; with numbers of no use in between."""
    rng, robot, way = np.random.default_rng(1), planner().robot, Way(np.array(WAYS[name]))
    approach, arrival = Approach(robot), Arrival(NEAR)
    assert own.follow(way.points) == 0
    slowed = arrived = 0
    for arc in np.linspace(0.0, way.length, 300):
        place = way.at(np.array([arc]))[0] + 0.15 * rng.standard_normal(2)
        place = np.array([np.nan, 1e300]) if rng.random() < 0.02 else place
        pose, wanted = np.array([*place, rng.uniform(-4.0, 4.0)]), rng.uniform(-1.0, 1.0, 3)
        wanted[:2] *= rng.random() > 0.05
        twist = Twist((float(wanted[0]), float(wanted[1])), float(wanted[2]))
        limited = approach.limited(way, Pose((pose[0], pose[1]), pose[2]), twist)
        found = own.approach(pose, wanted)
        assert found == pytest.approx([*limited.linear, limited.angular], abs=1e-12)
        slowed += limited is not twist
        assert own.arrived(place, NEAR) is arrival.update(way, place)
        arrived += arrival.there
    assert slowed > 10 and arrived > 5


def test_an_end_that_comes_again_is_the_same_one(own: Library) -> None:
    """Twice the tolerance is for a robot that is there, and for the same goal."""
    way = Way(np.array(WAYS["straight"]))
    for onward in (0.0, 0.01, 0.03, 0.45):
        arrival, beside = Arrival(NEAR), way.goal - np.array([1.8 * NEAR, 0.0])
        again = Way(np.array([(1.0, 0.0), (3.0 + onward, 0.0)]))
        assert own.follow(np.array([(9.0, 9.0), (8.0, 9.0)])) == 0
        own.arrived(np.zeros(2), NEAR)
        for path, place, new in ((way, way.goal, 1), (way, beside, 0), (again, beside, 1)):
            assert not new or own.follow(path.points) == 0
            assert own.arrived(place, NEAR) is arrival.update(path, place)


def test_turns_and_limits_are_python_s(own: Library) -> None:
    rng, robot = np.random.default_rng(2), planner().robot
    for period in (0.02, 0.05, 1.0, 5.0):
        spin = Spin(robot, period)
        for off in (0.0, 1e-3, -1e-3, 0.2, -1.5, 3.1, *rng.uniform(-np.pi, np.pi, 20)):
            assert own.spin(off, period) == pytest.approx(spin.rate(off), abs=1e-12)
        for last, wanted in rng.uniform(-0.7, 0.7, (20, 2, 3)):
            last[1], last[2] = 0.0, 0.4 * last[2]
            state = np.array([0.0, 0.0, 0.0, last[0], last[2]])
            twist = Twist((float(wanted[0]), float(wanted[1])), float(wanted[2]))
            expected = attained(robot, state, [twist], period)[0]
            assert own.next(last, wanted, period) == pytest.approx(expected, abs=1e-12)
