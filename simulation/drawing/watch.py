"""A window that shows episodes while they run."""

from time import monotonic
from typing import Any, Protocol

from ...draw.style import paper_style
from . import film
from .logged import Logged


class Running(Protocol):
    """An episode that goes on, see `wideberth.simulation.engine.episode.Run`."""

    clock: list[float]

    def episode(self) -> Logged:
        """Return the log up to now."""
        ...


class WatchWindow:
    """Shows the newest instant of the episode that runs, as `Episode.animate` does.

    Drawing takes at most half of the time: pictures are left out where it is slow. Closing the
    window ends the showing; the run goes on. What is measured does not change.

    Parameters
    ----------
    tail : 1 - content of the pale regions.
    every : s of the episode from one picture to the next.

    Raises
    ------
    WideberthError : the session draws without a screen.
    """

    def __init__(self, tail: float = 0.05, every: float = 0.1) -> None:
        self.tail: float = tail
        self.every: float = every
        self.figure: Any = film.window()
        self.figure.show()
        self.run: Running | None = None
        self.stage: film.FilmStage | None = None
        self.shown: float = 0.0
        self.open: bool = True
        self.next: float = 0.0  # s of the clock that runs on: not before this
        self.figure.canvas.mpl_connect("close_event", self._close)

    def __call__(self, run: Running) -> None:
        """Show a run, if enough time has passed in it since the last picture."""
        if not self.open or (run is self.run and run.clock[-1] < self.shown + self.every):
            return
        begin = monotonic()
        if begin < self.next:
            return
        episode = run.episode()
        stage = self.stage
        if stage is None or run is not self.run or len(episode.agents) != len(stage.actors):
            self.figure.clear()
            with paper_style():
                note = "while it is simulated"
                stage = film.FilmStage(self.figure, episode, self.tail, film.own_regions, note)
        stage.follow(episode)
        self.stage = stage
        self.run, self.shown = run, run.clock[-1]
        self.figure.canvas.draw_idle()
        self.figure.canvas.flush_events()
        end = monotonic()
        self.next = end + (end - begin)

    def _close(self, event: object) -> None:
        self.open = False
