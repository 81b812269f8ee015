"""Workers of a Dask cluster, reached through its scheduler.

Shards come back through the scheduler and the driver writes them: the workers need no folder in
common with it, only the same program. docs/cluster.md says how to start a cluster.
"""

import logging
from concurrent.futures import CancelledError
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from queue import Empty, SimpleQueue
from re import fullmatch
from time import monotonic
from typing import Any, TypeAlias
from uuid import uuid4

from ...framework.plugins.extras import from_extra
from ...framework.values.errors import WideberthError
from .progress import say
from .worker import Chunk, Done, Returned, check, do_chunk

Future: TypeAlias = Any
"""Of Dask, whose methods carry no types."""

_PATIENCE = 8.0
"""s to wait for a scheduler to answer."""
_CHECK = 2.0
"""s between looks at who is there."""


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
    """A pool of Dask workers; see `wideberth.experiments.engine.worker.Pool`.

    Workers may come and go while the work goes on.

    Raises
    ------
    WideberthError : the extra is missing, the scheduler does not answer or is lost later, or a
        worker is not the driver's twin.
    """

    patience = 1  # Dask itself has tried elsewhere, as often as its allowed-failures says

    def __init__(self, scheduler: Scheduler, job: bytes) -> None:
        self._address = scheduler.address
        self._job = job
        self._keys = (f"wideberth-{uuid4().hex[:8]}-{number}" for number in count())
        self._back: SimpleQueue[Future] = SimpleQueue()
        self._out: dict[Future, Chunk] = {}
        self._alone = False
        self._client: Any = _connect(scheduler)
        logs = [logging.getLogger(name) for name in _TALKATIVE]
        self._levels = [(log, log.level) for log in logs]
        for log in logs:
            log.setLevel(logging.CRITICAL)
        try:
            self._look()
            self._compare()
        except BaseException:
            self.close()
            raise

    @property
    def slots(self) -> int:
        """Workers that are there."""
        return self._slots

    @property
    def free(self) -> bool:
        """Whether a chunk can be taken now: some wait at the scheduler, for those who join."""
        return len(self._out) < 2 * max(self._slots, 8)

    def submit(self, chunk: Chunk) -> None:
        """Give a chunk to the scheduler."""
        key = next(self._keys)  # a new name: Dask must not take an older run's answer for it
        future = self._client.submit(do_chunk, self._job, chunk, key=key, pure=False)
        self._out[future] = chunk
        future.add_done_callback(self._back.put)

    def finished(self) -> list[Returned]:
        """Wait a little for chunks; look now and then who is there."""
        if monotonic() > self._looked + _CHECK:
            self._look()
        try:
            futures = [self._back.get(timeout=_CHECK)]
        except Empty:
            return []
        while not self._back.empty():
            futures.append(self._back.get())
        chunks = {future: self._out.pop(future) for future in futures}
        good = [future for future in futures if future.status == "finished"]
        try:
            found: list[Done] = self._client.gather(good, errors="raise") if good else []
        except (OSError, TimeoutError, CancelledError) as error:
            raise self._lost() from error
        returned = [
            Returned(chunks[future], done) for future, done in zip(good, found, strict=True)
        ]
        bad = [future for future in futures if future not in good]
        return returned + [Returned(chunks[future], None, self._loss(future)) for future in bad]

    def _loss(self, future: Future) -> str:
        """Say how a chunk's workers were lost; raise if that is not what happened."""
        from distributed import KilledWorker

        if future.status != "error":  # cancelled, all of them
            raise self._lost()
        error = future.exception()
        if not isinstance(error, KilledWorker):
            raise WideberthError(f"a worker of {self._address} failed: {error!r}")
        return f"workers of {self._address} lost with it: {error.allowed_failures + 1}"

    def _lost(self) -> WideberthError:
        return WideberthError(f"the scheduler {self._address} was lost")

    def _look(self) -> None:
        """Count the workers, and see that each does one task at a time."""
        try:
            threads: dict[str, int] = self._client.nthreads()
        except (OSError, TimeoutError, CancelledError) as error:
            raise self._lost() from error
        self._looked = monotonic()
        for address, number in threads.items():
            if number != 1:
                raise WideberthError(
                    f"the worker {address} does {number} tasks at once, in threads; start it "
                    "with --nthreads 1, and --nworkers for more of them"
                )
        if threads:
            self._alone = False
        elif not self._alone:
            self._alone = True
            say(f"no worker at {self._address}; the work waits for one")
        self._slots = len(threads)

    def _compare(self) -> None:
        """Have every worker that is there compare itself with the driver."""
        answers = self._client.run(check, self._job, on_error="return") if self._slots else {}
        for address, answer in answers.items():
            if isinstance(answer, OSError):
                continue  # it went away
            if answer is not None:
                raise WideberthError(f"the worker {address} cannot take part: {answer}")

    def close(self) -> None:
        """Forget the tasks that are left and leave the scheduler."""
        self._out.clear()
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
