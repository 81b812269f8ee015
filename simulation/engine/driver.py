"""A robot in a running episode: its plant, its controller and its log."""

from bisect import bisect_right
from copy import copy, deepcopy
from dataclasses import replace
from math import isfinite, nan

import numpy as np

from ...framework.controller import Controller
from ...framework.mpc.planner.emergency import command_of_plan
from ...framework.robot import start_state
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Command, Observation
from ...framework.values.path import Path
from ...framework.values.plan import Plan
from ...metrics.gaps import BodyMotion
from ..log.episode_log import AgentLog, CommandLog
from .agents import RobotAgent, along
from .plant import Plant


class Driver:
    """Steps one robot and writes its log. Changes as the episode runs.

    Parameters
    ----------
    agent : whom it drives, from the start of the path.
    plant : its body.
    came : s, when it stands there.
    absent : number of instants of the episode before that.

    Attributes
    ----------
    present : False once it has left.
    """

    def __init__(
        self, agent: RobotAgent, plant: Plant, came: float = 0.0, absent: int = 0
    ) -> None:
        self.agent = agent
        self.present: bool = True
        self.absent: int = absent
        self.paths: list[tuple[float, Path]] = [(came, agent.path)]
        self.plant: Plant = plant
        self.states: list[tuple[float, ...]] = [
            *absent * [_nowhere(self.plant.state)],
            self.plant.state,
        ]
        self.controls: list[tuple[float, ...]] = [
            *absent * [_nowhere(self.plant.control)],
            self.plant.control,
        ]
        self.positions: list[tuple[float, ...]] = [
            *absent * [_nowhere(self.plant.position)],
            self.plant.position,
        ]
        self.reached: float = nan
        self.skipped = 0
        self.commands: list[tuple[float, float, Command]] = []
        self.plans: list[Plan] = []
        self.seconds: list[float] = []
        agent.controller.reset()
        agent.controller.set_path(agent.path)

    def clone(self, controller: Controller | None = None) -> "Driver":
        """Return another driver in the same state, with a log of its own that goes on from here.

        Parameters
        ----------
        controller : decides from now on; None for a copy of this one's, with all that it
            remembers.

        Raises
        ------
        WideberthError : the controller cannot be copied.
        """
        try:
            decides = deepcopy(self.agent.controller) if controller is None else controller
        except Exception as error:  # compiled problems, say
            raise WideberthError(
                f"the controller of {self.name} cannot be copied ({error}); give another one"
            ) from None
        twin = copy(self)
        twin.agent, twin.plant = replace(self.agent, controller=decides), copy(self.plant)
        twin.paths, twin.states, twin.controls = [*self.paths], [*self.states], [*self.controls]
        twin.positions, twin.commands = [*self.positions], [*self.commands]
        twin.plans, twin.seconds = [*self.plans], [*self.seconds]
        return twin

    @property
    def name(self) -> str:
        """Identity."""
        return self.agent.name

    @property
    def radius(self) -> float:
        """Radius of the disc, m."""
        return self.agent.radius

    def state_before(self, time: float) -> Array:
        """State at a time up to 0, on the way to the start, (n,)."""
        path, robot = self.agent.path, self.agent.robot
        place = along(path, np.array([self.agent.speed * time]))[0]
        direction = path.direction(np.zeros(1))[0]
        return np.array(start_state(robot, place, direction, self.agent.speed)[0])

    def position_at(self, time: float, clock: list[float]) -> Array:
        """Where the robot was at a time up to now, (D,), m; NaN where it was absent."""
        if time <= 0.0:
            if self.absent:
                return np.full(self.agent.robot.dimension, nan)
            return np.asarray(along(self.agent.path, np.array([self.agent.speed * time]))[0])
        index = min(bisect_right(clock, time), len(clock) - 1)
        first, second = np.array(self.positions[index - 1]), np.array(self.positions[index])
        share = (time - clock[index - 1]) / (clock[index] - clock[index - 1])
        if share in (0.0, 1.0) and (self.absent or not self.present):
            return second if share else first  # at an instant itself the other does not count
        return np.asarray(first + min(share, 1.0) * (second - first))

    def future(self, times: Array, now: float) -> Array:
        """Where the robot means to be, (T,) -> (T, D), m; of people see `Foresight`.

        Its current plan, straight on beyond the plan's end; before its first plan (or
        without one) along its path at the reference speed, standing where that is unknown. NaN
        once it has left.
        """
        if not self.present:
            return np.full((len(times), self.agent.robot.dimension), nan)
        plan = self.agent.controller.last_plan
        here = np.array(self.positions[-1])
        if plan is None:
            path = self.paths[-1][1]
            speed = np.nan_to_num(self.agent.reference)
            return along(path, path.project(here) + speed * (times - now))
        clock = plan.stamp + plan.dt * np.arange(len(plan.positions))
        ahead = clock > now + 1e-9
        clock = np.concatenate([[now], clock[ahead]])
        places = np.concatenate([here[None], plan.positions[ahead]])
        inside = np.stack([np.interp(times, clock, column) for column in places.T], axis=-1)
        last = plan.positions[-1] - plan.positions[-2]
        beyond = np.maximum(times - clock[-1], 0.0)[:, None] * last / plan.dt
        return np.asarray(inside + beyond)

    def take(self, time: float, path: Path) -> None:
        """Follow another path from now on; a goal reached before does not count for it."""
        self.paths.append((time, path))
        self.reached = nan
        self.agent.controller.set_path(path)

    def leave(self) -> None:
        """Be gone from the newest instant on."""
        self.present = False
        for series in (self.states, self.controls, self.positions):
            series[-1] = _nowhere(series[-1])

    def tick_time(self, tick: int) -> float:
        """Time of a decision, s."""
        return self.agent.phase + tick * self.agent.controller.period

    def advance(self, time: float, duration: float, tolerance: float) -> None:
        """Step the plant and log the result."""
        if not self.present:
            for series in (self.states, self.controls, self.positions):
                series.append(series[-1])
            return
        self.plant.advance(time, duration)
        self.states.append(self.plant.state)
        self.controls.append(self.plant.control)
        self.positions.append(self.plant.position)
        goal = self.paths[-1][1].goal
        here = self.plant.believed
        away = sum((float(a) - b) ** 2 for a, b in zip(goal, here, strict=True)) ** 0.5
        if self.reached != self.reached and away <= tolerance:
            self.reached = time + duration

    def decide(self, observation: Observation) -> Command:
        """Ask the controller.

        Raises
        ------
        WideberthError : the command is not finite or has another dimension.
        """
        command = self.agent.controller.command(observation)
        size = self.agent.robot.dimension
        numbers = (*command.linear, command.omega, command.ramp)
        if len(command.linear) != size or not all(isfinite(v) for v in numbers):
            raise WideberthError(
                f"the controller of {self.name} returned {command} at {observation.stamp:g} s; "
                f"wanted {size} finite linear components, omega and ramp"
            )
        return command

    def meanwhile(self, time: float, plan: Plan | None) -> Command | None:
        """Return the command of a tick at which the controller is still busy.

        It follows the last plan, shifted: a late solve finds the robot where that plan
        wanted it, not straight on. None, to go on as commanded, where there is no plan.
        """
        if plan is None:
            return None
        return command_of_plan(
            self.agent.robot, plan, max(int((time - plan.stamp) / plan.dt + 1e-6), 0)
        )

    def note(
        self,
        stamp: float,
        effect: float,
        command: Command,
        seconds: float,
        plan: Plan | None,
    ) -> None:
        """Write down a decision, and the plan behind it as an onlooker sees it."""
        self.commands.append((stamp, effect, command))
        self.seconds.append(seconds)
        if plan is not None:
            forecast = plan.forecast
            if forecast is not None and forecast.joint_source is not None:
                forecast = replace(forecast, joint_source=None)
            self.plans.append(replace(plan, seconds=0.0, forecast=forecast))

    def latest(self, steps: int = 1) -> BodyMotion:
        """Return the way of the last ``steps`` intervals between two instants."""
        last = self.states[-1 - steps :]
        heading = [self.agent.robot.pose(state).heading for state in last]
        headings = np.array([nan if value is None else value for value in heading], float)
        where = np.array(self.positions[-1 - steps :])
        return BodyMotion(self.radius, where, headings, self.agent.robot.footprint)

    def log(self) -> AgentLog:
        """Return all that was noted."""
        robot = self.agent.robot
        states = tuple(np.array(self.states).T)
        controls = tuple(np.array(self.controls).T)
        pose, twist = robot.pose(states), robot.twist(states, controls)
        count = len(self.states)
        linear = np.stack([np.broadcast_to(v, count) for v in twist.linear], axis=-1)
        heading = nan if pose.heading is None else pose.heading
        return AgentLog(
            name=self.name,
            kind="person" if self.agent.person else "robot",
            radius=self.radius,
            positions=np.stack(pose.position, axis=-1),
            headings=np.broadcast_to(np.asarray(heading, dtype=np.float64), count).copy(),
            speeds=np.linalg.norm(linear, axis=-1),
            yaw_rates=np.broadcast_to(np.asarray(twist.angular, np.float64), count).copy(),
            paths=tuple(self.paths),
            speed=self.agent.reference,
            period=self.agent.controller.period,
            reached=self.reached,
            skipped=self.skipped,
            commands=self._command_log(),
            plans=tuple(self.plans),
            footprint=robot.footprint,
        )

    def _command_log(self) -> CommandLog:
        size = self.agent.robot.dimension
        rows = [(stamp, effect, *c.linear, c.omega, c.ramp) for stamp, effect, c in self.commands]
        table = np.array(rows, dtype=np.float64).reshape(len(rows), 4 + size)
        return CommandLog(
            table[:, 0], table[:, 1], table[:, 2 : 2 + size], table[:, -2], table[:, -1]
        )


def _nowhere(values: tuple[float, ...]) -> tuple[float, ...]:
    return (nan,) * len(values)
