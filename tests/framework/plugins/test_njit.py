"""Loops that Numba compiles: late, announced, and cached where no other user can write."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from wideberth.framework.plugins.njit import cached_njit

LOOPS = """
def half(x):
    return x / 2.0

def quarter(x):
    return half(half(x))

def inverse(x):
    return 1.0 / x
"""
USE = """
import sys
import loops
from wideberth.framework.plugins.njit import cached_njit
assert "numba" not in sys.modules
quarter, inverse = cached_njit([loops.quarter, loops.inverse], [loops.half])
print(quarter(8.0), inverse(0.0), sum(quarter.stats.cache_hits.values()))
"""


def used(folder: Path, script: str = USE, **environment: str) -> tuple[list[str], str]:
    """Return what a script prints in a new process, and its standard error."""
    inherited = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, check=True,
        env={**inherited, "PYTHONPATH": str(folder), **environment},
    )  # fmt: skip
    return done.stdout.split(), done.stderr


@pytest.fixture
def loops(tmp_path: Path) -> Path:
    """A folder with a module of loops."""
    (tmp_path / "loops.py").write_text(LOOPS)
    return tmp_path


LINE = "compiling loops for its first use, some seconds ...\n"


def test_the_first_use_compiles_and_says_so(loops: Path) -> None:
    assert used(loops) == (["2.0", "inf", "0"], LINE)
    assert used(loops) == (["2.0", "inf", "1"], "")


def test_a_quiet_planner_compiles_in_silence(loops: Path) -> None:
    quiet = "from wideberth import recommended\nrecommended(quiet=True)\n" + USE.replace(
        'assert "numba" not in sys.modules\n', ""
    )
    assert used(loops, quiet) == (["2.0", "inf", "0"], "")


def test_without_a_cache_folder_loops_are_compiled_for_one_process(loops: Path) -> None:
    nowhere = loops / "file"
    nowhere.touch()
    (loops / "__pycache__").write_text("no folder")
    places = {"HOME": str(nowhere), "XDG_CACHE_HOME": str(nowhere)}
    for _ in range(2):
        assert used(loops, **places) == (["2.0", "inf", "0"], LINE)


def twice(x: float) -> float:
    return 2.0 * x


def numba_place(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str | None:
    from numba.core import config

    monkeypatch.setattr(config, "CACHE_DIR", str(folder))
    found: str | None = cached_njit([twice])[0].stats.cache_path
    return found


def test_numba_does_not_unpickle_what_others_may_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "numba"
    folder.mkdir(0o700)
    used = numba_place(folder, monkeypatch)
    assert used is not None and Path(used).parent == folder
    file = Path(used) / "x.nbi"
    file.touch(0o600)
    assert numba_place(folder, monkeypatch) == used
    for path, mode in ((folder, 0o777), (Path(used), 0o777), (file, 0o666)):
        before = path.stat().st_mode
        path.chmod(mode)
        assert numba_place(folder, monkeypatch) is None
        path.chmod(before)
    assert numba_place(folder, monkeypatch) == used


def test_numba_takes_no_cache_from_a_file_of_the_working_folder(loops: Path) -> None:
    (loops / ".numba_config.yaml").write_text("cache_dir: evil\n")
    used(loops)
    assert not (loops / "evil").exists() and (loops / "__pycache__").is_dir()
