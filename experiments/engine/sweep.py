"""Tasks out, shards in: the driver's loop over any pool of workers."""

from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil
from typing import Protocol

from ...framework.values.errors import WideberthError
from .base import Task
from .shards import Packed
from .worker import Chunk, Done

CHUNK = 0.2
"""s of work that travel together: little beside what sending costs, little to do again."""

LARGEST = 100
"""Tasks in a chunk."""


@dataclass(frozen=True)
class Returned:
    """A chunk that came back.

    Attributes
    ----------
    chunk : as it was submitted.
    done : what the worker made of it; None if the worker was lost.
    loss : how.
    """

    chunk: Chunk
    done: Done | None
    loss: str = ""


class Pool(Protocol):
    """Workers somewhere.

    Attributes
    ----------
    patience : workers that a task, done with nothing beside it, may cost before it is given up.
    """

    patience: int

    @property
    def slots(self) -> int:
        """Chunks that are worked at at the same time."""
        ...

    @property
    def free(self) -> bool:
        """Whether a chunk can be taken now."""
        ...

    def submit(self, chunk: Chunk) -> None:
        """Give a chunk to a worker."""

    def finished(self) -> list[Returned]:
        """Wait a few seconds at most for chunks that came back, or were lost."""
        ...

    def close(self) -> None:
        """Stop the work that is left and let go of the workers."""


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

    def run(self, keep: Callable[[str, Packed], None]) -> None:
        """Do all tasks; ``keep`` is called here with each shard, in the order of their ends.

        Raises
        ------
        WideberthError : a task failed, or ends every worker that tries it.
        """
        self._fill()
        while self._out:
            back = self._pool.finished()
            self._out -= len(back)
            faults = [fault for fault in map(self._fault, back) if fault]
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
        size = min(LARGEST, share, int(CHUNK / self._pace) if self._pace else 1)
        chunk = [self._waiting.popleft()]
        while len(chunk) < size and self._tried is None:
            chunk.append(self._waiting.popleft())
        return chunk
