"""Workers of a Dask cluster, reached through its scheduler.

Results of tasks come back through the scheduler and the driver writes them: the workers need no
folder in common with it, only the same program. docs/cluster.md says how to start a cluster.
"""

import logging
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
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


@dataclass(frozen=True)
class Scheduler:
    """Where the scheduler of a Dask cluster is, and with what to prove who we are.

    Parameters
    ----------
    address : ``tcp://HOST:PORT``, or ``tls://HOST:PORT``.
    ca : file of the certificates (PEM) that scheduler and workers are to be signed by.
    cert : file of our own certificate (PEM).
    key : file of its key (PEM), where it is not in the same file.

    Without ca, cert and key Dask's own config is used (``distributed.comm.tls``).

    Raises
    ------
    WideberthError : another kind of address, a file that is not there, ca without cert or the
        other way round.
    """

    address: str
    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None

    def __post_init__(self) -> None:
        if not fullmatch(r"(tcp|tls)://[^/]+:[0-9]+", self.address):
            raise WideberthError(
                f"scheduler is {self.address!r}; wanted tcp://HOST:PORT or tls://HOST:PORT"
            )
        files = {"ca": self.ca, "cert": self.cert, "key": self.key}
        given = [name for name, file in files.items() if file is not None]
        if given and not self.address.startswith("tls://"):
            raise WideberthError(f"tls {given[0]} is of no use with {self.address}; use tls://")
        if given and (self.ca is None or self.cert is None):
            raise WideberthError(f"of the TLS files there is only {given}; wanted ca and cert")
        for name, file in files.items():
            if file is not None and not file.is_file():
                raise WideberthError(f"tls {name}: there is no file {file}")

    def security(self) -> Any:
        """Return the ``Security`` that Dask wants; None for a connection in the clear.

        Raises
        ------
        WideberthError : no TLS files are named, or they hold no certificate and key.
        """
        from distributed import Security

        if not self.address.startswith("tls://"):
            return None
        files = {"tls_ca_file": self.ca, "tls_client_cert": self.cert, "tls_client_key": self.key}
        given = {name: str(file) for name, file in files.items() if file is not None}
        security: Any = Security
        try:
            made = security(require_encryption=True, **given)
            ready = made.get_connection_args("client")["ssl_context"] is not None
        except (OSError, ValueError) as error:
            raise WideberthError(f"the TLS files are of no use: {error}") from None
        if not ready or made.tls_client_cert is None:
            raise WideberthError(
                f"{self.address} wants certificates: name them with --tls-ca, --tls-cert and "
                "--tls-key, or in Dask's own config (distributed.comm.tls)"
            )
        return made


def reached(
    address: str | None, ca: Path | None = None, cert: Path | None = None, key: Path | None = None
) -> Scheduler | None:
    """Return the scheduler that options of the command line name, if they name one."""
    if address is not None:
        return Scheduler(address, ca, cert, key)
    if ca or cert or key:
        raise WideberthError("TLS files are of use with --scheduler tls://HOST:PORT only")
    return None


_TALKATIVE = ("distributed.client", "distributed.batched")
"""Loggers of Dask that tell of lost workers and schedulers, as we do in a line."""


class Cluster:
    """A pool of Dask workers; see `wideberth.experiments.engine.pool.Pool`.

    Workers may come and go while the work goes on.

    Raises
    ------
    WideberthError : the extra is missing, the scheduler does not answer or is lost later, or a
        worker has another environment than the driver.
    """

    patience = 2  # Dask itself has tried elsewhere, as often as its allowed-failures says

    def __init__(self, scheduler: Scheduler, job: bytes) -> None:
        self._address = scheduler.address
        self._job = job
        self._slots, self._looked, self._alone = 0, -LOOK, False
        self._client: Any = _connect(scheduler)
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


def _connect(scheduler: Scheduler) -> Any:
    everywhere = "the workers need it too"
    client = from_extra("distributed", "cluster", "a scheduler needs Dask", everywhere).Client
    security = scheduler.security()
    try:
        return client(
            scheduler.address, timeout=_PATIENCE, security=security, set_as_default=False
        )
    except (OSError, TimeoutError) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise WideberthError(
            f"no scheduler answers at {scheduler.address} ({why}); nothing was begun: see that "
            "it runs and can be reached from here"
        ) from None
