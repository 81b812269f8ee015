"""Recordings that predictors are scored on: which files make a scene, and its windows."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, final

import numpy as np

from wideberth.framework.arrays import Array, positive, whole
from wideberth.framework.errors import WideberthError
from wideberth.framework.recordings import Recording
from wideberth.framework.tracks import Tracks
from wideberth.framework.windows import IntArray, cut_windows

from .crowd import DATA, SHIPPED, TrackFile

SHORTEST = 2
"""Predicted steps of the shortest window in Schoeller's protocol."""


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

    Parameters
    ----------
    observed : rows that a predictor is given, with everybody who is seen at the newest one.
    predicted : rows ahead.
    windows : "full" or "schoeller".
    stride : every so many rows a forecast is scored. Predictors that adapt see every row.
    floor : m, standard deviation added in quadrature in the likelihoods (and in the joint
        coverage), but not in coverage and area: those are of the forecast as it stands.
    draws : of each forecast, for the energy score and the regions of mixtures.
    seed : of the draws, which are the same for every predictor.

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
    seed: int = 0

    def __post_init__(self) -> None:
        whole("protocol.observed", self.observed, least=2)
        whole("protocol.predicted", self.predicted, least=SHORTEST)
        whole("protocol.stride", self.stride)
        whole("protocol.draws", self.draws, least=2)
        whole("protocol.seed", self.seed, least=0)
        positive("protocol.floor", self.floor)

    @property
    def least(self) -> int:
        """Rows that must follow the newest observed one."""
        return self.predicted if self.windows == "full" else SHORTEST

    def text(self, dt: float, fit: bool) -> str:
        """Say in one line what a number of the table stands for."""
        kind = "full windows" if self.windows == "full" else f"windows from {SHORTEST} on"
        apart = "" if self.stride == 1 else f", every {self.stride} rows"
        learnt = "fit on other scenes" if fit else "no fit"
        return (
            f"{self.observed} + {self.predicted} rows of {dt:g} s, {kind}{apart}, {learnt}, "
            f"floor {self.floor:g} m"
        )


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
            positive("dt", self.dt)


@final
@dataclass(frozen=True)
class PredictionData:
    """A folder of recordings: `frame id x y`, or logs of one robot, `time x y theta`.

    Parameters
    ----------
    root : folder; ``shipped:`` is the package's own, of synthetic recordings.
    scenes : name -> its files. They are those of one dataset: in a folder that holds any of
        the named files all must be there; in a folder that holds none of them, every file
        that fits ``pattern`` is a primary scene, named after the file.
    pattern : of file names, as in a shell.
    dt : s between rows (which ``frame id x y`` does not tell); logs are resampled to it.
    kind : of all files, or "auto"; see `wideberth.experiments.crowd.TrackFile`.
    radius : m, of an obstacle.
    noise : m, standard deviation of a recorded position, which the predictors are told.

    Raises
    ------
    WideberthError : a number that is not above 0.
    """

    root: str = SHIPPED
    scenes: dict[str, SceneFiles] = field(default_factory=dict)
    pattern: str = "*.txt"
    dt: float = 0.4
    kind: Literal["auto", "tracks", "robot-log"] = "auto"
    radius: float = 0.3
    noise: float = 0.01

    def __post_init__(self) -> None:
        for name in ("dt", "radius", "noise"):
            positive(f"data.{name}", getattr(self, name))

    @property
    def folder(self) -> Path:
        """Where the files are."""
        return DATA if self.root == SHIPPED else Path(self.root)

    def found(self) -> dict[str, SceneFiles]:
        """Return the scenes of this folder.

        Raises
        ------
        WideberthError : no such folder, no file in it that fits, or a named one missing.
        """
        if not self.folder.is_dir():
            raise WideberthError(f"data.root: {self.folder} is no folder; check the path")
        named = {file: scene for scene, one in self.scenes.items() for file in one.files}
        missing = [file for file in named if not (self.folder / file).is_file()]
        if len(missing) < len(named):
            if missing:
                raise WideberthError(
                    f"data.scenes.{named[missing[0]]}: {self.folder} holds no file {missing[0]!r}"
                    " (but others of data.scenes); add it, or take the scene out of data.scenes"
                )
            return dict(self.scenes)
        files = sorted(path.name for path in self.folder.glob(self.pattern) if path.is_file())
        if not files:
            raise WideberthError(
                f"data.root: {self.folder} holds no file {self.pattern!r}; wanted recordings of "
                "rows `frame id x y` or `time x y theta`"
            )
        return {Path(file).stem: SceneFiles((file,)) for file in files}

    def step(self, scene: SceneFiles) -> float:
        """Seconds between the rows of a scene."""
        return self.dt if scene.dt is None else scene.dt

    def paths(self, scene: SceneFiles) -> list[Path]:
        """Return the files of a scene."""
        return [self.folder / file for file in scene.files]

    def read(self, scene: SceneFiles) -> list[Recording]:
        """Read the recordings of a scene.

        Raises
        ------
        WideberthError : as the readers.
        """
        return [
            TrackFile(str(path), self.step(scene), None, self.kind, self.radius, 1).read()
            for path in self.paths(scene)
        ]

    def whole(self, recording: Recording) -> Tracks:
        """Return a whole recording as tracks, NaN where unobserved."""
        return recording.scene(radius=self.radius, noise=self.noise)

    def training(self, name: str) -> list[Tracks]:
        """Return every recording that a predictor scored on this scene may learn from."""
        scenes = self.found()
        own = scenes[name].site or name
        others = [
            scene
            for other, scene in scenes.items()
            if scene.role != "secondary" and (scene.site or other) != own
        ]
        return [self.whole(one) for scene in others for one in self.read(scene)]


@final
@dataclass(frozen=True, eq=False)
class Moment:
    """One row of a recording at which forecasts are scored.

    Attributes
    ----------
    row : in the recording.
    tracks : everybody seen at this row, and the ``observed`` rows up to it.
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
    return np.asarray(kept[np.lexsort((kept[:, 0], kept[:, 1]))])


def moments(data: PredictionData, recording: Recording, how: Protocol) -> Iterator[Moment]:
    """Yield every row of a recording, from the first; ``scored`` is empty where nobody is."""
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
        yield Moment(row, tracks, scored, truth)
