"""The film of an episode.

Positions of three coordinates are seen from above (x and y).
"""

import io
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ...framework.mpc.planner.planner import Planner
from ...framework.values.arrays import positive, probability
from ...framework.values.plan import Plan
from ...simulation.log.episode_log import AgentLog, Episode
from . import episode_artists as artists
from .kept_out import kept_out_of
from .plotting import paper_style

if TYPE_CHECKING:
    from PIL.Image import Image

_EVERY = 3  # steps from one drawn forecast region to the next in the film
_REST = 1500  # ms that the last frame stays
_NARROWEST = 0.65  # width of the world over its height, so that the header is no wider


def animate(
    episode: Episode,
    *,
    tail: float,
    planner: Planner | None = None,
    rate: float = 10.0,
    seconds_per_second: float = 4.0,
) -> bytes:
    """Return a GIF of the closed loop; the same episode gives the same bytes.

    Discs with their headings, the ways driven so far, each robot's current plan and, in
    the same colour at every third step, what the plan keeps the centre out of (the planner's
    region, enlarged, at the level that the plan holds); pale, the forecast's region of the asked
    content 1 - tail, before it is enlarged by the radii. Above, the time, the clearance now and
    the smallest one so far, of pairs with at least one robot.

    Parameters
    ----------
    episode : any number of agents.
    tail : 1 - content of the pale regions.
    planner : of all robots; None where it is not known, and only the asked content is drawn.
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
        stage = _Stage(episode, tail, planner, f"{seconds_per_second:g} times real time")
        some = [np.asarray(stage.image(time)) for time in times[:: max(len(times) // 5, 1)]]
        # One palette for all frames keeps still what stands still, and the file small.
        sheet = Image.fromarray(np.concatenate(some))
        palette = sheet.quantize(colors=255, method=Image.Quantize.MAXCOVERAGE, kmeans=3)
        colours = np.reshape(palette.getpalette() or (), (-1, 3))
        colours[(colours >= 248).all(axis=1)] = 255  # paper stays white: Pillow rounds to four
        palette.putpalette(colours.ravel().tolist())
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

    def __init__(
        self, panel: Any, log: AgentLog, look: artists.Look, tail: float, planner: Planner | None
    ) -> None:
        from matplotlib.collections import PolyCollection

        self.log, self.tail, self.planner = log, tail, planner
        self.shown: Plan | None = None
        self.asked = PolyCollection(
            [], facecolor=(look.color, 0.07), edgecolor=(look.color, 0.2), linewidth=0.5
        )
        self.kept = PolyCollection([], facecolor="none", edgecolor=look.color, linewidth=0.8)
        self.body = PolyCollection([], facecolor=(look.color, 0.25), edgecolor=look.color)
        (self.trail,) = panel.plot([], [], ls=look.linestyle, color=look.color, lw=0.9)
        (self.nose,) = panel.plot([], [], "-", color=look.color, lw=1.6)
        (self.plan,) = panel.plot([], [], look.marker, color=look.color, ms=2.4)
        (self.marks,) = panel.plot([], [], look.marker, color=look.color, ms=4.4)
        panel.add_collection(self.asked, autolim=False)
        panel.add_collection(self.kept, autolim=False)
        panel.add_collection(self.body, autolim=False)

    def move(self, episode: Episode, time: float) -> None:
        """Bring the artists to where the agent is."""
        log = self.log
        here = episode.at(log, np.array([time]))[0, :2]
        there = bool(np.isfinite(here).all())
        heading = artists.heading_at(episode, log, time)
        self.body.set_verts(artists.shapes(log, here, heading) if there else [])
        self.nose.set_data(*artists.nose(episode, log, time).T)
        before = log.positions[episode.times <= time, :2][::5]
        self.trail.set_data(*np.concatenate([before, here[None]]).T)
        plan = artists.plan_at(log, time)
        if plan is not None and plan is not self.shown:
            self.shown = plan
            self.plan.set_data(*plan.positions[1:, :2].T)
            self.asked.set_verts(list(artists.outlines(plan.forecast, self.tail, 48, _EVERY)))
            if self.planner is not None:
                steps = list(range((len(plan.inputs) - 1) % _EVERY, len(plan.inputs), _EVERY))
                self.marks.set_data(*plan.positions[1:, :2][steps].T)
                found = kept_out_of(episode, log, plan, self.planner, steps)
                self.kept.set_verts([rim for rims in found.values() for rim in rims])


class _Stage:
    """A figure whose fixed part is drawn once; each frame draws only what moves."""

    def __init__(self, episode: Episode, tail: float, planner: Planner | None, note: str) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        low, high = artists.extent(episode)
        missing = max(_NARROWEST * (high[1] - low[1]) - (high[0] - low[0]), 0.0)
        low[0], high[0] = low[0] - 0.5 * missing, high[0] + 0.5 * missing
        shape = (high[1] - low[1]) / (high[0] - low[0])
        height = float(np.clip(5.0 * shape, 1.2, 4.6)) + 1.45
        self.episode = episode
        now = artists.clearance_over_time(episode)
        self.clearance = np.stack([now, np.fmin.accumulate(now)])
        self.figure = Figure(figsize=(5.6, height), dpi=120)
        self.canvas = cast(Any, FigureCanvasAgg(self.figure))
        panel = self.panel = self.figure.subplots()
        artists.frame(panel, low, high)
        artists.walls(panel, episode)
        artists.courses(panel, episode)
        styles = artists.looks(episode)
        self.actors = [
            _Actor(panel, log, styles[log.name], tail, planner) for log in episode.agents
        ]
        self._legend(styles, tail)
        self.note = note
        self.text = panel.set_title(self._words(0.0), loc="left")
        self.canvas.draw()
        self.figure.set_layout_engine("none")
        layers = ("asked", "kept", "trail", "plan", "marks", "body", "nose")
        self.moving = [getattr(actor, layer) for layer in layers for actor in self.actors]
        self.moving.append(self.text)
        for artist in self.moving:
            artist.set_animated(True)
        self.canvas.draw()
        self.still = self.canvas.copy_from_bbox(self.figure.bbox)

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
        """Time and speed of the film; below, the clearance now and the smallest one so far."""
        index = int(np.searchsorted(self.episode.times, time + 1e-9)) - 1
        now, least = self.clearance[:, max(index, 0)]
        words = [f"clearance {now:.2f} m"] if np.isfinite(now) else []
        words += [f"smallest so far {least:.2f} m"] if np.isfinite(least) else []
        return f"t = {time:.1f} s, {self.note}\n{', '.join(words)}"

    def _legend(self, styles: dict[str, artists.Look], tail: float) -> None:
        """Say what is what; bystanders share one entry."""
        for actor in self.actors:
            robot = actor.log.kind == "robot"
            name = f"{actor.log.name} and its plan" if robot else "others"
            if name not in self.panel.get_legend_handles_labels()[1]:
                self.panel.plot([], [], label=name, **styles[actor.log.name]._asdict())
        first = next((one for one in self.actors if one.log.plans), None)
        if first is not None and first.planner is not None:
            first.kept.set_label("kept out of at the large marks")
        if first is not None:
            first.asked.set_label(f"asked content {100 * (1 - tail):g} %, not enlarged")
        self.figure.legend(loc="outside lower center", ncols=3)
