"""A progress bar for long work, a line now and then where there is no terminal, notes."""

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from itertools import pairwise
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
    from rich.progress import BarColumn, SpinnerColumn

    first = f"{done} of {total} tasks"
    display = _Display(first, SpinnerColumn(), BarColumn(20), total=total, completed=done)
    ends, reported = [time.monotonic()], time.monotonic()

    def advance() -> None:
        nonlocal reported
        ends.append(time.monotonic())
        count = done + len(ends) - 1
        left = time_left([b - a for a, b in pairwise(ends)], total - count)
        text = display.text = f"{count} of {total} tasks{left and f', {left}'}"
        display.bar.update(display.task, advance=1, description=text)
        if display.shown and not display.terminal and ends[-1] > reported + _EVERY:
            reported = ends[-1]
            say(text)

    with display:
        yield advance


def time_left(pauses: Sequence[float], tasks: int) -> str:
    """Estimate how long the tasks that are left take, with the range that their spread allows.

    The pauses between the ends of tasks count as independent draws. Their mean gives the time
    left; two standard deviations of the sum of those to come, the mean's own error included, give
    the range. Less than a second is not worth a word.

    Parameters
    ----------
    pauses : s between the ends of the tasks that are done.
    tasks : that are left.

    Examples
    --------
    >>> time_left([3.0, 5.0, 4.0], 37), time_left([3.0], 2), time_left([], 5)
    ('about 2 min left (2 to 3)', 'about 6 s left', '')
    >>> time_left([1.0, 30.0, 2.0, 40.0], 100)
    'about 30 min left (0 to 64)'
    """
    if not pauses or not tasks:
        return ""
    count = len(pauses)
    mean = sum(pauses) / count
    if mean * tasks < 1.0:
        return ""
    about = f"about {span(mean * tasks)} left"
    if count < 3:
        return about
    variance = sum((pause - mean) ** 2 for pause in pauses) / (count - 1)
    spread = 2.0 * (variance * tasks * (1.0 + tasks / count)) ** 0.5
    least, most = (max(mean * tasks + side, 0.0) for side in (-spread, spread))
    if " h " in about:
        return f"{about} ({span(least)} to {span(most)})"
    unit = 60.0 if " min " in about else 1.0
    return f"{about} ({least / unit:.0f} to {most / unit:.0f})"


def working(what: str) -> AbstractContextManager[None]:
    """Show that something goes on: a spinner on a terminal, elsewhere a line; nothing if quick."""
    from rich.progress import SpinnerColumn

    return _Display(f"{what} ...", SpinnerColumn(), total=None)


def span(seconds: float) -> str:
    """Write a time for reading.

    Examples
    --------
    >>> span(42.3), span(600.0), span(7380.0)
    ('42 s', '10 min', '2 h 3 min')
    """
    minutes = round(seconds / 60.0)
    if minutes < 2:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


def say(text: str) -> None:
    """Print a note to standard error."""
    print(text, file=sys.stderr, flush=True)
