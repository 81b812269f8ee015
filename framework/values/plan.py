"""Plans: trajectory, status, fallback rung and reasons."""

from dataclasses import dataclass, field
from enum import StrEnum
from math import floor, log10
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.shapes import Shape, outlines, sphere, surfaces
from ..drawing.style import (
    BLACK,
    FORECAST,
    WALL,
    chosen_steps,
    halo,
    picture,
    png,
    polygons,
    shades,
)
from .arrays import Array
from .errors import WideberthError
from .footprint import Footprint, body_outlines
from .forecast import LIGHT, Forecast, GaussianObstacle
from .path import Path
from .polygon import Polygon

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
        of contact, see `wideberth.framework.mpc.fallback.in_contact`.
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
        shown = [_percent(tail, self.promise, 2) for tail in (self.asked, self.held)]
        for digits in range(3, 9):
            if shown[0] != shown[1]:
                break
            shown = [_percent(tail, self.promise, digits) for tail in (self.asked, self.held)]
        asked = f"asked {'a risk of at most ' if self.promise == 'risk' else ''}{shown[0]}"
        return f"{asked}, holds {shown[1]} from step {self.step} on, because of {self.name!r}"


def _percent(tail: float, promise: str, digits: int) -> str:
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

    region: Shape | None
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
    situation : the robot's body and the regions, for `plot`; None where they are not known.
    fallbacks : per obstacle, why the named predictor was not used, or None.
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

    situation: Situation | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        """Say how it came about and what it holds, in a line, and why in another."""
        names = list(dict.fromkeys(self.ids))
        held = f"{len(names)} obstacle{'s' * (len(names) != 1)}"
        if self.content.size:
            held += f" held at {_percent(1.0 - self.lowest_content, 'content', 3)}"
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

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the plan and what it keeps out of; return the axes.

        A planned position and the set that the robot's centre keeps out of at that step have the
        same shade, darker the later; the forecast's mean has it too. At most eight steps, the last
        among them, have a region and their time ahead. Around the first position stands the robot.

        Parameters
        ----------
        ax : axes to draw into, in three dimensions with ``projection="3d"``; None for a figure.

        Examples
        --------
        >>> ax = planner.plan.plot()            # doctest: +SKIP
        >>> ax.figure.savefig("plan.png")       # doctest: +SKIP
        """
        return picture(self._draw, self.positions.shape[1], ax)

    def _repr_png_(self) -> bytes:
        return png(self._draw, self.positions.shape[1])

    def _draw(self, panel: Any) -> Array:
        """Draw into axes of the right dimension; return what has to be seen."""
        seen = [self.positions, draw_situation(panel, self)]
        seen.append(draw_kept_out(panel, self))
        panel.plot(*self.positions.T, "-", color="0.45", linewidth=0.7, zorder=2.2)
        steps = drawn_steps(self)
        others = np.delete(self.positions, [0, *(i + 1 for i in steps)], axis=0)
        panel.plot(*others.T, linestyle="none", marker=".", color="0.45", markersize=2.5)
        for i, (step, shade) in enumerate(zip(steps, shades(len(steps)), strict=True)):
            place = self.positions[step + 1]
            panel.plot(
                *place[:, None], "s", color=shade, markersize=5.0, markeredgecolor="black",
                markeredgewidth=0.5, zorder=2.6, label=None if i else "planned positions",
            )  # fmt: skip
        if self.positions.shape[1] == 2:
            span = float(np.ptp(np.concatenate(seen), axis=0).max())
            times = self.dt * (np.array(steps) + 1.0)
            write_times(panel, self.positions[1:][steps], times, 0.08 * span)
        panel.set_title(self._title(), loc="left")
        return np.concatenate(seen)

    def _title(self) -> str:
        """Name the rung, and the content that is held."""
        name = "plan" if self.rung is Rung.OPTIMAL else str(self.rung)
        head = f"{name} at t = {self.stamp:g} s"
        if not self.content.size:
            return f"{head}, no obstacle"
        return f"{head}, holds {_percent(1.0 - self.lowest_content, 'content', 2)} content"

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


def kept_out(
    plan: Plan, situation: Situation | None, steps: list[int]
) -> dict[tuple[int, int], Array]:
    """Boundaries of the sets that a plan kept the robot's centre out of.

    It is the planner's own region with the margin r + r_d and what is added to it, at the level
    that the plan held at each step. Of a robot of discs it is that for each disc's centre; of one
    with corners, where the region knows them, that for the whole body (r = 0). The robot's own
    uncertainty, which a plan does not record, is left out.

    Parameters
    ----------
    steps : of the forecast, from 0.

    Returns
    -------
    (obstacle, mode) of the forecast -> (len(steps), COUNT, 2), m, in space surfaces
    (len(steps), C, C, 3), of the obstacles that a constraint holds. Empty where the region is not
    known or not defined.
    """
    forecast = plan.forecast
    if forecast is None or situation is None or situation.region is None or not plan.level.size:
        return {}
    keys = [
        (int(owner), int(mode))
        for owner, mode in zip(*np.nonzero(forecast.weight >= LIGHT), strict=True)
        if plan.tracked[owner] in plan.ids
    ]
    if not keys:
        return {}
    owners, modes = (np.array(part) for part in zip(*keys, strict=True))
    obstacle = GaussianObstacle(
        forecast.mean[owners, modes][:, steps], forecast.covariance[owners, modes][:, steps]
    )
    # Modes of one obstacle share a name and a level.
    columns = [plan.ids.index(plan.tracked[owner]) for owner in owners]
    level = plan.level[steps][:, columns].T
    margin = np.broadcast_to((situation.radii[owners] + situation.room)[:, None], level.shape)
    trace = outlines if forecast.mean.shape[-1] == 2 else surfaces
    try:
        found = trace(situation.region, obstacle, margin, level)
    except WideberthError:  # a region that a singular covariance leaves undefined
        return {}
    return dict(zip(keys, found, strict=True))


def drawn_steps(plan: Plan) -> list[int]:
    """Choose the steps, from 0, that have a region in a picture; fewer in space."""
    return chosen_steps(len(plan.inputs), 8 if plan.positions.shape[1] == 2 else 4)


def draw_kept_out(panel: Any, plan: Plan) -> Array:
    """Draw what a plan keeps out of, each step in its shade; return all points drawn."""
    size, steps = plan.positions.shape[1], drawn_steps(plan)
    seen = [np.zeros((0, size))]
    if plan.forecast is not None:
        for mean in plan.forecast.mean[plan.forecast.weight >= LIGHT]:
            panel.plot(*mean.T, "-", color=FORECAST, linewidth=0.7, zorder=1.6)
            seen.append(mean)
    found = kept_out(plan, plan.situation, steps)
    for i, (step, shade) in enumerate(zip(steps, shades(len(steps)), strict=True)):
        first = i == 0
        if plan.forecast is not None:
            means = plan.forecast.mean[plan.forecast.weight >= LIGHT][:, step]
            panel.plot(
                *means.T, linestyle="none", marker="P", color=shade, markersize=4.5,
                markeredgewidth=0.0, zorder=2.0, label="expected places" if first else None,
            )  # fmt: skip
        label = "kept out of, in the shade of its step" if first else None
        rims = [rim[i] for rim in found.values()]
        if rims and size == 2:
            polygons(
                panel, rims, facecolor=(shade, 0.04), edgecolor=shade, linewidth=1.1, zorder=1.8,
                gid=f"kept out of at step {step + 1}", label=label,
            )  # fmt: skip
        for skin in rims if size == 3 else ():
            panel.plot_wireframe(
                *np.moveaxis(skin, -1, 0), color=shade, linewidth=0.35, rcount=9, ccount=9,
                label=label,
            )  # fmt: skip
            label = None
        seen += [rim.reshape(-1, size) for rim in rims]
    return np.concatenate(seen)


def draw_situation(panel: Any, plan: Plan) -> Array:
    """Draw the path, what stands still and the robot; return points that have to be seen."""
    situation, start = plan.situation, plan.positions[0]
    size = len(start)
    route = situation.path.points if situation and situation.path else plan.reference
    panel.plot(*route.T, "-", color="0.7", linewidth=0.9, zorder=1.0, label="path")
    if situation is None:
        panel.plot(*start[:, None], "o", color=BLACK, markersize=5, label="robot")
        return np.asarray(start[None])
    if size == 3:
        skin = start + situation.radius * sphere(17)
        panel.plot_surface(*np.moveaxis(skin, -1, 0), color=BLACK, alpha=0.5, linewidth=0)
        panel.plot([], [], "o", color=BLACK, alpha=0.5, label="robot")
        return np.asarray(skin.reshape(-1, 3))
    walls = [one.points for one in situation.polygons]
    if walls:
        polygons(panel, walls, **WALL)
    body = body_outlines(start, situation.heading, situation.radius, situation.footprint)
    polygons(panel, body, facecolor="white", edgecolor=BLACK, linewidth=1.0, zorder=2.3,
             label="robot")  # fmt: skip
    ahead = np.array([np.cos(situation.heading), np.sin(situation.heading)])
    nose = np.stack([start, start + situation.radius * ahead])
    panel.plot(*nose.T, "-", color=BLACK, linewidth=1.6, zorder=2.4)
    return np.asarray(np.concatenate([np.zeros((0, 2)), *body]))


def write_times(panel: Any, places: Array, times: Array, apart: float) -> None:
    """Write a time ahead beside each place, those alone that are so many metres apart."""
    last = np.full(2, np.inf)
    for place, time in zip(places[::-1], times[::-1], strict=True):
        if np.linalg.norm(place - last) > apart:
            last = place
            panel.annotate(
                f"{time:.3g} s", place, (4.0, 4.0), textcoords="offset points", color="0.15",
                zorder=3.0, **halo(),
            )  # fmt: skip
