"""Readers of recorded tracks and robot logs in plain text."""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from itertools import groupby, pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ...framework.plugins.io import read_bytes
from ...framework.tracking.identities import Identities
from ...framework.tracking.names import DEVIATION
from ...framework.tracking.noise import NoiseEstimate, estimated_noise
from ...framework.tracking.resampling import MOST_CELLS, interpolated
from ...framework.values.arrays import Array, checked, positive, whole
from ...framework.values.errors import WideberthError, short
from ...framework.values.motion import Truth
from ...framework.values.tracks import Tracks

Sample: TypeAlias = tuple[int, float, float, int]
"""(frame, x in m, y in m, line in the file)."""
Samples: TypeAlias = dict[str, list[Sample]]
"""Identity -> its samples, frames increasing."""

MOST_BYTES = 200 * 2**20
"""Bytes of a recording."""
LONGEST_IDENTITY = 100
"""Characters."""
LARGEST_COORDINATE = 1e8
"""m; a coordinate beyond it is no position on the earth, in whatever frame."""
_NUMBER = re.compile(
    r"[-+]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[-+]?[0-9]+)?|inf|infinity|nan)", re.IGNORECASE
)
"""Numbers as all software reads them; Python's own grammar has ``1_5`` and other scripts too."""
_WHOLE = re.compile(r"(-?[0-9]+)\.0*")

TRACK_COLUMNS = ("frame", "id", "x", "y")
TIMED_COLUMNS = ("id", "time", "x", "y")
ROBOT_COLUMNS = ("time", "x", "y", "theta")
_OF_TIMES = "above rows with times in s write the columns' names, such as `id,time,x,y`"
UNEVEN = 1.5
"""Usual times between samples that make a gap."""

_MEANINGS = {
    "frame": ("frame", "frames", "frame_id", "frame_number"),
    "id": ("id", "ids", "ident", "identity", "ped", "ped_id", "pedestrian_id", "person_id",
           "agent_id", "track_id", "object_id"),
    "time": ("time", "t", "stamp", "timestamp", "seconds", "time_s"),
    "x": ("x", "pos_x", "x_m"), "y": ("y", "pos_y", "y_m"), "z": ("z", "pos_z", "z_m"),
    "theta": ("theta", "yaw", "phi", "psi", "heading", "theta_rad", "yaw_rad"),
}  # fmt: skip
_NAMES = {word: name for name, words in _MEANINGS.items() for word in words}
"""Word of a header -> what the column holds."""
_REMARKS = re.compile(r"\([^)]*\)?|\[[^]]*\]?|[\"']")
"""Units and the like in brackets, which may stay open, and quotes."""
_SMALL = re.compile(r"[_(\[]\s*([mc]m)\b", re.IGNORECASE)
"""A unit in a header that is no metre."""
_UNITS = {"mm": ("millimetres", 1000), "cm": ("centimetres", 100)}


def header(line: str) -> tuple[str, ...]:
    """Return what the columns hold where a line names them, as a comment or not; else ().

    Examples
    --------
    >>> header("# ID, t, pos_x, pos_y"), header("# recorded in a hall")
    (('id', 'time', 'x', 'y'), ())
    >>> header('"frame", "id", "x [m]", "y [m]"'), header("# time (s), x, y, theta (rad)")
    (('frame', 'id', 'x', 'y'), ('time', 'x', 'y', 'theta'))
    """
    words = _header_words(line)
    known = tuple(_NAMES[word] for word in words if word in _NAMES)
    return known if len(known) == len(words) else ()


def _header_words(line: str) -> list[str]:
    """Return the words of a line, as a comment or not, without what else may stand there."""
    text = line.lstrip("# \t").split("#", 1)[0]
    return _REMARKS.sub("", text).replace(",", " ").lower().split()


def _seems_header(line: str, words: list[str], count: int) -> bool:
    """Whether a line has a word for each column, none of them a number.

    In a comment one of them must be a known name; otherwise it is prose.
    """
    if len(words) != count or any(map(is_number, words)):  # rows of another length are refused
        return False
    prose = line.lstrip().startswith("#")
    return not prose or any(_SMALL.sub("", word) in _NAMES for word in words)


def _is_header(line: str, place: str, columns: tuple[str, ...]) -> bool:
    """Whether a line names the columns; refuse one that names others, or in another order."""
    words = _header_words(line)
    if not _seems_header(line, words, len(columns)):
        return False
    if unit := _SMALL.search(line):
        name, factor = _UNITS[unit[1].lower()]
        raise WideberthError(f"{place}: positions are in {name}: divide by {factor}")
    named = header(line)
    if named == columns:
        return True
    if not named:
        raise WideberthError(
            f"{place}: header not understood: names {short(' '.join(words), 80)}; wanted "
            f"`{' '.join(columns)}` in metres (a comma or blanks between)"
        )
    raise WideberthError(
        f"{place} names the columns `{' '.join(named)}`; wanted `{' '.join(columns)}`: write the "
        "columns in this order"
    )


def read_rows(path: Path, columns: tuple[str, ...]) -> Iterator[tuple[int, list[str]]]:
    """Yield (line number, words) of each row that is not a comment.

    Raises
    ------
    WideberthError : no such file, no text, no rows, rows of another length, or a header before
        the first row that names other columns, or positions in millimetres. One that names these
        is passed over. A line is a header if it has as many words as there are columns, and no
        number among them; a comment only if it has the name of a column too.
    """
    empty = True
    for place, line in enumerate(_text(path, columns).splitlines(), start=1):
        if empty and _is_header(line, f"{path}, line {place}", columns):
            continue
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


def named_columns(path: Path) -> tuple[str, ...]:
    """Return what a file's header says that its columns hold; () where it has none."""
    for line in _text(path, TRACK_COLUMNS).splitlines():
        if named := header(line):
            return named
        if line.split("#", 1)[0].strip():
            break
    return ()


def _text(path: Path, columns: tuple[str, ...]) -> str:
    try:
        raw = read_bytes(path, MOST_BYTES)
    except WideberthError as error:
        raise WideberthError(f"{error}; check the path") from None
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise WideberthError(f"{path} is not a text file; wanted rows `{' '.join(columns)}`")
    return text


def number(word: str, name: str, path: str | Path, line: int) -> float:
    """Turn one word into a finite number."""
    if not is_number(word):
        raise WideberthError(f"{path}, line {line}: {name} is {short(word, 40)}; wanted a number")
    value = float(word)
    if not np.isfinite(value):
        raise WideberthError(
            f"{path}, line {line}: {name} is {word[:40]}; leave a row out where nothing was seen"
        )
    if name in ("x", "y") and abs(value) > LARGEST_COORDINATE:
        raise WideberthError(
            f"{path}, line {line}: {name} is {value:g} m; wanted at most {LARGEST_COORDINATE:g}"
        )
    return value


def read_samples(path: Path) -> tuple[Samples, set[str]]:
    """Read identity -> rows of (frame, x, y, line), and which identities one frame has twice."""
    samples: Samples = {}
    shared: set[str] = set()
    seen: dict[tuple[str, int], Sample] = {}
    for line, words in read_rows(path, TRACK_COLUMNS):
        frame, ident = _frame(words[0], path, line), _identity(words[1], path, line)
        x, y = (number(words[i], TRACK_COLUMNS[i], path, line) for i in (2, 3))
        key = (ident, frame)
        if key in seen and seen[key][1:3] == (x, y):
            raise WideberthError(
                f"{path}, line {line} repeats frame {key[1]} of id {ident} (line {seen[key][3]}); "
                "remove one of them"
            )
        if key in seen:
            shared.add(ident)
        seen[key] = (key[1], x, y, line)
        rows = samples.setdefault(ident, [])
        if rows and rows[-1][0] > key[1]:
            raise WideberthError(
                f"{path}, line {line}: frame {key[1]} of id {ident} comes after frame "
                f"{rows[-1][0]} (line {rows[-1][3]}); sort the file by frame"
            )
        rows.append(seen[key])
    timed = [ident for ident in samples if _is_fraction(ident)]
    if timed and (shared or len({frame for _, frame in seen}) < len(seen)):
        raise WideberthError(
            f"{path}: the columns seem to be `id time x y`, since the second holds {timed[0]} and "
            f"the first repeats; wanted `{' '.join(TRACK_COLUMNS)}`: {_OF_TIMES}"
        )
    return samples, shared


def _assigned(
    samples: Samples, shared: set[str], seconds: float
) -> tuple[Samples, tuple[str, ...]]:
    """Take rows of shared identities as unnamed, and assign them to obstacles by `Identities`.

    Parameters
    ----------
    samples, shared : of `read_samples`. seconds : s between two frames.
    """
    if not shared:
        return samples, ()
    named = {ident: rows for ident, rows in samples.items() if ident not in shared}
    unnamed = sorted(row for ident in shared for row in samples[ident])
    identities, tracks, first = Identities(DEVIATION), Samples(), unnamed[0][0]
    for frame, group in groupby(unnamed, key=lambda row: row[0]):
        rows = list(group)
        places = np.array([row[1:3] for row in rows])
        for row, obstacle in zip(
            rows, identities.named(seconds * (frame - first), places), strict=True
        ):
            tracks.setdefault(f"#{obstacle.ident}", []).append(row)
    listed = ", ".join(sorted(shared)[:3]) + ", ..." * (len(shared) > 3)
    note = (
        f"{len(shared)} identities are those of several tracks in one frame ({listed}): their "
        f"{len(unnamed)} rows are assigned to {len(tracks)} tracks by their positions"
    )
    return named | tracks, (note,)


def _is_fraction(word: str) -> bool:
    """Whether a word is a number that is not whole."""
    if not is_number(word) or not np.isfinite(float(word)):
        return False
    return float(word) != round(float(word))


def is_number(word: str) -> bool:
    """Whether a word is a number, perhaps NaN or infinite."""
    return _NUMBER.fullmatch(word) is not None


def _frame(word: str, path: Path, line: int) -> int:
    """Return the number of a frame, to its last digit."""
    value = number(word, "frame", path, line)
    exact = Decimal(word if value else 0)
    if exact != int(exact):
        raise WideberthError(
            f"{path}, line {line}: frame is {word[:40]}; wanted a whole number: "
            f"{_OF_TIMES} (a robot log of `time x y theta` is read by read_robot_log)"
        )
    return int(exact)


def _identity(word: str, path: Path, line: int) -> str:
    """Return an identity as it is written; only 7.0 and 7 are the same."""
    if len(word) > LONGEST_IDENTITY:
        raise WideberthError(
            f"{path}, line {line}: id has {len(word)} characters; wanted at most "
            f"{LONGEST_IDENTITY}"
        )
    if is_number(word) and word[-1].isalpha():
        raise WideberthError(f"{path}, line {line}: id is {word[:40]}; wanted a name or a number")
    return found[1] if (found := _WHOLE.fullmatch(word)) else word


OFF_GRID = 1e-6
STOOD = 0.1
"""m/s; who is slower stands."""
SLOW = 0.2
"""Share of the highest speeds below which a robot stands, in recordings of slow robots."""
FAST = 4.0
"""m/s; people (who walk at about 1.3) are not faster in the median, unless dt or the unit is
wrong."""
SIDEWAYS = 0.5
"""Share of the way of a robot log that lies across the headings; more contradicts its columns."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Tracks of one file on a uniform time grid.

    Attributes
    ----------
    dt : s between rows.
    times : (T,), s, uniform.
    ids : identity of each track.
    positions : (O, T, D), m, NaN where unobserved.
    unusable : per track None, or why it cannot serve as a track to predict. It still
        stands in ``positions`` as far as it could be read.
    notes : what was done to the data on the way, for the report.
    """

    dt: float
    times: Array
    ids: tuple[str, ...]
    positions: Array
    unusable: tuple[str | None, ...]
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        positive("recording.dt", self.dt)
        times = checked("recording.times", self.times, (None,))
        shape = (len(self.ids), len(times), None)
        positions = checked("recording.positions", self.positions, shape, finite=False)
        if len(self.unusable) != len(self.ids):
            raise WideberthError(
                f"recording.unusable has {len(self.unusable)} entries; wanted {len(self.ids)}"
            )
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "positions", positions)

    @property
    def usable(self) -> tuple[str, ...]:
        """Identities of the usable tracks."""
        pairs = zip(self.ids, self.unusable, strict=True)
        return tuple(ident for ident, reason in pairs if reason is None)

    @cached_property
    def noise(self) -> NoiseEstimate:
        """How noisy the recorded positions are, estimated from all tracks together."""
        return estimated_noise(np.asarray(self.positions))

    @cached_property
    def speed(self) -> float:
        """Median speed, m/s, of those who do not stand; see `usual_speed`."""
        return usual_speed([self])

    def report(self) -> str:
        """Say in a few lines how many tracks are usable, and why others are not.

        A last line asks for dt and the unit where the median speed is above `FAST`.
        """
        count = len(self.ids)
        lines = [f"{len(self.usable)} of {count} tracks usable, {len(self.times)} rows"]
        lines[0] += f" of {self.dt:g} s"
        reasons = [reason for reason in self.unusable if reason is not None]
        for reason in sorted(set(reasons)):
            lines.append(f"  {reasons.count(reason)} unusable: {reason}")
        lines += [f"  note: {note}" for note in self.notes]
        return "\n".join([*lines, *(f"  warning: {text}" for text in doubts(self.speed))])

    def tracks(
        self, end_index: int, length: int, *, radius: float = 0.3, noise: float | None = None
    ) -> Tracks:
        """Return the tracks observed at one row, with their past.

        Parameters
        ----------
        end_index : newest row.
        length : rows of past, the newest included; NaN before the recording began.
        radius : m, given to every obstacle (0.3 m: a person).
        noise : m per axis, standard deviation of a position; by default what `noise` estimates.

        Raises
        ------
        WideberthError : a row outside the recording, or a length below 1.
        """
        whole("length", length)
        if not 0 <= end_index < len(self.times):
            raise WideberthError(
                f"end_index is {end_index}; the recording has rows 0 to {len(self.times) - 1}"
            )
        size = self.positions.shape[2]
        here = np.flatnonzero(np.isfinite(self.positions[:, end_index]).all(axis=1))
        window = np.full((len(here), length, size), np.nan)
        past = self.positions[here, max(0, end_index + 1 - length) : end_index + 1]
        window[:, length - past.shape[1] :] = past
        return Tracks(
            window,
            self.dt,
            tuple(self.ids[i] for i in here),
            np.full(len(here), radius),
            self._covariances(len(here), noise),
            float(self.times[end_index]),
        )

    def scene(self, *, radius: float = 0.3, noise: float | None = None) -> Tracks:
        """Return the whole recording, for `Fittable.fit`; the arguments are as in `tracks`.

        Unusable tracks stand in it too: windows are cut where enough is observed.
        """
        count = len(self.ids)
        spread = self._covariances(count, noise)
        radii = np.full(count, radius)
        return Tracks(self.positions, self.dt, self.ids, radii, spread, float(self.times[-1]))

    def _covariances(self, count: int, noise: float | None) -> Array:
        """Covariance of a position, stated or estimated, of each obstacle, (O, D, D), m^2."""
        deviation = self.noise.deviation if noise is None else noise
        size = self.positions.shape[2]
        return np.tile(deviation**2 * np.eye(size), (count, 1, 1))

    def truth(self) -> Truth:
        """Return the whole recording as the future for the oracle; NaN where unobserved."""
        return Truth(self.times, dict(zip(self.ids, self.positions, strict=True)))


def usual_speed(recordings: Sequence[Recording]) -> float:
    """Median speed, m/s, of those who do not stand; NaN if all always do.

    To stand is to be slower than `STOOD`. In recordings of slow robots it is to be slower than a
    fifth of the speed that one sample in a hundred exceeds.
    """
    parts = [
        step[np.isfinite(step)] / one.dt
        for one in recordings
        for step in (np.linalg.norm(np.diff(track, axis=0), axis=1) for track in one.positions)
    ]
    speeds = np.concatenate(parts)
    if not speeds.size:
        return float("nan")
    moving = speeds[speeds > min(STOOD, SLOW * float(np.quantile(speeds, 0.99)))]
    return float(np.median(moving)) if moving.size else float("nan")


def doubts(speed: float) -> list[str]:
    """Ask for dt and the unit where a median speed, m/s, is above `FAST`; otherwise nothing."""
    text = f"median speed {speed:.3g} m/s of those who move: is dt right, are positions in metres?"
    return [text] * (speed > FAST)


def gridded(
    times: Mapping[str, ArrayLike],
    places: Mapping[str, ArrayLike],
    dt: float,
    *,
    bridge: float,
    minimum_samples: int,
    longest_gap: float,
    notes: Sequence[str] = (),
) -> Recording:
    """Resample all tracks to one grid, which starts at the first sample of all.

    Parameters
    ----------
    times : s, by identity, on one clock; of samples at the same time the first counts.
    places : of each (T, D), m; a sample that is not finite was not seen.
    dt, bridge, minimum_samples, longest_gap : as in `read_robot_log`.
    notes : of the recording.

    Raises
    ------
    WideberthError : numbers that are not above 0, more than `MOST_CELLS` samples, or none.
    """
    positive("dt", dt)
    positive("bridge", bridge)
    whole("minimum_samples", minimum_samples)
    positive("longest_gap", longest_gap)
    clocks, tracks = dict[str, Array](), dict[str, Array]()
    for ident, stamps in times.items():
        track = np.array(places[ident], dtype=np.float64)
        seen = np.isfinite(track).all(axis=-1)
        clock, first = np.unique(np.array(stamps)[seen], return_index=True)
        if clock.size:
            clocks[ident], tracks[ident] = clock, track[seen][first]
    if not clocks:
        raise WideberthError(f"none of {', '.join(times) or 'no tracks'} is ever seen")
    notes = [*notes, *(f"never seen: {ident}" for ident in times if ident not in clocks)]
    start = min(clock[0] for clock in clocks.values())
    end = max(clock[-1] for clock in clocks.values())
    rows = (end - start) / dt + 1.0
    if rows * len(clocks) > MOST_CELLS:
        raise WideberthError(
            f"{len(clocks)} tracks over {end - start:g} s in steps of {dt:g} s are more than "
            f"{MOST_CELLS} samples; are the times in s? If so, choose a longer dt, or split the "
            "recording in time"
        )
    grid = start + dt * np.arange(int(rows + OFF_GRID))
    positions = interpolated([*clocks.values()], [*tracks.values()], grid, bridge, OFF_GRID)
    reasons = tuple(unusable(track, dt, minimum_samples, longest_gap) for track in positions)
    return Recording(dt, grid, tuple(clocks), positions, reasons, tuple(notes))


def read_tracks(
    path: str | Path,
    *,
    dt: float,
    frames_per_row: int | None = None,
    minimum_samples: int = 8,
    longest_gap: float = 1.0,
) -> Recording:
    """Read rows ``frame id x y``, separated by white space or commas.

    Where a header names ``id``, ``time``, ``x`` and ``y``, in any order, the rows have times in s
    instead of frames, at any rate. They are resampled to ``dt`` along straight lines, across gaps
    of at most `UNEVEN` usual times between samples or `UNEVEN` dt, whichever is longer.

    Parameters
    ----------
    path : text file; ``#`` starts a comment. Rows may be sorted by frame or by identity,
        but frames must increase within each track.
    dt : s between rows. It cannot be read from frames: the frame rate of the video is
        not in the file (one published copy of the ETH data is 0.667 s, not the usual 0.4 s).
    frames_per_row : frame numbers between rows; by default the most frequent step within a track,
        of equally frequent ones the smallest.
    minimum_samples : a track is usable if a stretch of it has this many samples; 8 is the
        observed part of the usual benchmark.
    longest_gap : s; a longer one ends a stretch.

    A track whose frames are not whole steps from the others' is shifted to the nearest row
    (at most half a step), which keeps its motion as it was; the notes tell. A sample that
    is not a whole number of steps from most others of its track is left out. An identity that one
    frame has at several places names no track: its rows are assigned to tracks "#1", "#2", and so
    on by their positions, see `Identities`; the notes tell.

    Raises
    ------
    WideberthError : no such file, empty, binary, wrong columns, not numbers, NaN, frames
        unsorted within a track, or a row twice; it names file, line and cure.
    """
    positive("dt", dt)
    whole("minimum_samples", minimum_samples)
    positive("longest_gap", longest_gap)
    if frames_per_row is not None:
        whole("frames_per_row", frames_per_row)
    columns = named_columns(Path(path))
    if sorted(columns) == sorted(TIMED_COLUMNS):
        return _read_timed(Path(path), columns, dt, minimum_samples, longest_gap)
    samples, shared = read_samples(Path(path))
    step = frames_per_row or _frame_step(samples)
    samples, assigned = _assigned(samples, shared, dt / step)
    positions, notes = _on_grid(samples, step, dt, path)
    notes += assigned
    reasons = tuple(unusable(track, dt, minimum_samples, longest_gap) for track in positions)
    if None not in reasons:
        notes += (f"are the columns `{' '.join(TRACK_COLUMNS)}`, in this order?",)
    times = np.asarray(dt * np.arange(positions.shape[1]), dtype=np.float64)
    return Recording(dt, times, tuple(samples), positions, reasons, notes)


def read_robot_log(
    path: str | Path,
    dt: float,
    *,
    ident: str | None = None,
    bridge: float = 0.3,
    minimum_samples: int = 8,
    longest_gap: float = 1.0,
) -> Recording:
    """Read rows ``time x y theta`` of one robot and resample them to ``dt``.

    Parameters
    ----------
    path : text file, as in `read_tracks`; time in s on any clock, strictly increasing.
    dt : s, of the grid, which starts at the first sample; the clock is kept.
    ident : identity of the one track; by default the file's name.
    bridge : s; positions are interpolated linearly across gaps up to this long, grid times
        inside longer ones are NaN.
    minimum_samples, longest_gap : as in `read_tracks`.

    The heading is checked and then left out: predictors see positions alone.

    Raises
    ------
    WideberthError : as `read_tracks`, and times that do not increase.
    """
    positive("dt", dt)
    positive("bridge", bridge)
    rows = _log(Path(path))
    table = np.array([row for _, row in rows])
    with np.errstate(over="ignore"):
        clock = table[:, 0] - table[0, 0]
    with np.errstate(over="ignore"):
        rows_needed = clock[-1] / dt + 1.0
    if not rows_needed <= MOST_CELLS:
        raise WideberthError(
            f"{path}: {clock[-1]:g} s in steps of {dt:g} s are {rows_needed:g} rows; wanted at "
            f"most {MOST_CELLS:g}: are the times in s?"
        )
    count = int(np.floor(clock[-1] / dt + OFF_GRID)) + 1
    grid = np.minimum(dt * np.arange(count), clock[-1])
    positions = interpolated([clock], [table[:, 1:3]], grid, bridge, OFF_GRID)[0]
    lost = int(np.isnan(positions[:, 0]).sum())
    notes: tuple[str, ...] = ()
    if lost:
        notes += (f"{lost} rows unobserved: in gaps longer than {bridge:g} s",)
    if _seem_identities(table[:, 1]) and _drives_sideways(table):
        asked = f"are the columns `{' '.join(ROBOT_COLUMNS)}`, in this order?"
        notes += (f"x is {table[0, 1]:g} in every row: {asked}",)
    reason = unusable(positions, dt, minimum_samples, longest_gap)
    name = Path(path).stem if ident is None else ident
    times = table[0, 0] + dt * np.arange(count)
    return Recording(dt, times, (name,), positions[None], (reason,), notes)


def _seem_identities(column: Array) -> bool:
    """Whether a column holds one and the same whole number in several rows."""
    return len(column) > 1 and np.ptp(column) == 0.0 and column[0] == round(column[0])


def _drives_sideways(table: Array) -> bool:
    """Whether rows of time, x, y and theta go, on the mean of the way, where theta denies it."""
    steps = np.diff(table[:, 1:3], axis=0)
    headings = table[:-1, 3]
    lateral = steps[:, 1] * np.cos(headings) - steps[:, 0] * np.sin(headings)
    return float(np.abs(lateral).sum()) > SIDEWAYS * float(np.hypot(*steps.T).sum())


def _log(path: Path) -> list[tuple[int, list[float]]]:
    """Read (line, [time, x, y, theta]) of each row, times increasing."""
    rows = [
        (
            line,
            [
                number(word, name, path, line)
                for word, name in zip(words, ROBOT_COLUMNS, strict=True)
            ],
        )
        for line, words in read_rows(path, ROBOT_COLUMNS)
    ]
    for (before, old), (line, new) in pairwise(rows):
        if new[0] <= old[0]:
            if new[1] != old[1] and _seem_timed_tracks([row for _, row in rows]):
                raise WideberthError(
                    f"{path}: the columns seem to be `time id x y`, since the first goes on from "
                    f"{old[0]:.10g} (line {before}) to {new[0]:.10g} (line {line}) and the second "
                    f"holds whole numbers; wanted `{' '.join(TRACK_COLUMNS)}`: {_OF_TIMES}"
                )
            raise WideberthError(
                f"{path}, line {line}: time {new[0]:.10g} does not come after {old[0]:.10g} "
                f"(line {before}); sort the rows by time and remove repeated ones (a file of "
                "`frame id x y` is read by read_tracks)"
            )
    return rows


def _seem_timed_tracks(rows: list[list[float]]) -> bool:
    """Whether the first column holds times in s, and the second identities."""
    fractions = [any(row[place] != round(row[place]) for row in rows) for place in (0, 1)]
    return fractions == [True, False]


def _read_timed(
    path: Path, columns: tuple[str, ...], dt: float, minimum_samples: int, longest_gap: float
) -> Recording:
    """Read rows with an identity and a time in s, and resample them; see `read_tracks`."""
    lines: dict[tuple[str, float], int] = {}
    times: dict[str, list[float]] = {}
    places: dict[str, list[tuple[float, float]]] = {}
    for line, words in read_rows(path, columns):
        cells = dict(zip(columns, words, strict=True))
        ident = _identity(cells["id"], path, line)
        time, x, y = (number(cells[name], name, path, line) for name in ("time", "x", "y"))
        before = lines.setdefault((ident, time), line)
        if before != line:
            raise WideberthError(
                f"{path}, line {line} repeats time {cells['time']} of id {ident} (line {before}); "
                "remove one of them"
            )
        times.setdefault(ident, []).append(time)
        places.setdefault(ident, []).append((x, y))
    steps = np.concatenate([np.diff(np.sort(stamps)) for stamps in times.values()])
    period = float(np.median(steps)) if steps.size else dt
    bridge = UNEVEN * max(dt, period)
    note = f"resampled from {period:.3g} s to {dt:g} s, across gaps of up to {bridge:.3g} s"
    try:
        return gridded(
            times, places, dt, bridge=bridge, minimum_samples=minimum_samples,
            longest_gap=longest_gap, notes=[note],
        )  # fmt: skip
    except WideberthError as error:
        raise WideberthError(f"{path}: {error}") from None


def _on_grid(
    samples: Samples, step: int, dt: float, path: str | Path
) -> tuple[Array, tuple[str, ...]]:
    """Put samples into rows, (O, T, 2), and say what did not fit."""
    usual = _most_frequent(row[0] % step for rows in samples.values() for row in rows)
    placed: list[list[tuple[int, Sample]]] = []
    odd: list[str] = []
    shifts: list[float] = []
    for ident, rows in samples.items():
        phase = _most_frequent(row[0] % step for row in rows)
        offset = (phase - usual + step // 2) % step - step // 2
        shifts.append(abs(offset) / step * dt)
        odd += [f"{ident} at {row[0]}" for row in rows if row[0] % step != phase]
        placed.append([((row[0] - offset) // step, row) for row in rows if row[0] % step == phase])
    first = min(cells[0][0] for cells in placed)
    count = max(cells[-1][0] for cells in placed) - first + 1
    if count * len(samples) > MOST_CELLS:
        raise WideberthError(
            f"{path}: in steps of {step} frames there are {count} rows for {len(samples)} tracks, "
            f"more than {MOST_CELLS} samples: state frames_per_row if it is another, else split "
            "the file in time"
        )
    positions = np.full((len(samples), count, 2), np.nan)
    for track, cells in zip(positions, placed, strict=True):
        for row, (_, x, y, _) in cells:
            track[row - first] = x, y
    notes = [f"frames per row: {step}"]
    if any(shifts):
        shifted = sum(shift > 0.0 for shift in shifts)
        notes.append(f"{shifted} tracks shifted in time to the grid, by up to {max(shifts):.3g} s")
    if odd:
        listed = ", ".join(odd[:3]) + ", ..." * (len(odd) > 3)
        notes.append(
            f"{len(odd)} samples left out: not a whole number of steps from the others of their "
            f"track: {listed}"
        )
    return positions, tuple(notes)


def _most_frequent(values: Iterable[int]) -> int:
    """Return the most frequent number; of equally frequent ones the first."""
    return Counter(values).most_common(1)[0][0]


def _frame_step(samples: Samples) -> int:
    """Return the most frequent frame step within a track; across them if all have one sample."""
    steps = [
        after[0] - before[0]
        for rows in samples.values()
        for before, after in pairwise(rows)
        if after[0] > before[0]
    ]
    if not steps:
        frames = sorted({row[0] for rows in samples.values() for row in rows})
        steps = [b - a for a, b in pairwise(frames)]
    return _most_frequent(sorted(steps)) if steps else 1


def unusable(track: Array, dt: float, minimum: int, longest_gap: float) -> str | None:
    """Return why no stretch of a gridded track, (T, D), is long enough; None if one is."""
    seen = np.flatnonzero(np.isfinite(track).all(axis=1))
    breaks = np.flatnonzero(np.diff(seen) * dt > longest_gap + OFF_GRID)
    if not breaks.size:
        few = len(seen) < minimum
        return f"fewer than {minimum} samples" if few else None
    ends = np.concatenate([[0], breaks + 1, [len(seen)]])
    if np.diff(ends).max() >= minimum:
        return None
    return f"gaps longer than {longest_gap:g} s leave no stretch of {minimum} samples"


BAG_SUFFIXES = (".mcap", ".db3")
"""Of the files of a recording of ROS 2."""


def storage_files(path: Path) -> list[Path]:
    """Return the files that hold the messages of a recording, a folder or a file."""
    if path.is_file():
        return [path]
    return sorted(one for suffix in BAG_SUFFIXES for one in path.glob(f"*{suffix}*"))


def is_bag(path: Path) -> bool:
    """Whether a path looks like a recording of ROS 2."""
    return path.suffix in BAG_SUFFIXES or (path.is_dir() and bool(storage_files(path)))
