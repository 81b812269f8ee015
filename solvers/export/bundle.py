"""The files of an export, and the folder that they are written into."""

import json
import os
import shutil
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ... import __version__
from ...framework.numerics.symbolic import ca
from ...framework.plugins.io import read_json, stamped
from ...framework.values.errors import WideberthError
from .example import data, example
from .header import constants, flat_source, header, stage_source
from .readme import readme
from .rendering import rendered
from .routines import c_code
from .subject import Subject

KIND = "export"
VERSION = 1
MANIFEST = "manifest.json"

_BUILT = ("example", "example.o", "wideberth.o", "stage_functions.o", "wideberth_nlp.o",
          "nlp_functions.o", "loop", "loop_cpp", "wideberth_solver.o", "problem.o", "riccati.o",
          "libwideberth.a", "libwideberth_planner.a",
          "libwideberth_planner.so", "wideberth_planner.o", "planner_tracks.o",
          "planner_forecast.o", "planner_motion.o", "planner_walls.o", "planner_scene.o",
          "planner_verify.o", "planner_ladder.o", "planner_end.o")  # fmt: skip
"""What ``make`` leaves in the folder of an export."""


def bundle(subject: Subject) -> dict[str, str]:
    """Return the files of an export by name; the same subject gives the same text.

    Raises
    ------
    WideberthError : a function that no C can be made of, or values that are not numbers.
    """
    files = {
        "README.md": readme(subject),
        "wideberth.h": header(subject),
        "wideberth.c": stage_source(subject),
        "stage_functions.c": c_code(subject.stage, "stage_functions.c"),
        "wideberth_nlp.c": flat_source(subject),
        "nlp_functions.c": c_code(subject.flat, "nlp_functions.c"),
        "example.c": example(subject),
        "example_data.h": data(subject),
        "Makefile": rendered("problem/Makefile"),
    }
    return {**files, MANIFEST: _manifest(subject, [*files])}


def _manifest(subject: Subject, files: list[str]) -> str:
    content = {
        "wideberth": __version__,
        "casadi": ca.CasadiMeta.version(),
        "source": subject.source,
        "key": subject.problem.key,
        "sizes": {name: value for name, value, _ in constants(subject)},
        "stage_functions": [routine.name for routine in subject.stage],
        "nlp_functions": [routine.name for routine in subject.flat],
        "files": files,
        "planner": subject.config,
    }
    return json.dumps(stamped(KIND, VERSION, content), indent=1) + "\n"


def check_target(out: Path, *, force: bool) -> None:
    """Refuse a folder that cannot be made, or that holds something that is no export.

    Raises
    ------
    WideberthError : ``out`` exists (with ``force``: and is no export, or holds something that is
        not of one), or its parent does not.
    """
    if not out.absolute().parent.is_dir():
        raise WideberthError(f"{out} cannot be written: its folder does not exist")
    if out.is_symlink():
        raise WideberthError(f"{out} is a symbolic link; give the folder that it leads to")
    if not out.exists():
        return
    if not force:
        raise WideberthError(f"{out} exists; give another folder, or replace it with --force")
    known = _known(out)
    strange = [path.name for path in sorted(out.iterdir())
               if path.name not in known or path.is_symlink() or not path.is_file()]  # fmt: skip
    if strange:
        raise WideberthError(
            f"{out} holds {', '.join(strange)}, which no export wrote, and is not replaced; move "
            "that away or give another folder"
        )


def _known(out: Path) -> set[str]:
    """Names in the folder of an export that may be removed."""
    try:
        files = read_json(out / MANIFEST, KIND, VERSION).get("files")
    except WideberthError as error:
        raise WideberthError(f"{out} is no export and is not replaced: {error}") from None
    names = files if isinstance(files, list) else []
    return {MANIFEST, *_BUILT, *(name for name in names if isinstance(name, str))}


def write_folder(out: Path, files: Mapping[str, str], *, force: bool) -> None:
    """Write files into a new folder, which appears whole or not at all.

    Raises
    ------
    WideberthError : see `check_target`, or the disk.
    """
    check_target(out, force=force)
    out = out.absolute()
    try:
        made = Path(tempfile.mkdtemp(prefix=f".{out.name}.", suffix=".part", dir=out.parent))
    except OSError as error:
        raise WideberthError(f"{out} cannot be written: {error.strerror or error}") from None
    try:
        for name, content in files.items():
            (made / name).write_bytes(content.encode("utf-8"))
        made.chmod(0o755)
        _exchange(made, out)
    except OSError as error:
        raise WideberthError(f"{out} cannot be written: {error.strerror or error}") from None
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _exchange(made: Path, out: Path) -> None:
    """Put the new folder in the place of an older export; on failure the older one stays."""
    if not out.exists():
        os.rename(made, out)
        return
    known = _known(out)
    aside = made.with_suffix(".old")
    os.rename(out, aside)
    try:
        os.rename(made, out)
    except OSError:
        with suppress(OSError):
            os.rename(aside, out)
        raise
    with suppress(OSError):  # something that came since stays, in the folder aside
        for path in aside.iterdir():  # a manifest may name files of other folders
            if path.name in known:
                path.unlink()
        aside.rmdir()
