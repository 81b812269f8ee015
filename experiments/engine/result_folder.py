"""The folder of a result: begun, checked before it is used again, one run at a time.

A folder is written into if it is new or empty, or if its provenance.json is one of ours and its
config.yaml that of the same result, begun before. What belongs to the runs is known from the
folder itself: `NAMES`, the folders of tasks, the files that these name, and the figures that
``tasks/figures.json`` names. Nothing else is ever removed, and no other file is overwritten by one
of a task.
"""

import os
import re
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from ...framework.plugins.config import build, describe
from ...framework.plugins.io import read_json, write_json, write_text
from ...framework.plugins.yamlfile import dump, parse, read_config
from ...framework.values.errors import WideberthError
from .file_lock import file_lock
from .inside import files_inside, inside, is_inside
from .progress import say
from .tasks import TASKS, flush, read_task, task_folders

CONFIG, PROVENANCE = "config.yaml", "provenance.json"
TABLES = ("table.csv", "times.csv", "summary.csv", "summary.md", "table.parquet")
"""Files that are made of the finished tasks; the first one says that the run is complete."""
FIGURES = f"{TASKS}/figures.json"
"""Names the figures that were drawn."""
NAMES = (CONFIG, *TABLES, FIGURES, PROVENANCE)
"""Files of every result."""
LOCK = ".lock"
CURE = (
    "give another folder with --out, or throw the old result away with --fresh; in Python, "
    "folder=... or resume=False"
)
"""What to do where a folder holds another result; it ends such messages."""

_LONGEST = 200
"""Bytes of a folder's name; most file systems take 255, and names beside it are longer."""
_HALF = re.compile(r"\.(?P<name>.+)\.[a-z0-9_]{8}\.part")
"""As `wideberth.framework.plugins.io.write_bytes` names a file that is not complete."""


def check_folder(out: Path) -> None:
    """Refuse a folder that no result can be written into; nothing is made or changed.

    Raises
    ------
    WideberthError : a symbolic link, a file, a name that is too long, a folder that may not be
        written, or one that holds files and no result.
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
    elif not out.is_dir():
        raise WideberthError(
            f"{out} is a file and holds no result; give another folder with --out"
        )
    elif not _is_result(out) and not _is_empty(out):
        raise WideberthError(f"{out} exists and holds no result; give another folder with --out")


def _is_result(out: Path) -> bool:
    origin = inside(out, PROVENANCE)
    try:
        read_json(origin, "provenance", 1)
    except WideberthError:
        return False
    return True


def _is_empty(out: Path) -> bool:
    """Whether a folder holds nothing but what a run makes before its first file."""
    tasks = inside(out, TASKS)
    ours = {tasks, tasks / LOCK, *half_written(out)}
    return all(path in ours for path in (*out.iterdir(), *tasks.glob("*")))


@contextmanager
def locked(out: Path) -> Iterator[None]:
    """Hold the folder, which is made if missing; the system lets go of it when the process ends.

    Raises
    ------
    WideberthError : another run is at work there, or it cannot be written.
    """
    with ExitStack() as held:
        try:
            lock = inside(out, f"{TASKS}/{LOCK}")
            lock.parent.mkdir(parents=True, exist_ok=True)
            held.enter_context(file_lock(lock))
        except BlockingIOError:
            raise WideberthError(
                f"another run is at work in {out}; let it finish, stop it, or give another "
                "folder with --out"
            ) from None
        except OSError as error:
            raise _unwritable(out, error) from None
        yield


def prepare(
    out: Path, config: Mapping[str, Any], origin: Mapping[str, Any], fresh: bool = False
) -> None:
    """Begin a result in a folder that is `locked`, or check the one that it holds.

    With ``fresh`` `remove_result` removes the files of an earlier result first.
    """
    check_folder(out)
    if fresh:
        if kept := remove_result(out):
            say(f"kept in {out}, since no run wrote it: {', '.join(path.name for path in kept)}")
    if not inside(out, CONFIG).exists() and not any(task_folders(inside(out, TASKS))):
        write_json(inside(out, PROVENANCE), "provenance", 1, origin)
        write_text(inside(out, CONFIG), dump(dict(config)))
    else:
        check_same(out, config, origin)


def check_same(out: Path, config: Mapping[str, Any], origin: Mapping[str, Any]) -> None:
    """Refuse a folder whose result is that of another config, source code or data.

    Raises
    ------
    WideberthError : it is, or it cannot be read.
    """
    if not inside(out, CONFIG).is_file():
        raise WideberthError(f"{out} holds a result without its {CONFIG}; {CURE}")
    place = inside(out, PROVENANCE)
    try:
        found = read_config(inside(out, CONFIG))
        stored = read_json(place, "provenance", 1)
    except WideberthError as error:
        raise WideberthError(f"{error}; {CURE}") from None
    if names := differing_keys(found, config):
        raise WideberthError(
            f"{out} holds the result of another config (it differs in {', '.join(names)}); {CURE}"
        )
    if stored.get("source") != origin["source"]:
        raise WideberthError(f"{out} was measured by other source code or data; {CURE}")


def differing_keys(found: Mapping[str, Any], config: Mapping[str, Any]) -> list[str]:
    """Return the keys in which a stored config differs from another one, sorted."""
    keys = {*found, *config} - {"plugins"}  # their names stand in the config, their code in source
    return sorted(str(key) for key in keys if found.get(key) != config.get(key))


def check_config(config: Mapping[str, Any]) -> None:
    """Refuse a config that would not build the same experiment when its result is opened.

    Raises
    ------
    WideberthError : what its text builds is not the experiment that is about to run.
    """
    text = dump(dict(config))
    try:
        found = parse(text, CONFIG)
        plugins = found.pop("plugins")
        again = {**describe(build("experiments", found)), "plugins": plugins}
    except (WideberthError, KeyError) as error:
        raise WideberthError(f"the result could not be opened again: {error}") from error
    if dump(again) != text:
        keys = ", ".join(differing_keys(again, config)) or "plugins"
        raise WideberthError(
            f"the result could not be opened again: its config builds another experiment (it "
            f"differs in {keys}); constructors must keep their arguments as they are given"
        )


def note_figures(out: Path, names: Iterable[str]) -> None:
    """Note the names of figures that are about to be written, relative to the folder."""
    drawn = _drawn(out)
    inside(out, TASKS).mkdir(exist_ok=True)
    write_json(inside(out, FIGURES), "figures", 1, {"files": sorted({*names, *drawn})})


def _drawn(out: Path) -> list[str]:
    """Return the names of the figures that were drawn."""
    place = inside(out, FIGURES)
    if not place.is_file():
        return []
    names = read_json(place, "figures", 1).get("files")
    if not isinstance(names, list) or not all(map(is_inside, names)):
        raise WideberthError(f"{place} is damaged: 'files' must be names in the folder")
    return names


def own_files(out: Path) -> list[Path]:
    """Return the files in a folder that runs wrote, the config first and the provenance last.

    Raises
    ------
    WideberthError : a symbolic link where a file of the result should be.
    """
    tasks = [*task_folders(inside(out, TASKS))]
    moved = [path for folder in tasks for path in moved_files(out, folder)]
    left = [path for folder in tasks for path in files_inside(out, folder.relative_to(out))]
    made = [inside(out, name) for name in (*TABLES, *_drawn(out), FIGURES)]
    places = [inside(out, CONFIG), *made, *moved, *left]
    return [*places, *half_written(out, places), inside(out, PROVENANCE)]


def half_written(out: Path, places: Collection[Path] = ()) -> list[Path]:
    """Return what killed runs left incomplete of some files and of those of every result."""
    places = {*places, *(inside(out, name) for name in NAMES)}
    return [
        path
        for parent in sorted({path.parent for path in places if path.parent.is_dir()})
        for path in parent.iterdir()
        if (half := _HALF.fullmatch(path.name)) and parent / half["name"] in places
        if path.is_file() and not path.is_symlink()
    ]


def moved_files(out: Path, folder: Path) -> list[Path]:
    """Return the files of a task that were moved from its folder to their place in the result."""
    try:
        task = read_task(folder.parent, folder.name)
    except WideberthError:  # a damaged one does not say which files it had
        return []
    return [
        inside(out, f"files/{name}")
        for name in (task.files if task else ())
        if not inside(out, f"{TASKS}/{folder.name}/files/{name}").exists()
    ]


def remove_task(out: Path, folder: Path) -> None:
    """Remove the folder of a task, finished or not, and its files."""
    remove_files(out, moved_files(out, folder))
    shutil.rmtree(inside(out, folder.relative_to(out)))


def move_file(out: Path, key: str, name: str) -> None:
    """Move a file of a finished task to its place in the result, if it is not there yet.

    Raises
    ------
    WideberthError : another file is there, or the file cannot be written.
    """
    source, target = inside(out, f"{TASKS}/{key}/files/{name}"), inside(out, f"files/{name}")
    if not source.exists():
        return
    if os.path.lexists(target):
        raise WideberthError(
            f"{target} was not written by this package and is not overwritten; move it away "
            "and run the same command again"
        )
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        source.rename(target)
        flush(target.parent)
        _remove_empty(out, [source])
    except OSError as error:
        raise WideberthError(f"{target} cannot be written: {error.strerror or error}") from None


def remove_result(out: Path) -> list[Path]:
    """Remove the files of a result, and folders that are empty then.

    The config goes first: what is left of an interrupted removal is no result. The lock stays.

    Returns
    -------
    What is still there, since no run wrote it.
    """
    first, *found = own_files(out)
    first.unlink(missing_ok=True)
    for folder in [*task_folders(inside(out, TASKS))]:
        remove_task(out, folder)
    remove_files(out, found)
    others = [path for path in out.iterdir() if path.name != TASKS]
    return sorted([*others, *(path for path in (out / TASKS).iterdir() if path.name != LOCK)])


def remove_files(out: Path, paths: Sequence[Path]) -> None:
    """Remove files of a result, in this order, and the folders that are empty then."""
    for path in paths:
        inside(out, path.relative_to(out)).unlink(missing_ok=True)
    _remove_empty(out, paths)


def _remove_empty(out: Path, paths: Iterable[Path]) -> None:
    parents = {parent for path in paths for parent in path.relative_to(out).parents}
    for parent in sorted(parents - {Path(), Path(TASKS)}, reverse=True):
        if (out / parent).is_dir() and not any((out / parent).iterdir()):
            (out / parent).rmdir()
