"""Workers of a Dask cluster, reached through its scheduler.

Results of tasks come back through the scheduler and the driver writes them: the workers need no
folder in common with it, only the same program. docs/cluster.md says how to start a cluster.
"""

import logging
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from re import fullmatch
from time import monotonic
from typing import Any

from ...framework.plugins.extras import from_extra
from ...framework.values.errors import WideberthError
from .base import Task, TaskOutcome
from .pool import LOOK, Outcome, WorkerLost
from .progress import say
from .worker import check, do_task

_PATIENCE = 8.0
"""s to wait for a scheduler to answer."""


_TALKATIVE = ("distributed.client", "distributed.batched", "tornado.application")
"""Loggers of Dask that write of lost workers and schedulers, as we do in a line."""


class Cluster:
    """A pool of Dask workers; see `wideberth.experiments.engine.pool.Pool`.

    Workers may come and go while the work goes on.

    Raises
    ------
    WideberthError : another kind of address, the extra is missing, the scheduler does not answer
        or is lost later, or a worker has another environment than the driver.
    """

    patience = 2  # Dask itself has tried elsewhere, as often as its allowed-failures says

    def __init__(self, address: str, job: bytes) -> None:
        self._address = address
        self._job = job
        self._slots, self._looked, self._alone = 0, -LOOK, False
        self._client: Any = _connect(address)
        self._executor = self._client.get_executor(pure=False)
        logs = [logging.getLogger(name) for name in _TALKATIVE]
        self._levels = [(log, log.level) for log in logs]
        for log in logs:
            log.setLevel(logging.CRITICAL)
        try:
            self._compare()
        except BaseException:
            self.close()
            raise

    @property
    def slots(self) -> int:
        """Workers that are there, each for one task at a time; looked for now and then."""
        if monotonic() < self._looked + LOOK:
            return self._slots
        with self._answering():
            threads: dict[str, int] = self._client.nthreads()
        for address, number in threads.items():
            if number != 1:
                raise WideberthError(
                    f"the worker {address} does {number} tasks at once, in threads; start it "
                    "with --nthreads 1, and --nworkers for more of them"
                )
        self._slots, self._looked = len(threads), monotonic()
        if not self._slots and not self._alone:
            say(f"no worker at {self._address}; the work waits for one")
        self._alone = not self._slots
        return self._slots

    def submit(self, task: Task) -> Outcome:
        """Give a task to the scheduler."""
        with self._answering():
            future: Outcome = self._executor.submit(do_task, self._job, task)
        return future

    def result(self, future: Outcome) -> TaskOutcome:
        """Return what a task measured."""
        from distributed import KilledWorker

        with self._answering():
            try:
                return future.result()
            except KilledWorker as error:
                raise WorkerLost(
                    f"is lost: workers of {self._address} lost with it: "
                    f"{error.allowed_failures + 1}"
                ) from error

    @contextmanager
    def _answering(self) -> Iterator[None]:
        """Say so where the scheduler does not answer any more."""
        try:
            yield
        except (OSError, TimeoutError, CancelledError) as error:
            raise WideberthError(f"the scheduler {self._address} was lost") from error

    def _compare(self) -> None:
        """Have every worker that is there compare itself with the driver."""
        answers = self._client.run(check, self._job, on_error="return") if self.slots else {}
        for address, answer in answers.items():
            if isinstance(answer, OSError):
                continue  # it went away
            if answer is not None:
                raise WideberthError(f"the worker {address} cannot take part: {answer}")

    def close(self) -> None:
        """Forget the tasks that are left and leave the scheduler."""
        self._client.close(timeout=_PATIENCE)
        for log, level in self._levels:
            log.setLevel(level)


def _connect(address: str) -> Any:
    """Return Dask's client of a scheduler; of one with TLS Dask's own config has the files."""
    if not fullmatch(r"(tcp|tls)://[^/]+:[0-9]+", address):
        raise WideberthError(
            f"scheduler is {address!r}; wanted tcp://HOST:PORT or tls://HOST:PORT"
        )
    everywhere = "the workers need it too"
    client = from_extra("distributed", "cluster", "a scheduler needs Dask", everywhere).Client
    try:
        return client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, TypeError) as error:  # the last one without certificates
        why = " ".join(str(error).split()) or type(error).__name__
        raise WideberthError(
            f"no scheduler answers at {address} ({why}); nothing was begun: see that it runs and "
            "can be reached from here, and for tls:// that Dask's config names the certificates"
        ) from None
