"""The folder of a result: made whole, checked before it is used again, one run at a time.

A folder is written into if it is new or empty, or if its manifest says that it holds the same
result, begun before; see `wideberth.experiments.engine.manifest`.
"""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...framework.plugins.io import read_json, write_json, write_text
from ...framework.plugins.yamlfile import dump, read_config
from ...framework.values.errors import WideberthError
from . import manifest
from .progress import say

_BEGUN = ("config.yaml", "provenance.json")
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
    if manifest.listed(out) is not None or not any(out.iterdir()):
        return
    if (out / "config.yaml").exists() and (out / "provenance.json").exists():
        raise WideberthError(
            f"{out} has no {manifest.NAME}, so it is not known which files an older version wrote "
            "there, and none is removed; delete the folder by hand, or give another one with --out"
        )
    raise WideberthError(f"{out} exists and holds no result; give another folder with --out")


def prepare(
    out: Path, config: Mapping[str, Any], origin: Mapping[str, Any], fresh: bool = False
) -> None:
    """Make the folder with manifest, provenance and config in it, or check those that it holds.

    With ``fresh`` the files of an earlier result are removed first, and no others: see
    `wideberth.experiments.engine.manifest.remove`.
    """
    check_folder(out)
    try:
        if not out.exists():
            _make(out, config, origin)
        elif manifest.listed(out) is None:
            (out / manifest.SHARDS).mkdir()  # fails if another run was quicker
            _fill(out, config, origin)
        elif fresh:
            manifest.owned(out)  # refuses links before anything changes
            (out / manifest.SHARDS).mkdir(exist_ok=True)
            with claimed(out):
                kept = manifest.remove(out)
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
        (begun / manifest.SHARDS).mkdir()
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
    for name in (manifest.NAME, *_BEGUN):
        if os.path.lexists(out / name):
            raise WideberthError(
                f"{out / name} is no file of ours; give another folder with --out"
            )
    manifest.begin(out, _BEGUN)
    write_json(out / "provenance.json", "provenance", 1, origin)
    write_text(out / "config.yaml", dump(dict(config)))


def _check_same(out: Path, config: Mapping[str, Any], source: str) -> None:
    cure = "give another folder with --out, or throw the old result away with --fresh"
    manifest.claim(out, ())
    for name in _BEGUN:
        if not (out / name).is_file():
            raise WideberthError(f"{out} holds a result without its {name}; {cure}")
    try:
        found = read_config(out / "config.yaml", stored=True)
        stored = read_json(out / "provenance.json", "provenance", 1)
    except WideberthError as error:
        raise WideberthError(f"{error}; {cure}") from None
    if found != config:
        differing = sorted(
            str(key) for key in {*found, *config} if found.get(key) != config.get(key)
        )
        raise WideberthError(
            f"{out} holds the result of another config (it differs in {', '.join(differing)}); "
            f"{cure}"
        )
    if stored.get("source") != source:
        raise WideberthError(f"{out} was measured by other source code or data; {cure}")
    if not (out / "table.csv").exists():
        (out / manifest.SHARDS).mkdir(exist_ok=True)


@contextmanager
def claimed(out: Path) -> Iterator[None]:
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
