"""Films that are written by what their file's name asks for."""

from os import PathLike
from pathlib import Path
from typing import Any, final

import matplotlib
from matplotlib.animation import FuncAnimation, writers

from ...framework.values.errors import WideberthError

_PILLOW = (".gif", ".webp", ".apng")


@final
class Film(FuncAnimation):
    """A film that chooses its writer by the file's suffix, and says so where there is none."""

    def save(
        self, filename: str | PathLike[str], writer: Any = None, *more: Any, **settings: Any
    ) -> None:
        """Write the film; all else is as matplotlib's ``FuncAnimation.save``.

        Pillow, which comes with matplotlib, writes .gif, .webp and .apng; all others need a
        program, ffmpeg by default (matplotlib's setting ``animation.writer``).

        Parameters
        ----------
        filename : with its suffix.
        writer : matplotlib's name of one, or one; None to choose.

        Raises
        ------
        WideberthError : the suffix needs a program that is missing.
        """
        chosen = writer_for(filename) if writer is None else writer
        super().save(filename, chosen, *more, **settings)


def writer_for(filename: str | PathLike[str]) -> str:
    """Return matplotlib's name of the writer for a file; raises as `Film.save`."""
    path = Path(filename)
    if path.suffix.lower() in _PILLOW:
        return "pillow"
    program = str(matplotlib.rcParams["animation.writer"])
    if not writers.is_available(program):
        raise WideberthError(
            f"{path.name} has to be written by {program}, which is not installed; install it, or "
            f"write {path.stem}.gif, which needs no program"
        )
    return program
