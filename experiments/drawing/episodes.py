"""Pictures of one episode: what each robot saw and planned, and where all of them drove.

Positions of three coordinates are drawn from above (x and y).
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from ...framework.mpc.planner.planner import Planner
from ...framework.values.arrays import Array, positive, probability
from ...framework.values.errors import WideberthError
from ...framework.values.plan import Plan, Rung
from ...simulation.log.episode_log import AgentLog, Episode
from . import episode_artists as artists
from .episode_artists import mark_closest
from .kept_out import kept_out_of
from .plotting import COLOURS, COLUMN, PAGE, paper_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BLACK, PLANNED, OTHER, REFERENCE, FORECAST = COLOURS[:5]
"""The paper's colours: green reference, blue plan, pink forecast."""

_MARK = 5.0  # s between two time marks
_EVERY = 3  # steps from one drawn region to the next
_ORDER = (
    *("reference path", "reference points", "planned positions", "kept out of"),
    *("asked content", "robot and its trail", "obstacle and its trail", "static"),
)


def draw_views(
    episode: Episode, *, distance: float, tail: float, planner: Planner | None = None
) -> "Figure":
    """Draw both robots' views of an encounter, as in the paper's section on results.

    One panel per robot, at the stamp of the plan that it followed when the two centres first
    came within ``distance`` (or were closest, if they never did): its reference path and the
    reference points over the horizon, the planned positions, and at every third step, in the
    shade of the position of that step and with its time ahead, what the plan keeps the
    centre out of: the planner's own region, enlarged by both radii and its margin, at the level
    that the plan holds. Pale behind it stands the forecast's region of content 1 - tail at those
    steps, before the enlargement: what was asked. Both panels have the same scale.

    The paper's figures show the regions before the enlargement, of a content that it does not
    give, while its plans choose a level of their own, so that plans cut through what is drawn.
    The title says what content the plan holds (the smallest over steps and obstacles).

    Parameters
    ----------
    episode : of two robots; others may be there too.
    distance : m between the centres.
    tail : 1 - content of the pale regions.
    planner : of both robots; None where it is not known, and only the asked content is drawn.

    Raises
    ------
    WideberthError : not two robots, a distance not above 0, a tail outside (0, 1).
    """
    from matplotlib.figure import Figure

    positive("distance", distance)
    probability("tail", tail)
    if len(episode.robots) != 2:
        names = [log.name for log in episode.robots]
        raise WideberthError(
            f"views are drawn for two robots; this episode has {len(names)}: {names}. Draw "
            "the run instead"
        )
    first, second = episode.robots
    apart = np.linalg.norm(first.positions - second.positions, axis=1)
    near = np.flatnonzero(apart <= distance)
    moment = float(episode.times[near[0] if near.size else np.argmin(apart)])
    with paper_style():
        figure = Figure()
        panels = figure.subplots(1, 2)
        boxes = [
            _view(panel, episode, log, moment, tail, planner)
            for panel, log in zip(panels, episode.robots, strict=True)
        ]
        span = np.max([high - low for low, high in boxes], axis=0)
        for panel, (low, high) in zip(panels, boxes, strict=True):
            artists.frame(panel, 0.5 * (low + high - span), 0.5 * (low + high + span))
        width = 0.5 * PAGE - 0.5
        figure.set_size_inches(PAGE, width * min(span[1] / span[0], 1.4) + 1.4)
        _legend(figure, panels)
    return figure


def draw_run(episode: Episode) -> "Figure":
    """Draw where all agents drove, with a mark every 5 s and the closest approach.

    Robots have a colour, line and marker each; recorded and scripted agents are grey and
    dotted. The closest approach is that of the pair with the smallest clearance of which at
    least one is a robot: both discs, the line between the centres, and the number.
    """
    from matplotlib.figure import Figure

    with paper_style():
        figure = Figure()
        panel = figure.subplots()
        low, high = artists.extent(episode)
        span = high - low
        figure.set_size_inches(COLUMN, min(2.98 * span[1] / span[0], 3.6) + 1.0)
        artists.frame(panel, low, high)
        artists.walls(panel, episode)
        artists.courses(panel, episode)
        styles = artists.looks(episode)
        for log in episode.agents:
            _way(panel, episode, log, styles[log.name])
        taken = mark_closest(panel, episode)
        write_times(panel, episode, taken, _MARK)
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _view(
    panel: Any,
    episode: Episode,
    ego: AgentLog,
    moment: float,
    tail: float,
    planner: Planner | None,
) -> tuple[Array, Array]:
    """Draw one robot's view; return the corners of what has to be seen."""
    plan = artists.plan_at(ego, moment)
    time = moment if plan is None else plan.stamp
    path = [path for begin, path in ego.paths if begin <= time + 1e-9][-1]
    panel.plot(*path.points[:, :2].T, "-", color=REFERENCE, linewidth=0.7, label="reference path")
    artists.walls(panel, episode)
    seen = [_world(panel, episode, ego, time)]
    if plan is not None:
        kept = _kept_out(panel, episode, ego, plan, planner)
        seen += [*kept, *_intention(panel, plan, tail)]
    panel.set_title(_title(ego, plan, time, tail))
    points = np.concatenate(seen)
    return points.min(axis=0) - 0.3, points.max(axis=0) + 0.3


def _steps(plan: Plan) -> list[int]:
    """Return the steps whose regions are drawn, from 0: the last and every third before it."""
    count = len(plan.inputs)
    return list(range((count - 1) % _EVERY, count, _EVERY))


def _shades(plan: Plan) -> list[tuple[float, float, float]]:
    """One shade per drawn step, darker the later, so that grey print tells them apart too."""
    count = len(_steps(plan))
    pale, dark = np.array([0.86, 0.56, 0.72]), np.array([0.30, 0.03, 0.22])
    shares = np.linspace(0.0, 1.0, count)[:, None]
    return [tuple(one) for one in (1.0 - shares) * pale + shares * dark]


def _kept_out(
    panel: Any, episode: Episode, ego: AgentLog, plan: Plan, planner: Planner | None
) -> list[Array]:
    """Draw what the plan keeps out of, with the time ahead of each step; return all outlines."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patheffects import withStroke

    steps, shades = _steps(plan), _shades(plan)
    found = {} if planner is None else kept_out_of(episode, ego, plan, planner, steps)
    if not found:
        return []
    rims = np.stack(list(found.values()))
    for i, (step, shade) in enumerate(zip(steps, shades, strict=True)):
        panel.add_collection(
            PolyCollection(
                list(rims[:, i]), facecolor="none", edgecolor=shade, linewidth=1.1, zorder=1.8,
                gid=f"kept out of at step {step + 1}",
                label=None if i else "kept out of, in the shade of its step",
            ),
            autolim=False,
        )  # fmt: skip
        place = plan.positions[step + 1, :2]
        panel.plot(
            *place, "s", color=shade, markersize=5.0, markeredgecolor="black",
            markeredgewidth=0.5, zorder=2.6,
        )  # fmt: skip
        panel.annotate(
            f"{plan.dt * (step + 1):g} s", place, (4.0, 4.0), textcoords="offset points",
            fontsize=6, color=shade, zorder=3.0,
            path_effects=[withStroke(linewidth=1.5, foreground="white")],
        )  # fmt: skip
    return [rims.reshape(-1, 2)]


def _intention(panel: Any, plan: Plan, tail: float) -> list[Array]:
    """Draw what the robot expects and means to do."""
    from matplotlib.collections import PolyCollection

    regions = artists.outlines(plan.forecast, tail, every=_EVERY)
    panel.add_collection(
        PolyCollection(
            list(regions), facecolor=(FORECAST, 0.08), edgecolor=(FORECAST, 0.35),
            linewidth=0.5, zorder=0.9, label=f"asked content {100 * (1 - tail):g} %, not enlarged",
        ),
        autolim=False,
    )  # fmt: skip
    reference, planned = plan.reference[:, :2], plan.positions[1:, :2]
    panel.plot(
        *reference.T, "o", color=REFERENCE, markersize=3.6, markerfacecolor="white",
        markeredgewidth=0.9, label="reference points",
    )  # fmt: skip
    panel.plot(
        *planned.T, "s-", color=PLANNED, markersize=2.6, linewidth=0.7, label="planned positions"
    )
    return [regions.reshape(-1, 2), reference, planned]


def _world(panel: Any, episode: Episode, ego: AgentLog, time: float) -> Array:
    """Draw the discs and the ways driven so far; return the corners of the robots' discs."""
    from matplotlib.collections import PolyCollection

    corners = []
    for log in episode.agents:
        here = episode.at(log, np.array([time]))[0, :2]
        before = log.positions[episode.times <= time, :2]
        trail = np.concatenate([before, here[None]])
        own = log is ego
        colour, line = (BLACK, "-") if own else (OTHER, "--")
        panel.plot(*trail.T, linestyle=line, color=colour, linewidth=1.0)
        if not np.isfinite(here).all():
            continue
        face = "white" if own else (OTHER, 0.25)
        body = PolyCollection(
            artists.shapes(log, here, artists.heading_at(episode, log, time)), facecolor=face,
            edgecolor=colour, linewidth=0.9, linestyle=line, hatch=None if own else "/////",
            zorder=1.5,
            label="robot and its trail" if own else _once(panel, "obstacle and its trail"),
        )  # fmt: skip
        panel.add_collection(body, autolim=False)
        panel.plot(*artists.nose(episode, log, time).T, "-", color=colour, linewidth=2.0)
        if log.kind == "robot":
            corners += [here - log.radius, here + log.radius]
    return np.array(corners).reshape(-1, 2)


def _legend(figure: Any, panels: Any) -> None:
    """One legend for both panels, related entries one below the other."""
    entries: dict[str, Any] = {}
    for panel in panels:
        entries.update(zip(*panel.get_legend_handles_labels()[::-1], strict=True))
    names = sorted(entries, key=_rank)
    handles = [entries[name] for name in names]
    figure.legend(handles, names, loc="outside lower center", ncols=3)


def _rank(label: str) -> int:
    """Place of an entry in the legend."""
    return next(i for i, start in enumerate(_ORDER) if label.startswith(start))


def _once(panel: Any, label: str) -> str | None:
    """Return the label, unless the panel has it already."""
    return None if label in panel.get_legend_handles_labels()[1] else label


def _title(ego: AgentLog, plan: Plan | None, time: float, tail: float) -> str:
    head = f"{ego.name} robot's view, t = {time:.2f} s\n"
    if plan is None:
        return f"{head}no plan"
    content = plan.lowest_content
    name = "plan" if plan.rung is Rung.OPTIMAL else str(plan.rung)
    if not np.isfinite(content):
        return f"{head}{name} without obstacles"
    percent = f"{100 * content:.0f} %" if content >= 0.01 else "less than 1 %"
    return f"{head}{name} holds {percent} content, {100 * (1 - tail):g} % asked"


def _way(panel: Any, episode: Episode, log: AgentLog, look: artists.Look) -> None:
    """Draw where one agent drove, with a mark every 5 s."""
    if log.kind == "robot":
        label: str | None = f"{log.name}, marks every {_MARK:g} s"
    else:
        label = _once(panel, "replayed" if log.kind == "replay" else log.kind)
    marks = episode.at(log, np.arange(_MARK, episode.duration, _MARK))
    panel.plot(*log.positions[:, :2].T, color=look.color, linestyle=look.linestyle)
    panel.plot(*marks[:, :2].T, look.marker, color=look.color, markersize=3)
    panel.plot(
        [], [], look.marker, color=look.color, linestyle=look.linestyle, markersize=3, label=label
    )


def write_times(panel: Any, episode: Episode, taken: Array, every: float) -> None:
    """Write the time at the robots' marks where there is room; elsewhere the mark stands alone.

    Parameters
    ----------
    panel : about 3 inches along its longer side, with its limits set.
    taken : (K, 2), m, points that labels had better keep clear of, beside the robots' ways.
    every : s between two marks.
    """
    from matplotlib.patheffects import withStroke

    styles = artists.looks(episode)
    ways = [log.positions[::10, :2] for log in episode.robots]
    taken = np.concatenate([taken, *ways])
    corners = np.array([panel.get_xlim(), panel.get_ylim()]).T
    span = float((corners[1] - corners[0]).max())
    # Half the size of a label in the panel's units: 215 points along the longer side.
    half = 0.5 * span / 215.0 * np.array([3.6 * len(f"{episode.duration:.0f} s") + 1.5, 7.5])
    boxes = np.zeros((0, 2))
    times = np.arange(every, episode.duration, every)
    for log in episode.robots:
        places = episode.at(log, times)[:, :2]
        last = log.positions[0, :2]
        for time, place in zip(times, places, strict=True):
            if np.linalg.norm(place - last) < 0.03 * span:  # the marks are one upon the other
                continue
            last = place
            chosen = _spot(place, half, boxes, taken, corners)
            if chosen is None:
                continue
            boxes = np.concatenate([boxes, chosen[None]])
            panel.text(
                *chosen, f"{time:g} s", ha="center", va="center", fontsize=6,
                color=styles[log.name].color, zorder=3,
                path_effects=[withStroke(linewidth=1.5, foreground="white")],
            )  # fmt: skip


def _spot(place: Array, half: Array, boxes: Array, taken: Array, corners: Array) -> Array | None:
    """Choose the middle of a label beside a mark, off other labels; None without room.

    Parameters
    ----------
    place : (2,), of the mark.
    half : (2,), half the size of a label.
    boxes : (K, 2), middles of the labels that are there.
    taken : (M, 2), points that it had better keep clear of.
    corners : (2, 2), of the panel, lower left and upper right.
    """
    angles = np.arange(16) * np.pi / 8.0
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    spots = np.concatenate([place + reach * half * rays for reach in (1.7, 2.3)])
    inside = np.all((spots - half >= corners[0]) & (spots + half <= corners[1]), axis=1)
    apart = np.all((np.abs(spots[:, None] - boxes) >= 2.0 * half).any(axis=2), axis=1)
    free = inside & apart
    if not free.any():
        return None
    covered = np.all(np.abs(spots[:, None] - taken) < half, axis=2).sum(axis=1)
    return np.asarray(spots[int(np.argmin(np.where(free, covered, np.inf)))])
