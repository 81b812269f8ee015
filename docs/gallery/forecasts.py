"""
Forecasts of one walker
=======================

A walker has turned to the left during the last two seconds. What do the predictors expect of the next four? Each
ellipse holds 95 % of the forecast.
"""

import matplotlib.pyplot as plt
import numpy as np

from wideberth import GaussianObstacle, Tracks, build

DT = 0.4  # s, between two samples
heading = np.concatenate([np.zeros(4), np.linspace(0.0, 0.8, 6)])  # rad
step = 1.2 * DT * np.stack([np.cos(heading), np.sin(heading)], axis=-1)  # m
walk = np.cumsum(step, axis=0) - step.sum(axis=0)  # m, it ends in the origin
noise = 4e-4 * np.eye(2)  # m^2, of one measured position
tracks = Tracks(positions=walk[None], dt=DT, ids=("walker",), radius=(0.3,), noise=noise[None])

ellipse = build("regions", "mahalanobis_ellipse")
level = ellipse.level(tail=0.05)

figure, panels = plt.subplots(2, 3, figsize=(10, 6.5), sharex=True, sharey=True)
names = ("static", "constant_velocity", "kalman", "coordinated_turn", "imm", "var")
for panel, name in zip(panels.flat, names, strict=True):
    forecast = build("predictors", name).predict(tracks, steps=10)
    panel.plot(*walk.T, "k.-", label="observed")
    for mode in range(forecast.mean.shape[1]):
        panel.plot(*forecast.mean[0, mode].T, "C0.-", label="forecast" if mode == 0 else None)
        for centre, covariance in zip(
            forecast.mean[0, mode, 1::2], forecast.covariance[0, mode, 1::2], strict=True
        ):
            shape = ellipse.parameters(GaussianObstacle(centre, covariance), np.asarray(0.0))
            panel.fill(*ellipse.boundary(shape, level, count=100).T, color="C0", alpha=0.12)
    reason = forecast.fallback[0]
    panel.set_title(name if reason is None else f"{name}\n(fell back: {reason})", fontsize=9)
    panel.set_aspect("equal")
panels[0, 0].set(xlim=(-5, 7), ylim=(-3, 7))
panels[0, 0].legend(loc="upper left")
figure.supxlabel("x / m")
figure.supylabel("y / m")
figure.tight_layout()
