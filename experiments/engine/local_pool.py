"""Workers on this machine: one process each, with one chunk of tasks at a time.

Processes start clean (nothing is forked, the main script is not imported) with the environment
that `threads` states, and in a session of their own, out of reach of a Ctrl-C: the driver stops
its workers. A process that ends in the middle of a chunk gives the chunk back, and another one
takes its place. When the driver is killed, its workers lose the connection to it, and end.
"""

import os
import subprocess
import sys
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from signal import Signals
from typing import Any

from . import thread_limits
from .worker import Chunk, Returned, do_chunk

_CHECK = 5.0
"""s between looks whether processes live whose pipe something else may hold open."""

_CODE = f"""
import sys
from multiprocessing.connection import Connection
pipe = Connection(int(sys.argv[1]))
job = pipe.recv_bytes()  # before the imports below, which take a second: the driver waits
sys.path[:] = sys.argv[2:]
from {__name__} import serve
serve(pipe, job)
"""
"""Source of a worker; its arguments are its pipe's number and the driver's module path."""


@dataclass
class _Worker:
    process: "subprocess.Popen[bytes]"
    pipe: "Connection[Any, Any]"
    chunk: Chunk | None = None


class LocalPool:
    """A pool of processes; see `wideberth.experiments.engine.worker.Pool`."""

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
        """Wait until a worker has returned its chunk, or has died."""
        busy = {
            worker.pipe: place
            for place, worker in enumerate(self._workers) if worker.chunk is not None
        }  # fmt: skip
        ready = wait(list(busy), _CHECK)
        dead = [
            pipe for pipe, place in busy.items() if self._workers[place].process.poll() is not None
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
        code = self._replace(place)
        return Returned(chunk, None, _ending(code))

    def _start(self) -> _Worker:
        ours, theirs = Pipe()
        number = theirs.fileno()
        process = subprocess.Popen(
            [sys.executable, "-c", _CODE, str(number), *sys.path],
            env=os.environ | dict.fromkeys(thread_limits.WORKER, "1"),
            stdin=subprocess.DEVNULL,
            pass_fds=[number],
            start_new_session=True,
        )
        theirs.close()
        worker = _Worker(process, ours)
        worker.pipe.send_bytes(self._job)
        return worker

    def _replace(self, place: int) -> int:
        """Start another worker in the place of one that is lost; return how that one ended."""
        code = self._end(self._workers[place])
        self._workers[place] = self._start()
        return code

    def _end(self, worker: _Worker) -> int:
        worker.pipe.close()
        try:
            return worker.process.wait(_CHECK if worker.process.poll() is None else 0.0)
        except subprocess.TimeoutExpired:
            worker.process.kill()
            return worker.process.wait()

    def close(self) -> None:
        """End all workers at once."""
        for worker in self._workers:
            worker.process.terminate()
        for worker in self._workers:
            self._end(worker)


def serve(pipe: "Connection[Any, Any]", job: bytes) -> None:
    """Do chunks until the driver is gone; runs in a worker."""
    try:
        while True:
            pipe.send(do_chunk(job, pipe.recv()))
    except (EOFError, OSError):
        return


def _ending(code: int) -> str:
    if code >= 0:
        return f"it ended with code {code}"
    name = Signals(-code).name
    why = ": the memory may be full" if name == "SIGKILL" else ""
    return f"it was ended by {name}{why}"
