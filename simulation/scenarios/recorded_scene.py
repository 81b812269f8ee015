"""A robot among recorded people, with the starts and goals of a published comparison."""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path as File
from typing import ClassVar, Literal, TypeAlias, final

import numpy as np

from ...framework.plugins.io import expanded
from ...framework.values.arrays import positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ...predictors.data.recordings import Recording, read_tracks
from ..engine.agents import Bystander, ReplayAgent
from .base import Cast, Placement, Scenario

Pose: TypeAlias = tuple[float, float, float]
Place: TypeAlias = tuple[float, float]
Scene: TypeAlias = Literal["eth", "hotel", "univ", "zara1", "zara2"]

SCENES: dict[str, tuple[Pose, Place, tuple[int, ...]]] = {
    "eth": ((5.0, 1.0, 0.5 * np.pi), (3.0, 10.0), (100, 200, 300)),
    "hotel": ((-1.5, 0.0, -0.5 * np.pi), (2.0, -6.0), (100, 200, 300)),
    "univ": ((3.5, 2.0, 0.25 * np.pi), (11.5, 8.5), (100,)),
    "zara1": ((12.0, 5.0, np.pi), (3.0, 6.0), (100, 200, 300)),
    "zara2": ((1.0, 6.0, 0.0), (14.0, 5.0), (100, 200, 300)),
}
"""Scene -> start (x, y, heading) in m and rad, goal in m, rows at which an episode starts."""
FILES: dict[str, str] = {
    "eth": "biwi_eth.txt",
    "hotel": "biwi_hotel.txt",
    "univ": "students003.txt",
    "zara1": "crowds_zara01.txt",
    "zara2": "crowds_zara02.txt",
}
"""Scene -> name of its file in the copy of the recordings that the comparison used."""
LEAD = 0.1
"""m that the path leads straight ahead from the start, so that the robot looks that way."""
SHIPPED = "shipped:"
PLAZA = f"{SHIPPED}plaza.txt"
_ACROSS: tuple[Pose, Place, tuple[int, ...]] = ((-9.0, 0.0, 0.0), (9.0, 0.0), (10, 30, 50, 70))
_PUBLISHED, _SYNTHETIC = 1.0 / np.sqrt(2.0), 0.3  # m, radii of people


@final
@dataclass(frozen=True)
class RecordedScene(Scenario):
    """The robot drives from a start to a goal; people walk as they were recorded.

    The seeds go round the rows at which an episode may start: seed k has ``rows[k % len(rows)]``.
    A scene of the ETH and UCY recordings has the starts, goals and rows of the published
    comparison; for another recording state ``start``, ``goal`` and ``rows``. The recordings are
    the user's own files, read once; with nothing stated the robot crosses the plaza, a synthetic
    recording that comes with the package.

    Parameters
    ----------
    tracks : file with lines ``frame id x y``, or the folder that holds the scene's under its
        usual name (`FILES`); ``shipped:plaza.txt`` and ``shipped:crowd.txt`` are synthetic.
    scene : "eth", "hotel", "univ", "zara1" or "zara2"; None for another recording.
    start : x, y in m and heading in rad; None for the scene's.
    goal : m; None for the scene's.
    rows : instants of the recording, counted in rows from its first; () for the scene's.
    dt : s between rows.
    robot_radius : m, of the robot that there is room for.
    speed : m/s at time 0.
    reference_speed : m/s.

    Raises
    ------
    WideberthError : neither a scene nor a start, goal and rows; a scene of a synthetic recording;
        a file that cannot be read, or is not there; a row that the recording does not have.

    Notes
    -----
    Starts, goals, rows, dt, the robot's 0.4 m and 0.8 m/s and the people's 1 / sqrt 2 m are those
    of ECP-MPC. Its "frames" 100, 200 and 300 are rows: its data preparation divides the numbers
    of the video's frames by ten and counts from the first. What else it does:

    - It ends after 100 rows, in "univ" 300, and counts a robot as arrived within 0.6 m: here
      ``time_limit`` (40 s, 120 s) and ``goal_tolerance`` of `Settings`.
    - Its robot stands for the first 15 rows, 6 s, while its predictor is calibrated; nothing is
      counted then. Here it may drive at once. ``rows`` (115, 215, 315) begin when that one moves.
    - It reads "eth" from a copy with 0.667 s between rows as if they were 0.4 s, so that people
      walk at 2.5 m/s. ``dt`` 0.6667 gives them their own 1.5 m/s at the same instants.

    People do not know of the robot, and some are nearer to its start than both radii at time 0
    ("zara1" row 100, "zara2" 100 and 200) or enter the recording there: such contacts are
    no one's fault. Two who walk side by side overlap, as wide as they are taken here.
    """

    reference: ClassVar[str] = "shin2025egocentric"

    tracks: str = PLAZA
    scene: Scene | None = None
    start: Pose | None = None
    goal: Place | None = None
    rows: tuple[int, ...] = ()
    dt: float = 0.4
    robot_radius: float = 0.4
    speed: float = 0.0
    reference_speed: float = 0.8

    def __post_init__(self) -> None:
        for name in ("dt", "robot_radius", "reference_speed"):
            positive(f"recorded_scene.{name}", getattr(self, name))
        positive("recorded_scene.speed", self.speed, zero=True)
        for row in self.rows:
            whole("recorded_scene.rows", row, least=0)
        missing = [name for name in ("start", "goal", "rows") if not getattr(self, name)]
        if self.scene is None and self.tracks != PLAZA and missing:
            raise WideberthError(
                f"recorded_scene: no scene is named, and {' and '.join(missing)} missing; name "
                f"one of {', '.join(sorted(SCENES))}, or state start, goal and rows"
            )
        if self.scene is not None and self.tracks.startswith(SHIPPED):
            raise WideberthError(
                f"recorded_scene.scene is {self.scene!r}, and tracks is the synthetic "
                f"{self.tracks}; state tracks, the file or folder of your recordings"
            )

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        """Place the robot; the same for every seed."""
        start, goal, _ = self._stated()
        place, heading = np.array(start[:2]), start[2]
        ahead = place + LEAD * np.array([np.cos(heading), np.sin(heading)])
        way = Path(np.stack([place, ahead, np.array(goal)]))
        return (Placement("robot", way, self.speed, reference_speed=self.reference_speed),)

    def cast(self, seed: int) -> Cast:
        """Place robot and people; the seed chooses the row."""
        rows = self._stated()[2]
        placements = self.build(np.random.default_rng(seed))
        return Cast(placements, (), self.people_from(rows[seed % len(rows)]))

    def bystanders(
        self, rng: np.random.Generator, placements: tuple[Placement, ...]
    ) -> tuple[Bystander, ...]:
        """Draw the row."""
        rows = self._stated()[2]
        return self.people_from(rows[int(rng.integers(len(rows)))])

    def inputs(self) -> tuple[File, ...]:
        """Return the recording, if it is the user's own."""
        return () if self.tracks.startswith(SHIPPED) else (File(self._file()),)

    def people_from(self, row: int) -> tuple[ReplayAgent, ...]:
        """Return the recorded people of a time span, on a clock that is 0 at a row."""
        recording = _read(self._file(), self.dt)
        last = max(row, *self._stated()[2])  # of all seeds: the first one finds it
        if last >= len(recording.times):
            raise WideberthError(
                f"recorded_scene.rows holds {last}, and {self.tracks} has rows 0 to "
                f"{len(recording.times) - 1}; state earlier ones"
            )
        radius = _SYNTHETIC if self.tracks == PLAZA else _PUBLISHED
        clock = recording.times - recording.times[row]
        return tuple(
            ReplayAgent(f"recorded {ident}", clock, track, radius)
            for ident, track in zip(recording.ids, recording.positions, strict=True)
        )

    def _stated(self) -> tuple[Pose, Place, tuple[int, ...]]:
        """Start, goal and rows: what is stated, or else the scene's."""
        start, goal, rows = _ACROSS if self.scene is None else SCENES[self.scene]
        return self.start or start, self.goal or goal, self.rows or rows

    def _file(self) -> str:
        """Path of the recording."""
        if self.tracks.startswith(SHIPPED):
            name = self.tracks.removeprefix(SHIPPED)
            return str(files("wideberth").joinpath("experiments", "data", name))
        path = expanded(self.tracks)
        if path.is_file():
            return str(path)
        if not path.is_dir():
            raise WideberthError(
                f"recorded_scene.tracks: {path} is no file; give the recording, or the folder "
                "that holds it"
            )
        if self.scene is None:
            raise WideberthError(
                f"recorded_scene.tracks: {path} is a folder; name a file, or a scene of "
                f"{', '.join(sorted(SCENES))}, whose file is then taken"
            )
        found = path / FILES[self.scene]
        if not found.is_file():
            raise WideberthError(
                f"recorded_scene.tracks: {path} holds no {FILES[self.scene]!r}, the usual name "
                f"of the scene {self.scene!r}; name the file itself"
            )
        return str(found)


@lru_cache(maxsize=4)
def _read(path: str, dt: float) -> Recording:
    """Read a recording once for all seeds."""
    return read_tracks(path, dt=dt)
