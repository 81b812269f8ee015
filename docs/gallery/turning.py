"""
People who turn
===============

In a hall people walk straight on until they turn. The predictor ``turning`` has a mode for each time of the turn and
each new direction, which leads to a place in the hall; a region keeps clear of each. Grey: the ellipses of a Kalman
filter, which expects that all people walk straight on, through the wall as well.
"""

import matplotlib.pyplot as plt
import numpy as np

from wideberth import Tracks, build, draw
from wideberth.predictors import Kalman

HALL = [(-4, -4), (6, -4), (6, 4), (-4, 4)]  # m, corners
DT = 0.25  # s

walk = np.array([[1.0 * DT * k, 0.25 * DT * k] for k in range(-12, 1)])  # m
noise = 4e-4 * np.eye(2)  # m^2
tracks = Tracks(walk[None], DT, ids=("walker",), radius=(0.3,), noise=noise[None])
forecast = build("predictors", {"type": "turning", "area": HALL}).predict(tracks, steps=24)

figure, ax = plt.subplots(figsize=(7, 5), layout="constrained")
draw.forecast(Kalman().predict(tracks, steps=24), ax)
ax.fill(*np.transpose(HALL), facecolor="none", edgecolor="k", label="hall")
for mean in forecast.mean[0]:
    ax.plot(*np.vstack([walk[-1:], mean]).T, color="C1")
ax.plot([], [], color="C1", label="turning")
ax.plot(*walk.T, "k.-", label="observed")
ax.set(xlabel="x / m", ylabel="y / m", aspect="equal", xlim=(-5, 10), ylim=(-5, 7.5))
ax.legend(loc="upper left", ncols=2)
