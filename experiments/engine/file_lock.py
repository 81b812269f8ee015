"""Locks on files, by which processes of one user keep out of each other's way."""

import errno
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path


@contextmanager
def file_lock(path: Path, patience: float = 0.0) -> Iterator[None]:
    """Hold the lock of a file by the library filelock; on a disk without locks nothing is held.

    Parameters
    ----------
    patience : s to wait for another one that holds it.

    Raises
    ------
    BlockingIOError : another one holds it.
    OSError : the file cannot be opened.
    """
    import filelock

    with ExitStack() as held:
        try:
            held.enter_context(filelock.FileLock(path, timeout=patience))
        except filelock.Timeout:
            raise BlockingIOError(errno.EAGAIN, "another process holds it", str(path)) from None
        except NotImplementedError:  # a system without locks
            pass
        except OSError as error:
            if error.errno not in (errno.ENOLCK, errno.ENOTSUP):  # a disk without them
                raise
        yield
