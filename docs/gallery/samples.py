"""
Futures drawn from a forecast
=============================

A forecast is more than an ellipse per step: its steps belong together. Each thin line is one future that the Kalman
filter holds for possible.
"""

import numpy as np

from wideberth import Tracks, draw
from wideberth.predictors import Kalman

DT = 0.4  # s
walk = np.array([[1.1 * DT * k, 0.3 * DT * k] for k in range(-12, 1)])  # m
noise = 4e-4 * np.eye(2)  # m^2
tracks = Tracks(walk[None], DT, ids=("walker",), radius=(0.3,), noise=noise[None])

forecast = Kalman(acceleration_density=0.05).predict(tracks, steps=12)
futures = forecast.sample(np.random.default_rng(0), 60)[:, 0]  # (60, steps, 2), m

ax = draw.forecast(forecast)
for future in futures:
    ax.plot(*future.T, color="0.5", linewidth=0.4, zorder=1)
ax.plot(*walk.T, "k.", markersize=3)
