"""What each region costs in closed loop: clearance, time, way and solve time."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Self, cast, final

from ...framework.controller import Controller
from ...framework.mpc.levels.base import LevelPolicy
from ...framework.mpc.planner.planner import Planner
from ...framework.numerics.statistics import known_mean
from ...framework.plugins.io import write_table
from ...framework.predictor import Predictor
from ...framework.region import Region
from ...framework.robot import Robot
from ...framework.values.arrays import probability, whole
from ...framework.values.errors import WideberthError
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.measures.summary import robot_rows, summarise
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Outcome, Result, Row, Task
from ..engine.closed_loop import (
    check_starts,
    column,
    condense,
    first_of,
    group,
    inputs_of,
    pick,
    play,
)
from .price_figure import draw_prices
from .prices import ELLIPSE, area_ratio, excess, met, quartiles, solve_times, time_rows
from .region_family import family, member
from .stopwatch import Stopwatch
from .variants import planner_of

AT_RISK = "_at_risk"
"""Ends the name of a region whose level is that for a risk, not for a content."""

COLUMNS = (
    "episodes", "collisions", "deadlocks", "goals_in_time", "clearance_min_m",
    "clearance_median_m",
)  # fmt: skip


@final
@dataclass(frozen=True)
class RegionPrice(Experiment):
    """The same planner with every region, on the same seeds, against the paper's ellipse.

    ``extra_time`` and ``extra_path`` are the slower robot's time and the longer path over
    those under the ellipse at the same seed and forecast, less 1; medians over the ``paired``
    seeds at which both arrived. ``area_ratio`` is the mean area over that of the exact sum
    for the forecasts that were met under the ellipse. The level policy is the planner's: its
    ``minimum`` and ``weight`` are in each region's own level, and its tail is the content
    kept out or the risk asked for, whichever the region's level stands for.

    Solve times are the solver's own, without forecast and re-check, in processor time, each
    region in its own closed loop: what a user pays, on problems that differ a little. One task
    plays all regions at one seed, one after another, from another one first at every seed; a
    ratio is of two quantiles within one task, and what is reported is the median of the ratios
    over the seeds, so that a machine that is slower for a while slows both.

    Parameters
    ----------
    scenario, robot, planner, settings, tail : as in `dynamic_matters`, one scenario.
    predictors : forecasts by name. Round ones set the regions apart less: there the paper's
        ellipse, the exact sum and all outer ellipses are the same disc.
    regions : by name; one of them is named ``mahalanobis_ellipse``.
    registered : add every other registered region.
    at_risk : names of regions to be played once more at the level at which the collision
        risk is at most the policy's tail (promise: risk).
    seeds : number of episodes per region and forecast, seeds 0 to seeds - 1.
    """

    claim: ClassVar[str] = (
        "A tighter or a safer region has its price in clearance, time and computation: what "
        "does each cost in the same encounters?"
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"

    scenario: Scenario
    robot: Robot
    planner: Controller
    predictors: dict[str, Predictor]
    regions: dict[str, Region]
    registered: bool = True
    at_risk: tuple[str, ...] = ()
    settings: Settings = field(default_factory=Settings)
    seeds: int = 10
    tail: float = 0.05

    def __post_init__(self) -> None:
        whole("seeds", self.seeds)
        probability("tail", self.tail)
        planner_of(self.planner)
        if not self.predictors:
            raise WideberthError("predictors is empty; name at least one")
        if ELLIPSE not in self.regions:
            raise WideberthError(
                f"regions are {sorted(self.regions)}; one must be named {ELLIPSE!r}: the price "
                "of the others is relative to it"
            )
        unknown = sorted(set(self.at_risk) - set(self.regions))
        if unknown:
            raise WideberthError(
                f"at_risk names {unknown}; wanted some of regions, {sorted(self.regions)}"
            )

    def tasks(self) -> list[Task]:
        """One per forecast and seed, for all regions."""
        return [
            Task(f"{forecast} {seed}", seed, {"forecast": forecast})
            for forecast in self.predictors
            for seed in range(self.seeds)
        ]

    def inputs(self) -> list[Path]:
        """Return the files that the scenario reads."""
        return inputs_of([self.scenario])

    def check(self) -> None:
        """Begin an episode of the first seed."""
        check_starts({"": self.scenario}, self.robot, {"planner": self.planner})

    def measure(self, task: Task) -> Outcome:
        """Play one episode with each region."""
        forecast = str(task.settings["forecast"])
        names = self._names()
        turn = task.seed % len(names)
        rows: dict[str, Row] = {}
        seconds: dict[str, list[float]] = {}
        planners: dict[str, Planner] = {}
        covariances = None
        for name in names[turn:] + names[:turn]:
            try:
                planners[name] = self.variant(name, self.predictors[forecast])
            except WideberthError as error:
                rows[name] = {"remark": str(error)}
                continue
            watch = Stopwatch(planners[name], [])
            episode = play(self.scenario, self.robot, watch, self.settings, task.seed)
            rows[name], seconds[name] = _row(episode, self.tail), watch.seconds
            if name == ELLIPSE:
                covariances = met(episode)
        for name, planner in planners.items():
            rows[name] |= {"area_ratio": area_ratio(planner, planners.get(ELLIPSE), covariances)}
        labels: list[Row] = [
            {"forecast": forecast, "region": name, "seed": task.seed} for name in names
        ]
        times = time_rows([(label, seconds.get(label["region"], [])) for label in labels])
        return Outcome([label | rows[label["region"]] for label in labels], times)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per forecast and region, paired with the paper's ellipse."""
        base = {(row["forecast"], row["seed"]): row for row in rows if row["region"] == ELLIPSE}
        lines = []
        for (forecast, region), some in group(rows, "forecast", "region").items():
            line: Row = {"forecast": forecast, "region": region}
            if some[0]["remark"]:
                lines.append(line | {"remark": some[0]["remark"]})
                continue
            pairs = [base[row["forecast"], row["seed"]] for row in some]
            time = excess(some, pairs, "time_ratio_worst")
            path = excess(some, pairs, "length_ratio_worst")
            rest = condense(some)
            lines.append(
                {
                    **line,
                    "area_ratio": known_mean(column(some, "area_ratio")),
                    **pick(rest, COLUMNS),
                    "extra_time": quartiles(time)[1],
                    "extra_path": quartiles(path)[1],
                    "paired": len(time),
                    **pick(rest, ("below_reference", "least_content", "fallback_plans")),
                    "iterations": known_mean(column(some, "iterations")),
                    "remark": rest["errors"],
                }
            )
        return lines

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw the prices, and write the solve times and their ratios as a table."""
        from ..drawing.plotting import paper_style, save

        times = solve_times(result.times)
        with paper_style():
            figure = draw_prices(result.rows, self.summary(result.rows), times)
            files = save(figure, folder, "region_price")
        return [*files, write_table(folder / "solve_times.csv", times)]

    def quick(self) -> Self:
        """One seed, the first forecast, the ellipse and two other regions."""
        others = [name for name in self.regions if name != ELLIPSE]
        return replace(
            self,
            predictors=first_of(self.predictors),
            regions={name: self.regions[name] for name in (ELLIPSE, *others[:2])},
            registered=False,
            at_risk=(),
            seeds=1,
        )

    def _names(self) -> list[str]:
        """Names of the rows: every region, then those that are played at a risk too."""
        names = family(self.regions, self.registered, self.robot.dimension)
        return [*names, *(name + AT_RISK for name in self.at_risk)]

    def variant(self, name: str, predictor: Predictor) -> Planner:
        """Return the planner with the region and the level policy behind a row's name.

        Raises
        ------
        WideberthError : no such region, one that the planner refuses, or one without a level
            for a risk.
        """
        planner = planner_of(self.planner)
        policy = planner.level
        short = name.removesuffix(AT_RISK)
        at_risk = name != short and short in self.at_risk
        region = member(self.regions, short if at_risk else name)
        if at_risk:
            policy = cast(LevelPolicy, replace(cast(Any, policy), promise="risk"))
        return replace(planner, region=region, level=policy, predictor=predictor)


def _row(episode: Episode, tail: float) -> Row:
    """Return what is kept of an episode."""
    iterations = column(robot_rows(episode), "iterations")
    return {"remark": "", **summarise(episode, tail), "iterations": known_mean(iterations)}
