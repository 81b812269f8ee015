"""Record what the studies, solvers and regions give, and compare two recordings byte by byte.

    python benchmarks/same_numbers.py record results/before --workers 2
    python benchmarks/same_numbers.py record results/after --workers 2
    python benchmarks/same_numbers.py compare results/before results/after

Record before code is moved, and again afterwards: a change that only moves code changes no byte.
Measured times are left out. Numbers are those of one machine and one set of versions: record both
sides there.
"""

import argparse
import csv
import shutil
import subprocess
import sys
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from set_ups import OWN, registered
from solver_speed import chosen

from wideberth.benchmarks.recorded_instances import ELLIPSE, EXACT, SAMPLE, paper_problem
from wideberth.framework import GaussianObstacle, build, names, recommended
from wideberth.framework.control.rate_limited_warnings import quiet
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.robot import start_state
from wideberth.framework.values.motion import Command, Detection, Observation
from wideberth.framework.values.path import Path as Course
from wideberth.framework.values.plan import Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.engine.plant import KinematicPlant

RUNS = {
    "chicken_game": {"seeds": 20},
    "crossing": {"seeds": 20},
    "blind_corner": {"seeds": 4},
    "flight": {"seeds": 4},
    "crowdnav": {"seeds": 20},
    "hallway": {"seeds": 4},
    "doorway": {"seeds": 4},
    "region_price": {"seeds": 2},
    "prediction_benchmark": {},
}
"""Config -> settings that make it short enough."""
KEPT = ("table.csv", "summary.csv")
"""Files of a result folder that hold no measured time."""
REGIONS, SOLVES, DRIVES = "regions.csv", "solves.csv", "drives.csv"


KALMAN = {"type": "kalman", "acceleration_density": 0.01}
PLANNERS: dict[str, dict[str, Any]] = {
    "five": {"predictor": KALMAN, "speed": 1.25, "seen": 5, "static_region": None},
    "forty": {"predictor": KALMAN, "speed": 1.25, "seen": 40, "most_obstacles": 10},
    "recommended": {},
    "nav2": {"predictor": KALMAN, "robot": "differential_drive", "speed": 0.4},
    "contouring": {"predictor": KALMAN, "cost": "contouring"},
    "paper's level": {"predictor": KALMAN, "level": "paper", "static_region": None},
    "fixed, hard": {"predictor": "var", "level": "fixed", "penalty": None, "seen": 14},
    "exact sum": {"predictor": KALMAN, "region": "minkowski_sum", "level": "discounted"},
    "few slots": {"predictor": "imm", "most_obstacles": 2, "seen": 12},
    "late": {"predictor": "constant_velocity", "latency": 0.12, "period": 0.1},
}
"""Name -> changes of the recommended planner, the robot, and how many people are seen."""
WALLS = (
    Polygon(((2.0, 1.2), (4.0, 1.2), (4.0, 2.5), (2.0, 2.5)), "box"),
    Polygon(((5.0, -3.0), (9.0, -3.0), (9.0, -1.3), (7.0, -1.0)), "wall"),
)


def main() -> int:
    """Record, or compare and return 1 where anything differs."""
    asked = _arguments()
    if asked.action == "record":
        record(asked.folder, asked.only or [*RUNS, REGIONS, SOLVES, DRIVES], asked.workers)
        return 0
    different = list(differences(asked.folder, asked.other))
    print("\n".join(different or ["the same to the byte"]))
    return int(bool(different))


def record(folder: Path, wanted: list[str], workers: int) -> None:
    """Write the tables of every study, and those of regions, recorded instances and drives."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in wanted:
        print(f"recording {name} ...", flush=True)
        if name == REGIONS:
            _write(folder / REGIONS, region_rows())
        elif name == SOLVES:
            _write(folder / SOLVES, solve_rows())
        elif name == DRIVES:
            _write(folder / DRIVES, drive_rows())
        else:
            _run(name, folder, workers)


def differences(first: Path, second: Path) -> Iterator[str]:
    """Yield a line for every table that differs or is missing on one side."""
    every = sorted({path.name for one in (first, second) for path in one.glob("*.csv")})
    if not every:
        yield f"no tables in {first} and {second}"
    for name in every:
        texts = [
            (one / name).read_text().splitlines() if (one / name).exists() else None
            for one in (first, second)
        ]
        if None in texts:
            yield f"{name}: only in {first if texts[1] is None else second}"
        elif texts[0] != texts[1]:
            yield f"{name}: {_first_difference(*texts)}"


def _first_difference(before: list[str], after: list[str]) -> str:
    pairs = zip(before, after, strict=False)
    rows = [i for i, (one, other) in enumerate(pairs) if one != other]
    if not rows:
        return f"{len(before)} and {len(after)} lines"
    row = rows[0]
    return f"{len(rows)} lines differ, first line {row + 1}:\n  {before[row]}\n  {after[row]}"


def region_rows() -> Iterator[list[object]]:
    """Yield a row for every registered region, dimension and content: digests of its values."""
    yield ["region", "dimension", "tail", "parameters", "level", "contains", "area"]
    for name in names("regions"):
        region = build("regions", name)
        for size in region.dimensions:
            rng = np.random.default_rng(1)
            mean = rng.normal(scale=2.0, size=(40, size))
            root = rng.normal(scale=0.5, size=(40, size, size))
            covariance = root @ root.swapaxes(1, 2) + 0.01 * np.eye(size)
            margin = rng.uniform(0.2, 1.5, 40)
            numbers = region.parameters(GaussianObstacle(mean, covariance), margin)
            points = mean[:, None] + rng.normal(scale=2.0, size=(40, 50, size))
            for tail in (0.5, 0.05, 1e-6):
                level = region.level(tail, size)
                inside = [
                    region.contains(*one, np.float64(level))
                    for one in zip(points, numbers[:, None], strict=True)
                ]
                area = region.area(numbers, np.full(40, level))
                digests = [_digest(np.asarray(one, dtype=np.float64)) for one in (inside, area)]
                yield [name, size, tail, _digest(numbers), level.hex(), *digests]


def solve_rows() -> Iterator[list[object]]:
    """Yield a row for every solver and recorded instance of the sample: status, cost, plan."""
    yield ["solver", "region", "instance", "status", "iterations", "cost", "plan"]
    for name, solver in registered().items():
        for region in (ELLIPSE, EXACT) if name == OWN else (ELLIPSE,):
            for i, one in enumerate(chosen(SAMPLE, None, region)):
                problem = paper_problem(region, one.obstacles, len(one.parameters.reference))
                (found,) = solver.solve(problem, one.parameters, [one.guess])
                plan = np.concatenate([found.point.states.ravel(), found.point.inputs.ravel()])
                yield [name, region, i, found.status.name, found.iterations,
                       float(found.cost).hex(), _digest(plan)]  # fmt: skip


def drive_rows() -> Iterator[list[object]]:
    """Yield a row for every decision of some planners: command, rung, digest of the plan."""
    yield ["planner", "decision", "command", "rung", "reason", "iterations", "plan"]
    with quiet():
        for name, settings in PLANNERS.items():
            changes = {"robot": "unicycle", **settings}
            seen = changes.pop("seen", 6)
            planner = recommended(changes.pop("robot"), quiet=True, **changes)
            for k, (command, plan) in enumerate(_drive(planner, seen)):
                numbers = plan.states, plan.inputs, plan.level, plan.target, plan.content
                values = np.concatenate([one.ravel() for one in numbers])
                yield [name, k, command, plan.rung, plan.reason, plan.iterations, _digest(values)]


def _drive(planner: Planner, seen: int) -> Iterator[tuple[Command, Plan]]:
    """Drive past people who walk, and walls, for some decisions."""
    rng, robot, period = np.random.default_rng(7), planner.robot, planner.period
    places = rng.uniform([-2.0, -6.0], [10.0, 6.0], (seen, 2))
    velocities = 0.5 * rng.standard_normal((seen, 2))
    plant = KinematicPlant(robot, *start_state(robot, (0.0, 0.0), (1.0, 0.0), 0.0))
    planner.set_path(Course(np.array([[0.0, 0.0], [12.0, 0.0], [14.0, 5.0]])))
    for k in range(-30, 14):
        now = places + period * k * velocities + 0.02 * rng.standard_normal((seen, 2))
        people = [Detection(f"{i}", place, 4e-4 * np.eye(2), 0.3) for i, place in enumerate(now)]
        walls = WALLS if planner.static_region is not None else ()
        view = Observation(period * k, np.array(plant.state), tuple(people), polygons=walls)
        if k < 0:
            planner.remember(view)
            continue
        command = planner.command(view)
        yield command, planner.plan
        plant.command(command, period * k)
        plant.advance(period * k, period)


def _run(name: str, folder: Path, workers: int) -> None:
    settings = [f"--set={key}={value}" for key, value in RUNS[name].items()]
    out = folder / "runs" / name
    command = ["wideberth", "run", name, *settings, "--workers", str(workers), "--out", str(out)]
    subprocess.run([Path(sys.executable).with_name("wideberth"), *command[1:]], check=True,
                   stdout=subprocess.DEVNULL)  # fmt: skip
    for file in KEPT:
        if (out / file).exists():
            shutil.copyfile(out / file, folder / f"{name}_{file}")


def _write(path: Path, rows: Iterator[list[object]]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(rows)


def _digest(values: np.ndarray) -> str:
    return sha256(np.ascontiguousarray(values).tobytes()).hexdigest()[:16]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    actions = parser.add_subparsers(dest="action", required=True)
    recording = actions.add_parser("record", help="write tables into a folder")
    recording.add_argument("folder", type=Path)
    recording.add_argument("--workers", type=int, default=2)
    recording.add_argument("--only", nargs="+", choices=[*RUNS, REGIONS, SOLVES, DRIVES])
    comparing = actions.add_parser("compare", help="compare two folders byte by byte")
    comparing.add_argument("folder", type=Path)
    comparing.add_argument("other", type=Path)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
