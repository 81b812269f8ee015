"""Workers on this machine, and the sweep of tasks through workers anywhere.

Each worker is a pool of one process, of the library loky: when a process ends in the middle of a
task, that task is known and only that pool is made anew. Processes start clean (nothing is
forked, the main script is not imported) with the environment that `thread_limits` states. They
ignore a Ctrl-C, which the driver handles, and end soon after a driver that was killed.
"""

import os
import re
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from typing import TYPE_CHECKING, Protocol, TypeAlias

from ...framework.values.errors import WideberthError
from . import thread_limits
from .base import Task, TaskOutcome
from .progress import say
from .worker import do_task

if TYPE_CHECKING:
    from loky import ProcessPoolExecutor

Outcome: TypeAlias = "Future[TaskOutcome]"

LOOK = 2.0
"""s between looks at who is there."""


class WorkerLost(Exception):
    """The worker of a task ended; the text says how."""


class Pool(Protocol):
    """Workers somewhere.

    Attributes
    ----------
    patience : workers that a task may cost before it is given up.
    """

    patience: int

    @property
    def slots(self) -> int:
        """Workers that are there."""
        ...

    def submit(self, task: Task) -> Outcome:
        """Give a task to a worker; there are never more tasks out than `slots`, or 1."""
        ...

    def result(self, future: Outcome) -> TaskOutcome:
        """Return what a task measured; raise `WorkerLost`, or a `WideberthError`."""
        ...

    def close(self) -> None:
        """Stop the work that is left and let go of the workers."""


def sweep(pool: Pool, tasks: Mapping[str, Task], keep: Callable[[str, TaskOutcome], None]) -> None:
    """Do all tasks; ``keep`` is called here with each outcome, in the order of their ends.

    A task whose worker ended is done again, as often as the pool's ``patience`` allows. Then it
    is given up, and the others are done.

    Raises
    ------
    WideberthError : a task failed, or ended every worker that did it.
    """
    waiting, out = deque(tasks), dict[Outcome, str]()
    lost, given_up, failures = Counter[str](), list[str](), list[WideberthError]()
    while (waiting or out) and (pool.slots or not given_up):
        while waiting and len(out) < max(pool.slots, 1):
            key = waiting.popleft()
            out[pool.submit(tasks[key])] = key
        done, _ = wait(out, LOOK, FIRST_COMPLETED)
        for future in done:
            key = out.pop(future)
            try:
                outcome = pool.result(future)
            except WorkerLost as loss:
                lost[key] += 1
                if lost[key] < pool.patience:
                    say(f"task {tasks[key].name!r} is done again: its worker {loss}")
                    waiting.appendleft(key)
                else:
                    given_up.append(
                        f"task {tasks[key].name!r} ends every worker that does it (it {loss})"
                    )
                continue
            except WideberthError as error:
                failures.append(error)
                continue
            if waiting and not failures:  # the worker goes on while the driver writes
                following = waiting.popleft()
                out[pool.submit(tasks[following])] = following
            keep(key, outcome)
        if failures:
            raise failures[0]
    if given_up:
        raise WideberthError(given_up[0])


class LocalPool:
    """A pool of processes; see `Pool`."""

    patience = 3

    def __init__(self, job: bytes, count: int) -> None:
        self._job = job
        self._workers = [_worker() for _ in range(count)]
        self._given: list[Outcome | None] = [None] * count

    @property
    def slots(self) -> int:
        """Workers that are there."""
        return len(self._workers)

    def submit(self, task: Task) -> Outcome:
        """Give a task to a worker that has none."""
        place = next(i for i, given in enumerate(self._given) if given is None or given.done())
        try:
            future: Outcome = self._workers[place].submit(do_task, self._job, task)
        except BrokenExecutor:  # it ended, in its task or without one
            self._workers[place].shutdown(kill_workers=True)
            self._workers[place] = _worker()
            future = self._workers[place].submit(do_task, self._job, task)
        self._given[place] = future
        return future

    def result(self, future: Outcome) -> TaskOutcome:
        """Return what a task measured."""
        try:
            return future.result()
        except BrokenExecutor as error:
            signals = re.findall(r"\bSIG\w+", str(error))
            how = f"was ended by {signals[0]}" if signals else f"ended ({error})"
            why = ": the memory may be full" if signals == ["SIGKILL"] else ""
            raise WorkerLost(how + why) from error

    def close(self) -> None:
        """End all workers at once."""
        for worker in self._workers:
            worker.shutdown(kill_workers=True)


def _worker() -> "ProcessPoolExecutor":
    """Return a pool of one process, which starts with its first task."""
    from loky import ProcessPoolExecutor

    return ProcessPoolExecutor(
        1,
        timeout=None,
        env=dict.fromkeys(thread_limits.WORKER, "1") | {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e15"},
        initializer=_begin,
        initargs=(os.getpid(),),
    )


def _begin(driver: int) -> None:
    """Leave a Ctrl-C to the driver, and end when the driver has ended; runs in a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def watch() -> None:
        while os.getppid() == driver:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
