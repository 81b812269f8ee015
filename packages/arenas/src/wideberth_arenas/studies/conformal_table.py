"""The table by which conformal planners were compared: their rows, and others beside them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from time import perf_counter
from typing import Any, ClassVar, Self, final

import numpy as np

from wideberth.experiments import GridStudy, Result, Row, Task, TaskOutcome, subplots
from wideberth.experiments.drawing.plotting import PAGE, legend_below, style
from wideberth.experiments.engine.closed_loop import column
from wideberth.experiments.studies.crowd import TrackFile
from wideberth.experiments.studies.grid import labelled
from wideberth.framework import Controller, WideberthError
from wideberth.framework.controller import fresh
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.plugins.io import expanded
from wideberth.framework.predictor import Fittable
from wideberth.framework.values.arrays import positive, whole
from wideberth.predictors.data.recordings import read_tracks
from wideberth.simulation.scenarios.recorded_scene import FILES, PLAZA, SCENES

from ..controllers.acp import AdaptiveConformalPlanner
from ..controllers.fcp import FunctionalConformalPlanner
from ..controllers.sampled_paths import SampledController
from .block_bootstrap import block_bootstrap
from .conformal_forecasts import PublishedForecasts
from .conformal_protocol import MOST, PERSON, STANDING, RecordedCourse, drive
from .field_rows import calibrated, unbroken
from .least_hits import least_hits

DT = 0.4
"""s between rows, as published: those of "eth" are 0.667 s apart, and its people too fast."""
STARTS: dict[str, tuple[int, ...]] = {
    "eth": (732, 339, 653),
    "hotel": (1001, 1245, 1582),
    "zara1": (100, 200, 300),
    "zara2": (100, 200, 300),
    "univ": (100,),
    "plaza": (10, 30),
}
"""Scene -> rows at which the published episodes start."""
LONGEST = {"univ": 300}
"""Rows of an episode where they are not `MOST`."""
ACROSS = ((-9.0, 0.0, 0.0), (9.0, 0.0))
"""Start and goal on the synthetic plaza."""
SYNTHETIC = "plaza"
"""Name of the scene that comes with the package."""
BLOCK = 200
"""Rows of a block of the bootstrap, twice those of an episode."""
PUBLISHED, MORE, ALL = "published", "more", "all"
"""Names of the two sets of starts, and of the line over all scenes."""
MARKERS = tuple("osD^vPX*<>dp")
FEW = 100
"""Paths of a quick run."""
KINDS = ("newcomers", "standing", "own")


@final
@dataclass(frozen=True)
class Contender:
    """A controller of the table, and how it is played.

    Parameters
    ----------
    controller : decides at every row.
    last_arrival : its time is the last row at which it is at the goal, as the published loop of
        CC has it, which overwrites the first.
    at_once : it drives from the first row on, and the episode ends at a row without people, as
        the published loop of FCP has it, which calls the rows until then the steps to the goal.
    person : m, radius of the people that it is given. The published 1 / sqrt 2 m is distance for
        the most part, not body: a planner that leaves what it touches slowly takes a body of 0.3
        m, and the rest as its margin.
    fitted : whether its planner's predictor is fitted to the recordings of all other scenes; it
        is left out where there are none, on the synthetic plaza.

    Raises
    ------
    WideberthError : a radius that is not above 0, or a controller that has nothing to fit.
    """

    controller: Controller
    last_arrival: bool = False
    at_once: bool = False
    person: float = PERSON
    fitted: bool = False

    def __post_init__(self) -> None:
        positive("person", self.person)
        if self.fitted:
            self.fittable()

    def fittable(self) -> tuple[Planner, Fittable]:
        """Return the planner and the predictor to be fitted.

        Raises
        ------
        WideberthError : it is no planner, or its predictor cannot be fitted.
        """
        planner = self.controller
        if isinstance(planner, Planner) and isinstance(planner.predictor, Fittable):
            return planner, planner.predictor
        raise WideberthError("fitted: wanted an mpc whose predictor can be fitted")


@final
@dataclass(frozen=True)
class ConformalTable(GridStudy):
    """Controllers in the loop of `conformal_protocol`, from the published starts and from more.

    A hit is a row at which a person's centre is nearer than both radii; the rate is per row and
    start, and its mean over the starts is the published column. ``infeasible`` is the share of
    rows at which the robot stood for want of a plan, ``steps`` the mean rows to the goal, with the
    longest for those that never arrive: ``timeouts`` stands beside it, since a robot that
    stands far from all people has no hits.

    Hits are split into ``newcomers``, whom the recording did not have 2 s before; ``standing``,
    at which the robot stood; and its ``own``. ``unavoidable`` is the fewest that a robot of this
    speed which knows all futures and moves in any direction has, from below (`least_hits`).

    ``difference`` is the rate less that of ``ours``, start by start, with a p value by a bootstrap
    of blocks of `BLOCK` rows: starts are nearer than an episode is long.

    The people are the user's recordings, the forecasts of those that sample paths the published
    files where they are given, or else their own predictors'.

    Parameters
    ----------
    contenders : by name.
    ours : name of the one that the others are compared with.
    recordings : folder with the ETH and UCY recordings under their usual names; a file that comes
        with the package for the synthetic plaza.
    forecasts : folder with a file for each scene, such as ``eth.npz``, see `conformal_forecasts`;
        "" for none.
    every : of the rows with people every how many begins an episode of the second set; 0 for none.
    """

    claim: ClassVar[str] = (
        "By the table that compares conformal planners: who reaches the goal, who hits people, "
        "and what becomes of the published rows without the faults of their code?"
    )
    reference: ClassVar[str] = (
        "dixit2023adaptive,lekeufack2024conformal,shin2025egocentric,shin2026prediction,"
        "efron1993introduction"
    )
    printed: ClassVar[tuple[str, ...]] = (
        *("starts", "collision", "infeasible", "steps", "arrivals", "hits", "unavoidable"),
        *(*KINDS, "p_difference"),
    )

    contenders: dict[str, Contender]
    ours: str
    recordings: str = PLAZA
    forecasts: str = ""
    every: int = 0

    def __post_init__(self) -> None:
        whole("every", self.every, least=0)
        if self.ours not in self.contenders:
            raise WideberthError(
                f"ours is {self.ours!r}; wanted one of {', '.join(self.contenders)}"
            )
        if self.forecasts and self.recordings == PLAZA:
            raise WideberthError(
                "forecasts are of the user's recordings, and recordings is the synthetic plaza: "
                "state the folder of the recordings"
            )

    def axes(self) -> Mapping[Any, Any]:
        """Each contender from each start.

        Raises
        ------
        WideberthError : a folder without a scene's recording.
        """
        starts = [
            (kind, scene, start)
            for scene in self._scenes()
            for kind, some in self._starts(scene).items()
            for start in some
        ]
        return {"contender": self._known(), ("set", "scene", "start"): starts}

    def inputs(self) -> list[Path]:
        """Return the recordings and forecasts."""
        if self.recordings == PLAZA:
            return []
        scenes = self._scenes()
        found = [self._forecast_file(scene) for scene in scenes]
        return [Path(self._file(scene)) for scene in scenes] + [Path(one) for one in found if one]

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode."""
        kind, scene, start = (task.settings[name] for name in ("set", "scene", "start"))
        contender, course = self.contenders[task.settings["contender"]], self._course(scene)
        longest = LONGEST.get(scene, MOST) if kind == PUBLISHED else MOST
        rows = course.episode(start, longest)
        if contender.at_once:
            rows = unbroken(course, start, longest)
        controller = self._prepared(contender, kind, scene, start)
        if isinstance(controller, FunctionalConformalPlanner):
            controller = calibrated(controller, course, rows, STARTS[scene][0])
        standing, on = 0 if contender.at_once else STANDING, contender.last_arrival
        begin = perf_counter()
        body = contender.person
        found = drive(controller, course, rows, standing=standing, to_the_end=on, radius=body)
        seconds = perf_counter() - begin
        arrival, hits = found.arrival(last=contender.last_arrival), found.hits
        row: Row = {
            **task.settings,
            "rows": len(hits),
            "hits": int(hits.sum()),
            "rate": float(hits.mean()) if len(hits) else 0.0,
            "infeasible": float(found.failed[found.judged].mean()) if len(hits) else 0.0,
            "arrived": arrival is not None,
            "steps": len(rows) if arrival is None else arrival,
            **found.kinds(course),
            "block": f"{scene} {start // BLOCK}",
            "unavoidable": _unavoidable(self._file(scene), scene, rows[standing:]),
        }
        return TaskOutcome([row], [{**task.settings, "episode_s": seconds}])

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per set, scene and contender, and one over all scenes."""
        lines = []
        whole_sets = labelled(rows, "set") if len(self._scenes()) > 1 else []
        for labels, some in (*labelled(rows, "set", "scene"), *whole_sets):
            ours = [row for row in some if row["contender"] == self.ours]
            for name, own in labelled(some, "contender"):
                head = {"set": labels["set"], "scene": labels.get("scene", ALL)}
                lines.append({**head, **name, **condensed(own), **compared(own, ours)})
        return lines

    def pictures(self, result: Result) -> Iterator[tuple[str, Any]]:
        """Draw collisions against arrivals of each set of starts."""
        scenes = self._scenes()
        wanted = SYNTHETIC if scenes == (SYNTHETIC,) else ALL
        lines = [line for line in self.summary(result.rows) if line["scene"] == wanted]
        yield "conformal_table", draw(lines)

    def quick(self) -> Self:
        """Few paths, and the published starts alone."""
        few = {name: _quicker(one) for name, one in self.contenders.items()}
        return replace(self, contenders=few, every=0)

    def _known(self) -> list[str]:
        """Return the contenders; on the plaza without those to be fitted: it has too few rows."""
        fits = self.recordings != PLAZA
        return [name for name, one in self.contenders.items() if fits or not one.fitted]

    def _scenes(self) -> tuple[str, ...]:
        return (SYNTHETIC,) if self.recordings == PLAZA else tuple(FILES)

    def _starts(self, scene: str) -> dict[str, tuple[int, ...]]:
        """Return the rows at which episodes start, by set."""
        rows = self._course(scene).rows
        last = len(rows) - MOST
        more = rows[: max(last + 1, 0) : self.every] if self.every else ()
        return {PUBLISHED: STARTS[scene], MORE: more}

    def _course(self, scene: str) -> RecordedCourse:
        return _course(self._file(scene), scene)

    def _file(self, scene: str) -> str:
        """Return the recording of a scene.

        Raises
        ------
        WideberthError : the folder does not hold it.
        """
        if self.recordings == PLAZA:
            return str(TrackFile(PLAZA).file)
        found = expanded(self.recordings) / FILES[scene]
        if not found.is_file():
            raise WideberthError(
                f"recordings: {self.recordings} holds no {FILES[scene]!r}, the scene {scene!r}; "
                f"wanted a folder with {', '.join(FILES.values())}"
            )
        return str(found)

    def _forecast_file(self, scene: str) -> str:
        """Return the forecasts of a scene; "" where there are none."""
        if not self.forecasts:
            return ""
        folder = expanded(self.forecasts)
        if not folder.is_dir():
            raise WideberthError(f"forecasts: {self.forecasts} is no folder")
        file = folder / f"{scene}.npz"
        pickled = file.with_suffix(".pkl")
        if pickled.is_file() and not file.is_file():
            raise WideberthError(
                f"forecasts: {pickled} is a pickle, which can run code and is not read; "
                f"docs/controllers.md says how to write {file.name} of it"
            )
        return str(file) if file.is_file() else ""

    def _prepared(self, contender: Contender, kind: str, scene: str, start: int) -> Controller:
        """Return a controller with what it was fitted to, and the random state it had there."""
        made, file = fresh(contender.controller), self._forecast_file(scene)
        if contender.fitted:
            planner, predictor = contender.fittable()
            others = [self._file(other) for other in self._scenes() if other != scene]
            made = replace(planner, predictor=_fitted(predictor, tuple(others)))
        if isinstance(made, SampledController) and file:
            made = replace(made, predictor=PublishedForecasts(file, made.predictor))
        if isinstance(made, AdaptiveConformalPlanner) and kind == PUBLISHED:
            made = replace(made, earlier=STARTS[scene].index(start))
        return made


@lru_cache(maxsize=64)
def _fitted(predictor: Fittable, files: tuple[str, ...]) -> Fittable:
    """Fit a predictor to recordings."""
    return predictor.fit([read_tracks(file, dt=DT).scene(radius=PERSON) for file in files])


@lru_cache(maxsize=8)
def _course(file: str, scene: str) -> RecordedCourse:
    """Read a recording once for all starts."""
    start, goal = ACROSS if scene == SYNTHETIC else SCENES[scene][:2]
    return RecordedCourse(read_tracks(file, dt=DT), start, goal)


@cache
def _unavoidable(file: str, scene: str, rows: tuple[int, ...]) -> int:
    """Return the fewest hits, the same for all contenders."""
    return int(least_hits(_course(file, scene), rows).low)


def _quicker(one: Contender) -> Contender:
    """Return a contender that samples few paths."""
    if isinstance(one.controller, SampledController):
        return replace(one, controller=replace(one.controller, paths=FEW))
    return one


def condensed(rows: list[Row]) -> Row:
    """Condense the episodes of one contender."""
    counted: Row = {kind: int(column(rows, kind).sum()) for kind in ("unavoidable", *KINDS)}
    arrived = int(column(rows, "arrived").sum())
    return {
        "starts": len(rows),
        "collision": float(column(rows, "rate").mean()),
        "infeasible": float(column(rows, "infeasible").mean()),
        "steps": float(column(rows, "steps").mean()),
        "timeouts": len(rows) - arrived,
        "arrivals": arrived,
        "hits": int(column(rows, "hits").sum()),
        **counted,
    }


def compared(rows: list[Row], ours: list[Row]) -> Row:
    """Compare a contender with ours, start by start."""
    differences = column(rows, "rate") - column(ours, "rate")
    blocks = [row["block"] for row in rows]
    found = block_bootstrap(differences, blocks, np.random.default_rng(0))
    return {
        "difference": found.mean,
        "difference_low": found.low,
        "difference_high": found.high,
        "p_difference": found.p_value,
    }


def draw(lines: list[Row]) -> Any:
    """Draw collisions against arrivals, a panel for each set of starts."""
    sets = labelled(lines, "set")
    figure, panels = subplots(1, len(sets), figsize=(PAGE, 3.2), squeeze=False)
    for panel, (labels, some) in zip(panels[0], sets, strict=True):
        for i, line in enumerate(some):
            share, rate = line["arrivals"] / line["starts"], line["collision"]
            low = max(rate - line["difference"] + line["difference_low"], 0.0)
            high = rate - line["difference"] + line["difference_high"]
            look = style(i, MARKERS)
            panel.plot([share, share], [low, high], "-", color=look["color"], linewidth=0.8)
            panel.plot(
                share,
                rate,
                **{**look, "linestyle": ""},
                label=str(line["contender"]).replace("_", " "),
            )
        panel.set(xlim=(-0.05, 1.05), xlabel="share of starts that arrive")
        panel.set_ylim(bottom=0.0)
        panel.set_title(f"{labels['set']}: {some[0]['starts']} starts")
    panels[0, 0].set_ylabel("rows with a hit")
    legend_below(figure, panels[0], ncol=4)
    return figure
