"""An exported solver on disk: compiled, run, and held against Python's."""

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from wideberth.benchmarks.recorded_instances import SAMPLE, read_instances
from wideberth.experiments.cli.export import exported_solver
from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.plan import Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.export.bundle import write_folder
from wideberth.solvers.export.solver.exported import ExportedSolver
from wideberth.solvers.export.solver.files import SOURCES, bundle
from wideberth.solvers.export.subject import Subject
from wideberth.solvers.riccati.solver import Riccati

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = ROOT / "tests" / "data" / "c"
COMPILER = shutil.which("cc")
STRICT = "-std=c99 -Wall -Wextra -Wpedantic -Werror -D_DEFAULT_SOURCE"
QUICK, FAST = "-O1", "-O3 -fno-math-errno -fno-trapping-math"
"""How a program is compiled soon, and how it runs fast."""
CLOSE = 1e-9
"""Largest difference between a number in C and Python's: compilers round differently."""
LONG, CLOSE_AFTER = 80, 0.01
"""Iterations after which rounding decides to which of several local minima an infeasible problem
leads, and the largest relative difference of the total slack then."""
STATUS = (Status.SOLVED, Status.LIMIT, Status.INFEASIBLE, Status.FAILED, Status.DEADLINE)


def planner(**settings: Any) -> Any:
    """Build a planner that can be exported; ``settings`` replace those of its config."""
    config = {
        "type": "mpc", "robot": "unicycle", "region": "mahalanobis_ellipse", "margin": 0.1,
        "predictor": "constant_velocity", "solver": "riccati", "history": 6, "penalty": 1e4,
        "level": {"type": "relaxed", "minimum": 0.5, "weight": 10.0},
    }  # fmt: skip
    return build("controllers", {**config, **settings})


def exported(room: tuple[int, int, int] = (5, 0, 4), **settings: Any) -> ExportedSolver:
    """Export such a planner's solver with room for so many discs, polygons and corners."""
    return exported_solver(planner(**settings), room, "test, planner")


@dataclass(frozen=True, eq=False)
class Folder:
    """An export on disk, and how its structures stand in memory."""

    solver: ExportedSolver
    place: Path
    compiler: str = str(COMPILER)
    level: str = QUICK
    programs: dict[tuple[Path, tuple[str, ...]], Path] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """The problem that it solves."""
        return self.solver.subject.problem

    @property
    def given(self) -> "np.dtype[Any]":
        """The structure of a problem."""
        problem = self.problem
        steps, n, m, size = problem.horizon, problem.states, problem.inputs, problem.dimension
        fields: list[Any] = [
            ("build", "u8"), ("stop", "u8"), ("initial", "f8", n),
            ("reference", "f8", (steps, size)), ("direction", "f8", (steps, size)),
            ("speed", "f8", steps),
            *([("curve", "f8", (steps, problem.curve))] * bool(problem.curve)),
            ("start_states", "f8", (steps + 1, n)), ("start_inputs", "f8", (steps, m)),
            ("start_level", "f8"),
        ]  # fmt: skip
        for k, one in enumerate(problem.slots):
            if one.count:
                own, levels = len(one.auxiliary), [(f"level{k}", "f8", (steps, one.count))]
                fields += [(f"parameters{k}", "f8", (steps, one.count, one.width))]
                fields += [*(levels if one.levelled else []), (f"active{k}", "f8", one.count)]
                fields += [(f"auxiliaries{k}", "f8", (steps, one.count, own))] if own else []
        return np.dtype(fields)

    @property
    def result(self) -> "np.dtype[Any]":
        """The structure of a result."""
        problem = self.problem
        steps = problem.horizon
        fields: list[Any] = [
            ("states", "f8", (steps + 1, problem.states)),
            ("inputs", "f8", (steps, problem.inputs)),
            ("slack", "f8", steps),
            *((f"auxiliaries{k}", "f8", (steps, one.count, len(one.auxiliary)))
              for k, one in enumerate(problem.slots) if one.count * len(one.auxiliary)),
            *((name, "f8") for name in ("cost", "level", "error")),
            ("iterations", "i4"), ("status", "i4"),
        ]  # fmt: skip
        return np.dtype(fields)

    def instance(self, row: Any) -> tuple[Parameters, Guess]:
        """Return what Python solves instead of a problem in C."""
        steps, slots, own = self.problem.horizon, [], []
        for k, one in enumerate(self.problem.slots):
            none = np.zeros((steps, one.count, 0))
            starts = row[f"auxiliaries{k}"] if one.count * len(one.auxiliary) else none
            if one.count:
                level = row[f"level{k}"] if one.levelled else None
                slots.append(SlotNumbers(row[f"parameters{k}"], row[f"active{k}"], starts, level))
            else:
                slots.append(SlotNumbers.none(steps, one.width, levelled=one.levelled))
            own.append(slots[-1].auxiliaries)
        curve = row["curve"] if self.problem.curve else np.zeros((steps, 0))
        along = row["reference"], row["direction"], row["speed"]
        parameters = Parameters(row["initial"], *along, tuple(slots), curve)
        first = Guess.bare(row["start_states"], row["start_inputs"], float(row["start_level"]))
        return parameters, replace(first, auxiliaries=tuple(own))

    def written(self, parameters: Parameters, guess: Guess) -> Any:
        """Return the problem in C for what Python solves."""
        row = np.zeros((), dtype=self.given)
        row["build"] = self.solver.build
        row["initial"], row["reference"] = parameters.initial, parameters.reference
        row["direction"], row["speed"] = parameters.direction, parameters.speed
        row["start_states"], row["start_inputs"] = guess.states, guess.inputs
        row["start_level"] = guess.level
        if self.problem.curve:
            row["curve"] = parameters.curve
        for k, one in enumerate(parameters.slots):
            if len(one.active):
                row[f"parameters{k}"], row[f"active{k}"] = one.parameters, one.active
            if len(one.active) and one.level is not None:
                row[f"level{k}"] = one.level
            if one.auxiliaries.size:
                row[f"auxiliaries{k}"] = one.auxiliaries
        return row

    def compiled(self, source: Path, *words: str) -> Path:
        """Compile a program with the export, without a warning, where it has not been yet."""
        if (source, words) not in self.programs:
            if not self.programs:
                self._compile("-c", *SOURCES)
            out = self.place / source.stem
            objects = [str(Path(name).with_suffix(".o")) for name in SOURCES]
            self._compile("-I", ".", "-o", str(out), str(source), *objects, *words, "-lm")
            self.programs[source, words] = out
        return self.programs[source, words]

    def _compile(self, *words: str) -> None:
        command = [self.compiler, *self.level.split(), *STRICT.split(), *words]
        done = subprocess.run(
            command, cwd=self.place, capture_output=True, text=True, check=False, timeout=300
        )
        assert done.returncode == 0, done.stderr

    def replayed(self, rows: Sequence[Any], times: int = 1) -> tuple[Any, Array, list[float]]:
        """Solve problems in C: results, violations, us."""
        program = self.compiled(PROGRAMS / "replay.c")
        first, second = self.place / "problems", self.place / "results"
        first.write_bytes(b"".join(row.tobytes() for row in rows))
        done = run(program, str(first), str(second), str(times))
        assert done.returncode == 0, done.stderr
        both = np.dtype([("result", self.result), ("violation", "f8")])
        found = np.frombuffer(second.read_bytes(), dtype=both)
        return found["result"], found["violation"], [float(line) for line in done.stdout.split()]

    def point(self, result: Any) -> Guess:
        """Return the plan of a result in C, with its slack."""
        first = Guess.bare(result["states"], result["inputs"], float(result["level"]))
        auxiliaries = tuple(
            result[f"auxiliaries{k}"] if slots.auxiliaries.size else slots.auxiliaries
            for k, slots in enumerate(self.solver.subject.parameters.slots)
        )
        return replace(first, slack=result["slack"], auxiliaries=auxiliaries)

    def by_python(self, row: Any) -> Solution:
        """Solve a problem in Python."""
        parameters, guess = self.instance(row)
        settings = self.solver.settings
        return settings.solve(self.problem, parameters, [guess])[0]

    def is_python_s(self, row: Any, result: Any) -> None:
        """Compare a result in C with Python's, to `CLOSE`."""
        solution = self.by_python(row)
        point = solution.point
        assert STATUS[int(result["status"])] is solution.status
        if solution.status is Status.INFEASIBLE and solution.iterations > LONG:
            total = point.slack.sum()
            np.testing.assert_allclose(result["slack"].sum(), total, CLOSE_AFTER)
            return
        assert abs(int(result["iterations"]) - solution.iterations) <= 1
        np.testing.assert_allclose(result["cost"], solution.cost, 10.0 * CLOSE)  # slack is dear
        for name in ("states", "inputs", "slack"):
            np.testing.assert_allclose(
                result[name], getattr(point, name), 0.0, CLOSE, err_msg=name
            )
        if self.problem.shared:
            np.testing.assert_allclose(result["level"], point.level, 0.0, CLOSE)
        for k, own in enumerate(point.auxiliaries):
            if own.size:
                np.testing.assert_allclose(result[f"auxiliaries{k}"], own, 0.0, CLOSE)


def run(program: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run a program in its folder."""
    return subprocess.run(
        [str(program), *words], cwd=program.parent, capture_output=True, text=True, check=False,
        timeout=120,
    )  # fmt: skip


def on_disk(one: ExportedSolver, place: Path, *how: str) -> Folder:
    """Write an export; ``how`` are compiler and level, see `Folder`."""
    write_folder(place, bundle(one), force=False)
    return Folder(one, place, *how)


def of_instances(count: int, place: Path, *how: str) -> tuple[Folder, list[Any]]:
    """Export the recorded problem with so many obstacles; return it and its instances."""
    robot, region = Unicycle(), MahalanobisEllipse()
    kinds = (GaussianDiscs(region),)
    policy = Paper(tail=float(np.exp(-5.991 / 2)))
    problem = assemble(robot, kinds, policy, horizon=15, dt=0.5, rooms=[(count,)])
    some = [one for one in read_instances(SAMPLE, region) if one.obstacles == count]
    first = some[0]
    what = Subject(
        problem, first.parameters, first.guess, robot, kinds, Tracking(), {}, "recorded"
    )
    aims = (policy.levels(region, 15, count, 2)[:, 0],)
    folder = on_disk(ExportedSolver(what, Riccati(), 0.0, 0.5, aims), place, *how)
    return folder, [folder.written(one.parameters, one.guess) for one in some]
