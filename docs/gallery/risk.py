"""
The risk of touching, and a region
==================================

Each place has a collision probability: that the body of a robot there overlaps the body of the obstacle, whose place
is uncertain. The white line is where the risk is 5 %; the dashed line is the paper's ellipse of content 95 %, enlarged
by both radii. It stays outside nearly everywhere, as it counts more than the touching.
"""

import matplotlib.pyplot as plt
import numpy as np

from wideberth import GaussianObstacle, build
from wideberth.framework import collision_probability

covariance = np.array([[1.0, 0.4], [0.4, 0.25]])  # m^2
radii = 0.75  # m, of both bodies together

x, y = np.meshgrid(np.linspace(-4, 4, 120), np.linspace(-2.6, 2.6, 80))
places = np.stack([x, y], axis=-1)
every = np.broadcast_to(covariance, (*x.shape, 2, 2))
risk = collision_probability(-places, every, np.full(x.shape, radii))

figure, ax = plt.subplots(figsize=(7, 4.2), layout="constrained")
shown = ax.pcolormesh(x, y, risk, cmap="magma", shading="gouraud")
figure.colorbar(shown, label="collision probability")
ax.contour(x, y, risk, levels=[0.05], colors="white")

region = build("regions", "mahalanobis_ellipse")
shape = region.parameters(GaussianObstacle(np.zeros(2), covariance), np.asarray(radii))
curve = region.boundary(shape, region.level(tail=0.05), count=200)
ax.plot(*np.append(curve, curve[:1], axis=0).T, "w--")
ax.set(xlabel="x / m", ylabel="y / m", aspect="equal")
