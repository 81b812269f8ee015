"""Assembles the MPC problem of any robot and any region.

The paper's problem (its last display equation), for stages i = 0..N with the state x_0
given:

    minimise    sum_{i=1..N}  w_p |p_i - p_ref,i|^2 + w_v (v_i - v_ref,i)^2
              + sum_{i=0..N-1} w_a |a_i|^2 + w_alpha alpha_i^2  +  w_s (s - s_ref)^2
    subject to  x_{i+1} = f(x_i, u_i)                 i = 0..N-1
                u_i within its bounds                 i = 0..N-1
                x_i within its bounds, p_i outside the region of every obstacle, i = 1..N

The paper runs dynamics and input bounds over i = 1..N, which leaves x_k out and u_k free;
that cannot be meant, and we start both at 0. Its reference has x_r twice where the second
must be y_r: read literally, the robot tracks y = x. Costs are written on pose, twist and
acceleration, so that the weights mean the same for every robot; for the unicycle they are
the paper's to the letter.
"""

from dataclasses import dataclass
from typing import Any

from ..arrays import positive, whole
from ..integration import step as integrate
from ..motion import Twist
from ..region import Region
from ..robot import Robot
from ..symbolic import ca
from .levels.base import LevelPolicy
from .problem import Problem


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
) -> Problem:
    """Build the MPC problem of any robot among ``capacity`` obstacles.

    Parameters
    ----------
    robot, region, level : the plug-ins; only their interfaces are used.
    horizon : N, at least 1.
    dt : s per step.
    capacity : K, obstacle slots, at least 0.
    weights : of the cost; the paper's by default.
    penalty : price of one unit of slack (regions are unit-free); None keeps them hard.

    Raises
    ------
    WideberthError : horizon below 1, dt not positive, negative capacity or penalty.
    """
    whole("horizon", horizon)
    positive("dt", dt)
    whole("capacity", capacity, least=0)
    if penalty is not None:
        positive("penalty", penalty)
    x = ca.SX.sym("x", len(robot.states))
    u = ca.SX.sym("u", len(robot.inputs))
    stage = _Stage(region, capacity, robot.dimension)
    by_input, by_state = _running_cost(robot, x, u, stage, weights or Weights())
    on_input, on_state = _limits(robot, x, u)
    s, target = ca.SX.sym("s", int(level.shared)), ca.SX.sym("target")
    price = level.weight * (s - target) ** 2 if level.shared else ca.SX(0)
    inequalities, equalities = stage.outside(robot, region, x, s)
    following = ca.vertcat(*integrate(robot, _split(x), _split(u), dt))
    pull = stage.regularisation()
    return Problem(
        horizon=horizon,
        dt=dt,
        states=len(robot.states),
        inputs=len(robot.inputs),
        dimension=robot.dimension,
        capacity=capacity,
        width=stage.width,
        auxiliary=stage.extra,
        shared=level.shared,
        minimum=level.minimum,
        penalty=penalty,
        state_bounds=robot.state_bounds(),
        input_bounds=robot.input_bounds(),
        dynamics=ca.Function("dynamics", [x, u], [following]),
        input_cost=ca.Function("input_cost", [x, u, stage.vector], [by_input]),
        input_constraints=ca.Function("input_constraints", [x, u], [on_input]),
        state_cost=ca.Function("state_cost", [x, stage.lifted, stage.vector], [by_state + pull]),
        state_constraints=ca.Function("state_constraints", [x], [on_state]),
        regions=ca.Function(
            "regions", [x, stage.lifted, s, stage.vector], [inequalities, equalities]
        ),
        level_cost=ca.Function("level_cost", [s, target], [price]),
    )


class _Stage:
    """The symbols of one stage's parameters and auxiliaries, cut into named pieces."""

    def __init__(self, region: Region, capacity: int, dimension: int) -> None:
        self.extra = region.auxiliary(dimension)
        self.width = region.parameter_count(dimension)
        self.capacity = capacity
        extra = len(self.extra)
        self.position = ca.SX.sym("reference", dimension)
        self.direction = ca.SX.sym("direction", dimension)
        self.speed = ca.SX.sym("speed")
        self.region = ca.SX.sym("region", self.width, capacity)
        self.level = ca.SX.sym("level", capacity)
        self.active = ca.SX.sym("active", capacity)
        self.guess = ca.SX.sym("guess", extra, capacity)
        self.auxiliary = ca.SX.sym("auxiliary", extra, capacity)
        self.lifted = ca.vec(self.auxiliary)
        slots = ca.vertcat(self.region, self.level.T, self.active.T, self.guess)
        self.vector = ca.vertcat(self.position, self.direction, self.speed, ca.vec(slots))

    def outside(self, robot: Robot, region: Region, x: Any, s: Any) -> tuple[Any, Any]:
        """Regions of all slots; an inactive one states 1 >= 0 and ties no auxiliary."""
        inequalities, equalities = [], []
        pose = robot.pose(_split(x))
        for slot in range(self.capacity):
            level = s if s.numel() else self.level[slot]
            parts = region.constraint(pose, self.region[:, slot], level, self.auxiliary[:, slot])
            on = self.active[slot]
            inequalities += [on * value + (1 - on) for value in parts.inequalities]
            equalities += [on * value for value in parts.equalities]
        return ca.vertcat(*inequalities), ca.vertcat(*equalities)

    def regularisation(self) -> Any:
        """Pull of the auxiliaries towards their guess."""
        if not self.lifted.numel():
            return ca.SX(0)
        return self.extra.regularisation * ca.sumsqr(self.lifted - ca.vec(self.guess))


def _limits(robot: Robot, x: Any, u: Any) -> tuple[Any, Any]:
    """Split the robot's limits into those of (x_i, u_i), i < N, and those of x_i, i >= 1."""
    limits = robot.constraints(_split(x), _split(u))
    on_input = [limit for limit in limits if ca.depends_on(ca.SX(limit), u)]
    on_state = [limit for limit in limits if not ca.depends_on(ca.SX(limit), u)]
    return ca.vertcat(*on_input), ca.vertcat(*on_state)


def _running_cost(
    robot: Robot, x: Any, u: Any, stage: _Stage, weights: Weights
) -> tuple[Any, Any]:
    """Split the cost into a part of (x_i, u_i), i < N, and a part of x_i, i >= 1.

    The speed belongs to the state for most robots; for one that takes velocities as inputs
    it depends on u, and its cost is then paid at i = 0..N-1 against the reference of i + 1.
    """
    pose = robot.pose(_split(x))
    place = ca.vertcat(*pose.position)
    by_state = weights.position * ca.sumsqr(place - stage.position)
    twist = robot.twist(_split(x), _split(u))
    speed = weights.speed * _speed_error(twist, pose.heading is not None, stage)
    change = robot.acceleration(_split(x), _split(u))
    by_input = weights.acceleration * ca.sumsqr(ca.vertcat(*change.linear))
    by_input += weights.yaw_acceleration * change.angular**2
    if ca.depends_on(speed, u):
        return by_input + speed, by_state
    return by_input, by_state + speed


def _speed_error(twist: Twist, headed: bool, stage: _Stage) -> Any:
    """Squared error of the speed: forward speed where there is a heading, else velocity."""
    velocity = ca.vertcat(*twist.linear)
    if headed:
        wanted = ca.vertcat(stage.speed, ca.SX.zeros(velocity.numel() - 1))
    else:
        wanted = stage.speed * stage.direction
    return ca.sumsqr(velocity - wanted)


def _split(vector: Any) -> tuple[Any, ...]:
    return tuple(ca.vertsplit(vector)) if vector.numel() else ()
