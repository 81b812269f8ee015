"""The exported planner as a library, and drives of Python's planner to hold it against.

Nothing in the drives depends on the clock: planners have no deadline, so that neither watchdog nor
starting points are cut short.
"""

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from wideberth.framework.control.rate_limited_warnings import quiet
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.numerics.geometry import plane_turn
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import start_state
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path as Way
from wideberth.framework.values.polygon import Polygon
from wideberth.solvers.export.bundle import write_folder
from wideberth_embedded.files import SOURCES, bundle
from wideberth_embedded.tables import NAV2
from wideberth_embedded.whole import whole_planner

COMPILER = shutil.which("cc")
STRICT = "-std=c99 -Wall -Wextra -Wpedantic -Werror -ffp-contract=off -fPIC".split()
REPLAY = Path(__file__).with_name("planner_replay.c")
FORECASTS = Path(__file__).with_name("planner_forecasts.c")


def planner(**settings: Any) -> Planner:
    """Return our recommended planner of a unicycle at 0.5 m/s, but with `kalman`."""
    given = {
        "type": "recommended", "robot": "unicycle", "reference_speed": 0.5, "predictor": "kalman",
        **settings,
    }  # fmt: skip
    made: Planner = build("controllers", given)
    return made


def exported(made: Planner, place: Path, package: str = NAV2) -> Path:
    """Write the bundle of a planner into a new folder."""
    whole = whole_planner(made, "test", package=package)
    write_folder(place, bundle(whole), force=False)
    return place


def compiled(place: Path, out: str, *words: str) -> Path:
    """Compile a bundle, with further sources and flags, to a file beside it."""
    assert COMPILER is not None
    call = [COMPILER, *STRICT, *words, "-o", out, *SOURCES, "-lm"]
    done = subprocess.run(call, cwd=place, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return place / out


def library(place: Path) -> "Library":
    """Compile a bundle to a shared library, and begin a planner of it."""
    return Library(compiled(place, "planner.so", "-O1", "-shared"), place)


class Structures:
    """The structures of one export's header, and observations as it has them."""

    def __init__(self, place: Path) -> None:
        text = (place / "wideberth_planner.h").read_text()
        found = re.findall(r"#define WIDEBERTH_(\w+)\s+(?:UINT64_C\()?(\d+)[)\s]", text)
        size = {name: int(value) for name, value in found}
        real, whole = ctypes.c_double, ctypes.c_int
        self.build = size["PLAN_BUILD"]

        class Detected(ctypes.Structure):
            _fields_ = [("name", ctypes.c_char * size["NAME"]), ("position", real * 2),
                        ("covariance", real * 4), ("radius", real), ("age", real)]  # fmt: skip

        class Wall(ctypes.Structure):
            _fields_ = [("corners", whole), ("at", real * 2 * size["CORNERS"])]

        class Seen(ctypes.Structure):
            _fields_ = [
                ("stamp", real), ("state", ctypes.POINTER(real)), ("obstacles", whole),
                ("detections", ctypes.POINTER(Detected)), ("polygons", whole),
                ("walls", ctypes.POINTER(Wall)),
            ]  # fmt: skip

        class Decided(ctypes.Structure):
            _fields_ = [
                ("linear", real * 2), ("omega", real), ("ramp", real), ("status", whole),
                ("rung", whole), ("iterations", whole), ("starts", whole), ("left_out", whole),
                ("violation", real), ("level", real), ("cost", real),
                ("states", real * size["PLAN_STATES"] * (size["PLAN_HORIZON"] + 1)),
                ("inputs", real * size["PLAN_INPUTS"] * size["PLAN_HORIZON"]),
                ("reason", ctypes.c_char * 160),
            ]  # fmt: skip

        self.detection, self.wall, self.seen, self.decided = Detected, Wall, Seen, Decided

    def people(self, seen: Observation) -> Any:
        """Detections of an observation."""
        made = (self.detection * len(seen.detections))()
        for place, one in zip(made, seen.detections, strict=True):
            assert one.covariance is not None
            place.name, place.radius, place.age = one.ident.encode(), one.radius, one.age
            place.position[:], place.covariance[:] = one.position, one.covariance.ravel()
        return made

    def walls(self, seen: Observation) -> Any:
        """Walls of an observation."""
        made = (self.wall * len(seen.polygons))()
        for place, one in zip(made, seen.polygons, strict=True):
            place.corners = len(one.vertices)
            for corner, vertex in zip(place.at, one.vertices, strict=False):
                corner[:] = vertex
        return made

    def written(self, seen: Observation) -> bytes:
        """Return an observation as `planner_replay.c` reads it."""
        people, walls = self.people(seen), self.walls(seen)
        counts = np.array([len(people), len(walls)], np.int32).tobytes()
        head = np.array([seen.stamp, *seen.state]).tobytes()
        return head + counts + bytes(people) + bytes(walls)


class Library:
    """One planner of a compiled library.

    Attributes
    ----------
    code : the library's functions. planner : its address. place : folder of the export.
    """

    def __init__(self, file: Path, place: Path) -> None:
        self.place = place
        self.code: Any = ctypes.CDLL(str(file))
        self.types = Structures(place)
        self.code.wideberth_planner_size.restype = ctypes.c_size_t
        self.code.wideberth_planner_status_text.restype = ctypes.c_char_p
        self.code.wideberth_spin_rate.restype = ctypes.c_double
        size = self.code.wideberth_planner_size()
        self._memory = ctypes.create_string_buffer(size)
        self.planner = ctypes.c_void_p()
        assert self.begin(size, self.types.build) == 0

    def begin(self, size: int, build: int) -> int:
        """Begin a planner in so many bytes; return the status."""
        given = self._memory, ctypes.c_size_t(size), ctypes.c_uint64(build)
        return int(self.code.wideberth_planner_begin_as(*given, ctypes.byref(self.planner)))

    def follow(self, points: Array) -> int:
        """Set a path; return the status."""
        given = np.ascontiguousarray(points, np.float64)
        place = given.ctypes.data_as(ctypes.c_void_p)
        return int(self.code.wideberth_planner_set_path(self.planner, place, len(given)))

    def decide(self, seen: Observation, *, remember: bool = False) -> Any:
        """Decide and return the decision; or take note alone."""
        types, found = self.types, self.types.decided()
        people, walls = types.people(seen), types.walls(seen)
        state = (ctypes.c_double * len(seen.state))(*seen.state)
        given = types.seen(seen.stamp, state, len(people), people, len(walls), walls)
        if remember:
            self.code.wideberth_planner_remember(self.planner, ctypes.byref(given))
            return None
        self.code.wideberth_planner_decide(self.planner, ctypes.byref(given), ctypes.byref(found))
        return found

    def approach(self, pose: Array, wanted: Array) -> Array:
        """Return a velocity (3,) slowed down near the end of the path."""
        found = (ctypes.c_double * 3)()
        given = (ctypes.c_double * 3)(*pose), (ctypes.c_double * 3)(*wanted), found
        assert self.code.wideberth_planner_approach(self.planner, *given) == 0
        return np.array(found)

    def arrived(self, place: Array, tolerance: float) -> bool:
        """Return whether a robot at a place (2,) is at the end of the path."""
        given = (ctypes.c_double * 2)(*place), ctypes.c_double(tolerance)
        return bool(self.code.wideberth_planner_arrived(self.planner, *given))

    def spin(self, off: float, period: float) -> float:
        """Return the yaw rate of a turn on the spot."""
        given = ctypes.c_double(off), ctypes.c_double(period)
        return float(self.code.wideberth_spin_rate(*given))

    def next(self, last: Array, wanted: Array, period: float) -> Array:
        """Return the velocity (3,) that the robot can have a period after the last one."""
        found = (ctypes.c_double * 3)()
        given = (ctypes.c_double * 3)(*last), (ctypes.c_double * 3)(*wanted)
        self.code.wideberth_next_velocity(*given, ctypes.c_double(period), found)
        return np.array(found)

    def replayed(self, drive: "Drive") -> list[Any]:
        """Decide on what Python's planner saw in a drive."""
        self.code.wideberth_planner_reset(self.planner)
        assert self.follow(drive.way.points) == 0
        for one in drive.before:
            self.decide(one, remember=True)
        return [self.decide(tick.seen) for tick in drive.ticks]


@dataclass(frozen=True)
class Tick:
    """One call of a planner: what was seen, and what Python made of it."""

    seen: Observation
    command: tuple[float, ...]
    rung: str
    iterations: int


@dataclass(frozen=True)
class Drive:
    """A path, what was remembered before the first decision, and the decisions."""

    way: Way
    before: tuple[Observation, ...]
    ticks: tuple[Tick, ...]

    def written(self, types: Structures) -> bytes:
        """Return the drive as `planner_replay.c` reads it."""
        points = np.ascontiguousarray(self.way.points)
        counts = np.array([len(points), len(self.before), len(self.ticks)], np.int32)
        seen = [*self.before, *(tick.seen for tick in self.ticks)]
        return counts.tobytes() + points.tobytes() + b"".join(map(types.written, seen))


@dataclass(frozen=True)
class Scene:
    """What a drive meets.

    Attributes
    ----------
    people : who walk at random, and are seen now and then. walls : at random beside the path.
    close : whether people start round the robot. late : whether detections have ages.
    odd : share of detections of which a number is of no use, or whose name is another's.
    period : s between decisions.
    turned : rad, by which the robot looks away from its path at first.
    events : decision -> what becomes of its observation.
    """

    people: int
    walls: int = 0
    close: bool = False
    late: bool = False
    odd: float = 0.0
    period: float = 0.5
    turned: float = 0.0
    events: Mapping[int, Callable[[Observation], Observation]] = field(default_factory=dict)

    def seen(self, rng: np.random.Generator) -> Iterator[tuple[Any, Any]]:
        """Yield detections and walls of each tick."""
        low, high = ((0, -2), (6, 2)) if self.close else ((-2, -4), (12, 4))
        at, speed = rng.uniform(low, high, (self.people, 2)), rng.normal(0, 0.6, (self.people, 2))
        walls = tuple(_wall(rng, k) for k in range(self.walls))
        for tick in range(10_000):
            at, speed = at + self.period * speed, speed + rng.normal(0, 0.1, speed.shape)
            there = [k for k in range(self.people) if rng.uniform() > 0.15]
            yield (
                tuple(
                    self._detection(rng, k, at[k])
                    for k in there
                    if k != 1 or tick % 20 < 11  # he goes, is forgotten, and comes back
                ),
                walls,
            )

    def _detection(self, rng: np.random.Generator, k: int, at: Array) -> Detection:
        spread = np.array([[2e-4, 5e-5], [5e-5, 1e-4]]) if k % 2 else 1e-4 * np.eye(2)
        # At most a period: the library leaves out what comes after a newer measurement.
        ages = self.period * np.array([0.0, 0.0, 0.1, 0.26, 1.0])
        age = float(rng.choice(ages)) if self.late else 0.0
        place = at + 0.01 * rng.standard_normal(2)
        one = Detection(f"person {k}", place, spread, 0.3, age)
        odd: list[dict[str, Any]] = [
            {"ident": "person 0"}, {"radius": -1.0}, {"age": 3.5}, {"age": -1.0},
            {"position": np.full(2, np.nan)}, {"covariance": np.array([[1.0, 2.0], [2.0, 1.0]])},
        ]  # fmt: skip
        if rng.uniform() >= self.odd:
            return one
        return replace(one, **odd[int(rng.integers(len(odd)))])


def _wall(rng: np.random.Generator, k: int) -> Polygon:
    """Return a triangle or a quadrilateral that leaves the path free, in either orientation."""
    centre, size = rng.uniform((0, -4), (12, 4)), rng.uniform(0.1, 0.9)
    centre[1] = np.sign(centre[1]) * max(abs(centre[1]), 1.3)
    angles = rng.uniform(0, 6) + np.array([0.0, 2.0, 4.1] if k % 3 == 2 else [0.0, 1.3, 3.1, 4.5])
    corners = centre + size * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return Polygon(
        tuple((float(x), float(y)) for x, y in corners[:: 1 - 2 * (k % 2)]), f"wall {k}"
    )


def driven(made: Planner, scene: Scene, seed: int, count: int) -> Drive:
    """Let Python's planner drive its own model, pushed a little, for ``count`` decisions."""
    rng, before, period = np.random.default_rng(seed), 5, scene.period
    way = Way(np.array([(0.0, 0.0), (6.0, 1.0), (12.0, 0.0)]))
    assert made.deadline is None
    made.reset()
    made.set_path(way)
    along = plane_turn(scene.turned) @ way.direction(np.zeros(1))[0]
    here = np.array(start_state(made.robot, way.points[0], along, 0.2)[0], float)
    remembered, ticks = [], []
    with quiet():
        for k, (people, walls) in zip(range(before + count), scene.seen(rng), strict=False):
            one = Observation(period * k, here, people, polygons=walls)
            if k < before:
                made.remember(one)
                remembered.append(one)
                continue
            one = scene.events.get(k - before, _as_it_is)(one)
            command = made.command(one)
            plan = made.plan
            assert plan is not None
            numbers = *command.linear, command.omega, command.ramp
            ticks.append(Tick(one, numbers, str(plan.rung), plan.iterations))
            share = min(period / made.dt, 1.0)
            moved = (1.0 - share) * here + share * plan.states[1]
            here = moved + 0.003 * rng.standard_normal(len(here))
    return Drive(way, tuple(remembered), tuple(ticks))


def _as_it_is(seen: Observation) -> Observation:
    return seen


def differences(drives: Sequence[Drive], commands: Array) -> Array:
    """Largest difference of each command (K, 4) from Python's."""
    wanted = np.array([tick.command for drive in drives for tick in drive.ticks])
    return np.asarray(np.abs(wanted - commands).max(axis=1))
