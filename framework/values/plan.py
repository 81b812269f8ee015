"""Plans: trajectory, status, fallback rung and reasons."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import floor, log10
from typing import Any

import numpy as np

from .arrays import Array
from .footprint import Footprint
from .forecast import Forecast
from .path import Path
from .polygon import Polygon

TOLERANCE = 1e-4
"""Largest violation of a plan that counts as feasible, in each limit's own unit: m, m/s, m^2/s^2
where a limit is a square; unit-free for regions."""


class Status(StrEnum):
    """How the solver ended."""

    SOLVED = "solved"
    LIMIT = "iteration limit"
    DEADLINE = "deadline"
    INFEASIBLE = "infeasible"
    GIVEN_UP = "given up"
    FAILED = "failed"
    NOT_RUN = "not run"


class Rung(StrEnum):
    """Rung of the fallback ladder that the plan stands on, best first."""

    OPTIMAL = "optimal"
    FEASIBLE = "feasible iterate"
    SHIFTED = "shifted last plan"
    LEAST = "least violation"
    BRAKE = "brake"


class BreachKind(StrEnum):
    """Kind of constraint that a plan can break."""

    REGION = "region"
    POLYGON = "polygon"
    MOTION = "motion limits"
    CONTACT = "contact"


@dataclass(frozen=True)
class Breach:
    """The constraint that a plan breaks most: which, when, by how much.

    Attributes
    ----------
    kind : region of an obstacle or static polygon at a step, polygon touched on the way to it,
        limits of the motion (dynamics, bounds, the robot's own, the stop at the end), or the rule
        of contact, see `wideberth.framework.mpc.planner.in_contact`.
    name : of the obstacle or polygon; empty for limits of the motion.
    step : 1..N.
    amount : unit-free in a region, m in a polygon, a limit's own unit; in contact m/s too fast, or
        m too far or too deep.
    """

    kind: BreachKind
    name: str
    step: int
    amount: float

    def __str__(self) -> str:
        """Say it in one clause."""
        if self.kind is BreachKind.REGION:
            return f"region of {self.name!r} entered by {self.amount:.2g} at step {self.step}"
        if self.kind is BreachKind.POLYGON:
            where = f"on the way to step {self.step}"
            return f"polygon {self.name!r} touched by {self.amount:.2g} m {where}"
        if self.kind is BreachKind.CONTACT:
            what = f"neither stops for {self.name!r} nor leaves it"
            return f"{what}, by {self.amount:.2g} at step {self.step}"
        return f"motion limits broken by {self.amount:.2g} at step {self.step}"


@dataclass(frozen=True)
class GivenWay:
    """A plan keeps a lower probability than was asked for: how low, from when on, for whom.

    Attributes
    ----------
    asked, held : 1 - content, or collision risk, see ``promise``, that the level aimed at stands
        for and that the plan keeps, where they differ most.
    promise : "content" or "risk", what the level policy promises.
    step : 1..N, first step at which the region that was asked for is entered.
    name : of the obstacle whose region that is.
    """

    asked: float
    held: float
    promise: str
    step: int
    name: str

    def __str__(self) -> str:
        """Say it in one clause, with as many digits as tell both numbers apart."""
        shown = [percent(tail, self.promise, 2) for tail in (self.asked, self.held)]
        for digits in range(3, 9):
            if shown[0] != shown[1]:
                break
            shown = [percent(tail, self.promise, digits) for tail in (self.asked, self.held)]
        asked = f"asked {'a risk of at most ' if self.promise == 'risk' else ''}{shown[0]}"
        return f"{asked}, holds {shown[1]} from step {self.step} on, because of {self.name!r}"


def percent(tail: float, promise: str, digits: int) -> str:
    """Write a probability in %, with so many digits of its distance from 0 or 100 %."""
    value = 100.0 * (tail if promise == "risk" else 1.0 - tail)
    away = min(value, 100.0 - value)
    decimals = min(max(digits - 1 - floor(log10(away)), 0), 15) if away > 0.0 else 0
    text = f"{value:.{decimals}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text) + " %"


@dataclass(frozen=True, eq=False)
class Situation:
    """The robot's body and what a plan kept out of: what a picture of it needs beside numbers.

    Attributes
    ----------
    region : of the planner, see `wideberth.framework.region.Region`; None where it is not known.
    room : m, radius of the body that keeps out of the region, and what is added to it.
    radii : (K,), m, of the plan's ``tracked`` obstacles.
    radius : m, of the disc that encloses the robot.
    heading : rad, at the plan's first state; NaN for a robot without one.
    footprint : of the robot; None for the disc.
    path : that the robot follows.
    polygons : what stood still.
    """

    region: Any
    room: float
    radii: Array
    radius: float
    heading: float = float("nan")
    footprint: Footprint | None = None
    path: Path | None = None
    polygons: tuple[Polygon, ...] = ()


@dataclass(frozen=True, eq=False)
class Plan:
    """States and inputs over the horizon, with their level, status and violation.

    Attributes
    ----------
    stamp : s, time of the first state.
    dt : s between states.
    states : (N + 1, n), the first is where the plan starts.
    inputs : (N, m).
    positions : (N + 1, D), m, of the states.
    reference : (N, D), m, what the plan tracked.
    auxiliaries : (N, O, A) of the regions, for the warm start.
    level : (N, O), the level that each constraint is held at.
    target : (N, O), the level aimed at.
    content : (N, O), the content that those levels stand for.
    ids : identities of the O obstacles: those in the problem, and behind them those that no plan
        can meet, which need no place in it.
    status : how the solver ended.
    rung : which rung of the fallback ladder this is; the name of a user's own is plain text.
    reason : how it gave way, why it is not the optimal plan, which other solver answered than
        the planner's own, and what was refused of the observation; empty where there is nothing
        to say. Judge by ``rung`` and ``status``.
    breach : the constraint that it breaks most; None where it keeps all, or was held against
        none.
    given_way : how far it keeps less than was asked for; None where it keeps that.
    iterations : of the solver.
    seconds : wall time of the solve.
    violation : largest violated constraint, re-checked in NumPy (unit-free, 0 if none; nan
        where an emergency left nothing to check against).
    cost : value of the objective, nan where there is none.
    left_out : obstacles that did not fit into the problem, or forecast modes, and polygons
        with a part that did not.
    forecast : what was assumed of all obstacles, left-out ones too, on the plan's grid.
    tracked : identities of the forecast's obstacles, in its order.
    situation : the robot's body and the regions, for pictures; None where they are not known.
    fallbacks : per obstacle, why the named predictor was not used, or None.
    risk : largest probability that an obstacle is met at any step of the whole plan, where a slot
        kind promises one, as `wideberth.controllers.slots.drawn_futures` does, and the plan
        keeps all that it was made for; else nan. Obstacles left out are not counted.
    """

    stamp: float
    dt: float
    states: Array
    inputs: Array
    positions: Array
    reference: Array
    auxiliaries: Array
    level: Array
    target: Array
    content: Array
    ids: tuple[str, ...]
    status: Status
    rung: Rung | str
    reason: str = ""
    iterations: int = 0
    seconds: float = 0.0
    violation: float = 0.0
    cost: float = float("nan")
    left_out: tuple[str, ...] = ()
    forecast: Forecast | None = field(default=None, repr=False)
    tracked: tuple[str, ...] = ()
    breach: Breach | None = None
    given_way: GivenWay | None = None
    risk: float = float("nan")

    situation: Situation | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """Say how it came about and what it holds, in a line, and why in another."""
        names = list(dict.fromkeys(self.ids))
        held = f"{len(names)} obstacle{'s' * (len(names) != 1)}"
        if self.content.size:
            held += f" held at {percent(1.0 - self.lowest_content, 'content', 3)}"
        words = [
            f"Plan({self.status} by {str(self.rung)!r}",
            f"{len(self.inputs)} steps of {self.dt:g} s from {self.stamp:g} s",
            held,
            f"cost {self.cost:.4g}",
            f"{self.iterations} iterations",
            f"{1e3 * self.seconds:.3g} ms",
        ]
        reason = f"\n  because: {self.reason}" if self.reason else ""
        return f"{', '.join(words)}{reason})"

    @property
    def fallbacks(self) -> tuple[str | None, ...]:
        """Per obstacle, why the named predictor was not used, or None."""
        return () if self.forecast is None else self.forecast.fallback

    @property
    def below_reference(self) -> bool | None:
        """Whether a constraint is held at less than was aimed at, or not kept at all.

        None where the plan held no constraint.
        """
        if self.violation > 1e-4:
            return True
        return bool((self.level < self.target - 1e-4).any()) if self.level.size else None

    @property
    def lowest_content(self) -> float:
        """Smallest content that any constraint of the plan stands for; nan without any."""
        return float(self.content.min()) if self.content.size else float(np.nan)
