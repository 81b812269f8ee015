"""Pictures of one episode: what each robot saw and planned, and where all of them drove.

Positions of three coordinates are drawn from above (x and y).
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from ...draw.style import BLACK, FORECAST, OTHER, PLANNED, REFERENCE, shades
from ...framework.mpc.planner.planner import Planner
from ...framework.values.arrays import Array, positive, probability
from ...framework.values.errors import WideberthError
from ...framework.values.plan import Plan, Rung
from ...simulation.drawing import artists
from ...simulation.drawing.pictures import draw_ways, once
from ...simulation.log.episode_log import AgentLog, Episode
from .beliefs import Beliefs, belief_at, beliefs_of, draw_belief, magnified
from .kept_out import kept_out_of
from .plotting import COLUMN, PAGE, paper_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_EVERY = 3  # steps from one drawn region to the next
_ORDER = (
    *("reference path", "reference points", "planned positions", "kept out of"),
    *("asked content", "robot and its trail", "obstacle", "static"),
    *("points of the scan", "body as it is tracked", "ellipse of"),
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

    Of robots with sensors each panel has the newest scan and the tracks at that stamp, with their
    identities, over what really is there, in grey.

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
    beliefs = beliefs_of(episode)
    with paper_style():
        figure = Figure()
        panels = figure.subplots(1, 2)
        boxes = [
            _view(panel, episode, log, moment, tail, planner, beliefs)
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
        draw_ways(panel, episode, low, high)
        figure.legend(loc="outside lower center", ncols=2)
    return figure


def _view(
    panel: Any,
    episode: Episode,
    ego: AgentLog,
    moment: float,
    tail: float,
    planner: Planner | None,
    beliefs: Beliefs,
) -> tuple[Array, Array]:
    """Draw one robot's view; return the corners of what has to be seen."""
    plan = artists.plan_at(ego, moment)
    time = moment if plan is None else plan.stamp
    path = [path for begin, path in ego.paths if begin <= time + 1e-9][-1]
    panel.plot(*path.points[:, :2].T, "-", color=REFERENCE, linewidth=0.7, label="reference path")
    artists.walls(panel, episode)
    belief = belief_at(beliefs.get(ego.name, ()), time)
    seen = [_world(panel, episode, ego, time, belief is not None)]
    if plan is not None:
        kept = _kept_out(panel, episode, ego, plan, planner)
        seen += [*kept, *_intention(panel, plan, tail)]
    if belief is not None:
        seen.append(draw_belief(panel, belief, OTHER, tail, magnified(beliefs, tail)))
    panel.set_title(_title(ego, plan, time, tail))
    points = np.concatenate(seen)
    return points.min(axis=0) - 0.3, points.max(axis=0) + 0.3


def _steps(plan: Plan) -> list[int]:
    """Return the steps whose regions are drawn, from 0: the last and every third before it."""
    count = len(plan.inputs)
    return list(range((count - 1) % _EVERY, count, _EVERY))


def _kept_out(
    panel: Any, episode: Episode, ego: AgentLog, plan: Plan, planner: Planner | None
) -> list[Array]:
    """Draw what the plan keeps out of, with the time ahead of each step; return all outlines."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patheffects import withStroke

    steps = _steps(plan)
    found = {} if planner is None else kept_out_of(episode, ego, plan, planner, steps)
    if not found:
        return []
    rims = np.stack(list(found.values()))
    for i, (step, shade) in enumerate(zip(steps, shades(len(steps)), strict=True)):
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


def _world(panel: Any, episode: Episode, ego: AgentLog, time: float, believed: bool) -> Array:
    """Draw the discs and the ways driven so far; return the corners of the robots' discs.

    Where ``believed`` others are drawn too, the true ones are grey below them.
    """
    from matplotlib.collections import PolyCollection

    corners = []
    shade, hatch = ("0.45", None) if believed else (OTHER, "/////")
    words = "obstacle as it is, and its trail" if believed else "obstacle and its trail"
    for log in episode.agents:
        here = episode.at(log, np.array([time]))[0, :2]
        before = log.positions[episode.times <= time, :2]
        trail = np.concatenate([before, here[None]])
        own = log is ego
        colour, line = (BLACK, "-") if own else (shade, "--")
        panel.plot(*trail.T, linestyle=line, color=colour, linewidth=1.0)
        if not np.isfinite(here).all():
            continue
        face = "white" if own else (shade, 0.25)
        body = PolyCollection(
            artists.shapes(log, here, artists.heading_at(episode, log, time)), facecolor=face,
            edgecolor=colour, linewidth=0.9, linestyle=line, hatch=None if own else hatch,
            zorder=1.5, label="robot and its trail" if own else once(panel, words),
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
