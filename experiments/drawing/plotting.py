"""Figures of studies: in the framework's style, and files without a time stamp."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...draw.style import COLOURS as COLOURS
from ...draw.style import COLUMN as COLUMN
from ...draw.style import LINES as LINES
from ...draw.style import PAGE as PAGE
from ...draw.style import number as number
from ...draw.style import paper_style as paper_style
from ...framework.plugins.io import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ENOUGH = 10
"""Episodes from which on figures draw intervals and quartiles; of fewer they say how many."""


def few(counts: Iterable[int]) -> str:
    """Say on a figure why a series has no interval; nothing where each has episodes enough.

    Examples
    --------
    >>> few([40, 40]), few([2, 4])
    ('', '2 to 4 episodes each: too few for intervals')
    """
    found = list(counts)
    if not found or min(found) >= ENOUGH:
        return ""
    low, high = min(found), max(found)
    number = f"{low}" if low == high else f"{low} to {high}"
    noun = "episode" if high == 1 else "episodes"
    return f"{number} {noun} each: too few for intervals"


def entry(text: str, **look: Any) -> Any:
    """Return an entry of a legend: a line, a marker where its look has no line, or words alone.

    Parameters
    ----------
    text : of the entry.
    look : settings of ``matplotlib.lines.Line2D``.
    """
    from matplotlib.lines import Line2D

    return Line2D([], [], label=text, **{"linestyle": "", **look})


def title(name: str) -> str:
    """Return a name of a config as figures print it."""
    return str(name).replace("_", " ")


def subplots(rows: int = 1, columns: int = 1, **settings: Any) -> tuple["Figure", Any]:
    """Return a figure for a file, with its panels, as ``pyplot.subplots`` does.

    It never opens a window, whatever the backend of the session is.

    Parameters
    ----------
    rows, columns : of panels.
    settings : those of ``Figure`` (``figsize``, ``layout``), all others of ``Figure.subplots``.
    """
    from matplotlib.figure import Figure

    own = {name: settings.pop(name) for name in ("figsize", "layout") if name in settings}
    figure = Figure(**own)
    return figure, figure.subplots(rows, columns, **settings)


def style(index: int, markers: Sequence[str]) -> dict[str, Any]:
    """Return colour, line and marker of a series, by its place among others."""
    return {
        "color": COLOURS[index % len(COLOURS)],
        "linestyle": LINES[index % len(LINES)],
        "marker": markers[index % len(markers)],
    }


def legend_below(figure: "Figure", panels: Iterable[Any], **settings: Any) -> None:
    """Put one legend below all panels, with each of their labels once.

    Parameters
    ----------
    settings : those of ``Figure.legend``.
    """
    entries: dict[str, Any] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(label, handle)
    figure.legend([*entries.values()], [*entries], loc="outside lower center", **settings)


def print_dollars(figure: "Figure") -> None:
    r"""Print dollar signs of names as they are; a formula has a command, as in `\rho`.

    Names come from configs, recordings and plug-ins, and matplotlib reads what stands between two
    dollar signs as a formula.
    """
    from matplotlib.mathtext import MathTextParser
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        words = text.get_text()
        if "$" in words:
            try:
                MathTextParser("path").parse(words)
            except ValueError:
                words = ""
            text.set_parse_math("\\" in words)


def save(figure: "Figure", folder: Path, name: str) -> list[Path]:
    """Write ``name``.png and ``name``.pdf and return both files.

    Nothing that changes from run to run goes inside: the same figure gives the same bytes.
    """
    import io

    print_dollars(figure)
    folder.mkdir(parents=True, exist_ok=True)
    plain = {
        "png": {"Software": None},
        "pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    }
    written = []
    for kind, metadata in plain.items():
        buffer = io.BytesIO()
        figure.savefig(buffer, format=kind, metadata=metadata)
        written.append(write_bytes(folder / f"{name}.{kind}", buffer.getvalue()))
    return written
