"""Finished tasks: a folder each, renamed into its place whole, so that a killed run can go on.

``tasks/KEY/`` of a result holds ``rows.json`` (the rows of a task and the names of its files),
``times.json`` (measured times, if there are any) and, until the tables are made, the files. KEY
is a hash of the experiment's config and the task. Only the driver writes there.
"""

import errno
import hashlib
import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...framework.plugins.io import parse_json, read_text, stamped, unstamped
from ...framework.values.errors import WideberthError, short
from .base import Row, Task, TaskOutcome
from .csv_tables import table_text
from .inside import inside, is_inside

TASKS = "tasks"
"""Folder of a result that holds the finished tasks."""
VERSION = 2
"""Of the format. Files of version 1, and earlier ones of version 2, are read as well."""
LARGEST = 2**30
"""Bytes of the rows of one task."""
_FOLDER = re.compile(r"[0-9a-f]{24}|\.[0-9a-f]{24}\.[a-z0-9_]{8}\.part")
"""Name of a finished task's folder, or of one that is not complete."""


@dataclass(frozen=True)
class FinishedTask:
    """A task that was read back.

    Attributes
    ----------
    rows, times : as of `TaskOutcome`.
    files : names of its files.
    """

    rows: list[Row]
    times: list[Row]
    files: list[str]


def checked_tasks(tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks if there is one at least and every name is used once."""
    tasks = list(tasks)
    if not tasks:
        raise WideberthError("the experiment has no task: its config leaves nothing to measure")
    seen: set[str] = set()
    for task in tasks:
        if task.name in seen:
            raise WideberthError(f"two tasks are named {task.name!r}; names must differ")
        seen.add(task.name)
    return tasks


def task_keys(config: Mapping[str, Any], tasks: Sequence[Task]) -> dict[str, Task]:
    """Return the tasks by the names of their folders: a hash of experiment config and task."""
    begun = hashlib.sha256(_plain_json(config, "the config is").encode() + b"\0")
    keys = {}
    for task in tasks:
        content = [task.name, task.seed, dict(task.settings)]
        digest = begun.copy()
        digest.update(_plain_json(content, f"task {task.name!r}: its settings are").encode())
        keys[digest.hexdigest()[:24]] = task
    return keys


def _plain_json(value: Any, what: str) -> str:
    try:
        return json.dumps(value, sort_keys=True, allow_nan=True)
    except TypeError as error:
        raise WideberthError(f"{what} not plain ({error})") from None


def checked_outcome(task: Task, outcome: TaskOutcome) -> TaskOutcome:
    """Return what a task measured, its numbers as those of Python.

    Raises
    ------
    WideberthError : no outcome, a file name that leaves the folder, or a cell that no table can
        hold.
    """
    if not isinstance(outcome, TaskOutcome):  # of a third party's study
        raise WideberthError(
            f"task {task.name!r}: measure returned {short(outcome)}; wanted "
            "TaskOutcome(rows=[...])"
        )
    for name in outcome.files:
        if not is_inside(name):
            raise WideberthError(f"task {task.name!r}: file name {name!r} leaves the folder")
    try:
        return replace(outcome, rows=_plain(outcome.rows), times=_plain(outcome.times))
    except WideberthError as error:
        raise WideberthError(f"task {task.name!r}: {error}") from None


def _plain(rows: Sequence[Row]) -> list[Row]:
    table_text(rows)  # refuses whatever a table cannot hold
    return [
        {key: value.item() if hasattr(value, "item") else value for key, value in row.items()}
        for row in rows
    ]


def write_task(folder: Path, key: str, task: Task, outcome: TaskOutcome) -> None:
    """Write the folder of a finished task below ``folder``; it appears whole or not at all.

    Files and folder are on the disk before the folder gets its name, which a power cut keeps.

    Raises
    ------
    WideberthError : it cannot be written; nothing of it is left.
    """
    content = {"task": task.name, "rows": outcome.rows, "files": list(outcome.files)}
    inside = {"rows.json": _stamped(content)}
    if outcome.times:
        inside["times.json"] = _stamped({"task": task.name, "times": outcome.times})
    inside |= {f"files/{name}": data for name, data in outcome.files.items()}
    try:
        with tempfile.TemporaryDirectory(
            ".part", f".{key}.", folder, ignore_cleanup_errors=True
        ) as made:
            os.chmod(made, 0o755)
            for name, data in inside.items():
                path = Path(made, name)
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
            for path in (*Path(made).rglob("*"), Path(made)):
                flush(path)
            os.rename(made, folder / key)
        flush(folder)
    except OSError as error:
        reason = error.strerror or error
        raise WideberthError(f"{folder / key} cannot be written: {reason}") from None


def flush(path: Path) -> None:
    """Wait until the disk holds the content of a file, or the names in a folder.

    Nothing is waited for on Windows, and where a file system does not flush folders.

    Raises
    ------
    OSError : the path cannot be opened or written.
    """
    if os.name == "nt":  # flushes only what is open for writing
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def _stamped(content: Mapping[str, Any]) -> bytes:
    return json.dumps(stamped("task", VERSION, content)).encode() + b"\n"


def read_task(folder: Path, key: str) -> FinishedTask | None:
    """Return a finished task, or None if it is not finished.

    Raises
    ------
    WideberthError : it is damaged.
    """
    path = inside(folder, key)
    if not path.exists():
        return None
    content = _read(inside(folder, f"{key}/rows.json"))
    timed = inside(folder, f"{key}/times.json")
    times = _read(timed).get("times") if timed.exists() else []
    files = content.get("files")  # earlier ones have a mapping, name -> size and hash
    if not isinstance(files, list | dict) or not all(map(is_inside, files)):
        raise WideberthError(f"{path} is damaged: 'files' must be names in the folder")
    return FinishedTask(_rows(path, content.get("rows")), _rows(path, times), list(files))


def _rows(path: Path, rows: object) -> list[Row]:
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise WideberthError(f"{path} is damaged: wanted rows")
    table_text(rows)  # refuses whatever a table cannot hold
    return rows


def _read(path: Path) -> dict[str, Any]:
    content = parse_json(read_text(path, "a JSON file", LARGEST), str(path))
    return unstamped(content, "task", VERSION, str(path))


def task_folders(folder: Path) -> Iterator[Path]:
    """Yield the folders of tasks below ``folder``, those that are not complete included."""
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if _FOLDER.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
            yield path
