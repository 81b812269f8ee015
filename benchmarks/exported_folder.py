"""An exported solver on disk: compiled, run, and held against Python's."""

import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from wideberth.benchmarks.recorded_instances import read_instances
from wideberth.experiments.cli.export import solver, subject
from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.mpc.solver import Solution
from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.plan import Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.export.bundle import write_folder
from wideberth.solvers.export.solver.files import bundle
from wideberth.solvers.export.solver.measured import needs
from wideberth.solvers.export.solver.native import Native, machine
from wideberth.solvers.export.solver.needs import ExportedSolver
from wideberth.solvers.export.subject import Subject
from wideberth.solvers.riccati import objects
from wideberth.solvers.riccati.solver import Riccati

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ROOT / "tests" / "data" / "c"
SAMPLE = ROOT / "tests" / "data" / "mpc_instances.npz"
COMPILER = shutil.which("cc")
STRICT = "-O2 -std=c99 -Wall -Wextra -pedantic -Werror -D_DEFAULT_SOURCE"
STATUS = (Status.SOLVED, Status.LIMIT, Status.INFEASIBLE, Status.FAILED, Status.DEADLINE)


def fits() -> bool:
    """Whether object code of the solver fits this processor."""
    try:
        return bool(objects.fitting())
    except WideberthError:
        return False


def planner(**settings: Any) -> Any:
    """Build a planner that can be exported; ``settings`` replace those of its config."""
    config = {
        "type": "mpc", "robot": "unicycle", "region": "mahalanobis_ellipse", "margin": 0.1,
        "predictor": "constant_velocity", "solver": "riccati", "history": 6, "penalty": 1e4,
        "level": {"type": "relaxed", "minimum": 0.5, "weight": 10.0},
    }  # fmt: skip
    return build("controllers", {**config, **settings})


def exported(
    target: str = "native", room: tuple[int, int, int] = (5, 0, 4), **settings: Any
) -> ExportedSolver:
    """Export such a planner's solver with room for so many discs, polygons and corners."""
    one = planner(**settings)
    return solver(one, subject(one, room, "test, planner"), machine(target))


@dataclass(frozen=True, eq=False)
class Folder:
    """An export on disk, and how its structures stand in memory."""

    solver: ExportedSolver
    place: Path
    programs: dict[tuple[Path, tuple[str, ...]], Path] = field(default_factory=dict)

    @property
    def problem(self) -> Problem:
        """The problem that it solves."""
        return self.solver.native.subject.problem

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
        row["build"] = self.solver.native.build
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
        if (source, words) in self.programs:
            return self.programs[source, words]
        out = self.place / source.stem
        files = [str(source), "wideberth_solver.c", "libwideberth.a", *words, "-lm"]
        command = [str(COMPILER), *STRICT.split(), "-I", ".", "-o", str(out), *files]
        done = subprocess.run(
            command, cwd=self.place, capture_output=True, text=True, check=False, timeout=120
        )
        assert done.returncode == 0, done.stderr
        self.programs[source, words] = out
        return out

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

    def by_python(self, row: Any) -> Solution:
        """Solve a problem in Python."""
        parameters, guess = self.instance(row)
        settings = self.solver.settings
        return settings.solve(self.problem, parameters, [guess])[0]

    def is_python_s(self, row: Any, result: Any) -> None:
        """Hold a result in C against Python's: every number, bit for bit."""
        solution = self.by_python(row)
        point = solution.point
        for name, values in (
            ("states", point.states), ("inputs", point.inputs), ("slack", point.slack),
            ("cost", np.float64(solution.cost)),
        ):  # fmt: skip
            assert result[name].tobytes() == values.tobytes(), name
        if self.problem.shared:
            assert result["level"] == point.level
        for k, own in enumerate(point.auxiliaries):
            if own.size:
                assert result[f"auxiliaries{k}"].tobytes() == own.tobytes()
        assert int(result["iterations"]) == solution.iterations
        assert STATUS[int(result["status"])] is solution.status


def run(program: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run a program in its folder."""
    return subprocess.run(
        [str(program), *words], cwd=program.parent, capture_output=True, text=True, check=False,
        timeout=120,
    )  # fmt: skip


def on_disk(one: ExportedSolver, place: Path) -> Folder:
    """Write an export."""
    write_folder(place, bundle(one), force=False)
    return Folder(one, place)


def of_instances(count: int, place: Path) -> tuple[Folder, list[Any]]:
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
    native = Native(what, machine("native"), 0.0)
    taken = needs(problem, first.parameters, first.guess, Riccati())
    aims = (policy.levels(region, 15, count, 2)[:, 0],)
    folder = on_disk(ExportedSolver(native, Riccati(), taken, 0.5, aims), place)
    return folder, [folder.written(one.parameters, one.guess) for one in some]
