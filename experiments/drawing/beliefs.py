"""What robots believe, drawn over what is: scans, tracks with identities and ellipses.

All of it is drawn in the world's frame: a robot's own frame is laid so that its believed pose is
the true one of that instant.
"""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...draw.shapes import circle, ellipses
from ...draw.style import BLACK
from ...framework.numerics.chi_square import content_bound
from ...framework.values.arrays import Array
from ...simulation.log.episode_log import Episode
from ...simulation.log.perception_log import Glance

SCALES = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
"""Ellipses are drawn as many times as large, so that they are seen."""
LEGIBLE = 0.2
"""m, semi-axis that nine of ten ellipses have at most, as drawn."""
LATEST = 1.0
"""s, for which a belief is drawn after its scan."""
MOST = 24
"""Tracks of one robot whose identities the film has room for."""


class DrawnBelief(NamedTuple):
    """What a robot believed after one scan, in the world's frame.

    Attributes
    ----------
    time : s, of the episode.
    points : (P, 2), m, where the scan hit something.
    idents : of the tracks, (K,).
    places : (K, 2), m.
    covariance : (K, 2, 2), m^2, of the places.
    radii : (K,), m.
    segments : (S, 2, 2), m, ends of what was taken to stand still.
    """

    time: float
    points: Array
    idents: tuple[str, ...]
    places: Array
    covariance: Array
    radii: Array
    segments: Array

    @classmethod
    def of(cls, glance: Glance) -> "DrawnBelief":
        """Return what was believed at a glance."""
        to_world, tracked = glance.to_world, glance.obstacles
        states = np.array([one.state for one in tracked]).reshape(-1, 4)
        spread = np.array([one.covariance[:2, :2] for one in tracked]).reshape(-1, 2, 2)
        return cls(
            glance.truth.time,
            to_world.points(glance.points),
            tuple(one.ident for one in tracked),
            to_world.points(states[:, :2]),
            to_world.covariances(spread),
            np.array([one.radius for one in tracked]),
            to_world.points(glance.sightings.segments.ends),
        )


Beliefs = Mapping[str, Sequence[DrawnBelief]]
"""Name of a robot -> what it believed, in order of time."""


def beliefs_of(episode: Episode) -> Beliefs:
    """Return what each robot of an episode believed; empty where none has sensors."""
    return {
        name: [DrawnBelief.of(glance) for glance in log.glances if glance.truth.time >= 0.0]
        for name, log in episode.perception.items()
    }


SCAN: dict[str, Any] = {
    "marker": ".", "color": BLACK, "markersize": 3.0, "markeredgewidth": 0.0, "linestyle": ""
}  # fmt: skip
"""How points of a scan are drawn."""
STILL: dict[str, Any] = {"color": BLACK, "linewidth": 1.1, "alpha": 0.7}
"""How segments of what stands still are drawn."""
_STILL = "what it takes to stand still"


def belief_at(beliefs: Sequence[DrawnBelief], time: float) -> DrawnBelief | None:
    """Return what was believed last before a time, s; None where that is long ago."""
    index = bisect_right([one.time for one in beliefs], time + 1e-9) - 1
    if index < 0 or time - beliefs[index].time > LATEST:
        return None
    return beliefs[index]


def magnified(beliefs: Beliefs, tail: float) -> float:
    """Return how many times as large ellipses of content 1 - tail are drawn; see `SCALES`."""
    spreads = [one.covariance for some in beliefs.values() for one in some if len(one.idents)]
    if not spreads:
        return 1.0
    largest = np.linalg.eigvalsh(np.concatenate(spreads))[:, -1]
    axis = float(np.sqrt(content_bound(2, tail) * np.quantile(largest, 0.9)))
    return max((scale for scale in SCALES if scale * axis <= LEGIBLE), default=1.0)


def discs(belief: DrawnBelief, count: int = 60) -> list[Array]:
    """Outlines of the bodies that are tracked, (count, 2), m."""
    unit = circle(count).T
    return [p + r * unit for p, r in zip(belief.places, belief.radii, strict=True)]


def rims(belief: DrawnBelief, tail: float, scale: float) -> list[Array]:
    """Outlines of the ellipses of the places, ``scale`` times as large, (C, 2), m."""
    if not len(belief.idents):
        return []
    spread = scale**2 * belief.covariance
    return list(ellipses(belief.places, spread, content_bound(2, tail), 48))


def draw_belief(panel: Any, belief: DrawnBelief, colour: str, tail: float, scale: float) -> Array:
    """Draw one belief; return the corners of what has to be seen, (K, 2), m.

    Parameters
    ----------
    panel : axes in the world's frame.
    belief : of one robot.
    colour : of its tracks.
    tail : 1 - content of the ellipses.
    scale : how many times as large they are drawn.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.patheffects import withStroke

    if len(belief.segments):
        still = LineCollection([*belief.segments], zorder=2.6, label=_STILL, **STILL)
        panel.add_collection(still, autolim=False)
    panel.plot(*belief.points.T, zorder=2.9, label="points of the scan", **SCAN)
    bodies = PolyCollection(
        discs(belief), facecolor="none", edgecolor=colour, linewidth=1.4, linestyle=(0, (4, 1.5)),
        zorder=2.7, label="body as it is tracked",
    )  # fmt: skip
    spread = PolyCollection(
        rims(belief, tail, scale), facecolor=(colour, 0.25), edgecolor=colour, linewidth=0.8,
        zorder=2.8, label=_words(tail, scale),
    )  # fmt: skip
    for one in (bodies, spread):
        panel.add_collection(one, autolim=False)
    for ident, place, radius in zip(belief.idents, belief.places, belief.radii, strict=True):
        panel.annotate(
            f"track {ident}", place + np.array([0.0, radius]), (0.0, 2.5),
            textcoords="offset points", ha="center", fontsize=6.5, color=colour, zorder=3.1,
            clip_on=True, annotation_clip=True,
            path_effects=[withStroke(linewidth=1.6, foreground="white")],
        )  # fmt: skip
    outlines = discs(belief, 8)
    return np.concatenate(outlines) if outlines else np.zeros((0, 2))


def _words(tail: float, scale: float) -> str:
    times = "" if scale == 1.0 else f", {scale:g} times as large"
    return f"ellipse of {100 * (1 - tail):g} % of its place{times}"


def explain(figure: Any, tail: float, scale: float, still: bool) -> None:
    """Add what robots believe to a film's legend; ``still``: also of what stands still."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    (legend,) = figure.legends
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + 0.45)
    handles = [*legend.legend_handles]
    words = [text.get_text() for text in legend.get_texts()]
    handles += [
        Line2D([], [], **SCAN),
        Line2D([], [], color="0.3", linewidth=1.0, linestyle=(0, (3, 1.5))),
        Patch(facecolor=("0.3", 0.3), edgecolor="0.3"),
    ]
    words += ["points of its scan", "body as it tracks it, with the identity", _words(tail, scale)]
    if still:
        handles.append(Line2D([], [], **STILL))
        words.append(_STILL)
    legend.remove()
    figure.legend(handles, words, loc="outside lower center", ncols=2, fontsize=6.5)


class Onlooker:
    """The moving artists of what one robot believes.

    Parameters
    ----------
    panel : axes in the world's frame.
    beliefs : of the robot.
    colour : of its scan and tracks.
    tail : 1 - content of the ellipses.
    scale : how many times as large they are drawn.
    """

    def __init__(
        self, panel: Any, beliefs: Sequence[DrawnBelief], colour: str, tail: float, scale: float
    ) -> None:
        from matplotlib.collections import LineCollection, PolyCollection
        from matplotlib.patheffects import withStroke

        self._beliefs, self._tail, self._scale = beliefs, tail, scale
        (self._points,) = panel.plot([], [], zorder=2.9, **{**SCAN, "color": colour})
        self._bodies = PolyCollection(
            [], facecolor="none", edgecolor=colour, linewidth=1.0, linestyle=(0, (3, 1.5))
        )
        self._spreads = PolyCollection(
            [], facecolor=(colour, 0.3), edgecolor=colour, linewidth=0.7
        )
        self._still = LineCollection([], **{**STILL, "color": colour})
        for one in (self._still, self._bodies, self._spreads):
            panel.add_collection(one, autolim=False)
        stroke = [withStroke(linewidth=1.5, foreground="white")]
        most = max((len(one.idents) for one in beliefs), default=0)
        self._words = [
            panel.text(0.0, 0.0, "", color=colour, fontsize=7, ha="center", va="bottom",
                       path_effects=stroke, clip_on=True, parse_math=False)
            for _ in range(min(most, MOST))
        ]  # fmt: skip

    @property
    def moving(self) -> list[Any]:
        """All artists that change, from back to front."""
        return [self._still, self._bodies, self._spreads, self._points, *self._words]

    def show(self, time: float) -> None:
        """Bring the artists to a time, s."""
        belief = belief_at(self._beliefs, time)
        self._points.set_data(*(np.zeros((2, 0)) if belief is None else belief.points.T))
        self._still.set_segments([] if belief is None else [*belief.segments])
        self._bodies.set_verts([] if belief is None else discs(belief))
        self._spreads.set_verts([] if belief is None else rims(belief, self._tail, self._scale))
        idents = () if belief is None else belief.idents
        for i, word in enumerate(self._words):
            word.set_text(f"track {idents[i]}" if i < len(idents) else "")
            if belief is not None and i < len(idents):
                word.set_position(belief.places[i] + np.array([0.0, belief.radii[i]]))
