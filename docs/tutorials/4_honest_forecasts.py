"""
4. Honest forecasts
===================

A forecast says "the person will be inside this ellipse with 95 %". Is that true? This page counts. A planner can
only be as safe as its forecasts are honest: ellipses that are too small promise too much, and ellipses that are too
large block the way.
"""

# %%
# People who turn
# ---------------
# We draw forty people who walk for a minute and change their velocity at random, a little more than the Kalman filter
# expects by default. With people of your own, read their file as in :doc:`2_your_own_tracks`, and take
# ``recording.scene()``.

import numpy as np

from wideberth import Tracks, cut_windows

DT = 0.4  # s
rng = np.random.default_rng(1)
push = np.sqrt(0.06 * DT) * rng.standard_normal((40, 150, 2))  # m/s, per step
velocity = rng.normal(scale=0.8, size=(40, 1, 2)) + np.cumsum(push, axis=1)
walks = DT * np.cumsum(velocity, axis=1) + 0.02 * rng.standard_normal((40, 150, 2))  # m


def scene(positions):
    """Return tracks that are measured to 2 cm."""
    count = len(positions)
    noise = np.tile(0.02**2 * np.eye(2), (count, 1, 1))  # m^2
    return Tracks(positions, DT, tuple(map(str, range(count))), np.full(count, 0.3), noise)


# %%
# A window has a past, which the predictor sees, and a future, which it does not. Every walk gives many of them: here
# 24 samples of past and 12 of future. We judge on the first twenty people.

windows = cut_windows(scene(walks[:20]), observed=24, predicted=12, stride=4)
print(len(windows), "windows")

# %%
# Count
# -----
# ``reached_tail`` returns, for every window and step, how far out the true position lies: 0.3 means that it lies on
# the border of the region that leaves out 30 %. The truth lies in the 95 % region where that number is 0.05 or more.
# If forecasts are honest, this is so in 95 % of the cases.

from wideberth import build
from wideberth.metrics import displacement, reached_tail

predictors = {
    "the paper's var": build("predictors", {"type": "var", "covariance": "paper"}),
    "constant_velocity": build("predictors", "constant_velocity"),
    "kalman": build("predictors", "kalman"),
}


def judge(predictor):
    """Return the tails that the truth reached, and the mean error in m, by window and step."""
    forecast = predictor.predict(windows.tracks, steps=12)
    mean, covariance, weight = forecast.mean, forecast.covariance, forecast.weight
    tails = reached_tail(mean, covariance, weight, windows.future)
    return tails, displacement(mean, weight, windows.future)


tails = {}
for name, predictor in predictors.items():
    tails[name], error = judge(predictor)
    inside = np.mean(tails[name] >= 0.05)
    print(f"{name}: {100 * inside:.0f} % in the 95 % region, {error.mean():.2f} m from the mean")

# %%
# Look at all contents
# --------------------
# 95 % is one number of many. The curve shows every content at once: how often is the truth in the region that
# should hold it with 10 %, 20 %, ...? On the diagonal a forecast is honest. Below it promises too much, above it is
# more careful than it says.

import matplotlib.pyplot as plt

contents = np.linspace(0.01, 0.99, 50)


def draw(ax):
    """Draw the share of truths inside, by content."""
    ax.plot([0, 1], [0, 1], "k--", linewidth=1, label="honest")
    for name, reached in tails.items():
        share = [np.mean(reached >= 1 - content) for content in contents]
        ax.plot(contents, share, label=name)
    ax.set(xlabel="content of the region", ylabel="share of true positions inside")
    ax.legend()


draw(plt.figure().add_subplot())

# %%
# Make it honest
# --------------
# A *conformal* predictor looks at the errors of another one on recordings, and scales its covariances so that the
# regions hold what they say, whatever the distribution of the errors. It learns from the other twenty people: never
# judge a predictor on what it has learnt from.

from wideberth.predictors import Conformal

conformal = Conformal(build("predictors", "kalman"), tail=0.05)
fitted = conformal.fit([scene(walks[20:])])

tails = {}
for name, predictor in {"kalman": predictors["kalman"], "conformal": fitted}.items():
    tails[name], error = judge(predictor)
    print(f"{name}: {100 * np.mean(tails[name] >= 0.05):.1f} % in the 95 % region")

draw(plt.figure().add_subplot())

# %%
# It was fitted for a content of 95 %, and there it has to be right. ``adaptive_conformal`` does the same
# while the robot drives, without recordings of the place; it is the predictor that we recommend among people. See
# the guide :doc:`/predictors`.
