"""
5. Why did it brake?
====================

A robot that plans with regions sometimes stops although the way looks free. A plan states its reasons, so that you
need not guess. This page provokes a stop, reads the reasons, and changes what caused it.
"""

# %%
# A stop
# ------
# The robot drives at 0.5 m/s. Suddenly a person is there, three metres ahead and a little aside, whom it has never
# seen before.

from wideberth import Detection, Observation, Path, build

SETTINGS = {
    "type": "mpc",
    "robot": "unicycle",
    "predictor": {"type": "kalman", "acceleration_density": 0.002},  # m^2/s^3: calm people
    "region": "mahalanobis_ellipse",
    "level": "fixed",  # asks for 95 % at every step; a plan that cannot keep it says so
    "solver": "riccati",
}
noise = [[0.0004, 0.0], [0.0, 0.0004]]  # m^2


def person(time):
    """Return a person who stands still."""
    return Detection("person", (4.0, 1.6), noise, radius=0.3)


def seen(time):
    """Return what the robot sees while it drives towards (0, 0)."""
    return Observation(time, (0.5 * time, 0.0, 0.0, 0.5, 0.0), detections=(person(time),))


planner = build("controllers", SETTINGS)
planner.set_path(Path([(-10, 0), (10, 0)]))
command = planner.command(seen(0.0))
print(command)
print(planner.plan.rung)

# %%
# Read the reason
# ---------------
# The plan is not ``optimal``: the planner has gone down its ladder of fallback plans. The reason names each rung that
# did not hold, and why.

print(planner.plan.reason)

# %%
# ``explain`` looks at the decision from outside: how many starting points were tried, and which constraint is broken
# most.

print(planner.explain().text())

# %%
# Look at it
# ----------
# The picture shows the cause at once. The speed of a person seen only once is unknown; the filter assumes that
# it may be anything a person can walk. The regions grow by a metre per second, until they close the way.

planner.plan.plot()

# %%
# Watch a little longer
# ---------------------
# The honest cure is to know more. After five seconds of watching the filter knows that the person stands, the regions
# stay small, and the robot drives past.

planner.reset()
planner.set_path(Path([(-10, 0), (10, 0)]))
for k in range(-10, 1):
    planner.remember(seen(0.5 * k))
planner.command(seen(0.0))
print(planner.plan.rung)
planner.plan.plot()

# %%
# Let the level give way
# ----------------------
# The other cure is a level that gives way at a price: ``relaxed`` holds 95 % where it can, and less where there is no
# other way, down to a ``minimum`` (0 stands for the bodies alone). The robot then goes on, and the plan says what it
# no longer promises: ``given_way`` has the probability that was asked for, the one that is held, from which step on,
# and because of whom.

planner = build("controllers", SETTINGS | {"level": {"type": "relaxed", "minimum": 0.0}})
planner.set_path(Path([(-10, 0), (10, 0)]))
planner.command(seen(0.0))
print(planner.plan.rung)
print(planner.plan.given_way)
planner.plan.plot()

# %%
# Whether that is right is yours to decide. It should not come as a surprise afterwards, therefore every plan says it.
#
# In an episode of a study
# ------------------------
# A study keeps the episodes that its ``show`` names, with every plan. ``wideberth play RESULT`` steps through them.
# In Python, look for the plans that are not optimal or gave way:
#
# .. code-block:: python
#
#    episode = wideberth.open_result("results/crossing").episodes["run-default-0"]
#    for plan in episode.robots[0].plans:
#        if plan.given_way or plan.rung != "optimal":
#            print(plan.stamp, plan.rung, plan.given_way, plan.reason)
#
# ``plan.plot()`` draws one of them.
#
# On a robot you will not sit beside every stop. The setting ``record`` writes failed or slow decisions to files, and
# ``wideberth explain FOLDER`` solves them again on your desk; see the guide :doc:`/solving`.
