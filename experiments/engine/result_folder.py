"""The folder of a result: begun, checked before it is used again, one run at a time.

A folder is written into if it is new or empty, or if its provenance.json is one of ours and its
config.yaml that of the same result, begun before. What belongs to the runs is known from the
folder itself: `NAMES`, the folders of tasks, the files that these name, and the figures that
``tasks/figures.json`` names. Nothing else is ever removed, and no other figure or file of a task
is overwritten.
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
from .tasks import TASKS, flush, read_task, seal, task_folders

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
    out: Path,
    config: Mapping[str, Any],
    origin: Mapping[str, Any],
    growing: Collection[str] = (),
    fresh: bool = False,
) -> bool:
    """Begin a result in a folder that is `locked`, or check the one that it holds.

    With ``fresh`` `remove_result` removes the files of an earlier result first. A result of the
    same config but for smaller values of what may grow becomes an unfinished one of this config.

    Returns
    -------
    Whether an earlier result is extended.
    """
    check_folder(out)
    if fresh:
        if kept := remove_result(out):
            say(f"kept in {out}, since no run wrote it: {', '.join(path.name for path in kept)}")
    if not inside(out, CONFIG).exists() and not any(task_folders(inside(out, TASKS))):
        write_json(inside(out, PROVENANCE), "provenance", 1, origin)
        write_text(inside(out, CONFIG), dump(dict(config)))
        return False
    extended = is_smaller(out, config, str(origin["source"]), growing)
    if extended:
        remove_files(out, _derived(out))  # first the table that says that the run is complete
        write_text(inside(out, CONFIG), dump(dict(config)))
    return extended


def is_smaller(
    out: Path, config: Mapping[str, Any], source: str, growing: Collection[str] = ()
) -> bool:
    """Whether a folder's result is of the same config, but for smaller values of ``growing``.

    Raises
    ------
    WideberthError : it is that of another config, source code or data, or cannot be read.
    """
    if not inside(out, CONFIG).is_file():
        raise WideberthError(f"{out} holds a result without its {CONFIG}; {CURE}")
    origin = inside(out, PROVENANCE)
    try:
        found = read_config(inside(out, CONFIG))
        stored = read_json(origin, "provenance", 1)
    except WideberthError as error:
        raise WideberthError(f"{error}; {CURE}") from None
    names = differing_keys(found, config)
    numbers = [(found.get(name), config.get(name)) for name in names]
    grown = all(type(old) is int and type(new) is int and old < new for old, new in numbers)
    if not grown or not set(names) <= set(growing):
        raise WideberthError(
            f"{out} holds the result of another config (it differs in {', '.join(names)}); {CURE}"
        )
    if stored.get("source") != source:
        raise WideberthError(f"{out} was measured by other source code or data; {CURE}")
    return bool(names)


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


def claim_figures(out: Path, names: Iterable[str]) -> None:
    """Note the names of figures that are about to be written, relative to the folder.

    Raises
    ------
    WideberthError : a file of this name is there already and was not drawn, or its place is a
        symbolic link.
    """
    names, drawn = set(names), set(_drawn(out))
    for name in sorted(names):
        refuse_overwriting(inside(out, name), name in drawn)
    inside(out, TASKS).mkdir(exist_ok=True)
    if not names <= drawn:
        write_json(inside(out, FIGURES), "figures", 1, {"files": sorted(names | drawn)})


def refuse_overwriting(path: Path, ours: bool = False) -> None:
    """Refuse to write over a file that no run wrote."""
    if not ours and os.path.lexists(path):
        raise WideberthError(
            f"{path} was not written by this package and is not overwritten; move it away "
            "and run the same command again"
        )


def _drawn(out: Path) -> list[str]:
    """Return the names of the figures that were drawn."""
    place = inside(out, FIGURES)
    if not place.is_file():
        return []
    names = read_json(place, "figures", 1).get("files")
    if not isinstance(names, list) or not all(map(is_inside, names)):
        raise WideberthError(f"{place} is damaged: 'files' must be names in the folder")
    return names


def _derived(out: Path) -> list[Path]:
    """Return where tables and figures are, the table that says that the run is complete first."""
    return [inside(out, name) for name in (*TABLES, *_drawn(out), FIGURES)]


def own_files(out: Path) -> list[Path]:
    """Return the files in a folder that runs wrote, the config first and the provenance last.

    Raises
    ------
    WideberthError : a symbolic link where a file of the result should be.
    """
    tasks = [*task_folders(inside(out, TASKS))]
    moved = [path for folder in tasks for path in moved_files(out, folder)]
    left = [path for folder in tasks for path in files_inside(out, folder.relative_to(out))]
    places = [inside(out, CONFIG), *_derived(out), *moved, *left]
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
    places = [file_place(out, folder.name, name) for name in (task.files if task else ())]
    return [path for path in places if folder not in path.parents]


def file_place(out: Path, key: str, name: str) -> Path:
    """Return where a file of a task is: in the task's folder, or at its place in the result."""
    path = inside(out, f"{TASKS}/{key}/files/{name}")
    return path if path.exists() else inside(out, f"files/{name}")


def remove_task(out: Path, folder: Path) -> None:
    """Remove the folder of a task, finished or not, and its files."""
    remove_files(out, moved_files(out, folder))
    shutil.rmtree(inside(out, folder.relative_to(out)))


def damage(out: Path, key: str) -> str:
    """Return why a task that is finished cannot be used, or nothing.

    Raises
    ------
    WideberthError : a symbolic link where the task or one of its files should be.
    """
    files_inside(out, f"{TASKS}/{key}")
    try:
        task = read_task(inside(out, TASKS), key)
    except WideberthError as error:
        return str(error)
    for name, stored in task.files.items() if task else ():
        path = file_place(out, key, name)
        if not path.is_file():
            return f"{path} is missing"
        if not stored:
            return f"version 1 stored no hash of {path}"
        if path.stat().st_size != stored.get("size") or seal(path.read_bytes()) != stored:
            return f"{path} is not what the task wrote"
    return ""


def move_file(out: Path, key: str, name: str) -> None:
    """Move a file of a finished task to its place in the result, if it is not there yet.

    Raises
    ------
    WideberthError : another file is there, or the file cannot be written.
    """
    source, target = inside(out, f"{TASKS}/{key}/files/{name}"), inside(out, f"files/{name}")
    if not source.exists():
        return
    refuse_overwriting(target)
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
