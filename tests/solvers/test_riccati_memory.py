"""The core reads and writes its own memory alone, on problems of any size, and from threads."""

import os
import subprocess
import sys
import sysconfig
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.programs import SOURCES
from wideberth.framework.values.plan import Status
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.random_problems import Draw, draws
from wideberth.tests.helpers.riccati_parts import CORE, SANITIZED, compiler

PROGRAM = Path(__file__).with_name("sanitized.py")


def library_of(command: list[str], name: str) -> str:
    """Path of a library of the compiler; skips where it has none."""
    done = subprocess.run([*command, f"-print-file-name={name}"], capture_output=True, text=True)
    path = done.stdout.strip()
    if not os.path.isabs(path):
        pytest.skip(f"{command[0]} has no {name}")
    return path


def test_random_problems_under_address_and_undefined_behaviour_sanitizer(tmp_path: Path) -> None:
    if not sys.platform.startswith("linux"):
        pytest.skip("the sanitizer is loaded before Python by LD_PRELOAD, which is Linux's")
    command, module = compiler(), tmp_path / "_core.so"
    preloaded = library_of(command, "libasan.so")
    include = f"-I{sysconfig.get_path('include')}"
    build = [
        *command, "-std=c99", *SANITIZED, "-fPIC", "-shared", include, f"-I{SOURCES}",
        "-DPy_LIMITED_API=0x030B0000", *map(str, sorted(CORE.glob("*.c"))), "-o", str(module),
        "-lm",
    ]  # fmt: skip
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    environment = {
        **os.environ, "LD_PRELOAD": preloaded, "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONMALLOC": "malloc",
    }  # fmt: skip
    run = subprocess.run(
        [sys.executable, str(PROGRAM), str(module)], env=environment, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr[-4000:]
    assert int(run.stdout.split()[-1]) >= 20


def test_threads_find_what_one_thread_finds() -> None:
    def digest(draw: Draw) -> bytes:
        problem, parameters, guess = made[draw]
        (found,) = Riccati().solve(problem, parameters, [guess])
        arrays = found.point.states, found.point.inputs, *found.point.auxiliaries
        return b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)

    some = [draw for draw in draws() if draw.steps <= 30][:12]
    made = {draw: draw.make() for draw in some}
    alone = [digest(draw) for draw in some]
    with ThreadPoolExecutor(8) as pool:
        together = list(pool.map(digest, some * 6))
    assert together == alone * 6


def test_any_number_of_kinds_of_slots_is_solved() -> None:
    outcomes = []
    for draw in draws():
        if len(draw.counts) == 3 and draw.iterations == 200 and draw.steps <= 30:
            problem, parameters, guess = draw.make()
            (found,) = Riccati().solve(problem, parameters, [guess])
            assert not found.stand_in
            outcomes.append(found.status)
    assert outcomes.count(Status.SOLVED) >= 3
