"""More seeds for a result that is there: what was measured is taken over, the rest is measured.

Beside its tables a result keeps tasks.json: which lines and files each task left. From these the
shards are made again, and the run goes on like one that was stopped. Killed at any moment, the
folder holds either the old result, or an unfinished one that the old command and the new one both
finish.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import groupby, islice
from pathlib import Path, PurePosixPath
from typing import Any

from ...framework.plugins.io import read_cells, read_json, read_text
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError
from .base import Row, Task, TaskOutcome
from .progress import say
from .result_folder import (
    CURE,
    MANIFEST,
    SHARDS,
    check_source,
    differing_keys,
    locked,
    owned_files,
    remove_empty,
    write_config,
    write_manifest,
)
from .shards import pack, write_shard

TASKS = "tasks.json"

_KEPT = ("config.yaml", "provenance.json")


def grown(out: Path, config: Mapping[str, Any], fields: Collection[str], source: str) -> bool:
    """Whether a folder holds a result of the same config but for smaller values of ``fields``.

    Raises
    ------
    WideberthError : it does, and other source code or data measured it.
    """
    if not (out / MANIFEST).is_file() or not (out / "config.yaml").is_file():
        return False
    found = read_config(out / "config.yaml", stored=True)
    names = differing_keys(found, config)
    if not names or not set(names) <= set(fields):
        return False
    numbers = [(found.get(name), config[name]) for name in names]
    if not all(type(old) is int and type(new) is int and old < new for old, new in numbers):
        return False
    check_source(out, source)
    return True


def extend(out: Path, config: Mapping[str, Any], tasks: Mapping[str, Task], source: str) -> None:
    """Make the folder of a smaller result that of an unfinished larger one.

    Parameters
    ----------
    out : for which `grown` holds.
    config : of the larger result.
    tasks : of the larger result, by the names of their shards.
    source : fingerprint of the source code.

    Raises
    ------
    WideberthError : another run is at work there; tables, tasks.json or files of the old result
        are missing or do not fit to each other; nothing is changed then.
    """
    done = dict(_outcomes(out, tasks)) if (out / "table.csv").is_file() else {}
    (out / SHARDS).mkdir(exist_ok=True)
    with locked(out):
        if done:
            say(f"{out} is extended: {len(done)} of {len(tasks)} tasks are done")
        for key, outcome in done.items():
            write_shard(out / SHARDS, key, pack(tasks[key], outcome, source))
        (out / "table.csv").unlink(missing_ok=True)  # first: it says that the run is complete
        kept = {out / name for name in (MANIFEST, *_KEPT)}
        old = [
            path for path in owned_files(out) if path not in kept and path.parent.name != SHARDS
        ]
        for path in old:
            path.unlink()
        parents = {parent for path in old for parent in path.relative_to(out).parents}
        for parent in sorted(parents - {Path()}, reverse=True):
            if (out / parent).is_dir():
                remove_empty(out / parent)
        write_manifest(out, _KEPT)
        write_config(out, config)


def task_index(outcomes: Mapping[str, TaskOutcome]) -> dict[str, Any]:
    """Return the content of tasks.json: what each task left, by the names of the shards.

    Lines of a table are runs [number of a list of columns, how many lines], in the order of the
    tasks.
    """
    columns: dict[tuple[str, ...], int] = {}

    def runs(rows: Sequence[Row]) -> list[list[int]]:
        numbers = [columns.setdefault(tuple(row), len(columns)) for row in rows]
        return [[number, len(list(same))] for number, same in groupby(numbers)]

    tasks = {
        key: {
            "rows": runs(outcome.rows),
            "times": runs(outcome.times),
            "files": list(outcome.files),
        }
        for key, outcome in outcomes.items()
    }
    return {"columns": [list(names) for names in columns], "tasks": tasks}


def _outcomes(out: Path, tasks: Mapping[str, Task]) -> Iterator[tuple[str, TaskOutcome]]:
    """Yield what each task left that the larger result has too, its cells as text."""
    if not (out / TASKS).is_file():
        raise WideberthError(
            f"{out} has no {TASKS}, so it is not known which task left which lines; {CURE}"
        )
    index = read_json(out / TASKS, "tasks", 1)
    rows, times = _Lines(out / "table.csv", index), _Lines(out / "times.csv", index)
    for key, left in index["tasks"].items():
        files = {name: (out / "files" / PurePosixPath(name)) for name in left["files"]}
        missing = [name for name, path in files.items() if not path.is_file()]
        if missing:
            raise WideberthError(f"{out} lacks its file files/{missing[0]}; {CURE}")
        outcome = TaskOutcome(
            rows.next(left["rows"]),
            times.next(left["times"]),
            {name: path.read_bytes() for name, path in files.items()},
        )
        if key in tasks:  # a last block that was not full is a task of the smaller result alone
            yield key, outcome
    rows.end()
    times.end()


class _Lines:
    """The lines of a table, handed out from the first to the last."""

    def __init__(self, path: Path, index: Mapping[str, Any]) -> None:
        self._path, self._columns = path, index["columns"]
        text = read_text(path, "a CSV file") if path.is_file() else ""
        self._left = iter(read_cells(text, str(path)))

    def next(self, runs: Sequence[Sequence[int]]) -> list[Row]:
        """Return the next lines, each with the columns that its task wrote."""
        found: list[Row] = []
        for number, count in runs:
            lines = list(islice(self._left, count))
            if len(lines) < count:
                raise self._other()
            found += [{name: line[name] for name in self._columns[number]} for line in lines]
        return found

    def end(self) -> None:
        """Refuse a table with further lines."""
        if next(self._left, None) is not None:
            raise self._other()

    def _other(self) -> WideberthError:
        return WideberthError(
            f"{self._path} has another number of lines than {TASKS} says; {CURE}"
        )
