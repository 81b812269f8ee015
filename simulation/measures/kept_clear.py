"""How often people leave the regions that plans were to keep clear of."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, final

import numpy as np

from ...framework.mpc.levels.base import LevelPolicy
from ...framework.region import Region
from ...framework.values.arrays import Array, BoolArray
from ...framework.values.forecast import Forecast, GaussianObstacle, heeded
from ...framework.values.plan import Plan
from ..log.episode_log import Episode


@final
@dataclass(frozen=True, eq=False)
class Person:
    """Where a person truly is.

    Attributes
    ----------
    at : positions at some times, (T,), s -> (T, D), m, NaN where absent.
    radius : m.
    """

    at: Callable[[Array], Array]
    radius: float


def people_of(episode: Episode, others: Sequence[Any] = ()) -> dict[str, Person]:
    """Return all but the robots, by name.

    Parameters
    ----------
    episode : its log knows people up to its end.
    others : bystanders whose motion is known beyond it, such as `ReplayAgent`.
    """
    found = {
        agent.name: Person(partial(episode.at, agent), agent.radius)
        for agent in episode.agents
        if agent.kind != "robot"
    }
    return found | {one.name: Person(one.at, one.radius) for one in others}


@final
@dataclass(frozen=True, eq=False)
class KeptClear:
    """What became of the regions of one plan's forecast, at the level that was aimed at.

    Attributes
    ----------
    known : (O, N), whether it is known where the person was at the step.
    outside : (O, N), whether they were outside all regions of the modes of their forecast.
    radius : (O, N), m, of the disc as large as the regions of one person at one step.
    uncovered : (N,), whether a person with a forecast was outside the regions of all people:
        where the distance to the nearest of them was less than the plan reckoned with.
    met : (O, N), whether they touched the robot, had it been where it was planned to be.
    newcomers : people who appeared while the plan lasted, of whom it could know nothing.
    """

    known: BoolArray
    outside: BoolArray
    radius: Array
    uncovered: BoolArray
    met: BoolArray
    newcomers: int

    @classmethod
    def of(
        cls,
        plan: Plan,
        region: Region,
        level: LevelPolicy,
        people: Mapping[str, Person],
        radius: float,
    ) -> "KeptClear | None":
        """Judge a plan by where people then were; None where its forecast has no person.

        Parameters
        ----------
        plan, region, level : the plan, and the regions that it was to keep clear of.
        people : by name, as plans name them; other obstacles are left out.
        radius : m, of the robot.
        """
        forecast = plan.forecast
        if forecast is None:
            return None
        rows = [o for o, name in enumerate(plan.tracked) if name in people]
        if not rows:
            return None
        steps = min(forecast.steps, len(plan.positions) - 1)
        times = plan.stamp + plan.dt * np.arange(1, steps + 1, dtype=np.float64)
        names = [plan.tracked[o] for o in rows]
        others = [name for name in people if name not in plan.tracked]
        truth = np.array([people[name].at(times) for name in (*names, *others)])
        there: BoolArray = np.asarray(np.isfinite(truth).all(axis=2), dtype=np.bool_)
        regions = HeededRegions.of(forecast, rows, steps, region, level)
        inside = regions.contain(truth)
        own = inside[np.arange(len(rows)), np.arange(len(rows))]
        known, covered = there[: len(rows)], inside[: len(rows)].any(axis=1)
        apart = np.linalg.norm(truth[: len(rows)] - plan.positions[1 : steps + 1], axis=2)
        reach = radius + np.array([people[name].radius for name in names])
        return cls(
            known=known,
            outside=known & ~own,
            radius=regions.radius,
            uncovered=np.asarray((known & ~covered).any(axis=0), dtype=np.bool_),
            met=known & (apart < reach[:, None]),
            newcomers=int(there[len(rows) :].any(axis=1).sum()),
        )

    def counts(self) -> dict[str, float]:
        """Count steps, people and the plan itself, and those of each that were missed.

        A meeting is missed where the plan, driven to its end, touches a person. ``driven`` is the
        first step, which is driven before a new plan is made.
        """
        persons = self.known.any(axis=1)
        there = float(persons.any())
        return {
            "steps": float(self.known.sum()),
            "steps_missed": float(self.outside.sum()),
            "persons": float(persons.sum()),
            "persons_missed": float(self.outside.any(axis=1).sum()),
            "plans": there,
            "plans_missed": float(self.outside.any()),
            "fields": there,
            "fields_missed": float(self.uncovered.any()),
            "meetings": there,
            "meetings_missed": float(self.met.any()),
            "driven": float(self.known[:, 0].any()),
            "driven_missed": float(self.outside[:, 0].any()),
            "plans_with_newcomers": float(self.newcomers > 0),
        }


@final
@dataclass(frozen=True, eq=False)
class HeededRegions:
    """Regions of all modes of a forecast that plans heed, enlarged or not.

    Attributes
    ----------
    region : states them. numbers : (O, M, N, P), its parameters. level : (O, M, N).
    heeded : (O, M, 1), modes that plans keep clear of.
    """

    region: Region
    numbers: Array
    level: Array
    heeded: BoolArray

    @classmethod
    def of(
        cls, forecast: Forecast, rows: list[int], steps: int, region: Region, level: LevelPolicy
    ) -> "HeededRegions":
        """Return those of some obstacles, at the levels of so many."""
        mean, covariance = forecast.mean[rows, :, :steps], forecast.covariance[rows, :, :steps]
        numbers = region.parameters(GaussianObstacle(mean, covariance), np.zeros(mean.shape[:3]))
        levels = level.levels(region, steps, len(rows), mean.shape[-1]).T[:, None]
        return cls(
            region,
            numbers,
            np.broadcast_to(levels, mean.shape[:3]),
            heeded(forecast.weight[rows])[..., None],
        )

    @classmethod
    def aimed(cls, plan: Plan, steps: int) -> "HeededRegions | None":
        """Return what a plan was to keep its centre out of; None where it does not say.

        As pictures show it (`wideberth.draw.plans.kept_out`), at the level aimed at.
        """
        forecast, situation = plan.forecast, plan.situation
        if forecast is None or situation is None or situation.region is None:
            return None
        rows = [o for o, name in enumerate(plan.tracked) if name in plan.ids]
        if not rows:
            return None
        steps = min(steps, forecast.steps)
        mean, covariance = forecast.mean[rows, :, :steps], forecast.covariance[rows, :, :steps]
        margin = np.broadcast_to(
            (situation.radii[rows] + situation.room)[:, None, None], mean.shape[:3]
        )
        numbers = situation.region.parameters(GaussianObstacle(mean, covariance), margin)
        columns = [plan.ids.index(plan.tracked[o]) for o in rows]
        levels = np.broadcast_to(plan.target[:steps, columns].T[:, None], mean.shape[:3])
        return cls(situation.region, numbers, levels, heeded(forecast.weight[rows])[..., None])

    def contain(self, places: Array) -> BoolArray:
        """Whether each place is in a region of each obstacle, (P, N, D) -> (P, O, N)."""
        held = self.region.contains(places[:, None, None], self.numbers, self.level)
        return np.asarray((held & self.heeded).any(axis=2), dtype=np.bool_)

    @property
    def radius(self) -> Array:
        """Radius of a disc as large as the regions of an obstacle at a step, (O, N), m."""
        area = np.where(self.heeded, self.region.area(self.numbers, self.level), 0.0)
        return np.asarray(np.sqrt(area.sum(axis=1) / np.pi))
