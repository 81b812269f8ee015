"""The film of an episode as a file.

Positions of three coordinates are seen from above (x and y).
"""

import io
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...framework.mpc.planner.planner import Planner
from ...framework.values.arrays import Array, positive, probability
from ...framework.values.plan import Plan
from ...simulation.drawing import artists
from ...simulation.drawing.film import FilmStage, canvas_of
from ...simulation.drawing.logged import DrawnAgent
from ...simulation.log.episode_log import Episode
from .beliefs import Onlooker, beliefs_of, explain, magnified
from .kept_out import kept_out_of
from .plotting import paper_style

if TYPE_CHECKING:
    from PIL.Image import Image

_REST = 1500  # ms that the last frame stays


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
        note = f"{seconds_per_second:g} times real time"
        stage = _Frames(episode, tail, planner, note)
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


def _kept_out_of(
    episode: Episode, planner: Planner, log: DrawnAgent, plan: Plan, steps: list[int]
) -> dict[tuple[int, int], Array]:
    return kept_out_of(episode, log, plan, planner, steps)


class _Frames:
    """Images of a stage whose fixed part is drawn once; each draws only what moves."""

    def __init__(self, episode: Episode, tail: float, planner: Planner | None, note: str) -> None:
        from matplotlib.figure import Figure

        regions = None if planner is None else partial(_kept_out_of, episode, planner)

        self.figure = Figure(dpi=120)
        self.canvas = canvas_of(self.figure)
        self.stage = FilmStage(self.figure, episode, tail, regions, note)
        beliefs = beliefs_of(episode)
        looks, scale = artists.looks(episode), magnified(beliefs, tail)
        self.onlookers = [
            Onlooker(self.stage.panel, some, looks[name].color, tail, scale)
            for name, some in beliefs.items()
        ]
        if beliefs:
            still = any(len(one.segments) for some in beliefs.values() for one in some)
            explain(self.figure, tail, scale, still)
            self.figure.draw_without_rendering()  # the layout takes another round
        self.canvas.draw()
        self.figure.set_layout_engine("none")
        believed = [artist for one in self.onlookers for artist in one.moving]
        for artist in (*self.stage.moving, *believed):
            artist.set_animated(True)
        self.canvas.draw()
        self.still = self.canvas.copy_from_bbox(self.figure.bbox)

    def image(self, time: float) -> "Image":
        """Draw the frame at a time, s."""
        from PIL import Image

        moving = list(self.stage.show(time))
        for one in self.onlookers:
            one.show(time)
            moving += one.moving
        self.canvas.restore_region(self.still)
        for artist in moving:
            self.figure.draw_artist(artist)
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())[..., :3])
