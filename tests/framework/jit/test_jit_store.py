"""Compiled code is kept, shared by processes, checked, and made again when damaged."""

import ctypes
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from ctypes import CFUNCTYPE, c_double
from pathlib import Path

import pytest

from wideberth.framework.jit import cache, load, machine
from wideberth.framework.values.errors import WideberthError

DOUBLE = """define double @double(double %x) {
  %y = fmul double 2.0, %x
  ret double %y
}
"""
PROCESS = """
import sys
from ctypes import CFUNCTYPE, c_double
from wideberth.framework.jit import load, store
store.WORTH, said = 0.0, []
place = load("tested", open(sys.argv[1]).read(), ["double"], said.append)["double"]
print(CFUNCTYPE(c_double, c_double)(place)(4.0), *said)
"""


pytestmark = pytest.mark.usefixtures("place")


def entries(place: Path) -> list[Path]:
    return sorted(path for path in place.iterdir() if not path.name.startswith("."))


def called(source: str, x: float) -> float:
    place = load("tested", source, ["double"])["double"]
    return float(CFUNCTYPE(c_double, c_double)(place)(x))


def start(tmp_path: Path) -> subprocess.Popen[str]:
    (tmp_path / "source.py").write_text(DOUBLE)
    command = [sys.executable, "-c", PROCESS, str(tmp_path / "source.py")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_compiles_once(again: Callable[[str], list[str]], place: Path) -> None:
    (line,) = again(DOUBLE)
    assert line.startswith("compiling tested (once)")
    assert again(DOUBLE) == []
    (entry,) = entries(place)
    assert entry.is_file() and not list(place.glob(".unfinished*"))
    assert load("tested", DOUBLE, ["double"]) is load("tested", DOUBLE, ["double"])


def test_another_source_is_another_module(place: Path) -> None:
    assert called(DOUBLE, 1.0) == 2.0
    assert called(DOUBLE.replace("2.0", "3.0"), 1.0) == 3.0
    assert len(entries(place)) == 2


@pytest.mark.parametrize("damage", ["empty", "hash cut", "cut", "changed"])
def test_damaged_code_is_made_again(
    damage: str, again: Callable[[str], list[str]], place: Path
) -> None:
    again(DOUBLE)
    (path,) = entries(place)
    whole = path.read_bytes()
    middle = len(whole) // 2
    cut = {"empty": b"", "hash cut": whole[:31], "cut": whole[:middle]}
    cut["changed"] = whole[:middle] + b"?" + whole[middle:]
    path.write_bytes(cut[damage])
    (line,) = again(DOUBLE)
    assert "damaged" in line
    assert again(DOUBLE) == []


def test_sound_files_that_do_not_load_are_made_again(
    again: Callable[[str], list[str]], place: Path
) -> None:
    again(DOUBLE)
    (entry,) = entries(place)
    cache.write(entry, b"no object file")  # with its hash
    assert len(again(DOUBLE)) == 1
    assert again(DOUBLE) == []


def test_processes_at_once(tmp_path: Path, place: Path) -> None:
    """One compiles while the others wait."""
    running = [start(tmp_path) for _ in range(3)]
    ends = [process.communicate(timeout=120) for process in running]
    assert all(out.startswith("8.0") for out, _ in ends), ends
    assert sum("compiling" in out for out, _ in ends) == 1
    (entry,) = entries(place)
    assert entry.is_file() and not list(place.glob(".unfinished*"))


def test_where_nothing_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, again: Callable[[str], list[str]]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "file"))
    (line,) = again(DOUBLE)
    assert "this run only" in line
    assert load("tested", DOUBLE, ["double"]) is load("tested", DOUBLE, ["double"])


def test_a_full_disk(
    monkeypatch: pytest.MonkeyPatch, again: Callable[[str], list[str]], place: Path
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        _, line = again(DOUBLE)
        assert "for this run only: [Errno 28]" in line
        assert not entries(place) and not list(place.glob(".unfinished*"))
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_the_oldest_modules_make_room(place: Path) -> None:
    for i in range(4):
        called(DOUBLE.replace("2.0", f"{i + 3}.0"), 1.0)  # of the same size
    modules = entries(place)
    for age, entry in enumerate(modules):
        stamp = time.time() - 1000 * age
        os.utime(entry, (stamp, stamp))
    dead, alive, other = place / ".unfinished-1", place / ".unfinished-2", place / "mine"
    for path in (dead, alive, other):
        path.touch()
    os.utime(dead, (0, 0))
    assert cache.read(modules[1]) is not None  # which is a use
    cache.prune(place, budget=int(2.5 * modules[0].stat().st_size))
    assert entries(place) == sorted([modules[0], modules[1], other])
    assert alive.exists() and not dead.exists()


def test_threads() -> None:
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda _: load("tested", DOUBLE, ["double"]), range(8)))
        assert len(set(map(id, found))) == 1
        assert list(pool.map(lambda i: called(DOUBLE, i), range(100))) == [
            2.0 * i for i in range(100)
        ]


@pytest.mark.parametrize("source", ["define f(:", DOUBLE.replace("%x\n", "%colour\n")])
def test_a_source_that_does_not_compile(source: str, place: Path) -> None:
    with pytest.raises(WideberthError, match="LLVM refuses generated code"):
        load("tested", source, ["double"])
    assert not entries(place) and not list(place.glob(".unfinished*"))


def test_what_code_lacks_is_an_error(place: Path) -> None:
    """A function that is not there, and one that no library has; LLVM alone ends the process."""
    with pytest.raises(WideberthError, match="does not load"):
        load("tested", DOUBLE, ["triple"])
    unknown = DOUBLE.replace("fmul double 2.0,", "call double @nowhere(double").replace(
        "%x\n", "%x)\n"
    )
    with pytest.raises(WideberthError, match="does not load"):
        load("tested", f"declare double @nowhere(double)\n{unknown}", ["double"])


def test_without_llvmlite(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    for one in (machine.llvm, machine.host):
        one.cache_clear()
    with pytest.raises(WideberthError, match="llvmlite, which cannot be imported"):
        load("tested", DOUBLE, ["double"])


@pytest.mark.parametrize("known", [machine._LIBRARY, ("sin", "pow")])
def test_the_library_is_searched_only_where_functions_lack(
    known: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The search starts other programs and may find no place for temporary files."""
    searched = []

    def search(name: str) -> str:
        searched.append(name)
        raise FileNotFoundError(2, "No usable temporary directory found")

    real = machine._addresses(ctypes.CDLL(None))
    monkeypatch.setattr(machine, "_addresses", lambda _: {name: real[name] for name in known})
    monkeypatch.setattr(machine.ctypes.util, "find_library", search)
    found = machine._of_the_system.__wrapped__()
    assert set(found) - {*machine.MEMORY} == set(known)
    assert searched == ([] if known == machine._LIBRARY else ["m"])


def test_a_lock_of_one_stem_is_not_that_of_another(place: Path) -> None:
    """Kernels of a second do not wait for a solver of minutes, whatever their hashes are."""
    root = cache.folder()
    waited = []

    @contextmanager
    def waiting() -> Iterator[None]:
        waited.append(True)
        yield

    with cache.alone(root / f"wideberth_solver_{0:020x}.o", waiting()):
        for k in range(64):
            with cache.alone(root / f"wideberth_kernels_{k:020x}.o", waiting()):
                pass
    assert not waited
