"""A progress bar for long work, a line now and then where there is no terminal, notes."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import ProgressColumn, TaskID

_EVERY = 60.0
"""s between the lines that a log gets."""
_SOON = 0.5
"""s until work is shown: what is quicker needs no bar."""


_shown = ContextVar("shown", default=True)


@contextmanager
def without_progress() -> Iterator[None]:
    """Show no bars, spinners or lines of progress within the block; notes are printed."""
    token = _shown.set(False)
    try:
        yield
    finally:
        _shown.reset(token)


def in_notebook() -> bool:
    """Whether output goes into a notebook."""
    from rich.console import Console

    return Console().is_jupyter


class _Display:
    """A bar or spinner on a terminal, a line elsewhere; neither for work that is quick."""

    def __init__(self, text: str, *columns: "ProgressColumn", **task: Any) -> None:
        from rich.console import Console
        from rich.progress import Progress, TextColumn, TimeElapsedColumn

        console = Console(stderr=True)
        self.terminal: bool = console.is_terminal
        self.bar: Progress = Progress(
            *columns, TextColumn("{task.description}"), TimeElapsedColumn(), console=console,
            disable=not self.terminal, transient=True, redirect_stdout=False,
            speed_estimate_period=3600.0,
        )  # fmt: skip
        self.text: str = text
        self.task: TaskID = self.bar.add_task(text, **task)
        self.shown: bool = _shown.get()
        self.timer: threading.Timer = threading.Timer(_SOON, self.begin)
        self.timer.daemon = True

    def __enter__(self) -> None:
        if self.shown:
            self.timer.start()

    def __exit__(self, *_: object) -> None:
        self.timer.cancel()
        if self.shown:
            self.timer.join()
        self.bar.stop()

    def begin(self) -> None:
        self.bar.start()
        if not self.terminal:
            say(self.text)


@contextmanager
def progress(total: int, done: int = 0) -> Iterator[Callable[[], None]]:
    """Yield what is called after each task, and show how far the work is.

    A bar with an estimate of the time left, on a terminal; elsewhere a line now and then.

    Parameters
    ----------
    total : tasks of the whole work.
    done : of these, by an earlier run. They count as done and say nothing about the pace.
    """
    from rich.progress import BarColumn, SpinnerColumn, TimeRemainingColumn

    columns = SpinnerColumn(), BarColumn(20), TimeRemainingColumn()
    display = _Display(f"{done} of {total} tasks", *columns, total=total, completed=done)
    count, reported = done, time.monotonic()

    def advance() -> None:
        nonlocal count, reported
        count += 1
        text = display.text = f"{count} of {total} tasks"
        display.bar.update(display.task, advance=1, description=text)
        if display.shown and not display.terminal and time.monotonic() > reported + _EVERY:
            reported = time.monotonic()
            say(text)

    with display:
        yield advance


def working(what: str) -> AbstractContextManager[None]:
    """Show that something goes on: a spinner on a terminal, elsewhere a line; nothing if quick."""
    from rich.progress import SpinnerColumn

    return _Display(f"{what} ...", SpinnerColumn(), total=None)


def say(text: str) -> None:
    """Print a note to standard error."""
    print(text, file=sys.stderr, flush=True)
