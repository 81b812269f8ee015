"""Films that play in a notebook, and are written by what their file's name asks for."""

from base64 import b64encode
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from ...framework.values.errors import WideberthError

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

_PILLOW = (".gif", ".webp", ".apng")


def film_of(
    figure: "Figure", show: Callable[[float], list[Any]], times: list[float], interval: float
) -> "FuncAnimation":
    """Return a film that plays in a notebook, and whose ``save`` chooses the writer by suffix.

    Pillow, which comes with matplotlib, writes .gif, .webp and .apng; all others need a program,
    ffmpeg by default (matplotlib's setting ``animation.writer``).

    A notebook shows a film that has no window of its own as a GIF, which plays wherever pictures
    are shown. Matplotlib's setting ``animation.html`` chooses another form: "jshtml" has buttons
    to stop and to step, and is more than twice as large.

    Parameters
    ----------
    figure : whose artists move.
    show : brings them to a time, s.
    times : of the frames, s.
    interval : between two frames, ms.
    """
    import matplotlib
    from matplotlib.animation import FuncAnimation

    class Film(FuncAnimation):
        """As matplotlib's, but for the writer; raises as `writer_for`."""

        def save(
            self, filename: str | Path, writer: Any = None, *more: Any, **settings: Any
        ) -> None:
            chosen = writer_for(Path(filename)) if writer is None else writer
            super().save(filename, chosen, *more, **settings)

        def _repr_html_(self) -> Any:
            if figure.canvas.manager is not None:  # it plays in its window
                return None
            if matplotlib.rcParams["animation.html"] != "none":
                return super()._repr_html_()
            with TemporaryDirectory() as folder:
                self.save(Path(folder) / "film.gif")
                data = b64encode((Path(folder) / "film.gif").read_bytes()).decode("ascii")
            look = 'alt="film" style="max-width: 100%"'
            return f'<img {look} src="data:image/gif;base64,{data}">'

    return Film(figure, show, frames=times, interval=interval)


def writer_for(file: Path) -> str:
    """Return matplotlib's name of the writer for a file.

    Raises
    ------
    WideberthError : the suffix needs a program that is missing.
    """
    import matplotlib
    from matplotlib.animation import writers

    if file.suffix.lower() in _PILLOW:
        return "pillow"
    program = str(matplotlib.rcParams["animation.writer"])
    if not writers.is_available(program):
        raise WideberthError(
            f"{file.name} has to be written by {program}, which is not installed; install it, or "
            f"write {file.stem}.gif, which needs no program"
        )
    return program
