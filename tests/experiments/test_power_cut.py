"""What a power cut damages is done again; what is on the disk before a name is, stays whole."""

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.engine import runner
from wideberth.experiments.engine.base import Task, TaskOutcome
from wideberth.experiments.engine.runner import run
from wideberth.experiments.engine.tasks import read_task, write_task
from wideberth.framework.plugins import io
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.sweeps import coins, contents

pytestmark = pytest.mark.usefixtures("helpers_on_path")


def begun(out: Path) -> list[Path]:
    """Do all tasks of a run, and no table; return their folders."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, "_collect", None)
        with pytest.raises(WideberthError, match=r"3 of 3 tasks are done and kept"):
            run(coins(), out)
    return sorted(path for path in (out / "tasks").iterdir() if path.is_dir())


def emptied(path: Path) -> None:
    path.write_bytes(b"")


def of_zeros(path: Path) -> None:
    """Write zeros, as some file systems leave them: the size is right."""
    path.write_bytes(bytes(path.stat().st_size))


def only_file(task: Path) -> Path:
    (path,) = (task / "files" / "seed").iterdir()
    return path


DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "empty file": (lambda task: emptied(only_file(task)), r"bin is not what the task wrote"),
    "zeros": (lambda task: of_zeros(only_file(task)), r"bin is not what the task wrote"),
    "no file": (lambda task: only_file(task).unlink(), r"bin is missing"),
    "no times": (lambda task: (task / "times.json").unlink(), r"times.json is missing"),
    "empty times": (lambda task: emptied(task / "times.json"), r"times.json cannot be read"),
    "empty rows": (lambda task: emptied(task / "rows.json"), r"rows.json cannot be read"),
}


@pytest.mark.parametrize("kind", DAMAGES)
def test_a_damaged_task_is_done_again_and_the_reason_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    damage, words = DAMAGES[kind]
    tasks = begun(tmp_path / "a")
    kept = {path: path.stat().st_ino for path in tasks[1:]}
    damage(tasks[0])
    run(coins(), tmp_path / "a")
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "done again" in line]
    assert f"1 of 3 tasks of {tmp_path / 'a'} are done again" in line
    assert re.search(words, line)
    assert {path: path.stat().st_ino for path in tasks[1:]} == kept
    run(coins(), tmp_path / "whole")
    assert contents(tmp_path / "a") == contents(tmp_path / "whole")


def test_a_file_that_was_moved_is_looked_at_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "a"
    run(coins(), out)
    (out / "table.csv").unlink()
    emptied(out / "files" / "seed" / "1.bin")
    run(coins(), out)
    assert "1 of 3 tasks" in capsys.readouterr().err
    run(coins(), tmp_path / "whole")
    assert contents(out) == contents(tmp_path / "whole")


def test_tasks_of_the_first_format_are_done_again_where_they_have_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It stored neither size nor hash of a file; rows alone are read as before."""
    first, second, _ = begun(tmp_path / "a")
    for task, files in ((first, True), (second, False)):
        path = task / "rows.json"
        content: dict[str, Any] = json.loads(path.read_text())
        content |= {"version": 1, "files": list(content["files"]) if files else []}
        del content["timed"]
        path.write_text(json.dumps(content))
    former = read_task(second.parent, second.name)
    assert former is not None and len(former.rows) == 1 and not former.files
    run(coins(), tmp_path / "a")
    said = capsys.readouterr().err
    assert "1 of 3 tasks" in said and "version 1 stored no hash of" in said


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
    io.flush(tmp_path)
    monkeypatch.setattr(os, "fsync", fails(5))
    with pytest.raises(OSError, match=r"Input/output error"):
        io.flush(tmp_path)
