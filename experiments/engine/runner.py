"""Runs an experiment: tasks in, one folder out, resumable, the same bytes on any machine count.

The folder holds config.yaml (resolved), provenance.json, table.csv (one line per row measured),
times.csv (measured times, which alone differ from run to run), summary.csv, summary.md, files/
and tasks/: a folder per finished task, of which the tables are made. table.csv is written last
and says that the run is complete.
"""

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ... import __version__
from ...framework.plugins.config import build, describe
from ...framework.plugins.io import expanded, read_json, write_bytes, write_text
from ...framework.plugins.registry import as_data, note_not_built
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError, short
from ...framework.values.failures import Take, reporting
from .base import Experiment, Result, Row, Task, TaskOutcome
from .csv_tables import read_rows, table_text, write_table
from .errors import as_user_error, describe_error
from .extract import markdown_text, of_rows
from .inside import inside
from .pool import LocalPool, Pool, sweep
from .progress import progress, say, working
from .provenance import foreign_sources, plugin_modules, provenance
from .result import check_finished
from .result_folder import (
    check_config,
    check_folder,
    check_same,
    half_written,
    locked,
    move_file,
    note_figures,
    prepare,
    remove_files,
    remove_task,
)
from .tasks import TASKS, checked_tasks, read_task, task_folders, task_keys, write_task
from .text_tables import columns_of
from .worker import measured, pack_job


@dataclass(frozen=True)
class _Work:
    """An experiment and its tasks, ready to be measured.

    Attributes
    ----------
    experiment, plugins : what to measure, and the modules that workers import first.
    config : the resolved config.
    tasks : by the names of their folders.
    origin : versions, commit, source and machine, as stored beside the result.
    """

    experiment: Experiment
    plugins: tuple[str, ...]
    config: dict[str, Any]
    tasks: dict[str, Task]
    origin: dict[str, Any]


def run(
    experiment: Experiment,
    out: Path | str,
    workers: int = 1,
    quick: bool = False,
    plugins: Sequence[str] = (),
    fresh: bool = False,
    scheduler: str | None = None,
) -> Result:
    """Run an experiment into a folder, or finish what was begun there.

    Parameters
    ----------
    experiment : what to measure.
    out : folder of the result; made if missing. With the same config in it the run resumes.
    workers : processes; the result does not depend on their number.
    quick : run the experiment's reduced copy; a line says what it leaves out.
    plugins : modules that every worker imports first.
    fresh : remove the files that an earlier run of any config wrote into the folder; others that
        lie beside them stay.
    scheduler : address of that of a Dask cluster, whose workers do the tasks instead.

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
        chosen = _chosen(experiment, quick)
    with as_user_error(), working("listing the work"):
        work = _work(chosen, plugins)
    table = inside(out, "table.csv")
    if table.exists() and not fresh:
        check_same(out, work.config, work.origin)
        return Result(out)
    with as_user_error(), working("preparing the run"):
        check_config(work.config)
        work.experiment.check()
    # The pool comes before the folder: without a scheduler no old result is thrown away.
    with _pool(work, min(workers, len(work.tasks)), scheduler) as pool, locked(out):
        prepare(out, work.config, work.origin, fresh)
        if not table.exists():
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
            f"run takes an Experiment, and {short(experiment, 60)} was given; "
            "`wideberth.run` takes the name of a config, a file or a mapping too"
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
    tasks = task_keys({**settings, "plugins": list(plugins)}, checked_tasks(experiment.tasks()))
    config = {**settings, "plugins": sorted({*plugins, *plugin_modules(experiment)})}
    origin = provenance([*foreign_sources(experiment, plugins), *experiment.inputs()])
    return _Work(experiment, tuple(plugins), config, tasks, origin)


@contextmanager
def _pool(work: _Work, workers: int, scheduler: str | None) -> Iterator[Pool | None]:
    """Yield the workers, ready; None means this process. They end with the block."""
    if scheduler is None and workers == 1:
        yield None
        return
    job = pack_job(work.experiment, work.plugins)
    pool: Pool
    if scheduler is None:
        pool = LocalPool(job, workers)
    else:
        from .dask_pool import Cluster

        pool = Cluster(scheduler, job)
    try:
        yield pool
    finally:
        pool.close()


def _measure(work: _Work, out: Path, pool: Pool | None) -> None:
    """Do the tasks that are not finished, and write the folder of each when it is done."""
    missing = _missing(work, out)
    total, done = len(work.tasks), len(work.tasks) - len(missing)
    if not missing:
        return

    def keep(key: str, outcome: TaskOutcome) -> None:
        nonlocal done
        write_task(inside(out, TASKS), key, missing[key], outcome)
        done += 1
        advance()
        for kind, words in outcome.failures.items():
            failed(kind, words)

    failed = _warning_once()
    try:
        with progress(total, done) as advance, reporting(failed):
            if pool is not None:
                sweep(pool, missing, keep)
            else:
                for key, task in missing.items():
                    keep(key, measured(work.experiment, task))
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f"stopped with {done} of {total} tasks done; they are kept in {out}: "
            "the same command goes on from there"
        ) from None
    except WideberthError as error:
        raise _kept(error, done, work, out) from error


def _warning_once() -> Take:
    """Return what says that a plug-in failed while its robot drives on, each kind once."""
    said = set[str]()

    def failed(kind: str, words: str) -> None:
        if kind not in said:
            said.add(kind)
            say(f"warning: a plug-in raised {words}; `wideberth check` tries it on its own")

    return failed


def _missing(work: _Work, out: Path) -> dict[str, Task]:
    """Return the tasks that are not finished; what is left of them and of others is removed."""
    remove_files(out, half_written(out))
    for folder in task_folders(inside(out, TASKS)):
        if folder.name not in work.tasks:  # not complete
            remove_task(out, folder)
    done = {folder.name for folder in task_folders(inside(out, TASKS))}
    return {key: task for key, task in work.tasks.items() if key not in done}


def _kept(error: Exception, done: int, work: _Work, out: Path) -> WideberthError:
    """Return the error with the number of finished tasks, which are kept."""
    if not done:
        return WideberthError(describe_error(error))
    return WideberthError(
        f"{describe_error(error)}; {done} of {len(work.tasks)} tasks are done and kept in {out}: "
        "once that is corrected, the same command goes on from there"
    )


def _collect(work: _Work, out: Path) -> None:
    """Write the tables from the tasks, in their order, and move their files; table.csv is last."""
    rows: list[Row] = []
    times: list[Row] = []
    owner: dict[str, str] = {}
    for key in work.tasks:
        task = read_task(inside(out, TASKS), key)
        if task is None:
            raise WideberthError(f"{out}/{TASKS}/{key} vanished")
        rows += task.rows
        times += task.times
        for name in task.files:
            if owner.setdefault(name, key) != key:
                raise WideberthError(f"two tasks wrote the file {name!r}; names must differ")
    for name, key in owner.items():
        move_file(out, key, name)
    if times:
        write_table(inside(out, "times.csv"), times)
    table = table_text(rows)
    with chdir(os.curdir):
        summary = work.experiment.summary(read_rows(table, "the table"))
    write_table(inside(out, "summary.csv"), summary)
    whole = of_rows(str(work.config["type"]), summary, columns_of(summary))
    write_text(inside(out, "summary.md"), f"{work.experiment.claim}\n\n{markdown_text(whole)}\n")
    write_text(inside(out, "table.csv"), table)


@as_data()
def reopen(folder: Path) -> tuple[Experiment, Result]:
    """Return the experiment and the result of a finished run.

    The config is data, see `as_data`: modules that it lists under ``plugins`` are not imported.

    Raises
    ------
    WideberthError : no result there, one that is not finished, or one whose study or plug-ins are
        not registered.
    """
    check_finished(folder)
    config = read_config(inside(folder, "config.yaml"))
    modules = config.pop("plugins", None) or []
    try:
        with chdir(os.curdir):  # plug-ins may change it
            experiment: Experiment = build("experiments", config)
    except WideberthError as error:
        listed = f"; it lists plugins: {short(modules)}" if modules else ""
        reason = f"{folder / 'config.yaml'}: {error}{listed}{_written_by(folder)}"
        raise WideberthError(reason) from error
    return experiment, Result(folder.absolute())  # wherever the study's figures are drawn from


def reopened(folder: Path) -> tuple[Experiment | None, Result]:
    """Return what `reopen` does; for the experiment None, and a note, where it is not built.

    Raises
    ------
    WideberthError : no result there, or one that is not finished.
    """
    check_finished(folder)
    try:
        return reopen(folder)
    except WideberthError as error:
        note_not_built(str(error))
        return None, Result(folder.absolute())


def _written_by(folder: Path) -> str:
    """Return which other version of the package wrote a result, if one did."""
    with suppress(WideberthError):
        wrote = read_json(inside(folder, "provenance.json"), "provenance", 1).get("versions", {})
        if wrote.get("wideberth", __version__) != __version__:
            return (
                f"; version {wrote['wideberth']} wrote this result and {__version__} is "
                "installed: run its config again, or install that version"
            )
    return ""


@as_data()
def draw(folder: Path) -> list[Path]:
    """Draw the figures of a finished run into its figures/ and return their files.

    Raises
    ------
    WideberthError : no finished run, or the figures cannot be drawn; the result stays as it is.
    """
    experiment, result = reopen(folder)
    head = f"the result in {folder} is complete, its figures cannot be drawn: "
    with as_user_error(head), tempfile.TemporaryDirectory() as name:
        drawn = Path(name)
        with chdir(os.curdir):
            returned = experiment.figures(result, drawn)
        made = {
            path: inside(folder, "figures" / path.relative_to(drawn)) for path in written(drawn)
        }
        note_figures(folder, [path.relative_to(folder).as_posix() for path in made.values()])
        inside(folder, "figures").mkdir(exist_ok=True)
        for path, target in made.items():
            target.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(target, path.read_bytes())
        return [made.get(path, path) for path in returned]


def written(folder: Path) -> Iterator[Path]:
    """Yield every file of a result that is for the reader, sorted."""
    for path in sorted(folder.rglob("*")):
        ours = path.relative_to(folder).parts[0] != TASKS
        if ours and path.is_file() and not path.is_symlink():
            yield path


LONGEST = 60
"""Characters of a value in the line."""


def left_out(whole: Mapping[str, Any], quick: Mapping[str, Any], place: str = "") -> str:
    """Return in one line what the config of a quick run has less than the whole one.

    Parameters
    ----------
    whole, quick : configs, or their parts at ``place``, a dotted key.

    Examples
    --------
    >>> whole = {"scenarios": {"door": 1, "hall": 2, "yard": 3}, "seeds": 20, "show": [0, 4]}
    >>> left_out(whole, {"scenarios": {"door": 1}, "seeds": 1, "show": [0]})
    'scenarios without hall and yard; seeds 1, not 20; show without 4'
    """
    words = []
    for key, value in whole.items():
        small, gone = quick.get(key, value), []
        if isinstance(value, Mapping | list) and isinstance(small, Mapping | list):
            gone = [str(one)[:LONGEST] for one in value if one not in small]
        if gone:
            names = filter(None, (", ".join(gone[:-1]), gone[-1]))
            words.append(f"{place}{key} without {' and '.join(names)}")
        if isinstance(value, Mapping) and isinstance(small, Mapping):
            words.append(left_out(value, small, f"{place}{key}."))
        elif small != value and not gone:
            every = "all" if value == [] else short(value, LONGEST)
            words.append(f"{place}{key} {short(small, LONGEST)}, not {every}")
    return "; ".join(filter(None, words))
