"""Runs an experiment: tasks in, one folder out, resumable, the same bytes on any machine count.

The folder holds manifest.json (the names of all files that the package wrote there), config.yaml
(resolved), provenance.json, table.csv (one line per row measured), times.csv (measured times,
which alone differ from run to run), summary.csv, summary.md and files/. While the work goes on,
shards/ holds one file per finished task; table.csv is written last and says that the run is
complete.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from ...framework.plugins.config import build, describe, import_plugins
from ...framework.plugins.io import read_rows, table_text, write_bytes, write_table, write_text
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError
from .base import Experiment, Result, Row, Task
from .markdown import markdown_table
from .progress import Progress, say
from .provenance import foreign_sources, provenance
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
from .shards import Packed, checked_tasks, finished, read_shard, shard_keys, write_shard
from .showing import fault, told
from .sweep import Pool, Sweep
from .worker import do_task, pack_job

if TYPE_CHECKING:
    from .dask_pool import Scheduler


def run(
    experiment: Experiment,
    out: Path,
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
    out : folder of the result; made if missing. With the same config in it the run resumes.
    workers : processes; the result does not depend on their number.
    quick : run the experiment's reduced copy.
    plugins : modules that every worker imports first.
    fresh : remove the files that an earlier run of any config wrote into the folder; others that
        lie beside them stay.
    scheduler : of a Dask cluster, whose workers do the tasks instead.

    Raises
    ------
    WideberthError : before any work if the folder holds anything else, another config or a
        result of other source code, or cannot be written, or another run is at work there, the
        scheduler does not answer, the tasks are not valid, or `check` refuses; later if a task
        refuses its input, ends its workers, or the disk is full. Finished tasks are kept.
    KeyboardInterrupt : with a message that says how to resume; finished tasks are kept.
    """
    if workers < 1:
        raise WideberthError(f"workers is {workers}; wanted at least 1")
    if scheduler is not None and workers > 1:
        raise WideberthError(
            f"workers is {workers}, and a scheduler has its own; give one of them"
        )
    check_folder(out)
    with told():
        if quick:
            experiment = experiment.quick()
        config: dict[str, Any] = {**describe(experiment), "plugins": list(plugins)}
        keys = shard_keys(config, checked_tasks(experiment.tasks()))
        origin = provenance([*foreign_sources(experiment, plugins), *experiment.inputs()])
    result = Result(out)
    if (out / "table.csv").exists() and not fresh:
        prepare(out, config, origin)
        return result
    with told():
        experiment.check()
    crew = _pool(experiment, plugins, min(workers, len(keys)), scheduler, origin["source"])
    with crew as pool:  # before the folder: where there is no scheduler, no result is thrown away
        prepare(out, config, origin, fresh)
        if not (out / "table.csv").exists():
            with locked(out):
                for path in half_written(out):
                    path.unlink(missing_ok=True)
                _work(experiment, keys, out, origin["source"], pool)
                try:
                    _collect(experiment, list(keys), out, origin["source"])
                except Exception as error:  # a summary may fail in any way
                    raise _kept(error, len(keys), len(keys), out) from error
    return result


@contextmanager
def _pool(
    experiment: Experiment,
    plugins: Sequence[str],
    workers: int,
    scheduler: "Scheduler | None",
    source: str,
) -> Iterator[Pool | None]:
    """Yield the workers, ready; None means this process. They end with the block."""
    if scheduler is None and workers == 1:
        yield None
        return
    job = pack_job(experiment, plugins, source)
    pool: Pool
    if scheduler is None:
        from .local_pool import Processes

        pool = Processes(job, workers)
    else:
        from .dask_pool import Cluster

        pool = Cluster(scheduler, job)
    try:
        yield pool
    finally:
        pool.close()


def _work(
    experiment: Experiment, keys: Mapping[str, Task], out: Path, source: str, pool: Pool | None
) -> None:
    """Do the tasks that are missing, and write the shard of each when it is done."""
    folder = out / "shards"
    usable, reasons = finished(folder, keys, source)
    for reason, number in reasons.items():
        say(f"{number} of {len(keys)} tasks of {out} are done again: their shards are {reason}")
    missing = {key: task for key, task in keys.items() if key not in usable}
    if not missing:
        return
    done = len(usable)

    def keep(key: str, packed: Packed) -> None:
        nonlocal done
        write_shard(folder, key, packed)
        done += 1
        advance()

    try:
        with Progress(len(keys), done) as advance:
            if pool is not None:
                Sweep(pool, missing).run(keep)
            else:
                for key, task in missing.items():
                    keep(key, do_task(experiment, task, source))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"stopped with {done} of {len(keys)} tasks done; they are kept in {out}: "
            "the same command goes on from there"
        ) from None
    except WideberthError as error:
        raise _kept(error, done, len(keys), out) from error


def _kept(error: Exception, done: int, total: int, out: Path) -> WideberthError:
    """Add to an error what it left."""
    if not done:
        return WideberthError(fault(error))
    return WideberthError(
        f"{fault(error)}; {done} of {total} tasks are done and kept in {out}: once that is "
        "mended, the same command goes on from there"
    )


def _collect(experiment: Experiment, keys: Sequence[str], out: Path, source: str) -> None:
    """Bring the shards together in the order of the tasks; table.csv comes last."""
    rows: list[Row] = []
    times: list[Row] = []
    owner: dict[str, str] = {}
    for key in keys:
        outcome = read_shard(out / "shards", key, source)
        if outcome is None:
            raise WideberthError(f"{out}/shards/{key}.json vanished")
        rows += outcome.rows
        times += outcome.times
        for name in outcome.files:
            if owner.setdefault(name, key) != key:
                raise WideberthError(f"two tasks wrote the file {name!r}; names must differ")
    files = {name: PurePosixPath("files") / name for name in owner}
    tables = ["table.csv", "summary.csv", "summary.md", *(["times.csv"] if times else [])]
    claim_files(out, [*tables, *map(str, files.values())])
    for key in dict.fromkeys(owner.values()):
        outcome = read_shard(out / "shards", key, source)  # not all are held in memory at once
        for name, data in outcome.files.items() if outcome else ():
            path = out / files[name]
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, data)
    if times:
        write_table(out / "times.csv", times)
    table = table_text(rows)
    summary = experiment.summary(read_rows(table, "the table"))
    write_table(out / "summary.csv", summary)
    write_text(out / "summary.md", f"{experiment.claim}\n\n{markdown_table(summary)}\n")
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
    if not (folder / "config.yaml").is_file():
        raise WideberthError(f"{folder} holds no result; `wideberth run` makes one")
    if not (folder / "table.csv").is_file():
        raise WideberthError(f"the run in {folder} is not finished; run the same command again")
    config = read_config(folder / "config.yaml", stored=True)
    import_plugins(config.pop("plugins", []))
    experiment: Experiment = build("experiments", config)
    return experiment, Result(folder)


def draw(folder: Path) -> list[Path]:
    """Draw the figures of a finished run into its figures/ and return their files.

    Raises
    ------
    WideberthError : no finished run, the figures cannot be drawn, or one would overwrite a file
        that the manifest does not name; the result stays as it is.
    """
    experiment, result = reopen(folder)
    head = f"the result in {folder} is complete, its figures cannot be drawn: "
    with told(head), tempfile.TemporaryDirectory() as name:
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
