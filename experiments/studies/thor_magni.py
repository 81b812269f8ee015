"""Reader of recordings of THÖR-MAGNI, people in a hall under motion capture."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from ...framework.plugins.io import read_text
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...predictors.data.recordings import MOST_BYTES, Recording, gridded, number

MILLIMETRES = 1000.0
"""In a metre; the unit of the files."""
PERIOD = 0.01
"""s between frames: the published recordings have 100 Hz."""
SMALLEST = 100.0
"""mm; people of whom none is ever farther than this from the origin were not recorded in mm."""
LONGEST_HEADER, HEADER_BYTES = 64, 2**16
"""Lines, of which the published files have 16 above the names of the columns; their bytes."""
PERSON = "Helmet"
"""What the names of bodies begin with that people wore."""
BODIES, CLOCK = "BODY_NAMES", ("Frame", "Time")
UNSEEN = ("", "nan", "n/a")
"""Cells of a row in which the body was not seen, in small letters."""

Point: TypeAlias = tuple[int, int]
"""Columns of x and of y."""


def is_thor_magni(path: Path) -> bool:
    """Whether a file seems to be a recording of THÖR-MAGNI: one of its first lines has bodies."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return f"\n{BODIES},".encode() in b"\n" + file.read(HEADER_BYTES)


def read_thor_magni(
    path: str | Path,
    dt: float,
    *,
    bridge: float = 0.3,
    minimum_samples: int = 8,
    longest_gap: float = 1.0,
) -> Recording:
    """Read the people of one recording of THÖR-MAGNI, and resample them to ``dt``.

    A body's place is its ``Centroid``, or where the file has none the one of its markers that is
    seen most often: a mean over markers would jump when one of them is lost. Millimetres become
    metres. The robot, and things that people carry, are left out; the notes name them.

    Parameters
    ----------
    path : file of ``CSVs_Scenarios``, as published: lines ``KEY,value,value``, then the names of
        the columns, then a row for each frame.
    dt : s, of the grid, which starts at the first sample.
    bridge : s; positions are interpolated linearly across gaps up to this long.
    minimum_samples, longest_gap : as in `wideberth.predictors.data.recordings.read_tracks`.

    Raises
    ------
    WideberthError : no such file, another format, no people, other units or another clock.

    References
    ----------
    Schreiter et al., "THÖR-MAGNI: A large-scale indoor motion capture recording of human movement
    and robot interaction", IJRR 2024; the files: https://zenodo.org/records/10554472
    """
    text = read_text(Path(path), "a recording of THÖR-MAGNI", MOST_BYTES).removeprefix("\ufeff")
    lines = text.splitlines()
    bodies, columns, first = _header(lines, path)
    people = {name: _points(name, columns) for name in bodies if name.startswith(PERSON)}
    if not any(people.values()):
        raise WideberthError(
            f"{path} has no columns of people: its bodies are {', '.join(bodies) or 'none'}; "
            f"wanted names that begin with {PERSON!r}, and columns as `Helmet_1 - 1 X` of them"
        )
    clock, tracks, notes = _read(lines, first, columns, people, path)
    notes += [f"left out: {name}" for name in bodies if name not in people]
    notes += [f"never seen: {name}" for name in people if name not in tracks]
    if not tracks:
        raise WideberthError(f"{path}: none of {', '.join(people)} is ever seen")
    _check_unit(max(np.nanmax(np.abs(track)) for track in tracks.values()), path)
    return gridded(
        dict.fromkeys(tracks, clock),
        {name: track / MILLIMETRES for name, track in tracks.items()},
        dt,
        bridge=bridge,
        minimum_samples=minimum_samples,
        longest_gap=longest_gap,
        notes=notes,
    )


def _header(lines: Sequence[str], path: str | Path) -> tuple[list[str], list[str], int]:
    """Return the names of the bodies and of the columns, and the first line of data, from 0."""
    bodies: list[str] | None = None
    for place, row in enumerate(csv.reader(lines[:LONGEST_HEADER])):
        cells = [cell.strip() for cell in row]
        if cells[:1] == [BODIES]:
            bodies = [name for name in cells[1:] if name]
        elif bodies is not None and set(CLOCK) <= set(cells):
            return bodies, cells, place + 1
    lacking = f"`{BODIES},...`" if bodies is None else "`Frame,Time,...`"
    raise WideberthError(
        f"{path} is no recording of THÖR-MAGNI: none of its first {LONGEST_HEADER} lines is "
        f"{lacking}; wanted a file of the folder CSVs_Scenarios, as published"
    )


def _points(body: str, columns: Sequence[str]) -> list[Point]:
    """Return the columns of the centroid of a body, or else of each of its markers."""
    stems = [name[:-1] for name in columns if name == f"{body} Centroid_X"] or [
        name[:-1] for name in columns if name.startswith(f"{body} - ") and name.endswith(" X")
    ]
    return [
        (columns.index(f"{stem}X"), columns.index(f"{stem}Y"))
        for stem in stems
        if f"{stem}Y" in columns
    ]


def _read(
    lines: Sequence[str],
    first: int,
    columns: Sequence[str],
    people: Mapping[str, Sequence[Point]],
    path: str | Path,
) -> tuple[Array, dict[str, Array], list[str]]:
    """Return the time of each frame, s; of each person who is seen (T, 2), mm; and notes."""
    points = [(name, point) for name, some in people.items() for point in some]
    wanted = [columns.index(name) for name in CLOCK] + [i for _, point in points for i in point]
    rows = []
    for line, cells in enumerate(csv.reader(lines[first:]), start=first + 1):
        row = [_value(cells, i, columns[i], path, line) for i in wanted]
        if np.isfinite(row[:2]).all():
            rows.append(row)
        elif np.isfinite(row[2:]).any():
            raise WideberthError(
                f"{path}, line {line}: a position without frame or time; leave the row out"
            )
    if not rows:
        raise WideberthError(f"{path} holds no rows; wanted one for each frame")
    table, times = np.array(rows), len(rows)
    table = table[np.unique(table[:, 0], return_index=True)[1]]
    _check_clock(table[:, 0], table[:, 1], path)
    notes = [f"left out: {times - len(table)} rows that repeat a frame"] * (len(table) < times)
    tracks: dict[str, Array] = {}
    for (name, _), track in zip(points, np.hsplit(table[:, 2:], len(points)), strict=True):
        if _seen(track) > _seen(tracks.get(name, track[:0])):
            tracks[name] = track
    return table[:, 1], tracks, notes


def _seen(track: Array) -> int:
    """Count the rows of a point, (T, 2), in which it is seen."""
    return int(np.isfinite(track).all(axis=1).sum())


def _value(cells: Sequence[str], i: int, name: str, path: str | Path, line: int) -> float:
    """Return the number in a cell, NaN in one of `UNSEEN`; rows may end early."""
    word = cells[i].strip() if i < len(cells) else ""
    return float("nan") if word.lower() in UNSEEN else number(word, name, path, line)


def _check_clock(frames: Array, times: Array, path: str | Path) -> None:
    """Refuse times that do not increase with the frames, and another rate than the published."""
    if len(frames) < 2:
        return
    steps = np.diff(times)
    if (steps <= 0).any():
        place = int(np.argmax(steps <= 0)) + 1
        raise WideberthError(
            f"{path}: frame {frames[place]:g} is at {times[place]:g} s, and frame "
            f"{frames[place - 1]:g} at {times[place - 1]:g} s; wanted times that increase"
        )
    period = float(np.median(steps / np.diff(frames)))
    if not 0.9 * PERIOD <= period <= 1.1 * PERIOD:
        raise WideberthError(
            f"{path}: frames are {period:g} apart in `Time`; wanted {PERIOD:g} s, as published: "
            "are the times in s, and are all frames there?"
        )


def _check_unit(largest: float, path: str | Path) -> None:
    """Refuse positions that cannot be in millimetres."""
    if largest < SMALLEST:
        raise WideberthError(
            f"{path}: no person is ever farther than {largest:g} from the origin; wanted "
            "millimetres, as published: are these metres?"
        )
