"""Shards: one finished task each, written whole, so that a killed run can go on."""

import base64
import binascii
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from wideberth.framework.errors import WideberthError
from wideberth.framework.io import read_json, table_text, write_json

from .base import Outcome, Row, Task


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


def shard_key(config: Mapping[str, Any], task: Task) -> str:
    """Return the name of a task's shard: a hash of experiment config and task."""
    try:
        text = json.dumps(
            [config, task.name, task.seed, dict(task.settings)], sort_keys=True, allow_nan=True
        )
    except TypeError as error:
        raise WideberthError(f"task {task.name!r}: its settings are not plain ({error})") from None
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def write_shard(folder: Path, key: str, task: Task, outcome: Outcome) -> None:
    """Write what a task found; its times go into a file of their own, first."""
    for name in outcome.files:
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts or not name:
            raise WideberthError(f"task {task.name!r}: file name {name!r} leaves the folder")
    files = {name: base64.b64encode(data).decode() for name, data in outcome.files.items()}
    rows, times = _plain(outcome.rows), _plain(outcome.times)
    if times:
        write_json(folder / f"{key}.times.json", "times", 1, {"task": task.name, "times": times})
    content = {"task": task.name, "timed": bool(times), "rows": rows, "files": files}
    write_json(folder / f"{key}.json", "shard", 1, content)


def _plain(rows: Sequence[Row]) -> list[Row]:
    table_text(rows)  # refuses whatever a table cannot hold
    return [
        {key: value.item() if hasattr(value, "item") else value for key, value in row.items()}
        for row in rows
    ]


def read_shard(folder: Path, key: str) -> Outcome | None:
    """Return what a task found; None if it is not finished, or its shard is damaged."""
    try:
        content = read_json(folder / f"{key}.json", "shard", 1)
        times = []
        if content["timed"]:
            times = read_json(folder / f"{key}.times.json", "times", 1)["times"]
        files = {
            name: base64.b64decode(text, validate=True) for name, text in content["files"].items()
        }
    except (WideberthError, KeyError, binascii.Error):
        return None
    return Outcome(content["rows"], times, files)
