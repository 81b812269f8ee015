"""Three dimensions: robots that fly among others, under several regions and predictors."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, final

import numpy as np

from ...framework.controller import Controller
from ...framework.predictor import Predictor
from ...framework.region import Region
from ...framework.robot import Robot
from ...framework.values.arrays import positive
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import GaussianObstacle
from ...metrics.statistics import known_mean
from ...regions.minkowski_sum import MinkowskiSum
from ...simulation.engine.settings import Settings
from ...simulation.log.episode_log import Episode
from ...simulation.scenarios.base import Scenario
from ..engine.base import Experiment, Result, Row, Task, TaskOutcome
from ..engine.closed_loop import (
    check_settings,
    check_shown,
    check_starts,
    column,
    condense,
    figure_name,
    first_of,
    group,
    inputs_of,
    outcome,
    pick,
    play,
    seeds_of,
    shown_of_fewer,
)
from .variants import by_region_and_predictor, planner_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMNS = (
    *("episodes", "collisions", "deadlocks", "clearance_min_m", "clearance_median_m"),
    *("time_ratio", "length_ratio", "fallback_plans", "named_forecasts", "coverage"),
)
PANELS = {
    "clearance": "least clearance (m)",
    "time_ratio_worst": "slower robot's time\n/ free time",
    "iterations": "iterations per plan",
}


@final
@dataclass(frozen=True)
class Flight(Experiment):
    """Every pair of predictor and region in space, on the same seeds.

    Where covariances are round (a Kalman filter with the same noise in all directions) the
    paper's ellipsoid, its repairs, the outer forms and the exact sum are one and the same
    ball; they differ for predictors that tell directions apart, as the VAR does.

    ``volume_ratio`` is the volume of the region over that of the exact sum of the ellipsoid
    of the same content, over all forecasts of the episode (the median); ``iterations`` the
    mean of the solver's per plan.

    Parameters
    ----------
    scenario : who flies where, in three dimensions; each seed draws the same for all.
    robot : model of all plants.
    planner : settings of the MPC; its region and predictor are exchanged.
    regions, predictors : by name. The episodes of ``show`` are drawn for the first region
        under each predictor.
    settings : clock, noise and end of the episodes.
    seeds : number of episodes per pair.
    first_seed : the seeds are first_seed to first_seed + seeds - 1.
    tail : 1 - content of the drawn ellipsoid, of the coverage and of the volumes.
    show : seeds that are drawn.
    lead : s from the drawn plan to the closest approach.
    """

    claim: ClassVar[str] = (
        "Nothing in the planner is tied to the plane: content ellipsoids (chi-square with three "
        "degrees of freedom), outer forms and the exact sum keep flying robots apart."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    growing: ClassVar[tuple[str, ...]] = ("seeds",)
    captions: ClassVar[Mapping[str, str]] = {
        "comparison": (
            "Clearance, time and iterations of every flight by region: no region should reach "
            "the line at which bodies touch."
        ),
        "flight_*": (
            "One flight, from above and from the side, with the least distance between the robots."
        ),
    }
    headline: ClassVar[tuple[str, ...]] = ("collisions", "clearance_min_m", "time_ratio")

    scenario: Scenario
    robot: Robot
    planner: Controller
    regions: dict[str, Region]
    predictors: dict[str, Predictor]
    settings: Settings = field(default_factory=Settings)
    seeds: int = 10
    first_seed: int = 0
    tail: float = 0.05
    show: tuple[int, ...] = (0,)
    lead: float = 1.5

    def __post_init__(self) -> None:
        check_settings(self, regions=self.regions, predictors=self.predictors)
        positive("lead", self.lead)
        planner_of(self.planner)
        check_shown(self.show, self.first_seed, self.seeds)
        if self.robot.dimension != 3:
            raise WideberthError(
                f"robot moves in {self.robot.dimension} dimensions; a flight has three"
            )

    def tasks(self) -> list[Task]:
        """One per predictor, region and seed."""
        return [
            Task(f"{rule} {region} {seed}", seed, _labels(rule, region))
            for rule in self.predictors
            for region in self.regions
            for seed in seeds_of(self)
        ]

    def inputs(self) -> list[Path]:
        """Return the files that the scenario reads."""
        return inputs_of([self.scenario])

    def check(self) -> None:
        """Begin an episode with every region and predictor."""
        variants = by_region_and_predictor(self.planner, self.regions, self.predictors)
        planners = {" ".join(key): planner for key, planner in variants.items()}
        check_starts({"": self.scenario}, self.robot, planners, self.first_seed)

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode and measure its regions."""
        region, rule = task.settings["region"], task.settings["predictor"]
        shape = self.regions[region]
        variants = by_region_and_predictor(
            self.planner, {region: shape}, {rule: self.predictors[rule]}
        )
        planner = variants[region, rule]
        episode = play(self.scenario, self.robot, planner, self.settings, task.seed)
        drawn = task.seed in self.show and region == next(iter(self.regions))
        result = outcome(episode, task, self.tail, keep=drawn)
        spent = [plan.iterations for log in episode.robots for plan in log.plans]
        extra = {
            "iterations": float(np.mean(spent)),
            "volume_ratio": volume_ratio(
                episode, shape, self.tail, planner_of(self.planner).margin
            ),
        }
        return replace(result, rows=[{**result.rows[0], **extra}])

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per predictor and region."""
        return [
            {
                "predictor": rule,
                "region": region,
                **pick(condense(some), COLUMNS),
                "iterations": known_mean(column(some, "iterations")),
                "volume_ratio": known_mean(column(some, "volume_ratio")),
            }
            for (rule, region), some in group(rows, "predictor", "region").items()
        ]

    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw one run for each predictor, and compare the regions."""
        from ..drawing.episodes_3d import draw_flight
        from ..drawing.plotting import paper_style, save

        with paper_style():
            files = save(compare(result.rows), folder, "comparison")
            for rule in self.predictors:
                labels = _labels(rule, next(iter(self.regions)))
                for seed in self.show:
                    data = result.read(f"flight-{labels['planner']}-{seed}.npz")
                    flight = draw_flight(Episode.from_bytes(data), tail=self.tail, lead=self.lead)
                    files += save(flight, folder, f"flight_{figure_name(rule, seed, self.show)}")
        return files

    def quick(self) -> Self:
        """One seed, two regions, the last predictor."""
        return replace(
            self,
            regions=first_of(self.regions, 2),
            predictors=dict(list(self.predictors.items())[-1:]),
            seeds=1,
            show=shown_of_fewer(self.show, self.first_seed, 1),
        )


def _labels(rule: str, region: str) -> dict[str, str]:
    return {
        "scenario": "flight",
        "planner": f"{rule}-{region}",
        "predictor": rule,
        "region": region,
    }


def volume_ratio(episode: Episode, region: Region, tail: float, margin: float) -> float:
    """Median volume of a region over the exact sum's, over all forecasts; nan without any.

    Both have the content 1 - tail before they are enlarged; ``margin`` m is added to the
    radii.
    """
    exact, ratios = MinkowskiSum(), [np.zeros(0)]
    for log in episode.robots:
        for plan in log.plans:
            if plan.forecast is None:
                continue
            means, spreads = plan.forecast.mean, plan.forecast.covariance
            radii = [episode.agent(name).radius + log.radius + margin for name in plan.tracked]
            room = np.broadcast_to(np.reshape(radii, (-1, 1, 1)), means.shape[:-1])
            obstacle = GaussianObstacle(means, spreads)
            volumes = [
                one.area(one.parameters(obstacle, room), np.array(one.level(tail, 3)))
                for one in (region, exact)
            ]
            ratios.append((volumes[0] / volumes[1]).ravel())
    joined = np.concatenate(ratios)
    return float(np.median(joined)) if joined.size else float("nan")


def compare(rows: list[Row]) -> "Figure":
    """Draw every episode's clearance, time and iterations by region, a column per predictor."""
    from matplotlib.figure import Figure

    from ..drawing.plotting import PAGE
    from ..drawing.strips import strip, strip_legend

    groups = group(rows, "predictor")
    figure = Figure(figsize=(PAGE, 4.6))
    panels: Any = figure.subplots(
        len(PANELS), len(groups), squeeze=False, sharex=True, sharey="row"
    )
    for i, ((rule,), some) in enumerate(groups.items()):
        by_region = [{**row, "planner": row["region"]} for row in some]
        for panel, name in zip(panels[:, i], PANELS, strict=True):
            strip(panel, by_region, name)
        panels[0, i].set_title(f"predictor: {rule}")
        panels[0, i].axhline(0.0, color="0.5", linewidth=0.6)
    strip_legend(figure, "bodies touch")
    for panel, text in zip(panels[:, 0], PANELS.values(), strict=True):
        panel.set_ylabel(text)
    return figure
