"""The folder that compiled modules are kept in: its place, its soundness, its sharing.

Every compiled module is a folder of its own. It is filled under another name, sealed with the
hash of every file, and renamed when complete: a reader finds all of it or nothing.
"""

import json
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path

_SEAL = "seal.json"
_BUDGET = 200 * 2**20
"""Bytes that the folder may hold; the modules that were not used for the longest time go first."""
_ABANDONED = 86400.0
"""s, after which a folder that was never completed belongs to a process that died."""
_PATIENCE = 300.0
"""s to wait for another process that compiles the same; then everyone compiles for himself."""
_UNFINISHED = ".unfinished-"


def home() -> Path:
    """Return the folder: WIDEBERTH_CACHE, else the platform's place for caches."""
    if chosen := os.environ.get("WIDEBERTH_CACHE"):
        return Path(chosen).expanduser().absolute() / "jit"
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "wideberth" / "jit"


def begin(root: Path) -> Path:
    """Make an empty folder to fill; OSError where nothing can be written."""
    root.mkdir(parents=True, exist_ok=True)
    return Path(tempfile.mkdtemp(prefix=_UNFINISHED, dir=root))


def complete(filled: Path, final: Path) -> None:
    """Seal a filled folder and give it its name, unless another process was quicker."""
    text = json.dumps(_hashes(filled))
    (filled / _SEAL).write_text(text, encoding="utf-8")
    with suppress(OSError):
        filled.rename(final)
    remove(filled)


def sound(folder: Path) -> bool:
    """Whether a folder holds exactly what it was sealed with; marks it as used."""
    try:
        seal = json.loads((folder / _SEAL).read_text(encoding="utf-8"))
        intact = bool(seal) and seal == _hashes(folder)
    except (OSError, ValueError):
        return False
    with suppress(OSError):
        os.utime(folder / _SEAL)
    return intact


def remove(folder: Path) -> None:
    """Delete a folder, under another name first, so that nobody reads it half deleted."""
    if not folder.exists():
        return
    with suppress(OSError):
        grave = Path(tempfile.mkdtemp(prefix=_UNFINISHED, dir=folder.parent))
        folder = folder.rename(grave / folder.name).parent
    shutil.rmtree(folder, ignore_errors=True)


def prune(root: Path, keep: Path, budget: int = _BUDGET) -> None:
    """Delete what died unfinished and, beyond the budget, what was not used for longest."""
    used = []
    for folder in root.iterdir():
        with suppress(OSError):
            if folder.name.startswith(_UNFINISHED):
                if time.time() - folder.stat().st_mtime > _ABANDONED:
                    remove(folder)
            elif folder.is_dir() and folder != keep:
                used.append(((folder / _SEAL).stat().st_mtime, folder))
    room = budget - _size(keep)
    for _, folder in sorted(used, reverse=True):
        room -= _size(folder)
        if room < 0:
            remove(folder)


@contextmanager
def alone(root: Path, name: str) -> Iterator[None]:
    """Hold off other processes that want to make the same module.

    The operating system frees the lock of a process that dies. Where there are no locks (some
    network folders), or after long waiting, the caller goes on beside the others: that costs time
    only.
    """
    # One of 16 files for all names: they are never deleted, which could not be done safely.
    path = root / f".lock-{sha256(name.encode()).hexdigest()[0]}"
    try:
        root.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError:
        yield
        return
    try:
        end = time.monotonic() + _PATIENCE
        while not _lock(handle) and time.monotonic() < end:
            time.sleep(0.05)
        yield
    finally:
        os.close(handle)


def _lock(handle: int) -> bool:
    """Try to lock an open file; closing it frees it."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return not isinstance(error, BlockingIOError | PermissionError)  # no locks there: go on
    return True


def _hashes(folder: Path) -> dict[str, str]:
    """Hash of every file of Python or Numba below a folder."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.suffix in {".py", ".nbi", ".nbc"}:
            found[path.relative_to(folder).as_posix()] = sha256(path.read_bytes()).hexdigest()
    return found


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
