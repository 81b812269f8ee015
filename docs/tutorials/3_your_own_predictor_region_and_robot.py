"""
3. Your own predictor, region and robot
=======================================

Everything in a planner can be replaced by something of your own. This page writes a predictor, a region and a robot,
each in a few lines, and lets one planner drive with all three. Each is a class with a few methods; its fields are
its settings.
"""

# %%
# A predictor
# -----------
# A predictor turns tracks into a forecast: a mean and a covariance for each obstacle and step. This one expects that
# all people slow down to a halt, as people do who reach for their phone. It takes the Kalman filter's forecast, and
# shortens the way.

from dataclasses import dataclass
from typing import final

import numpy as np

from wideberth import Forecast, Predictor
from wideberth.predictors import Kalman


@final
@dataclass(frozen=True)
class Braking(Predictor):
    """All people slow down: p(t) = p(0) + v tau (1 - exp(-t / tau))."""

    time_constant: float = 3.0  # tau, s

    def predict(self, tracks, steps, scene=None):
        straight = Kalman().predict(tracks, max(steps, 2))
        mean = straight.mean[:, 0]  # (obstacles, steps, 2), m
        velocity = (mean[:, 1] - mean[:, 0]) / tracks.dt  # (obstacles, 2), m/s
        time = tracks.dt * np.arange(1, steps + 1)  # s
        missing = time - self.time_constant * (1.0 - np.exp(-time / self.time_constant))
        return Forecast.single(
            mean[:, :steps] - velocity[:, None] * missing[:, None],
            straight.covariance[:, 0, :steps],
            tracks.dt,
            straight.fallback,
        )


# %%
# Is it a good citizen? A contract check tests the laws that every predictor has to keep: that it does not depend on
# where the origin is, that it copes with a track of one sample, and so on. It says nothing if all hold; otherwise it
# names the law.

from wideberth.framework import check_predictor

check_predictor(Braking())

# %%
# A region
# --------
# A region is the set that the robot keeps out of, around one obstacle at one step. This one is a plain disc: as large
# as the longest axis of the ellipse that holds the obstacle with the asked probability, plus the radii of both bodies
# (the margin). The same set is written twice: as a constraint for the solver, and in NumPy.

import casadi

from wideberth import Region
from wideberth.framework import Constraint, Guarantee, Relation


@final
@dataclass(frozen=True)
class Disc(Region):
    """The disc around the ellipse of content 1 - tail, enlarged by the margin."""

    relation = Relation.OUTER  # it encloses the ellipse and the bodies
    guarantee = Guarantee.CONTENT  # outside, the promised content is kept

    def parameter_count(self, dimension):
        return 4

    def parameters(self, obstacle, margin):
        """Return x, y, the largest standard deviation, and the margin, all in m."""
        x, y = np.moveaxis(obstacle.mean, -1, 0)
        largest = np.sqrt(np.linalg.norm(obstacle.covariance, 2, axis=(-2, -1)))
        return np.stack(np.broadcast_arrays(x, y, largest, margin), axis=-1)

    def constraint(self, pose, parameters, level, auxiliary):
        """State log(distance^2 / radius^2) >= 0 outside."""
        x, y, deviation, margin = (parameters[i] for i in range(4))
        distance2 = (pose.position[0] - x) ** 2 + (pose.position[1] - y) ** 2
        radius = level * deviation + margin + 1e-9
        return Constraint((casadi.log((distance2 + 1e-18) / radius**2),))

    def radius(self, parameters, level):
        return np.asarray(level * parameters[..., 2] + parameters[..., 3])

    def contains(self, points, parameters, level):
        apart = np.linalg.norm(points - parameters[..., :2], axis=-1)
        return np.asarray(apart < self.radius(parameters, level))

    def boundary(self, parameters, level, count):
        angle = 2.0 * np.pi * np.arange(count) / count
        around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return parameters[:2] + self.radius(parameters, level) * around

    def area(self, parameters, level):
        return np.pi * self.radius(parameters, level) ** 2

    def level(self, tail, dimension=2):
        """Return how many standard deviations a tail stands for."""
        return float(np.sqrt(-2.0 * np.log(tail)))

    def tail(self, level, dimension=2):
        return float(np.exp(-(level**2) / 2.0))


from wideberth.framework import check_region

check_region(Disc())

# %%
# A robot
# -------
# A robot is its equation of motion and its limits. This cart takes on a speed and a yaw rate at once. NumPy's
# functions serve the solver too.

from wideberth import Pose, Robot, Twist
from wideberth.framework import Bounds, Quantity


@final
@dataclass(frozen=True)
class Cart(Robot):
    """State (x, y, phi), input (v, omega)."""

    states = (Quantity("x", "m"), Quantity("y", "m"), Quantity("phi", "rad"))
    inputs = (Quantity("v", "m/s"), Quantity("omega", "rad/s"))

    radius: float = 0.3  # m
    max_speed: float = 1.0  # m/s
    max_yaw_rate: float = 1.0  # rad/s

    def derivative(self, state, control):
        v, omega = control
        return v * np.cos(state[2]), v * np.sin(state[2]), omega

    def state_bounds(self):
        return Bounds.symmetric(np.inf, np.inf, np.inf)

    def input_bounds(self):
        return Bounds.symmetric(self.max_speed, self.max_yaw_rate)

    def pose(self, state):
        return Pose((state[0], state[1]), state[2])

    def twist(self, state, control):
        return Twist((control[0], 0.0), control[1])

    def acceleration(self, state, control):
        return Twist((0.0, 0.0), 0.0)

    def state_at(self, pose, twist):
        return (*pose.position, pose.heading)

    def drive(self, state, twist, duration):
        """Return the wanted twist within the limits."""
        v = np.clip(twist.linear[0], -self.max_speed, self.max_speed)
        return float(v), float(np.clip(twist.angular, -self.max_yaw_rate, self.max_yaw_rate))


from wideberth.framework import check_robot

check_robot(Cart())

# %%
# All three in one planner
# ------------------------
# ``build`` takes objects wherever it takes names.

from wideberth import Detection, Observation, Path, build, draw

planner = build(
    "controllers",
    {
        "type": "mpc",
        "robot": Cart(),
        "predictor": Braking(),
        "region": Disc(),
        "level": "fixed",  # every region holds 95 %
        "solver": "riccati",
    },
)
planner.set_path(Path([(0, 0), (10, 0)]))


def seen(time):
    """Return what the robot sees at a time, s."""
    noise = 1e-4 * np.eye(2)  # m^2
    person = Detection("person", (4.0, 1.0 + 0.3 * time), noise, radius=0.3)
    return Observation(stamp=time, state=(0.0, 0.0, 0.0), detections=(person,))


for k in range(-20, 0):
    planner.remember(seen(0.5 * k))
planner.command(seen(0.0))
draw.plan(planner.plan)

# %%
# To use your classes in configs and from the shell, put them into a file, and name them by their path:
#
# .. code-block:: sh
#
#    wideberth check region my_region:Disc
#    wideberth run crossing --quick --set planners.default.region=my_region:Disc
#
# A table of predictors and regions, yours among others, is a config of a few lines. ``planner_parts`` drives every
# pair through the same situations; ``levels`` and ``costs`` may be named beside them:
#
# .. code-block:: yaml
#
#    type: planner_parts
#    scenarios: {field: {type: crossing_field, walkers: 3, reach: 4.0}}
#    robot: &robot my_robot:Cart
#    planner: {<<: recommended, robot: *robot}
#    predictors: {braking: "my_predictor:Braking", kalman: kalman}
#    regions: {disc: "my_region:Disc", ellipse: mahalanobis_ellipse}
#    seeds: 2
#
# It keeps no episodes. To look at one, drive the pair in a ``comparison``, as in :doc:`6_a_figure_for_a_paper`.
#
# The guide :doc:`/write-your-own` has the laws of each kind, and many more kinds: level policies, costs,
# solvers, scenarios, studies, and so on.
