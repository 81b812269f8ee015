"""The user's folder of compiled code: one file for all that is compiled at once.

What is kept there is machine code: another user who could write it could run any code as this one.
So each file is for its owner alone, and one that another user owns or may write is not read. The
hash in front of the code shows damage, no malice. Root is trusted.
"""

import os
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from hashlib import sha256
from pathlib import Path

from ..plugins import code_cache
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


def folder() -> Path:
    """Return the folder of object code; raises as `wideberth.framework.plugins.code_cache`."""
    return code_cache.folder("jit")


def read(path: Path) -> bytes | None:
    """Return the code of a file, and mark it as used; None unless it is whole and of this user."""
    flags = os.O_RDONLY
    for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_BINARY"):  # no link; a pipe is not waited for
        flags |= getattr(os, name, 0)
    try:
        with open(os.open(path, flags), "rb") as file:
            found = os.fstat(file.fileno())
            if not (stat.S_ISREG(found.st_mode) and code_cache.is_private(found)):
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
