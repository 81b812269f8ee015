"""Three dimensions: robots that fly among others, under several regions and predictors."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Self, final

import numpy as np

from ...framework import Controller, GaussianObstacle, Predictor, Region, WideberthError
from ...metrics.statistics import known_mean
from ...regions.minkowski_sum import MinkowskiSum
from ...simulation.log.episode_log import Episode
from ..drawing.plotting import PAGE
from ..drawing.strips import strips
from ..engine.closed_loop import column, condense, group, outcome, pick
from .episodes import OnePlaceStudy
from .grid import Axes, Pictures, Result, Row, Task, TaskOutcome, labelled, reduced
from .variants import planner_of

COLUMNS = (
    *("episodes", "collisions", "deadlocks", "clearance_min_m", "clearance_median_m"),
    *("time_ratio", "length_ratio", "fallback_plans", "named_forecasts", "coverage"),
)
PANELS = {
    "clearance": "least clearance (m)",
    "time_ratio_worst": "slower robot's time\n/ free time",
    "iterations": "iterations per plan",
}
LEAD = 1.5
"""s from the drawn plan to the closest approach."""


@final
@dataclass(frozen=True)
class Flight(OnePlaceStudy):
    """Every pair of predictor and region in space, on the same seeds.

    Where covariances are round (a Kalman filter with the same noise in all directions) the
    paper's ellipsoid, its repairs, the outer forms and the exact sum are one and the same
    ball; they differ for predictors that tell directions apart, as the VAR does.

    ``volume_ratio`` is the volume of the region over that of the exact sum of the ellipsoid
    of the same content, over all forecasts of the episode (the median); ``iterations`` the
    mean of the solver's per plan.

    Parameters
    ----------
    planner : settings of the MPC; its region and predictor are exchanged.
    regions, predictors : by name. The episodes of ``show`` are drawn for the first region
        under each predictor.
    show : seeds that are drawn.
    """

    claim: ClassVar[str] = (
        "Nothing in the planner is tied to the plane: content ellipsoids (chi-square with three "
        "degrees of freedom), outer forms and the exact sum keep flying robots apart."
    )
    reference: ClassVar[str] = "schoeneberg2025trajectory"
    printed: ClassVar[tuple[str, ...]] = (
        *("collisions", "deadlocks", "clearance_min_m", "clearance_median_m"),
        *("time_ratio", "length_ratio", "coverage", "volume_ratio"),
    )

    planner: Controller
    regions: dict[str, Region]
    predictors: dict[str, Predictor]
    show: tuple[int, ...] = (0,)

    def validate(self) -> None:
        """Refuse settings that make no study."""
        planner_of(self.planner)
        self.check_shown(self.show)
        if self.robot.dimension != 3:
            raise WideberthError(
                f"robot moves in {self.robot.dimension} dimensions; a flight has three"
            )

    def axes(self) -> Axes:
        """Each predictor with each region."""
        names = [(f"{rule}-{one}", rule, one) for rule in self.predictors for one in self.regions]
        return {
            "scenario": ["flight"],
            ("planner", "predictor", "region"): {own[0]: own for own in names},
            "seed": self.seed_range,
        }

    def controllers(self) -> Mapping[str, Controller]:
        """Return the planner with each predictor and region."""
        planner = planner_of(self.planner)
        return {
            f"{rule}-{region}": replace(planner, region=shape, predictor=predictor)
            for rule, predictor in self.predictors.items()
            for region, shape in self.regions.items()
        }

    def measure(self, task: Task) -> TaskOutcome:
        """Play one episode and measure its regions."""
        region, margin = task.settings["region"], planner_of(self.planner).margin
        episode = self.played(task, self.controllers()[task.settings["planner"]])
        spent = [plan.iterations for log in episode.robots for plan in log.plans]
        more = {
            "iterations": float(np.mean(spent)),
            "volume_ratio": volume_ratio(episode, self.regions[region], self.tail, margin),
        }
        drawn = task.seed in self.show and region == next(iter(self.regions))
        return outcome(episode, task, self.tail, more, drawn)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per predictor and region."""
        return [
            {
                **labels,
                **pick(condense(some), COLUMNS),
                "iterations": known_mean(column(some, "iterations")),
                "volume_ratio": known_mean(column(some, "volume_ratio")),
            }
            for labels, some in labelled(rows, "predictor", "region")
        ]

    def pictures(self, result: Result) -> Pictures:
        """Compare the regions, and draw one run for each predictor."""
        from ..drawing.episodes_3d import draw_flight

        columns = {
            f"predictor: {rule}": [{**row, "planner": row["region"]} for row in some]
            for (rule,), some in group(result.rows, "predictor").items()
        }
        yield "comparison", strips(columns, PANELS, (PAGE, 4.6))
        for rule in self.predictors:
            for seed in self.show:
                data = result.read(f"flight-{rule}-{next(iter(self.regions))}-{seed}.npz")
                flight = draw_flight(Episode.from_bytes(data), tail=self.tail, lead=LEAD)
                yield f"flight_{self.figure_name(rule, seed, self.show)}", flight

    def quick(self) -> Self:
        """One seed, two regions, the last predictor."""
        return reduced(self, regions=2, predictors=-1, seeds=1)


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
