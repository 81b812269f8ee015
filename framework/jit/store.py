"""Generated modules, compiled once per machine and then loaded from the user's cache folder."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any, cast

from ..values.errors import WideberthError
from . import columns, folder

_LOADED: dict[str, ModuleType] = {}
_GUARD = threading.RLock()


def load(stem: str, source: str, announce: Callable[[str], None] | None = None) -> ModuleType:
    """Import a generated module whose functions Numba compiles.

    Every function that is called from Python or handed on carries ``cache=True`` and its
    signature: ``@njit("void(...)", cache=True, ...)``. It is compiled while the module is
    imported; other signatures are refused afterwards, since they would be compiled outside the
    cache. A compiled module is kept under the hash of its source, of Python, Numba, llvmlite and
    of the processor, in WIDEBERTH_CACHE or the platform's place for caches (whatever
    NUMBA_CACHE_DIR says), and checked before it is loaded: one that is damaged, or that another
    user owns or may write, is compiled again. Where nothing can be kept, or others could write, it
    is compiled for this process alone.

    Parameters
    ----------
    stem : what the module is called in file names and messages, a Python identifier.
    source : of the module. Of this package it may import `wideberth.framework.jit.columns` alone.
    announce : is called with one line before something is compiled, which takes seconds; not
        where the cache serves.

    Raises
    ------
    WideberthError : Numba is missing or switched off, or the source does not compile.
    """
    say = announce or (lambda line: None)
    name = f"wideberth_{stem}_{_digest(source)}"
    with _GUARD:
        if name not in _LOADED:
            try:
                _LOADED[name] = _stored(stem, name, source, say)
            except WideberthError:
                raise
            except Exception as error:
                raise WideberthError(
                    f"the generated module {stem!r} does not compile ({type(error).__name__}: "
                    f"{error}); take a solver that needs no compilation, such as 'fatrop', and "
                    "report this"
                ) from error
        return _LOADED[name]


def _digest(source: str) -> str:
    """Hash of all that compiled code depends on."""
    try:
        import numba
        from numba.core.registry import cpu_target
    except ImportError as error:
        raise WideberthError(
            f"Numba cannot be imported ({error}); install it again, or take a solver that needs "
            "no compilation, such as 'fatrop'"
        ) from error
    if _settings().DISABLE_JIT:
        raise WideberthError(
            "NUMBA_DISABLE_JIT is set, so nothing is compiled; unset it, or take a solver that "
            "needs no compilation, such as 'fatrop'"
        )
    machine = cast(Any, cpu_target).target_context.codegen().magic_tuple()
    versions = (sys.version, numba.__version__, version("llvmlite"))
    beside = Path(columns.__file__).read_text(encoding="utf-8")  # generated modules import it
    return sha256(repr((source, beside, versions, machine)).encode()).hexdigest()[:20]


def _stored(stem: str, name: str, source: str, say: Callable[[str], None]) -> ModuleType:
    """Take the module from the cache, or compile it into the cache, or compile it for now."""
    try:
        root = folder.opened()
    except OSError as error:
        return _for_now(stem, name, source, say, error)
    final = root / name
    if (module := _reused(final, name, source)) is not None:
        return module
    with folder.alone(root, name):
        if (module := _reused(final, name, source)) is not None:  # another process made it
            return module
        damaged = os.path.lexists(final)
        folder.remove(final)
        try:
            place = folder.begin(root)
        except OSError as error:
            return _for_now(stem, name, source, say, error)
        why = "again, the stored one is damaged or not yours alone" if damaged else "(once)"
        say(f"compiling {stem} {why} ...")
        return _built(place, final, name, source)


def _for_now(
    stem: str, name: str, source: str, say: Callable[[str], None], error: OSError
) -> ModuleType:
    """Compile for this process alone."""
    say(f"compiling {stem} for this run only (it cannot be kept: {error}) ...")
    return _executed(name, source, None)


def _reused(final: Path, name: str, source: str) -> ModuleType | None:
    """Return a stored module, None where there is none that is sound."""
    if not folder.sound(final):
        return None
    try:
        return _executed(name, source, final)
    except Exception:  # whatever a file does to Numba: it is made again
        return None


def _built(place: Path, final: Path, name: str, source: str) -> ModuleType:
    """Compile into an unfinished folder; where that cannot be written, for this process alone."""
    try:
        (place / f"{name}.py").write_text(source, encoding="utf-8")
        module = _executed(name, source, place)
        with suppress(OSError):  # it is compiled, whether it can be kept or not
            folder.complete(place, final)
            folder.prune(final.parent, final)
    except OSError:  # a full disk, say
        return _executed(name, source, None)
    finally:
        folder.remove(place)
    return module


def _executed(name: str, source: str, place: Path | None) -> ModuleType:
    """Run the source as a module; ``place`` holds its file and what Numba keeps beside it."""
    module = ModuleType(name)
    path = str(place / f"{name}.py") if place else f"<{name}>"
    text = source if place else source.replace("cache=True", "cache=False")
    module.__file__ = path
    sys.modules[name] = module  # Numba looks a function's module up by its name
    try:
        with _beside_the_source():
            exec(compile(text, path, "exec"), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    for value in vars(module).values():
        if hasattr(value, "disable_compile") and value.py_func.__module__ == name:
            value.disable_compile()  # what it imports is not its own
    return module


@contextmanager
def _beside_the_source() -> Iterator[None]:
    """Have Numba keep its files beside the source, whatever its settings say."""
    settings = _settings()
    wanted = {"CACHE_DIR": "", "CACHE_LOCATOR_CLASSES": "InTreeCacheLocator"}
    before = {key: getattr(settings, key, "") for key in wanted}
    for key, value in wanted.items():
        setattr(settings, key, value)
    try:
        yield
    finally:
        for key, value in before.items():
            setattr(settings, key, value)


def _settings() -> Any:
    from numba.core import config

    return config
