"""Functions of the robot and its problem that the planner in C calls beside the solver."""

from typing import Any

from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.robot import SymbolicDrive, step
from wideberth.framework.values.motion import Pose, Twist
from wideberth.solvers.export.constants import planner_constants
from wideberth.solvers.export.solver.exported import ExportedSolver


def kernels(robot: SymbolicDrive, solver: ExportedSolver) -> dict[str, Any]:
    """Return functions (v, p) of one column, by name; what has no result is left out.

    ``pose`` x -> place, heading; ``twist`` (x, u) -> linear, yaw rate; ``step`` (x, u) -> next x;
    ``drive`` (x, twist) -> u, and the same within a second, in the long run, and ``drive_within``
    (x, twist, s) -> u; ``state_at``
    (pose, twist) -> x; ``rates`` (x, u) -> dx/dt; ``limits`` (x, u) -> values >= 0; ``price``
    (x, u, next x), (place, direction, speed) -> cost.
    """
    problem = solver.subject.problem
    x, u, w = (ca.SX.sym(*one) for one in (("x", problem.states), ("u", problem.inputs), ("w", 3)))
    state, control = tuple(ca.vertsplit(x)), tuple(ca.vertsplit(u))
    wanted = Twist(tuple(ca.vertsplit(w[:2])), w[2])
    at, driven = robot.pose(state), robot.twist(state, control)
    heading: Any = at.heading
    place = ca.SX.sym("place", 3)
    pose = Pose(tuple(ca.vertsplit(place[:2])), place[2])
    none = ca.SX.sym("none", 0)

    duration = ca.SX.sym("duration")

    def drive(duration: Any) -> tuple[Any, Any, Any]:
        return ca.vertcat(x, w), none, ca.vertcat(*robot.drive(state, wanted, duration))

    both = ca.vertcat(x, u)
    found = {
        "pose": (x, none, ca.vertcat(*at.position, heading)),
        "twist": (both, none, ca.vertcat(*driven.linear, driven.angular)),
        "step": (both, none, ca.vertcat(*step(robot, state, control, problem.dt))),
        "drive": drive(problem.dt),
        "drive_second": drive(1.0),
        "drive_ever": drive(planner_constants()["FOREVER"]),
        "drive_within": (ca.vertcat(x, w, duration), none, drive(duration)[2]),
        "state_at": (ca.vertcat(place, w), none, ca.vertcat(*robot.state_at(pose, wanted))),
        "rates": (both, none, ca.vertcat(*robot.derivative(state, control))),
        "limits": (both, none, ca.vertcat(*robot.constraints(state, control))),
        "price": _price(problem, x, u),
    }
    return {
        f"plan_{name}": ca.Function("kernel", [v, p], [ca.densify(ca.SX(result))])
        for name, (v, p, result) in found.items()
        if ca.SX(result).numel()
    }


def _price(problem: Any, x: Any, u: Any) -> tuple[Any, Any, Any]:
    following, head = ca.SX.sym("next", problem.states), ca.SX.sym("head", problem.head_width)
    cost = problem.input_cost(x, u, head) + problem.state_cost(following, head)
    return ca.vertcat(x, u, following), head, cost
