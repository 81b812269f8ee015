"""The shipped object code of the solver is that of the sources, and is used where it fits."""

import json
import lzma
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path

import pytest

from wideberth.framework.jit import store
from wideberth.framework.values.errors import WideberthError
from wideberth.solvers.riccati import compiled, emit, objects

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
ELF_MACHINES = {"x86_64": 62, "aarch64": 183}

fits = pytest.mark.skipif(
    not any(one.needs <= objects.host_features() for one in objects.PROCESSORS.values())
    or not sys.platform.startswith("linux"),
    reason="no object code is shipped for this processor",
)


def test_objects_are_made_from_the_present_sources() -> None:
    said = objects.manifest()
    assert said["sources"] == objects.sources(), "the core has changed: run `make core`"
    assert set(said["objects"]) == set(objects.PROCESSORS)
    assert len(list(objects.FOLDER.iterdir())) == len(objects.PROCESSORS) + 1
    for name, one in objects.PROCESSORS.items():
        code = lzma.decompress((objects.FOLDER / f"{name}.o.xz").read_bytes())
        assert sha256(code).hexdigest() == said["objects"][name]
        assert code[:4] == b"\x7fELF" and code[18] == ELF_MACHINES[one.machine]
        assert objects.ENTRY.encode() in code
        for foreign in (b".py", b"NRT_", b"numba", b"Py", os.fsencode(Path.home())):
            assert foreign not in code, f"{name} holds {foreign!r}"


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
    path = folder / f"{NAME}.o.xz"
    path.write_bytes(path.read_bytes()[:5000])


def changed(folder: Path) -> None:
    path = folder / f"{NAME}.o.xz"
    code = bytearray(lzma.decompress(path.read_bytes()))
    code[len(code) // 2] ^= 1
    path.write_bytes(lzma.compress(code))


def gone(folder: Path) -> None:
    (folder / f"{NAME}.o.xz").unlink()


def not_said(folder: Path) -> None:
    (folder / objects.MANIFEST).write_text("[1, 2]")


def of_other_sources(folder: Path) -> None:
    path = folder / objects.MANIFEST
    path.write_text(json.dumps({**json.loads(path.read_text()), "sources": "0" * 64}))


DAMAGE = [
    (cut, "damaged"), (changed, "another hash"), (gone, "damaged"), (not_said, "core.json is"),
    (of_other_sources, "not that of the present sources"),
]  # fmt: skip


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: Path) -> Path:
    """A copy of the shipped objects, in a process with an empty cache."""
    folder = tmp_path / "objects"
    shutil.copytree(objects.FOLDER, folder)
    monkeypatch.setattr(objects, "FOLDER", folder)
    return folder


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
        objects.shipped(objects.KINDS)
    for _ in range(2):  # compiled, then from the cache
        monkeypatch.setattr(store, "_LOADED", {})
        assert callable(compiled._core.__wrapped__(objects.KINDS))
    said = capsys.readouterr().err
    assert len(calls) == 1 and said.count("compiling solver") == 1 and why in said


@fits
def test_other_processors_and_more_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(WideberthError, match="for 2 kinds of slots, not for 3"):
        objects.shipped(3)
    for change in (
        (objects, "host_features", lambda: frozenset({"sse2"})),
        (objects.platform, "machine", lambda: "riscv64"),
        (sys, "platform", "darwin"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(*change)
            with pytest.raises(WideberthError, match="no shipped object code is for"):
                objects.shipped(objects.KINDS)


@pytest.mark.slow
@pytest.mark.parametrize("name", objects.PROCESSORS)
def test_objects_are_the_same_bytes_made_anew(name: str) -> None:
    said = objects.manifest()
    if said["compiler"] != emit.compiler():
        pytest.skip(f"the objects were made by {said['compiler']}")
    assert sha256(emit.emitted(name)).hexdigest() == said["objects"][name]
