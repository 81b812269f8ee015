"""Regions of people who move, between the steps of a plan.

A plan keeps out of regions at its steps. Between two of them the robot goes on along its way and
the obstacle along its own, and both may have passed each other's side in the meantime.

**What is between.** Let R_i and R_{i+1} be an obstacle's regions at two steps, convex, with
support functions h_i and h_{i+1}, and p(u) = (1 - u) p_i + u p_{i+1} the robot's place at the
share u of the step. The region at u is taken as (1 - u) R_i + u R_{i+1}. Of the exact sum of an
ellipse and a disc it contains the region of the obstacle at (1 - u) x_i + u x_{i+1}, however x_i
and x_{i+1} are correlated: along a unit vector n the deviation is at most
(1 - u) sigma_i + u sigma_{i+1}, by the triangle inequality.

**One normal decides.** The regions between are, seen from the robot, all points of the convex hull
of R_i - p_i and R_{i+1} - p_{i+1}. So the robot is outside of all of them if and only if one
unit vector n has

    min(n . p_i - h_i(n), n . p_{i+1} - h_{i+1}(n)) >= 0,

and the largest such value over n is its distance from what is swept, negative where it enters.

**The robot's own way** is no chord. Under a constant acceleration a it is the chord less
u (1 - u) dt^2 a / 2, so that n . p is lower by at most the positive part of n . b with the bend
b = dt^2 a / 8, a dt^2 being the second difference of the places.

**A margin that is enough.** Let both ends be outside of ellipse plus disc of radius rho', so that
every point of either ellipse, seen from the robot, is rho' away or farther. The hull of both
ellipses comes nearest to the robot in a point of one of them, or of a segment from a point of the
one to a point of the other, at a right angle to it. If the segment has length l, its distance is
at least sqrt(rho'^2 - (l / 2)^2) by Pythagoras, which is rho or more for

    rho' = sqrt(rho^2 + (l / 2)^2).

That the hull holds the robot itself is excluded by letting both ellipses grow from their centres:
the distance is continuous, and never below rho. To l the displacement of the robot against the
mean adds its length at most; the ellipses' own points only what they move at a right angle to the
normal, the difference of s T Sigma n / sqrt(n . Sigma n) at both ends, T the projection along n.
Let a >= b be the largest and smallest deviation of an ellipse, D the difference of covariances and
d >= c its largest and smallest eigenvalue. Since |T Sigma n| <= (a^2 - b^2) / 2, and likewise of
D, the difference is at most s (a - b) of both ends together, and at most

    s (d - c) / (2 b_1) + s (a_0^2 - b_0^2) |D| / (2 b_0 b_1 (b_0 + b_1)),

and nothing where covariances are round. With the bend of the robot's way added to rho' the bound
is complete.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from ...framework.mpc.ocp.problem import SlotNumbers, Slots
from ...framework.mpc.ocp.stage import Frame
from ...framework.mpc.slots.base import PlanningContext, SlotAssignment, SlotSizes, farthest
from ...framework.mpc.slots.gaussian_discs import KnownDiscs, OfDiscs
from ...framework.region import Convex, Region
from ...framework.robot import Robot, SpeedLimited
from ...framework.robot import step as integrate
from ...framework.values.arrays import Array, altered
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import GaussianObstacle
from ...framework.values.motion import Pose
from ...framework.values.plan import Plan

ENTERED = 1e-3
"""m, from which depth on a region counts as entered between two steps."""
_LOOKS = 24
"""Directions that are tried all round before the best of them is refined."""
_HALVINGS = 16
"""Of the turn from one direction to the next, down to 4e-6 rad."""


@final
@dataclass(frozen=True, eq=False)
class _Segments:
    """Q segments between two steps, and at both ends the region of one obstacle each.

    Attributes
    ----------
    places : (2, Q, 2), m, of the robot. bend : (Q, 2), m, of its way.
    parameters : (2, Q, P) and level (2, Q) of the region.
    """

    region: Convex
    places: Array
    bend: Array
    parameters: Array
    level: Array

    def proven(self, angle: Array) -> Array:
        """Distance that one normal proves of each segment, (..., Q), m; the angles are in rad."""
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        pair = np.broadcast_to(normal[..., None, :, :], (*angle.shape[:-1], *self.places.shape))
        reach = self.region.support(pair, self.parameters, self.level)
        apart = (pair * self.places).sum(axis=-1) - reach
        bent = np.maximum((normal * self.bend).sum(axis=-1), 0.0)
        return np.asarray(apart.min(axis=-2) - bent)

    def most(self, start: Array) -> Array:
        """Largest distance that any normal proves of each segment, (Q,), m.

        Within a look of the best of all looks there is one maximum, and it stays within the width
        by which the best angle is turned next.
        """
        width = 2.0 * np.pi / _LOOKS
        turns = np.arange(_LOOKS)
        best, angle = self._best(start + width * turns[:, None])
        for _ in range(_HALVINGS):
            width *= 0.5
            best, angle = self._best(angle + width * np.array([[0.0], [-1.0], [1.0]]))
        return best

    def _best(self, angles: Array) -> tuple[Array, Array]:
        """Return the largest of several distances (T, Q), and its angle."""
        found = self.proven(angles)
        which = found.argmax(axis=0)[None]
        best, angle = (np.take_along_axis(one, which, axis=0)[0] for one in (found, angles))
        return best, angle

    def some(self, which: NDArray[np.intp]) -> "_Segments":
        """Return some of the segments, by their indices."""
        ends = self.places[:, which], self.bend[which], self.parameters[:, which]
        return _Segments(self.region, *ends, self.level[:, which])

    def towards_the_robot(self) -> Array:
        """Angle from the middle of what is swept to the nearest place of the robot, (Q,), rad."""
        axes = np.concatenate([np.eye(2), -np.eye(2)])[:, None, None]
        normals = np.broadcast_to(axes, (4, *self.places.shape))
        reach = self.region.support(normals, self.parameters, self.level)
        middle = 0.5 * np.stack([reach[0] - reach[2], reach[1] - reach[3]], axis=-1)
        first, last = self.places - middle
        way = last - first
        square = np.maximum((way * way).sum(axis=-1), 1e-300)
        share = np.clip(-(first * way).sum(axis=-1) / square, 0.0, 1.0)
        nearest = first + share[:, None] * way
        return np.asarray(np.arctan2(nearest[:, 1], nearest[:, 0]))


def entered_between(region: Convex, places: Array, parameters: Array, level: Array) -> Array:
    """How deep a robot enters regions on its way from steps 1..N-1 to the next, (N-1, K), m.

    Parameters
    ----------
    region : of every obstacle, in the plane.
    places : (N + 1, 2), m, of the robot at steps 0..N; the first one shows how its way bends.
    parameters, level : (N, K, P) and (N, K), of the regions at steps 1..N.
    """
    shape = (len(level) - 1, level.shape[1])
    depth = np.zeros(shape[0] * shape[1])
    if not depth.size:
        return depth.reshape(shape)
    turn = np.diff(places, n=2, axis=0)
    bend = (turn + np.concatenate([turn[1:], turn[-1:]])) / 16.0
    ends = np.stack([places[1:-1], places[2:]])[:, :, None]
    segments = _Segments(
        region,
        np.broadcast_to(ends, (2, *shape, 2)).reshape(2, -1, 2),
        np.broadcast_to(bend[:, None], (*shape, 2)).reshape(-1, 2),
        np.stack([parameters[:-1], parameters[1:]]).reshape(2, -1, parameters.shape[2]),
        np.stack([level[:-1], level[1:]]).reshape(2, -1),
    )
    start = segments.towards_the_robot()
    left = np.flatnonzero(segments.proven(start) < 0.0)
    if left.size:
        depth[left] = np.maximum(-segments.some(left).most(start[left]), 0.0)
    return depth.reshape(shape)


def plan_between(plan: Plan) -> Array | None:
    """How deep a plan enters the regions of its obstacles between its steps, (N-1, O), m.

    Of the levels that it holds. The regions are those of its forecast, without an uncertainty of
    the robot's own place, and without what a slot kind adds; obstacles of several modes count as
    not entered. What lies before step 1 is no part of the forecast.

    Parameters
    ----------
    plan : with its situation.

    Returns
    -------
    A column for each of the plan's ``ids``; None where situation or forecast is not known, and
    for regions that are not convex, bodies other than one disc, and in space.
    """
    known, forecast, size = plan.situation, plan.forecast, plan.positions.shape[1]
    if known is None or forecast is None or known.footprint is not None or size != 2:
        return None
    depth = np.zeros((len(plan.positions) - 2, len(plan.ids)))
    if not isinstance(known.region, Convex):
        return None
    places = {name: k for k, name in enumerate(plan.ids) if plan.ids.count(name) == 1}
    pairs = [
        (o, places[name])
        for o, name in enumerate(plan.tracked)
        if name in places and forecast.weight[o, 0] > 1.0 - 1e-9
    ]
    if pairs:
        who, columns = np.array(pairs).T
        mean, covariance = forecast.mean[who, 0], forecast.covariance[who, 0]
        gaussian = GaussianObstacle(mean.swapaxes(0, 1), covariance.swapaxes(0, 1))
        margin = np.broadcast_to(known.room + known.radii[who], (forecast.steps, len(who)))
        parameters = known.region.parameters(gaussian, margin)
        held = plan.level[:, columns]
        depth[:, columns] = entered_between(known.region, plan.positions, parameters, held)
    return depth


@final
@dataclass(frozen=True)
class BetweenSteps(OfDiscs):
    """Obstacles of the forecast, kept clear of between the steps too.

    In a planner's ``further_kinds`` it takes the place of `GaussianDiscs`, whose name it has.
    To the radius of each obstacle it adds what a step can lose at most::

        sqrt(rho^2 + (l / 2)^2) - rho + bend,    l = max (v dt + |mu_{i+1} - mu_i| + turn_i)

    with rho the radii and the margin, v the robot's largest speed, the turn of the ellipses' own
    points, see above, and the largest bend within the robot's limits. A plan that keeps its
    regions, of a kind that holds the exact sum of ellipse and disc, then keeps those of rho
    between steps 1..N as well. For regions inside of that sum the same holds around round
    covariances, where they are the sum. A planner with it needs no other margin for what lies
    between.

    Parameters
    ----------
    region : states the sets that the robot keeps out of; the planner's.
    """

    region: Region

    name: ClassVar[str] = "obstacle"

    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        """State the constraint of `GaussianDiscs`."""
        return self.discs.slots(room, frame)

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Choose discs as without, with larger radii; contact is that of the bodies.

        Raises
        ------
        WideberthError : a robot without a largest speed, or of another form than one disc.
        """
        if view.tracks is None or view.forecast is None:
            return self.discs.choose(robot, view)
        more = self.lost(robot, view)
        tracks = altered(view.tracks, radius=view.tracks.radius + more)
        chosen = self.discs.choose(robot, altered(view, tracks=tracks))
        assert isinstance(chosen.known, KnownDiscs)
        own = dict(zip(view.tracks.ids, view.tracks.radius, strict=True))
        discs = chosen.known.obstacles
        bare = altered(discs, radius=np.array([own[name] for name in discs.ids], dtype=np.float64))
        return altered(chosen, known=altered(chosen.known, obstacles=bare))

    def lost(self, robot: Robot, view: PlanningContext) -> Array:
        """Return by how much the radius of each obstacle grows, (O,), m.

        Raises
        ------
        WideberthError : as `choose`.
        """
        forecast, tracks, bodies = view.forecast, view.tracks, self.bodies(robot)
        assert forecast is not None and tracks is not None
        if not isinstance(robot, SpeedLimited) or farthest(bodies) > 0.0:
            raise WideberthError(
                f"the slot kind between_steps is made for robots of one disc with a largest "
                f"speed; got {robot}"
            )
        scale = self.levels(view.level, forecast.steps, len(tracks), robot.dimension).max()
        way = np.linalg.norm(np.diff(forecast.mean, axis=2), axis=-1)
        way += max(scale, 0.0) * turned_aside(forecast.covariance + view.own)
        half = 0.5 * (robot.max_speed * view.dt + way.max(axis=(1, 2), initial=0.0))
        rho = bodies[0].radius + view.margin + tracks.radius
        return np.asarray(np.hypot(rho, half) - rho + largest_bend(robot, view.dt))

    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        """Best auxiliaries of the region."""
        return self.discs.auxiliary_start(robot, pose, numbers)

    def explanation(self, dimension: int) -> str:
        """Quote the region, and say what the radius is."""
        grown = "The obstacle's radius holds what a step can lose, see `BetweenSteps`."
        return f"{self.discs.explanation(dimension)}\n\n{grown}"


def turned_aside(covariance: Array) -> Array:
    """How far points of ellipses of level 1 move at a right angle to their normal, at most, m.

    Between each two steps, (..., N, D, D) -> (..., N - 1), see above.
    """
    values = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    small, large = np.sqrt(values[..., 0]), np.sqrt(values[..., -1])
    change = np.linalg.eigvalsh(np.diff(covariance, axis=-3))
    first, last = small[..., :-1], small[..., 1:]
    lengths = first * last * (first + last)
    spread, most = change[..., -1] - change[..., 0], np.abs(change).max(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        smooth = 0.5 * spread / last
        smooth += 0.5 * (values[..., :-1, -1] - values[..., :-1, 0]) * most / lengths
    apart = large - small
    return np.asarray(np.fmin(smooth, apart[..., :-1] + apart[..., 1:]))


@lru_cache(maxsize=16)
def largest_bend(robot: Robot, dt: float) -> float:
    """Largest distance of a robot's way in one step from its chord, m, at its middle.

    Over the corners of the robot's bounds; what is not bounded is 0.
    """
    state, control = robot.state_bounds(), robot.input_bounds()
    corners = [
        (low, high) if np.isfinite([low, high]).all() else (0.0,)
        for bounds in (state, control)
        for low, high in zip(bounds.lower, bounds.upper, strict=True)
    ]
    bends = [0.0]
    for corner in product(*corners):
        start, given = corner[: len(robot.states)], corner[len(robot.states) :]
        way = [start, *(integrate(robot, start, given, time) for time in (0.5 * dt, dt))]
        places = [np.array(robot.pose(one).position, dtype=np.float64) for one in way]
        begin, middle, end = places
        bends.append(float(np.linalg.norm(middle - 0.5 * (begin + end))))
    return max(bends)
