"""Parts of the solver's C core, compiled for tests of their own."""

import ctypes
import os
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.framework.programs import SOURCES
from wideberth.framework.values.arrays import Array, address
from wideberth.solvers.riccati.workspace import (
    KindTable,
    ProblemTable,
    SettingsTable,
    SlotsTable,
    StartTable,
)

ROOT = Path(__file__).resolve().parents[2]
CORE = ROOT / "solvers" / "riccati" / "core"
SANITIZED = ["-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined"]


def compiler() -> list[str]:
    """Command of the C compiler; tests are skipped where there is none."""
    command = shlex.split(os.environ.get("CC") or "cc")
    if shutil.which(command[0]) is None:
        pytest.skip(f"no C compiler: {command[0]} is not found")
    return command


def compile_parts(folder: Path) -> ctypes.CDLL:
    """Compile riccati_parts.c as a shared library."""
    library = folder / "parts.so"
    source = ROOT / "tests" / "solvers" / "riccati_parts.c"
    command = [
        *compiler(), "-std=c99", "-O1", "-fPIC", "-shared", f"-I{SOURCES}", f"-I{CORE}",
        str(source), "-o", str(library), "-lm",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(library))


class Parts:
    """The arrays of a solve that is laid out, of no or one kind of slots.

    Parameters
    ----------
    library : see `compile_parts`.
    problem : sizes.
    kind, active : of slots; those above 0 are in use.
    settings, plans : of the solve; states of plans that are known.
    """

    def __init__(
        self,
        library: Any,
        problem: ProblemTable,
        kind: KindTable | None = None,
        active: Sequence[float] = (),
        settings: SettingsTable | None = None,
        plans: Array | None = None,
    ) -> None:
        self.library, self.problem = library, problem
        w, self.wide = problem.n + problem.m, 8 * ((problem.steps + 8) // 8)
        free = np.full(w, np.inf)
        lower = -free
        problem.lower, problem.upper = address(lower), address(free)
        kinds = (KindTable * 1)(*([kind] if kind else []))
        problem.kinds, problem.kind = int(kind is not None), ctypes.addressof(kinds)
        used = np.array(active, dtype=np.float64)
        slots = (SlotsTable * 1)(SlotsTable(active=address(used)))
        start = StartTable(slots=ctypes.addressof(slots))
        start.plans = None if plans is None else address(plans)
        settings = settings or SettingsTable()
        settings.minimum = -np.inf
        library.wb_size.restype = ctypes.c_int64
        memory = np.full(library.wb_size(ctypes.byref(problem)), np.nan)
        tables = (problem, settings, start)
        library.parts_prepare(*map(ctypes.byref, tables), ctypes.c_void_p(address(memory)))
        self._kept = lower, free, kinds, used, slots, start, settings, memory, plans
        library.parts_array.restype = library.parts_multiplier_step.restype = ctypes.c_void_p
        library.parts_multiplier_step.argtypes = [ctypes.c_int64]
        library.parts_level_step.restype = ctypes.c_double

    def array(self, name: str, rows: int, columns: int = 0) -> Array:
        """View of an array of the core."""
        return self._view(self.library.parts_array(name.encode()), rows, columns)

    def multiplier_step(self, row: int) -> Array:
        """View of the steps of an inequality's multiplier."""
        step: Array = self._view(self.library.parts_multiplier_step(row), 1, 0)[0]
        return step

    def _view(self, place: int, rows: int, columns: int) -> Array:
        columns = columns or self.wide
        if not rows:
            return np.zeros((0, columns))
        view: Array = np.asarray((ctypes.c_double * (rows * columns)).from_address(place))
        return view.reshape(rows, columns)

    def numbers(self, mu: float, rho: float, delta: float, weight: float, level: float) -> None:
        """Set barrier, price, regularisations, and the step of the level."""
        self.library.parts_numbers(*map(ctypes.c_double, (mu, rho, delta, weight, level)))
