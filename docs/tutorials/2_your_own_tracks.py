"""
2. Your own tracks
==================

You have recorded people, or another robot: a text file with one row per position. This page reads it, forecasts the
people in it, and lets a robot plan among them.
"""

# %%
# Read the file
# -------------
# A row holds ``frame id x y``, in metres, with blanks or commas between them. A header that names these columns may stand
# above them. The time between two rows is not in the file, so that you have to say it.
# A table with times in seconds instead of frames is read if its header says so, ``id,time,x,y`` in any order. At
# whatever rate it was recorded, it is resampled to the time that you say. Other names, or millimetres, need pandas:
#
# .. code-block:: python
#
#    table = pandas.read_csv("mine.csv")
#    table["x"], table["y"] = table["pos_x_mm"] / 1000, table["pos_y_mm"] / 1000
#    table[["id", "time", "x", "y"]].to_csv("people.csv", index=False)
#
# Here we read a recording that comes with the package; put the name of your own file in its place.

from importlib.resources import files

from wideberth.framework import read_tracks

file = files("wideberth") / "experiments" / "data" / "crowd.txt"
print("".join(file.read_text().splitlines(keepends=True)[:4]))

recording = read_tracks(str(file), dt=0.4)  # s
print(recording.report())

# %%
# The report says how many tracks are usable and why others are not. It also pays to look at the noise: the reader
# estimates it from the tracks themselves.

print(f"a position is measured to {100 * recording.noise.deviation:.1f} cm")

# %%
# Forecast the people
# -------------------
# ``tracks`` returns all people who were there at one moment, with their past. A predictor takes that, and returns where
# they will be: a mean and a covariance per person and step.

from wideberth import build, draw

row = 12  # the moment, 4.8 s after the recording began
tracks = recording.tracks(end_index=row, length=10)
predictor = build("predictors", "kalman")
forecast = predictor.predict(tracks, steps=12)
print(forecast.mean.shape)  # people, modes, steps, coordinates

ax = draw.forecast(forecast)
for track in tracks.positions:
    ax.plot(*track.T, "k.", markersize=3)
ax.set_title("dots: observed; ellipses: each holds its person with 95 %")

# %%
# Did it come true? The next rows of the recording tell.

import numpy as np

from wideberth.metrics import covered, reached_tail

mine = [recording.ids.index(name) for name in tracks.ids]
truth = recording.positions[mine, row + 1 : row + 13]
error = np.linalg.norm(forecast.mean[:, 0] - truth, axis=-1)  # m, per person and step
print(f"on average the mean is wrong by {np.nanmean(error):.2f} m")

tails = reached_tail(forecast.mean, forecast.covariance, forecast.weight, truth)
inside = covered(tails, tail=0.05)
print(f"{100 * np.nanmean(inside):.0f} % of the true positions lie inside")

# %%
# One moment is not enough to judge a predictor. :doc:`4_honest_forecasts` looks at all of them.
#
# Plan among them
# ---------------
# The robot crosses the place. At every row it is shown where the people are, as its own sensors would show it.

from wideberth import Detection, Observation, Path, recommended

robot = {"type": "unicycle", "radius": 0.3, "max_speed": 1.4}  # as wide as a person
planner = recommended(robot, speed=1.0, quiet=True)
planner.set_path(Path([(-2, 6), (-2, -6)]))


def seen(k: int):
    """Return what the robot sees at a row of the recording."""
    time = recording.times[k]
    people = [
        Detection(name, position, 1e-4 * np.eye(2), radius=0.3)
        for name, position in zip(recording.ids, recording.positions[:, k], strict=True)
        if np.isfinite(position).all()
    ]
    y = 4.0 - 1.0 * (time - recording.times[row])  # m: it drives downwards at 1 m/s
    state = (-2.0, y, -np.pi / 2, 1.0, 0.0)  # x, y, heading, speed, yaw rate
    return Observation(stamp=time, state=state, detections=people)


for k in range(row - 12, row):
    planner.remember(seen(k))
planner.command(seen(row))
draw.plan(planner.plan)

# %%
# In a study a robot drives through the whole recording, many times, and the distances are measured. The command line
# does that with your file:
#
# .. code-block:: sh
#
#    wideberth run replay --set tracks.path=people.txt --set tracks.dt=0.4 --set seeds=10
