"""The exported C: it compiles without a warning and says what Python says."""

import ctypes
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.cli.export import subject
from wideberth.framework.plugins.config import build
from wideberth.framework.values.arrays import Array
from wideberth.solvers.export.bundle import bundle, write_folder
from wideberth.solvers.export.routines import STAGE
from wideberth.solvers.export.subject import Subject

COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(
    COMPILER is None or shutil.which("make") is None,
    reason="the exported C is compiled and run, and there is no C compiler with make here",
)
STAGE_FILES, NLP_FILES = ("wideberth", "stage_functions"), ("wideberth_nlp", "nlp_functions")
STRICT = "-fPIC -O0 -std=c99 -Wall -Wextra -pedantic -Werror"
SOFT = {"penalty": 1e4, "level": {"type": "relaxed", "minimum": 0.5, "weight": 10.0}}
OUTLINE = {"vertices": [[-0.4, -0.2], [0.4, -0.2], [0.4, 0.2], [-0.4, 0.2]]}

PAIRS: dict[str, tuple[dict[str, Any], tuple[int, int, int]]] = {
    "unicycle-mahalanobis": (
        {"robot": "unicycle", "region": "mahalanobis_ellipse", **SOFT},
        (5, 0, 4),
    ),
    "holonomic-minkowski": ({"robot": "holonomic", "region": "minkowski_sum"}, (2, 0, 4)),
    "differential-dual": (
        {
            "robot": {"type": "differential_drive", "footprint": OUTLINE, "radius": 0.5},
            "region": "separating_line",
            "static_region": "dual",
            **SOFT,
        },
        (1, 2, 4),
    ),
    "bicycle-line-stopping": (
        {
            "robot": "bicycle",
            "region": "luetkepohl_rectangle",
            "static_region": "separating_line",
            "fallback": {"stop_at_end": True},
        },
        (1, 1, 6),
    ),
    "discs-no-obstacle": (
        {
            "robot": {
                "type": "unicycle",
                "radius": 0.6,
                "footprint": {"centres": [[-0.3, 0.0], [0.3, 0.0]], "radius": 0.29},
            },
            "region": "minkowski_sum",
            "static_region": "separating_line",
        },
        (0, 1, 4),
    ),
    "flying-contouring": (
        {"robot": "holonomic_3d", "region": "mahalanobis_ellipse", "cost": "contouring", **SOFT},
        (1, 0, 4),
    ),
}


def made(settings: dict[str, Any], sizes: tuple[int, int, int]) -> Subject:
    config = {
        "type": "mpc",
        "predictor": "constant_velocity",
        "level": "fixed",
        "solver": "fatrop",
    }
    planner = build("controllers", {**config, "horizon": 4, "history": 6, **settings})
    return subject(planner, sizes, "test, planner")


@pytest.fixture(scope="module", params=PAIRS)
def exported(request: pytest.FixtureRequest, tmp_path_factory: Any) -> tuple[Subject, Path]:
    one = made(*PAIRS[request.param])
    folder = tmp_path_factory.mktemp("export") / "c"
    write_folder(folder, bundle(one), force=False)
    return one, folder


def make(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        ["make", *words], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )


class Library:
    """The exported functions, called through ctypes."""

    def __init__(self, folder: Path) -> None:
        out = folder / "shared.so"
        assert make(folder, f"CFLAGS={STRICT}", "example").returncode == 0
        objects = [str(folder / f"{name}.o") for name in (*STAGE_FILES, *NLP_FILES)]
        command = [str(COMPILER), "-shared", "-o", str(out), *objects, "-lm"]
        subprocess.run(command, check=True, timeout=120)
        self._library = ctypes.CDLL(str(out))

    def call(self, name: str, size: int, *given: Array) -> Array:
        kind = ctypes.POINTER(ctypes.c_double)
        found = np.full(size, np.nan)
        kept = [np.array(one, dtype=np.float64) for one in (*given,)]
        pointers = [one.ctypes.data_as(kind) if one.size else None for one in kept]
        getattr(self._library, f"wideberth_{name}")(*pointers, found.ctypes.data_as(kind))
        return found

    def table(self, name: str, size: int) -> list[int]:
        return list((ctypes.c_int * size).in_dll(self._library, f"wideberth_{name}"))


@pytest.fixture(scope="module")
def library(exported: tuple[Subject, Path]) -> Library:
    return Library(exported[1])


@needs_compiler
def test_the_example_agrees_and_compiles_without_a_warning(exported: tuple[Subject, Path]) -> None:
    _, folder = exported
    done = make(folder, f"CFLAGS={STRICT}")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "all results agree" in done.stdout and not done.stderr
    data = folder / "example_data.h"
    head, mark, tail = data.read_text().partition("expected_nlp_gradient[")
    begin = tail.index("{\n") + 2
    data.write_text(head + mark + tail[:begin] + " 123.0 + " + tail[begin:].lstrip())
    spoilt = make(folder, f"CFLAGS={STRICT}")
    assert spoilt.returncode != 0 and "WRONG" in spoilt.stdout
    assert "1 results differ" in spoilt.stdout


@needs_compiler
def test_stage_functions_are_the_problems(
    exported: tuple[Subject, Path], library: Library
) -> None:
    """At points of its own, against the functions that the Python solvers use."""
    one, _ = exported
    rng = np.random.default_rng(1)
    functions = {
        **{name: getattr(one.problem, name, None) for name in STAGE},
        **{slots.name: slots.constraint for slots in one.problem.slots},
    }
    for routine in one.stage:
        if routine.name not in (*STAGE, routine.slots):
            continue
        given = [one.argument(routine, name) for name in routine.arguments]
        given = [values + 0.01 * rng.random(values.shape) for values in given]
        wanted = functions[routine.name].call(given)
        flat = np.concatenate([np.array(part, dtype=float).ravel() for part in wanted])
        found = library.call(routine.name, routine.size, *given)
        np.testing.assert_allclose(found, flat, rtol=1e-9, atol=1e-9)


@needs_compiler
def test_derivatives_are_those_of_the_c_functions(
    exported: tuple[Subject, Path], library: Library
) -> None:
    """Central differences of the C values, and of the C Jacobian for the Hessian."""
    one, _ = exported
    for routine in one.stage:
        if routine.name not in (*STAGE, routine.slots) or not routine.size:
            continue
        name, rows = routine.name, routine.size
        by = {"dynamics": 2, "input_cost": 2, "input_constraints": 2, "obstacle": 3, "polygon": 3}
        given = [one.argument(routine, each) for each in routine.arguments]
        first, fixed = given[: by.get(name, 1)], given[by.get(name, 1) :]
        ends = np.cumsum([len(part) for part in first])
        count, weights = int(ends[-1]), one.multipliers[:rows]

        def at(flat: Array, kind: str, size: int, *more: Array) -> Array:
            parts = np.split(flat, ends[:-1])  # noqa: B023
            return library.call(name + kind, size, *parts, *fixed, *more)  # noqa: B023

        point = np.concatenate(first)
        slope = at(point, "_jacobian", rows * count).reshape(count, rows).T
        bend = at(point, "_hessian", count * count, weights).reshape(count, count)
        steps = 1e-6 * np.eye(count)
        rise = [(at(point + h, "", rows) - at(point - h, "", rows)) / 2e-6 for h in steps]
        np.testing.assert_allclose(slope, np.array(rise).reshape(count, rows).T, 1e-5, 1e-4)

        def weighted(flat: Array) -> Array:
            jacobian = at(flat, "_jacobian", rows * count).reshape(count, rows)  # noqa: B023
            return jacobian @ weights  # noqa: B023

        turn = [(weighted(point + h) - weighted(point - h)) / 2e-6 for h in steps]
        np.testing.assert_allclose(bend, np.array(turn).reshape(count, count), 1e-5, 1e-3)
        np.testing.assert_allclose(bend, bend.T, 1e-12, 1e-12)
        assert not count or np.isfinite(bend).all()


@needs_compiler
def test_the_flat_problem(exported: tuple[Subject, Path], library: Library) -> None:
    """Sparse Jacobian and Hessian by the tables, against differences of cost and rows."""
    one, _ = exported
    form, rng = one.layout.form, np.random.default_rng(2)
    point = one.variables + 0.01 * rng.random(len(one.variables))
    count, rows, numbers = len(point), len(form.row_lower), one.numbers
    directions = rng.standard_normal((3, count))
    sizes = {routine.name: routine.size for routine in one.flat}

    def dense(name: str, shape: tuple[int, int], values: Array) -> Array:
        columns = library.table(f"{name}_columns", count + 1)
        inside = library.table(f"{name}_row_indices", sizes[name])
        matrix = np.zeros(shape)
        matrix[inside, np.repeat(np.arange(count), np.diff(columns))] = values
        return matrix

    def both(flat: Array) -> tuple[Array, Array]:
        gradient = library.call("nlp_gradient", count, flat, numbers)
        values = library.call("nlp_jacobian", sizes["nlp_jacobian"], flat, numbers)
        return gradient, dense("nlp_jacobian", (rows, count), values)

    def lagrangian(flat: Array) -> Array:
        gradient, jacobian = both(flat)
        return 0.5 * gradient + jacobian.T @ one.multipliers

    gradient, jacobian = both(point)
    given = (point, numbers, np.array([0.5]), one.multipliers)
    values = library.call("nlp_hessian", sizes["nlp_hessian"], *given)
    upper = dense("nlp_hessian", (count, count), values)
    assert not np.tril(upper, -1).any()
    hessian = upper + np.triu(upper, 1).T
    for way in directions:
        h = 1e-6 * way
        ends = [
            np.append(
                library.call("nlp_cost", 1, p, numbers),
                library.call("nlp_constraints", rows, p, numbers),
            )
            for p in (point + h, point - h)
        ]
        rise = (ends[0] - ends[1]) / 2e-6
        assert gradient @ way == pytest.approx(rise[0], rel=1e-5, abs=1e-3)
        np.testing.assert_allclose(jacobian @ way, rise[1:], 1e-5, 1e-4)
        turn = (lagrangian(point + h) - lagrangian(point - h)) / 2e-6
        scale = max(1.0, float(np.abs(turn).max()))
        np.testing.assert_allclose(hessian @ way, turn, 1e-5, 1e-6 * scale)


@pytest.mark.skipif(shutil.which("c++") is None, reason="there is no C++ compiler here")
def test_the_header_serves_cpp(exported: tuple[Subject, Path]) -> None:
    _, folder = exported
    (folder / "use.cpp").write_text('#include "wideberth.h"\nint main() { return 0; }\n')
    words = ["c++", "-Wall", "-Wextra", "-pedantic", "-Werror", "-fsyntax-only", "use.cpp"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@needs_compiler
def test_functions_of_one_stage_need_no_nlp(exported: tuple[Subject, Path]) -> None:
    assert make(exported[1], f"CFLAGS={STRICT}", "example").returncode == 0
    _, folder = exported
    (folder / "alone.c").write_text(
        '#include "wideberth.h"\n'
        "int main(void) {\n"
        "    double next[WIDEBERTH_STATES];\n"
        "    wideberth_dynamics(wideberth_state_lower, wideberth_input_lower, next);\n"
        "    return 0;\n}\n"
    )
    words = [str(COMPILER), "-o", "alone", "alone.c", *(f"{name}.o" for name in STAGE_FILES)]
    done = subprocess.run([*words, "-lm"], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
