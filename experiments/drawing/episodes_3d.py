"""Pictures of one episode in space: where all flew, the closest approach, the clearances."""

from typing import TYPE_CHECKING, Any

import numpy as np

from ...draw import shapes
from ...draw.style import FORECAST, frame_space, number
from ...framework.numerics.chi_square import content_bound
from ...framework.values.arrays import Array, positive, probability
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import GaussianObstacle, resample
from ...framework.values.plan import Plan
from ...simulation.drawing import artists, pictures
from ...simulation.drawing.artists import Closest, closest
from ...simulation.log.episode_log import Episode
from .plotting import COLOURS, LINES, PAGE, paper_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BESIDE = 0.35  # m that the close view shows on each side beyond balls and ellipsoid


def draw_flight(episode: Episode, *, tail: float, lead: float) -> "Figure":
    """Draw an episode in space: the whole volume, the closest approach, and clearances.

    Left, the ways of all agents with their shadows on the floor, and the balls at the
    closest approach. Upper right, the closest approach from near: the two balls, the way
    that the robot planned ``lead`` seconds before, and where it then expected the other,
    the ellipsoid of content 1 - tail of the forecast for just that moment (not enlarged by
    the radii). Lower right, distances between surfaces over time.

    Parameters
    ----------
    episode : of agents that move in three dimensions, at least one pair there together.
    tail : 1 - content of the ellipsoid.
    lead : s from the drawn plan to the closest approach; the first plan where that is too
        early for any.

    Raises
    ------
    WideberthError : agents in the plane, or never together; tail outside (0, 1) or lead
        not above 0.
    """
    from matplotlib.figure import Figure

    probability("tail", tail)
    positive("lead", lead)
    found = closest(episode)
    if found is None or episode.robots[0].positions.shape[1] != 3:
        raise WideberthError(
            "a flight is drawn of agents that meet in three dimensions; draw the run instead"
        )
    with paper_style():
        figure = Figure(figsize=(PAGE, 4.7))
        grid = figure.add_gridspec(2, 2, width_ratios=(1.6, 1.0), height_ratios=(1.6, 1.0))
        whole: Any = figure.add_subplot(grid[:, 0], projection="3d")
        near: Any = figure.add_subplot(grid[0, 1], projection="3d")
        _volume(whole, episode, found)
        _encounter(near, episode, found, tail, lead)
        _clearances(figure.add_subplot(grid[1, 1]), episode, found)
        _legend(figure, (whole, near))
    return figure


def ellipsoid(obstacle: GaussianObstacle, tail: float, count: int = 25) -> Array:
    """Points of the surface of a Gaussian's content region, (count, count, 3), m.

    mu + sqrt(q) L n with L L^T = Sigma, n the unit vectors and q the quantile of chi^2 with
    three degrees of freedom that is exceeded with probability ``tail``.
    """
    return shapes.ellipsoid(obstacle.mean, obstacle.covariance, content_bound(3, tail), count)


def expected(plan: Plan, name: str, time: float) -> GaussianObstacle | None:
    """Where a plan expected an agent at a time, s; None where it did not look as far.

    Of a mixture the heaviest mode.
    """
    forecast, ahead = plan.forecast, time - plan.stamp
    if forecast is None or name not in plan.tracked:
        return None
    if not forecast.dt <= ahead <= forecast.steps * forecast.dt:
        return None
    row = plan.tracked.index(name)
    mode = int(np.argmax(forecast.weight[row]))
    # The origin does not count: the time is not before the first step.
    origin, spread = forecast.mean[:, 0, 0], forecast.covariance[:, 0, 0]
    then = resample(forecast, origin, spread, np.array([ahead]))
    return GaussianObstacle(then.mean[row, mode, 0], then.covariance[row, mode, 0])


def _volume(panel: Any, episode: Episode, found: Closest) -> None:
    """Draw the ways of all agents and their shadows."""
    low, high = pictures.volume(episode)
    frame_space(panel, low, high)
    pictures.draw_ways_in_space(panel, episode, low, high)
    pictures.draw_balls(panel, episode, found.time, low, high)
    panel.set_title(f"all at t = {found.time:.1f} s, the closest approach")


def _encounter(panel: Any, episode: Episode, found: Closest, tail: float, lead: float) -> None:
    """Draw the closest approach: balls, the earlier plan and the earlier forecast."""
    ego, other = found.pair
    styles = artists.looks(episode)
    places = [episode.at(log, np.array([found.time]))[0] for log in found.pair]
    seen = [
        place + side * log.radius
        for place, log in zip(places, found.pair, strict=True)
        for side in (-1.0, 1.0)
    ]
    plan = artists.plan_at(ego, found.time - lead)
    guess = None if plan is None else expected(plan, other.name, found.time)
    if guess is not None:
        surface = ellipsoid(guess, tail)
        seen += [surface.min(axis=(0, 1)), surface.max(axis=(0, 1))]
        label = f"asked content {100 * (1 - tail):g} % of the forecast for then, not enlarged"
        panel.plot_surface(*np.moveaxis(surface, -1, 0), color=FORECAST, alpha=0.25, shade=False)
        panel.plot_wireframe(
            *np.moveaxis(surface, -1, 0), color=FORECAST, linewidth=0.4, rcount=9, ccount=13
        )
        panel.plot([], [], [], "-", color=FORECAST, linewidth=3.0, alpha=0.6, label=label)
    low, high = np.min(seen, axis=0), np.max(seen, axis=0)
    half = 0.5 * float(np.max(high - low)) + _BESIDE
    low, high = 0.5 * (low + high) - half, 0.5 * (low + high) + half
    frame_space(panel, low, high)
    for log, place in zip(found.pair, places, strict=True):
        look = styles[log.name]
        way = pictures.inside(log.positions, low, high)
        panel.plot(*way.T, linestyle=look.linestyle, color=look.color)
        pictures.draw_ball(panel, place, log.radius, look.color)
    title = "near, "
    if plan is not None:
        panel.plot(
            *pictures.inside(plan.positions, low, high).T, "s", color=styles[ego.name].color,
            markersize=2.5, markerfacecolor="white", markeredgewidth=0.7,
            label=f"{ego.name} robot's plan",
        )  # fmt: skip
        title += f"with what was planned {found.time - plan.stamp:.1f} s before"
    panel.set_title(title.removesuffix(", "))


def _clearances(panel: Any, episode: Episode, found: Closest) -> None:
    """Draw each robot's distance to its nearest passer-by, and the robots' to each other."""
    styles = artists.looks(episode)
    gaps: dict[str, Array] = {}
    for first, second in artists.pairs(episode):
        apart = np.linalg.norm(first.positions - second.positions, axis=1)
        apart = apart - first.radius - second.radius
        both = first.kind == second.kind == "robot"
        robot = second if first.kind != "robot" else first
        name = "between robots" if both else robot.name
        gaps[name] = np.fmin(gaps.get(name, np.full(len(apart), np.nan)), apart)
    for name, gap in gaps.items():
        look = styles.get(name)
        color, line = (look.color, look.linestyle) if look else (COLOURS[0], LINES[3])
        label = f"{name} to passers-by" if look else name
        panel.plot(episode.times, gap, color=color, linestyle=line, linewidth=1.0, label=label)
    panel.plot(found.time, found.clearance, "o", color="black", markersize=3.5)
    panel.annotate(
        f"{number(found.clearance, '.2f')} m", (found.time, found.clearance), xytext=(-6, 2),
        ha="right", textcoords="offset points", fontsize=7,
    )  # fmt: skip
    panel.axhline(0.0, color="black", linewidth=0.6)
    panel.set_xlim(0.0, episode.duration)
    panel.set_ylim(-0.2, 5.0)
    panel.set_xlabel("time (s)")
    panel.set_ylabel("clearance (m)")
    panel.legend(
        loc="lower center", bbox_to_anchor=(0.45, 1.03), ncols=2, handlelength=2.2,
        columnspacing=1.0, borderaxespad=0.0, borderpad=0.2,
    )  # fmt: skip


def _legend(figure: Any, panels: tuple[Any, Any]) -> None:
    """One legend below both views in space."""
    entries: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=4)
