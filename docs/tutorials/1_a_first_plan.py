"""
1. A first plan
===============

A robot drives along a corridor at 1 m/s. A person comes from the right and will cross its path. In a few lines the
robot plans how to get past, and we look at its plan.
"""

# %%
# The planner
# -----------
# A planner needs many choices: how people are forecast, how far the robot keeps away, what a comfortable
# motion is. :py:obj:`~wideberth.recommended` makes all of them for a robot and a speed, and prints what it chose.
# Lengths are in metres and angles in radians. A robot that is only named, ``"unicycle"``, is that of the paper, with a
# radius of 0.75 m.

import wideberth

robot = {
    "type": "unicycle",
    "radius": 0.3,
    "max_speed": 1.4,
    "max_yaw_rate": 1.0,
    "max_yaw_acceleration": 1.0,
}
planner = wideberth.recommended(robot, speed=1.0)

# %%
# The path leads 12 m straight on. The planner follows it where it can.

from wideberth import Path

planner.set_path(Path([(0, 0), (12, 0)]))

# %%
# What the robot sees
# -------------------
# A detection is one measured position of an obstacle, with its uncertainty and its radius. All lengths are in
# metres, all times in seconds. The robot watches the person for five seconds, four times a second, while it
# comes nearer. ``remember`` adds an observation to what the planner knows.

from wideberth import Detection, Observation

noise = [[0.0004, 0.0], [0.0, 0.0004]]  # m^2: each coordinate is measured to 2 cm


def seen(time):
    """Return what the robot sees at a time, s."""
    position = (6.0, -1.5 + 0.8 * time)  # m: the person walks upwards at 0.8 m/s
    person = Detection("person", position, noise, radius=0.3)
    state = (time, 0.0, 0.0, 1.0, 0.0)  # x, y, heading, speed, yaw rate
    return Observation(stamp=time, state=state, detections=(person,))


for k in range(-20, 0):
    planner.remember(seen(0.25 * k))

# %%
# The plan
# --------
# ``command`` plans, and returns what the robot should do now: the speed to reach and how fast to turn.

command = planner.command(seen(0.0))
print(command)

# %%
# The whole plan is there to be looked at. A dot is where the robot plans to be, and the shape of the same shade is
# what it keeps out of at that moment: the region around the person, where the centre of the robot must not be. The
# regions grow, because a forecast is less certain the further ahead it reaches.

plan = planner.plan
wideberth.draw.plan(plan)

# %%
# How good is the plan? ``optimal`` says that the solver found the best motion that keeps out of the regions drawn
# above. If it had not, the robot would fall back to the next rung of a ladder of plans, and ``plan.reason`` would
# say why. The regions drawn are those of the level that the plan holds. The recommended level may give way: where
# 95 % would cost a long detour, regions hold somewhat less, at a price. Then the reason says how much, and from which
# step on; ``plan.given_way`` is that as a value, and None where all that was asked for is kept. Steps that lie some
# seconds ahead are planned again many times before the robot gets there.

print(plan.rung, plan.reason)

# %%
# The forecast behind the plan can be drawn alone. An ellipse holds the person with 95 %. An emergency stop has none.

if plan.forecast is not None:
    wideberth.draw.forecast(plan.forecast)

# %%
# Try another speed of the person, or another path, and look again. In :doc:`2_your_own_tracks` the people are
# recorded.
