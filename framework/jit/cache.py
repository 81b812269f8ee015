"""The user's folder of compiled code: one file for all that is compiled at once.

What is kept there is machine code: another user who could write it could run any code as this one.
So each file is for its owner alone, and one that another user owns or may write is not read. The
hash in front of the code shows damage, no malice. Root is trusted.
"""

import os
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from hashlib import sha256
from pathlib import Path

from ..plugins.extras import from_extra
from ..plugins.file_lock import file_lock

_BUDGET = 200 * 2**20
"""Bytes that the folder may hold; the files that were not used for the longest time go first."""
_ABANDONED = 86400.0
"""s, after which a file that was never completed belongs to a process that died."""
_PATIENCE = 300.0
"""s to wait for another process that compiles the same; then each compiles for itself."""
_UNFINISHED = ".unfinished-"
_HASH = 32
"""Bytes of the hash in front of the code."""


def folder(kind: str = "jit") -> Path:
    """Return the folder, made if missing: in WIDEBERTH_CACHE, else among the user's caches.

    Parameters
    ----------
    kind : of what is kept there; each has a folder of its own.

    Raises
    ------
    OSError : it cannot be made, its user has no home folder, it is a symbolic link, or other
        users may write there.
    WideberthError : it is among the user's caches, and platformdirs is not installed.
    """
    chosen = os.environ.get("WIDEBERTH_CACHE")
    try:
        base = Path(chosen or _user_cache()).expanduser()
    except RuntimeError as error:  # there is no home folder
        raise OSError(f"no place for it: {error}; set WIDEBERTH_CACHE") from None
    root = base.absolute() / kind
    for place in (base.absolute(), root):
        if place.is_symlink():
            raise PermissionError(
                f"{place} is a symbolic link, which is not followed: set WIDEBERTH_CACHE to the "
                "folder that it leads to"
            )
    root.mkdir(0o700, parents=True, exist_ok=True)
    check_private(root)
    return root


def check_private(*paths: Path) -> None:
    """Refuse files and folders of code that another user could have put there, and links.

    Raises
    ------
    OSError : one is a symbolic link, belongs to another user, may be written by others, or is not
        there.
    """
    for path in paths:
        if path.is_symlink() or not _own(path.stat()):
            raise PermissionError(
                f"{path} is a link, belongs to another user, or others may write there: remove "
                f"it, or `chmod 700 {path}` if all in it is yours, or set WIDEBERTH_CACHE"
            )


def _user_cache() -> str:
    """Return this user's folder of caches, as the operating system has it."""
    need = "a folder for compiled code needs platformdirs"
    places = from_extra("platformdirs", "fast", need, "or set WIDEBERTH_CACHE")
    return str(places.user_cache_dir("wideberth", False))


def _own(found: os.stat_result) -> bool:
    """Whether this user or root owns a file or a folder, and no other user may write it."""
    if sys.platform == "win32":  # where the folder's place in the user's profile protects it
        return True
    return found.st_uid in (os.getuid(), 0) and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def read(path: Path) -> bytes | None:
    """Return the code of a file, and mark it as used; None unless it is whole and of this user."""
    flags = os.O_RDONLY
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"):  # no link; a pipe is not waited for
        flags |= getattr(os, name, 0)
    try:
        with open(os.open(path, flags), "rb") as file:
            found = os.fstat(file.fileno())
            if not (stat.S_ISREG(found.st_mode) and _own(found)):
                return None
            seal, code = file.read(_HASH), file.read()
    except OSError:
        return None
    with suppress(OSError):
        os.utime(path)
    return code if sha256(code).digest() == seal else None


def write(path: Path, code: bytes) -> None:
    """Keep code in a file that appears whole or not at all; older files make room.

    Raises
    ------
    OSError : it cannot be written.
    """
    handle, name = tempfile.mkstemp(prefix=_UNFINISHED, dir=path.parent)  # for its owner alone
    try:
        with open(handle, "wb") as file:
            file.write(sha256(code).digest() + code)
        os.replace(name, path)
    finally:
        with suppress(OSError):
            os.unlink(name)
    prune(path.parent)


def prune(root: Path, budget: int = _BUDGET) -> None:
    """Delete what died unfinished and, beyond the budget, what was not used for longest."""
    used = []
    for path in root.iterdir():
        with suppress(OSError):
            found = path.stat()
            if path.name.startswith(_UNFINISHED):
                if time.time() - found.st_mtime > _ABANDONED:
                    path.unlink()
            elif path.match("wideberth_*.o"):
                used.append((found.st_mtime, found.st_size, path))
    for _, size, path in sorted(used, reverse=True):
        budget -= size
        if budget < 0:
            with suppress(OSError):
                path.unlink()


@contextmanager
def alone(path: Path, waiting: AbstractContextManager[None]) -> Iterator[None]:
    """Hold off other processes that want to make the same file.

    The operating system frees the lock of a process that dies. Where there are no locks (some
    network folders), or after long waiting, the caller goes on beside the others: that costs time
    only. ``waiting`` is entered while another process holds the lock.
    """
    # 16 locks for all names of a stem, since locks are never deleted. One stem's alone: kernels of
    # a second must not wait for a solver of minutes.
    stem, _, digest = path.stem.rpartition("_")
    lock = path.with_name(f".lock-{stem}-{digest[:1]}")
    with ExitStack() as held:
        with suppress(OSError):
            try:
                held.enter_context(file_lock(lock))
            except BlockingIOError:
                with waiting:
                    held.enter_context(file_lock(lock, _PATIENCE))
        yield
