"""Rows of numbers in text files, with errors that name file, line and cure."""

from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ..plugins.reading import read_bytes
from ..values.errors import WideberthError, short

Sample: TypeAlias = tuple[int, float, float, int]
"""(frame, x in m, y in m, line in the file)."""
Samples: TypeAlias = dict[str, list[Sample]]
"""Identity -> its samples, frames increasing."""

LARGEST = 200 * 2**20
"""Bytes of a recording."""
LONGEST_IDENTITY = 100
"""Characters."""
FARTHEST = 1e8
"""m; a coordinate beyond it is no position on the earth, in whatever frame."""

TRACK = ("frame", "id", "x", "y")
ROBOT = ("time", "x", "y", "theta")


def read_rows(path: Path, columns: tuple[str, ...]) -> Iterator[tuple[int, list[str]]]:
    """Yield (line number, words) of each row that is not a comment."""
    try:
        raw = read_bytes(path, LARGEST)
    except WideberthError as error:
        raise WideberthError(f"{error}; check the path") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise WideberthError(f"{path} is not a text file; wanted rows `{' '.join(columns)}`")
    empty = True
    for place, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].replace(",", " ").split()
        if not words:
            continue
        if len(words) != len(columns):
            raise WideberthError(
                f"{path}, line {place}: {len(words)} columns; wanted {len(columns)}: "
                f"`{' '.join(columns)}`"
            )
        empty = False
        yield place, words
    if empty:
        raise WideberthError(f"{path} holds no rows; wanted `{' '.join(columns)}` in each")


def number(word: str, name: str, path: str | Path, line: int) -> float:
    """Turn one word into a finite number."""
    try:
        value = float(word)
    except ValueError:
        raise WideberthError(
            f"{path}, line {line}: {name} is {short(word, 40)}; wanted a number (put # before "
            "a header)"
        ) from None
    if not np.isfinite(value):
        raise WideberthError(
            f"{path}, line {line}: {name} is {word[:40]}; leave a row out where nothing was seen"
        )
    if name in ("x", "y") and abs(value) > FARTHEST:
        raise WideberthError(
            f"{path}, line {line}: {name} is {value:g} m; wanted at most {FARTHEST:g}"
        )
    return value


def read_samples(path: Path) -> Samples:
    """Read identity -> rows of (frame, x, y, line), frames increasing."""
    samples: Samples = {}
    seen: dict[tuple[str, int], int] = {}
    for line, words in read_rows(path, TRACK):
        frame = number(words[0], "frame", path, line)
        if frame != round(frame):
            raise WideberthError(
                f"{path}, line {line}: frame is {words[0][:40]}; wanted a whole number (a robot "
                "log of `time x y theta` is read by read_robot_log)"
            )
        ident = _identity(words[1], path, line)
        x, y = (number(words[i], TRACK[i], path, line) for i in (2, 3))
        key = (ident, round(frame))
        if key in seen:
            raise WideberthError(
                f"{path}, line {line} repeats frame {key[1]} of id {ident} (line {seen[key]}); "
                "remove one of them"
            )
        seen[key] = line
        rows = samples.setdefault(ident, [])
        if rows and rows[-1][0] > key[1]:
            raise WideberthError(
                f"{path}, line {line}: frame {key[1]} of id {ident} comes after frame "
                f"{rows[-1][0]} (line {rows[-1][3]}); sort the file by frame"
            )
        rows.append((key[1], x, y, line))
    return samples


def _identity(word: str, path: Path, line: int) -> str:
    """Return an identity as text; 7.0 and 7 are the same."""
    try:
        value = float(word)
    except ValueError:
        if len(word) > LONGEST_IDENTITY:
            raise WideberthError(
                f"{path}, line {line}: id has {len(word)} characters; wanted at most "
                f"{LONGEST_IDENTITY}"
            ) from None
        return word
    if not np.isfinite(value):
        raise WideberthError(f"{path}, line {line}: id is {word[:40]}; wanted a name or a number")
    return str(round(value)) if value == round(value) else word
