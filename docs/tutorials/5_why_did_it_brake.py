"""
5. Why did it brake?
====================

A robot that plans with regions sometimes brakes although the way looks free. A plan states its reasons, so that you
need not guess. This page makes a robot brake, reads the reasons, and changes what caused it.
"""

# %%
# It brakes
# ---------
# The robot drives at 0.5 m/s. Suddenly a person is there, 4 m ahead and 1.6 m aside, whom it has never seen before.

from wideberth import Detection, Observation, Path, build, controllers, draw

CALM = {"type": "kalman", "acceleration_density": 0.002}  # m^2/s^3: people who keep their velocity


def planner_of(level):
    """Return a planner whose regions hold what this level policy asks for."""
    return controllers.Planner(
        robot=build("robots", {"type": "unicycle", "radius": 0.3}),
        predictor=build("predictors", CALM),
        region=build("regions", "mahalanobis_ellipse"),
        level=build("levels", level),
        solver=build("solvers", "riccati"),
    )


noise = [[0.0004, 0.0], [0.0, 0.0004]]  # m^2


def person(time):
    """Return a person who stands still."""
    return Detection("person", (4.0, 1.6), noise, radius=0.3)


def seen(time):
    """Return what the robot sees while it drives towards (0, 0)."""
    return Observation(time, (0.5 * time, 0.0, 0.0, 0.5, 0.0), detections=(person(time),))


planner = planner_of("fixed")  # asks for 95 % at every step
planner.set_path(Path([(-10, 0), (10, 0)]))
command = planner.command(seen(0.0))
print(command)
print(planner.plan.rung)

# %%
# The command is 0.15 m/s, and the plan goes on to drive backwards.
#
# Read the reason
# ---------------
# The plan is not ``optimal``: the planner has gone down its ladder of fallback plans, here to ``least violation``. The
# reason says first what this plan holds of the 95 % that were asked for, from which step on, and because of whom.
# Then it names each rung that did not hold, and why, and at last the rung that was taken: ``entered by 0.8 at step 15`` is
# how deep its plan is in a region, without a unit, and when.

print(planner.plan.reason)

# %%
# ``explain`` says the same again and looks at the decision from outside: how many starting points were tried, and
# which constraints the plan breaks, each at its worst step.

print(planner.explain().text())

# %%
# Look at it
# ----------
# The picture shows the cause at once. The speed of a person seen only once is unknown; the filter assumes that
# it may be anything a person can walk, with a deviation of 1 m/s. The regions of 95 % grow by 2.4 m per second, faster
# than the robot drives: they reach it wherever it goes, and backing away only makes it less deep.

draw.plan(planner.plan)

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
draw.plan(planner.plan)

# %%
# Let the level give way
# ----------------------
# The other cure is a level that gives way at a price: ``relaxed`` holds 95 % where it can, and less where there is no
# other way, down to a ``minimum`` (0 stands for the bodies alone). The robot then goes on, and the plan is ``optimal``
# by what it weighs, but promises even less than the one that backed away: ``given_way`` has the probability that was
# asked for, the one that is held, from which step on, and because of whom, as the reason above began.

planner = planner_of({"type": "relaxed", "minimum": 0.0})
planner.set_path(Path([(-10, 0), (10, 0)]))
planner.command(seen(0.0))
print(planner.plan.rung)
print(planner.plan.given_way)
draw.plan(planner.plan)

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
# ``draw.plan(plan)`` draws one of them.
#
# On a robot you will not sit beside every stop. The setting ``record`` writes failed or slow decisions to files, and
# ``wideberth explain FOLDER`` solves them again on your desk; see the guide :doc:`/solving`.
