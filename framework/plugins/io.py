"""Files: written whole or not at all; read with a bound on their size.

The same content gives the same bytes, and a file that cannot be used gives one error message.
"""

import io
import json
import os
import stat
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..values.errors import WideberthError, short

if TYPE_CHECKING:
    import numpy as np

MOST_BYTES = 64 * 2**20
"""Bytes of a file that is read whole into memory."""
DEEPEST = 60
"""Lists and mappings inside each other in a JSON file."""
LARGEST_ARRAYS = 2**30
"""Bytes of the arrays in one archive."""


def read_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return the content of a regular file of at most ``most`` bytes.

    Raises
    ------
    WideberthError : it cannot be read, is larger, or is a pipe or a device, which may never end.
    """
    path = Path(path)
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode) and not stat.S_ISDIR(status.st_mode):
            raise WideberthError(f"{path} cannot be read: it is a pipe or a device; wanted a file")
        if status.st_size > most:
            raise WideberthError(
                f"{path} cannot be read: it has {status.st_size} bytes; wanted at most {most}"
            )
        with path.open("rb") as file:
            return file.read(most)
    except (OSError, ValueError) as error:
        if isinstance(error, WideberthError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise WideberthError(f"{path} cannot be read: {reason}") from None


def read_text(path: Path, wanted: str, most: int = MOST_BYTES) -> str:
    """Return the text of a UTF-8 file; ``wanted`` names its kind in error messages.

    Raises
    ------
    WideberthError : as `read_bytes`, or no UTF-8 text.
    """
    try:
        return read_bytes(path, most).decode("utf-8")
    except UnicodeDecodeError:
        raise WideberthError(f"{path} is not text; wanted {wanted}") from None


def expanded(path: str | Path) -> Path:
    """Return a path with a leading ``~`` replaced by the home folder.

    Raises
    ------
    WideberthError : the user is unknown or has no home folder.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError as error:
        raise WideberthError(f"{path} cannot be used: {error} Give the whole path") from None


def parse_json(text: str, place: str) -> Any:
    """Return the value of a JSON text; ``place`` begins the error message.

    Raises
    ------
    WideberthError : no JSON, or lists and mappings nested more than `DEEPEST` deep.
    """
    deep = f"{place} cannot be read as JSON: it is nested more than {DEEPEST} deep"
    try:
        value = json.loads(text)
    except RecursionError:
        raise WideberthError(deep) from None
    except ValueError as error:
        raise WideberthError(f"{place} cannot be read as JSON: {error}") from None
    level, depth = [value], 0
    while level := [one for one in level if isinstance(one, dict | list)]:
        if (depth := depth + 1) > DEEPEST:
            raise WideberthError(deep)
        level = [
            inner for one in level for inner in (one.values() if isinstance(one, dict) else one)
        ]
    return value


def read_arrays(data: bytes, place: str) -> dict[str, "np.ndarray[Any, Any]"]:
    """Return the arrays of an npz archive by name; ``place`` begins the error message.

    Raises
    ------
    WideberthError : no archive, a damaged one, one with Python objects, or one of arrays larger
        than `LARGEST_ARRAYS` together.
    """
    import numpy as np

    if not data.startswith(b"PK"):
        raise WideberthError(f"{place} is no npz archive")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(member.file_size for member in archive.infolist())
        if size <= LARGEST_ARRAYS:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                return {name: arrays[name] for name in arrays.files}
    except Exception as error:  # a damaged archive fails in any way
        raise WideberthError(
            f"{place} is a damaged npz archive ({type(error).__name__}: {error})"
        ) from None
    raise WideberthError(
        f"{place} holds arrays of {size} bytes; wanted at most {LARGEST_ARRAYS} together"
    )


def write_bytes(path: Path, data: bytes) -> Path:
    """Write ``data`` so that readers see the old file or the new one, never a part.

    A temporary file in the same folder is flushed to the disk and renamed.

    Raises
    ------
    WideberthError : the folder does not exist or cannot be written.
    """
    path = Path(path)
    try:
        handle, temporary = tempfile.mkstemp(
            prefix=f".{path.name}.", suffix=".part", dir=path.parent
        )
    except OSError as error:
        raise WideberthError(f"{path} cannot be written: {error.strerror or error}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException as error:
        Path(temporary).unlink(missing_ok=True)
        if isinstance(error, OSError):
            reason = error.strerror or error
            raise WideberthError(f"{path} cannot be written: {reason}") from None
        raise
    return path


def check_target(path: Path, mark: str) -> None:
    """Refuse a path that cannot be written, or that holds a file of another program.

    Parameters
    ----------
    path : of the file that is to be written later.
    mark : text that stands in the first kilobyte of every file that may be replaced.

    Raises
    ------
    WideberthError : the folder does not exist or may not be written, or the place holds a folder,
        a symbolic link, or a file without the mark.
    """
    cure = "give another name with --out"
    try:
        if path.is_symlink():
            raise WideberthError(f"{path} is a symbolic link, which is not replaced; {cure}")
        if path.is_dir():
            raise WideberthError(f"{path} is a folder; wanted a file: {cure}")
        if not path.absolute().parent.is_dir():
            raise WideberthError(f"{path} cannot be written: its folder does not exist")
        if not os.access(path.absolute().parent, os.W_OK):
            raise WideberthError(f"{path} cannot be written: its folder is read-only; {cure}")
        if not path.exists():
            return
        with path.open("rb") as file:
            ours = mark.encode() in file.read(1024)
    except OSError as error:
        raise WideberthError(f"{path} cannot be written: {error.strerror or error}") from None
    if not ours:
        raise WideberthError(f"{path} is another file, which is not replaced; {cure}")


def write_text(path: Path, text: str) -> Path:
    """Write ``text`` as UTF-8 with line feeds; see `write_bytes`."""
    return write_bytes(path, text.encode("utf-8"))


def stamped(kind: str, version: int, content: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``content`` with a header of format and version."""
    return {"format": f"wideberth/{kind}", "version": version, **content}


def write_json(path: Path, kind: str, version: int, content: Mapping[str, Any]) -> Path:
    """Write a stamped JSON file; floats survive exactly."""
    return write_text(path, json.dumps(stamped(kind, version, content), indent=1) + "\n")


def read_json(path: Path, kind: str, version: int) -> dict[str, Any]:
    """Read a stamped JSON file.

    Raises
    ------
    WideberthError : unreadable, not JSON, another format, or a version newer than this
        package knows.
    """
    return unstamped(
        parse_json(read_text(Path(path), "a JSON file"), str(path)), kind, version, str(path)
    )


def unstamped(content: Any, kind: str, version: int, place: str) -> dict[str, Any]:
    """Check the header that `stamped` wrote and return the content without it."""
    found = content.get("format") if isinstance(content, dict) else None
    if found != f"wideberth/{kind}":
        raise WideberthError(f"{place} has format {short(found)}; wanted 'wideberth/{kind}'")
    stored = content.get("version")
    if not isinstance(stored, int) or not 1 <= stored <= version:
        raise WideberthError(
            f"{place} has version {short(stored)}; this package reads 1 to {version}: "
            "use the release that wrote it, or a newer one"
        )
    return {key: value for key, value in content.items() if key not in ("format", "version")}
