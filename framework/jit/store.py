"""Object code, compiled once per machine and then loaded from the user's cache folder."""

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

from ..values.errors import WideberthError
from . import folder, machine
from .patience import announced, note_seconds, usual_seconds

_LOADED: dict[str, Mapping[str, int]] = {}
_GUARD = threading.Lock()
_BUSY: dict[str, threading.Lock] = {}
"""By the name of the code: kernels need not wait while the solver is compiled."""
_CODE = "code.o"


def load(
    stem: str,
    source: str,
    names: Sequence[str],
    announce: Callable[[str], None] | None = None,
    usual: float | None = None,
    make: Callable[[], bytes] | None = None,
) -> Mapping[str, int]:
    """Compile functions for this processor, or take them from the cache; return their addresses.

    Object code is kept under the hash of its source, of llvmlite and of the processor, in
    WIDEBERTH_CACHE or the platform's place for caches, and checked before it is loaded: code
    that is damaged, or that another user owns or may write, is compiled again. Where nothing can
    be kept, or others could write, it is compiled for this process alone.

    Parameters
    ----------
    stem : what the code is called in file names and messages, a Python identifier.
    source : an LLVM module; with ``make``, any text that the code depends on.
    names : of the functions.
    announce : is called with a line before something is compiled or another process is waited
        for, and now and then from there on; not where the cache serves, nor for what takes less
        than a second, unless stored code is damaged or nothing can be kept.
    usual : s that compiling usually takes, which is stated until it has been measured here.
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
        root = folder.opened()
    except OSError as error:
        return _for_now(wanted, error)
    final = root / wanted.name
    if (found := _reused(final, wanted)) is not None:
        return found
    usual = usual_seconds(root, wanted.stem, wanted.usual)
    others = announced(
        wanted.say, f"waiting for another process, which compiles {wanted.stem}", usual
    )
    with folder.alone(root, wanted.name, others):
        if (found := _reused(final, wanted)) is not None:  # another process made it
            return found
        damaged = os.path.lexists(final)
        folder.remove(final)
        try:
            place = folder.begin(root)
        except OSError as error:
            return _for_now(wanted, error)
        why = "again, the stored one is damaged or not yours alone" if damaged else "(once)"
        begin = time.monotonic()
        what = f"compiling {wanted.stem} {why}"
        with announced(wanted.say, what, usual, at_once=damaged):
            code = _built(place, final, wanted)
        note_seconds(root, wanted.stem, time.monotonic() - begin)
    return machine.loaded(code, wanted.names)


def _for_now(wanted: _Wanted, error: OSError) -> Mapping[str, int]:
    """Compile for this process alone."""
    what = f"compiling {wanted.stem} for this run only (it cannot be kept: {error})"
    with announced(wanted.say, what, wanted.usual, at_once=True):
        return machine.loaded(wanted.make(), wanted.names)


def _reused(final: Path, wanted: _Wanted) -> Mapping[str, int] | None:
    """Load stored code; None where there is none that is sound."""
    if not folder.sound(final):
        return None
    try:
        return machine.loaded((final / _CODE).read_bytes(), wanted.names)
    except (OSError, WideberthError):  # it is made again
        return None


def _built(place: Path, final: Path, wanted: _Wanted) -> bytes:
    """Compile into an unfinished folder, which becomes the final one where it can be written."""
    try:
        code = wanted.make()
        with suppress(OSError):  # a full disk, say: it is compiled, whether it can be kept or not
            (place / _CODE).write_bytes(code)
            folder.complete(place, final)
            folder.prune(final.parent, final)
    finally:
        folder.remove(place)
    return code
