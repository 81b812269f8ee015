"""Assembles the MPC problem of any robot and any region.

The paper's problem (its last display equation), for stages i = 0..N with the state x_0
given:

    minimise    sum_{i=1..N}  w_p |p_i - p_ref,i|^2 + w_v (v_i - v_ref,i)^2
              + sum_{i=0..N-1} w_a |a_i|^2 + w_alpha alpha_i^2  +  w_s (s - s_ref)^2
    subject to  x_{i+1} = f(x_i, u_i)                 i = 0..N-1
                u_i within its bounds                 i = 0..N-1
                x_i within its bounds, p_i outside the region of every obstacle, i = 1..N
    and, beyond the paper, the robot's bodies at p_i clear of every static polygon.

The paper runs dynamics and input bounds over i = 1..N, which leaves x_k out and u_k free;
that cannot be meant, and we start both at 0. Its reference has x_r twice where the second
must be y_r: read literally, the robot tracks y = x. Costs are written on pose, twist and
acceleration, so that the weights mean the same for every robot; for the unicycle they are
the paper's to the letter.
"""

from dataclasses import dataclass
from typing import Any

from ..arrays import Scalar, positive, whole
from ..errors import WideberthError
from ..integration import step as integrate
from ..motion import Pose, Twist
from ..region import Auxiliary, Constraint, Region
from ..robot import Robot
from ..static_region import StaticRegion
from ..symbolic import ca
from .bodies import bodies
from .levels.base import LevelPolicy
from .problem import Problem, Slots
from .stage import ReferenceSymbols, slots


@dataclass(frozen=True)
class Weights:
    """Weights of the paper's cost.

    Parameters
    ----------
    position : w_p, 1/m^2.
    speed : w_v, s^2/m^2.
    acceleration : w_a, s^4/m^2.
    yaw_acceleration : w_alpha, s^4/rad^2.
    """

    position: float = 100.0
    speed: float = 10.0
    acceleration: float = 1e4
    yaw_acceleration: float = 500.0

    def __post_init__(self) -> None:
        for name in ("position", "speed", "acceleration", "yaw_acceleration"):
            positive(f"weights.{name}", getattr(self, name), zero=True)


def assemble(
    robot: Robot,
    region: Region,
    level: LevelPolicy,
    *,
    horizon: int,
    dt: float,
    capacity: int,
    weights: Weights | None = None,
    penalty: float | None = None,
    static_region: StaticRegion | None = None,
    statics: int = 0,
    corners: int = 4,
) -> Problem:
    """Build the MPC problem of any robot among ``capacity`` obstacles and static polygons.

    A robot of several discs has one constraint, with auxiliaries of its own, per disc.

    Parameters
    ----------
    robot, region, level : the plug-ins; only their interfaces are used.
    horizon : N, at least 1.
    dt : s per step.
    capacity : K, obstacle slots, at least 0.
    weights : of the cost; the paper's by default.
    penalty : price of one unit of slack (regions are unit-free); None keeps them hard.
    static_region : what keeps clear of static polygons; needed where there are any.
    statics, corners : slots for convex polygons, and vertices that each has room for.

    Raises
    ------
    WideberthError : horizon below 1, dt not positive, negative capacity or penalty.
    """
    _check(horizon, dt, capacity, penalty, static_region, statics)
    x, u = ca.SX.sym("x", len(robot.states)), ca.SX.sym("u", len(robot.inputs))
    reference = ReferenceSymbols(robot.dimension)
    by_input, by_state = _running_cost(robot, x, u, reference, weights or Weights())
    on_input, on_state = _limits(robot, x, u)
    s = ca.SX.sym("s", int(level.shared))
    pose = robot.pose(_split(x))
    frame = x, pose, s
    following = ca.vertcat(*integrate(robot, _split(x), _split(u), dt))
    return Problem(
        horizon=horizon,
        dt=dt,
        states=len(robot.states),
        inputs=len(robot.inputs),
        dimension=robot.dimension,
        shared=level.shared,
        minimum=level.minimum,
        penalty=penalty,
        state_bounds=robot.state_bounds(),
        input_bounds=robot.input_bounds(),
        dynamics=ca.Function("dynamics", [x, u], [following]),
        input_cost=ca.Function("input_cost", [x, u, reference.vector], [by_input]),
        input_constraints=ca.Function("input_constraints", [x, u], [on_input]),
        state_cost=ca.Function("state_cost", [x, reference.vector], [by_state]),
        state_constraints=ca.Function("state_constraints", [x], [on_state]),
        terminal_constraints=ca.Function("terminal_constraints", [x], [ca.SX(0, 1)]),
        level_cost=_level_cost(level, s),
        obstacles=_moving(robot, region, capacity, frame),
        statics=_standing(robot, static_region, statics, corners, frame),
        heading=_heading(pose, x),
    )


def _heading(pose: Pose, x: Any) -> int | None:
    """Return which entry of x the heading is, if it is one."""
    if pose.heading is None:
        return None
    same = [i for i, entry in enumerate(_split(x)) if ca.is_equal(entry, ca.SX(pose.heading))]
    return same[0] if same else None


def _level_cost(level: LevelPolicy, s: Any) -> Any:
    """Price of leaving the level aimed at."""
    target = ca.SX.sym("target")
    price = level.weight * (s - target) ** 2 if level.shared else ca.SX(0)
    return ca.Function("level_cost", [s, target], [price])


def _check(
    horizon: int,
    dt: float,
    capacity: int,
    penalty: float | None,
    static_region: StaticRegion | None,
    statics: int,
) -> None:
    whole("horizon", horizon)
    positive("dt", dt)
    whole("capacity", capacity, least=0)
    whole("statics", statics, least=0)
    if penalty is not None:
        positive("penalty", penalty)
    if statics and static_region is None:
        raise WideberthError(f"{statics} static polygons need a static region; got None")


def _moving(robot: Robot, region: Region, count: int, frame: tuple[Any, Pose, Any]) -> Slots:
    """Make the slots of the Gaussian obstacles."""
    size = robot.dimension
    own, width = region.auxiliary(size), region.parameter_count(size)
    parts = bodies(robot, region)
    return slots(count, width, own, parts, region.constraint, frame, levelled=True)


def _standing(
    robot: Robot,
    region: StaticRegion | None,
    count: int,
    corners: int,
    frame: tuple[Any, Pose, Any],
) -> Slots:
    """Make the slots of the static polygons."""
    if region is None or not count:
        none = Constraint(())
        return slots(0, 0, Auxiliary(), (), lambda *_: none, frame, levelled=False)
    parts = bodies(robot, region)
    own = region.auxiliary(corners, max(len(parts[0].outline), 1))
    width = region.parameter_count(corners)

    def state(pose: Pose, parameters: Scalar, level: Scalar, auxiliary: Scalar) -> Constraint:
        return region.constraint(pose, parameters, auxiliary)  # it has no level

    return slots(count, width, own, parts, state, frame, levelled=False)


def _limits(robot: Robot, x: Any, u: Any) -> tuple[Any, Any]:
    """Split the robot's limits into those of (x_i, u_i), i < N, and those of x_i, i >= 1."""
    limits = robot.constraints(_split(x), _split(u))
    on_input = [limit for limit in limits if ca.depends_on(ca.SX(limit), u)]
    on_state = [limit for limit in limits if not ca.depends_on(ca.SX(limit), u)]
    return ca.vertcat(*on_input), ca.vertcat(*on_state)


def _running_cost(
    robot: Robot, x: Any, u: Any, reference: ReferenceSymbols, weights: Weights
) -> tuple[Any, Any]:
    """Split the cost into a part of (x_i, u_i), i < N, and a part of x_i, i >= 1.

    The speed belongs to the state for most robots; for one that takes velocities as inputs
    it depends on u, and its cost is then paid at i = 0..N-1 against the reference of i + 1.
    """
    pose = robot.pose(_split(x))
    place = ca.vertcat(*pose.position)
    by_state = weights.position * ca.sumsqr(place - reference.position)
    twist = robot.twist(_split(x), _split(u))
    speed = weights.speed * _speed_error(twist, pose.heading is not None, reference)
    change = robot.acceleration(_split(x), _split(u))
    by_input = weights.acceleration * ca.sumsqr(ca.vertcat(*change.linear))
    by_input += weights.yaw_acceleration * change.angular**2
    if ca.depends_on(speed, u):
        return by_input + speed, by_state
    return by_input, by_state + speed


def _speed_error(twist: Twist, headed: bool, reference: ReferenceSymbols) -> Any:
    """Squared error of the speed: forward speed where there is a heading, else velocity."""
    velocity = ca.vertcat(*twist.linear)
    if headed:
        wanted = ca.vertcat(reference.speed, ca.SX.zeros(velocity.numel() - 1))
    else:
        wanted = reference.speed * reference.direction
    return ca.sumsqr(velocity - wanted)


def _split(vector: Any) -> tuple[Any, ...]:
    return tuple(ca.vertsplit(vector)) if vector.numel() else ()
