"""A kind of things of your own: carts, polygons that drive where the forecast says, drawn.

The planner keeps clear of discs around forecast obstacles and of polygons that stand still. A cart
is neither: its outline is known, and it moves along an uncertain forecast. The script checks the
laws of a kind, plans past a cart that crosses the way, and draws the plan into
``my_slot_kind.png``. No solver and no other file knows that there are carts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import erfc, sqrt
from typing import Any, ClassVar, final

import casadi
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Circle

from wideberth import Detection, Observation, Path, Pose, Robot, build, register
from wideberth.framework import (
    LIGHT,
    Array,
    Auxiliary,
    Body,
    BodyPath,
    Constraint,
    Frame,
    KnownObstacles,
    LevelledKind,
    LevelPolicy,
    PlanningContext,
    Promise,
    Scalar,
    SlotAssignment,
    SlotNumbers,
    Slots,
    SlotSizes,
    Touch,
    active_slots,
    best_direction,
    bodies,
    body_starts,
    check_slot_kind,
    deviations,
    next_capacity,
    separation,
    slots_of,
)

TINY = 1e-4  # m, gives the root of the variance a slope where the variance is zero
PLACE = 0.1  # m, on which the price of a turned line is felt


@register("slot_kinds", "carts")
@final
@dataclass(frozen=True)
class Carts(LevelledKind):
    """Convex polygons that move; the position is Gaussian, the heading that of the motion.

    A line with unit normal n(theta) separates the robot's body from the cart by the margin and s
    standard deviations of the cart's position along n:

        n . (v_i - w_j) - s sqrt(n^T C n) - margin >= 0

    for all corners v_i of the body and w_j of the cart. The collision risk of a step is then at
    most Phi(-s), Phi the normal distribution function. The angle theta is an extra variable of
    each cart and step. A slot holds the corners (x, y) of the cart at its mean position, m, the
    covariance C of its position and the robot's as (xx, xy, yy), m^2, and the margin, m.

    Parameters
    ----------
    outlines : name of a tracked obstacle -> corners of the cart in its own frame, m: x ahead, y to
        the left, counter-clockwise. Obstacles of other names are no carts.
    """

    outlines: Mapping[str, tuple[tuple[float, float], ...]]

    name: ClassVar[str] = "cart"

    @property
    def corners(self) -> int:
        """How many corners a slot has room for; a cart with fewer repeats its last one."""
        return max((len(outline) for outline in self.outlines.values()), default=3)

    def bodies(self, robot: Robot) -> tuple[Body, ...]:
        """Discs or the outline of the robot: a line may separate either."""
        return bodies(robot)

    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        """State that the line lies between the body and the cart."""
        count = room[0] if room else 0
        angle = Auxiliary((-np.inf,), (np.inf,), (0.0,), regularisation=1e-5)
        width = 2 * self.corners + 4
        body = self.bodies(frame.robot)
        return slots_of(self.name, count, width, angle, body, self._state, frame, levelled=True)

    def _state(self, pose: Pose, numbers: Scalar, level: Scalar, angle: Scalar) -> Constraint:
        """One inequality for each pair of corners, in units of 1 m."""
        normal = (casadi.cos(angle[0]), casadi.sin(angle[0]))
        xx, xy, yy, margin = (numbers[2 * self.corners + i] for i in range(4))
        variance = normal[0] ** 2 * xx + 2.0 * normal[0] * normal[1] * xy + normal[1] ** 2 * yy
        taken = level * casadi.sqrt(variance + TINY**2) + margin
        return Constraint(
            tuple(
                normal[0] * (x - numbers[2 * j]) + normal[1] * (y - numbers[2 * j + 1]) - taken
                for x, y in pose.corners()
                for j in range(self.corners)
            )
        )

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Keep the carts that come closest to the route; each mode of a forecast has a slot."""
        names, mean, covariance = self._forecast(view)
        apart = np.linalg.norm(mean[None] - view.route[:, :, None], axis=3).min(axis=(0, 1))
        order = np.argsort(apart, kind="stable")
        kept, left_out = np.sort(order[: view.most]), np.sort(order[view.most :])
        polygons = self._polygons([names[i] for i in kept], mean[:, kept])
        margin = self.bodies(robot)[0].radius + view.margin
        numbers = self._numbers(
            polygons, covariance[:, kept] + view.own[:, None], margin, view.level
        )
        known = KnownCarts(self, tuple(names), self._polygons(names, mean), view.margin)
        return SlotAssignment(
            (len(numbers.active),),
            tuple(names[i] for i in kept),
            tuple(names[i] for i in left_out),
            numbers,
            known,
        )

    def _forecast(self, view: PlanningContext) -> tuple[list[str], Array, Array]:
        """Names, means (N, O, 2) and covariances (N, O, 2, 2) of all modes of all carts."""
        steps = len(view.reference.position)
        if view.tracks is None or view.forecast is None:
            return [], np.zeros((steps, 0, 2)), np.zeros((steps, 0, 2, 2))
        ids, forecast = view.tracks.ids, view.forecast
        owner, mode = np.nonzero(forecast.weight >= LIGHT)
        mine = np.array([ids[o] in self.outlines for o in owner], dtype=bool)
        owner, mode = owner[mine], mode[mine]
        mean = forecast.mean[owner, mode].swapaxes(0, 1)
        covariance = forecast.covariance[owner, mode].swapaxes(0, 1)
        return [ids[o] for o in owner], mean, covariance

    def _polygons(self, names: list[str], mean: Array) -> Array:
        """Corners of carts at their means (N, O, 2), turned into their motion, (N, O, V, 2)."""
        steps = np.diff(mean, axis=0, prepend=2.0 * mean[:1] - mean[1:2])
        heading = np.arctan2(steps[..., 1], steps[..., 0])
        outlines = np.zeros((len(names), self.corners, 2))
        for k, name in enumerate(names):
            outline = np.array(self.outlines[name])
            outlines[k] = outline[np.minimum(np.arange(self.corners), len(outline) - 1)]
        cos, sin = np.cos(heading)[..., None], np.sin(heading)[..., None]
        x, y = outlines[None, ..., 0], outlines[None, ..., 1]
        return mean[:, :, None] + np.stack([x * cos - y * sin, x * sin + y * cos], axis=-1)

    def _numbers(
        self, polygons: Array, covariance: Array, margin: float, level: LevelPolicy
    ) -> SlotNumbers:
        """Fill the slots; an empty one holds a point with a variance of 1 m^2."""
        steps, count = polygons.shape[:2]
        capacity = next_capacity(count)
        numbers = np.zeros((steps, capacity, 2 * self.corners + 4))
        numbers[..., 2 * self.corners :] = (1.0, 0.0, 1.0, 0.0)
        numbers[:, :count, : 2 * self.corners] = polygons.reshape(steps, count, 2 * self.corners)
        numbers[:, :count, 2 * self.corners : -1] = covariance.reshape(steps, count, 4)[
            ..., [0, 1, 3]
        ]
        numbers[:, :count, -1] = margin
        levels = self.levels(level, steps, capacity, 2)
        return SlotNumbers(
            numbers, active_slots(count, capacity), np.zeros((steps, capacity, 0)), levels
        )

    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        """Angle of the line that leaves most room between body and cart."""
        found, cut = numbers.parameters, 2 * self.corners
        polygons = found[..., :cut].reshape(*found.shape[:2], self.corners, 2)
        assert numbers.level is not None  # every cart has one
        spread = numbers.level[..., None] ** 2 * found[..., cut : cut + 3]
        spread = spread[..., [0, 1, 1, 2]].reshape(*found.shape[:2], 2, 2)

        def start(at: Pose) -> Array:
            normal = best_direction(at.corner_points(), polygons, spread)[1]
            return np.arctan2(normal[..., 1], normal[..., 0])[..., None]

        return body_starts(self.bodies(robot), pose, found.shape[1], start)

    def levels(self, policy: LevelPolicy, steps: int, count: int, dimension: int) -> Array:
        """Return the s at which Phi(-s) is the tail that the policy aims at, at every step."""
        return np.full((steps, count), deviations(policy))

    def tail(self, level: float, promise: Promise, dimension: int) -> float:
        """Phi(-s), which bounds the collision risk; 1 below level 0."""
        return 0.5 * erfc(level / sqrt(2.0)) if level >= 0.0 else 1.0

    def explanation(self, dimension: int) -> str:
        """Say what a slot holds."""
        return (
            f"They are the corners (x, y) of the cart at its mean position, m ({self.corners} of "
            "them, counter-clockwise), the covariance of its position and the robot's (xx, xy, "
            "yy), m^2, and the margin, m."
        )


@final
@dataclass(frozen=True, eq=False)
class KnownCarts(KnownObstacles):
    """All carts of a forecast, at their means, also those without a slot.

    Attributes
    ----------
    kind, names : of the O carts.
    polygons : (N, O, V, 2), m, at steps 1..N.
    margin : m, added around the robot's bodies.
    """

    kind: Carts
    names: tuple[str, ...]
    polygons: Array
    margin: float

    def touched(self, robot: Robot, states: Array) -> Touch:
        """Hold the body on its way to step i against the cart on its way there, i = 2..N.

        Where the carts are before step 1 the forecast does not say.
        """
        found = Touch.none(len(states) - 1)
        for body in self.kind.bodies(robot) if self.names else ():
            way = BodyPath.of(robot, body, states)
            before = np.concatenate([self.polygons[:1], self.polygons[:-1]])[:, None]
            share = way.share[:, None, None, None]
            carts = before + share * (self.polygons[:, None] - before)  # (N, L, O, V, 2)
            gap = separation(way.corners[:, :, None], carts)[0].min(axis=1) - body.radius
            deepest = gap.argmin(axis=1)
            depth = np.maximum(-gap.min(axis=1), 0.0)
            depth[depth <= way.cut] = 0.0
            found = found.deeper(Touch(depth, tuple(self.names[k] for k in deepest)))
        return found

    def overlap(self, robot: Robot, states: Array) -> Array:
        """How deep the bodies are in the carts at steps 1..N, (N,), m."""
        pose = robot.pose(tuple(states[1:].T))
        depth = np.zeros(len(states) - 1)
        for body in self.kind.bodies(robot) if self.names else ():
            corners = body.at(pose).corner_points()[:, None]
            gap = separation(corners, self.polygons)[0] - body.radius - self.margin
            depth = np.maximum(depth, -gap.min(axis=1))
        return depth


CART = ((0.8, 0.3), (-0.8, 0.3), (-0.8, -0.3), (0.8, -0.3))  # m, 1.6 m long and 0.6 m wide


def planner(**changes: Any) -> Any:
    """Make a planner that keeps clear of the cart besides all that it knows anyway."""
    settings = {
        "type": "mpc", "robot": {"type": "unicycle", "radius": 0.4}, "region": "minkowski_sum",
        "predictor": "kalman", "level": {"type": "fixed", "tail": 0.1}, "horizon": 10,
        "solver": "fatrop", "further_kinds": [Carts({"cart": CART})],
    }  # fmt: skip
    return build("controllers", {**settings, **changes})


def drive(made: Any) -> Any:
    """Let the planner watch the cart for a while, and plan as it is about to cross the way."""
    made.set_path(Path([(0.0, 0.0), (12.0, 0.0)]))
    for time in np.arange(-4.0, 0.0, 0.5):  # s
        made.remember(seen(time))
    made.command(seen(0.0))
    return made.plan


def seen(time: float) -> Observation:
    """Return what the robot sees at a time, s."""
    state = (0.0, 0.0, 0.0, 0.5, 0.0)  # x, y, heading, speed, yaw rate
    place = (2.5, -1.6 + 0.5 * time)  # m, the cart drives north at 0.5 m/s
    return Observation(time, state, [Detection("cart", place, 1e-4 * np.eye(2), 0.05)])


def draw(plan: Any, file: str) -> None:
    """Draw the robot and the cart at every second step, from light to dark."""
    kind = Carts({"cart": CART})
    mean = plan.forecast.mean[0, 0]
    carts = kind._polygons(["cart"], mean[:, None])[:, 0]
    figure, axes = plt.subplots(figsize=(7, 4.5), layout="constrained")
    for i in range(1, len(plan.states), 2):
        shade = 0.15 + 0.7 * i / len(plan.states)
        axes.add_patch(Circle(plan.positions[i], 0.4, fill=False, color="C0", alpha=shade))
        axes.fill(*carts[i - 1].T, facecolor="none", edgecolor="C3", alpha=shade)
    axes.plot(*plan.positions.T, color="C0", label="robot, every second step")
    axes.plot(*mean.T, color="C3", label="cart, forecast")
    axes.set(xlabel="x / m", ylabel="y / m", aspect="equal")
    axes.legend(loc="upper left")
    figure.savefig(file, dpi=150)


if __name__ == "__main__":
    check_slot_kind(Carts({"a": CART, "b": CART[:3]}))
    print("Carts keeps every law of a kind")
    plan = drive(planner())
    draw(plan, "my_slot_kind.png")
    print("The plan is", plan.rung, "and keeps clear of the", plan.ids[-1])
