"""Discs of a known radius, fitted to groups of neighbouring points."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, final

import numpy as np

from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Sightings

from ..detector import Detector
from .disc_fit import DiscFit, DiscShape, box, cylinder, fit_disc
from .groups import at_notches, by_gap, deepest_of_noise, width
from .hits import DRIFT, TURN, Hits, IntArray, hits_of
from .segments import segments_of

SLACK = 0.6
"""m by which a group may be wider than the body that is looked for; wider ones stand still."""
NOTCH = 0.05
"""m, least depth of a notch that splits a group, where the noise makes none as deep."""
VAGUEST = 1.0
"""m, largest standard deviation of a centre that is of use."""
UNLIKELY = 0.05
"""Share below which a shape does not make a body larger."""
GAP = 0.1
"""m, least distance that splits a group."""
FEWEST = 3
"""Least points of a group; with 5 a small robot vanishes beyond 8 m at 360 beams."""


@final
@dataclass(eq=False)
class DiscDetector(Detector):
    """Finds bodies of known shapes: groups of points, and a disc fitted to each.

    The poses within a scan err against each other by `DRIFT` in all directions, and by `TURN`
    times the distance across the line of sight; a centre has that error too.

    A group of up to two bodies' width is split where its outline goes back between them
    (`at_notches`). What is wider than the body by more than `SLACK` is a wall: its points are
    static. The rest is fitted by `fit_disc`. A box is handed on as the disc that encloses it; it
    is fitted with a smaller one, see `disc_fit.box`, and its covariance holds what its unknown
    heading does to the centre. That error stays for seconds, while the body keeps its heading, so
    that no filter can average it away: `Sightings.lasting` says how large it is.

    Where a body may have one of several shapes k, each is fitted. With the likelihoods L_k of the
    points the centre is handed on as the mixture that all are equally likely to be, by its mean
    and covariance::

        w_k = L_k / sum L        c = sum w_k c_k        C = sum w_k (C_k + (c_k - c) (c_k - c)^T)

    The shapes of near bodies are distinguished; those of far ones, met by a few beams, are not,
    and C grows by the spread of the c_k. The radius is the largest of those that are not
    `UNLIKELY`.

    Parameters
    ----------
    shape : (radius,) of a cylinder, or (half length, half width) of a box, m.
    others : further shapes, each given likewise. All that moves is taken for one of them.

    Raises
    ------
    WideberthError : a number that is not positive, or a shape of another length.
    """

    reference: ClassVar[str] = "przybyla2017detection"

    shape: tuple[float, ...] = (0.3,)
    others: tuple[tuple[float, ...], ...] = ()
    _shapes: tuple[DiscShape, ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._shapes = tuple(_shape(sizes) for sizes in (self.shape, *self.others))

    def reset(self) -> None:
        """Do nothing: each scan stands for itself."""

    def detect(self, scan: Scan, poses: Array) -> Sightings:
        """Find discs and walls; see `Detector.detect`."""
        hits, note = hits_of(scan, poses)
        found: list[tuple[Array, Array, float, float]] = []
        static: list[IntArray] = [np.zeros(0, dtype=np.int64)]
        widest = 2.0 * max(shape.radius for shape in self._shapes)
        for whole_group in by_gap(hits, GAP):
            if width(hits.points[whole_group]) > 2.0 * widest + SLACK:
                static.append(whole_group)
                continue
            depth = max(NOTCH, deepest_of_noise(len(whole_group)) * scan.deviation)
            for index in at_notches(hits, whole_group, depth):
                group = hits.select(index)
                extent = width(group.points)
                if extent > widest + SLACK:
                    static.append(index)
                elif len(group) >= FEWEST:
                    found += self._disc(group, scan.deviation, extent)
        positions, covariance, radius, times = zip(*found, strict=True) if found else ((),) * 4
        count = len(found)
        still = hits.select(np.sort(np.concatenate(static)))
        return Sightings(
            scan.stamp,
            np.reshape(positions, (count, 2)),
            np.reshape(covariance, (count, 2, 2)),
            np.reshape(radius, count),
            still.points,
            note,
            np.reshape(times, count),
            hits.sensor,
            max(shape.lasting for shape in self._shapes),
            segments_of(still, scan.deviation, DRIFT, TURN),
        )

    def _disc(
        self, group: Hits, deviation: float, extent: float
    ) -> list[tuple[Array, Array, float, float]]:
        """Return centre, covariance, radius and time of one body; none where it is too vague."""
        shapes = [one for one in self._shapes if extent <= 2.0 * one.radius + SLACK]
        fits = [self._fitted(group, deviation, shape) for shape in shapes]
        surprise = np.array([fit.surprise for fit in fits])
        weights = np.exp(-0.5 * (surprise - surprise.min()))
        weights = weights / weights.sum()
        centre = weights @ np.array([fit.centre for fit in fits])
        spread = np.zeros((2, 2))
        for weight, fit in zip(weights, fits, strict=True):
            off = fit.centre - centre
            spread = spread + weight * (fit.covariance + np.outer(off, off))
        if np.linalg.eigvalsh(spread)[-1] > VAGUEST**2:
            return []
        likely = max(
            shape.radius
            for weight, shape in zip(weights, shapes, strict=True)
            if weight >= UNLIKELY
        )
        return [(centre, spread, max(likely, 0.5 * extent), float(group.times.mean()))]

    def _fitted(self, group: Hits, deviation: float, shape: DiscShape) -> DiscFit:
        """Return the fit of one shape, with all that makes its centre uncertain."""
        fit = fit_disc(group.points, group.origins, shape.fitted, deviation, shape.rough)
        sight = fit.centre - group.origins.mean(axis=0)
        aside = TURN * np.array([-sight[1], sight[0]])
        spread = fit.covariance + DRIFT**2 * np.eye(2) + np.outer(aside, aside)
        return replace(fit, covariance=spread + shape.spread(sight))


def _shape(sizes: tuple[float, ...]) -> DiscShape:
    """Return the shape of a cylinder or a box.

    Raises
    ------
    WideberthError : other sizes.
    """
    if len(sizes) not in (1, 2):
        raise WideberthError(
            f"discs.shape is {sizes!r}; wanted (radius,) or (half length, half width)"
        )
    for size in sizes:
        positive("discs.shape", size)
    return cylinder(*sizes) if len(sizes) == 1 else box(*sizes)
