"""The exported solver: its plans are Python's, and a caller's mistake gets a code."""

import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.cli.export import export
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.planner.rollout import follow, shift
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.programs import SOURCES as PROGRAMS_OF_PACKAGE
from wideberth.framework.values.path import Path as Way
from wideberth.framework.values.path_progress import PathProgress
from wideberth.framework.values.plan import Status
from wideberth.regions import gaussian
from wideberth.solvers.export.bundle import write_folder
from wideberth.solvers.export.solver.files import CORE, SOURCES, bundle, has_example
from wideberth.tests.solvers.exported_folder import (
    COMPILER,
    FAST,
    PROGRAMS,
    ROOT,
    STRICT,
    Folder,
    exported,
    of_instances,
    on_disk,
    run,
)

CPP = shutil.which("c++")


needs_compiler = pytest.mark.skipif(
    COMPILER is None, reason="the solver is compiled and run, and there is no C compiler here"
)
COMPILERS = [one for one in ("gcc", "clang") if shutil.which(one)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    return on_disk(exported(), tmp_path_factory.mktemp("solver") / "c")


# ---- The same numbers as Python's


@needs_compiler
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"region": "minkowski_sum", "level": "fixed", "horizon": 7},
        {"region": "luetkepohl_rectangle", "robot": "bicycle", "penalty": None},
        {
            "robot": {"type": "differential_drive", "radius": 0.5},
            "fallback": {"stop_at_end": True},
        },
        {"robot": "holonomic", "level": "fixed", "horizon": 130, "dt": 0.1},
    ],
    ids=str,
)
def test_an_episode_in_c_is_python_s(settings: dict[str, Any], tmp_path: Path) -> None:
    """Every plan of the example's loop, and what fills the problem, to rounding."""
    folder = on_disk(exported(**settings), tmp_path / "c")
    program = folder.compiled(folder.place / "loop.c")
    done = run(program, "record")
    assert done.returncode == 0, done.stderr
    both = np.dtype([("problem", folder.given), ("result", folder.result)])
    rows = np.frombuffer((folder.place / "record").read_bytes(), dtype=both)
    assert len(rows) == 60
    robot = folder.solver.subject.robot
    last, checked = None, rows if folder.problem.horizon < 50 else rows[::10]
    for row in checked:
        folder.is_python_s(row["problem"], row["result"])
    for cycle, row in enumerate(rows[:: len(rows) // 20]):
        filled_as_in_python(folder, row["problem"], cycle * (len(rows) // 20))
    for row in rows:
        problem = row["problem"]
        zero = np.zeros_like(problem["start_inputs"])
        inputs = zero if last is None else shift(last["inputs"], 1.0)
        assert np.abs(problem["start_inputs"] - inputs).max() <= 1e-6  # within the robot's limits
        driven = follow(robot, problem["initial"], problem["start_inputs"], folder.problem.dt)
        np.testing.assert_allclose(problem["start_states"], driven, 1e-9, 1e-9)
        last = row["result"]
    ends = follow(robot, rows[-1]["problem"]["initial"], last["inputs"][:1], folder.problem.dt)
    found = re.search(r"at \((.*), (.*)\) m; .* within (.*) m", done.stdout)
    assert found is not None
    assert abs(float(found[1]) - ends[-1][0]) < 1e-5 and abs(float(found[2]) - ends[-1][1]) < 1e-5


def filled_as_in_python(folder: Folder, row: Any, cycle: int) -> None:
    """The reference is `lay_reference`'s; slots hold the Gaussians that the example states."""
    one, problem = folder.solver, folder.problem
    way = Way(np.array([(0.0, 0.0), (12.0, 0.0)]))
    robot = one.subject.robot
    place = np.array(robot.pose(tuple(row["initial"])).position, dtype=np.float64)
    start = way.project(place)
    wanted = lay_reference(way, start, one.speed, problem.horizon, problem.dt)
    np.testing.assert_allclose(row["reference"], wanted.position, 1e-9, 1e-9)
    np.testing.assert_allclose(row["direction"], wanted.direction, 1e-9, 1e-9)
    np.testing.assert_allclose(row["speed"], wanted.speed, 1e-9, 1e-9)
    ahead = problem.dt * np.arange(1, problem.horizon + 1)
    along, across = 0.01 + 0.02 * ahead, 0.01 + 0.005 * ahead
    places = ((4.0, 2.5), (8.0, -3.5), (11.0, 0.4))
    speeds = ((0.0, -0.3), (0.0, 0.25), (-0.25, 0.0))
    room = 0.3 + robot.radius + one.margin
    for k, (begin, velocity) in enumerate(zip(places, speeds, strict=True)):
        times = problem.dt * cycle + ahead
        mean = np.array(begin) + times[:, None] * np.array(velocity)
        pair = (across, along) if velocity[0] == 0.0 else (along, across)
        covariance = np.zeros((len(ahead), 2, 2))
        covariance[:, 0, 0], covariance[:, 1, 1] = pair
        covariance[:, 0, 1] = covariance[:, 1, 0] = 0.002 * ahead
        numbers = row["parameters0"][:, k]
        np.testing.assert_allclose(numbers[:, :2], mean, 1e-9, 1e-9)
        np.testing.assert_allclose(numbers[:, -1], room, 1e-9)
        if numbers.shape[1] == gaussian.packed_count(2):
            _, vectors, deviations, _ = gaussian.unpack(numbers)
            assert (deviations[:, 0] >= deviations[:, 1]).all()
            spread = (vectors * deviations[:, None] ** 2) @ vectors.swapaxes(1, 2)
            np.testing.assert_allclose(spread, covariance, 1e-9, 1e-12)
        else:
            variance = np.diagonal(covariance, axis1=1, axis2=2)
            np.testing.assert_allclose(numbers[:, 2:4] ** 2, variance, 1e-9)
    assert row["active0"].tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]


@needs_compiler
@pytest.mark.skipif(CPP is None, reason="there is no C++ compiler here")
def test_the_loop_in_cpp_drives_as_that_in_c(folder: Folder) -> None:
    flags = "-O1 -Wall -Wextra -Wpedantic -Werror"
    made = subprocess.run(
        ["make", f"CXXFLAGS={flags}", f"CFLAGS=-O1 {STRICT}"],
        cwd=folder.place, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
    first, second = run(folder.place / "loop"), run(folder.place / "loop_cpp")
    assert first.returncode == second.returncode == 0
    assert first.stdout == second.stdout and first.stdout.count("\n") == 7


@pytest.mark.parametrize("level", ["-O0", FAST])
@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("count", [1, 5, 10, 20])
def test_recorded_instances_are_solved_as_in_python(
    count: int, compiler: str, level: str, tmp_path: Path
) -> None:
    folder, rows = of_instances(count, tmp_path / "c", compiler, level)
    results, violations, _ = folder.replayed(rows)
    assert len(results) == len(rows) >= 8
    for row, result, worst in zip(rows, results, violations, strict=True):
        folder.is_python_s(row, result)
        parameters, _ = folder.instance(row)
        wanted = violation(folder.problem, parameters, folder.point(result)).worst
        assert worst == pytest.approx(wanted, abs=1e-9)


@needs_compiler
@pytest.mark.parametrize(
    "settings",
    [{}, {"level": "fixed"}, {"level": "fixed", "penalty": None, "region": "minkowski_sum"},
     {"level": "fixed", "horizon": 130, "dt": 0.1, "fallback": {"stop_at_end": True}}],
    ids=str,
)  # fmt: skip
def test_within_an_obstacle_and_turned_round(settings: dict[str, Any], tmp_path: Path) -> None:
    """Slack, violated regions, guesses off by whole turns: numbers that episodes hardly see."""
    folder = on_disk(exported(**settings), tmp_path / "c")
    assert run(folder.compiled(folder.place / "loop.c"), "record").returncode == 0
    both = np.dtype([("problem", folder.given), ("result", folder.result)])
    first = np.frombuffer((folder.place / "record").read_bytes(), dtype=both)["problem"][12]
    rows = []
    for turns, where in ((0.0, 0.3), (1.0, 0.0), (-3.0, -0.2), (0.5, 0.1)):
        row = first.copy()
        row["start_states"][:, 2] += 2.0 * np.pi * turns
        ahead = np.linspace(1.0, 0.8, folder.problem.horizon)
        row["parameters0"][:, 1, :2] = row["initial"][:2] + where * ahead[:, None]
        row["parameters0"][:, 1, -1] = ahead
        rows.append(row)
    results, violations, _ = folder.replayed(rows)
    for row, result, worst in zip(rows, results, violations, strict=True):
        folder.is_python_s(row, result)
        parameters, _ = folder.instance(row)
        wanted = violation(folder.problem, parameters, folder.point(result)).worst
        assert worst == pytest.approx(wanted, rel=1e-9) and wanted > 0.01
        assert result["slack"].sum() > 0.0


OUTLINE = {"vertices": [[-0.4, -0.2], [0.4, -0.2], [0.4, 0.2], [-0.4, 0.2]]}


@needs_compiler
@pytest.mark.parametrize(
    ("room", "settings"),
    [
        ((0, 0, 4), {}),
        ((2, 1, 6), {"static_region": "separating_line", "level": "fixed"}),
        ((1, 2, 4), {"static_region": "dual", "region": "separating_line", "robot":
            {"type": "differential_drive", "footprint": OUTLINE, "radius": 0.5}}),
        ((1, 0, 4), {"robot": "holonomic_3d", "cost": "contouring"}),
    ],
    ids=str,
)  # fmt: skip
def test_problems_of_other_kinds_are_solved_as_in_python(
    room: tuple[int, int, int], settings: dict[str, Any], tmp_path: Path
) -> None:
    """Nothing to keep clear of, polygons with own variables, space and a path's own numbers."""
    folder = on_disk(exported(room=room, **settings), tmp_path / "c")
    what = folder.solver.subject
    row = folder.written(what.parameters, what.guess)
    (result,), (worst,), _ = folder.replayed([row])
    folder.is_python_s(row, result)
    assert folder.by_python(row).status is Status.SOLVED
    parameters, _ = folder.instance(row)
    wanted = violation(folder.problem, parameters, folder.by_python(row).point).worst
    assert worst == pytest.approx(wanted, abs=1e-9)


@needs_compiler
def test_the_reference_follows_a_bent_path(folder: Folder) -> None:
    """The robot drives beside the path, past corners, across its own way and to the end."""
    path = np.array([(0.0, 0.0), (3.0, 0.0), (5.0, 2.0), (5.0, 5.0), (2.0, 5.0), (2.0, -3.0)])
    way, one = Way(path), folder.solver
    progress = PathProgress(way)
    arcs = np.linspace(0.0, way.length, 60)
    places = way.at(arcs) + 0.05 * np.sin(np.arange(60))[:, None]
    (folder.place / "places").write_bytes(places.tobytes())
    done = run(folder.compiled(PROGRAMS / "follow.c"), "places", "laid")
    assert done.returncode == 0
    both = np.dtype([("problem", folder.given), ("arc", "f8")])
    rows = np.frombuffer((folder.place / "laid").read_bytes(), dtype=both)
    assert len(rows) == 60
    for place, row in zip(places, rows, strict=True):
        progress, start = progress.advanced(place)
        assert row["arc"] == pytest.approx(start, abs=1e-9)
        wanted = lay_reference(way, start, 0.7, one.subject.problem.horizon, 0.5)
        np.testing.assert_allclose(row["problem"]["reference"], wanted.position, 1e-9, 1e-9)
        np.testing.assert_allclose(row["problem"]["direction"], wanted.direction, 1e-9, 1e-9)
        np.testing.assert_allclose(row["problem"]["speed"], wanted.speed, 1e-9, 1e-9)


@needs_compiler
def test_the_program_of_the_page_runs(tmp_path: Path) -> None:
    """Its commands, its C: exported, compiled and run as docs/export.md says."""
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    programs = re.findall(r"^```c\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    shells = re.findall(r"^```sh\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    (program,) = programs
    (tmp_path / "drive.c").write_text(program)
    words = shlex.split(shells[0].splitlines()[0])
    assert words[:4] == ["wideberth", "export", "crossing", "--solver"]
    out = tmp_path / words[words.index("--out") + 1]
    export(words[2], [], out, obstacles=int(words[-1]), solver=True)
    for line in shells[1].splitlines():
        done = subprocess.run(
            shlex.split(line), cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0 and not done.stderr, done.stderr
    found = re.fullmatch(r"at \((.*), (.*)\) m, v = (.*) m/s\n", done.stdout)
    assert found is not None and float(found[1]) > 8.0 and float(found[3]) > 0.3


# ---- What a caller may do wrong


@needs_compiler
def test_mistakes_get_a_code(folder: Folder) -> None:
    done = run(folder.compiled(PROGRAMS / "trouble.c"))
    assert (done.returncode, done.stdout) == (0, ""), done.stdout


@needs_compiler
def test_threads_at_once_and_the_stack_of_the_header(folder: Folder) -> None:
    assert run(folder.compiled(folder.place / "loop.c"), "record").returncode == 0
    both = np.dtype([("problem", folder.given), ("result", folder.result)])
    rows = np.frombuffer((folder.place / "record").read_bytes(), dtype=both)
    (folder.place / "some").write_bytes(b"".join(row.tobytes() for row in rows["problem"][8:40:8]))
    done = run(folder.compiled(PROGRAMS / "threads.c", "-pthread"), "some")
    assert done.returncode == 0, done.stdout + done.stderr
    used, allowed = map(int, done.stdout.split())
    assert used <= allowed == folder.solver.stack < 8 * used


@needs_compiler
def test_files_of_another_export_are_refused(folder: Folder, tmp_path: Path) -> None:
    mixed = {**bundle(folder.solver), "problem.c": bundle(exported(horizon=9))["problem.c"]}
    write_folder(tmp_path / "c", mixed, force=False)
    words = [str(COMPILER), "-c", "problem.c"]
    done = subprocess.run(words, cwd=tmp_path / "c", capture_output=True, text=True, check=False)
    assert done.returncode != 0 and "are of different exports" in done.stderr


# ---- What is written


@needs_compiler
def test_the_code_allocates_nothing_and_has_no_state(folder: Folder) -> None:
    """It calls libm and functions of memory alone, and no symbol of it can be written to."""
    folder.compiled(folder.place / "loop.c")
    done = subprocess.run(
        ["nm", *(name.replace(".c", ".o") for name in SOURCES)], cwd=folder.place,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    symbols = [line.split()[-2:] for line in done.stdout.splitlines() if len(line.split()) > 1]
    kinds: dict[str, set[str]] = {}
    for kind, name in symbols:
        kinds.setdefault(kind, set()).add(name)
    called = {name for name in kinds["U"] if not name.startswith(("wb_", "wideberth_", "_"))}
    assert called <= {
        "atan2", "cos", "exp", "fmax", "fmin", "fmod", "hypot", "log", "log10", "memcpy", "memset",
        "pow", "rint", "sin", "sincos", "sqrt",
    }  # fmt: skip
    assert set(kinds) <= set("UTtRrDd")
    relocated = {"ERRORS", "STATUSES", "KINDS", "sweeps", "wideberth_core", "wideberth_kinds"}
    assert kinds.get("D", set()) | kinds.get("d", set()) <= relocated


def test_the_same_config_gives_the_same_bytes(folder: Folder) -> None:
    assert bundle(exported()) == bundle(folder.solver)


def test_the_core_is_the_package_s_own(folder: Folder) -> None:
    for name in ("riccati.c", "riccati.h", "state.h", "slots.h", "sweep.h", "levels.h"):
        assert (folder.place / name).read_bytes() == (CORE / name).read_bytes()
    assert (folder.place / "kernel.h").read_bytes() == (
        PROGRAMS_OF_PACKAGE / "kernel.h"
    ).read_bytes()


@needs_compiler
@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no CMake here")
def test_cmake_makes_the_library_and_the_loops(folder: Folder, tmp_path: Path) -> None:
    for words in (["-S", str(folder.place), "-B", "."], ["--build", ".", "--target", "loop_c"]):
        done = subprocess.run(
            ["cmake", *words], cwd=tmp_path, capture_output=True, text=True, check=False,
            env={**os.environ, "CFLAGS": "-O1 -Wall -Wextra -Wpedantic -Werror"},
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
    done = run(tmp_path / "loop_c")
    assert done.returncode == 0 and done.stdout.count("\n") == 7


def test_what_cannot_be_exported_says_why() -> None:
    one = exported(region="minkowski_sum", robot="holonomic_3d")
    assert not has_example(one) and one.filled == (False, False)
    files = bundle(one)
    assert "loop.c" not in files and "WIDEBERTH_OBSTACLE_FILLED 0" in str(
        files["wideberth_solver.h"]
    )


@needs_compiler
def test_parameters_without_a_closed_form_are_the_caller_s(tmp_path: Path) -> None:
    one = on_disk(exported(robot="holonomic_3d"), tmp_path / "c")
    source = one.place / "ask.c"
    source.write_text(
        '#include "wideberth_solver.h"\n'
        "int main(void)\n{\n    static wideberth_problem problem;\n"
        "    static double mean[WIDEBERTH_HORIZON][3], covariance[WIDEBERTH_HORIZON][9];\n"
        "    wideberth_begin(&problem);\n"
        "    return wideberth_set(&problem, 0, 0, (const double(*)[3])mean,\n"
        "        (const double(*)[9])covariance, 0.1) != WIDEBERTH_NO_CLOSED_FORM;\n}\n"
    )
    assert run(one.compiled(source)).returncode == 0
