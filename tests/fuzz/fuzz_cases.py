"""Absurd input for planners, rivals, predictors and configs, each case from one seed.

Nodes and detectors have theirs in `fuzz_scans`.

A case is a short run whose numbers all come from its seed, so that it can be repeated alone.
"""

import re
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path as File
from time import perf_counter, process_time
from typing import Any

import numpy as np

from wideberth.experiments.engine.shipped_configs import config_path, read_experiment, shipped
from wideberth.framework.control.command_limits import broken_limit
from wideberth.framework.controller import Controller, DrivesRobot
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import names
from wideberth.framework.predictor import Adaptive
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.tracks import Tracks

DEADLINE = 0.45
"""s for one call of a planner, the paper's."""
SECONDS = 5.0
"""s of processor time for one predictor call or one config."""
TICKS = 25
"""Calls of a controller in one case."""
BATCH = 50
"""Predictor calls in one case."""
EXPONENTS = (-323, -308, -300, -200, -160, -100, -31, -20, -6, -3, 0, 0, 0, 3, 6, 9, 20, 100, 154,
             200, 300, 308)  # fmt: skip
INSIDE = re.compile(r"\b(?!WideberthError)[A-Z]\w*(?:Error|Warning|Exception|Interrupt)\b")
"""An exception or a warning that a controller has caught and made the reason of a status."""
LARGEST = 1.7e308
CONTROLLERS = ("planner", "optional", "rival")
"""Kinds of cases that call a controller."""

Rng = np.random.Generator


@dataclass(frozen=True)
class Call:
    """How one call ended.

    Attributes
    ----------
    what : part under test.
    fault : "" or one of raised, caught, contract, nan, late, config.
    detail : of the fault.
    clock, processor : s.
    limit : s that it was allowed, 0 for none.
    """

    what: str
    fault: str
    detail: str
    clock: float
    processor: float
    limit: float


def timed(what: str, call: Callable[[], tuple[str, str]], limit: float) -> Call:
    """Make one call; what it raises, and NumPy's warnings, are faults.

    Late is more than twice the limit by the clock *and* in processor time of the process: on a
    machine that others use too the clock alone accuses the machine. More than ten times the
    limit by the clock is late whatever the processor did.
    """
    clock, processor = perf_counter(), process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            fault, detail = call()
    except Exception as error:
        fault, detail = "raised", f"{type(error).__name__}: {error}"
    clock, processor = perf_counter() - clock, process_time() - processor
    if not fault and limit and (min(clock, processor) > 2 * limit or clock > 10 * limit):
        fault, detail = "late", f"{clock:.3g} s, {processor:.3g} s of processor time"
    return Call(what, fault, detail[:300], clock, processor, limit)


def magnitude(rng: Rng, usual: float = 0.6) -> float:
    """Draw a power of ten, usually 1."""
    return 1.0 if rng.random() < usual else float(10.0 ** rng.choice(EXPONENTS))


def scaled(values: Array, factor: float) -> Array:
    """Multiply within the range of a float."""
    with np.errstate(all="ignore"):
        return np.clip(np.nan_to_num(values * factor), -LARGEST, LARGEST)


def spread(rng: Rng, size: int, usual: float = 0.6) -> Array:
    """Draw a covariance, (D, D), of any magnitudes along any axes."""
    basis, _ = np.linalg.qr(rng.standard_normal((size, size)))
    values = np.array([min(1e-4 * magnitude(rng, usual), 1e307) for _ in range(size)])
    if rng.random() < 0.5:
        values[:] = values[0]
    if rng.random() < 0.1:
        values[0] = 0.0
    whole = (basis * values) @ basis.T
    return np.asarray(0.5 * whole + 0.5 * whole.T)


def one_of(rng: Rng, *values: Any) -> Any:
    """Draw one of these values."""
    return values[int(rng.integers(len(values)))]


def setups() -> list[dict[str, Any]]:
    """Return the planners: every region and robot, each solver, walls, and presets."""
    robots = names("robots")
    made: list[tuple[str, str, str, str | None]] = []
    for index, region in enumerate(names("regions")):
        for turn, solver in enumerate(("riccati", "fatrop")):
            robot = robots[(index + turn) % len(robots)]
            if "3d" in robot and 3 not in build("regions", region).dimensions:
                robot = "unicycle"
            made.append((region, robot, solver, None))
    for index, region in enumerate(("mahalanobis_ellipse", "minkowski_sum", "half_plane")):
        made.append((region, robots[index], "ipopt", None))
    for index, wall in enumerate(names("static_regions")):
        made.append(("mahalanobis_ellipse", "unicycle", ("riccati", "fatrop")[index % 2], wall))
    return [options(k, *entry) for k, entry in enumerate(made)]


def options(index: int, region: str, robot: str, solver: str, wall: str | None) -> dict[str, Any]:
    """Draw what else a planner has; the same in every run."""
    rng = np.random.default_rng([7, index])
    predictors = [name for name in names("predictors") if name != "game"]
    levels = ("fixed", "relaxed", {"type": "relaxed", "tail": 0.05, "weight": 1.0, "minimum": 0.0})
    settings = {
        "type": "mpc",
        "robot": robot,
        "region": region,
        "solver": solver,
        "predictor": predictors[index % len(predictors)],
        "level": one_of(rng, *levels),
        "penalty": one_of(rng, None, 1e4, 1e5),
        "horizon": one_of(rng, 5, 8, 15),
        "period": one_of(rng, 0.1, 0.5),
        "deadline": DEADLINE,
        "latency": one_of(rng, 0.0, 0.2, 5.0),
        "margin": one_of(rng, 0.0, 0.1, 10.0),
        "fallback": {"stop_at_end": one_of(rng, True, False)},
        "own_uncertainty": one_of(rng, "open-loop", "feedback"),
        "starts": one_of(rng, "auto", []),
        "most_obstacles": one_of(rng, 1, 2, 5),
    }
    return settings | ({"static_region": wall} if wall else {})


UNICYCLES = ("acp", "cc", "ecp", "fcp", "nav2")
"""Rivals that drive no robot without a heading; all but the last want it to turn on the spot."""


def rivals() -> list[dict[str, Any]]:
    """Return the other registered controllers, each with a robot that it drives."""
    flat = [name for name in names("robots") if "3d" not in name]
    found = []
    for index, name in enumerate(n for n in names("controllers") if n != "mpc"):
        robot = "unicycle" if name in UNICYCLES else flat[index % len(flat)]
        one: dict[str, Any] = {"type": name, "robot": robot}
        if name in ("around_crowds", "withdrawing"):
            one = {"type": name, "controller": {"type": "orca", "robot": robot}}
        if name == "policy":
            one["policy"] = "fuzz_cases:straight_on"
        found.append(one)
    return found


def straight_on(shown: dict[str, Array]) -> Array:
    """Return an action of absurd size, as a policy out of its depth might."""
    return np.asarray(1e300 * shown["goal"])


WAYS = {"type": "ways", "region": "mahalanobis_ellipse"}
BETWEEN = {"type": "between_steps", "region": "mahalanobis_ellipse"}
OPTIONS: dict[str, dict[str, Any]] = {
    "none": {},
    "hard regions": {"penalty": None},
    "relaxed level": {"level": "relaxed"},
    "ways": {"further_kinds": [WAYS]},
    "withdraw": {"withdraw": True},
    "between_steps": {"further_kinds": [BETWEEN]},
    "stop_at_end": {"fallback": {"stop_at_end": True}},
    "steps_at_rest": {"fallback": {"stop_at_end": True, "steps_at_rest": 2}},
    "latency": {"latency": 0.3},
    "own_uncertainty": {"own_uncertainty": "feedback"},
    "starts": {"starts": ["along", "left", "right", "back-left", "back-right", "wait", "coast",
                          "turn"]},
    "forwards": {"robot": {"type": "unicycle", "max_reverse_speed": 0.0}},
    "contouring": {"cost": "contouring"},
    "no deadline": {"deadline": None},
    "all": {"further_kinds": [WAYS], "withdraw": True, "fallback": {"stop_at_end": True},
            "latency": 0.3,
            "own_uncertainty": "feedback", "static_region": "separating_line"},
}  # fmt: skip
"""Optional settings of the planner, each on by itself, and all of those that go together."""
FEW = ("none", "ways")
"""Those that are tried with every solver."""


@cache
def optional() -> list[tuple[str, dict[str, Any]]]:
    """Return planners with each optional setting, and with each solver, and what they are."""
    plain = {"type": "mpc", "robot": "unicycle", "region": "mahalanobis_ellipse",
             "predictor": "imm", "level": "fixed", "penalty": 1e4, "horizon": 10, "period": 0.2,
             "deadline": DEADLINE, "most_obstacles": 5}  # fmt: skip
    every = ("riccati", "fatrop")
    pairs = [(solver, option) for solver in every for option in OPTIONS]
    pairs += [(one, option) for one in names("solvers") if one not in every for option in FEW]
    return [
        (f"{solver} with {option}", plain | {"solver": solver} | OPTIONS[option])
        for solver, option in pairs
    ]


@cache
def controller(kind: str, index: int) -> Controller:
    """Build a controller and compile what it needs; kept for later cases."""
    lists = {"planner": setups, "rival": rivals}
    settings = optional()[index][1] if kind == "optional" else lists[kind]()[index]
    made: Controller = build("controllers", settings)
    made.set_path(Path(5.0 * np.eye(robot_of(made).dimension)[:1] * [[-1.0], [1.0]]))
    return made


def robot_of(made: Controller) -> Robot:
    """Return the robot of a registered controller: all of them have one."""
    assert isinstance(made, DrivesRobot)
    return made.robot


def controller_case(kind: str, index: int, seed: int) -> Iterator[Call]:
    """Call a controller `TICKS` times with absurd observations."""
    rng = np.random.default_rng([1, index, seed])
    made = controller(kind, index)
    made.reset()
    robot, stamp = robot_of(made), 0.0
    settings = vars(made)
    name = label(kind, index)
    walls = kind != "rival" and settings.get("static_region") is not None
    limit = SECONDS if settings.get("deadline") is None else DEADLINE
    yield timed("path", lambda: (made.set_path(draw_path(rng, robot.dimension)), ("", ""))[1], 0.0)
    for _ in range(TICKS):
        stamp = draw_stamp(rng, stamp, made.period)
        seen = draw_observation(rng, robot, stamp, walls)
        yield timed(name, lambda seen=seen: judged(made, robot, seen), limit)


def label(kind: str, index: int) -> str:
    """Return what a controller is counted as."""
    if kind == "planner":
        return f"{setups()[index]['solver']} planner"
    return optional()[index][0] if kind == "optional" else f"rival {rivals()[index]['type']}"


def judged(made: Controller, robot: Robot, seen: Observation) -> tuple[str, str]:
    """Ask for a command, and say what is wrong with it."""
    command = made.command(seen)
    if wrong := broken_limit(robot, command):
        return ("nan" if "finite" in wrong else "contract"), wrong
    plan, reason = made.last_plan, str(getattr(made, "reason", ""))
    if plan is not None:
        reason = plan.reason
        for name in ("states", "inputs", "positions", "level"):
            if not np.isfinite(getattr(plan, name)).all():
                return "nan", f"plan.{name}: {reason}"
    if found := INSIDE.search(reason):
        return "caught", reason[max(found.start() - 40, 0) :]
    return "", ""


def draw_path(rng: Rng, size: int) -> Path:
    """Draw a path: ordinary, tiny, huge, doubled back or with hundreds of corners."""
    count = int(one_of(rng, 2, 2, 3, 10, 300))
    points = rng.normal(scale=5.0, size=(count, size))
    points = scaled(points, one_of(rng, 1.0, 1.0, 1.0, 1e-12, 1e-5, 1e4, 1e9, 1e150, 1e300))
    if rng.random() < 0.2:
        points[-1] = points[0]
    try:
        return Path(points)
    except WideberthError:  # repeated or far points are refused
        return Path(np.stack([np.zeros(size), np.ones(size)]))


def draw_stamp(rng: Rng, stamp: float, period: float) -> float:
    """Draw the next instant: usually one period on, else a repeat, a jump or a step back."""
    if rng.random() < 0.8:
        return stamp + period
    jumps = (0.0, 1e-300, 1e-9, 10.0, 1e6, 1e9, 1e17, 1e300, 1.7e308, -0.1, -1e9, -1e300)
    return float(np.clip(stamp + one_of(rng, *jumps), -1e308, LARGEST))


def draw_observation(rng: Rng, robot: Robot, stamp: float, walls: bool) -> Observation:
    """Draw what a robot sees on a very bad day."""
    bounds = robot.state_bounds()
    low = np.clip(np.asarray(bounds.lower, dtype=np.float64), -5.0, 5.0)
    high = np.clip(np.asarray(bounds.upper, dtype=np.float64), -5.0, 5.0)
    state = low + rng.random(len(low)) * (high - low)
    if rng.random() < 0.2:
        where = int(rng.integers(len(state)))
        state[where : where + 1] = scaled(state[where : where + 1], magnitude(rng, 0.0))
    if rng.random() < 0.03:
        state[rng.integers(len(state))] = one_of(rng, np.nan, np.inf, -np.inf)
    count = int(one_of(rng, 0, 1, 1, 2, 3, 5, 10, 40, 300))
    place = robot.pose(tuple(np.nan_to_num(state, posinf=0.0, neginf=0.0))).points()
    seen = tuple(draw_detection(rng, robot.dimension, place) for _ in range(count))
    known = None
    if rng.random() < 0.3:
        known = spread(rng, len(state))
    polygons = tuple(draw_polygon(rng) for _ in range(rng.integers(4))) if walls else ()
    return Observation(stamp, state, seen, known, tuple(p for p in polygons if p is not None))


def draw_detection(rng: Rng, size: int, here: Array) -> Detection:
    """Draw one obstacle: repeated names, ages, places and covariances of any magnitude."""
    if rng.random() < 0.1:
        size = 5 - size
    position = rng.normal(scale=4.0, size=size)
    if rng.random() < 0.1:
        position = scaled(position, magnitude(rng, 0.0))
    if rng.random() < 0.1 and len(here) == size:
        position = here.copy()
    if rng.random() < 0.03:
        position[0] = one_of(rng, np.nan, np.inf)
    covariance: Array | None = spread(rng, size, 0.9)
    if rng.random() < 0.05:  # asymmetric, indefinite, not finite
        covariance = scaled(rng.standard_normal((size, size)), magnitude(rng))
    if rng.random() < 0.05:
        covariance = None
    radius = abs(rng.normal(0.4, 0.2)) * magnitude(rng, 0.95)
    age = one_of(rng, 0.0, 0.0, 0.0, 0.1, 1.0, 2.9, 3.1, 1e6, 1e9, 1e300, 5e-324)
    name = str(rng.integers(one_of(rng, 2, 10, 10**6)))
    return Detection(name, position, covariance, radius, age, one_of(rng, "", "a", name))


def draw_polygon(rng: Rng) -> Polygon | None:
    """Draw a polygon, thin, tiny, huge or starred; None where validation refuses it."""
    corners = int(one_of(rng, 3, 4, 8, 40))
    angles = np.sort(rng.uniform(0.0, 2 * np.pi, corners))
    reach = rng.uniform(0.2, 1.0, corners)
    points = reach[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points[:, 0] *= one_of(rng, 1.0, 1.0, 1e-3, 1e-5)
    points = scaled(points, one_of(rng, 1.0, 1.0, 1e-4, 1e3, 1e8, 1e200)) + rng.normal(0, 3, 2)
    try:
        return Polygon(tuple(map(tuple, points.tolist())))
    except WideberthError:
        return None


def predictor_case(index: int, seed: int) -> Iterator[Call]:
    """Let a predictor forecast `BATCH` worlds."""
    rng = np.random.default_rng([2, index, seed])
    name = names("predictors")[index]
    predictor = built(name)
    for _ in range(BATCH):
        tracks, scene, steps = draw_world(rng)
        yield timed(
            f"predictor {name}",
            lambda given=(tracks, steps, scene): foreseen(predictor, *given),
            SECONDS / 2,
        )


@cache
def built(name: str) -> Any:
    """Build a predictor with its defaults."""
    return build("predictors", name)


def foreseen(predictor: Any, tracks: Tracks, steps: int, scene: Scene | None) -> tuple[str, str]:
    """Forecast, after an update where there is one, and say what is wrong."""
    if isinstance(predictor, Adaptive):
        predictor = predictor.update(tracks, scene)
    forecast = predictor.predict(tracks, steps, scene)
    if not np.isfinite(forecast.mean).all() or not np.isfinite(forecast.covariance).all():
        return "nan", "forecast"
    if forecast.mean.shape[2] != steps or len(forecast.mean) != len(tracks):
        return "contract", f"shape {forecast.mean.shape}"
    return "", ""


def draw_world(rng: Rng) -> tuple[Tracks, Scene | None, int]:
    """Draw tracks of any magnitudes, a scene or none, and how many steps to forecast."""
    size, count = int(one_of(rng, 2, 2, 2, 3)), int(rng.integers(1, 5))
    rows = int(one_of(rng, 1, 2, 3, 9, 30, 60))
    base = rng.standard_normal((count, rows, size))
    kind = rng.integers(4)
    if kind == 0:
        base = base.cumsum(axis=1)
    elif kind == 1:
        base = base[:, :1] + np.zeros((count, rows, 1))
    elif kind == 2:
        base = np.arange(rows)[None, :, None] * base[:, :1]
    positions = np.stack([scaled(track, magnitude(rng)) for track in base])
    if rng.random() < 0.3:
        where = 0, rng.integers(rows)
        positions[where] = scaled(positions[where], magnitude(rng, 0.0))
    positions[rng.random((count, rows)) < one_of(rng, 0.0, 0.1, 0.6)] = np.nan
    noise = np.stack([spread(rng, size) for _ in range(count)])
    steps = (1e-300, 1e-6, 1e-5, 1e-3, 0.1, 0.4, 0.5, 1.0, 10.0, 1e3, 1e4, 1e300)
    tracker = None
    if rng.random() < 0.2:
        tracker = np.stack([spread(rng, 2 * size) for _ in range(count)])
    ids = tuple(str(k) for k in range(count))
    radius = np.full(count, min(0.3 * magnitude(rng), 1e308))
    stamp = one_of(rng, 0.0, 0.0, 1e9, -1e17, 1e300)
    tracks = Tracks(positions, one_of(rng, *steps), ids, radius, noise, stamp, tracker)
    if rng.random() < 0.5:
        return tracks, None, int(one_of(rng, 1, 6, 15))
    scene = Scene(
        ego=scaled(rng.standard_normal(5), magnitude(rng)),
        goals=scaled(rng.standard_normal((count, size)), magnitude(rng)),
        plan=scaled(rng.standard_normal((8, size)).cumsum(axis=0), magnitude(rng)),
        radius=min(0.4 * magnitude(rng), 1e308),
    )
    return tracks, scene, int(one_of(rng, 1, 6, 15))


ABSURD = (
    "1e999", "-1", "0", ".nan", ".inf", "''", "[]", "{}", "null", "true", "1e-320", "9" * 5001,
    "x" * 300, "../../etc", "[[[[[", "{a: 1, a: 2}", "&a [*a]", "!!python/object:os.system x",
    "-1.0e+308", "99999999999", "'\\0'", "0x7fffffffffffffff", "2026-01-01", "1:2:3", "* ", "? ",
)  # fmt: skip


def config_case(seed: int) -> Iterator[Call]:
    """Read a mutated config, up to its list of tasks: one clear error or a valid plan."""
    rng = np.random.default_rng([3, seed])
    files = shipped()
    name = files[int(rng.integers(len(files)))]
    text = mutated(rng, name)
    with tempfile.TemporaryDirectory() as folder:
        path = File(folder) / "config.yaml"
        path.write_bytes(text)

        def through() -> tuple[str, str]:
            try:
                experiment, _ = read_experiment(str(path), [])
                len(experiment.tasks())
            except WideberthError as error:
                long = len(str(error)) > 5000
                return (
                    ("config", f"a message of {len(str(error))} characters") if long else ("", "")
                )
            return "", ""

        yield timed(f"config {name}", through, SECONDS / 2)


def mutated(rng: Rng, name: str) -> bytes:
    """Change a shipped config in up to four places."""
    lines = config_path(name).read_text().splitlines()
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    for _ in range(int(rng.integers(1, 5))):
        at, how = int(rng.integers(len(lines))), int(rng.integers(9))
        line = lines[at]
        if how <= 3 and ":" in line:
            lines[at] = f"{line.split(':')[0]}: {one_of(rng, *ABSURD)}"
        elif how == 4:
            numbers = list(re.finditer(r"\d[\d.e+-]*", line))
            if numbers:
                hit = numbers[int(rng.integers(len(numbers)))]
                lines[at] = line[: hit.start()] + str(one_of(rng, *ABSURD)) + line[hit.end() :]
        elif how == 5:
            del lines[at]
            lines = lines or ["type: nothing"]
        elif how == 6:
            lines.insert(at, line)
        elif how == 7:
            lines[at] = " " * int(rng.integers(6)) + line
        else:
            lines.insert(at, f"{'  ' * int(rng.integers(3))}unheard_of: {one_of(rng, *ABSURD)}")
    text = "\n".join(lines).encode()
    if rng.random() < 0.1:
        cut = int(rng.integers(len(text)))
        text = text[:cut] + bytes(rng.integers(0, 256, 8).tolist()) + text[cut:]
    return text


def cases(kind: str, index: int, seed: int) -> Iterator[Call]:
    """Return the calls of one case."""
    if kind in CONTROLLERS:
        return controller_case(kind, index, seed)
    return predictor_case(index, seed) if kind == "predictor" else config_case(seed)
