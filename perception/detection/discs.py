"""Discs of a known radius, fitted to groups of neighbouring points."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal, final

import numpy as np

from ...framework.detector import Detector
from ...framework.values.arrays import Array, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.sensing import Scan, Sightings
from .disc_fit import Shape, box, cylinder, fit_disc
from .groups import (
    at_notches,
    by_density,
    by_gap,
    deepest_of_noise,
    density_library,
    width,
)
from .hits import Hits, hits_of

SLACK = 0.6
"""m by which a group may be wider than the body that is looked for; wider ones stand still."""
NOTCH = 0.05
"""m, least depth of a notch that splits a group, where the noise makes none as deep."""
VAGUEST = 1.0
"""m, largest standard deviation of a centre that is of use."""


@final
@dataclass(eq=False)
class Discs(Detector):
    """Finds bodies of a known shape: groups of points, and a disc fitted to each.

    A group of up to two bodies' width is split where its outline goes back between them
    (`at_notches`). What is wider than the body by more than `SLACK` is a wall: its points are
    static. The rest is fitted by `fit_disc`. A box is handed on as the disc that encloses it; it
    is fitted with a smaller one, see `disc_fit.box`, and its covariance holds what its unknown
    heading does to the centre. That error stays for seconds, while the body keeps its heading, so
    that no filter can average it away: `Sightings.lasting` says how large it is.

    Parameters
    ----------
    shape : (radius,) of a cylinder, or (half length, half width) of a box, m. All that moves is
        taken for it.
    groups : "gap" splits the points where neighbours are apart (`by_gap`); "density" clusters
        them by DBSCAN (`by_density`; needs scikit-learn), which does not mind their order, but
        loses bodies whose points are more than 0.3 m apart.
    gap : m, least distance that splits a group.
    fewest : points of a group; with 5 a small robot vanishes beyond 8 m at 360 beams.
    drift, turn : m and rad, by which the poses within a scan err against each other (standard
        deviations). The error of a centre is the first one in all directions, and the second one
        times its distance across the line of sight.

    Raises
    ------
    WideberthError : a number that is not positive, a shape of another length, unknown groups,
        or scikit-learn is wanted and not installed.
    """

    reference: ClassVar[str] = "przybyla2017detection"

    shape: tuple[float, ...] = (0.3,)
    groups: Literal["gap", "density"] = "gap"
    gap: float = 0.1
    fewest: int = 3
    drift: float = 0.001
    turn: float = 0.0005
    _shape: Shape = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if len(self.shape) not in (1, 2):
            raise WideberthError(
                f"discs.shape is {self.shape!r}; wanted (radius,) or (half length, half width)"
            )
        for size in self.shape:
            positive("discs.shape", size)
        positive("discs.gap", self.gap)
        positive("discs.drift", self.drift, zero=True)
        positive("discs.turn", self.turn, zero=True)
        whole("discs.fewest", self.fewest)
        if self.groups not in ("gap", "density"):
            raise WideberthError(f"discs.groups is {self.groups!r}; wanted gap or density")
        if self.groups == "density":
            density_library()
        self._shape = cylinder(*self.shape) if len(self.shape) == 1 else box(*self.shape)

    def reset(self) -> None:
        """Do nothing: each scan stands for itself."""

    def detect(self, scan: Scan, poses: Array) -> Sightings:
        """Find discs and walls; see `Detector.detect`."""
        hits, note = hits_of(scan, poses)
        found: list[tuple[Array, Array, float, float]] = []
        static = [np.zeros((0, 2))]
        for whole_group in by_gap(hits, self.gap) if self.groups == "gap" else by_density(hits):
            if width(hits.points[whole_group]) > 4.0 * self._shape.radius + SLACK:
                static.append(hits.points[whole_group])
                continue
            depth = max(NOTCH, deepest_of_noise(len(whole_group)) * scan.deviation)
            for index in at_notches(hits, whole_group, depth):
                group = hits.select(index)
                extent = width(group.points)
                if extent > 2.0 * self._shape.radius + SLACK:
                    static.append(group.points)
                elif len(group) >= self.fewest:
                    found += self._disc(group, scan.deviation, extent)
        positions, covariance, radius, times = zip(*found, strict=True) if found else ((),) * 4
        count = len(found)
        return Sightings(
            scan.stamp,
            np.reshape(positions, (count, 2)),
            np.reshape(covariance, (count, 2, 2)),
            np.reshape(radius, count),
            np.concatenate(static),
            note,
            np.reshape(times, count),
            hits.sensor,
            self._shape.lasting,
        )

    def _disc(
        self, group: Hits, deviation: float, extent: float
    ) -> list[tuple[Array, Array, float, float]]:
        """Return centre, covariance, radius and time of one body; none where it is too vague."""
        shape = self._shape
        fit = fit_disc(group.points, group.origins, shape.fitted, deviation, shape.rough)
        sight = fit.centre - group.origins.mean(axis=0)
        aside = self.turn * np.array([-sight[1], sight[0]])
        spread = fit.covariance + self.drift**2 * np.eye(2) + np.outer(aside, aside)
        spread = spread + shape.spread(sight)
        if np.linalg.eigvalsh(spread)[-1] > VAGUEST**2:
            return []
        radius = max(shape.radius, 0.5 * extent)
        return [(fit.centre, spread, radius, float(group.times.mean()))]
