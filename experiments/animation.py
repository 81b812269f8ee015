"""An episode at one instant, and the film of all instants.

`wideberth.experiments.drawing` draws with the same pieces. Positions of three coordinates are
seen from above (x and y).
"""

import io
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from wideberth.experiments.plotting import COLOURS, LINES, paper_style
from wideberth.framework.arrays import Array, positive, probability
from wideberth.framework.forecast import Forecast
from wideberth.framework.metrics import approach
from wideberth.framework.plan import Plan
from wideberth.simulation.log import AgentLog, Episode

if TYPE_CHECKING:
    from PIL.Image import Image

_MARKERS = ("o", "s", "^", "D", "v")
_CYCLE = (1, 2, 3, 5, 0)  # of COLOURS and LINES; pink is kept for forecasts
_EVERY = 3  # steps from one drawn forecast region to the next in the film
_REST = 1500  # ms that the last frame stays


class Look(NamedTuple):
    """How one agent is drawn."""

    color: str
    linestyle: Any
    marker: str


def looks(episode: Episode) -> dict[str, Look]:
    """Colour, line and marker of each agent; bystanders share one grey."""
    found = {log.name: Look("0.55", (0, (1, 1)), ".") for log in episode.agents}
    for i, log in enumerate(episode.robots):
        place = _CYCLE[i % len(_CYCLE)]
        found[log.name] = Look(COLOURS[place], LINES[place], _MARKERS[i % len(_MARKERS)])
    return found


def pairs(episode: Episode) -> list[tuple[AgentLog, AgentLog]]:
    """All pairs of agents of which at least one is a robot."""
    return [p for p in combinations(episode.agents, 2) if "robot" in (p[0].kind, p[1].kind)]


def plan_at(log: AgentLog, time: float) -> Plan | None:
    """Return the plan that a robot followed at a time, s; its first one before that."""
    stamps = [plan.stamp for plan in log.plans]
    if not stamps:
        return None
    return log.plans[max(int(np.searchsorted(stamps, time + 1e-9)) - 1, 0)]


def nose(episode: Episode, log: AgentLog, time: float) -> Array:
    """Line from the centre to the rim along the heading, (2, 2), m; NaN without a heading."""
    place = episode.at(log, np.array([time]))[0, :2]
    heading = log.headings[max(int(np.searchsorted(episode.times, time + 1e-9)) - 1, 0)]
    return np.stack([place, place + log.radius * np.array([np.cos(heading), np.sin(heading)])])


def outlines(forecast: Forecast | None, tail: float, count: int = 96, every: int = 1) -> Array:
    """Outlines of the forecast's content regions, one per obstacle, mode and step.

    With D coordinates, mean mu, covariance Sigma and content 1 - tail the region is::

        (x - mu)^T Sigma^-1 (x - mu) <= q,    P(chi^2_D > q) = tail

    and its outline from above is mu + sqrt(q) L (cos t, sin t), where L L^T is the block of
    Sigma for x and y. Modes of weight 0 are left out.

    Parameters
    ----------
    forecast : as in the plan; None gives no outlines.
    tail : 1 - content, in (0, 1).
    count : points of an outline.
    every : draw every so manieth step only, the last one among them.

    Returns
    -------
    (K, count, 2), m.
    """
    from scipy.special import gammainccinv

    if forecast is None:
        return np.zeros((0, count, 2))
    kept = forecast.weight > 0
    steps = slice((forecast.steps - 1) % every, None, every)
    centre = forecast.mean[kept][:, steps, :2].reshape(-1, 2)
    blocks = forecast.covariance[kept][:, steps, :2, :2].reshape(-1, 2, 2)
    values, vectors = np.linalg.eigh(blocks)
    quantile = 2.0 * float(gammainccinv(0.5 * forecast.mean.shape[-1], tail))
    root = vectors * np.sqrt(quantile * np.clip(values, 0.0, None))[:, None, :]
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return np.asarray(centre[:, None] + np.swapaxes(root @ circle, 1, 2))


def extent(episode: Episode) -> tuple[Array, Array]:
    """Corners of the part of the world in which the robots and their paths are, (2,) each, m."""
    points = [log.positions[:, :2] for log in episode.robots]
    points += [path.points[:, :2] for log in episode.robots for _, path in log.paths]
    every, margin = np.concatenate(points), max(log.radius for log in episode.agents) + 0.6
    low, high = np.nanmin(every, axis=0) - margin, np.nanmax(every, axis=0) + margin
    beside = 0.8 if len(episode.agents) > len(episode.robots) else 0.4  # where others move
    span = np.maximum(high - low, beside * max(high - low))
    return 0.5 * (low + high - span), 0.5 * (low + high + span)


def frame(panel: Any, low: Array, high: Array) -> None:
    """Set limits, equal scale and grid on both axes, and their labels."""
    from matplotlib.ticker import MultipleLocator

    panel.set_xlim(low[0], high[0])
    panel.set_ylim(low[1], high[1])
    panel.set_aspect("equal")
    steps = np.outer(10.0 ** np.arange(-3, 6), (1.0, 2.0, 5.0)).ravel()
    step = steps[np.argmin(np.abs(np.log(steps * 8.0 / max(high - low))))]
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_locator(MultipleLocator(step))
    panel.set_xlabel("x (m)")
    panel.set_ylabel("y (m)")


def courses(panel: Any, episode: Episode) -> None:
    """Draw the robots' reference paths, their starts and their goals."""
    styles = looks(episode)
    for log in episode.robots:
        hollow = {"linestyle": "none", "markerfacecolor": "none", "color": styles[log.name].color}
        for _, path in log.paths:
            panel.plot(*path.points[:, :2].T, "-", color="0.75", linewidth=0.7)
            panel.plot(*path.points[0, :2], marker="o", markersize=7, **hollow)
            panel.plot(*path.goal[:2], marker="x", markersize=5, **hollow)
    panel.plot([], [], "-", color="0.75", linewidth=0.7, label="reference path")
    for label, marker in (("start", "o"), ("goal", "x")):
        panel.plot([], [], marker, color="0.3", markerfacecolor="none", label=label)


def animate(
    episode: Episode, *, tail: float, rate: float = 10.0, seconds_per_second: float = 4.0
) -> bytes:
    """Return a GIF of the closed loop; the same episode gives the same bytes.

    Discs with their headings, the ways driven so far, each robot's current plan and, in
    the same colour, every third of the forecast regions that it is based on (of content
    1 - tail, before they are enlarged by the radii); the time, the clearance now and the
    smallest one so far, of pairs with at least one robot.

    Parameters
    ----------
    episode : any number of agents.
    tail : 1 - content of the drawn regions.
    rate : frames per second. A GIF counts in hundredths of a second, so that it is rounded
        to 100 / n with a whole n of at least 2; the speed is kept.
    seconds_per_second : seconds of the episode in one second of the film.

    Raises
    ------
    WideberthError : a tail outside (0, 1), a rate or speed not above 0.
    """
    from PIL import Image

    probability("tail", tail)
    positive("rate", rate)
    positive("seconds_per_second", seconds_per_second)
    hundredths = max(round(100.0 / rate), 2)
    step = seconds_per_second * hundredths / 100.0
    times = np.append(np.arange(0.0, episode.duration - 0.5 * step, step), episode.duration)
    with paper_style():
        stage = _Stage(episode, tail, f"{seconds_per_second:g} times real time")
        some = [np.asarray(stage.image(time)) for time in times[:: max(len(times) // 5, 1)]]
        # One palette for all frames keeps still what stands still, and the file small.
        sheet = Image.fromarray(np.concatenate(some))
        palette = sheet.quantize(colors=255, method=Image.Quantize.MAXCOVERAGE, kmeans=3)
        frames = (
            stage.image(time).quantize(palette=palette, dither=Image.Dither.NONE) for time in times
        )
        buffer = io.BytesIO()
        durations = [10 * hundredths] * (len(times) - 1) + [_REST]
        next(frames).save(
            buffer, format="GIF", save_all=True, append_images=frames, duration=durations, loop=0
        )
    return buffer.getvalue()


class _Actor:
    """The moving artists of one agent."""

    def __init__(self, panel: Any, log: AgentLog, look: Look, tail: float) -> None:
        from matplotlib.collections import PolyCollection
        from matplotlib.patches import Circle

        self.log, self.tail = log, tail
        self.shown: Plan | None = None
        self.regions = PolyCollection(
            [], facecolor=(look.color, 0.05), edgecolor=(look.color, 0.7), linewidth=0.6,
            linestyle=look.linestyle,
        )  # fmt: skip
        self.disc = Circle((0, 0), log.radius, facecolor=(look.color, 0.25), edgecolor=look.color)
        (self.trail,) = panel.plot([], [], ls=look.linestyle, color=look.color, lw=0.9)
        (self.nose,) = panel.plot([], [], "-", color=look.color, lw=1.6)
        (self.plan,) = panel.plot([], [], look.marker, color=look.color, ms=2.4)
        panel.add_collection(self.regions, autolim=False)
        panel.add_patch(self.disc)

    def move(self, episode: Episode, time: float) -> None:
        """Bring the artists to where the agent is."""
        log = self.log
        here = episode.at(log, np.array([time]))[0, :2]
        self.disc.set_visible(bool(np.isfinite(here).all()))
        self.disc.set_center(tuple(here))
        self.nose.set_data(*nose(episode, log, time).T)
        before = log.positions[episode.times <= time, :2][::5]
        self.trail.set_data(*np.concatenate([before, here[None]]).T)
        plan = plan_at(log, time)
        if plan is not None and plan is not self.shown:
            self.shown = plan
            self.plan.set_data(*plan.positions[1:, :2].T)
            self.regions.set_verts(list(outlines(plan.forecast, self.tail, 48, _EVERY)))


class _Stage:
    """A figure whose fixed part is drawn once; each frame draws only what moves."""

    def __init__(self, episode: Episode, tail: float, note: str) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        low, high = extent(episode)
        shape = (high[1] - low[1]) / (high[0] - low[0])
        height = float(np.clip(5.0 * shape, 1.2, 4.6)) + 1.25
        self.episode = episode
        self.figure = Figure(figsize=(5.6, height), dpi=120)
        self.canvas = cast(Any, FigureCanvasAgg(self.figure))
        panel = self.panel = self.figure.subplots()
        frame(panel, low, high)
        courses(panel, episode)
        styles = looks(episode)
        self.actors = [_Actor(panel, log, styles[log.name], tail) for log in episode.agents]
        self._legend(styles, tail)
        panel.set_title(" ")  # room for the line above it
        self.text = self.figure.text(0.02, 0.985, "t = 0.0 s", va="top")
        self.figure.text(0.98, 0.985, note, va="top", ha="right")
        self.canvas.draw()
        self.figure.set_layout_engine("none")
        layers = ("regions", "trail", "plan", "disc", "nose")
        self.moving = [getattr(actor, layer) for layer in layers for actor in self.actors]
        self.moving.append(self.text)
        for artist in self.moving:
            artist.set_animated(True)
        self.canvas.draw()
        self.still = self.canvas.copy_from_bbox(self.figure.bbox)
        self.gaps = _gaps(episode)

    def image(self, time: float) -> "Image":
        """Draw the frame at a time, s."""
        from PIL import Image

        for actor in self.actors:
            actor.move(self.episode, time)
        self.text.set_text(self._words(time))
        self.canvas.restore_region(self.still)
        for artist in self.moving:
            self.figure.draw_artist(artist)
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3])

    def _words(self, time: float) -> str:
        """Time, clearance now, and the smallest one so far."""
        index = int(np.searchsorted(self.episode.times, time + 1e-9)) - 1
        now, least = self.gaps[:, max(index, 0)]
        text = f"t = {time:.1f} s"
        if np.isfinite(now):
            text += f",  clearance {now:.2f} m"
        return f"{text} (smallest so far {least:.2f} m)" if np.isfinite(least) else text

    def _legend(self, styles: dict[str, Look], tail: float) -> None:
        """Say what is what; bystanders share one entry."""
        for actor in self.actors:
            robot = actor.log.kind == "robot"
            name = f"{actor.log.name} and its plan" if robot else "others"
            if name not in self.panel.get_legend_handles_labels()[1]:
                self.panel.plot([], [], label=name, **styles[actor.log.name]._asdict())
        self.actors[0].regions.set_label(f"forecast of others, {100 * (1 - tail):g} %")
        self.figure.legend(loc="outside lower center", ncols=3)


def _gaps(episode: Episode) -> Array:
    """Clearance at each logged instant and smallest one until then, (2, T), m; NaN if none."""
    gaps = np.full((2, len(episode.times)), np.nan)
    for a, b in pairs(episode):
        apart = np.linalg.norm(a.positions - b.positions, axis=1) - a.radius - b.radius
        between = approach(a.positions, b.positions) - a.radius - b.radius
        gaps[0] = np.fmin(gaps[0], apart)
        gaps[1] = np.fmin(gaps[1], np.fmin(apart, np.append(np.nan, between)))
    return np.stack([gaps[0], np.fmin.accumulate(gaps[1])])
