"""Runs an experiment: tasks in, one folder out, resumable, the same bytes on any machine count.

The folder holds config.yaml (resolved), provenance.json, table.csv (one line per row measured),
times.csv (measured times, which alone differ from run to run), summary.csv, summary.md and
files/. While the work goes on, shards/ holds one file per finished task; table.csv is written
last and says that the run is complete.
"""

import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

from wideberth.framework.config import build, describe, import_plugins
from wideberth.framework.errors import WideberthError
from wideberth.framework.io import (
    read_json,
    read_table,
    write_bytes,
    write_json,
    write_table,
    write_text,
)
from wideberth.framework.yamlfile import dump, read_config

from .base import Experiment, Result, Row, Task
from .progress import Progress
from .provenance import foreign_sources, provenance
from .shards import checked_tasks, read_shard, shard_key, write_shard
from .showing import fault, shown


def run(
    experiment: Experiment,
    out: Path,
    workers: int = 1,
    quick: bool = False,
    plugins: Sequence[str] = (),
    fresh: bool = False,
) -> Result:
    """Run an experiment into a folder, or finish what was begun there.

    Parameters
    ----------
    experiment : what to measure.
    out : folder of the result; made if missing. With the same config in it the run resumes.
    workers : processes; the result does not depend on their number.
    quick : run the experiment's reduced copy.
    plugins : modules that every worker imports first.
    fresh : throw away what an earlier run of any config left in the folder.

    Raises
    ------
    WideberthError : before any work if the folder holds anything else, another config or a
        result of other source code, or cannot be written, or the tasks are not valid; later if
        a task refuses its input.
    KeyboardInterrupt : with a message that says how to resume; finished tasks are kept.
    """
    if workers < 1:
        raise WideberthError(f"workers is {workers}; wanted at least 1")
    if quick:
        experiment = experiment.quick()
    config: dict[str, Any] = {**describe(experiment), "plugins": list(plugins)}
    tasks = checked_tasks(experiment.tasks())
    keys = {shard_key(config, task): task for task in tasks}
    others = [*foreign_sources(experiment, plugins), *experiment.inputs()]
    prepare(out, config, fresh, others)
    result = Result(out)
    if (out / "table.csv").exists():
        return result
    missing = {key: task for key, task in keys.items() if read_shard(out / "shards", key) is None}
    try:
        _work_all(experiment, missing, out / "shards", workers, plugins)
    except KeyboardInterrupt:
        kept = sum(read_shard(out / "shards", key) is not None for key in keys)
        raise KeyboardInterrupt(
            f"stopped with {kept} of {len(keys)} tasks done; they are kept in {out}: "
            "the same command goes on from there"
        ) from None
    _collect(experiment, list(keys), out)
    return result


def prepare(
    out: Path, config: dict[str, Any], fresh: bool = False, others: Sequence[Path] = ()
) -> None:
    """Make the folder with config and provenance in it, or check those that stand there."""
    origin = provenance(others)
    try:
        if fresh and (out / "config.yaml").exists():
            shutil.rmtree(out)
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            _check_same(out, config, origin["source"])
            return
        out.parent.mkdir(parents=True, exist_ok=True)
        begun = Path(tempfile.mkdtemp(".part", f".{out.name}.", out.parent))
    except OSError as error:
        raise WideberthError(
            f"the result cannot be written to {out} ({error.strerror or error}); "
            "give another folder with --out"
        ) from None
    begun.chmod(0o755)
    (begun / "shards").mkdir()
    write_json(begun / "provenance.json", "provenance", 1, origin)
    write_text(begun / "config.yaml", dump(config))
    try:
        os.replace(begun, out)  # the folder is there with both files or not at all
    except OSError:
        shutil.rmtree(begun)
        raise WideberthError(
            f"{out} was begun by another run at the same moment; let that one finish, or give "
            "another folder with --out"
        ) from None


def _check_same(out: Path, config: dict[str, Any], source: str) -> None:
    cure = "give another folder with --out, or throw the old result away with --fresh"
    if not (out / "config.yaml").is_file():
        raise WideberthError(f"{out} exists and holds no result; give another folder with --out")
    found = read_config(out / "config.yaml")
    if found != config:
        differing = sorted(key for key in {*found, *config} if found.get(key) != config.get(key))
        raise WideberthError(
            f"{out} holds the result of another config (it differs in {', '.join(differing)}); "
            f"{cure}"
        )
    stored = read_json(out / "provenance.json", "provenance", 1)
    if stored.get("source") != source:
        raise WideberthError(f"{out} was measured by other source code or data; {cure}")
    (out / "shards").mkdir(exist_ok=True)


def _work_all(
    experiment: Experiment,
    missing: dict[str, Task],
    folder: Path,
    workers: int,
    plugins: Sequence[str],
) -> None:
    from joblib import Parallel, delayed, parallel_config

    settings = {"inner_max_num_threads": 1} if workers > 1 else {}
    with Progress(len(missing)) as advance, parallel_config("loky", **settings):
        jobs = (
            delayed(_work)(experiment, task, folder, key, plugins, workers > 1)
            for key, task in missing.items()
        )
        for _ in Parallel(n_jobs=workers, return_as="generator_unordered")(jobs):
            advance()


def _work(
    experiment: Experiment,
    task: Task,
    folder: Path,
    key: str,
    plugins: Sequence[str],
    own_process: bool,
) -> None:
    """Do one task and write its shard; runs in a worker."""
    if own_process:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the main process stops the workers
    import_plugins(plugins)
    with _Interrupt() as interrupt:
        try:
            outcome = experiment.measure(task)
        except Exception as error:  # a plug-in may fail in any way; say where
            interrupt.check()
            raise WideberthError(f"task {task.name!r}: {fault(error)}") from error
        interrupt.check()
    write_shard(folder, key, task, outcome)


class _Interrupt:
    """Remembers a Ctrl-C during a task.

    IPOPT and fatrop may swallow the KeyboardInterrupt raised inside them and report a
    failed solve; a result made from that must not be kept.
    """

    def __init__(self) -> None:
        self._pressed = False
        self._before: Any = None

    def __enter__(self) -> "_Interrupt":
        if threading.current_thread() is threading.main_thread():
            before = signal.getsignal(signal.SIGINT)
            if callable(before):  # a worker process ignores the signal
                self._before = before
                signal.signal(signal.SIGINT, self._press)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _press(self, number: int, frame: Any) -> None:
        self._pressed = True
        self._before(number, frame)

    def check(self) -> None:
        """Raise the KeyboardInterrupt that was swallowed, if one was."""
        if self._pressed:
            raise KeyboardInterrupt


def _collect(experiment: Experiment, keys: Sequence[str], out: Path) -> None:
    """Bring the shards together in the order of the tasks; table.csv comes last."""
    rows: list[Row] = []
    times: list[Row] = []
    owner: dict[str, str] = {}
    for key in keys:
        outcome = read_shard(out / "shards", key)
        if outcome is None:
            raise WideberthError(f"{out}/shards/{key}.json vanished; run the same command again")
        rows += outcome.rows
        times += outcome.times
        for name, data in outcome.files.items():
            if owner.setdefault(name, key) != key:
                raise WideberthError(f"two tasks wrote the file {name!r}; names must differ")
            path = out / "files" / PurePosixPath(name)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, data)
    if times:
        write_table(out / "times.csv", times)
    partial = write_table(out / ".table.part", rows)
    summary = experiment.summary(read_table(partial))
    write_table(out / "summary.csv", summary)
    write_text(out / "summary.md", _markdown(experiment.claim, summary))
    partial.replace(out / "table.csv")
    shutil.rmtree(out / "shards")


def _markdown(claim: str, rows: Sequence[Row]) -> str:
    columns = list(dict.fromkeys(name for row in rows for name in row))
    lines = [claim, "", f"| {' | '.join(columns)} |", "|" + " --- |" * len(columns)]
    lines += [f"| {' | '.join(shown(row.get(name)) for name in columns)} |" for row in rows]
    return "\n".join(lines) + "\n"


def reopen(folder: Path) -> tuple[Experiment, Result]:
    """Return the experiment and the result of a finished run.

    Raises
    ------
    WideberthError : no result there, or one that is not finished.
    """
    if not (folder / "config.yaml").is_file():
        raise WideberthError(f"{folder} holds no result; `wideberth run` makes one")
    if not (folder / "table.csv").is_file():
        raise WideberthError(f"the run in {folder} is not finished; run the same command again")
    config = read_config(folder / "config.yaml")
    import_plugins(config.pop("plugins", []))
    experiment: Experiment = build("experiments", config)
    return experiment, Result(folder)


def draw(folder: Path) -> list[Path]:
    """Draw the figures of a finished run into its figures/ and return their files."""
    experiment, result = reopen(folder)
    target = folder / "figures"
    target.mkdir(exist_ok=True)
    return experiment.figures(result, target)


def written(folder: Path) -> Iterator[Path]:
    """Yield every file of a result, sorted, without the shards."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "shards" not in path.relative_to(folder).parts:
            yield path
