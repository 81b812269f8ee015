"""
An episode
==========

Three people cross the way of a robot. The picture shows where all of them went, and the place of the least clearance.
This planner takes its forecasts as certain, and touches a person. ``episode.animate()`` makes a film of it.
"""

from wideberth import build
from wideberth.simulation import Settings, run_episode

robot = build("robots", {"type": "unicycle", "radius": 0.4})
planner = build("controllers", {"type": "mpc_constant_velocity", "robot": robot})
cast = build("scenarios", {"type": "crossing_field", "walkers": 3, "reach": 4.0}).cast(seed=2)
agents = [place.agent(robot, planner, truth=False) for place in cast.placements]
episode = run_episode(agents, Settings(time_limit=30.0), others=cast.bystanders)

episode.plot()
