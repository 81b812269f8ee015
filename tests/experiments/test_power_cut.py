"""What is on the disk before a name is, stays whole."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.engine.base import Task, TaskOutcome
from wideberth.experiments.engine.tasks import flush, write_task


def test_all_of_a_task_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flushed: list[int] = []
    fsync, rename = os.fsync, os.rename

    def noted(handle: int) -> None:
        flushed.append(os.fstat(handle).st_ino)
        fsync(handle)

    def checked(source: Any, target: Any) -> None:
        within = [Path(source), *Path(source).rglob("*")]
        assert len(within) == 5  # the folder, rows, times, files/ and one file
        assert {path.stat().st_ino for path in within} <= set(flushed)
        assert tmp_path.stat().st_ino not in flushed
        rename(source, target)

    monkeypatch.setattr(os, "fsync", noted)
    monkeypatch.setattr(os, "rename", checked)
    write_task(tmp_path, "k", Task("a"), TaskOutcome([{"x": 1}], [{"t": 1.0}], {"f": b"1"}))
    assert flushed[-1] == tmp_path.stat().st_ino


def test_a_disk_that_flushes_no_folders_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(number: int) -> Callable[[int], None]:
        def fsync(_: int) -> None:
            raise OSError(number, os.strerror(number))

        return fsync

    monkeypatch.setattr(os, "fsync", fails(22))
    flush(tmp_path)
    monkeypatch.setattr(os, "fsync", fails(5))
    with pytest.raises(OSError, match=r"Input/output error"):
        flush(tmp_path)
