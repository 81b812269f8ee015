"""A progress bar for long work, a line now and then where there is no terminal, notes."""

import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.progress import Progress as Bar
    from rich.progress import TaskID

_EVERY = 60.0
"""s between the lines that a log gets."""
_SOON = 0.8
"""s until work is shown: what is quicker needs no bar."""


class ProgressLines:
    """A bar with an estimate of the time left, on a terminal; elsewhere a line now and then.

    Parameters
    ----------
    total : tasks of the whole work.
    done : of these, by an earlier run. They count as done and say nothing about the pace.
    """

    def __init__(self, total: int, done: int = 0) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
        )

        self.console: Console = Console(stderr=True)
        self.bar: Bar = Progress(
            SpinnerColumn(), BarColumn(20), TextColumn("{task.description}"), TimeElapsedColumn(),
            console=self.console, disable=not self.console.is_terminal, transient=True,
        )  # fmt: skip
        self.total: int = total
        self.done: int = done
        self.pauses: list[float] = []
        self.last: float = 0.0
        self.reported: float = 0.0
        self.task: TaskID = self.bar.add_task(self._text(), total=total, completed=done)
        self.timer: threading.Timer = threading.Timer(_SOON, self._begin)
        self.timer.daemon = True

    def __enter__(self) -> Any:
        self.last = self.reported = time.monotonic()
        self.timer.start()
        return self._advance

    def __exit__(self, *_: object) -> None:
        self.timer.cancel()
        self.timer.join()
        self.bar.stop()

    def _begin(self) -> None:
        self.bar.start()
        if not self.console.is_terminal:
            say(self._text())

    def _advance(self) -> None:
        now = time.monotonic()
        self.pauses.append(now - self.last)
        self.last = now
        self.done += 1
        self.bar.update(self.task, advance=1, description=self._text())
        if not self.console.is_terminal and now > self.reported + _EVERY:
            self.reported = now
            say(self._text())

    def _text(self) -> str:
        left = time_left(self.pauses, self.total - self.done)
        return f"{self.done} of {self.total} tasks{left and f', {left}'}"


def time_left(pauses: Sequence[float], tasks: int) -> str:
    """Estimate how long the tasks that are left take, with the range that their spread allows.

    The pauses between the ends of tasks count as independent draws. Their mean gives the time
    left; two standard deviations of the sum of those to come, the mean's own error included, give
    the range.

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


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show that something goes on: a spinner on a terminal, elsewhere a line; nothing if quick."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    spinner = Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), console=console,
        disable=not console.is_terminal, transient=True, redirect_stdout=False,
    )  # fmt: skip
    spinner.add_task(f"{what} ...", total=None)

    def begin() -> None:
        spinner.start()
        if not console.is_terminal:
            say(f"{what} ...")

    timer = threading.Timer(_SOON, begin)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()
        spinner.stop()


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
