"""What to do when there is no plan to choose from, and what to command of one."""

import numpy as np

from ...control.command_limits import within_bounds, within_reach
from ...robot import Robot
from ...values.arrays import Array, checked
from ...values.failures import caught
from ...values.motion import Command, Observation
from ...values.plan import Plan, Rung, Status
from .rollout import brake


def command_of_plan(robot: Robot, plan: Plan, step: int = 0) -> Command:
    """Aim at the twist of the step after ``step``, over one MPC step, for the paper's smoother.

    A robot whose input is the velocity itself takes it at once. Beyond the plan's end it
    is the command to stop.
    """
    if step >= len(plan.inputs):
        return Command((0.0,) * robot.dimension, ramp=plan.dt)
    state, control = tuple(plan.states[step + 1].tolist()), tuple(plan.inputs[step].tolist())
    twist = robot.twist(state, control)
    other = robot.twist(state, tuple([value + 1.0 for value in control]))
    direct = twist.linear != other.linear or twist.angular != other.angular
    linear = tuple(map(float, twist.linear))
    return Command(linear, float(twist.angular), 0.0 if direct else plan.dt)


def emergency(
    robot: Robot, observation: Observation, reason: str, horizon: int, dt: float
) -> tuple[Plan, Command]:
    """Brake without looking; where even that fails, command zero velocity at once.

    A state beyond the limits is taken as on them, as in every plan: the command is then within
    them, and the low-level controller brakes as hard as it can to get there.
    """
    try:
        checked("the observed state", observation.state, (None,))
        states, inputs = brake(robot, within_bounds(robot, observation.state), horizon, dt)
        positions = np.stack(robot.pose(tuple(states.T)).position, axis=-1)
        plan = _unchecked(observation, reason, states, inputs, positions, dt)
        return plan, within_reach(robot, command_of_plan(robot, plan))
    except Exception as error:
        reason = f"{reason}; braking: {caught(error)}"
        states = np.zeros((horizon + 1, len(robot.states)))
        inputs = np.zeros((horizon, len(robot.inputs)))
        positions = np.zeros((horizon + 1, robot.dimension))
        plan = _unchecked(observation, reason, states, inputs, positions, dt)
        return plan, Command((0.0,) * robot.dimension)


def _unchecked(
    observation: Observation,
    reason: str,
    states: Array,
    inputs: Array,
    positions: Array,
    dt: float,
) -> Plan:
    """Wrap a trajectory that was held against nothing; its violation is not known."""
    none = np.zeros((len(inputs), 0))
    return Plan(
        stamp=observation.stamp,
        dt=dt,
        states=states,
        inputs=inputs,
        positions=positions,
        reference=np.broadcast_to(positions[0], positions[1:].shape),
        auxiliaries=none[..., None],
        level=none,
        target=none,
        content=none,
        ids=(),
        status=Status.NOT_RUN,
        rung=Rung.BRAKE,
        reason=reason,
        violation=float("nan"),
    )
