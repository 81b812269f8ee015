"""A robot among recorded people, with the starts and goals of a published comparison."""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path as File
from typing import ClassVar, Literal, TypeAlias, final

import numpy as np

from ..framework.arrays import positive, whole
from ..framework.errors import WideberthError
from ..framework.path import Path
from ..framework.recordings import Recording, read_tracks
from .agents import Bystander, ReplayAgent
from .scenario import Cast, Placement, Scenario

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
LEAD = 0.1
"""m that the path leads straight ahead from the start, so that the robot looks that way."""
SHIPPED = "shipped:"


@final
@dataclass(frozen=True)
class RecordedScene(Scenario):
    """The robot drives from a start to a goal; people walk as they were recorded.

    The seeds go round the rows at which an episode may start: seed k has ``rows[k % len(rows)]``.
    A scene of the ETH and UCY recordings has the starts, goals and rows of the published
    comparison; for another recording state ``start``, ``goal`` and ``rows``. The recording is the
    user's own file, read once.

    Parameters
    ----------
    tracks : file with lines ``frame id x y``; ``shipped:crowd.txt`` is the synthetic recording
        that comes with the package.
    scene : "eth", "hotel", "univ", "zara1" or "zara2"; None where the three below are stated.
    start : x, y in m and heading in rad; None for the scene's.
    goal : m; None for the scene's.
    rows : instants of the recording, counted in rows from its first; () for the scene's.
    dt : s between rows.
    robot_radius : m, of the robot that there is room for.
    person_radius : m.
    speed : m/s at time 0.
    reference_speed : m/s.

    Raises
    ------
    WideberthError : neither a scene nor a start, goal and rows; a file that cannot be read;
        a row that the recording does not have.

    Notes
    -----
    Starts, goals, rows 100, 200 and 300, dt 0.4 s, the robot's 0.4 m and 0.8 m/s and the
    people's 1 / sqrt 2 m are those of ECP-MPC. It says "frames"; taken here as rows of 0.4 s.
    People do not know of the robot: intrusions are to be reported rather than blamed on anybody,
    and one may stand on the robot's start.
    """

    reference: ClassVar[str] = "shin2025egocentric"

    tracks: str = f"{SHIPPED}crowd.txt"
    scene: Scene | None = None
    start: Pose | None = None
    goal: Place | None = None
    rows: tuple[int, ...] = ()
    dt: float = 0.4
    robot_radius: float = 0.4
    person_radius: float = 1.0 / np.sqrt(2.0)
    speed: float = 0.0
    reference_speed: float = 0.8

    def __post_init__(self) -> None:
        for name in ("dt", "robot_radius", "person_radius", "reference_speed"):
            positive(f"recorded_scene.{name}", getattr(self, name))
        positive("recorded_scene.speed", self.speed, zero=True)
        for row in self.rows:
            whole("recorded_scene.rows", row, least=0)
        missing = [name for name in ("start", "goal", "rows") if not getattr(self, name)]
        if self.scene is None and missing:
            raise WideberthError(
                f"recorded_scene: no scene is named, and {' and '.join(missing)} missing; name "
                f"one of {', '.join(sorted(SCENES))}, or state start, goal and rows"
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

    def people_from(self, row: int) -> tuple[ReplayAgent, ...]:
        """Return everybody who is there at some time, on a clock that is 0 at a row."""
        recording = _read(self.tracks, self.dt)
        if row >= len(recording.times):
            raise WideberthError(
                f"recorded_scene.rows holds {row}, and {self.tracks} has rows 0 to "
                f"{len(recording.times) - 1}; state earlier ones"
            )
        clock = recording.times - recording.times[row]
        return tuple(
            ReplayAgent(f"recorded {ident}", clock, track, self.person_radius)
            for ident, track in zip(recording.ids, recording.positions, strict=True)
        )

    def _stated(self) -> tuple[Pose, Place, tuple[int, ...]]:
        """Start, goal and rows: what is stated, or else the scene's."""
        start, goal, rows = SCENES[self.scene or "eth"]
        return self.start or start, self.goal or goal, self.rows or rows


@lru_cache(maxsize=4)
def _read(tracks: str, dt: float) -> Recording:
    """Read a recording once for all seeds."""
    if not tracks.startswith(SHIPPED):
        return read_tracks(tracks, dt=dt)
    data = files("wideberth").joinpath("experiments", "data", tracks.removeprefix(SHIPPED))
    return read_tracks(File(str(data)), dt=dt)
