"""The folder that compiled code is kept in: its place, its soundness, its sharing.

All that is compiled at once is a folder of its own. It is filled under another name, sealed with
the hash of every file, and renamed when complete: a reader finds all of it or nothing.

What is kept there is machine code: a user who can write there can run any code as this one. The
seal lies beside the files and shows damage, no malice. So a folder or a file that another user
owns or may write is not read, and what is made here is for its owner alone. Root is trusted, and
so is the owner of a folder above, unless everybody may write there.
"""

import json
import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from hashlib import sha256
from pathlib import Path

_SEAL = "seal.json"
_LARGEST_SEAL = 100_000
"""Bytes; a seal names one file."""
_MODULE = re.compile(r"wideberth_\w+_[0-9a-f]{20}")
"""Names of compiled modules; nothing else is pruned."""
_BUDGET = 200 * 2**20
"""Bytes that the folder may hold; the modules that were not used for the longest time go first."""
_ABANDONED = 86400.0
"""s, after which a folder that was never completed belongs to a process that died."""
_PATIENCE = 300.0
"""s to wait for another process that compiles the same; then everyone compiles for himself."""
_UNFINISHED = ".unfinished-"


def home() -> Path:
    """Return the folder: WIDEBERTH_CACHE, else the platform's place for caches.

    A relative XDG_CACHE_HOME or LOCALAPPDATA is passed over, as the XDG specification wants it.

    Raises
    ------
    OSError : the user has no home folder, or WIDEBERTH_CACHE names that of an unknown user.
    """
    try:
        if chosen := os.environ.get("WIDEBERTH_CACHE"):
            return Path(chosen).expanduser().absolute() / "jit"
        if sys.platform == "win32":
            base = _absolute("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
        elif sys.platform == "darwin":
            base = Path.home() / "Library" / "Caches"
        else:
            base = _absolute("XDG_CACHE_HOME") or Path.home() / ".cache"
    except RuntimeError as error:  # Python found no home folder
        raise OSError(f"no place for it: {error}; set WIDEBERTH_CACHE") from None
    return base / "wideberth" / "jit"


def _absolute(variable: str) -> Path | None:
    value = Path(os.environ.get(variable, ""))
    return value if value.is_absolute() else None


def opened() -> Path:
    """Return the folder, made if missing; see `home`.

    Raises
    ------
    OSError : it cannot be made, or another user could have written what is in it.
    """
    root = home()
    missing = [path for path in (root, *root.parents) if not os.path.lexists(path)]
    for path in reversed(missing):
        path.mkdir(0o700, exist_ok=True)
    if sys.platform == "win32":  # where the folder's place in the user's profile protects it
        return root
    for path in (root, *root.parents):
        if path.is_symlink() and path.lstat().st_uid not in _trusted():
            raise PermissionError(f"{path} is a symbolic link that another user made")
    root = root.resolve()
    if not root.is_dir():
        raise NotADirectoryError(f"{root} is no folder")
    if _foreign(root.stat()):
        raise PermissionError(
            f"{root} belongs to another user, or others may write there: remove it, or "
            f"`chmod 700 {root}` if all in it is yours, or set WIDEBERTH_CACHE"
        )
    for path in root.parents:
        mode = path.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise PermissionError(f"everybody may write to {path} above it: set WIDEBERTH_CACHE")
    return root


def _trusted() -> tuple[int, int]:
    """Users whose files are read: this one and root."""
    return os.getuid(), 0


def _foreign(found: os.stat_result) -> bool:
    """Whether another user owns a file or a folder, or may write it."""
    return found.st_uid not in _trusted() or bool(found.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def begin(root: Path) -> Path:
    """Make an empty folder to fill; OSError where nothing can be written."""
    return Path(tempfile.mkdtemp(prefix=_UNFINISHED, dir=root))


def complete(filled: Path, final: Path) -> None:
    """Seal a filled folder and give it its name, unless another process was quicker."""
    text = json.dumps(_hashes(filled))
    (filled / _SEAL).write_text(text, encoding="utf-8")
    for path in filled.rglob("*"):  # whatever the umask is
        path.chmod(0o700 if path.is_dir() else 0o600)
    with suppress(OSError):
        filled.rename(final)
    remove(filled)


def sound(folder: Path) -> bool:
    """Whether a folder holds exactly what it was sealed with, by this user; marks it as used."""
    try:
        if not _own(folder) or (folder / _SEAL).stat().st_size > _LARGEST_SEAL:
            return False
        seal = json.loads((folder / _SEAL).read_text(encoding="utf-8"))
        intact = bool(seal) and seal == _hashes(folder)
    except (OSError, ValueError, RecursionError):
        return False
    with suppress(OSError):
        os.utime(folder / _SEAL)
    return intact


def _own(folder: Path) -> bool:
    """Whether all in a folder are plain files and folders that no other user owns or may write."""
    for path in (folder, *folder.rglob("*")):
        found = path.lstat()
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
            return False
        if sys.platform != "win32" and _foreign(found):
            return False
    return True


def remove(folder: Path) -> None:
    """Delete a folder, under another name first, so that no process reads it half deleted."""
    if not os.path.lexists(folder):
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
            elif _MODULE.fullmatch(folder.name) and folder != keep:
                used.append(((folder / _SEAL).stat().st_mtime, folder))
    room = budget - _size(keep)
    for _, folder in sorted(used, reverse=True):
        room -= _size(folder)
        if room < 0:
            remove(folder)


@contextmanager
def alone(root: Path, name: str, waiting: AbstractContextManager[None]) -> Iterator[None]:
    """Hold off other processes that want to make the same module.

    The operating system frees the lock of a process that dies. Where there are no locks (some
    network folders), or after long waiting, the caller goes on beside the others: that costs time
    only. ``waiting`` is entered while another process holds the lock.
    """
    # 16 files for all names of a stem: they are never deleted, which could not be done safely.
    # One stem's alone: kernels of a second must not wait for a solver of minutes.
    stem = name.rpartition("_")[0]
    path = root / f".lock-{stem}-{sha256(name.encode()).hexdigest()[0]}"
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError:
        yield
        return
    try:
        if not _lock(handle):
            end = time.monotonic() + _PATIENCE
            with waiting:
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
    """Hash of every object file below a folder."""
    found = {}
    for path in sorted(folder.rglob("*.o")):
        if path.is_file():
            found[path.relative_to(folder).as_posix()] = sha256(path.read_bytes()).hexdigest()
    return found


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
