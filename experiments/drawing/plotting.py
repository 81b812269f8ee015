"""How figures look: one style, readable in grey, and files without a time stamp."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...framework.plugins.io import write_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLUMN = 3.5
"""Width of one printed column, inch."""

PAGE = 7.16
"""Width of two printed columns with the gap between them, inch."""

COLOURS = ("#1b1b1b", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")
"""Black and five of Okabe and Ito's colours, which most colour-blind readers distinguish."""

LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 2)))
"""Line styles, one per colour: in grey print the style alone tells lines apart."""


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


def note(text: str) -> Any:
    """Return an entry of a legend that has words alone."""
    from matplotlib.lines import Line2D

    return Line2D([], [], linestyle="", label=text)


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw without a screen, in the sizes, fonts and line cycle of a printed column."""
    import matplotlib
    from cycler import cycler

    matplotlib.use("Agg", force=False)
    settings: Any = {
        "figure.figsize": (COLUMN, 2.6),
        "figure.constrained_layout.use": True,
        "figure.dpi": 100,
        "savefig.dpi": 250,
        "font.family": "serif",
        "font.serif": ["DejaVu Serif"],  # ships with Matplotlib: the same bytes everywhere
        "mathtext.fontset": "dejavuserif",
        "font.size": 8,
        "axes.labelsize": 8,
        "axes.titlesize": 8,
        "legend.fontsize": 7,
        "xtick.labelsize": 7,
        "ytick.labelsize": 7,
        "axes.linewidth": 0.6,
        "lines.linewidth": 1.2,
        "grid.linewidth": 0.4,
        "grid.alpha": 0.4,
        "axes.grid": True,
        "axes.axisbelow": True,
        "legend.frameon": False,
        "axes.prop_cycle": cycler(color=COLOURS) + cycler(linestyle=LINES),
        "pdf.fonttype": 42,  # text stays text
        "svg.hashsalt": "wideberth",
    }
    with matplotlib.rc_context(settings):
        yield


def name_columns(panel: Any, names: Sequence[str]) -> None:
    """Write names below columns at 0, 1, ...: a word per line, upright where they are many."""
    upright = len(names) > 6
    labels = [name.replace("_", " " if upright else "\n") for name in names]
    panel.set_xticks(range(len(labels)), labels, rotation=90 if upright else 0)
    panel.set_xlim(-0.6, len(labels) - 0.4)
    panel.grid(axis="x", visible=False)


def save(figure: "Figure", folder: Path, name: str) -> list[Path]:
    """Write ``name``.png and ``name``.pdf, close the figure and return both files.

    Nothing that changes from run to run goes inside: the same figure gives the same bytes.
    """
    import io

    from matplotlib import pyplot

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
    pyplot.close(figure)
    return written
