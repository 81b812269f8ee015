"""Says that something takes its time: how long it usually takes, and how far it is."""

import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Event, Thread

_TIMES = ".times.json"
"""File beside the compiled modules: stem -> s that compiling took on this machine, at last."""
_LARGEST = 10_000
"""Bytes of it that are read."""
WORTH = 1.0
"""s; what usually takes less is worth no line, unless it takes longer this time."""
_EVERY = 10.0
"""s between two lines, at first."""
_LONG = 5.0
"""s, after which the end is worth a line."""


@contextmanager
def announced(
    say: Callable[[str], None], what: str, usual: float | None, *, at_once: bool = False
) -> Iterator[None]:
    """Say ``what`` goes on, now and then, and what it took if that was long.

    The first line comes at once where `WORTH` s or more are usual, otherwise after `WORTH` s.

    Parameters
    ----------
    say : is called with each line, also from another thread.
    what : goes on, as "compiling kernels".
    usual : s that it usually takes; None if unknown.
    at_once : whether it is worth a line however short it is.
    """
    begin, over = time.monotonic(), Event()
    long = usual is not None and usual >= WORTH
    about = f", usually about {usual:.0f} s" if long else ""
    silent = 0.0 if long or at_once else WORTH

    def count() -> None:
        if silent and over.wait(silent):
            return
        if silent:
            say(f"{what}{about} ...")
        seconds = 0.0
        while not over.wait(max(_EVERY, seconds / 5.0)):
            seconds = time.monotonic() - begin
            say(f"{what}: {seconds:.0f} s so far{about}")

    if not silent:
        say(f"{what}{about} ...")
    thread = Thread(target=count, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        seconds = time.monotonic() - begin
        if seconds > _LONG:
            say(f"{what}: {seconds:.0f} s, done")


def usual_seconds(root: Path, stem: str, default: float | None) -> float | None:
    """Return how long compiling took here the last time, else the default."""
    seconds = _times(root).get(stem)
    if isinstance(seconds, int | float) and 0.0 <= seconds < 1e5:
        return float(seconds)
    return default


def note_seconds(root: Path, stem: str, seconds: float) -> None:
    """Keep how long compiling took; nothing is kept where nothing can be written."""
    times = {**_times(root), stem: round(seconds, 1)}
    with suppress(OSError):
        handle, name = tempfile.mkstemp(prefix=_TIMES, dir=root)  # for its owner alone
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(times, file)
        os.replace(name, root / _TIMES)


def _times(root: Path) -> dict[str, object]:
    path = root / _TIMES
    try:
        if path.stat().st_size > _LARGEST:
            return {}
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
