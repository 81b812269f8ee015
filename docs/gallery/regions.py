"""
Regions around one forecast
===========================

A region is the set that the centre of the robot keeps out of. Each curve below encloses the same forecast:
a Gaussian that is wider than it is high, and correlated. All regions stand for a tail of 5 %, and all have the
radii of robot and obstacle, 0.75 m together, added. The dashed curve is the exact sum of the 95 % ellipse
and the disc of both radii. :ref:`reference-regions` says what each one promises.
"""

import matplotlib.pyplot as plt
import numpy as np

from wideberth import GaussianObstacle, WideberthError, build, names

covariance = np.array([[1.0, 0.4], [0.4, 0.25]])  # m^2
obstacle = GaussianObstacle(np.zeros(2), covariance)
margin = np.asarray(0.75)  # m, the radii of robot and obstacle


def outline(name):
    """Return the closed boundary of a region, or None where it has none for this Gaussian."""
    region = build("regions", name)
    try:
        shape = region.parameters(obstacle, margin)
        curve = region.boundary(shape, region.level(tail=0.05), count=300)
    except WideberthError:
        return None
    return np.append(curve, curve[:1], axis=0)


curves = {name: outline(name) for name in names("regions")}
curves = {name: curve for name, curve in curves.items() if curve is not None}
exact = curves["minkowski_sum"]

figure, panels = plt.subplots(4, 4, figsize=(9, 8), sharex=True, sharey=True)
for panel in panels.flat[len(curves) :]:
    panel.set_axis_off()
for panel, (name, curve) in zip(panels.flat, curves.items(), strict=False):
    panel.fill(*curve.T, color="C0", alpha=0.3)
    panel.plot(*exact.T, "k--", linewidth=0.8)
    panel.plot(0.0, 0.0, "k+")
    panel.set_title(name, fontsize=9)
    panel.set_aspect("equal")
figure.supxlabel("x / m")
figure.supylabel("y / m")
figure.tight_layout()
