"""Certificates of the convex regions by convex programs, which use none of their formulas."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ...framework import GaussianObstacle, Region, WideberthError
from ...framework.plugins.extras import check_extra
from ...framework.region import Convex, Relation, Signed
from ...framework.values.arrays import Array, positive, whole
from ..drawing.plotting import COLOURS, LINES, PAGE, subplots, title
from ..engine.closed_loop import column, group
from .grid import Axes, GridStudy, Pictures, Result, Row, Task, TaskOutcome, reduced
from .region_gallery import check_regions, region_names, region_of

TOLERANCE = 1e-5
"""Of what the solver leaves, in margins; a smaller gap counts as none."""
CUTS = 6
"""Rounds of cutting planes: from some degrees between normals to some hundredths of one."""
MARKERS = "osD^vPX*<>"


@final
@dataclass(frozen=True)
class ConvexCertificates(GridStudy):
    """Three convex programs per region and covariance, solved by CVXPY.

    With E the ellipse of the region's level s, B the disc of the margin rho and h the region's
    support function:

    - containment: for unit normals n_k a cone program gives max n_k . (y + z) over y in E and
      z in B. ``gap_min`` and ``gap_max`` are the extremes over k of h(n_k) less that, in margins:
      both 0 for the exact set, at least 0 for an outer one, at most 0 for an inner one.
      ``certified`` is the relation that follows, ``declared`` the one of the region.
    - distance: a quadratic program projects points onto {x : n_k . x <= h(n_k) for all k}, which
      encloses the region; cutting planes near the projections tighten it. ``distance_error`` is
      the largest difference, in margins, from the region's own signed distance of points outside.
    - smallest ellipse: a semidefinite program (S-procedure) finds the ellipse of least area
      around E + B; ``area_ratio`` is the area of the region over that ellipse's.

    Lengths of a covariance are those of its own axes: s sigma_2 is ``short_axis`` margins for the
    level of the content ellipse, and lambda_1 / lambda_2 the ``condition``.

    Attributes
    ----------
    regions : by name, each of type `Convex`.
    registered : examine every other registered convex region of two coordinates too.
    tail : 1 - content, or the asked risk where a region's level stands for a risk.
    conditions : lambda_1 / lambda_2, each within [1, 1e4]: beyond, the semidefinite program
        has no digits left.
    short_axis : s sigma_2 over the margin, within [0.01, 1].
    margin : m, r + r_d.
    directions : normals n_k, at equal angles.
    points : that are projected, around the region.
    """

    claim: ClassVar[str] = (
        "Closed forms of convex regions hold what they declare: containment, distance and the "
        "least area, certified by convex programs."
    )
    reference: ClassVar[str] = "boyd2004convex,kurzhanski1997ellipsoidal"

    regions: Mapping[str, Region] = field(default_factory=dict)
    registered: bool = True
    tail: float = 0.05
    conditions: tuple[float, ...] = (1.0, 2.0, 4.0, 10.0, 25.0, 100.0)
    short_axis: float = 1.0
    margin: float = 1.5
    directions: int = 360
    points: int = 12

    def __post_init__(self) -> None:
        check_regions(self.regions, self.registered, self.tail)
        check_extra("cvxpy", "certificates", "convex_certificates needs CVXPY")
        positive("margin", self.margin)
        whole("directions", self.directions, least=8)
        whole("points", self.points)
        if not 0.01 <= self.short_axis <= 1.0:
            raise WideberthError(f"short_axis is {self.short_axis}; wanted a number in [0.01, 1]")
        if not self.conditions or not all(1.0 <= one <= 1e4 for one in self.conditions):
            raise WideberthError(f"conditions is {self.conditions}; wanted numbers in [1, 1e4]")
        other = sorted(name for name, one in self.regions.items() if not isinstance(one, Convex))
        if other:
            raise WideberthError(f"regions {other} have no support function; name convex ones")

    def axes(self) -> Axes:
        """Each region with each condition number."""
        return {
            "region": region_names(self.regions, self.registered, Convex),
            "condition": self.conditions,
        }

    def measure(self, task: Task) -> TaskOutcome:
        """Solve the three programs for one region and covariance."""
        name, condition = str(task.settings["region"]), float(task.settings["condition"])
        region = region_of(self.regions, name)
        assert isinstance(region, Convex)
        row: Row = {"region": name, "condition": condition, "declared": str(region.relation)}
        deviations = self._deviations(condition)
        obstacle = GaussianObstacle(np.zeros(2), np.diag(deviations**2))
        try:
            level = region.level(self.tail)
            parameters = region.parameters(obstacle, np.asarray(self.margin))
        except WideberthError as error:
            return TaskOutcome([{**row, **dict.fromkeys(_MEASURED), "remark": str(error)}])
        axes = level * deviations
        normals = _circle(self.directions)
        height = region.support(normals, parameters, np.asarray(level))
        gaps = (height - sum_support(axes, self.margin, normals)) / self.margin
        smallest = np.pi * smallest_ellipse(axes, self.margin).prod()
        area = float(region.area(parameters, np.asarray(level)))
        return TaskOutcome([{
            **row,
            "level": _digits(level),
            "certified": str(_relation(gaps)),
            "gap_min": _digits(gaps.min()),
            "gap_max": _digits(gaps.max()),
            "distance_error": self._distance_error(region, parameters, level),
            "area_ratio": _digits(area / smallest),
            "remark": "",
        }])  # fmt: skip

    def _deviations(self, condition: float) -> Array:
        """Square roots of the eigenvalues, m, from large to small."""
        from ...regions.gaussian import ellipse_level

        short = self.short_axis * self.margin / ellipse_level(self.tail, 2)
        return short * np.array([np.sqrt(condition), 1.0])

    def _distance_error(self, region: Convex, parameters: Array, level: float) -> float | None:
        """Return the largest error of the signed distance, in margins; None without one."""
        if not isinstance(region, Signed):
            return None

        def support(normals: Array) -> Array:
            return region.support(normals, parameters, np.asarray(level))

        points = 2.0 * float(support(_circle(self.directions)).max()) * _circle(self.points, 0.1)
        own = region.signed_distance(points, parameters, np.asarray(level))
        found = distances(points, support, _circle(self.directions))
        return _digits(np.abs(own - found).max() / self.margin)

    def summary(self, rows: list[Row]) -> list[Row]:
        """One line per region: extremes over the condition numbers."""
        lines = []
        for (name,), some in group(rows, "region").items():
            known = [row for row in some if not row["remark"]]
            line: Row = {"region": name, "declared": some[0]["declared"]}
            if known:
                line["certified"] = ", ".join(sorted({str(row["certified"]) for row in known}))
                line["gap_min"] = min(float(row["gap_min"]) for row in known)
                line["gap_max"] = max(float(row["gap_max"]) for row in known)
                line["distance_error"] = _largest(known, "distance_error")
                line["area_ratio_max"] = _largest(known, "area_ratio")
            lines.append({**dict.fromkeys(_CONDENSED), **line, "remark": some[0]["remark"]})
        return lines

    def pictures(self, result: Result) -> Pictures:
        """Draw the gaps and the areas of every region over the condition number."""
        yield "convex_certificates", draw([row for row in result.rows if not row["remark"]])

    def quick(self) -> Self:
        """Keep the first and last condition number, and fewer directions."""
        ends = self.conditions[:: max(len(self.conditions) - 1, 1)]
        return reduced(replace(self, conditions=ends), directions=60, points=4)


_MEASURED = ("level", "certified", "gap_min", "gap_max", "distance_error", "area_ratio")
_CONDENSED = (
    "region", "declared", "certified", "gap_min", "gap_max", "distance_error", "area_ratio_max",
)  # fmt: skip


def sum_support(axes: Array, margin: float, normals: Array) -> Array:
    """Support function of ellipse plus disc by a cone program, (K, 2) -> (K,), m.

    Maximise sum_k n_k . (diag(axes) u_k + margin v_k) over |u_k| <= 1, |v_k| <= 1: the terms
    have no variable in common, so that each is at its own maximum.
    """
    cvxpy = _cvxpy()
    unit = float(max(axes.max(), margin))  # of length, so that the solver sees numbers near 1
    first, second = cvxpy.Variable(normals.shape), cvxpy.Variable(normals.shape)
    image = cvxpy.multiply(first, (axes / unit)[None]) + (margin / unit) * second
    reached = cvxpy.sum(cvxpy.multiply(normals, image), axis=1)
    discs = [cvxpy.norm(one, axis=1) <= 1.0 for one in (first, second)]
    _solve(cvxpy.Problem(cvxpy.Maximize(cvxpy.sum(reached)), discs))
    return unit * np.asarray(reached.value, dtype=np.float64)


def distances(points: Array, support: Callable[[Array], Array], normals: Array) -> Array:
    """Distance of points from a convex set by quadratic programs, (P, 2) -> (P,), m.

    The polygon {x : n_k . x <= h(n_k)} encloses the set. Each of `CUTS` rounds projects the points
    onto it and adds normals on both sides of the direction from a projection to its point, half
    as far away as in the round before: the polygon's distance falls short by that angle squared.

    Parameters
    ----------
    points : outside the set, around the origin.
    support : function h, (K, 2) -> (K,), m.
    normals : n_k to begin with, (K, 2).
    """
    cvxpy = _cvxpy()
    unit = float(np.abs(points).max())
    scaled = points / unit
    length, turn = np.zeros(len(points)), 2.0 * np.pi / len(normals)
    for _ in range(CUTS + 1):
        nearest = cvxpy.Variable(points.shape)
        height = np.broadcast_to(support(normals) / unit, (len(points), len(normals)))
        aim = cvxpy.Minimize(cvxpy.sum_squares(nearest - scaled))
        _solve(cvxpy.Problem(aim, [nearest @ normals.T <= height]))
        away = scaled - np.asarray(nearest.value, dtype=np.float64)
        length = np.linalg.norm(away, axis=1)
        turn = 0.5 * turn
        angle = np.arctan2(away[:, 1], away[:, 0])
        normals = np.concatenate([normals, _unit(angle - turn), _unit(angle + turn)])
    return np.asarray(unit * length)


def smallest_ellipse(axes: Array, margin: float) -> Array:
    """Semi-axes of the least ellipse around ellipse plus disc, (D,) -> (D,), m, from large.

    Maximise log det T such that x^T T x <= 1 for x = y + z with y^T P y <= 1 and z^T z <= 1 (the
    margin is the unit of length). By the S-procedure that holds if, for t_1, t_2 >= 0 with
    t_1 + t_2 <= 1,

        [[T - t_1 P, T], [T, T - t_2 I]] <= 0.
    """
    cvxpy = _cvxpy()
    size = len(axes)
    inverse = np.diag((margin / axes) ** 2)
    shape = cvxpy.Variable((size, size), PSD=True)
    first, second = cvxpy.Variable(nonneg=True), cvxpy.Variable(nonneg=True)
    block = cvxpy.bmat([[shape - first * inverse, shape], [shape, shape - second * np.eye(size)]])
    limits = [first + second <= 1.0, 0.5 * (block + block.T) << 0]
    _solve(cvxpy.Problem(cvxpy.Maximize(cvxpy.log_det(shape)), limits))
    return margin / np.sqrt(np.linalg.eigvalsh(np.asarray(shape.value)))


def _cvxpy() -> Any:
    """Return CVXPY, imported late, whose functions carry no types."""
    import cvxpy

    return cvxpy


def _solve(problem: Any) -> None:
    """Solve a program.

    Raises
    ------
    WideberthError : the solver found no optimum.
    """
    problem.solve(solver="CLARABEL")
    if problem.status != "optimal":
        raise WideberthError(
            f"a convex program ended as {problem.status!r}; wanted an optimum: try conditions "
            "nearer to 1 or a larger short_axis"
        )


def _relation(gaps: Array) -> Relation:
    """Return how the region lies to the exact set, by the gaps between support functions."""
    outer, inner = bool(gaps.min() >= -TOLERANCE), bool(gaps.max() <= TOLERANCE)
    if outer and inner:
        return Relation.EXACT
    return Relation.OUTER if outer else Relation.INNER if inner else Relation.NONE


def _circle(count: int, turn: float = 0.0) -> Array:
    """Return unit vectors at equal angles, (count, 2)."""
    return _unit(turn + np.linspace(0.0, 2.0 * np.pi, count, endpoint=False))


def _unit(angle: Array) -> Array:
    """Return unit vectors at some angles, (K,) -> (K, 2)."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _digits(value: Any) -> float | None:
    """Round to six decimals, which is what the solver leaves; None where not finite."""
    return round(float(value), 6) + 0.0 if np.isfinite(value) else None


def _largest(rows: Sequence[Row], name: str) -> float | None:
    known = [float(row[name]) for row in rows if row[name] is not None]
    return max(known) if known else None


def draw(rows: Sequence[Row]) -> Any:
    """Draw, over the condition number, the range of the gaps and the area of each region."""
    figure, (left, right) = subplots(1, 2, figsize=(PAGE, 3.2))
    for i, ((name,), some) in enumerate(group(rows, "region").items()):
        turn = i // len(COLOURS)  # a colour comes back with another line
        look = {
            "color": COLOURS[i % len(COLOURS)], "linestyle": LINES[(i + 3 * turn) % len(LINES)],
            "marker": MARKERS[i % len(MARKERS)], "markersize": 3.0,
        }  # fmt: skip
        condition = column(some, "condition")
        for quantity, label in (("gap_max", title(name)), ("gap_min", None)):
            left.plot(condition, column(some, quantity), label=label, **look)
        right.plot(condition, column(some, "area_ratio"), **look)
    left.axhline(0.0, color="black", linewidth=0.8)
    right.axhline(1.0, color="black", linewidth=0.8)
    left.set_ylabel(r"support beyond the exact sum / $\rho$" "\n(least and largest)")
    right.set_ylabel("area over the smallest\nenclosing ellipse")
    for panel in (left, right):
        panel.set_xscale("log")
        panel.set_xlabel(r"condition number $\lambda_1/\lambda_2$")
    figure.legend(loc="outside lower center", ncols=4)
    return figure
