"""A planner put into the place of somebody else."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...predictor import Predictor
from ...robot import Robot, start_state
from ...values.arrays import Array
from ...values.forecast import Forecast, Scene
from ...values.motion import Detection, Observation, Pose, Twist
from ...values.path import Path
from ...values.plan import Status
from ...values.tracks import Tracks
from .planner import Planner


@dataclass(frozen=True, eq=False)
class Agent:
    """Somebody who is taken to run the planner.

    Attributes
    ----------
    state : (n,), of the planner's robot model.
    direction : (2,), unit vector in which the goal lies.
    speed : m/s, reference speed towards it.
    radius : m.
    """

    state: Array
    direction: Array
    speed: float
    radius: float


class FixedForecast(Predictor):
    """Repeats a forecast that was made elsewhere; changes from call to call of the planner."""

    forecast: Forecast

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Return the first steps of what was told; obstacles are in the order of the tracks."""
        told = self.forecast
        return Forecast(
            told.mean[:, :, :steps],
            told.covariance[:, :, :steps],
            told.weight,
            told.dt,
            told.fallback,
        )


class BestResponsePlanner:
    """Plans for agents, one after the other, each from scratch: it remembers nothing.

    Every instance is solved in the agent's own frame (its position the origin, its goal on
    the x axis), so that turning the world changes a plan by rounding errors alone. The
    planner's deadline and latency are left out: the same agent gets the same plan. So are
    further starts: each is a first plan, for which all would be tried.

    Parameters
    ----------
    planner : whose settings are used; it is not changed. Its robot moves in the plane.
    """

    def __init__(self, planner: Planner) -> None:
        self._told = FixedForecast()
        self._planner = replace(
            planner, predictor=self._told, history=2, latency=0.0, deadline=None, starts=()
        )
        self._planner.warns = False  # what others might do is nothing to warn of

    def steps(self, dt: float) -> int:
        """How many steps of ``dt`` s forecasts have to reach."""
        return int(np.ceil(self._planner.horizon * self._planner.dt / dt - 1e-9))

    def respond(
        self, agent: Agent, others: Forecast | None, radii: Sequence[float]
    ) -> tuple[Array, Array] | str:
        """Plan for an agent that keeps clear of the others.

        Parameters
        ----------
        agent : whose plan it is.
        others : one mode each, of at least `steps` steps; None if there are none.
        radii : m, theirs. The planner's robot may have another radius than the agent: the
            difference is added to theirs.

        Returns
        -------
        Times (N + 1,), s, and positions (N + 1, 2), m, of the plan; or why there is none.
        """
        planner = self._planner
        robot = planner.robot
        origin = _place(robot, agent.state)
        turn = np.stack([agent.direction, (-agent.direction[1], agent.direction[0])], axis=1)
        detections = []
        if others is not None:
            self._told.forecast = Forecast(
                (others.mean - origin) @ turn,
                turn.T @ others.covariance @ turn,
                others.weight,
                others.dt,
                others.fallback,
            )
            planner.track_dt = others.dt
            for index, radius in enumerate(radii):
                size = max(radius + agent.radius - robot.radius, 0.0)
                where = self._told.forecast.mean[index, 0, 0]
                detections.append(Detection(f"{index:04}", where, np.zeros((2, 2)), size))
        planner.reference_speed = agent.speed
        far = 2.0 * agent.speed * planner.horizon * planner.dt
        planner.reset()
        planner.set_path(Path(np.array([[0.0, 0.0], [far, 0.0]])))
        planner.command(
            Observation(0.0, _moved(robot, agent.state, origin, turn), tuple(detections))
        )
        plan = planner.plan
        raised = plan is not None and plan.status is Status.FAILED and not plan.iterations
        if plan is None or raised or plan.violation != plan.violation:
            return "no plan" if plan is None else plan.reason
        times = plan.dt * np.arange(len(plan.positions), dtype=np.float64)
        return times, plan.positions @ turn.T + origin


def state_of(robot: Robot, place: Array, velocity: Array, direction: Array) -> Array:
    """State of the robot at a place with a velocity; looks in ``direction`` where it stands."""
    speed = float(np.linalg.norm(velocity))
    way = velocity / speed if speed > 0 else direction
    return np.array(start_state(robot, place.tolist(), way.tolist(), speed)[0], dtype=np.float64)


def _place(robot: Robot, state: Array) -> Array:
    return np.array(robot.pose(tuple(state)).position, dtype=np.float64)


def _moved(robot: Robot, state: Array, origin: Array, turn: Array) -> Array:
    """Return the state in the frame with this origin, whose axes are the columns of ``turn``."""
    pose = robot.pose(tuple(state))
    twist = robot.twist(tuple(state), tuple(0.0 for _ in robot.inputs))
    place = tuple((_place(robot, state) - origin) @ turn)
    if pose.heading is None:
        linear = tuple(np.asarray(twist.linear, dtype=np.float64) @ turn)
        return np.array(robot.state_at(Pose(place), Twist(linear)), dtype=np.float64)
    angle = pose.heading - np.arctan2(turn[1, 0], turn[0, 0])
    angle = np.arctan2(np.sin(angle), np.cos(angle))
    return np.array(robot.state_at(Pose(place, angle), twist), dtype=np.float64)
