"""
A forecast in space
===================

Everything works in three dimensions as well. A drone climbs; the forecast of a Kalman filter is an ellipsoid at each
step, which holds it with 95 %.
"""

import matplotlib.pyplot as plt
import numpy as np

from wideberth import Tracks, build, draw

DT = 0.4  # s
walk = np.array([[0.9 * DT * k, 0.3 * DT * k, 0.25 * DT * k] for k in range(-12, 1)])  # m
noise = 4e-4 * np.eye(3)  # m^2
tracks = Tracks(walk[None], DT, ids=("drone",), radius=(0.3,), noise=noise[None])
forecast = build("predictors", "kalman").predict(tracks, steps=12)

figure = plt.figure(figsize=(6.5, 6), layout="constrained")
ax = draw.forecast(forecast, figure.add_subplot(projection="3d"))
ax.plot(*walk.T, "k.-", label="observed")
