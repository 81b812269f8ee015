"""The shipped object code of the solver is that of the sources, and is used where it fits."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.jit import interpreter, store
from wideberth.framework.jit import shipped as processors
from wideberth.framework.jit.shipped import PROCESSORS, ShippedCode
from wideberth.framework.values.errors import WideberthError
from wideberth.solvers.export import object_files
from wideberth.solvers.riccati import compiled, emit, objects
from wideberth.tests.solvers.test_riccati_trouble import recorded_instances, solved

NAME = "linux-x86_64-v3"
FIRST = """
import sys, time
from pathlib import Path
from importlib import import_module
sys.path.insert(0, sys.argv[1])
own = import_module("test_riccati_trouble")
solution = own.solved(own.recorded_instances()[0])
print(own.digest(solution), solution.status, "numba" in sys.modules, time.process_time())
"""
COMPARED = """
import sys
sys.modules["llvmlite"] = sys.modules["numba"] = None
from importlib import import_module
sys.path.insert(0, sys.argv[1])
own = import_module("test_riccati_trouble")
for one in own.recorded_instances():
    solution = own.solved(one)
    assert solution.status == "solved" and solution.stand_in == "", solution.message
    print(repr(float(solution.cost)))
"""
ELF_MACHINES = {"x86_64": 62, "aarch64": 183}

fits = pytest.mark.skipif(
    not any(one.needs <= processors.features() for one in PROCESSORS.values())
    or not sys.platform.startswith("linux"),
    reason="no object code is shipped for this processor",
)


@pytest.mark.parametrize("code", [objects.SHIPPED, interpreter.SHIPPED], ids=["core", "programs"])
def test_what_is_shipped_is_made_from_the_present_sources(code: ShippedCode) -> None:
    said = code.manifest()
    assert said["sources"] == code.sources(), "the core has changed: run `make core`"
    assert {one.name for one in code.folder.iterdir()} == {*said["files"], "made.json"}
    for name, one in PROCESSORS.items():
        library = code.read(f"{name}.so")
        assert library[:4] == b"\x7fELF" and library[18] == ELF_MACHINES[one.machine]
        for foreign in (b".py", b"NRT_", b"numba", b"Py", os.fsencode(Path.home())):
            assert foreign not in library, f"{name} holds {foreign!r}"


@pytest.mark.parametrize("name", PROCESSORS)
def test_a_library_holds_the_object_that_is_exported(name: str) -> None:
    code, library = objects.code_for(name), objects.SHIPPED.read(f"{name}.so")
    assert objects.ENTRY.encode() in code and objects.ENTRY.encode() in library
    assert object_files.wanted(code)[-2:] == ("wideberth_give", "wideberth_take")
    assert b"wideberth_take" not in library, "a library takes memory from the C library"


@fits
def test_the_first_solve_needs_no_numba(tmp_path: Path) -> None:
    """With nothing in the cache, then with what the first process left there."""
    found = []
    for _ in range(2):
        ran = subprocess.run(
            [sys.executable, "-c", FIRST, str(Path(__file__).parent)],
            env={**os.environ, "WIDEBERTH_CACHE": str(tmp_path)},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert ran.returncode == 0, ran.stderr
        *words, seconds = ran.stdout.split()
        begun = [line for line in ran.stderr.splitlines() if line.endswith("...")]
        found.append((words, sum("compiling" in line for line in begun)))
        assert float(seconds) < 15.0  # of the processor; 2 where nothing else runs
    assert found[0][0] == found[1][0] and found[0][0][1:] == ["solved", "False"]
    assert [said for _, said in found] == [1, 0]


def cut(folder: Path) -> None:
    path = folder / f"{NAME}.so"
    path.write_bytes(path.read_bytes()[:5000])


def changed(folder: Path) -> None:
    path = folder / f"{NAME}.so"
    code = bytearray(path.read_bytes())
    code[len(code) // 2] ^= 1
    path.write_bytes(code)


def gone(folder: Path) -> None:
    (folder / f"{NAME}.so").unlink()


def not_said(folder: Path) -> None:
    (folder / "made.json").write_text("[1, 2]")


def of_other_sources(folder: Path) -> None:
    path = folder / "made.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "sources": "0" * 64}))


DAMAGE = [
    (cut, "another hash"), (changed, "another hash"), (gone, "missing"),
    (not_said, "made.json is"), (of_other_sources, "not that of the present sources"),
]  # fmt: skip


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the shipped objects, in a process with an empty cache."""
    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "objects"
    shutil.copytree(objects.SHIPPED.folder, folder)
    monkeypatch.setattr(objects, "SHIPPED", replace(objects.SHIPPED, folder=folder))
    return folder


@fits
def test_without_a_compiler_the_same_plan_comes_from_programs(tmp_path: Path) -> None:
    """To rounding: the order of sums is not the compiler's."""
    ran = subprocess.run(
        [sys.executable, "-c", COMPARED, str(Path(__file__).parent)],
        env={**os.environ, "WIDEBERTH_CACHE": str(tmp_path)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    costs = np.array(ran.stdout.split(), dtype=float)
    own = [solved(one) for one in recorded_instances()]
    assert costs.size == len(own) and ran.stderr == ""
    np.testing.assert_allclose(costs, [one.cost for one in own], rtol=1e-9)


@fits
@pytest.mark.parametrize(("damage", "why"), DAMAGE, ids=lambda one: getattr(one, "__name__", ""))
def test_numba_compiles_where_the_object_is_not_sound(
    damage: Callable[[Path], None],
    why: str,
    shipped: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    calls = []
    code = objects.shipped(objects.KINDS)
    monkeypatch.setattr(emit, "compile_in_subprocess", lambda *given: calls.append(given) or code)
    damage(shipped)
    with pytest.raises(WideberthError, match=why):
        objects.library(objects.KINDS)
    for _ in range(2):  # compiled, then from the cache
        monkeypatch.setattr(store, "_LOADED", {})
        assert callable(compiled._core.__wrapped__(objects.KINDS))
    said = capsys.readouterr().err
    assert len(calls) == 1 and said.count("compiling solver") == 1 and why in said


@fits
def test_other_processors_and_more_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WideberthError, match="for 2 kinds of slots, not for 3"):
        objects.library(3)
    for change in (
        (processors, "features", lambda: frozenset({"sse2"})),
        (processors.platform, "machine", lambda: "riscv64"),
        (sys, "platform", "darwin"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(*change)
            with pytest.raises(WideberthError, match="no shipped object code is for"):
                objects.library(objects.KINDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", PROCESSORS)
def test_objects_are_the_same_bytes_made_anew(name: str) -> None:
    said = objects.SHIPPED.manifest()
    if said["compiler"] != emit.compiler():
        pytest.skip(f"the objects were made by {said['compiler']}")
    assert emit.emitted(name) == objects.code_for(name)
