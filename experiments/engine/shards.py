"""Shards: one finished task each, written whole, so that a killed run can go on.

A shard is made where the task is done (`pack`) and written by the driver alone (`write_shard`).
It carries the fingerprint of the source that measured it: one of another version of the program
is never mixed into a result.
"""

import base64
import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from ...framework.plugins.io import (
    parse_json,
    read_text,
    stamped,
    table_text,
    unstamped,
    write_bytes,
)
from ...framework.values.errors import WideberthError, short
from .base import Row, Task, TaskOutcome

VERSION = 1
"""Of the format. 1 did not name the source."""


LARGEST_SHARD = 2**31
"""Bytes; a shard holds the files of its task."""


@dataclass(frozen=True)
class PackedShard:
    """A finished task as it is stored: what it found, and its times, which differ each time."""

    content: bytes
    times: bytes | None


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


def shard_keys(config: Mapping[str, Any], tasks: Sequence[Task]) -> dict[str, Task]:
    """Return the tasks by the names of their shards: a hash of experiment config and task."""
    try:
        whole = json.dumps(config, sort_keys=True, allow_nan=True)
    except TypeError as error:
        raise WideberthError(f"the config is not plain ({error})") from None
    begun = hashlib.sha256(whole.encode() + b"\0")
    keys = {}
    for task in tasks:
        try:
            text = json.dumps(
                [task.name, task.seed, dict(task.settings)], sort_keys=True, allow_nan=True
            )
        except TypeError as error:
            raise WideberthError(
                f"task {task.name!r}: its settings are not plain ({error})"
            ) from None
        digest = begun.copy()
        digest.update(text.encode())
        keys[digest.hexdigest()[:24]] = task
    return keys


def pack(task: Task, outcome: TaskOutcome, source: str) -> PackedShard:
    """Return a task's shard.

    Raises
    ------
    WideberthError : no outcome, a file name that leaves the folder, or a cell that no table can
        hold.
    """
    if not isinstance(outcome, TaskOutcome):  # of a third party's study
        raise WideberthError(
            f"task {task.name!r}: measure returned {short(outcome)}; wanted Outcome(rows=[...])"
        )
    for name in outcome.files:
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts or not name:
            raise WideberthError(f"task {task.name!r}: file name {name!r} leaves the folder")
    try:
        rows, times = _plain(outcome.rows), _plain(outcome.times)
    except WideberthError as error:
        raise WideberthError(f"task {task.name!r}: {error}") from None
    files = {name: base64.b64encode(data).decode() for name, data in outcome.files.items()}
    origin = {"task": task.name, "source": source}
    content = {**origin, "timed": bool(times), "rows": rows, "files": files}
    packed = _json("shard", content)
    if not times:
        return PackedShard(packed, None)
    return PackedShard(packed, _json("times", {**origin, "times": times}))


def _json(kind: str, content: Mapping[str, Any]) -> bytes:
    return json.dumps(stamped(kind, VERSION, content)).encode() + b"\n"


def _plain(rows: Sequence[Row]) -> list[Row]:
    table_text(rows)  # refuses whatever a table cannot hold
    return [
        {key: value.item() if hasattr(value, "item") else value for key, value in row.items()}
        for row in rows
    ]


def write_shard(folder: Path, key: str, packed: PackedShard) -> None:
    """Write a shard; its times go into a file of their own, first.

    The disk is not waited for: what a power cut leaves of a shard is seen to be damaged.
    """
    if packed.times is not None:
        write_bytes(_times(folder, key), packed.times, synced=False)
    write_bytes(_content(folder, key), packed.content, synced=False)


def _content(folder: Path, key: str) -> Path:
    return folder / f"{key}.json"


def _times(folder: Path, key: str) -> Path:
    return folder / f"{key}.times.json"


class UnusableShard(WideberthError):
    """A shard that is there and cannot be used; ``reason`` says why in a few words."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}; run the same command again")
        self.reason = reason


def read_shard(folder: Path, key: str, source: str) -> TaskOutcome | None:
    """Return what a task found, or None if it is not finished.

    Raises
    ------
    UnusableShard : damaged, or of another version of the program.
    """
    path = _content(folder, key)
    if not path.exists():
        return None
    content = _read(path, "shard", source)
    try:
        times = _read(_times(folder, key), "times", source)["times"] if content["timed"] else []
        for rows in (content["rows"], times):
            table_text(rows)
        files = {
            name: base64.b64decode(text, validate=True) for name, text in content["files"].items()
        }
        return TaskOutcome(content["rows"], times, files)
    except UnusableShard:
        raise
    except (KeyError, AttributeError, TypeError, ValueError):
        raise UnusableShard(path, "damaged") from None


def _read(path: Path, kind: str, source: str) -> dict[str, Any]:
    try:
        content = parse_json(read_text(path, "a shard", LARGEST_SHARD), str(path))
    except WideberthError:
        raise UnusableShard(path, "damaged") from None
    try:
        content = unstamped(content, kind, VERSION, str(path))
    except WideberthError:
        raise UnusableShard(path, "of another version of the program") from None
    if content.get("source") != source:
        raise UnusableShard(path, "of another version of the program")
    return content


def finished(folder: Path, keys: Iterable[str], source: str) -> tuple[set[str], Mapping[str, int]]:
    """Return the names of the shards that can be used, and how many cannot for which reason."""
    usable: set[str] = set()
    reasons: Counter[str] = Counter()
    for key in keys:
        try:
            if read_shard(folder, key, source) is not None:
                usable.add(key)
        except UnusableShard as error:
            reasons[error.reason] += 1
    return usable, reasons
