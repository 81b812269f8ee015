"""A progress bar for long work, and nothing for short work."""

import threading
from typing import Any


class Progress:
    """A bar with an ETA, shown on a terminal once the work has taken two seconds."""

    def __init__(self, total: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

        console = Console(stderr=True)
        self.bar = Progress(
            BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), console=console,
            disable=not console.is_terminal, transient=True,
        )  # fmt: skip
        self.task = self.bar.add_task("tasks", total=total)
        self.timer = threading.Timer(2.0, self.bar.start)
        self.timer.daemon = True

    def __enter__(self) -> Any:
        self.timer.start()
        return lambda: self.bar.advance(self.task)

    def __exit__(self, *_: object) -> None:
        self.timer.cancel()
        self.timer.join()
        self.bar.stop()
