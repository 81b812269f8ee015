"""Warnings of controllers through `logging`, limited in rate.

A user who never reads a plan's reason still learns that the planner brakes, that plans give way
or that detections are refused: each is a warning of the logger ``wideberth.controllers.NAME``,
NAME the controller's class. Python prints it where logging is not configured.
"""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from time import monotonic

ROOT = "wideberth.controllers"
"""Name of the logger above all of them."""

PAUSE = 10.0
"""s between two warnings of one kind."""


class RateLimitedWarnings:
    """Logs a new warning at once, and its repeats at most once in `PAUSE` seconds.

    One for the process, whatever the number of controllers: the limit is for the reader. It goes
    by the clock of the machine; stamps may stand still, jump, and run a hundred times faster in a
    simulation.

    Parameters
    ----------
    pause : s between two warnings of one kind from one class of controllers.
    clock : s, monotonic.
    """

    def __init__(self, pause: float = PAUSE, clock: Callable[[], float] = monotonic) -> None:
        self._pause, self._clock = pause, clock
        self._last: dict[tuple[str, str], float] = {}
        self._held: dict[tuple[str, str], int] = {}

    def warn(self, name: str, kind: str, words: str) -> None:
        """Warn, or count.

        Parameters
        ----------
        name : of the controller's class.
        kind : of the warning; its repeats are limited.
        words : what happened; the kind is put before it where it does not begin with it.
        """
        logger = logging.getLogger(f"{ROOT}.{name}")
        if not logger.isEnabledFor(logging.WARNING):
            return
        key, now = (name, kind), self._clock()
        if key in self._last and now - self._last[key] < self._pause:
            self._held[key] = self._held.get(key, 0) + 1
            return
        held, self._last[key] = self._held.pop(key, 0), now
        more = f" (and {held} times since the last warning of this kind)" if held else ""
        said = words if words.startswith(kind) else f"{kind}: {words}"
        with suppress(Exception):  # a handler of the user's own may fail; the robot drives on
            logger.warning("%s%s", said, more)


WARNINGS = RateLimitedWarnings()
"""The warnings of this process."""


@contextmanager
def quiet() -> Iterator[None]:
    """Silence the warnings of controllers while their plans are recorded anyway."""
    logger = logging.getLogger(ROOT)
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        yield
    finally:
        logger.setLevel(level)
