"""Workers on this machine: processes of their own, one chunk of tasks at a time each.

They start clean (nothing is forked) and read the environment that `threads` states. A process
that ends in the middle of a chunk gives the chunk back; the next one takes its place. When the
driver is killed, a worker finds nobody to report to, and ends.
"""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from typing import Any

from . import threads
from .sweep import Returned
from .worker import Chunk, do_chunk

_CHECK = 5.0
"""s between looks whether processes live whose pipe something else may hold open."""


@dataclass
class _Worker:
    process: Any
    pipe: "Connection[Any, Any]"
    chunk: Chunk | None = None


class Processes:
    """A pool of processes; see `wideberth.experiments.engine.sweep.Pool`."""

    patience = 3

    def __init__(self, job: bytes, count: int) -> None:
        self._job = job
        self._workers = [self._start() for _ in range(count)]

    @property
    def slots(self) -> int:
        """Chunks that are worked at at the same time."""
        return len(self._workers)

    @property
    def free(self) -> bool:
        """Whether a chunk can be taken now."""
        return any(worker.chunk is None for worker in self._workers)

    def submit(self, chunk: Chunk) -> None:
        """Give a chunk to a worker that has none."""
        place = next(i for i, worker in enumerate(self._workers) if worker.chunk is None)
        try:
            self._workers[place].pipe.send(chunk)
        except OSError:  # it died while it had nothing to do
            self._replace(place)
            self._workers[place].pipe.send(chunk)
        self._workers[place].chunk = chunk

    def finished(self) -> list[Returned]:
        """Wait until a worker has something to say, or has died."""
        busy = {
            worker.pipe: place
            for place, worker in enumerate(self._workers) if worker.chunk is not None
        }  # fmt: skip
        ready = wait(list(busy), _CHECK)
        dead = [
            pipe for pipe, place in busy.items() if not self._workers[place].process.is_alive()
        ]
        return [self._take(busy[pipe]) for pipe in busy if pipe in ready or pipe in dead]

    def _take(self, place: int) -> Returned:
        worker = self._workers[place]
        chunk, worker.chunk = worker.chunk or [], None
        try:
            if worker.pipe.poll():
                return Returned(chunk, worker.pipe.recv())
        except (EOFError, OSError):
            pass
        worker.process.join(_CHECK)
        code = worker.process.exitcode
        self._replace(place)
        return Returned(chunk, None, _ending(code))

    def _start(self) -> _Worker:
        from joblib.externals.loky.backend import get_context

        context: Any = get_context("loky")
        ours, theirs = context.Pipe()
        pinned = dict.fromkeys(threads.WORKER, "1")
        process = context.Process(target=serve, args=(theirs, self._job), env=pinned)
        with _deaf():
            process.start()
        theirs.close()
        return _Worker(process, ours)

    def _replace(self, place: int) -> None:
        self._end(self._workers[place])
        self._workers[place] = self._start()

    def _end(self, worker: _Worker) -> None:
        worker.pipe.close()
        worker.process.terminate()
        worker.process.join()

    def close(self) -> None:
        """End all workers at once."""
        for worker in self._workers:
            self._end(worker)


@contextmanager
def _deaf() -> Iterator[None]:
    """Have processes that start here never hear a Ctrl-C: the driver stops its workers."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def serve(pipe: "Connection[Any, Any]", job: bytes) -> None:
    """Do chunks until the driver is gone; runs in a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        while True:
            pipe.send(do_chunk(job, pipe.recv()))
    except (EOFError, OSError):
        return


def _ending(code: int | None) -> str:
    if code is None or code >= 0:
        return f"it ended with code {code}"
    name = signal.Signals(-code).name
    why = ": the memory may be full" if name == "SIGKILL" else ""
    return f"it was ended by {name}{why}"
