"""The robot's own uncertainty: its pose covariance carried along the plan."""

from collections.abc import Callable
from typing import Literal, TypeAlias, get_args

import numpy as np

from ..arrays import Array
from ..errors import WideberthError
from ..integration import slopes, step
from ..robot import Robot
from ..symbolic import ca

Growth: TypeAlias = Literal["open-loop", "feedback", "ignored"]
"""How the robot's own uncertainty grows over the horizon."""


class OwnUncertainty:
    """Covariance of where the robot's bodies will be, to be added to every obstacle's.

    From the covariance P_0 of the observed state, along the planned states and inputs,

        P_{i+1} = A_i P_i A_i^T,    A_i = df/dx (x_i, u_i)    (open-loop)

    or, with ``feedback``, A_i the derivative of x -> f(x, drive(x, twist_{i+1})): the velocity
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
        self._slope = ca.Function("slope", [x, u], [ca.jacobian(following, x)])
        rows = [ca.jacobian(place, x), ca.jacobian(heading, x)]
        self._place = ca.Function("place", [x], rows)

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
        spread = np.empty((len(inputs), size, size))
        for i, (state, control) in enumerate(zip(states[:-1], inputs, strict=True)):
            slope = self._step(state, states[i + 1], control)
            moved = slope @ moved @ slope.T
            spread[i] = self._of_bodies(states[i + 1], moved)
        return spread

    def _step(self, state: Array, following: Array, control: Array) -> Array:
        """A_i."""
        if self._growth == "open-loop":
            return np.asarray(self._slope(state, control))
        robot = self._robot
        twist = robot.twist(tuple(following), tuple(control))

        def closed(point: Array) -> Array:
            now = tuple(float(value) for value in point)
            return np.array(step(robot, now, robot.drive(now, twist, self._dt), self._dt))

        return slopes(closed, state)

    def _of_bodies(self, state: Array, covariance: Array) -> Array:
        place, heading = (np.asarray(row) for row in self._place(state))
        spread = place @ covariance @ place.T
        turned = self._reach**2 * float((heading @ covariance @ heading.T)[0, 0])
        size = len(spread)
        trace = float(np.trace(spread))
        if turned > 0.0 and trace > 0.0:
            share = np.sqrt(trace / (size * turned))
            spread = (1.0 + 1.0 / share) * spread + (1.0 + share) * turned * np.eye(size)
        else:
            spread = spread + turned * np.eye(size)
        return np.asarray(0.5 * (spread + spread.T))


def carried(covariance: Array, motion: Callable[[Array], Array], state: Array) -> Array:
    """Covariance after a motion of the state, to first order."""
    slope = slopes(motion, state)
    return np.asarray(slope @ covariance @ slope.T)
