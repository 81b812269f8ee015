"""The film of an episode.

Positions of three coordinates are seen from above (x and y).
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ...draw.plans import kept_out
from ...draw.style import is_seen, number, paper_style
from ...framework.values.arrays import Array, positive
from ...framework.values.errors import WideberthError
from ...framework.values.plan import Plan
from . import artists
from .logged import DrawnAgent, Logged
from .saving import film_of

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure

Regions: TypeAlias = Callable[[DrawnAgent, Plan, list[int]], Mapping[tuple[int, int], Array]]
"""Agent, plan and steps -> outlines of what the plan keeps out of, see `kept_out`."""

_EVERY = 3  # steps from one drawn forecast region to the next in the film
_NARROWEST = 0.65  # width of the world over its height, so that the header is no wider


def animation(
    episode: Logged, *, live: bool, tail: float, rate: float, speed: float
) -> "FuncAnimation":
    """Return the film of an episode as matplotlib's animation; see `Episode.animate`."""
    from matplotlib.figure import Figure

    positive("rate", rate)
    positive("speed", speed)
    times = np.append(np.arange(0.0, episode.duration, speed / rate), episode.duration)
    with paper_style():
        if live:
            figure = window()
        else:
            figure = Figure(dpi=120)
            canvas_of(figure)
        stage = FilmStage(figure, episode, tail, own_regions, f"{speed:g} times real time")
    film = film_of(figure, stage.show, list(times), 1000.0 / rate)
    if live:
        figure.show()
    return film


def window() -> "Figure":
    """Return an empty figure that can be shown in a window.

    Raises
    ------
    WideberthError : the session draws without a screen.
    """
    from matplotlib import pyplot

    figure = pyplot.figure(dpi=120)
    if not is_seen(figure):
        pyplot.close(figure)
        raise WideberthError(
            f"matplotlib draws with {pyplot.get_backend()!r}, which opens no window; on a machine "
            "with a screen set MPLBACKEND=TkAgg or QtAgg, or write a film: "
            "episode.animate().save('film.gif')"
        )
    return figure


def own_regions(
    agent: DrawnAgent, plan: Plan, steps: list[int]
) -> Mapping[tuple[int, int], Array]:
    """Outlines of what a plan keeps out of, as far as the plan itself knows; none in space."""
    flat = plan.positions.shape[1] == 2
    return kept_out(plan, plan.situation, steps) if flat else {}


def canvas_of(figure: "Figure") -> Any:
    """Give a figure a canvas without a screen."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    return FigureCanvasAgg(figure)


class Actor:
    """The moving artists of one agent."""

    log: DrawnAgent
    tail: float
    regions: Regions | None
    asked: "PolyCollection"
    kept: "PolyCollection"
    body: "PolyCollection"
    trail: Any
    nose: Any
    plan: Any
    marks: Any

    def __init__(
        self, panel: Any, log: DrawnAgent, look: artists.Look, tail: float, regions: Regions | None
    ) -> None:
        from matplotlib.collections import PolyCollection

        self.log, self.tail, self.regions = log, tail, regions
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

    def move(self, episode: Logged, time: float) -> None:
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
            if self.regions is not None:
                steps = list(range((len(plan.inputs) - 1) % _EVERY, len(plan.inputs), _EVERY))
                self.marks.set_data(*plan.positions[1:, :2][steps].T)
                found = self.regions(log, plan, steps)
                self.kept.set_verts([rim for rims in found.values() for rim in rims])


class FilmStage:
    """A figure of the world at one time, whose moving artists are brought to other times.

    Parameters
    ----------
    figure : an empty one; its size is set.
    episode : any number of agents.
    tail : 1 - content of the pale regions.
    regions : what plans keep out of; None where it is not known.
    note : stands beside the time.
    """

    def __init__(
        self, figure: Any, episode: Logged, tail: float, regions: Regions | None, note: str
    ) -> None:
        low, high = artists.extent(episode)
        missing = max(_NARROWEST * (high[1] - low[1]) - (high[0] - low[0]), 0.0)
        low[0], high[0] = low[0] - 0.5 * missing, high[0] + 0.5 * missing
        shape = (high[1] - low[1]) / (high[0] - low[0])
        figure.set_size_inches(5.6, float(np.clip(5.0 * shape, 1.2, 4.6)) + 1.45)
        self.figure: Any = figure
        self.note: str = note
        panel = figure.subplots()
        self.panel: Any = panel
        self._take(episode)
        artists.frame(panel, low, high)
        artists.walls(panel, episode)
        artists.courses(panel, episode)
        styles = artists.looks(episode)
        self.actors: list[Actor] = [
            Actor(panel, log, styles[log.name], tail, regions) for log in episode.agents
        ]
        self._legend(styles, tail)
        self.text: Any = panel.set_title(self._words(0.0), loc="left", parse_math=False)

    @property
    def moving(self) -> list[Any]:
        """All artists that change, from back to front."""
        layers = ("asked", "kept", "trail", "plan", "marks", "body", "nose")
        return [*(getattr(actor, layer) for layer in layers for actor in self.actors), self.text]

    def show(self, time: float) -> list[Any]:
        """Bring all artists to a time, s; return those that changed."""
        for actor in self.actors:
            actor.move(self.episode, time)
        self.text.set_text(self._words(time))
        return self.moving

    def follow(self, episode: Logged) -> None:
        """Show the end of a longer log of the same agents."""
        self._take(episode)
        for actor, log in zip(self.actors, episode.agents, strict=False):
            actor.log = log
        self.show(episode.duration)

    def _take(self, episode: Logged) -> None:
        self.episode = episode
        now = artists.clearance_over_time(episode)
        self.clearance: Array = np.stack([now, np.fmin.accumulate(now)])

    def _words(self, time: float) -> str:
        """Time and speed of the film; below, the clearance now and the smallest one so far."""
        index = int(np.searchsorted(self.episode.times, time + 1e-9)) - 1
        now, least = self.clearance[:, max(index, 0)]
        words = [f"clearance {number(now, '.2f')} m"] if np.isfinite(now) else []
        words += [f"smallest so far {number(least, '.2f')} m"] if np.isfinite(least) else []
        return f"t = {time:.1f} s, {self.note}\n{', '.join(words)}"

    def _legend(self, styles: dict[str, artists.Look], tail: float) -> None:
        """Say what is what; bystanders share one entry."""
        for actor in self.actors:
            robot = actor.log.kind == "robot"
            name = f"{actor.log.name} and its plan" if robot else "others"
            if name not in self.panel.get_legend_handles_labels()[1]:
                self.panel.plot([], [], label=name, **styles[actor.log.name]._asdict())
        first = next((one for one in self.actors if one.log.plans), None)
        if first is not None and first.regions is not None:
            first.kept.set_label("kept out of at the large marks")
        if first is not None:
            first.asked.set_label(f"asked content {100 * (1 - tail):g} %, not enlarged")
        self.figure.legend(loc="outside lower center", ncols=3)
