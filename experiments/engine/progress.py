"""A progress bar for long work, a line now and then where there is no terminal, notes."""

import sys
import threading
import time
from typing import Any

_EVERY = 60.0
"""s between the lines that a log gets."""


class Progress:
    """A bar with an ETA, shown on a terminal once the work has taken two seconds.

    Parameters
    ----------
    total : tasks of the whole work.
    done : of these, by an earlier run. They count as done and say nothing about the pace.
    """

    def __init__(self, total: int, done: int = 0) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

        self.console = Console(stderr=True)
        self.bar = Progress(
            BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), console=self.console,
            disable=not self.console.is_terminal, transient=True,
            speed_estimate_period=600.0,  # s; tasks may take minutes each
        )  # fmt: skip
        self.total = total
        self.earlier = self.done = done
        self.task = self.bar.add_task("tasks", total=total, completed=done)
        self.timer = threading.Timer(2.0, self.bar.start)
        self.timer.daemon = True

    def __enter__(self) -> Any:
        self.began = self.reported = time.monotonic()
        self.timer.start()
        return self._advance

    def __exit__(self, *_: object) -> None:
        self.timer.cancel()
        self.timer.join()
        self.bar.stop()

    def _advance(self) -> None:
        self.done += 1
        self.bar.advance(self.task)
        now = time.monotonic()
        if not self.console.is_terminal and now > self.reported + _EVERY:
            self.reported = now
            left = (now - self.began) / (self.done - self.earlier) * (self.total - self.done)
            say(f"{self.done} of {self.total} tasks; about {span(left)} left")


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
