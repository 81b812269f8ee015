"""The plan of another agent, as the planner would make it in its place."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from ...framework.mpc.planner.cycle import PlannerState, Services, step
from ...framework.mpc.planner.settings import PlannerSettings, changed
from ...framework.predictor import Predictor
from ...framework.robot import Robot, start_state
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast, Scene
from ...framework.values.motion import Detection, Observation, Pose, Twist
from ...framework.values.path import Path
from ...framework.values.plan import Status
from ...framework.values.tracks import Tracks


@dataclass(frozen=True, eq=False)
class Player:
    """An agent that is assumed to run the planner.

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


@final
@dataclass(frozen=True, eq=False)
class FixedForecast(Predictor):
    """Returns a forecast that was made elsewhere.

    Parameters
    ----------
    forecast : of the obstacles, in the order of the tracks; None where there are none.
    """

    forecast: Forecast | None = None

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Return the first steps of the forecast."""
        known = self.forecast
        if known is None:
            raise WideberthError("there are tracks and no forecast of them")
        return Forecast(
            known.mean[:, :, :steps],
            known.covariance[:, :, :steps],
            known.weight,
            known.dt,
            known.fallback,
        )


class BestResponsePlanner:
    """Plans for agents, one after the other, each from scratch: it remembers nothing.

    Every instance is solved in the agent's own frame (its position the origin, its goal on
    the x axis), so that turning the world changes a plan by rounding errors alone. The
    planner's deadline and latency are left out: the same agent gets the same plan. So are
    further starts: each is a first plan, for which all would be tried.

    Parameters
    ----------
    settings : of the planner that all agents are taken to run. Its robot moves in the plane.
    """

    def __init__(self, settings: PlannerSettings) -> None:
        self._settings = changed(
            settings, predictor=FixedForecast(), history=2, latency=0.0, deadline=None, starts=()
        )
        self._services = Services.of(self._settings)

    def steps(self, dt: float) -> int:
        """How many steps of ``dt`` s forecasts have to reach."""
        return int(np.ceil(self._settings.horizon * self._settings.dt / dt - 1e-9))

    def respond(
        self, agent: Player, others: Forecast | None, radii: Sequence[float]
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
        robot = self._settings.robot
        origin = _place(robot, agent.state)
        turn = np.stack([agent.direction, (-agent.direction[1], agent.direction[0])], axis=1)
        settings, detections = replace(self._settings, reference_speed=agent.speed), []
        if others is not None:
            forecast = Forecast(
                (others.mean - origin) @ turn,
                turn.T @ others.covariance @ turn,
                others.weight,
                others.dt,
                others.fallback,
            )
            settings = replace(settings, predictor=FixedForecast(forecast), track_dt=others.dt)
            for index, radius in enumerate(radii):
                size = max(radius + agent.radius - robot.radius, 0.0)
                where = forecast.mean[index, 0, 0]
                detections.append(Detection(f"{index:04}", where, np.zeros((2, 2)), size))
        far = 2.0 * agent.speed * settings.horizon * settings.dt
        state = PlannerState.initial(settings, Path(np.array([[0.0, 0.0], [far, 0.0]])))
        seen = Observation(0.0, _moved(robot, agent.state, origin, turn), tuple(detections))
        plan = step(settings, state, seen, self._services)[1].plan
        raised = plan.status is Status.FAILED and not plan.iterations
        if raised or plan.violation != plan.violation:
            return plan.reason
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
