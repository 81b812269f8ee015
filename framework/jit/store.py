"""Object code, compiled once per machine and then loaded from the user's cache folder."""

import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from ..values.errors import WideberthError
from . import cache, machine

_LOADED: dict[str, Mapping[str, int]] = {}
_GUARD = threading.Lock()
_BUSY: dict[str, threading.Lock] = {}
"""By the name of the code: kernels need not wait while the solver is compiled."""

WORTH = 1.0
"""s; what usually takes less is worth no line, unless it takes longer this time."""
_EVERY = 10.0
"""s between two lines, at first."""
_LONG = 5.0
"""s, after which the end is worth a line."""


def load(
    stem: str,
    source: str,
    names: Sequence[str],
    announce: Callable[[str], None] | None = None,
    usual: float | None = None,
    make: Callable[[], bytes] | None = None,
) -> Mapping[str, int]:
    """Compile functions for this processor, or take them from the cache; return their addresses.

    Object code is kept under the hash of its source, of llvmlite and of the processor, see
    `cache.folder`, and checked before it is loaded: code that is damaged, or that another user
    owns or may write, is compiled again. Where nothing can be kept, or others could write, it is
    compiled for this process alone.

    Parameters
    ----------
    stem : what the code is called in file names and messages, a Python identifier.
    source : an LLVM module; with ``make``, any text that the code depends on.
    names : of the functions.
    announce : is called with a line before something is compiled or another process is waited
        for, and now and then from there on; not where the cache serves, nor for what takes less
        than a second, unless stored code is damaged or nothing can be kept.
    usual : s that compiling usually takes.
    make : gives the object file where LLVM alone cannot make it from ``source``.

    Raises
    ------
    WideberthError : llvmlite is missing, or the source does not compile.
    """
    say = announce or (lambda line: None)
    name = f"wideberth_{stem}_{_digest(source)}"
    compiled = make or (lambda: machine.object_code(source, machine.host()))
    with _GUARD:
        alone = _BUSY.setdefault(name, threading.Lock())
    with alone:
        if name not in _LOADED:
            _LOADED[name] = _stored(_Wanted(stem, name, names, compiled, say, usual))
        return _LOADED[name]


def _digest(source: str) -> str:
    """Hash of all that compiled code depends on."""
    target = machine.host()
    beside = Path(machine.__file__).read_text(encoding="utf-8")  # how it is optimised
    return sha256(repr((source, beside, version("llvmlite"), target)).encode()).hexdigest()[:20]


@dataclass(frozen=True)
class _Wanted:
    """Code that is to be loaded; the fields are those of `load`, and its name in the cache."""

    stem: str
    name: str
    names: Sequence[str]
    make: Callable[[], bytes]
    say: Callable[[str], None]
    usual: float | None


def _stored(wanted: _Wanted) -> Mapping[str, int]:
    """Take the code from the cache, or compile it into the cache, or compile it for now."""
    try:
        path = cache.folder() / f"{wanted.name}.o"
    except OSError as error:
        what = f"compiling {wanted.stem} for this run only (it cannot be kept: {error})"
        with progress_notice(wanted.say, what, wanted.usual, at_once=True):
            return machine.loaded(wanted.make(), wanted.names)
    if (found := _reused(path, wanted)) is not None:
        return found
    waiting = f"waiting for another process, which compiles {wanted.stem}"
    with cache.alone(path, progress_notice(wanted.say, waiting, wanted.usual)):
        if (found := _reused(path, wanted)) is not None:  # another process made it
            return found
        damaged = os.path.lexists(path)
        why = "again, the stored one is damaged or not yours alone" if damaged else "(once)"
        what = f"compiling {wanted.stem} {why}"
        with progress_notice(wanted.say, what, wanted.usual, at_once=damaged):
            code = wanted.make()
        try:
            cache.write(path, code)
        except OSError as error:
            wanted.say(f"the code of {wanted.stem} is for this run only: {error}")
    return machine.loaded(code, wanted.names)


def _reused(path: Path, wanted: _Wanted) -> Mapping[str, int] | None:
    """Load stored code; None where there is none that is sound."""
    code = cache.read(path)
    try:
        return None if code is None else machine.loaded(code, wanted.names)
    except WideberthError:  # it is made again
        return None


@contextmanager
def progress_notice(
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
    begin, over = time.monotonic(), threading.Event()
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
    thread = threading.Thread(target=count, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        seconds = time.monotonic() - begin
        if seconds > _LONG:
            say(f"{what}: {seconds:.0f} s, done")
