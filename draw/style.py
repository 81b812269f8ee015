"""The style of all pictures: sizes, colours readable in grey, and axes with units."""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMN = 3.5
"""Width of one printed column, inch."""

PAGE = 7.16
"""Width of two printed columns with the gap between them, inch."""

COLOURS = ("#1b1b1b", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00")
"""Black and five of Okabe and Ito's colours, which most colour-blind readers distinguish."""

BLACK, PLANNED, OTHER, REFERENCE, FORECAST = COLOURS[:5]
"""The paper's colours: green reference, blue plan, pink forecast."""

LINES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 2)))
"""Line styles, one per colour: in grey print the lines differ by style alone."""

WALL: Mapping[str, Any] = {
    "facecolor": "0.82", "edgecolor": "0.35", "linewidth": 0.7, "zorder": 0.8, "label": "static",
}  # fmt: skip
"""How polygons that stand still are drawn."""

MINUS = "\u2212"

VIEW = {"elev": 24.0, "azim": -58.0}
"""Degrees; pictures in space are seen from there."""

Points: TypeAlias = npt.NDArray[np.float64]
"""(K, D), m."""
Shade: TypeAlias = tuple[float, float, float]

_WIDTH = 5.4  # inch, of a picture for the screen
_TALLEST, _LOWEST = 4.4, 1.5  # inch, of its axes
_SCREEN_DPI = 140
_IN_A_BROWSER = ("nbagg", "webagg", "module://ipympl.backend_nbagg", "ipympl")


@contextmanager
def paper_style() -> Iterator[None]:
    """Draw in the sizes, fonts and line cycle of a printed column.

    Settings of the user are as before when it ends. Backend and interactive mode belong to the
    session: the first figure chooses them, within the block or not, and they stay.
    """
    import matplotlib
    from cycler import cycler

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
    interactive = matplotlib.is_interactive()
    try:
        with matplotlib.rc_context(settings):
            try:
                yield
            finally:
                interactive = matplotlib.is_interactive()
    finally:
        matplotlib.interactive(interactive)


def shades(count: int) -> list[Shade]:
    """One shade per step, darker the later, so that they also differ in grey print."""
    pale, dark = np.array([0.86, 0.56, 0.72]), np.array([0.30, 0.03, 0.22])
    shares = np.linspace(0.0, 1.0, count)[:, None]
    return [tuple(one) for one in (1.0 - shares) * pale + shares * dark]


def number(value: float, form: str = "g") -> str:
    """Write a number with a minus sign where it is negative, as axes do.

    Parameters
    ----------
    value : any number.
    form : as after the colon in an f-string.

    Examples
    --------
    >>> number(-0.25), number(2.0, ".2f")
    ('−0.25', '2.00')
    """
    return format(value, form).replace("-", MINUS)


def chosen_steps(count: int, most: int = 8) -> list[int]:
    """Choose the steps, from 0, that have a region in a picture: evenly, and the last."""
    every = max(-(-count // most), 1)
    return list(range((count - 1) % every, count, every))


def is_seen(figure: "Figure") -> bool:
    """Whether the session's backend of matplotlib shows a figure: in a window or in a browser."""
    from matplotlib import pyplot

    canvas: Any = figure.canvas
    in_a_browser = str(pyplot.get_backend()).lower() in _IN_A_BROWSER
    return in_a_browser or canvas.required_interactive_framework is not None


def picture(draw: Callable[["Axes"], Points], dimension: int, ax: "Axes | None") -> "Axes":
    """Draw into axes; without any, into those of a new figure in our style.

    A new figure is pyplot's, so that ``plt.show()`` and notebooks show it, and has a legend. Axes
    of the user's keep their legend: what is drawn has labels.

    Parameters
    ----------
    draw : draws, and returns points that have to be seen, (K, D), m.
    dimension : 2 or 3; axes for the latter need ``projection="3d"``.
    ax : axes of the user's, or None.
    """
    if ax is not None:
        frame(ax, draw(ax))
        return ax
    from matplotlib import pyplot

    with paper_style():
        figure = pyplot.figure(figsize=(_WIDTH, _WIDTH), dpi=_SCREEN_DPI)
        panel: Axes = _filled(figure, draw, dimension)
    return panel


def png(draw: Callable[["Axes"], Points], dimension: int) -> bytes:
    """Return the picture as PNG, drawn without a screen: what a notebook shows by itself."""
    from matplotlib.figure import Figure

    with paper_style():
        figure = Figure(figsize=(_WIDTH, _WIDTH), dpi=_SCREEN_DPI)
        _filled(figure, draw, dimension)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=_SCREEN_DPI, metadata={"Software": None})
    return buffer.getvalue()


def _filled(figure: Any, draw: Callable[["Axes"], Points], dimension: int) -> Any:
    """Draw into the only axes of a figure, and bring it to the size of what is seen."""
    panel = figure.add_subplot(projection="3d" if dimension == 3 else None)
    frame(panel, draw(panel))
    if dimension == 2:
        (left, right), (low, high) = panel.get_xlim(), panel.get_ylim()
        tall = (_WIDTH - 0.8) * (high - low) / (right - left)
        figure.set_size_inches(_WIDTH, min(max(tall, _LOWEST), _TALLEST) + 1.3)
    if panel.get_legend_handles_labels()[1]:
        figure.legend(loc="outside lower center", ncols=3)
    for axis in (panel.xaxis, panel.yaxis):  # ticks are made when drawn, in the user's style
        axis.set_tick_params(labelsize=7, labelfontfamily="serif")
    return panel


def frame(panel: Any, points: Points) -> None:
    """Set limits around points, equal scales, and labels with units; in space the view too."""
    space = hasattr(panel, "zaxis")
    points = np.asarray(points, dtype=np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        points = np.array([[-1.0] * (3 if space else 2), [1.0] * (3 if space else 2)])
    low, high = points.min(axis=0), points.max(axis=0)
    room = max(0.04 * float((high - low).max()), 0.1)
    low, high = low - room, high + room
    least = (0.5 if space else 0.25) * float((high - low).max())
    more = 0.5 * np.maximum(least - (high - low), 0.0)
    low, high = low - more, high + more
    if space:
        frame_space(panel, low, high)
        return
    panel.set_xlim(low[0], high[0])
    panel.set_ylim(low[1], high[1])
    panel.set_aspect("equal")
    panel.set_xlabel("x (m)")
    panel.set_ylabel("y (m)")


def frame_space(panel: Any, low: Points, high: Points) -> None:
    """Set limits, equal scale, the view and the labels of a box in space."""
    from matplotlib.ticker import MaxNLocator

    for name, begin, end in zip("xyz", low, high, strict=True):
        getattr(panel, f"set_{name}lim")(begin, end)
        getattr(panel, f"set_{name}label")(f"{name} (m)", labelpad=-6)
        axis = getattr(panel, f"{name}axis")
        axis.set_major_locator(MaxNLocator(4))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        panel.tick_params(axis=name, pad=-3)
    panel.set_box_aspect(tuple(high - low))
    panel.view_init(**VIEW)


def polygons(panel: Any, outlines: Sequence[Points], **look: Any) -> Any:
    """Add closed outlines (K, 2), m, without changing the limits; return them as one artist."""
    from matplotlib.collections import PolyCollection

    found = PolyCollection(list(outlines), **look)
    panel.add_collection(found, autolim=False)
    return found


def halo() -> Mapping[str, Any]:
    """Return settings of small text that stays readable on lines."""
    from matplotlib.patheffects import withStroke

    return {"fontsize": 6, "path_effects": [withStroke(linewidth=1.5, foreground="white")]}
