"""Recorded tracks as an experiment states them, and situations drawn from them."""

from dataclasses import dataclass
from pathlib import Path as File
from typing import Any, Literal, TypeAlias, final

import numpy as np

from ...framework import Path, WideberthError
from ...framework.plugins.extensions import function
from ...framework.plugins.registry import unknown
from ...framework.values.arrays import Array, positive, whole
from ...predictors.data.recordings import (
    ROBOT_COLUMNS,
    TRACK_COLUMNS,
    Recording,
    doubts,
    is_bag,
    is_number,
    named_columns,
    read_robot_log,
    read_rows,
    read_tracks,
    storage_files,
)
from ...simulation.engine.agents import ReplayAgent
from .jrdb import odometry_file, read_jrdb
from .thor_magni import is_thor_magni, read_thor_magni

IntArray: TypeAlias = np.ndarray[Any, np.dtype[np.int64]]
Kind: TypeAlias = Literal["auto", "tracks", "robot-log", "thor-magni", "jrdb"]
"""Of a file, see `TrackFile`."""

DATA = File(__file__).resolve().parents[1] / "data"
SHIPPED = "shipped:"
BRIDGE = 1.0
"""s; a person unseen for at most this long is taken to have walked straight on."""
ROOM = 1.0
"""m from the robot's surface to the nearest person's, at the start and at the goal."""
PREFIX = "recorded "
"""Of the names of the recorded, which may otherwise be the robot's own."""
LONGEST_STEP = 10.0
"""s between rows; people who are seen more rarely are not forecast."""
FASTEST = 50.0
"""m/s; a higher median speed is that of millimetres, or of a dt in other units."""
DRAWS = 1000
"""Tries to find a free start before the recording is said to have none."""


@final
@dataclass(frozen=True)
class TrackFile:
    """A file of recorded positions, and what the file itself cannot tell.

    Parameters
    ----------
    path : of a text file, of a file of THÖR-MAGNI or of JRDB as published, or of a recording of
        ROS 2 (a folder of rosbag2, or its .mcap or .db3; extra ``ros``), relative to the working
        folder; ``shipped:crowd.txt`` and ``shipped:robot.txt`` are the synthetic recordings that
        come with the package.
    dt : s. Of ``frame id x y`` the time between rows, which the file does not hold; all others
        are resampled to it.
    frames_per_row : frame numbers between rows; by default the usual step within a track.
    kind : "tracks" (``frame id x y``, or below a header ``id time x y``), "robot-log" (``time x
        y theta``), "thor-magni" (a CSV of that dataset, which "auto" knows by its header), "jrdb"
        (labels_3d of that one, a .json) or
        "bag", a recording of ROS 2, known by its files. The first two have four columns: "auto"
        goes by a header, as a comment or not, if there is one. Otherwise it takes a file for a
        robot log if a value of its first column has a fraction; or if the first column increases
        from each row to the next and a value of the second column has one. Frames and identities
        are whole numbers or names, and several people share a frame. A log in whole seconds of a
        robot that stays at whole metres is mistaken: state its kind.
    radius : m, of a recorded body (0.3 m: a person).
    minimum_samples : samples that a usable track has in a row.
    topic : of a recording of ROS 2; see `read_bag_tracks` of the package that reads them.
    odometry : of JRDB; see `wideberth.experiments.studies.jrdb.read_jrdb`.

    Raises
    ------
    WideberthError : dt, radius or a number that is not above 0, or a dt above `LONGEST_STEP`.
    """

    path: str = f"{SHIPPED}crowd.txt"
    dt: float = 0.4
    frames_per_row: int | None = None
    kind: Kind | Literal["bag"] = "auto"
    radius: float = 0.3
    minimum_samples: int = 8
    topic: str | None = None
    odometry: str | None = None

    def __post_init__(self) -> None:
        seconds("tracks.dt", self.dt)
        positive("tracks.radius", self.radius)
        whole("tracks.minimum_samples", self.minimum_samples)
        if self.frames_per_row is not None:
            whole("tracks.frames_per_row", self.frames_per_row)

    @property
    def name(self) -> str:
        """The file's name without folder and ending."""
        return File(self.path.removeprefix(SHIPPED)).stem

    @property
    def file(self) -> File:
        """Where the file is."""
        if not self.path.startswith(SHIPPED):
            return File(self.path)
        name = self.path.removeprefix(SHIPPED)
        known = sorted(path.name for path in DATA.glob("*.txt"))
        if name not in known:
            raise WideberthError(f"tracks.path: {unknown('shipped recording', name, known)}")
        return DATA / name

    @property
    def is_bag(self) -> bool:
        """Whether it is a recording of ROS 2."""
        return self.kind == "bag" or (self.kind == "auto" and is_bag(self.file))

    def files(self) -> list[File]:
        """Return all files that are read."""
        if self.is_bag:
            return storage_files(self.file)
        others = [] if self.odometry is None else [odometry_file(self.file, self.odometry)]
        return [self.file, *others]

    def _read(self) -> Recording:
        """Read the file as what it is."""
        few = self.minimum_samples
        if self.is_bag:
            read = function("read_bag_tracks", f"{self.file} is a recording of ROS 2")
            recording: Recording = read(self.file, self.dt, topic=self.topic, minimum_samples=few)
            return recording
        kind = guess_kind(self.file) if self.kind == "auto" else self.kind
        if kind == "thor-magni":
            return read_thor_magni(self.file, self.dt, minimum_samples=few)
        if kind == "jrdb":
            return read_jrdb(self.file, self.dt, odometry=self.odometry, minimum_samples=few)
        if kind == "robot-log":
            return read_robot_log(self.file, self.dt, minimum_samples=few)
        return read_tracks(
            self.file, dt=self.dt, frames_per_row=self.frames_per_row, minimum_samples=few
        )

    def read(self) -> Recording:
        """Read the file.

        Raises
        ------
        WideberthError : as the readers, when no track is usable, and for a median speed above
            `FASTEST`.
        """
        recording = self._read()
        if not recording.usable:
            raise WideberthError(f"{self.file} holds no usable track: {recording.report()}")
        if recording.speed > FASTEST:
            raise WideberthError(
                f"{self.file}: {doubts(recording.speed)[0]} dt is {self.dt:g} s; wanted at most "
                f"{FASTEST:g} m/s (divide millimetres by 1000)"
            )
        return recording


def seconds(name: str, dt: float) -> float:
    """Return a time between rows if it is above 0 and at most `LONGEST_STEP`."""
    if positive(name, dt) > LONGEST_STEP:
        raise WideberthError(f"{name} is {dt:g} s; is it in ms?")
    return dt


def guess_kind(file: File) -> Kind:
    """Tell the formats apart by their ending, header or numbers; see `TrackFile`."""
    if file.suffix == ".json":
        return "jrdb"
    if is_thor_magni(file):
        return "thor-magni"
    named = named_columns(file)
    if len(named) == len(TRACK_COLUMNS):
        return "robot-log" if named == ROBOT_COLUMNS else "tracks"
    first, second = [], []
    for _, words in read_rows(file, TRACK_COLUMNS):
        if not all(map(is_number, words[:2])):  # a name, or what the reader will refuse
            return "tracks"
        first.append(float(words[0]))
        second.append(float(words[1]))
    clock, other = np.array(first), np.array(second)
    rising = bool((np.diff(clock) > 0).all())
    if _fraction(clock) or (rising and _fraction(other)):
        return "robot-log"
    return "tracks"


def _fraction(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return bool((known != np.round(known)).any())


def counted_reasons(recording: Recording) -> str:
    """Say how many tracks are unusable for which reason, in one line; empty if none is."""
    reasons = [reason for reason in recording.unusable if reason is not None]
    return "; ".join(f"{reasons.count(one)}: {one}" for one in sorted(set(reasons)))


@dataclass(frozen=True, eq=False)
class CrowdInstant:
    """One crossing, on a clock on which the robot starts at 0.

    Attributes
    ----------
    start : s, the robot's start on the recording's clock.
    end : s, the end of the recording on the robot's clock.
    path : the robot's way.
    aimed : identity of the person whom it would meet half way.
    people : all people who are there while the robot looks or drives.
    """

    start: float
    end: float
    path: Path
    aimed: str
    people: tuple[ReplayAgent, ...]


def draw_situation(
    recording: Recording,
    rng: np.random.Generator,
    *,
    reach: float,
    speed: float,
    radii: tuple[float, float],
    span: tuple[float, float],
) -> CrowdInstant:
    """Draw a straight way on which an unhindered robot would meet a recorded person.

    One sample of the usable tracks is drawn, so that crowded moments are drawn more often,
    and a direction. The way leads ``reach`` m towards the sample's place and as far beyond
    it; the robot starts at the recorded row at which it has to, to be there with the person
    (to half a row). Drawn again until no person is within `ROOM` of the robot at its start and,
    at the time an unhindered robot would be there, at its goal.

    Parameters
    ----------
    recording : whom to cross; unusable tracks are there as well.
    reach : m. speed : m/s.
    radii : m, of the robot and of a person.
    span : s before the start and after it for which the people are cut out.

    Raises
    ------
    WideberthError : the recording is too short, or crowded throughout.
    """
    lead = max(round(reach / speed / recording.dt), 1)
    who, rows = _samples(recording, lead)
    if not len(who):
        length = recording.dt * (len(recording.times) - 1)
        raise WideberthError(
            f"the recording lasts {length:g} s and no usable track is in it between "
            f"{lead * recording.dt:g} s after its begin and before its end, which a crossing of "
            f"2 x {reach:g} m at {speed:g} m/s needs; shorten reach or take a longer recording"
        )
    positions = bridged(recording)
    clear = sum(radii) + ROOM
    for _ in range(DRAWS):
        pick = int(rng.integers(len(who)))
        angle = rng.uniform(-np.pi, np.pi)
        along = reach * np.array([np.cos(angle), np.sin(angle)])
        row, aim = int(rows[pick]), recording.positions[who[pick], rows[pick]]
        near = [
            np.linalg.norm(positions[:, at] - place, axis=1) < clear
            for at, place in ((row - lead, aim - along), (row + lead, aim + along))
        ]
        if not np.any(near):
            way = Path(np.array([aim - along, aim + along]))
            start, aimed = row - lead, recording.ids[who[pick]]
            people = _cut(recording, positions, start, span, radii[1])
            left = recording.dt * (len(recording.times) - 1 - start)
            return CrowdInstant(float(recording.times[start]), left, way, aimed, people)
    raise WideberthError(
        f"in {DRAWS} draws no start and goal {reach:g} m from a person had {ROOM:g} m of room; "
        "state another reach"
    )


def _samples(recording: Recording, lead: int) -> tuple[IntArray, IntArray]:
    """Track and row of each usable sample with ``lead`` rows before and after it."""
    seen = np.isfinite(recording.positions).all(axis=2)
    seen &= np.array([reason is None for reason in recording.unusable])[:, None]
    seen[:, :lead] = seen[:, max(seen.shape[1] - lead, 0) :] = False
    who, rows = np.nonzero(seen)
    return who, rows


def bridged(recording: Recording) -> Array:
    """Positions with gaps of up to `BRIDGE` s filled linearly, (O, T, 2), m."""
    filled = recording.positions.copy()
    for track in filled:
        seen = np.flatnonzero(np.isfinite(track).all(axis=1))
        gaps = np.diff(seen)
        for k in np.flatnonzero((gaps > 1) & (gaps * recording.dt <= BRIDGE + 1e-9)):
            share = np.arange(1, gaps[k])[:, None] / gaps[k]
            ends = track[seen[k]], track[seen[k + 1]]
            track[seen[k] + 1 : seen[k + 1]] = (1 - share) * ends[0] + share * ends[1]
    return filled


def _cut(
    recording: Recording, positions: Array, start: int, span: tuple[float, float], radius: float
) -> tuple[ReplayAgent, ...]:
    """People of a stretch of the recording, on a clock that is 0 at the row ``start``."""
    before, after = (int(np.ceil(part / recording.dt)) + 1 for part in span)
    low, high = max(start - before, 0), min(start + after + 1, positions.shape[1])
    clock = recording.dt * (np.arange(low, high, dtype=np.float64) - start)
    return tuple(
        ReplayAgent(f"{PREFIX}{ident}", clock, track, radius)
        for ident, track in zip(recording.ids, positions[:, low:high], strict=True)
        if np.isfinite(track).any()
    )
