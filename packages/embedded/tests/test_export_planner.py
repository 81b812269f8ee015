"""The exported planner commands what Python's does, and says what it lacks."""

import ctypes
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wideberth_embedded
from wideberth.experiments.cli.export import export
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.numerics.geometry import plane_turn
from wideberth.framework.tracking.history import MOST
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path as Way
from wideberth.packages.embedded.tests.helpers.planner_library import (
    COMPILER,
    FORECASTS,
    REPLAY,
    Drive,
    Library,
    Scene,
    Structures,
    compiled,
    differences,
    driven,
    exported,
    library,
    planner,
)
from wideberth.predictors.core.history import LONGEST_GAP, ROUNDING
from wideberth.predictors.core.propagation import white_acceleration
from wideberth.regions.static import packing
from wideberth_embedded.files import RUNGS, bundle
from wideberth_embedded.supported import SUPPORTED
from wideberth_embedded.whole import whole_planner

needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="the planner is compiled and run, and there is no C compiler here"
)
C = Path(wideberth_embedded.__file__).with_name("c")
CPP = shutil.which("c++")
CLOSE = 1e-9
"""m/s, rad/s and s."""
LONG, CLOSE_AFTER = 80, 1e-5
"""With hard regions a solve of more than 80 iterations carries rounding on: after 87 the two
differ by 1.6e-9, and Python's own command moves by up to 6e-7 where what is seen changes in its
last digit (measured)."""


def lost(seen: Observation) -> Observation:
    """The robot does not know where it is."""
    return replace(seen, state=np.full(5, np.nan))


def back(seen: Observation) -> Observation:
    """The clock goes back by two seconds."""
    return replace(seen, stamp=seen.stamp - 2.0)


def later(seen: Observation) -> Observation:
    """Nothing was seen for half a minute."""
    return replace(seen, stamp=seen.stamp + 30.0)


EVENTS = {8: lost, 14: back, 29: later}
DRIVES: dict[str, tuple[dict[str, Any], list[tuple[Scene, int, int]]]] = {
    "crowds": (
        {},
        [
            (Scene(people=5, walls=6, late=True), 0, 35),
            (Scene(people=8, close=True, odd=0.1, events=EVENTS), 5, 35),
            (Scene(people=25, walls=3), 2, 25),
            (Scene(people=1), 3, 15),
        ],
    ),
    "fast": (
        {"period": 0.1, "solver": {"type": "riccati", "iterations": 12}},
        [
            (Scene(people=5, walls=3, late=True, period=0.1), 7, 40),
            (Scene(people=4, period=0.1, events=EVENTS), 0, 35),
            (Scene(people=4, period=0.1, events=EVENTS), 1, 35),
            (Scene(people=4, period=0.1, events=EVENTS), 8, 35),
            (Scene(people=10, close=True, odd=0.05, period=0.1), 2, 25),
        ],
    ),
    "forwards": (
        {"robot": {"type": "unicycle", "max_yaw_rate": 1.0, "max_yaw_acceleration": 1.0,
                   "max_reverse_speed": 0.0}, "wall_margin": 0.02,
         "predictor": {"type": "kalman", "acceleration_density": 0.05, "speed": 0.7,
                       "noise_floor": 0.02}},
        [(Scene(people=3, turned=2.9), 0, 20), (Scene(people=5, walls=6, turned=-2.2), 1, 20)],
    ),
    "hard": (
        {
            "level": {"type": "discounted"}, "penalty": None, "static_region": None,
            "most_obstacles": 2, "track_dt": 0.4,
            "starts": ["along", "left", "coast", "back-right"],
            "fallback": {"rungs": ["optimal", "shifted last plan", "brake"]},
        },
        [(Scene(people=6, late=True), 0, 25)],
    ),
}  # fmt: skip


class Case:
    """A planner, its export, and drives of it."""

    def __init__(self, name: str, place: Path) -> None:
        settings, scenes = DRIVES[name]
        self.planner: Planner = planner(**settings)
        self.place = exported(self.planner, place)
        self.drives = [driven(self.planner, *scene) for scene in scenes]

    @cached_property
    def library(self) -> Library:
        """The compiled library."""
        return library(self.place)


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Case]:
    folder = tmp_path_factory.mktemp("planner")
    return {name: Case(name, folder / name) for name in DRIVES}


# ---- The same commands as Python's


@needs_compiler
def test_commands_are_python_s(cases: dict[str, Case]) -> None:
    """320 decisions and 25 with hard regions: crowds, walls, contact, odd numbers, odd clocks."""
    rungs: Counter[str] = Counter()
    several = warm = 0
    for name, case in cases.items():
        for drive in case.drives:
            found = case.library.replayed(drive)
            commands = np.array([[*one.linear, one.omega, one.ramp] for one in found])
            apart = differences([drive], commands)
            iterations = np.array([tick.iterations for tick in drive.ticks])
            long = (iterations > LONG) & (case.planner.penalty is None)
            allowed = np.where(long, CLOSE_AFTER, CLOSE)
            assert (apart <= allowed).all(), (name, apart, iterations)
            assert (apart > CLOSE).sum() <= 2, (name, apart, iterations)
            taken = [(tick.rung, one) for tick, one in zip(drive.ticks, found, strict=True)]
            assert all(_same_rung(rung, one) for rung, one in taken), name
            rungs.update(rung for rung, one in taken if one.status == 0)
            rungs["emergency"] += sum(one.status != 0 for _, one in taken)
            several += sum(one.starts > 1 for _, one in taken)
            pairs = zip(drive.ticks, found, strict=True)
            warm += sum(tick.iterations == one.iterations > 0 for tick, one in pairs)
    assert sum(rungs.values()) == 345
    assert several > 40 and warm > 200  # the solver took as many iterations as in Python
    for rung, most in {"optimal": 100, "feasible": 15, "shifted": 1, "least violation": 30,
                       "brake": 30, "emergency": 2}.items():  # fmt: skip
        assert sum(count for name, count in rungs.items() if rung in name) >= most, rungs


@needs_compiler
def test_a_path_back_over_itself_that_comes_again_is_followed_as_in_python(
    cases: dict[str, Case],
) -> None:
    made, exported = cases["crowds"].planner, cases["crowds"].library
    points = np.array([(0.0, 0.0), (2.5, 0.0), (2.5, 0.3), (2.5, 0.0), (0.0, 0.0)])
    made.reset()
    exported.code.wideberth_planner_reset(exported.planner)
    state = np.zeros(len(made.robot.states))
    for k in range(70):
        if k % 4 == 0:
            made.set_path(Way(points + 0.001 * (k % 3)))
            assert exported.follow(points + 0.001 * (k % 3)) == 0
        seen = Observation(made.period * k, state)
        command, found = made.command(seen), exported.decide(seen)
        numbers = [*command.linear, command.omega, command.ramp]
        assert np.allclose(numbers, [*found.linear, found.omega, found.ramp], atol=CLOSE, rtol=0.0)
        assert made.plan is not None
        state = made.plan.states[1]
    assert np.linalg.norm(state[:2]) < 0.15


@needs_compiler
def test_somebody_on_the_goal_is_waited_for_as_in_python(cases: dict[str, Case]) -> None:
    made, exported = cases["crowds"].planner, cases["crowds"].library
    points = np.array([(0.0, 0.0), (3.0, 0.0)])
    made.reset()
    made.set_path(Way(points))
    exported.code.wideberth_planner_reset(exported.planner)
    assert exported.follow(points) == 0
    state, driven, turned = np.zeros(len(made.robot.states)), [], []
    body = Detection("p", points[-1], 1e-4 * np.eye(2), 0.3)
    for k in range(150):
        seen = Observation(made.period * k, state, (body,) if k < 110 else ())
        command, found = made.command(seen), exported.decide(seen)
        numbers = [*command.linear, command.omega, command.ramp]
        assert np.allclose(numbers, [*found.linear, found.omega, found.ramp], atol=1e-6, rtol=0.0)
        assert made.plan is not None
        driven.append(np.linalg.norm(made.plan.states[1][:2] - state[:2]))
        turned.append(abs(command.omega))
        state = np.append(made.plan.states[1][:4], command.omega)
    assert sum(driven[80:110]) < 0.2 and max(turned[80:110]) < 0.05, "it does not rest"
    assert np.linalg.norm(state[:2] - points[-1]) < 0.15, "it does not go on"


def _same_rung(rung: str, one: Any) -> bool:
    names = ("optimal", "feasible", "shifted", "least", "brake", "brake")
    return rung.startswith(names[one.rung])


@needs_compiler
@pytest.mark.parametrize("flags", ["address,undefined", "thread"])
def test_two_threads_under_sanitizers(cases: dict[str, Case], flags: str, tmp_path: Path) -> None:
    """All of the library is compiled with them, the solver too."""
    if not _knows(flags, tmp_path):
        pytest.skip(f"this compiler has no -fsanitize={flags}")
    case = cases["crowds"]
    words = ["-O1", "-g", f"-fsanitize={flags}", "-fno-sanitize-recover=all", "-I.", "-pthread"]
    program = compiled(case.place, "replay", *words, str(REPLAY))
    for commands in replayed(case, program, case.drives[:2], tmp_path):
        assert differences(case.drives[:2], commands).max() <= CLOSE


def _knows(flags: str, place: Path) -> bool:
    """Whether the compiler has a sanitizer whose programs run here."""
    (place / "none.c").write_text("int main(void) { return 0; }\n")
    call = [str(COMPILER), f"-fsanitize={flags}", "-o", "none", "none.c"]
    made = subprocess.run(call, cwd=place, capture_output=True, check=False)
    return made.returncode == 0 and subprocess.run([place / "none"], check=False).returncode == 0


def replayed(case: Case, program: Path, drives: list[Drive], place: Path) -> list[Any]:
    """Commands of both threads of `planner_replay.c`."""
    types = Structures(case.place)
    (place / "drives").write_bytes(b"".join(drive.written(types) for drive in drives))
    done = subprocess.run(
        [program, place / "drives", place / "commands"], capture_output=True, text=True,
        check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return list(np.fromfile(place / "commands").reshape(2, -1, 4))


@needs_compiler
def test_another_constant_is_noticed(cases: dict[str, Case], tmp_path: Path) -> None:
    case = cases["crowds"]
    place = Path(shutil.copytree(case.place, tmp_path / "c"))
    table = place / "wideberth_planner_tables.h"
    text, floor = table.read_text(), "PLAN_NOISE_FLOOR 0.01"
    assert text.count(floor) == 1
    table.write_text(text.replace(floor, f"{floor}1"))
    changed = library(place)
    found = [one for drive in case.drives for one in changed.replayed(drive)]
    commands = np.array([[*one.linear, one.omega, one.ramp] for one in found])
    assert differences(case.drives, commands).max() > 1e-4


def test_numbers_that_c_writes_itself_are_python_s() -> None:
    """All others come from `planner_constants`, which reads them where Python has them."""
    code = "".join(path.read_text("utf-8") for path in sorted(C.glob("planner_*")))
    found = {name: float(value) for name, value in re.findall(r"#define (\w+) (-?\d\S*)", code)}
    assert found == {
        "GIVEN_UP": 100,  # none of Python's
        "PI": np.pi,
        "FORGIVEN": 1e-9,  # of `arrays.checked_covariance`
        "LONGEST_LAG": LONGEST_GAP + 1,
        "ROUNDING": ROUNDING,
        "LEAST_LENGTH": packing._LENGTHS[0],
        "MOST_LENGTH": packing._LENGTHS[1],
    }


# ---- Forecasts are those of a Kalman filter


@dataclass(frozen=True)
class Measurement:
    """A measured position (2,), m, its covariance (2, 2), m^2, and its time, s."""

    time: float
    position: Array
    covariance: Array


def filtered(log: Sequence[Measurement], kalman: Any, step: float) -> tuple[Array, Array]:
    """Return state (4,) and covariance (4, 4) of position and velocity after a log."""
    state, spread, last = np.zeros(4), np.zeros((4, 4)), -np.inf
    for measurement in log:
        noise = measurement.covariance + kalman.noise_floor**2 * np.eye(2)
        if measurement.time - last > 6.0 * step * (1.0 + 1e-6):
            state = np.concatenate([measurement.position, np.zeros(2)])
            spread = np.zeros((4, 4))
            spread[:2, :2], spread[2:, 2:] = noise, kalman.speed**2 * np.eye(2)
        else:
            state, spread = ahead(state, spread, measurement.time - last, kalman)
            gain = spread[:, :2] @ np.linalg.inv(spread[:2, :2] + noise)
            state = state + gain @ (measurement.position - state[:2])
            spread = spread - gain @ spread[:2]
        last = measurement.time
    return state, spread


def ahead(state: Array, spread: Array, lag: float, kalman: Any) -> tuple[Array, Array]:
    """Return state and covariance ``lag`` s later."""
    transition, process = white_acceleration(lag, kalman.acceleration_density, 2)
    return transition @ state, transition @ spread @ transition.T + process


def expected(
    log: Sequence[Measurement], stated: Array, made: Planner, stamp: float, newest: float
) -> tuple[Array, Array]:
    """Return means (N, 2) and covariances (N, 2, 2) at the steps of a plan from ``stamp`` s on.

    Parameters
    ----------
    log : measurements that count. stated : (2, 2), m^2, covariance of the last report.
    made : the planner. newest : s, time of the newest measurement of all obstacles.
    """
    kalman, step, last = made.predictor, made.track_dt, log[-1]
    lag = newest - last.time if newest - last.time > 1e-6 * step else 0.0
    now = filtered(log, kalman, step)
    times = (stamp - newest + made.dt * np.arange(1, made.horizon + 1)) / step
    rows = [ahead(*now, lag + step * h, kalman) for h in range(1, int(times[-1]) + 3)]
    first = last.position if lag == 0.0 else rows[0][0][:2]
    means = np.array([first, *(mean[:2] for mean, _ in rows)])
    covariances = np.array([stated, *(spread[:2, :2] for _, spread in rows)])
    below = times.astype(int)
    share = (times - below)[:, None]
    mean = (1.0 - share) * means[below] + share * means[below + 1]
    weight = share[:, None]
    return mean, (1.0 - weight) * covariances[below] + weight * covariances[below + 1]


def noted(log: list[Measurement], measurement: Measurement, step: float) -> str:
    """Add a measurement unless it is older than the last, or replace the last; say which."""
    lag = measurement.time - log[-1].time if log else np.inf
    if lag < -1e-6 * step:
        return "late"
    same = lag <= 1e-6 * step
    log[len(log) - same :] = [measurement]
    return "same time" if same else "after a gap" if 6.0 * step < lag < np.inf else "new"


class Forecasting:
    """A library that hands its forecasts out, and a path."""

    def __init__(self, place: Path, made: Planner) -> None:
        words = ["-O1", "-shared", "-I.", str(FORECASTS)]
        self.library = Library(compiled(place, "forecasts.so", *words), place)
        self.horizon = made.horizon
        assert self.library.follow(np.array([(0.0, 0.0), (9.0, 0.0)])) == 0

    def after(self, stamp: float, detections: Sequence[Detection]) -> tuple[Array, Array]:
        """Decide; return means (O, N, 2) and covariances (O, N, 2, 2), by name."""
        self.library.decide(Observation(stamp, np.zeros(5), tuple(detections)))
        means = np.zeros((MOST, self.horizon, 2))
        covariances = np.zeros((MOST, self.horizon, 2, 2))
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (means, covariances)]
        count = self.library.code.planner_forecasts(self.library.planner, *pointers)
        return means[:count], covariances[:count]


@pytest.fixture(scope="module")
def coarse() -> Planner:
    """Return a planner whose tracks have longer steps than its plans."""
    return planner(dt=0.25, track_dt=0.4, period=0.1, static_region=None)


@pytest.fixture(scope="module")
def forecasting(coarse: Planner, tmp_path_factory: pytest.TempPathFactory) -> Forecasting:
    return Forecasting(exported(coarse, tmp_path_factory.mktemp("coarse") / "c"), coarse)


@needs_compiler
def test_forecasts_are_a_kalman_filter_s(coarse: Planner, forecasting: Forecasting) -> None:
    """Each measurement counts at its own time, with its own covariance, for as long as needed."""
    rng, step = np.random.default_rng(3), coarse.track_dt
    place, speed = rng.uniform(2.0, 6.0, (6, 2)), rng.normal(0.0, 0.4, (6, 2))
    logs: dict[str, list[Measurement]] = {f"person {k}": [] for k in range(6)}
    kinds: Counter[str] = Counter()
    stated: dict[str, Array] = {}
    forecasting.library.code.wideberth_planner_reset(forecasting.library.planner)
    for tick in range(300):
        stamp, detections = 0.1 * tick, []
        for k, (name, log) in enumerate(logs.items()):
            away = tick % 45 > 44 - 5 * k
            if tick and (away or rng.random() < 0.25):
                continue
            age = float(rng.choice([0.0, 0.03, 0.1, 0.25])) if k else 0.0
            turn = plane_turn(rng.uniform(0.0, 3.0))
            spread = turn @ np.diag(rng.uniform(1e-5, 4e-3, 2)) @ turn.T
            stated[name] = 0.5 * (spread + spread.T)
            at = place[k] + speed[k] * (stamp - age) + 0.02 * rng.standard_normal(2)
            detections.append(Detection(name, at, stated[name], 0.3, age))
            kinds[noted(log, Measurement(stamp - age, at, stated[name]), step)] += 1
        newest = max(log[-1].time for log in logs.values())
        means, covariances = forecasting.after(stamp, detections)
        assert len(means) == len(logs)
        for k, (name, log) in enumerate(logs.items()):
            mean, covariance = expected(log, stated[name], coarse, stamp, newest)
            assert np.abs(means[k] - mean).max() < 1e-9, (tick, k)
            assert np.abs(covariances[k] - covariance).max() < 1e-9, (tick, k)
    assert all(kinds[kind] > 5 for kind in ("late", "same time", "after a gap", "new")), kinds


@needs_compiler
def test_a_late_report_keeps_an_obstacle_but_not_its_forecast(
    coarse: Planner, forecasting: Forecasting
) -> None:
    forecasting.library.code.wideberth_planner_reset(forecasting.library.planner)
    spread = 1e-4 * np.eye(2)
    first = Detection("person", np.array([4.0, 1.0]), spread, 0.3)
    late = replace(first, position=np.array([4.5, 1.0]), age=2.5)
    forecasting.after(0.0, [first])
    alone = forecasting.after(2.0, [])[0]
    assert (forecasting.after(2.0, [late])[0] == alone).all()
    assert len(forecasting.after(4.9, [])[0]) == 1
    assert len(forecasting.after(5.1, [])[0]) == 0


# ---- Failures are statuses, and the command brakes


@needs_compiler
def test_every_failure_has_a_status_and_a_braking_command(cases: dict[str, Case]) -> None:
    case = cases["crowds"]
    own, first = case.library, case.drives[0].ticks[0].seen
    code, moving = own.code, replace(first, state=np.array([0.0, 0.0, 0.0, 0.5, 0.1]))
    fresh = Library(case.place / "planner.so", case.place)
    nowhere = fresh.decide(moving)
    assert status_of(fresh, nowhere) == "no path is set: call wideberth_planner_set_path"
    assert own.follow(np.zeros((3, 2))) == own.follow(np.full((2, 2), np.nan)) != 0
    assert own.follow(case.drives[0].way.points) == 0
    crowd = replace(moving, detections=first.detections * 200)
    walled = replace(moving, polygons=first.polygons * 60)
    never = replace(moving, stamp=np.inf)
    for seen, words in ((crowd, "more detections"), (walled, "more walls"), (never, "stamp")):
        found = own.decide(seen)
        assert status_of(own, found).startswith(words)
        assert found.linear[0] == pytest.approx(0.5 - 0.5 * 0.7) and found.rung == len(RUNGS) - 1
    assert code.wideberth_planner_decide(None, None, None) != 0
    none = own.types.decided()
    assert code.wideberth_planner_decide(own.planner, None, ctypes.byref(none)) != 0
    size = code.wideberth_planner_size()
    assert own.begin(size - 1, own.types.build) != own.begin(size, own.types.build + 1) != 0
    assert own.begin(size, own.types.build) == 0


def status_of(own: Library, found: Any) -> str:
    """Say in words how a decision ended."""
    words: bytes = own.code.wideberth_planner_status_text(found.status)
    assert words.decode() in found.reason.decode() or len(words) > 120
    return words.decode()


@needs_compiler
def test_walls_of_a_costmap_cover_its_cells(cases: dict[str, Case]) -> None:
    """Rectangles of occupied cells: their area is that of the cells, each cell in one of them."""

    class Costmap(ctypes.Structure):
        _fields_ = [
            ("cells", ctypes.c_char_p), ("width", ctypes.c_int), ("height", ctypes.c_int),
            ("resolution", ctypes.c_double), ("origin", ctypes.c_double * 2),
            ("occupied", ctypes.c_int), ("unknown", ctypes.c_int),
        ]  # fmt: skip

    rng = np.random.default_rng(0)
    cells = rng.choice(np.array([0, 100, 253, 254, 255], np.uint8), (12, 17))
    cells[3:6, 2:9] = 254
    own = cases["crowds"].library
    taken, walls = ctypes.create_string_buffer(cells.size), (own.types.wall * 200)()
    near = (ctypes.c_double * 2)(1.0, 1.0)
    given = Costmap(cells.tobytes(), 17, 12, 0.5, (ctypes.c_double * 2)(-2.0, 1.0), 254, 255)
    asked = own.code.wideberth_walls_of
    count = asked(ctypes.byref(given), near, taken, walls, 200)
    boxes = np.array([[list(corner) for corner in wall.at] for wall in walls[:count]])
    low, high = boxes[:, 0], boxes[:, 2]
    assert np.prod(high - low, axis=1).sum() == pytest.approx(0.25 * (cells == 254).sum())
    for row, column in np.argwhere(cells == 254):
        middle = np.array([-2.0, 1.0]) + 0.5 * (np.array([column, row]) + 0.5)
        assert ((low < middle) & (middle < high)).all(axis=1).sum() == 1
    few = (own.types.wall * 3)()
    assert asked(ctypes.byref(given), near, taken, few, 3) == count
    away = np.linalg.norm(np.maximum(0.0, np.maximum(low - 1.0, 1.0 - high)), axis=1)
    kept = np.array([[list(corner) for corner in wall.at] for wall in few])
    far = np.maximum(0.0, np.maximum(kept[:, 0] - 1.0, 1.0 - kept[:, 2]))
    assert np.allclose(np.sort(np.linalg.norm(far, axis=1)), np.sort(away)[:3])
    assert asked(None, near, taken, few, 3) == -1


@needs_compiler
def test_the_example_drives_past_people(cases: dict[str, Case]) -> None:
    place = cases["fast"].place
    made = subprocess.run(
        ["make", "CFLAGS=-O1 -Wall -Wextra -Werror"], cwd=place, capture_output=True, text=True,
        check=False, timeout=120,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    done = subprocess.run(
        [place / "loop"], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0 and "optimal" in done.stdout
    within = float(done.stdout.split("within ")[1].split()[0])
    assert within > 0.75 + 0.3  # both radii


# ---- The controller for Nav2

INCLUDED = (
    "geometry_msgs/msg/pose_stamped", "geometry_msgs/msg/twist_stamped", "nav2_core/controller",
    "nav2_core/controller_exceptions", "nav_msgs/msg/path", "pluginlib/class_list_macros",
    "pluginlib/exceptions",
    "rclcpp/rclcpp", "rclcpp_lifecycle/lifecycle_node", "nav2_dynamic_msgs/msg/obstacle_array",
    "costmap_converter_msgs/msg/obstacle_array_msg",
)  # fmt: skip
LYRICAL = "nav2_ros_common/lifecycle_node"
FLAGS = ("WIDEBERTH_NAV2_DYNAMIC_MSGS", "WIDEBERTH_COSTMAP_CONVERTER_MSGS")


@needs_compiler
@pytest.mark.skipif(CPP is None, reason="there is no C++ compiler here")
@pytest.mark.parametrize(
    ("headers", "kind"),
    [(INCLUDED, "nav2_dynamic_msgs"), ((*INCLUDED, LYRICAL), "costmap_converter_msgs")],
    ids=["jazzy", "lyrical"],
)
def test_the_nav2_controller_drives(
    cases: dict[str, Case], headers: tuple[str, ...], kind: str, tmp_path: Path
) -> None:
    """Past a person and a wall, on a path of another frame; with our headers in place of ROS."""
    helpers, place = REPLAY.parent, cases["crowds"].place
    for name in headers:
        stub = tmp_path / f"{name}.hpp"
        stub.parent.mkdir(parents=True, exist_ok=True)
        stub.write_text('#include "nav2_stub.hpp"\n')
    assert cases["crowds"].library
    words = [f"-D{flag}" for flag in FLAGS] + [f'-DKIND="{kind}"', f"-I{tmp_path}", "-std=c++20"]
    words += ["-DOF_COSTMAP_CONVERTER"] if kind == "costmap_converter_msgs" else []
    sources = [place / "wideberth_nav2.cpp", helpers / "nav2_drive.cpp"]
    call: list[Any] = [
        CPP,
        "-O1",
        "-Wall",
        "-Wextra",
        "-Werror",
        *words,
        f"-I{place}",
        f"-I{helpers}",
    ]
    program = tmp_path / "drive"
    call += ["-o", program, *sources, place / "planner.so", f"-Wl,-rpath,{place}"]
    made = subprocess.run(list(map(str, call)), capture_output=True, text=True, check=False)
    assert made.returncode == 0, made.stderr
    done = subprocess.run([program], capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    none = "no obstacles: the message on obstacles has not come yet"
    assert lines[:2] == ["no path: no path is set", none]
    assert lines[-2].startswith("late: the message on obstacles is 2.")
    assert lines[-1] == "no frame: no transform"
    time, x, y, speed, turn, px, py = np.array([line.split() for line in lines[2:-2]], float).T
    assert abs(x[-1] - 10.0) < 0.1 and abs(y[-1]) < 0.1 and abs(speed[-1]) < 0.02
    assert np.hypot(x - px, y - py).min() > 0.75 + 0.3
    wall = np.hypot(np.maximum(np.maximum(4.0 - x, x - 5.5), 0), np.maximum(y + 1.0, 0))
    assert wall.min() > 0.75  # the wall ends 1 m beside the path, from 4 to 5.5 m along it
    slowed = (time >= 20.0 - 1e-9) & (time < 25.0 - 1e-9)  # 40 % of 0.7 m/s
    assert np.abs(speed[slowed]).max() == pytest.approx(0.28) and np.abs(speed).max() > 0.4
    ramp = ~slowed[1:] & ~slowed[:-1]  # within the robot's limits
    assert np.abs(np.diff(speed))[ramp].max() <= 0.05 * 0.7 + 1e-3
    assert np.abs(np.diff(turn))[ramp].max() <= 0.05 * 0.1 + 1e-3


# ---- What is refused, and what is written

FOOTPRINT = {"radius": 0.3, "centres": [[0, 0]]}
WAYS = {"type": "ways", "region": "mahalanobis_ellipse"}


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("robot", {"robot": "bicycle"}),
        ("robot", {"robot": {"type": "unicycle", "footprint": FOOTPRINT}}),
        ("region", {"region": "minkowski_sum"}),
        ("static_region", {"static_region": "dual"}),
        ("level", {"level": "risk_allocation"}),
        ("cost", {"cost": "contouring"}),
        ("solver", {"solver": "fatrop"}),
        ("deadline", {"deadline": 0.4}),
        ("latency", {"latency": 0.1}),
        ("further_kinds", {"further_kinds": [WAYS], "level": "fixed"}),
        ("expected_contact", {"expected_contact": {"price": 25.0}}),
        ("fallback.stop_at_end", {"fallback": {"stop_at_end": True}}),
    ],
    ids=str,
)  # fmt: skip
def test_what_the_library_lacks_is_refused_by_name(name: str, settings: dict[str, Any]) -> None:
    with pytest.raises(WideberthError, match=f"{name} is ") as error:
        whole_planner(planner(**settings), "test")
    assert all(f"{known}: " in str(error.value) for known in SUPPORTED)


@pytest.mark.parametrize("predictor", ["adaptive_conformal", "imm", "corrected", "var"])
def test_another_predictor_is_refused_with_the_setting_to_write(
    predictor: str, tmp_path: Path
) -> None:
    path = "planners.default.predictor"
    with pytest.raises(WideberthError, match=f"^{path} is {predictor};") as error:
        export("crossing", [f"{path}={predictor}"], tmp_path / "c", whole=True)
    assert str(error.value).endswith(f"--set {path}=kalman")
    assert not list(tmp_path.iterdir())


def test_the_same_planner_gives_the_same_bytes(cases: dict[str, Case]) -> None:
    case = cases["crowds"]
    again = bundle(whole_planner(case.planner, "test"))
    assert {"README.md", "manifest.json", "wideberth_planner.h", "loop.c"} <= set(again)
    for name, content in again.items():
        text = content if isinstance(content, bytes) else content.encode()
        assert (case.place / name).read_bytes() == text, name
