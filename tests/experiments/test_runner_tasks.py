"""Finished tasks, tables, files: whole or not there, read back as written, or refused."""

import os
from pathlib import Path

import pytest

from wideberth.experiments.engine.base import Result, Task, TaskOutcome
from wideberth.experiments.engine.csv_tables import read_table, table_text
from wideberth.experiments.engine.tasks import (
    FinishedTask,
    checked_outcome,
    checked_tasks,
    read_task,
    task_keys,
    write_task,
)
from wideberth.framework.plugins.io import read_json, write_bytes, write_json
from wideberth.framework.values.errors import WideberthError


def test_tasks_must_be_there_and_differ() -> None:
    with pytest.raises(WideberthError, match=r"no task"):
        checked_tasks([])
    with pytest.raises(WideberthError, match=r"two tasks are named 'a'"):
        checked_tasks([Task("a"), Task("a", 1)])


def key_of(config: dict[str, object], task: Task) -> str:
    (key,) = task_keys(config, [task])
    return key


def test_a_finished_task_reads_back(tmp_path: Path) -> None:
    task = Task("a", 1, {"x": 0.1})
    key = key_of({"type": "e"}, task)
    assert key != key_of({"type": "e"}, Task("a", 2, {"x": 0.1}))
    assert key != key_of({"type": "f"}, task)
    assert read_task(tmp_path, key) is None
    outcome = TaskOutcome([{"x": 0.1, "nan": float("inf")}], [{"t": 1.0}], {"d/f": b"\x00\xff"})
    write_task(tmp_path, key, task, checked_outcome(task, outcome))
    assert read_task(tmp_path, key) == FinishedTask(outcome.rows, outcome.times, ["d/f"])
    assert (tmp_path / key / "files" / "d" / "f").read_bytes() == b"\x00\xff"
    for name in ("../f", "/f", "", "a/../../f", "a\0"):
        with pytest.raises(WideberthError, match=r"leaves the folder"):
            checked_outcome(task, TaskOutcome(files={name: b""}))
    with pytest.raises(WideberthError, match=r"not plain"):
        key_of({}, Task("a", 0, {"x": object()}))
    with pytest.raises(WideberthError, match=r"not plain"):
        key_of({"x": object()}, task)


def test_a_task_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    outcome = TaskOutcome([{"x": 1}], [{"t": 1.0}])
    for owner, name in ((Path, "write_bytes"), (os, "rename")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, fails)
            with pytest.raises(WideberthError, match=r"k cannot be written: No space left"):
                write_task(tmp_path, "k", Task("a"), outcome)
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["rows.json", "times.json"])
def test_a_damaged_task_is_refused(tmp_path: Path, name: str) -> None:
    write_task(tmp_path, "k", Task("a"), TaskOutcome([{"x": 1}], [{"t": 1.0}]))
    path = tmp_path / "k" / name
    whole = path.read_bytes()
    cuts = [whole[:cut] for cut in (0, 1, len(whole) // 2, len(whole) - 2)]
    for text in (*cuts, whole.replace(b'"version": 2', b'"version": 3')):
        path.write_bytes(text)
        with pytest.raises(WideberthError):
            read_task(tmp_path, "k")
    path.write_bytes(whole)
    assert read_task(tmp_path, "k") is not None


def test_table_reads_back_what_was_written(tmp_path: Path) -> None:
    rows = [
        {"a": 1, "b": 0.1 + 0.2, "c": "text, with\ncomma", "d": True, "e": None},
        {"a": -3, "b": 1e-300, "c": "1_000", "d": False, "f": float("-inf")},
    ]
    path = write_bytes(tmp_path / "t.csv", table_text(rows).encode())
    back = read_table(path)
    assert back[0] == {**rows[0], "f": None}
    assert back[1] == {**rows[1], "e": None}
    assert table_text([]) == "\n"
    with pytest.raises(WideberthError, match=r"column 'a' holds list"):
        table_text([{"a": []}])
    path.write_text("a,b\n1\n")
    with pytest.raises(WideberthError, match=r"line 2: 1 cells; wanted 2"):
        read_table(path)
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(WideberthError, match=r"cannot be read as a table"):
        read_table(path)


def test_writing_is_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_bytes(tmp_path / "f", b"old")

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises(WideberthError, match=r"cannot be written: No space left"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(WideberthError, match=r"cannot be written"):
        write_bytes(tmp_path / "missing" / "f", b"")


def test_json_header(tmp_path: Path) -> None:
    path = write_json(tmp_path / "j", "plan", 2, {"x": 0.1})
    assert read_json(path, "plan", 2) == {"x": 0.1}
    with pytest.raises(WideberthError, match=r"wanted 'wideberth/episode'"):
        read_json(path, "episode", 2)
    with pytest.raises(WideberthError, match=r"version 2; this package reads 1 to 1"):
        read_json(path, "plan", 1)
    path.write_text("{")
    with pytest.raises(WideberthError, match=r"as JSON"):
        read_json(path, "plan", 2)


def test_result_without_files_or_times(tmp_path: Path) -> None:
    write_bytes(tmp_path / "table.csv", b"a\n1\n")
    result = Result(tmp_path)
    assert result.rows == [{"a": 1}] and result.times == [] and result.names() == []


@pytest.mark.parametrize(
    "text", ["a\rb", "\r", "a\r\nb", "a\nb", 'a"b', '"', "a,b", " a ", "a\x85b", "a\u2028b"]
)
@pytest.mark.parametrize("names", [("t",), ("t", "u\r")])
def test_cells_come_back_as_they_were(tmp_path: Path, text: str, names: tuple[str, ...]) -> None:
    rows = [dict.fromkeys(names, text), dict.fromkeys(names, None), dict.fromkeys(names, text)]
    path = write_bytes(tmp_path / "t.csv", table_text(rows).encode())
    assert read_table(path) == rows
