"""The folder of a result: made whole, checked before it is used again, one run at a time.

A folder is written into if it is new or empty, or if its manifest says that it holds the same
result, begun before. ``manifest.json`` (format "wideberth/result", version 1) is the first file
of a result and lists every file that the package wrote there, before that file is written;
nothing else in the folder is ever removed or overwritten. While a run goes on, shards are
recognised by their names, which are hashes, and half-written files by the name of the file that
they would have become.
"""

import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from ...framework.plugins.config import build, describe
from ...framework.plugins.io import read_json, write_json, write_text
from ...framework.plugins.yamlfile import dump, read_config
from ...framework.values.errors import WideberthError
from .progress import say

_FIRST_FILES = ("config.yaml", "provenance.json")
_LONGEST = 200
"""Bytes of a folder's name; most file systems take 255, and a half-made one has a longer name."""


def check_folder(out: Path) -> None:
    """Refuse a folder that no result can be written into; nothing is made or changed.

    Raises
    ------
    WideberthError : a symbolic link, a file, a name that is too long, a folder with a damaged
        manifest, or one that holds files and no manifest.
    """
    try:
        _check_folder(out)
    except (OSError, ValueError) as error:
        if isinstance(error, WideberthError):
            raise
        raise _unwritable(out, error) from None


def _unwritable(out: Path, error: Exception) -> WideberthError:
    reason = getattr(error, "strerror", None) or error
    return WideberthError(
        f"the result cannot be written to {out} ({reason}); give another folder with --out"
    )


def _check_folder(out: Path) -> None:
    if len(os.fsencode(out.name)) > _LONGEST or "\0" in str(out):
        raise ValueError(f"wanted a name of at most {_LONGEST} bytes, none of them zero")
    if out.is_symlink():
        raise WideberthError(
            f"{out} is a symbolic link; give the folder that it leads to, or another one, "
            "with --out"
        )
    if not out.exists():
        above = next(parent for parent in out.absolute().parents if parent.exists())
        if not above.is_dir():
            raise NotADirectoryError(20, f"{above} is no folder")
        if not os.access(above, os.W_OK | os.X_OK):
            raise PermissionError(13, f"{above} may not be written")
        return
    if not out.is_dir():
        raise WideberthError(
            f"{out} is a file and holds no result; give another folder with --out"
        )
    if listed_files(out) is not None or not any(out.iterdir()):
        return
    if (out / "config.yaml").exists() and (out / "provenance.json").exists():
        raise WideberthError(
            f"{out} has no {MANIFEST}, so it is not known which files an older version wrote "
            "there, and none is removed; delete the folder by hand, or give another one with --out"
        )
    raise WideberthError(f"{out} exists and holds no result; give another folder with --out")


def prepare(
    out: Path, config: Mapping[str, Any], origin: Mapping[str, Any], fresh: bool = False
) -> None:
    """Make the folder with manifest, provenance and config in it, or check those that it holds.

    With ``fresh`` `remove_result` removes the files of an earlier result first, and no others.
    """
    check_folder(out)
    try:
        if not out.exists():
            _make(out, config, origin)
        elif listed_files(out) is None:
            (out / SHARDS).mkdir()  # fails if another run was quicker
            _fill(out, config, origin)
        elif fresh:
            owned_files(out)  # refuses links before anything changes
            (out / SHARDS).mkdir(exist_ok=True)
            with locked(out):
                kept = remove_result(out)
                if kept:
                    names = ", ".join(path.name for path in kept)
                    say(f"kept in {out}, since no run wrote it: {names}")
                _fill(out, config, origin)
        else:
            _check_same(out, config, origin["source"])
    except FileExistsError:
        raise _taken(out) from None
    except OSError as error:
        raise _unwritable(out, error) from None


def _make(out: Path, config: Mapping[str, Any], origin: Mapping[str, Any]) -> None:
    """Make a new folder, which appears with all its files or not at all."""
    out.parent.mkdir(parents=True, exist_ok=True)
    begun = Path(tempfile.mkdtemp(".part", f".{out.name}.", out.parent))
    try:
        begun.chmod(0o755)
        (begun / SHARDS).mkdir()
        _fill(begun, config, origin)
    except BaseException:  # a full disk
        shutil.rmtree(begun)
        raise
    try:
        os.rename(begun, out)
    except OSError:
        shutil.rmtree(begun)
        raise _taken(out) from None


def _taken(out: Path) -> WideberthError:
    return WideberthError(
        f"{out} was begun by another run at the same moment; let that one finish, or give "
        "another folder with --out"
    )


def _fill(out: Path, config: Mapping[str, Any], origin: Mapping[str, Any]) -> None:
    """Write what a run begins with: the manifest first, the config last."""
    for name in (MANIFEST, *_FIRST_FILES):
        if os.path.lexists(out / name):
            raise WideberthError(
                f"{out / name} is no file of ours; give another folder with --out"
            )
    write_manifest(out, _FIRST_FILES)
    write_json(out / "provenance.json", "provenance", 1, origin)
    write_config(out, config)


def write_config(out: Path, config: Mapping[str, Any]) -> None:
    """Write config.yaml, and read it back at once, so that the result can be opened again.

    Raises
    ------
    WideberthError : what the file holds is not the experiment that is about to run.
    """
    path, text = out / "config.yaml", dump(dict(config))
    write_text(path, text)
    try:
        found = read_config(path, stored=True)
        named = {key: value for key, value in found.items() if key != "plugins"}
        again = {**describe(build("experiments", named)), "plugins": found["plugins"]}
    except (WideberthError, KeyError) as error:
        raise WideberthError(f"the result could not be opened again: {error}") from error
    if dump(again) != text:
        keys = ", ".join(differing_keys(again, config)) or "plugins"
        raise WideberthError(
            f"the result could not be opened again: its config builds another experiment (it "
            f"differs in {keys}); constructors must keep their arguments as they are given"
        )


def _check_same(out: Path, config: Mapping[str, Any], source: str) -> None:
    cure = CURE
    claim_files(out, ())
    for name in _FIRST_FILES:
        if not (out / name).is_file():
            raise WideberthError(f"{out} holds a result without its {name}; {cure}")
    try:
        found = read_config(out / "config.yaml", stored=True)
    except WideberthError as error:
        raise WideberthError(f"{error}; {cure}") from None
    differing = differing_keys(found, config)
    if differing:
        raise WideberthError(
            f"{out} holds the result of another config (it differs in {', '.join(differing)}); "
            f"{cure}"
        )
    check_source(out, source)
    if not (out / "table.csv").exists():
        (out / SHARDS).mkdir(exist_ok=True)


CURE = "give another folder with --out, or throw the old result away with --fresh"
"""What to do where a folder holds another result; it ends such messages."""


def differing_keys(found: Mapping[str, Any], config: Mapping[str, Any]) -> list[str]:
    """Return the keys in which a stored config differs from another one, sorted."""
    keys = {*found, *config} - {"plugins"}  # their names stand in the config, their code in source
    return sorted(str(key) for key in keys if found.get(key) != config.get(key))


def check_source(out: Path, source: str) -> None:
    """Refuse a result that other source code or data measured.

    Raises
    ------
    WideberthError : it did, or the provenance cannot be read.
    """
    try:
        stored = read_json(out / "provenance.json", "provenance", 1)
    except WideberthError as error:
        raise WideberthError(f"{error}; {CURE}") from None
    if stored.get("source") != source:
        raise WideberthError(f"{out} was measured by other source code or data; {CURE}")


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Hold the folder for this run; the system lets go of it when the process ends in any way.

    Raises
    ------
    WideberthError : another run is at work there.
    """
    if sys.platform == "win32" or not (out / "shards").is_dir():
        yield
        return
    import fcntl

    handle = os.open(out / "shards", os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise WideberthError(
                f"another run is at work in {out}; let it finish, stop it, or give another "
                "folder with --out"
            ) from None
        except OSError:
            pass  # a file system without locks: what both write is the same
        yield
    finally:
        os.close(handle)


MANIFEST = "manifest.json"
KIND = "result"
VERSION = 1
SHARDS = "shards"

_SHARD = re.compile(r"[0-9a-f]{24}(\.times)?\.json")
_HALF = re.compile(r"\.(?P<name>.+)\.[a-z0-9_]{8}\.part")
"""As `wideberth.framework.plugins.io.write_bytes` names a file that is not complete."""


def listed_files(folder: Path) -> frozenset[str] | None:
    """Return the names in a folder's manifest, relative to the folder; None without a manifest.

    Raises
    ------
    WideberthError : the manifest is damaged, of another kind, or names a place elsewhere.
    """
    path = folder / MANIFEST
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


def write_manifest(folder: Path, names: Iterable[str]) -> None:
    """Write the manifest of a new result; it names itself too."""
    write_json(folder / MANIFEST, KIND, VERSION, {"files": sorted({MANIFEST, *names})})


def claim_files(folder: Path, names: Iterable[str]) -> None:
    """Name files that are about to be written, in a manifest where there is one.

    Raises
    ------
    WideberthError : a file of this name is there already and is not listed, or its place is a
        symbolic link.
    """
    known = listed_files(folder)
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
        write_manifest(folder, known | names)


def half_written(folder: Path) -> Iterator[Path]:
    """Yield what a run that was killed left incomplete."""
    yield from (path for path in owned_files(folder) if _HALF.fullmatch(path.name))


def shard_files(folder: Path) -> Iterator[Path]:
    """Yield the files of finished tasks, and those of them that are half-written."""
    yield from _in_shards(folder / SHARDS)


def remove_result(folder: Path) -> list[Path]:
    """Remove the files of a result, the manifest last, and folders that are empty then.

    The config goes first: what is left of an interrupted removal is no result. ``shards/`` stays,
    which holds the lock.

    Returns
    -------
    What is still there, because the manifest does not name it.

    Raises
    ------
    WideberthError : as `owned_files`; nothing is removed then.
    """
    found = owned_files(folder)
    first, last = folder / "config.yaml", folder / MANIFEST
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


def owned_files(folder: Path) -> list[Path]:
    """Return the files in a folder that the package wrote.

    Raises
    ------
    WideberthError : no manifest, or a symbolic link where a file of the result should be.
    """
    names = listed_files(folder)
    if names is None:
        raise WideberthError(f"{folder} holds no {MANIFEST}; nothing in it is removed")
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
