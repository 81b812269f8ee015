"""Strategies of Hypothesis for absurd observations, worlds, scans, messages and configs.

Numbers have magnitudes from 5e-324 to 1.7e308, and at places are none. Bulk, as of a scan, comes
from a drawn seed; Hypothesis draws what is absurd of it.
"""

import dataclasses
import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
from hypothesis import strategies as st

from wideberth.experiments.engine.shipped_configs import config_path, shipped
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth.framework.values.tracks import Tracks
from wideberth.tests.helpers.rays import ranges

Draw = Callable[[st.SearchStrategy[Any]], Any]
LARGEST = 1.7e308
NUMBERS = st.floats()
POWERS = st.sampled_from((-323, -308, -300, -160, -100, -31, -20, -6, -3, 3, 6, 9, 20, 100, 154,
                          200, 300, 308))  # fmt: skip
GENERATORS = st.integers(0, 2**32 - 1).map(np.random.default_rng)
ONCE = st.sampled_from((0, 0, 0, 0, 0, 1, 2))
"""How many numbers of an array are absurd."""
HALL = np.array([(-4.0, -3.0), (12.0, -3.0), (12.0, 4.0), (-4.0, 4.0), (-4.0, -3.0)])
"""m, corners of the room that scans show."""
FRAMES = st.sampled_from(("", "moon", "map", "odom", "base_link"))
ABSURD = st.sampled_from((
    "1e999", "-1", "0", ".nan", ".inf", "''", "[]", "{}", "null", "true", "1e-320", "9" * 5001,
    "x" * 300, "../../etc", "[[[[[", "{a: 1, a: 2}", "&a [*a]", "!!python/object:os.system x",
    "-1.0e+308", "99999999999", "'\\0'", "0x7fffffffffffffff", "2026-01-01", "1:2:3", "* ", "? ",
))  # fmt: skip


def rarely(draw: Draw, share: int = 10) -> bool:
    """Draw whether something happens that does so once in ``share`` times."""
    return bool(draw(st.integers(1, share)) == share)


def magnitude(draw: Draw, usual: bool = True) -> float:
    """Draw a power of ten, 1 in two of three cases if that is usual."""
    return 1.0 if usual and draw(st.integers(0, 2)) else float(10.0 ** draw(POWERS))


def scaled(values: Array, factor: float) -> Array:
    """Multiply within the range of a float."""
    with np.errstate(all="ignore"):
        return np.clip(np.nan_to_num(values * factor), -LARGEST, LARGEST)


def spoilt(draw: Draw, values: Any, with_: st.SearchStrategy[float] = NUMBERS) -> Array:
    """Put absurd numbers at some places of an array."""
    found = np.array(values, float)
    for _ in range(draw(ONCE) if found.size else 0):
        found.flat[draw(st.integers(0, found.size - 1))] = draw(with_)
    return found


def accepted(kind: Callable[[Any], Any], *given: Any) -> Any:
    """Make a value, or None where its constructor refuses what it is given."""
    try:
        return kind(*given)
    except WideberthError:
        return None


@st.composite
def covariances(draw: Draw, size: int) -> Array:
    """Draw a covariance, (D, D), of any magnitudes along any axes."""
    basis, _ = np.linalg.qr(draw(GENERATORS).standard_normal((size, size)))
    values = np.array([min(1e-4 * magnitude(draw), 1e307) for _ in range(size)])
    values[0] *= not rarely(draw)
    whole = (basis * values) @ basis.T
    return np.asarray(0.5 * whole + 0.5 * whole.T)


def wrong_covariances(size: int) -> st.SearchStrategy[Any]:
    """Draw a matrix that is asymmetric, indefinite or not finite, or none."""
    rows = st.lists(NUMBERS, min_size=size, max_size=size)
    return st.none() | st.lists(rows, min_size=size, max_size=size).map(np.array)


@st.composite
def paths(draw: Draw, size: int) -> Path:
    """Draw a path: ordinary, tiny, huge, doubled back or with hundreds of corners."""
    count = draw(st.sampled_from((2, 3, 10, 300)))
    points = scaled(draw(GENERATORS).normal(scale=5.0, size=(count, size)), magnitude(draw))
    points[-1] = points[0] if rarely(draw) else points[-1]
    return accepted(Path, points) or Path(np.stack([np.zeros(size), np.ones(size)]))


@st.composite
def polygons(draw: Draw) -> Polygon | None:
    """Draw a polygon, thin, tiny, huge or starred."""
    rng, corners = draw(GENERATORS), draw(st.sampled_from((3, 4, 8, 40)))
    angles = np.sort(rng.uniform(0.0, 2 * np.pi, corners))
    points = rng.uniform(0.2, 1.0, (corners, 1)) * np.stack([np.cos(angles), np.sin(angles)], 1)
    points[:, 0] *= draw(st.sampled_from((1.0, 1.0, 1e-3, 1e-5)))
    points = scaled(points, magnitude(draw)) + rng.normal(0, 3, 2)
    return accepted(Polygon, tuple(map(tuple, points.tolist())))


@st.composite
def stamps(draw: Draw, stamp: float, period: float) -> float:
    """Draw the next instant: usually one period on, else a repeat, a jump or a step back."""
    jumps = (0.0, 1e-300, 1e-9, 10.0, 1e6, 1e9, 1e17, 1e300, 1.7e308, -0.1, -1e9, -1e300)
    step = draw(st.sampled_from(jumps)) if rarely(draw, 5) else period
    return float(np.clip(stamp + step, -1e308, LARGEST))


@st.composite
def detections(draw: Draw, size: int, here: Array) -> Detection:
    """Draw one obstacle: repeated names, ages, places and covariances of any magnitude."""
    size = 5 - size if rarely(draw) else size
    free = draw(GENERATORS).normal(scale=4.0, size=size)
    position = spoilt(draw, here if rarely(draw) and len(here) == size else free)
    covariance = draw((wrong_covariances if rarely(draw) else covariances)(size))
    radius = draw(st.floats(0.1, 0.7)) if not rarely(draw, 20) else draw(NUMBERS)
    age = draw(st.sampled_from((0.0, 0.0, 0.1, 1.0, 2.9, 3.1, 1e6, 1e300, 5e-324)))
    name = str(draw(st.integers(0, 9)))
    return Detection(name, position, covariance, radius, age, draw(st.sampled_from(("", name))))


@st.composite
def observations(draw: Draw, robot: Robot, stamp: float, walls: bool) -> Observation:
    """Draw what a robot sees on a very bad day: nobody, or hundreds at the same place."""
    bounds = robot.state_bounds()
    low, high = np.clip(np.array([bounds.lower, bounds.upper], float), -5.0, 5.0)
    state = spoilt(draw, low + draw(GENERATORS).random(len(low)) * (high - low))
    place = robot.pose(tuple(np.nan_to_num(state, posinf=0.0, neginf=0.0))).points()
    seen = draw(st.lists(detections(robot.dimension, place), max_size=6))
    seen *= draw(st.sampled_from((1, 1, 1, 50)))
    known = draw(st.none() | covariances(len(state)))
    around = draw(st.lists(polygons(), max_size=3)) if walls else ()
    return Observation(stamp, state, tuple(seen), known, tuple(filter(None, around)))


@st.composite
def worlds(draw: Draw) -> tuple[Tracks, int, Scene | None]:
    """Draw tracks of any magnitudes, how many steps to forecast, and a scene or none."""
    size, count = draw(st.sampled_from((2, 2, 3))), draw(st.integers(1, 4))
    rows, rng = draw(st.sampled_from((1, 2, 3, 9, 30, 60))), draw(GENERATORS)
    base = rng.standard_normal((count, rows, size))
    walk: Callable[[Array], Array] = draw(st.sampled_from((
        lambda one: one, partial(np.cumsum, axis=1), lambda one: one[:, :1] + 0.0 * one,
        lambda one: np.arange(rows)[None, :, None] * one[:, :1],
    )))  # fmt: skip
    finite = st.floats(-LARGEST, LARGEST)
    positions = np.stack([scaled(one, magnitude(draw)) for one in walk(base)])
    positions = spoilt(draw, positions, finite)
    positions[rng.random((count, rows)) < draw(st.sampled_from((0.0, 0.1, 0.6)))] = np.nan
    noise = np.stack([draw(covariances(size)) for _ in range(count)])
    tracker = [draw(covariances(2 * size)) for _ in range(count)] if rarely(draw, 5) else None
    dt = draw(st.sampled_from((1e-300, 1e-6, 1e-5, 1e-3, 0.1, 0.4, 1.0, 10.0, 1e3, 1e4, 1e300)))
    radius = np.full(count, min(0.3 * magnitude(draw), 1e308))
    stamp = draw(st.sampled_from((0.0, 0.0, 1e9, -1e17, 1e300)))
    ids = tuple(str(k) for k in range(count))
    tracks = Tracks(positions, dt, ids, radius, noise, stamp,
                    None if tracker is None else np.stack(tracker))  # fmt: skip
    scene = Scene(
        ego=scaled(rng.standard_normal(5), magnitude(draw)),
        goals=scaled(rng.standard_normal((count, size)), magnitude(draw)),
        plan=scaled(rng.standard_normal((8, size)).cumsum(axis=0), magnitude(draw)),
        radius=min(0.4 * magnitude(draw), 1e308),
    )
    return tracks, draw(st.sampled_from((1, 6, 15))), draw(st.sampled_from((None, scene)))


def around(beams: int) -> Array:
    """Return the bearings of a full turn, (B,), rad."""
    return np.asarray(-np.pi + 2.0 * np.pi / max(beams, 1) * np.arange(beams))


@st.composite
def measured(draw: Draw, pose: Array, beams: int) -> Array:
    """Draw ranges, (B,), m, in a hall among people; some are absurd."""
    rng, walls = draw(GENERATORS), np.stack([HALL[:-1], HALL[1:]], axis=1)
    people = rng.uniform((-3.0, -2.0), (9.0, 3.0), (draw(st.integers(0, 5)), 2))
    found = ranges(pose[:2], around(beams) + pose[2], people, 0.3, walls)
    found = found + 0.01 * rng.standard_normal(beams)
    found[rng.random(beams) < draw(st.sampled_from((0.0, 0.0, 0.02, 0.3, 1.0)))] = draw(NUMBERS)
    return found


@st.composite
def scans(draw: Draw, stamp: float, pose: Array, beams: int = 180) -> tuple[Scan | None, Array]:
    """Draw a turn of a LiDAR, unless it is refused, and the pose of each beam."""
    turn = np.linspace(-0.05, 0.0, beams)
    times = scaled(stamp + 2 * turn, magnitude(draw, not rarely(draw)))
    longest = draw(st.sampled_from((15.0, 15.0, 15.0, 1e-300, 1e9, 1e154, 1.7e308)))
    mount, bearings = spoilt(draw, (0.2, 0.0, 0.1)), spoilt(draw, around(beams))
    lidar = partial(Scan, "lidar", times, bearings, longest=longest, mount=mount)
    scan = accepted(lidar, draw(measured(pose, beams)))
    poses = spoilt(draw, pose + turn[:, None] * np.array([1.0, 0.0, 0.3]))
    if rarely(draw, 5):
        poses[:, draw(st.integers(0, 2))] = draw(NUMBERS)
    return scan, poses


def leaves(message: Any) -> Iterator[tuple[Callable[[Any], None], type]]:
    """Yield how each number and each text of a message is set, and its type."""
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            yield from ((partial(value.__setitem__, k), float) for k in range(len(value)))
        elif dataclasses.is_dataclass(value) or isinstance(value, list):
            for one in value if isinstance(value, list) else [value]:
                yield from leaves(one) if dataclasses.is_dataclass(one) else ()
        elif isinstance(value, float | str) or field.name == "sec":
            kinds = (kind for kind in (float, str, int) if isinstance(value, kind))
            yield partial(setattr, message, field.name), next(kinds)


@st.composite
def corrupted(draw: Draw, message: Any) -> Any:
    """Put absurd numbers, stamps and frames at some places of a message."""
    places = list(leaves(message))
    kinds = {float: NUMBERS, str: FRAMES, int: st.integers(-(2**31), 2**31 - 1)}
    for _ in range(draw(ONCE) if places else 0):
        put, kind = places[draw(st.integers(0, len(places) - 1))]
        with np.errstate(all="ignore"):  # in single precision some are infinite
            put(draw(kinds[kind]))
    return message


@st.composite
def configs(draw: Draw) -> bytes:
    """Draw a shipped config that is changed in up to four places."""
    lines = config_path(draw(st.sampled_from(shipped()))).read_text().splitlines()
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    for _ in range(draw(st.integers(1, 4))):
        at, value = draw(st.integers(0, len(lines) - 1)), draw(ABSURD)
        line = lines[at]
        changes = [f"{line.partition(':')[0]}: {value}", f"   {line}", f"{line}\n{line}", "",
                   re.sub(r"\d[\d.e+-]*", lambda _, value=value: value, line, count=1),
                   f"{'  ' * draw(st.integers(0, 2))}unheard_of: {value}\n{line}"]  # fmt: skip
        lines[at] = draw(st.sampled_from(changes))
    text, cut = "\n".join(lines).encode(), draw(st.integers(0, 999))
    return text[:cut] + draw(st.binary(max_size=8)) + text[cut:] if rarely(draw) else text
