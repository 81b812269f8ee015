"""A region of your own: the disc around the content ellipse, which is simple and rather large.

The script checks the laws of a region and draws the disc beside the exact sum of ellipse and body
into ``my_region.png``. A config names the region by its path, ``region: my_region:Disc``, if this
file lies in the folder where the command is given.
"""

from dataclasses import dataclass
from typing import ClassVar, final

import casadi
import matplotlib.pyplot as plt
import numpy as np

from wideberth import GaussianObstacle, Pose, Region, build, register
from wideberth.framework import (
    Array,
    BoolArray,
    Constraint,
    Guarantee,
    Relation,
    Scalar,
    check_region,
)

SMALL = 1e-9  # m or m^2, keeps logarithm and quotient finite for a point


@register("regions", "disc")
@final
@dataclass(frozen=True)
class Disc(Region):
    """The disc that encloses the content ellipse, enlarged by the margin.

    With the largest standard deviation sigma of the position, the level s and the margin rho, the
    radius of the disc is s sigma + rho. The level is the Mahalanobis radius of the ellipse inside.
    The parameters are (x, y, sigma, rho), in m.
    """

    relation: ClassVar[Relation] = Relation.OUTER  # it encloses ellipse plus body
    guarantee: ClassVar[Guarantee] = Guarantee.CONTENT  # outside, the risk is at most tail(level)

    def parameter_count(self, dimension: int) -> int:
        """Return the number of parameters: centre, deviation and margin."""
        return 4

    def parameters(self, obstacle: GaussianObstacle, margin: Array) -> Array:
        """Compute (x, y, sigma, rho) for a batch of obstacles."""
        x, y = np.moveaxis(obstacle.mean, -1, 0)
        largest_variance = np.linalg.norm(obstacle.covariance, 2, axis=(-2, -1))
        columns = np.broadcast_arrays(x, y, np.sqrt(largest_variance), margin)
        return np.stack(columns, axis=-1)

    def constraint(
        self, pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar
    ) -> Constraint:
        """State log(distance^2 / radius^2) >= 0: unit-free, with a slope at the boundary."""
        x, y, deviation, margin = (parameters[i] for i in range(4))
        squared_distance = (pose.position[0] - x) ** 2 + (pose.position[1] - y) ** 2
        radius = level * deviation + margin + SMALL
        return Constraint((casadi.log((squared_distance + SMALL**2) / radius**2),))

    def contains(self, points: Array, parameters: Array, level: Array) -> BoolArray:
        """Whether points lie inside; the NumPy twin of the constraint."""
        distance = np.linalg.norm(points - parameters[..., :2], axis=-1)
        return np.asarray(distance < self._radius(parameters, level))

    def boundary(self, parameters: Array, level: float, count: int) -> Array:
        """Return points on the circle, counter-clockwise."""
        angle = 2.0 * np.pi * np.arange(count) / count
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return parameters[:2] + self._radius(parameters, level) * direction

    def area(self, parameters: Array, level: Array) -> Array:
        """Area of the disc, m^2."""
        return np.pi * self._radius(parameters, level) ** 2

    def level(self, tail: float, dimension: int = 2) -> float:
        """Return s = sqrt(-2 log tail), the ellipse of content 1 - tail in the plane."""
        return float(np.sqrt(-2.0 * np.log(tail)))

    def tail(self, level: float, dimension: int = 2) -> float:
        """Return exp(-s^2 / 2), the inverse of `level`."""
        return float(np.exp(-(level**2) / 2.0))

    @staticmethod
    def _radius(parameters: Array, level: Array | float) -> Array:
        """Radius of the disc, m."""
        return np.asarray(level * parameters[..., 2] + parameters[..., 3])


def draw(file: str) -> None:
    """Draw the disc and the exact sum around one Gaussian with a content of 95 %."""
    covariance = np.array([[0.5, 0.2], [0.2, 0.15]])  # m^2
    obstacle = GaussianObstacle(np.zeros(2), covariance)
    margin = np.asarray(0.6)  # m, the radii of robot and obstacle
    figure, axes = plt.subplots(figsize=(5, 4))
    for region, style in ((Disc(), "k-"), (build("regions", "minkowski_sum"), "k--")):
        shape = region.parameters(obstacle, margin)
        curve = region.boundary(shape, region.level(0.05), 200)
        axes.plot(*np.append(curve, curve[:1], axis=0).T, style, label=type(region).__name__)
    axes.plot(0.0, 0.0, "k+", label="mean of the obstacle")
    axes.set(xlabel="x / m", ylabel="y / m", aspect="equal")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    figure.savefig(file, dpi=150, bbox_inches="tight")


if __name__ == "__main__":
    check_region(Disc())
    print("Disc keeps every law of a region")
    draw("my_region.png")
