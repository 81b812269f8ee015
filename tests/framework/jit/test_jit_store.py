"""Compiled modules are kept, shared by processes, checked, and made again when damaged."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.jit import NUMBA_IMPORTS, address, folder, load, store
from wideberth.framework.values.errors import WideberthError

HEAD = f"from numba import njit, types\n{NUMBA_IMPORTS}\n\n"
DOUBLE = HEAD + "@njit('f8(f8)', cache=True, nogil=True)\ndef double(x):\n    return 2.0 * x\n"
KERNEL = f"""{HEAD}
MATRIX = types.float64[:, ::1]
KERNEL = types.void(types.int64, types.int64, MATRIX, MATRIX, MATRIX)


"""
SQUARE = f"""{KERNEL}@njit(KERNEL, cache=True)
def square(offset, count, v, p, out):
    for c in range(count):
        out[0, c] = v[0, offset + c] ** 2
"""
CORE = f"""{KERNEL}@njit(types.void(types.FunctionType(KERNEL), MATRIX, MATRIX), cache=True)
def by_function(kernel, v, out):
    kernel(0, v.shape[1], v, v, out)


@njit(types.void(types.int64, MATRIX, MATRIX), cache=True)
def by_address(kernel, v, out):
    call(kernel, 0, v.shape[1], v, v, out)
"""
PROCESS = """
import sys
from wideberth.framework.jit import load
said = []
print(load("tested", open(sys.argv[1]).read(), said.append).double(4.0), *said)
"""


pytestmark = pytest.mark.usefixtures("place")


def entries(place: Path) -> list[Path]:
    return sorted(path for path in place.iterdir() if not path.name.startswith("."))


def start(tmp_path: Path) -> subprocess.Popen[str]:
    (tmp_path / "source.py").write_text(DOUBLE)
    command = [sys.executable, "-c", PROCESS, str(tmp_path / "source.py")]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def test_compiles_once(again: Callable[[str], list[str]], place: Path) -> None:
    (line,) = again(DOUBLE)
    assert line.startswith("compiling tested (once)")
    assert again(DOUBLE) == []
    (entry,) = entries(place)
    assert list(entry.rglob("*.nbc")) and not list(place.glob(".unfinished*"))
    assert load("tested", DOUBLE) is load("tested", DOUBLE)


def test_another_source_is_another_module(place: Path) -> None:
    assert load("tested", DOUBLE).double(1.0) == 2.0
    assert load("tested", DOUBLE.replace("2.0", "3.0")).double(1.0) == 3.0
    assert len(entries(place)) == 2


@pytest.mark.parametrize("suffix", [".nbi", ".nbc", ".py", ".json"])
@pytest.mark.parametrize("damage", ["empty", "cut", "changed", "gone"])
def test_damage_is_mended(
    suffix: str, damage: str, again: Callable[[str], list[str]], place: Path
) -> None:
    again(DOUBLE)
    (path,) = (path for path in entries(place)[0].rglob(f"*{suffix}"))
    whole = path.read_bytes()
    middle = len(whole) // 2
    cut = {"empty": b"", "cut": whole[:middle], "changed": whole[:middle] + b"?" + whole[middle:]}
    if damage == "gone":
        path.unlink()
    else:
        path.write_bytes(cut[damage])
    (line,) = again(DOUBLE)
    assert "damaged" in line
    assert again(DOUBLE) == []


def test_sound_files_that_do_not_load_are_made_again(
    again: Callable[[str], list[str]], place: Path
) -> None:
    again(DOUBLE)
    (entry,) = entries(place)
    (index,) = entry.rglob("*.nbi")
    index.write_bytes(b"not an index")
    folder.complete(entry, place / "sealed")  # with the hash of the damaged file
    (place / "sealed").rename(entry)
    assert len(again(DOUBLE)) == 1
    assert again(DOUBLE) == []


def test_processes_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, place: Path) -> None:
    """One compiles while the others wait; Numba's own settings do not move the files."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "elsewhere"))
    running = [start(tmp_path) for _ in range(3)]
    ends = [process.communicate(timeout=120) for process in running]
    assert all(out.startswith("8.0") for out, _ in ends), ends
    assert sum("compiling" in out for out, _ in ends) == 1
    (entry,) = entries(place)
    assert list(entry.rglob("*.nbc")) and not list(place.glob(".unfinished*"))
    assert not list(tmp_path.glob("elsewhere/*"))


def test_where_nothing_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, again: Callable[[str], list[str]]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "file"))
    (line,) = again(DOUBLE)
    assert "this run only" in line
    assert load("tested", DOUBLE) is load("tested", DOUBLE)


def test_a_full_disk(
    monkeypatch: pytest.MonkeyPatch, again: Callable[[str], list[str]], place: Path
) -> None:
    from numba.core.caching import IndexDataCacheFile

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(IndexDataCacheFile, "_save_data", full)
        assert len(again(DOUBLE)) == 1
        assert not entries(place) and not list(place.glob(".unfinished*"))
    assert len(again(DOUBLE)) == 1 and again(DOUBLE) == []


def test_the_oldest_modules_make_room(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for i in range(4):
        load("tested", DOUBLE.replace("2.0", f"{i}.0"))
    modules = entries(place)
    for age, entry in enumerate(modules):
        stamp = time.time() - 1000 * age
        os.utime(entry / "seal.json", (stamp, stamp))
    dead = folder.begin(place)
    os.utime(dead, (0, 0))
    alive = folder.begin(place)
    size = sum(path.stat().st_size for path in modules[0].rglob("*") if path.is_file())
    folder.prune(place, keep=modules[3], budget=int(2.5 * size))
    assert entries(place) == sorted([modules[0], modules[3]])
    assert alive.exists() and not dead.exists()


def test_functions_of_one_module_are_called_by_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    v = np.arange(4.0)[None]
    for _ in range(2):  # compiled, then from the cache
        core, square = load("core", CORE), load("square", SQUARE).square
        for run, kernel in ((core.by_function, square), (core.by_address, address(square))):
            out = np.zeros((1, 4))
            run(kernel, v, out)
            np.testing.assert_array_equal(out, v**2)
        monkeypatch.setattr(store, "_LOADED", {})


def test_threads() -> None:
    with ThreadPoolExecutor(4) as pool:
        modules = list(pool.map(lambda _: load("tested", DOUBLE), range(8)))
        assert len(set(map(id, modules))) == 1
        assert list(pool.map(modules[0].double, range(100))) == [2.0 * i for i in range(100)]


def test_other_signatures_are_refused() -> None:
    """They would be compiled outside the cache."""
    with pytest.raises(TypeError, match="No matching definition"):
        load("tested", DOUBLE).double("text")


@pytest.mark.parametrize("source", ["def f(:", "1 / 0", DOUBLE.replace("2.0 * x", "x.colour")])
def test_a_source_that_does_not_compile(source: str, place: Path) -> None:
    with pytest.raises(WideberthError, match="'tested' does not compile"):
        load("tested", source)
    assert not entries(place) and not list(place.glob(".unfinished*"))


def test_numba_switched_off(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("numba.core.config.DISABLE_JIT", 1)
    with pytest.raises(WideberthError, match="NUMBA_DISABLE_JIT"):
        load("tested", DOUBLE)
