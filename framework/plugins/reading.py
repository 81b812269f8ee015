"""Reading files of others: bounded in size and depth, and one message for what cannot be used."""

import io
import json
import stat
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..values.errors import WideberthError

if TYPE_CHECKING:
    import numpy as np

LARGEST = 64 * 2**20
"""Bytes of a file that is read whole into memory."""
LARGEST_ARRAYS = 2**30
"""Bytes of the arrays in one archive."""
DEEPEST = 60
"""Lists and mappings inside each other in a JSON file."""


def read_bytes(path: Path, most: int = LARGEST) -> bytes:
    """Return the content of a regular file of at most ``most`` bytes.

    Raises
    ------
    WideberthError : it cannot be read, is larger, or is a pipe or a device, which may never end.
    """
    path = Path(path)
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise WideberthError(f"{path} cannot be read: it is a pipe or a device; wanted a file")
        if found.st_size > most:
            raise WideberthError(
                f"{path} cannot be read: it has {found.st_size} bytes; wanted at most {most}"
            )
        with path.open("rb") as file:
            return file.read(most)
    except (OSError, ValueError) as error:
        if isinstance(error, WideberthError):
            raise
        reason = getattr(error, "strerror", None) or error
        raise WideberthError(f"{path} cannot be read: {reason}") from None


def read_text(path: Path, wanted: str, most: int = LARGEST) -> str:
    """Return the text of a UTF-8 file, of which a message says what was ``wanted``.

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
    WideberthError : no JSON, a whole number of thousands of digits, or lists and mappings nested
        more than `DEEPEST` deep.
    """
    deep = f"{place} cannot be read as JSON: it is nested more than {DEEPEST} deep"
    try:
        value = json.loads(text)
    except RecursionError:
        raise WideberthError(deep) from None
    except ValueError as error:
        raise WideberthError(f"{place} cannot be read as JSON: {error}") from None
    level = [value]
    for _ in range(DEEPEST + 1):
        level = [
            inner
            for outer in level
            if isinstance(outer, dict | list)
            for inner in (outer.values() if isinstance(outer, dict) else outer)
            if isinstance(inner, dict | list)
        ]
        if not level:
            return value
    raise WideberthError(deep)


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
