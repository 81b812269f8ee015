"""Assembles the MPC problem of any robot among things of any kind.

The paper's problem (its last display equation), for stages i = 0..N with the state x_0
given:

    minimise    sum_{i=1..N}  w_p |p_i - p_ref,i|^2 + w_v (v_i - v_ref,i)^2
              + sum_{i=0..N-1} w_a |a_i|^2 + w_alpha alpha_i^2  +  w_s (s - s_ref)^2
    subject to  x_{i+1} = f(x_i, u_i)                 i = 0..N-1
                u_i within its bounds                 i = 0..N-1
                x_i within its bounds, p_i outside the region of every obstacle, i = 1..N
    and, beyond the paper, the robot's bodies at p_i clear of things of other kinds.

This is with the paper's cost, `wideberth.framework.mpc.costs.tracking`; another may take its
place. The paper runs dynamics and input bounds over i = 1..N, which leaves x_k out and u_k free;
that cannot be meant, and we start both at 0. Its reference has x_r twice where the second
must be y_r: read literally, the robot tracks y = x. Costs are written on pose, twist and
acceleration, so that the weights mean the same for every robot; for the unicycle they are
the paper's to the letter.
"""

from collections.abc import Sequence
from typing import Any

from ..numerics.symbolic import ca
from ..robot import Robot
from ..robot import step as integrate
from ..values.arrays import positive, whole
from ..values.errors import WideberthError
from ..values.motion import Pose, Twist
from .costs.base import Cost, Moment, ProgressCost
from .costs.tracking import Tracking
from .levels.base import LevelPolicy, SharedLevel
from .ocp.problem import Problem, Slots
from .ocp.stage import Frame, ReferenceSymbols
from .problem_robot import robot_of_problem
from .slots.base import SlotKind, SlotSizes

REST = 1e-2
"""m/s and rad/s; a plan that ends slower than this is braked to a stop in the step after its end.
Zero itself would leave an interior point method without an interior."""


def assemble(
    robot: Robot,
    kinds: Sequence[SlotKind],
    level: LevelPolicy,
    *,
    horizon: int,
    dt: float,
    rooms: Sequence[SlotSizes],
    cost: Cost | None = None,
    penalty: float | None = None,
    stop_at_end: bool = False,
) -> Problem:
    """Build the MPC problem of any robot among things of several kinds.

    A robot of several discs has one constraint, with auxiliaries of its own, per disc.

    Parameters
    ----------
    robot, kinds, level : the plug-ins; only their interfaces are used.
    horizon : N, at least 1.
    dt : s per step.
    rooms : what there is room for of each kind; kinds behind the last one have no slots.
    cost : of each stage; the paper's by default. A `ProgressCost` adds a state and an input
        to the robot's, a `CommandCost` the last input to its states.
    penalty : price of one unit of slack (regions are unit-free); None keeps them hard.
    stop_at_end : whether the robot rests at x_N, its twist no more than `REST`. One whose input
        is the velocity can always stop, and needs no such condition.

    Raises
    ------
    WideberthError : horizon below 1, dt not positive, a negative size or penalty, more rooms than
        kinds.
    """
    _check(horizon, dt, kinds, rooms, penalty)
    cost = Tracking() if cost is None else cost
    robot = robot_of_problem(robot, cost, dt)
    x, u = ca.SX.sym("x", len(robot.states)), ca.SX.sym("u", len(robot.inputs))
    reference = ReferenceSymbols(robot.dimension, cost.curve_width(robot.dimension))
    by_input, by_state = _running_cost(_moment(robot, x, u, cost), u, cost, reference)
    on_input, on_state = _limits(robot, x, u)
    shared = isinstance(level, SharedLevel)
    s = ca.SX.sym("s", int(shared))
    pose = robot.pose(_split(x))
    frame = Frame(robot, x, pose, s)
    following = ca.vertcat(*integrate(robot, _split(x), _split(u), dt))
    return Problem(
        horizon=horizon,
        dt=dt,
        states=len(robot.states),
        inputs=len(robot.inputs),
        dimension=robot.dimension,
        curve=reference.curve.numel(),
        shared=shared,
        minimum=level.minimum if isinstance(level, SharedLevel) else 0.0,
        penalty=penalty,
        state_bounds=robot.state_bounds(),
        input_bounds=robot.input_bounds(),
        dynamics=ca.Function("dynamics", [x, u], [following]),
        input_cost=ca.Function("input_cost", [x, u, reference.vector], [by_input]),
        input_constraints=ca.Function("input_constraints", [x, u], [on_input]),
        state_cost=ca.Function("state_cost", [x, reference.vector], [by_state]),
        state_constraints=ca.Function("state_constraints", [x], [on_state]),
        terminal_constraints=_at_rest(robot, x, wanted=stop_at_end),
        level_cost=_level_cost(level, s),
        slots=_slots(kinds, rooms, frame),
        heading=_heading(pose, x),
    )


def _heading(pose: Pose, x: Any) -> int | None:
    """Return which entry of x the heading is, if it is one."""
    if pose.heading is None:
        return None
    same = [i for i, entry in enumerate(_split(x)) if ca.is_equal(entry, ca.SX(pose.heading))]
    return same[0] if same else None


def _at_rest(robot: Robot, x: Any, *, wanted: bool) -> Any:
    """State that x_N is at rest, REST - |twist|^2 / REST >= 0, as far as x contains the twist.

    One row, since two for each component made fatrop fail where the robot's own limits bound the
    same components. The yaw rate counts for a robot that can turn on the spot.
    """
    still, none = (0.0,) * robot.dimension, (0.0,) * len(robot.inputs)
    spun = robot.state_at(Pose(still, 0.0), Twist(still, 1.0))
    twist = robot.twist(_split(x), none)
    parts = [*twist.linear] + [twist.angular] * bool(robot.twist(spun, none).angular)
    moving = ca.vertcat(*[part for part in parts if ca.depends_on(ca.SX(part), x)])
    rows = ca.SX(0, 1)
    if wanted and moving.numel():
        rows = REST - ca.sumsqr(moving) / REST
    return ca.Function("terminal_constraints", [x], [rows])


def _level_cost(level: LevelPolicy, s: Any) -> Any:
    """Price of leaving the level aimed at."""
    target = ca.SX.sym("target")
    price = level.weight * (s - target) ** 2 if isinstance(level, SharedLevel) else ca.SX(0)
    return ca.Function("level_cost", [s, target], [price])


def _slots(
    kinds: Sequence[SlotKind], rooms: Sequence[SlotSizes], frame: Frame
) -> tuple[Slots, ...]:
    """Make the slots of each kind; none of those that no room is given for."""
    none: SlotSizes = ()
    given = [*rooms, *[none] * (len(kinds) - len(rooms))]
    return tuple(kind.slots(room, frame) for kind, room in zip(kinds, given, strict=True))


def _check(
    horizon: int,
    dt: float,
    kinds: Sequence[SlotKind],
    rooms: Sequence[SlotSizes],
    penalty: float | None,
) -> None:
    whole("horizon", horizon)
    positive("dt", dt)
    if len(rooms) > len(kinds):
        raise WideberthError(f"got {len(rooms)} rooms; wanted at most one for each of {kinds}")
    for kind, room in zip(kinds, rooms, strict=False):
        for size in room:
            whole(f"room for each {kind.name}", size, least=0)
    if penalty is not None:
        positive("penalty", penalty)


def _limits(robot: Robot, x: Any, u: Any) -> tuple[Any, Any]:
    """Split the robot's limits into those of (x_i, u_i), i < N, and those of x_i, i >= 1."""
    limits = robot.constraints(_split(x), _split(u))
    on_input = [limit for limit in limits if ca.depends_on(ca.SX(limit), u)]
    on_state = [limit for limit in limits if not ca.depends_on(ca.SX(limit), u)]
    return ca.vertcat(*on_input), ca.vertcat(*on_state)


def _running_cost(
    moment: Moment, u: Any, cost: Cost, reference: ReferenceSymbols
) -> tuple[Any, Any]:
    """Split the cost into a part of (x_i, u_i), i < N, and a part of x_i, i >= 1.

    The speed, say, belongs to the state for most robots; for one that takes velocities as
    inputs it depends on u and is paid against the reference of i + 1.
    """
    by_input, by_state = ca.SX(0), ca.SX(0)
    for term in cost.terms(moment, reference):
        if ca.depends_on(ca.SX(term), u):
            by_input += term
        else:
            by_state += term
    return by_input, by_state


def _moment(robot: Robot, x: Any, u: Any, cost: Cost) -> Moment:
    """Say how the robot moves, and where along its path it is if that is a state."""
    state, control = _split(x), _split(u)
    motion = robot.pose(state), robot.twist(state, control), robot.acceleration(state, control)
    if not isinstance(cost, ProgressCost):
        return Moment(*motion)
    return Moment(*motion, progress=state[-1], rate=control[-1])


def _split(vector: Any) -> tuple[Any, ...]:
    return tuple(ca.vertsplit(vector)) if vector.numel() else ()
