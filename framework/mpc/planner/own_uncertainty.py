"""The robot's own uncertainty: its pose covariance carried along the plan."""

from collections.abc import Callable
from typing import Any, Literal, TypeAlias, get_args

import numpy as np

from ...numerics.integration import NUDGE, slopes
from ...numerics.symbolic import Mapped, ca
from ...robot import Robot, SymbolicDrive, step
from ...values.arrays import Array
from ...values.errors import WideberthError
from ...values.motion import Twist

Growth: TypeAlias = Literal["open-loop", "feedback", "ignored"]
"""How the robot's own uncertainty grows over the horizon."""


class OwnUncertainty:
    """Covariance of where the robot's bodies will be, to be added to every obstacle's.

    From the covariance P_0 of the observed state, along the planned states and inputs,

        P_{i+1} = A_i P_i A_i^T,    A_i = df/dx (x_i, u_i)    (open-loop)

    or, with ``feedback``, A_i = df/dx + df/du d(drive)/dx, the derivative of
    x -> f(x, drive(x, twist_{i+1})): the velocity
    smoother and the low-level controller bring the robot to the planned twist at every step
    whatever its error was, so that errors of the speed do not add up; those of position and
    heading are not fed back. The position's covariance is H P H^T, H = dp/dx.

    The relative position of two independent Gaussians has the sum of their covariances, so
    that adding this one to the obstacle's serves every region. The paper takes the robot's
    own state as exact, which is what happens where the observation has no covariance.

    A body away from the robot's position (a disc of several, a corner) also moves with the
    heading. Whatever the correlation, for every place within ``reach`` of the position,

        Cov <= (1 + 1/b) H P H^T + (1 + b) reach^2 Var(heading) I,

    of which b with the least trace is taken.

    Parameters
    ----------
    robot : the model.
    dt : s per step of the plan.
    growth : see above; "ignored" gives zero.
    reach : m, how far centres and corners of the bodies are from the robot's position.

    Raises
    ------
    WideberthError : another growth than these.
    """

    def __init__(self, robot: Robot, dt: float, growth: Growth, reach: float) -> None:
        if growth not in get_args(Growth):
            raise WideberthError(
                f"own uncertainty is {growth!r}; wanted one of {get_args(Growth)}"
            )
        self._robot, self._dt, self._growth, self._reach = robot, dt, growth, reach
        x, u = ca.SX.sym("x", len(robot.states)), ca.SX.sym("u", len(robot.inputs))
        state = tuple(ca.vertsplit(x))
        pose = robot.pose(state)
        following = ca.vertcat(*step(robot, state, tuple(ca.vertsplit(u)), dt))
        place = ca.vertcat(*pose.position)
        heading = ca.SX(0) if pose.heading is None else ca.SX(pose.heading)
        rows = [ca.jacobian(following, x), ca.jacobian(following, u)]
        self._slopes = _Matrices("slopes", [x, u], rows)
        rows = [ca.jacobian(place, x), ca.jacobian(heading, x)]
        self._places = _Matrices("places", [x], rows)
        self._driven = _driven(robot, dt) if isinstance(robot, SymbolicDrive) else None

    def spread(
        self,
        covariance: Array | None,
        states: Array,
        inputs: Array,
    ) -> Array:
        """Covariances at steps 1..N, (N, D, D) m^2.

        Parameters
        ----------
        covariance : (n, n) of the plan's first state, or None where it is taken as exact.
        states, inputs : (N + 1, n) and (N, m), the plan to linearise along.
        """
        size = self._robot.dimension
        if covariance is None or self._growth == "ignored":
            return np.zeros((len(inputs), size, size))
        moved = np.asarray(covariance, dtype=np.float64)
        covariances = np.empty((len(inputs), *moved.shape))
        for i, slope in enumerate(self._steps(states, inputs)):
            moved = slope @ moved @ slope.T
            covariances[i] = moved
        return self._of_bodies(states[1:], covariances)

    def _steps(self, states: Array, inputs: Array) -> Array:
        """A_0 .. A_{N-1}, (N, n, n)."""
        if self._growth == "open-loop":
            return self._slopes.at(states[:-1], inputs)[0]
        if self._driven is not None:
            rows, gain = self._driven.at(states[:-1], states[1:], inputs)
            by_state, by_input = self._slopes.at(states[:-1], rows[..., 0])
            return np.asarray(by_state + by_input @ gain)
        robot, dt = self._robot, self._dt
        driven, gains = [], []
        for state, following, control in zip(states[:-1], states[1:], inputs, strict=True):
            twist = robot.twist(tuple(following.tolist()), tuple(control.tolist()))

            def drive(point: Array, twist: Twist = twist) -> Array:
                return np.array(robot.drive(tuple(point.tolist()), twist, dt))

            driven.append(drive(state))
            gains.append(slopes(drive, state))
        by_state, by_input = self._slopes.at(states[:-1], np.array(driven))
        return np.asarray(by_state + by_input @ np.array(gains))

    def _of_bodies(self, states: Array, covariances: Array) -> Array:
        """Covariances of the places (N, D, D), enlarged by what the heading moves them."""
        place, heading = self._places.at(states)
        spread = place @ covariances @ place.swapaxes(1, 2)
        turned = self._reach**2 * (heading @ covariances @ heading.swapaxes(1, 2))
        size = spread.shape[-1]
        trace = spread.trace(axis1=1, axis2=2)[:, None, None]
        both = (turned > 0.0) & (trace > 0.0)
        share = np.sqrt(np.divide(trace, size * turned, out=np.ones_like(turned), where=both))
        around = turned * np.eye(size)
        enlarged = (1.0 + 1.0 / share) * spread + (1.0 + share) * around
        spread = np.where(both, enlarged, spread + around)
        return np.asarray(0.5 * (spread + spread.swapaxes(1, 2)))


class _Matrices:
    """Matrices that depend on points, compiled once for each number of points."""

    def __init__(self, name: str, symbols: list[Any], matrices: list[Any]) -> None:
        self._function = ca.Function(name, symbols, [ca.densify(one) for one in matrices])
        self._mapped: dict[int, Mapped] = {}

    def at(self, *points: Array) -> list[Array]:
        """Evaluate at each of N points (N, n): one (N, rows, columns) array per result."""
        count = len(points[0])
        if count not in self._mapped:
            self._mapped[count] = Mapped(self._function.map(count))
        found = self._mapped[count](points)
        return [values.reshape(count, -1, values.shape[1]).swapaxes(1, 2) for values in found]


def _driven(robot: SymbolicDrive, dt: float) -> _Matrices:
    """Return (x, next x of the plan, u) -> drive(x), and its slopes as by `slopes`."""
    x, following = (ca.SX.sym(name, len(robot.states)) for name in ("x", "next"))
    u = ca.SX.sym("u", len(robot.inputs))
    twist = robot.twist(tuple(ca.vertsplit(following)), tuple(ca.vertsplit(u)))

    def drive(point: Any) -> Any:
        return ca.vertcat(*robot.drive(tuple(ca.vertsplit(point)), twist, dt))

    columns = []
    for i in range(len(robot.states)):
        ahead, back = ca.SX(x), ca.SX(x)
        ahead[i], back[i] = x[i] + NUDGE, x[i] - NUDGE
        columns.append((drive(ahead) - drive(back)) / (2.0 * NUDGE))
    return _Matrices("driven", [x, following, u], [drive(x), ca.horzcat(*columns)])


def carried(covariance: Array, motion: Callable[[Array], Array], state: Array) -> Array:
    """Covariance after a motion of the state, to first order."""
    slope = slopes(motion, state)
    return np.asarray(slope @ covariance @ slope.T)
