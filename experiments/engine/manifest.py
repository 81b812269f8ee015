"""The manifest of a result: the list of the files that the package wrote into its folder.

Nothing else in the folder is ever removed or overwritten. ``manifest.json`` (format
"wideberth/result", version 1) is the first file of a result; it names every file before that file
is written. While a run goes on, shards, whose names are hashes, are recognised by their names, and
half-written files by the name of the file that they would have become.
"""

import os
import re
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath

from ...framework.plugins.io import read_json, write_json
from ...framework.values.errors import WideberthError

NAME = "manifest.json"
KIND = "result"
VERSION = 1
SHARDS = "shards"

_SHARD = re.compile(r"[0-9a-f]{24}(\.times)?\.json")
_HALF = re.compile(r"\.(?P<name>.+)\.[a-z0-9_]{8}\.part")
"""As `wideberth.framework.plugins.io.write_bytes` names a file that is not complete."""


def listed(folder: Path) -> frozenset[str] | None:
    """Return the names in a folder's manifest, relative to the folder; None without a manifest.

    Raises
    ------
    WideberthError : the manifest is damaged, of another kind, or names a place elsewhere.
    """
    path = folder / NAME
    if not os.path.lexists(path):
        return None
    _refuse_link(path)
    names = read_json(path, KIND, VERSION).get("files")
    if not isinstance(names, list) or not all(map(_inside, names)):
        raise WideberthError(f"{path} is damaged: 'files' must be a list of names in the folder")
    return frozenset(names)


def _inside(name: object) -> bool:
    """Whether a name is one that a manifest may hold."""
    if not isinstance(name, str) or not name or "\0" in name:
        return False
    place = PurePosixPath(name)
    return not place.is_absolute() and ".." not in place.parts and place.as_posix() == name


def begin(folder: Path, names: Iterable[str]) -> None:
    """Write the manifest of a new result; it names itself too."""
    write_json(folder / NAME, KIND, VERSION, {"files": sorted({NAME, *names})})


def claim(folder: Path, names: Iterable[str]) -> None:
    """Name files that are about to be written, in a manifest where there is one.

    Raises
    ------
    WideberthError : a file of this name is there already and is not listed, or its place is a
        symbolic link.
    """
    known = listed(folder)
    names = set(names)
    for name in sorted(names):
        path = folder / name
        _refuse_links(folder, path)
        if name not in (known or ()) and os.path.lexists(path):
            raise WideberthError(
                f"{path} was not written by this package and is not overwritten; move it away "
                "and run the same command again"
            )
    if known is not None and not names <= known:
        begin(folder, known | names)


def half_written(folder: Path) -> Iterator[Path]:
    """Yield what a run that was killed left incomplete."""
    yield from (path for path in owned(folder) if _HALF.fullmatch(path.name))


def shards(folder: Path) -> Iterator[Path]:
    """Yield the files of finished tasks, and those of them that are half-written."""
    yield from _in_shards(folder / SHARDS)


def remove(folder: Path) -> list[Path]:
    """Remove the files of a result, the manifest last, and folders that are empty then.

    The config goes first: what is left of an interrupted removal is no result. ``shards/`` stays,
    which holds the lock.

    Returns
    -------
    What is still there, because the manifest does not name it.

    Raises
    ------
    WideberthError : as `owned`; nothing is removed then.
    """
    found = owned(folder)
    first, last = folder / "config.yaml", folder / NAME
    for path in sorted(found, key=lambda path: (path != first, path == last, path)):
        path.unlink(missing_ok=True)
    parents = {parent for path in found for parent in path.relative_to(folder).parents}
    for parent in sorted(parents - {Path(), Path(SHARDS)}, reverse=True):
        remove_empty(folder / parent)
    return sorted(path for path in folder.iterdir() if path.name != SHARDS or any(path.iterdir()))


def remove_empty(folder: Path) -> None:
    """Remove a folder in which nothing is left."""
    try:
        folder.rmdir()
    except OSError:
        if not any(folder.iterdir()):
            raise


def owned(folder: Path) -> list[Path]:
    """Return the files in a folder that the package wrote.

    Raises
    ------
    WideberthError : no manifest, or a symbolic link where a file of the result should be.
    """
    names = listed(folder)
    if names is None:
        raise WideberthError(f"{folder} holds no {NAME}; nothing in it is removed")
    places = {folder / name for name in names}
    for path in places:
        _refuse_links(folder, path)
    _refuse_link(folder / SHARDS)
    found = [path for path in places if _is_file(path)]
    for parent in {path.parent for path in places}:
        if parent.is_dir():
            for path in parent.iterdir():
                half = _HALF.fullmatch(path.name)
                if half and parent / half["name"] in places and _is_file(path):
                    found.append(path)
    return [*found, *_in_shards(folder / SHARDS)]


def _in_shards(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    found = []
    for path in folder.iterdir():
        half = _HALF.fullmatch(path.name)
        if _SHARD.fullmatch(half["name"] if half else path.name) and _is_file(path):
            found.append(path)
    return found


def _is_file(path: Path) -> bool:
    """Whether a regular file stands there, no link to one."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False


def _refuse_links(folder: Path, path: Path) -> None:
    """Refuse a symbolic link on the way from a result's folder to a file."""
    here = folder
    for part in path.relative_to(folder).parts:
        here /= part
        _refuse_link(here)


def _refuse_link(path: Path) -> None:
    if path.is_symlink():
        raise WideberthError(
            f"{path} is a symbolic link, which no run makes; nothing is written or removed "
            "through it: put the file or folder itself there, or move the link away"
        )
