"""Recordings that predictors are scored on: the scenes, who learns from what, and the windows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Literal, final

import numpy as np

from ...framework import Tracks, WideberthError, cut_windows
from ...framework.values.arrays import Array, positive, whole
from ...predictors.data.recordings import Recording
from ...predictors.data.windows import IntArray
from .crowd import DATA, SHIPPED, Kind, TrackFile, seconds
from .jrdb import ROBOT_FRAME


@final
@dataclass(frozen=True)
class SceneFiles:
    """The recordings of one place.

    Parameters
    ----------
    files : names in the folder of the data. Each is a recording of its own clock.
    role : "primary" scenes are scored, and count in the mean over the scenes; "secondary"
        ones are scored beside them and never trained on; "training" ones are only trained on.
    site : scenes of one site are never trained on for each other; by default the scene's
        name.
    dt : s between rows, where it differs from the others'.

    Raises
    ------
    WideberthError : no file, or a dt that is not above 0.
    """

    files: tuple[str, ...]
    role: Literal["primary", "secondary", "training"] = "primary"
    site: str | None = None
    dt: float | None = None

    def __post_init__(self) -> None:
        if not self.files:
            raise WideberthError("files is empty; name at least one file of the scene")
        if self.dt is not None:
            seconds("dt", self.dt)


@final
@dataclass(frozen=True)
class PredictionData:
    """A folder of recordings: `frame id x y`, logs of one robot, THÖR-MAGNI or JRDB.

    Parameters
    ----------
    root : folder; ``shipped:`` stands for the package's own synthetic recordings: two crowds,
        or, of kind "robot-log", a robot.
    scenes : name -> its files. They are those of one dataset: in a folder that holds any of
        the named files all must be there (see `found`); in a folder that holds none of them,
        every file that fits ``pattern`` is a primary scene, named after the file: without its
        folder and ending, or with both where two scenes would have the same name.
    pattern : of files, relative to the folder, as in a shell: "*.csv", "day_*/*.txt", "**/*.txt".
    dt : s between rows (which ``frame id x y`` does not hold); all others are resampled to it.
    kind : of all files, or "auto"; see `wideberth.experiments.studies.crowd.TrackFile`.
    radius : m, of an obstacle.
    noise : m, standard deviation of a recorded position; by default each recording's own,
        estimated from all of it (`Recording.noise`).
    odometry : of JRDB, a folder; see `wideberth.experiments.studies.jrdb.read_jrdb`.

    Raises
    ------
    WideberthError : a number that is not above 0.
    """

    root: str = SHIPPED
    scenes: dict[str, SceneFiles] = field(default_factory=dict)
    pattern: str = "*.txt"
    dt: float = 0.4
    kind: Kind = "auto"
    radius: float = 0.3
    noise: float | None = None
    odometry: str | None = None

    def __post_init__(self) -> None:
        seconds("data.dt", self.dt)
        positive("data.radius", self.radius)
        if self.noise is not None:
            positive("data.noise", self.noise)

    @property
    def folder(self) -> Path:
        """Where the files are."""
        return DATA if self.root == SHIPPED else Path(self.root)

    def missing(self) -> dict[str, list[str]] | None:
        """Named files that are not there, by scene; None if none is there: another dataset."""
        lacking = {
            name: [file for file in scene.files if not (self.folder / file).is_file()]
            for name, scene in self.scenes.items()
        }
        if all(len(lacking[name]) == len(scene.files) for name, scene in self.scenes.items()):
            return None
        return {name: files for name, files in lacking.items() if files}

    def found(self, only: Sequence[str] = ()) -> dict[str, SceneFiles]:
        """Return the scenes of this folder.

        Parameters
        ----------
        only : named scenes that must be there, while others are left out if a file of theirs
            is missing; by default all must be there.

        Raises
        ------
        WideberthError : no such folder, no file in it that fits, or a named one missing.
        """
        if not self.folder.is_dir():
            raise WideberthError(
                f"data.root: {self.folder} is no folder; check the path "
                "(to score one file, name its folder here and the file in data.pattern)"
            )
        missing = self.missing()
        if missing is None:
            files = self._files()
            names = [Path(file).stem for file in files]
            if len(set(names)) < len(files):
                names = files
            return {name: SceneFiles((file,)) for name, file in zip(names, files, strict=True)}
        there = {name: scene for name, scene in self.scenes.items() if name not in missing}
        for name in only or missing:
            if name in missing:
                some = ", ".join(n for n, scene in there.items() if scene.role != "training")
                raise WideberthError(
                    f"data.scenes.{name}: {self.folder} holds no file {missing[name][0]!r} (but "
                    "others of data.scenes); add it, "
                    + (f"score only what is there (--set 'only=[{some}]'), " if some else "")
                    + "or take every file for a scene of its own (--set 'data.scenes={}')"
                )
        return there

    def _files(self) -> list[str]:
        """Files that fit the pattern, in the folder; of the package's, people or a robot."""
        if self.root == SHIPPED:
            return ["robot.txt"] if self.kind == "robot-log" else ["crowd.txt", "plaza.txt"]
        try:
            paths = [path for path in self.folder.glob(self.pattern) if path.is_file()]
            files = sorted(path.relative_to(self.folder).as_posix() for path in paths)
            if any(".." in Path(file).parts for file in files):
                raise ValueError("it leaves the folder")
        except (ValueError, NotImplementedError) as error:
            raise WideberthError(
                f"data.pattern is {self.pattern!r} ({error}); wanted one relative to the folder, "
                "such as '*.csv' or 'day_*/*.txt'"
            ) from None
        if not files:
            raise WideberthError(
                f"data.root: {self.folder} holds no file {self.pattern!r}; wanted recordings of "
                "rows `frame id x y`, `time x y theta`, or below a header `id`, `time`, `x` and "
                "`y`; to read files of other names set data.pattern, as in "
                "--set 'data.pattern=\"*.csv\"' (with both quotes)"
            )
        return files

    def step(self, scene: SceneFiles) -> float:
        """Seconds between the rows of a scene."""
        return self.dt if scene.dt is None else scene.dt

    def paths(self, scene: SceneFiles) -> list[Path]:
        """Return the files of a scene."""
        return [self.folder / file for file in scene.files]

    def size(self, scene: SceneFiles) -> int:
        """Bytes of the files of a scene."""
        return sum(path.stat().st_size for path in self.paths(scene))

    def read(self, scene: SceneFiles) -> list[Recording]:
        """Read the recordings of a scene.

        Raises
        ------
        WideberthError : as the readers.
        """
        return [
            TrackFile(
                str(path),
                self.step(scene),
                kind=self.kind,
                radius=self.radius,
                minimum_samples=1,
                odometry=self.odometry,
            ).read()
            for path in self.paths(scene)
        ]

    def noise_text(self, recordings: Sequence[Recording]) -> str:
        """Say how noisy the positions of some recordings are taken to be, and if a robot's."""
        texts = [recording.noise.text for recording in recordings]
        if self.noise is not None:
            texts = [f"measurement noise stated as {self.noise:g} m"]
        theirs = any(ROBOT_FRAME in recording.notes for recording in recordings)
        return "; ".join([*texts, *[ROBOT_FRAME] * theirs])

    def whole(self, recording: Recording) -> Tracks:
        """Return a whole recording as tracks, NaN where unobserved."""
        return recording.scene(radius=self.radius, noise=self.noise)

    def training(self, name: str, only: Sequence[str] = ()) -> list[Tracks]:
        """Return every recording that a predictor scored on this scene may learn from.

        ``only`` as in `found`.
        """
        scenes = self.found(only)
        own = scenes[name].site or name
        others = [
            scene
            for other, scene in scenes.items()
            if scene.role != "secondary" and (scene.site or other) != own
        ]
        return [self.whole(one) for scene in others for one in self.read(scene)]


def longest_stretch(recording: Recording) -> int:
    """Count the rows of the longest stretch in which an obstacle is seen without a gap."""
    run, longest = np.zeros(len(recording.ids), dtype=np.int64), 0
    known = np.isfinite(recording.positions)
    for row in range(known.shape[1]):
        run = np.where(known[:, row].all(axis=1), run + 1, 0)
        longest = max(longest, int(run.max(initial=0)))
    return longest


def pace(recording: Recording) -> str:
    """Say how fast those who move are."""
    speed = recording.speed
    return f"median speed of those who move: {speed:.3g} m/s" if speed > 0 else "all stand still"


SHORTEST = 2
"""Predicted steps of the shortest window in Schoeller's protocol."""
SLICES = ("all", "stops")
"""Names of the table's slices that no class of speed may have."""
WAY = 1.0
"""m from the forecast to the end of what was predicted; who goes less far is hardly drawn."""


@final
@dataclass(frozen=True)
class Protocol:
    """Which windows are scored, and how.

    A window is an obstacle with ``observed`` consecutive rows, the newest of which is the
    moment of the forecast. "full": and ``predicted`` consecutive rows after it. "schoeller",
    as in the published baseline of constant velocity: 2 rows after it suffice and at most
    ``predicted`` are scored, so that every start within a track gives one window of 10 to 20
    rows (with 8 + 12); the last row that there is counts as the final one.

    Windows overlap and follow one another by ``stride`` rows.

    A window's speed is the distance from the position 3 s before the forecast (from the first
    observed one where fewer were observed) to the newest, over the time between.

    Parameters
    ----------
    observed : rows that a predictor is given, with all people who are seen at the newest one.
    predicted : rows ahead.
    windows : "full" or "schoeller".
    stride : every so many rows a forecast is scored. Predictors that adapt see every row.
    floor : m, standard deviation added in quadrature in the likelihoods (and in the joint
        coverage), but not in coverage and area: those are of the forecast as it stands.
    draws : of each forecast, for the energy scores and the joint regions of mixtures; the same
        for every predictor.
    speeds : m/s, least speed of each class of windows that is also scored by itself; the first
        is 0.

    Raises
    ------
    WideberthError : a number out of range.
    """

    observed: int = 8
    predicted: int = 12
    windows: Literal["full", "schoeller"] = "full"
    stride: int = 1
    floor: float = 0.01
    draws: int = 99
    speeds: dict[str, float] = field(
        default_factory=lambda: {"standing": 0.0, "slow": 0.1, "walking": 0.5, "fast": 1.5}
    )

    def __post_init__(self) -> None:
        fewest = {"observed": 2, "predicted": SHORTEST, "stride": 1, "draws": 2}
        for name, few in fewest.items():
            whole(f"protocol.{name}", getattr(self, name), least=few)
        positive("protocol.floor", self.floor)
        for name in SLICES:
            if name in self.speeds:
                raise WideberthError(
                    f"protocol.speeds has a class {name!r}, which is another part of the table; "
                    "name it otherwise"
                )
        least = list(self.speeds.values())
        increase = all(first < second for first, second in pairwise(least))
        if least and not (least[0] == 0.0 and increase and np.isfinite(least[-1])):
            raise WideberthError(
                f"protocol.speeds is {self.speeds}; wanted the least speed of each class, m/s: "
                "0 for the first, and more from each to the next"
            )

    @property
    def least(self) -> int:
        """Rows that must follow the newest observed one."""
        return self.predicted if self.windows == "full" else SHORTEST

    def text(self, dt: float) -> str:
        """Say in one line which windows are scored and how; ``fitted`` says who learnt."""
        kind = "full windows" if self.windows == "full" else f"windows from {SHORTEST} on"
        apart = "" if self.stride == 1 else f", every {self.stride} rows"
        return (
            f"{self.observed} + {self.predicted} rows of {dt:g} s, {kind}{apart}, "
            f"floor {self.floor:g} m"
        )


@final
@dataclass(frozen=True, eq=False)
class ForecastInstant:
    """One row of a recording at which forecasts are scored.

    Attributes
    ----------
    row : in the recording.
    tracks : of all people seen at this row, and the ``observed`` rows up to it.
    scored : indices into the tracks of those who are scored.
    truth : (K, predicted, D), m, what the scored ones then did; NaN after the first sample
        missing.
    """

    row: int
    tracks: Tracks
    scored: IntArray
    truth: Array


def window_places(data: PredictionData, recording: Recording, how: Protocol) -> IntArray:
    """Track and newest observed row of every window, (W, 2), by row and then by track."""
    found = cut_windows(data.whole(recording), how.observed, how.least)
    places = np.stack([found.obstacle, found.row], axis=1)
    kept = places[places[:, 1] % how.stride == 0]
    return np.asarray(kept[np.lexsort(kept.T)])


def moments(
    data: PredictionData, recording: Recording, how: Protocol
) -> Iterator[ForecastInstant]:
    """Yield every row of a recording, from the first; ``scored`` is empty without windows."""
    places = window_places(data, recording, how)
    length = len(recording.times)
    for row in range(length):
        tracks = recording.tracks(row, how.observed, radius=data.radius, noise=data.noise)
        who = places[places[:, 1] == row, 0]
        where = {ident: index for index, ident in enumerate(tracks.ids)}
        scored = np.array([where[recording.ids[i]] for i in who], dtype=np.int64)
        truth = np.full((len(who), how.predicted, tracks.dimension), np.nan)
        ahead = recording.positions[who, row + 1 : row + 1 + how.predicted]
        seen = np.isfinite(ahead).all(axis=2)
        unbroken = np.logical_and.accumulate(seen, axis=1)
        truth[:, : ahead.shape[1]] = np.where(unbroken[..., None], ahead, np.nan)
        yield ForecastInstant(row, tracks, scored, truth)


def shown_windows(
    data: PredictionData, recording: Recording, how: Protocol, quantiles: Sequence[float]
) -> list[tuple[int, str]]:
    """Choose windows to draw: row and identity of some that are more or less of a surprise.

    Of all windows known in full of those who get somewhere (of all if none does) they are
    those whose distance of the last position from that of a person who walks straight on has
    these quantiles.
    """
    found: list[tuple[float, int, str, float]] = []
    for moment in moments(data, recording, how):
        past = moment.tracks.positions[moment.scored]
        straight = past[:, -1] + how.predicted * (past[:, -1] - past[:, -2])
        gaps = np.linalg.norm(moment.truth[:, -1] - straight, axis=1).tolist()
        ways = np.linalg.norm(moment.truth[:, -1] - past[:, -1], axis=1).tolist()
        idents = [moment.tracks.ids[index] for index in moment.scored]
        found += [
            (gap, moment.row, ident, way)
            for gap, ident, way in zip(gaps, idents, ways, strict=True)
            if np.isfinite(gap)
        ]
    chosen = sorted([one for one in found if one[-1] >= WAY] or found)
    at = [round(share * (len(chosen) - 1)) for share in quantiles]
    return [chosen[i][1:3] for i in at] if chosen else []
