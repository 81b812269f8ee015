"""Runs an experiment: tasks in, one folder out, resumable, the same bytes on any machine count.

The folder holds manifest.json (the names of all files that the package wrote there), config.yaml
(resolved), provenance.json, table.csv (one line per row measured), times.csv (measured times,
which alone differ from run to run), tasks.json (which task left which lines and files),
summary.csv, summary.md and files/. While the work goes on,
shards/ holds one file per finished task; table.csv is written last and says that the run is
complete.
"""

import tempfile
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from ... import __version__
from ...framework.plugins.config import build, describe, import_plugins
from ...framework.plugins.io import (
    expanded,
    read_json,
    read_rows,
    table_text,
    write_bytes,
    write_json,
    write_table,
    write_text,
)
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError, short
from .base import Experiment, Result, Row, Task, TaskOutcome
from .errors import as_user_error, describe_error
from .extending import TASKS, extend, grown, task_index
from .progress import ProgressLines, say, working
from .provenance import foreign_sources, plugin_modules, provenance
from .quick import left_out
from .result import check_finished
from .result_folder import (
    SHARDS,
    check_folder,
    claim_files,
    half_written,
    locked,
    prepare,
    remove_empty,
    shard_files,
)
from .shards import PackedShard, checked_tasks, finished, read_shard, shard_keys, write_shard
from .text_tables import markdown_table
from .worker import Chunk, Pool, Returned, do_task, pack_job

if TYPE_CHECKING:
    from .dask_pool import Scheduler


@dataclass(frozen=True)
class _Work:
    """An experiment and its tasks, ready to be measured.

    Attributes
    ----------
    experiment, plugins : what to measure, and the modules that workers import first.
    config : the resolved config.
    tasks : by the names of their shards.
    origin : versions, commit, source and machine, as stored beside the result.
    """

    experiment: Experiment
    plugins: tuple[str, ...]
    config: dict[str, Any]
    tasks: dict[str, Task]
    origin: dict[str, Any]

    @property
    def source(self) -> str:
        """Fingerprint of the source code and the data."""
        return str(self.origin["source"])


def run(
    experiment: Experiment,
    out: Path | str,
    workers: int = 1,
    quick: bool = False,
    plugins: Sequence[str] = (),
    fresh: bool = False,
    scheduler: "Scheduler | None" = None,
) -> Result:
    """Run an experiment into a folder, or finish what was begun there.

    Parameters
    ----------
    experiment : what to measure.
    out : folder of the result; made if missing. With the same config in it the run resumes; with
        more of what may grow (`Experiment.growing`, as more seeds) the result is extended.
    workers : processes; the result does not depend on their number.
    quick : run the experiment's reduced copy; a line says what it leaves out.
    plugins : modules that every worker imports first.
    fresh : remove the files that an earlier run of any config wrote into the folder; others that
        lie beside them stay.
    scheduler : of a Dask cluster, whose workers do the tasks instead.

    Raises
    ------
    WideberthError : before any work if it is no experiment, if the folder holds anything else,
        another config or a result of other source code, or cannot be written, or another run is
        at work there, the scheduler does not answer, the tasks are not valid, or `check` refuses;
        later if a task refuses its input, ends its workers, or the disk is full. Finished tasks
        are kept.
    KeyboardInterrupt : with a message that says how to resume; finished tasks are kept.
    """
    if workers < 1:
        raise WideberthError(f"workers is {workers}; wanted at least 1")
    if scheduler is not None and workers > 1:
        raise WideberthError(
            f"workers is {workers}, and a scheduler has its own; give one of them"
        )
    out = expanded(out)
    check_folder(out)
    with as_user_error():
        work = _work(_chosen(experiment, quick), plugins)
    fields = work.experiment.growing
    larger = not fresh and grown(out, work.config, fields, work.source)
    if (out / "table.csv").exists() and not fresh and not larger:
        prepare(out, work.config, work.origin)  # refuses another result
        return Result(out)
    with as_user_error(), working("preparing the run"):
        work.experiment.check()
    # The pool comes before the folder: without a scheduler no old result is thrown away.
    with _pool(work, min(workers, len(work.tasks)), scheduler) as pool:
        if larger:
            extend(out, work.config, work.tasks, work.source)
        prepare(out, work.config, work.origin, fresh)
        if not (out / "table.csv").exists():
            with locked(out):
                for path in half_written(out):
                    path.unlink(missing_ok=True)
                _measure(work, out, pool)
                try:
                    _collect(work, out)
                except Exception as error:  # a summary may fail in any way
                    raise _kept(error, len(work.tasks), work, out) from error
    return Result(out)


def _chosen(experiment: Experiment, quick: bool) -> Experiment:
    """Return the experiment, or its quick copy, of which a line says what it leaves out.

    Raises
    ------
    WideberthError : no experiment, but the name of a config, say.
    """
    if not isinstance(experiment, Experiment):
        raise WideberthError(
            f"run takes an Experiment, and {short(experiment, 60)} was given; read a config by "
            "`experiment, plugins = read_experiment('crossing', [])` of "
            "wideberth.experiments.engine.shipped_configs"
        )
    if not quick:
        return experiment
    small = experiment.quick()
    if less := left_out(describe(experiment), describe(small)):
        say(f"quick: {less}")
    return small


def _work(experiment: Experiment, plugins: Sequence[str]) -> _Work:
    """Resolve the config, list the tasks and record where they come from."""
    settings = describe(experiment)
    # a field that may grow is left out: what was measured with less of it can be used
    fixed = {name: value for name, value in settings.items() if name not in experiment.growing}
    given = {**fixed, "plugins": list(plugins)}
    tasks = shard_keys(given, checked_tasks(experiment.tasks()))
    config = {**settings, "plugins": sorted({*plugins, *plugin_modules(experiment)})}
    origin = provenance([*foreign_sources(experiment, plugins), *experiment.inputs()])
    return _Work(experiment, tuple(plugins), config, tasks, origin)


@contextmanager
def _pool(work: _Work, workers: int, scheduler: "Scheduler | None") -> Iterator[Pool | None]:
    """Yield the workers, ready; None means this process. They end with the block."""
    if scheduler is None and workers == 1:
        yield None
        return
    job = pack_job(work.experiment, work.plugins, work.source)
    pool: Pool
    if scheduler is None:
        from .local_pool import LocalPool

        pool = LocalPool(job, workers)
    else:
        from .dask_pool import Cluster

        pool = Cluster(scheduler, job)
    try:
        yield pool
    finally:
        pool.close()


def _measure(work: _Work, out: Path, pool: Pool | None) -> None:
    """Do the tasks without a shard, and write the shard of each when it is done."""
    folder = out / SHARDS
    usable, reasons = finished(folder, work.tasks, work.source)
    total, done = len(work.tasks), len(usable)
    for reason, number in reasons.items():
        say(f"{number} of {total} tasks of {out} are done again: their shards are {reason}")
    missing = {key: task for key, task in work.tasks.items() if key not in usable}
    if not missing:
        return

    def keep(key: str, packed: PackedShard) -> None:
        nonlocal done
        write_shard(folder, key, packed)
        done += 1
        advance()

    try:
        with ProgressLines(total, done) as advance:
            if pool is not None:
                Sweep(pool, missing).run(keep)
            else:
                for key, task in missing.items():
                    keep(key, do_task(work.experiment, task, work.source))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"stopped with {done} of {total} tasks done; they are kept in {out}: "
            "the same command goes on from there"
        ) from None
    except WideberthError as error:
        raise _kept(error, done, work, out) from error


def _kept(error: Exception, done: int, work: _Work, out: Path) -> WideberthError:
    """Return the error with the number of finished tasks, which are kept."""
    if not done:
        return WideberthError(describe_error(error))
    return WideberthError(
        f"{describe_error(error)}; {done} of {len(work.tasks)} tasks are done and kept in {out}: "
        "once that is corrected, the same command goes on from there"
    )


CHUNK = 0.2
"""s of work that travel together: little beside what sending costs, little to do again."""
LARGEST_CHUNK = 100
"""Tasks."""


class Sweep:
    """Tasks on their way through a pool.

    A chunk that is lost with its worker is done again task by task, each while nothing else is
    out: a Dask worker holds chunks in its queue, which are lost with it through no fault of
    theirs. Whatever then ends a worker as often as the pool's ``patience`` allows is named.
    """

    def __init__(self, pool: Pool, tasks: Mapping[str, Task]) -> None:
        self._pool = pool
        self._waiting = deque(tasks.items())
        self._suspects: set[str] = set()
        self._tried: str | None = None  # the suspect that is out, alone
        self._lost: Counter[str] = Counter()
        self._out = 0
        self._pace = 0.0  # s per task, of late

    def run(self, keep: Callable[[str, PackedShard], None]) -> None:
        """Do all tasks; ``keep`` is called here with each shard, in the order of their ends.

        Raises
        ------
        WideberthError : a task failed, or ends every worker that tries it.
        """
        self._fill()
        while self._out:
            back = self._pool.finished()
            self._out -= len(back)
            faults = [reason for reason in map(self._fault, back) if reason]
            self._fill()  # the workers go on while the driver writes
            for returned in back:
                shards = returned.done.packed if returned.done else []
                for (key, _), packed in zip(returned.chunk, shards, strict=False):
                    keep(key, packed)
            if faults:
                raise WideberthError(faults[0])

    def _fault(self, returned: Returned) -> str | None:
        """Learn from a chunk that came back; return why the sweep cannot go on, if so."""
        if returned.done is None:
            return self._again(returned)
        if returned.done.packed:
            pace = returned.done.seconds / len(returned.done.packed)
            self._pace = 0.5 * (self._pace + pace) if self._pace else pace
        return returned.done.failed

    def _again(self, returned: Returned) -> str | None:
        key, task = returned.chunk[0]
        if key == self._tried:
            self._lost[key] += 1
            if self._lost[key] >= self._pool.patience:
                return f"task {task.name!r} ends every worker that does it ({returned.loss})"
        self._suspects.update(key for key, _ in returned.chunk)
        self._waiting.extendleft(reversed(returned.chunk))
        return None

    def _fill(self) -> None:
        if self._out == 0:
            self._tried = None
        while self._waiting and self._pool.free and self._tried is None:
            key = self._waiting[0][0]
            if key in self._suspects:  # they wait in front
                if self._out:
                    return
                self._tried = key
            self._pool.submit(self._next())
            self._out += 1

    def _next(self) -> Chunk:
        # half of each worker's share of what is left: at the end none waits long for another
        share = ceil(len(self._waiting) / (2 * max(self._pool.slots, 1)))
        size = min(LARGEST_CHUNK, share, int(CHUNK / self._pace) if self._pace else 1)
        chunk = [self._waiting.popleft()]
        while len(chunk) < size and self._tried is None:
            chunk.append(self._waiting.popleft())
        return chunk


def _collect(work: _Work, out: Path) -> None:
    """Write tables and files from the shards, in the order of the tasks; table.csv comes last."""
    rows: list[Row] = []
    times: list[Row] = []
    owner: dict[str, str] = {}
    left: dict[str, TaskOutcome] = {}
    for key in work.tasks:
        outcome = read_shard(out / "shards", key, work.source)
        if outcome is None:
            raise WideberthError(f"{out}/shards/{key}.json vanished")
        rows += outcome.rows
        times += outcome.times
        # not all files are held in memory at once
        left[key] = replace(outcome, files=dict.fromkeys(outcome.files, b""))
        for name in outcome.files:
            if owner.setdefault(name, key) != key:
                raise WideberthError(f"two tasks wrote the file {name!r}; names must differ")
    files = {name: PurePosixPath("files") / name for name in owner}
    tables = ["table.csv", "summary.csv", "summary.md", TASKS, *(["times.csv"] if times else [])]
    claim_files(out, [*tables, *map(str, files.values())])
    for key in dict.fromkeys(owner.values()):
        outcome = read_shard(out / "shards", key, work.source)
        for name, data in outcome.files.items() if outcome else ():
            path = out / files[name]
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, data)
    if times:
        write_table(out / "times.csv", times)
    table = table_text(rows)
    summary = work.experiment.summary(read_rows(table, "the table"))
    write_table(out / "summary.csv", summary)
    write_text(out / "summary.md", f"{work.experiment.claim}\n\n{markdown_table(summary)}\n")
    write_json(out / TASKS, "tasks", 1, task_index(left))
    write_text(out / "table.csv", table)
    for path in shard_files(out):
        path.unlink()
    remove_empty(out / SHARDS)


def reopen(folder: Path) -> tuple[Experiment, Result]:
    """Return the experiment and the result of a finished run.

    Raises
    ------
    WideberthError : no result there, or one that is not finished.
    """
    check_finished(folder)
    config = read_config(folder / "config.yaml", stored=True)
    try:
        import_plugins(config.pop("plugins", []))
        experiment: Experiment = build("experiments", config)
    except WideberthError as error:
        raise WideberthError(f"{folder / 'config.yaml'}: {error}{_written_by(folder)}") from error
    return experiment, Result(folder)


def _written_by(folder: Path) -> str:
    """Return which other version of the package wrote a result, if one did."""
    with suppress(WideberthError):
        wrote = read_json(folder / "provenance.json", "provenance", 1).get("versions", {})
        if wrote.get("wideberth", __version__) != __version__:
            return (
                f"; version {wrote['wideberth']} wrote this result and {__version__} is "
                "installed: run its config again, or install that version"
            )
    return ""


def draw(folder: Path) -> list[Path]:
    """Draw the figures of a finished run into its figures/ and return their files.

    Raises
    ------
    WideberthError : no finished run, the figures cannot be drawn, or one would overwrite a file
        that the manifest does not name; the result stays as it is.
    """
    experiment, result = reopen(folder)
    head = f"the result in {folder} is complete, its figures cannot be drawn: "
    with as_user_error(head), tempfile.TemporaryDirectory() as name:
        drawn = Path(name)
        returned = experiment.figures(result, drawn)
        made = {path: folder / "figures" / path.relative_to(drawn) for path in written(drawn)}
        claim_files(folder, [path.relative_to(folder).as_posix() for path in made.values()])
        (folder / "figures").mkdir(exist_ok=True)
        for path, target in made.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(target, path.read_bytes())
        return [made.get(path, path) for path in returned]


def written(folder: Path) -> Iterator[Path]:
    """Yield every file of a result, sorted, without the shards."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "shards" not in path.relative_to(folder).parts:
            yield path
