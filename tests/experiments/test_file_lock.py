"""Locks on files: one holder at a time, freed with its process."""

import errno
import subprocess
import sys
import time
from pathlib import Path

import pytest

from wideberth.experiments.engine import file_lock as module
from wideberth.experiments.engine.file_lock import file_lock

HOLDER = """
import sys, time
from pathlib import Path
from wideberth.experiments.engine.file_lock import file_lock
with file_lock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_another_holder_is_refused_until_the_first_lets_go(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    with file_lock(path):
        with pytest.raises(BlockingIOError), file_lock(path):
            pass
        with pytest.raises(BlockingIOError), file_lock(path, patience=0.01):
            pass
    with file_lock(path):
        assert path.exists()


def test_the_system_frees_the_lock_of_a_process_that_dies(tmp_path: Path) -> None:
    path = tmp_path / ".lock"
    command = [sys.executable, "-c", HOLDER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "held\n"
        with pytest.raises(BlockingIOError), file_lock(path):
            pass
        process.kill()
    began = time.monotonic()
    with file_lock(path, patience=30.0):
        assert time.monotonic() - began < 30.0


def test_an_error_inside_is_the_callers_own(tmp_path: Path) -> None:
    with pytest.raises(BlockingIOError, match="mine"), file_lock(tmp_path / ".lock"):
        raise BlockingIOError("mine")
    with file_lock(tmp_path / ".lock"):
        pass


def test_a_disk_without_locks_lets_all_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(handle: int) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(module, "_take", refuse)
    with file_lock(tmp_path / ".lock"), file_lock(tmp_path / ".lock"):
        pass


def test_a_folder_that_is_not_there_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), file_lock(tmp_path / "nowhere" / ".lock"):
        pass
