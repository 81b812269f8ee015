"""Calls into code that may not return, in threads that can be left behind.

A solver is native code: nothing in Python can end it. So it is called in a thread of its own, and
where it does not return in time the caller goes on without it. The thread left behind runs on
until its call returns, or to the end of the process, which does not wait for it.

Threads are kept for the next call: handing a call over takes some tens of microseconds. A call
sees the caller's context variables (NumPy's error state is one). On Linux it has the caller's
right to the processor, a real-time priority too, until it is left behind: then it is ordinary.
Threads that it starts itself are ordinary.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from contextvars import copy_context
from threading import TIMEOUT_MAX, Lock, Thread
from typing import Any, TypeVar

MOST_LEFT = 3
"""Threads left behind, in the whole process, with which another call is still begun: each that
calculates takes a core."""

T = TypeVar("T")


class LeftBehind(Exception):
    """A call did not return in time."""


class Refused(Exception):
    """Too many threads were left behind; the call was not begun."""


def left_behind() -> int:
    """Count the threads of this process that were left behind and still run."""
    return _left


def watched(call: Callable[[], T], limit: float) -> T:
    """Return what a call returns, or raise what it raises.

    Parameters
    ----------
    call : runs in another thread.
    limit : s by the clock; more than a thread can wait for, some centuries, counts as that.

    Raises
    ------
    LeftBehind : it has not returned after ``limit``; it still runs.
    Refused : `MOST_LEFT` earlier calls still run.
    """
    if _left >= MOST_LEFT:
        raise Refused(
            f"is not asked: {_left} calls that did not return in time still run, and no other is "
            "begun until one ends"
        )
    with _LOCK:
        worker = _IDLE.pop() if _IDLE else None
    if worker is None:
        worker = _Worker()
    job = _Job(call)
    worker.begin(job)
    try:
        job.done.acquire(timeout=min(max(limit, 0.0), TIMEOUT_MAX))
    finally:  # also where the wait itself is interrupted
        over = _over(job, worker)
    if not over:
        raise LeftBehind(f"did not return within {limit:.3g} s")
    if job.error is not None:
        raise job.error
    result: T = job.result
    return result


_LOCK = Lock()
_IDLE: "list[_Worker]" = []
_left = 0

_LINUX = hasattr(os, "sched_setscheduler")


def _rights() -> tuple[int, int]:
    """Policy of the calling thread, and its real-time priority."""
    if not _LINUX:
        return 0, 0
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    return policy, os.sched_getparam(0).sched_priority


class _Job:
    """A call, and what came of it."""

    def __init__(self, call: Callable[[], Any]) -> None:
        self.call, self.context, self.rights = call, copy_context(), _rights()
        self.result: Any = None
        self.error: BaseException | None = None
        self.over = self.left = False
        self.done = Lock()
        self.done.acquire()


class _Worker:
    """A thread that makes one call after the other."""

    def __init__(self) -> None:
        self._go = Lock()
        self._go.acquire()
        self._job: _Job | None = None
        self._rights: tuple[int, int] | None = None
        self._thread = Thread(target=self._run, name="wideberth-watched", daemon=True)
        self._thread.start()

    def begin(self, job: _Job) -> None:
        """Make a call."""
        self._job = job
        self._go.release()

    def take(self, rights: tuple[int, int]) -> None:
        """Give the thread a policy and a priority, where the system grants them; under `_LOCK`."""
        if _LINUX and rights != self._rights and self._thread.native_id is not None:
            policy, priority = rights
            # Only with privileges could the flag be taken away again.
            policy |= os.SCHED_RESET_ON_FORK
            with suppress(OSError):
                os.sched_setscheduler(self._thread.native_id, policy, os.sched_param(priority))
                self._rights = rights

    def _run(self) -> None:
        global _left
        self._rights = _rights()
        while True:
            self._go.acquire()
            job, self._job = self._job, None
            assert job is not None
            if job.rights != self._rights:
                with _LOCK:
                    if not job.left:
                        self.take(job.rights)
            try:
                job.result = job.context.run(job.call)
            except BaseException as error:  # raised again where it was asked for
                job.error = error
            with _LOCK:
                job.over = True
                if job.left:
                    _left -= 1
                    _IDLE.append(self)
            job.done.release()
            del job  # while it waits it holds on to nothing


def _over(job: _Job, worker: _Worker) -> bool:
    """Whether a call has returned; otherwise its thread counts as left behind."""
    global _left
    with _LOCK:
        if job.over:
            _IDLE.append(worker)
        else:
            job.left = True
            _left += 1
            if job.rights[1]:
                worker.take((os.SCHED_OTHER, 0))
        return job.over


def _forked() -> None:
    """Begin anew in a child process: no thread but the one that forked lives on there."""
    global _LOCK, _left
    _LOCK, _left = Lock(), 0
    _IDLE.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forked)
