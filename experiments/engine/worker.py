"""What a worker does: it checks that it runs the same program as the driver, then does tasks.

A `Job` travels to every worker with every task and is opened once per process. What a task
measured comes back to the driver, which alone writes: workers need no folder in common, and one
that outlives its driver cannot touch a result.
"""

import hashlib
import os
import pickle
import platform
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import chdir, suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from ...framework.control.rate_limited_warnings import quiet
from ...framework.plugins.config import import_plugins
from ...framework.plugins.registry import MODULE_FOLDERS
from ...framework.values.errors import WideberthError
from ...framework.values.failures import reporting
from . import thread_limits
from .base import Experiment, Task, TaskOutcome
from .errors import describe_error
from .provenance import fingerprint, foreign_sources, versions
from .tasks import checked_outcome


@dataclass(frozen=True)
class Job:
    """The experiment of a run, packed for its workers.

    Attributes
    ----------
    experiment : pickled; opened after the plug-ins are imported.
    plugins : modules to import first.
    folders : where they may be, besides the working folder.
    environment : what must be the same in a worker, by its name.
    """

    experiment: bytes
    plugins: tuple[str, ...]
    folders: tuple[str, ...]
    environment: Mapping[str, str | None]


def pack_job(experiment: Experiment, plugins: Sequence[str]) -> bytes:
    """Return a `Job` as bytes; classes of a script travel by value, those of modules by name."""
    import cloudpickle

    packed = cloudpickle.dumps(experiment)
    needs = environment(experiment, plugins)
    return pickle.dumps(Job(packed, tuple(plugins), tuple(MODULE_FOLDERS), needs))


def environment(experiment: Experiment, plugins: Sequence[str]) -> dict[str, str | None]:
    """Return what must agree between driver and worker for the same task to give the same bytes.

    Source of modules is that of their first use in this process: a worker that goes on living
    while a file is edited runs the old one.
    """
    found = {
        "Python": platform.python_version(),
        **versions(),
        "wideberth's source": fingerprint(),
    }
    main = getattr(sys.modules["__main__"], "__file__", None)
    for path in foreign_sources(experiment, plugins):
        if main is None or path != Path(main):  # a script's classes travel by value
            found[f"module {path.name}"] = _module(path)
    for path in experiment.inputs():
        found[f"file {path}"] = _hash(path)
    return found


@cache
def _module(path: Path) -> str | None:
    return _hash(path)


def _hash(path: Path) -> str | None:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError:
        return None


@lru_cache(maxsize=4)
def open_job(packed: bytes) -> Experiment:
    """Open a job in this process, or say why it cannot be done here.

    Raises
    ------
    WideberthError : threads are not pinned, the experiment cannot be built, or the process
        differs from the driver in its `environment`.
    """
    thread_limits.pin()
    job: Job = pickle.loads(packed)
    for folder in ("", *job.folders):  # "" is the folder where the worker was started
        if folder not in sys.path:
            sys.path.append(folder)
    import_plugins(job.plugins)
    try:
        experiment: Experiment = pickle.loads(job.experiment)
    except Exception as error:  # a plug-in's module may be missing or fail in any way
        raise WideberthError(
            f"the experiment cannot be opened ({type(error).__name__}: {error}); its plug-ins "
            "must be importable there"
        ) from error
    here, wanted = environment(experiment, job.plugins), job.environment
    differing = [name for name in {**wanted, **here} if wanted.get(name) != here.get(name)]
    if differing:
        named = ", ".join(
            f"{name} ({here.get(name)} instead of {wanted.get(name)})" for name in differing
        )
        raise WideberthError(
            f"it differs from the driver in: {named}; install the same there and restart it"
        )
    return experiment


def check(packed: bytes) -> str | None:
    """Return why a job cannot be done in this process, if so."""
    try:
        open_job(packed)
    except WideberthError as error:
        return str(error)
    return None


def do_task(packed: bytes, task: Task) -> TaskOutcome:
    """Do one task of a job; runs in a worker."""
    try:
        experiment = open_job(packed)
    except WideberthError as error:
        raise WideberthError(f"the worker {_place()} cannot take part: {error}") from None
    failures: dict[str, str] = {}
    with reporting(failures.setdefault):
        outcome = measured(experiment, task)
    return replace(outcome, failures=failures)


def _place() -> str:
    """Name this worker: its address in a cluster, or the number of the process."""
    if "distributed.worker" in sys.modules:
        from distributed import get_worker

        with suppress(ValueError):  # no worker of a cluster
            return str(get_worker().address)
    return f"process {os.getpid()}"


def measured(experiment: Experiment, task: Task) -> TaskOutcome:
    """Measure one task and return its checked outcome.

    Controllers warn of nothing: what they did otherwise than asked stands in the result. The next
    task finds the working folder that this one found.

    Raises
    ------
    WideberthError : whatever the task raised, with its name.
    """
    with _Interrupt() as interrupt:
        try:
            with quiet(), chdir(os.curdir):
                outcome = experiment.measure(task)
        except (Exception, SystemExit) as error:  # a plug-in may fail in any way; say where
            interrupt.check()
            raise WideberthError(f"task {task.name!r}: {describe_error(error)}") from error
        interrupt.check()
    return checked_outcome(task, outcome)


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
