"""The user's folder of compiled code, which other users must not be able to write.

Another user who could write there could run any code as this one. Root is trusted.
"""

import os
import stat
import sys
from pathlib import Path


def folder(kind: str) -> Path:
    """Return a folder of compiled code in WIDEBERTH_CACHE, or else in the user's cache folder.

    The folder is created if missing.

    Parameters
    ----------
    kind : kind of code; each kind has its own folder.

    Raises
    ------
    OSError : the folder cannot be created, its user has no home folder, it is a symbolic link, or
        other users may write there.
    """
    import platformdirs

    chosen = os.environ.get("WIDEBERTH_CACHE")
    try:
        base = Path(chosen or platformdirs.user_cache_dir("wideberth", False)).expanduser()
    except RuntimeError as error:  # there is no home folder
        raise OSError(f"no folder for compiled code: {error}; set WIDEBERTH_CACHE") from None
    root = base.absolute() / kind
    for path in (base.absolute(), root):
        if path.is_symlink():
            raise PermissionError(
                f"{path} is a symbolic link, which is not followed: set WIDEBERTH_CACHE to the "
                "folder that it leads to"
            )
    root.mkdir(0o700, parents=True, exist_ok=True)
    check_private(root)
    return root


def check_private(*paths: Path) -> None:
    """Refuse files and folders of code that another user could have put there, and links.

    Raises
    ------
    OSError : one is a symbolic link, belongs to another user, may be written by others, or does
        not exist.
    """
    for path in paths:
        if path.is_symlink() or not is_private(path.stat()):
            raise PermissionError(
                f"{path} is a link, belongs to another user, or others may write there: remove "
                f"it, or `chmod 700 {path}` if all in it is yours, or set WIDEBERTH_CACHE"
            )


def is_private(status: os.stat_result) -> bool:
    """Whether this user or root owns a file or a folder, and no other user may write it."""
    if sys.platform == "win32":  # where the folder's place in the user's profile protects it
        return True
    shared = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return status.st_uid in (os.getuid(), 0) and not shared
