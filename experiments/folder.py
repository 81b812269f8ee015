"""The folder of a result: made whole, checked before it is used again, one run at a time."""

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from wideberth.framework.errors import WideberthError
from wideberth.framework.io import read_json, write_json, write_text
from wideberth.framework.yamlfile import dump, read_config


def prepare(
    out: Path, config: Mapping[str, Any], origin: Mapping[str, Any], fresh: bool = False
) -> None:
    """Make the folder with config and provenance in it, or check those that stand there."""
    try:
        if fresh and (out / "config.yaml").exists():
            with claimed(out):
                shutil.rmtree(out)
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            _check_same(out, config, origin["source"])
            return
        out.parent.mkdir(parents=True, exist_ok=True)
        begun = Path(tempfile.mkdtemp(".part", f".{out.name}.", out.parent))
    except OSError as error:
        raise WideberthError(
            f"the result cannot be written to {out} ({error.strerror or error}); "
            "give another folder with --out"
        ) from None
    try:
        begun.chmod(0o755)
        (begun / "shards").mkdir()
        write_json(begun / "provenance.json", "provenance", 1, origin)
        write_text(begun / "config.yaml", dump(dict(config)))
    except BaseException:  # a full disk
        shutil.rmtree(begun)
        raise
    try:
        os.replace(begun, out)  # the folder is there with both files or not at all
    except OSError:
        shutil.rmtree(begun)
        raise WideberthError(
            f"{out} was begun by another run at the same moment; let that one finish, or give "
            "another folder with --out"
        ) from None


def _check_same(out: Path, config: Mapping[str, Any], source: str) -> None:
    cure = "give another folder with --out, or throw the old result away with --fresh"
    if not (out / "config.yaml").is_file():
        raise WideberthError(f"{out} exists and holds no result; give another folder with --out")
    try:
        found = read_config(out / "config.yaml")
        stored = read_json(out / "provenance.json", "provenance", 1)
    except WideberthError as error:
        raise WideberthError(f"{error}; {cure}") from None
    if found != config:
        differing = sorted(key for key in {*found, *config} if found.get(key) != config.get(key))
        raise WideberthError(
            f"{out} holds the result of another config (it differs in {', '.join(differing)}); "
            f"{cure}"
        )
    if stored.get("source") != source:
        raise WideberthError(f"{out} was measured by other source code or data; {cure}")
    if not (out / "table.csv").exists():
        (out / "shards").mkdir(exist_ok=True)


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


def sweep_out(out: Path) -> None:
    """Remove what a run that was killed had half-written. Nobody else may be at work there."""
    for path in out.rglob(".*.part"):
        path.unlink(missing_ok=True)
