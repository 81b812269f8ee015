"""Model predictive control with ORCA's optimality conditions of all people in it, after SICNav."""

from dataclasses import dataclass, fields, replace
from typing import ClassVar, final

import numpy as np

from wideberth.controllers.reactive import Preparing, Reactive
from wideberth.controllers.steering import limited, steer, velocity_of
from wideberth.framework.control.command_limits import within_bounds
from wideberth.framework.mpc.planner.rollout import brake, follow, shift
from wideberth.framework.robot import step
from wideberth.framework.values.arrays import Array, whole
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation

from .bilevel_program import CrowdScene, OrcaRules, program

MOST_PEOPLE = 10
"""In a programme. One for ten takes 2 s of processor time to build, one for twenty 14 s."""


@final
@dataclass(eq=False)
class BilevelOrca(Reactive, Preparing):
    """Plans its own way and the people's answers in one programme: each answers by ORCA.

    The upper level is a model predictive controller of the robot. The lower level is a programme
    per person and step: of the velocities that keep all half-planes of ORCA, the nearest to the
    wanted one. Its optimality conditions stand in the upper level as constraints, so that a plan
    knows how people make way for it::

        min  sum_k |p_k - c|^2 / 2 + 100 |p_K - c|^2 / 2 + sum_k 0.1 omega_k^2 / 2
        x_{k+1} = f(x_k, u_k),   u, x, |v| within limits,   |v_{k+1}| - |v_k| <= a dt
        |p_k - q_ik| >= r + r_i + 0.03,   distance to walls >= r + 0.05
        q_i,k+1 = q_ik + dt w_ik,   w_ik optimal in the programme of person i at step k

    with the point c ahead on the path; distances have slacks with a price of 10^4 per metre.
    See `wideberth_arenas.controllers.orca_conditions` for the lower programme and how its
    conditions are relaxed. IPOPT solves the whole, from the last plan carried on and people who
    answer it; where that fails, once more from braking. The first step is commanded.

    People's goals are unknown: a person's goal is taken to be where they would be in 2 s at their
    present velocity, and their speed to be at most ``people_speed``. People may do
    otherwise, and a plan may rely on a courtesy that does not come: nothing is promised.

    Our own implementation after the paper, with the numbers of its authors' configuration. It
    differs. Complementarity is one smooth equation with rho = 1e-5, not products of 1e-10. A wall
    holds people back by the half-plane of its nearest point, which is looked up beside the first
    guess. That guess heads for c where there is no last plan, and does not avoid people.
    Velocities of people are differences of what is seen. The linear solver is MUMPS. Where both
    solves fail, the last plan carried on is driven if it is free of contact; otherwise the robot
    brakes, and `reason` says why.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead : as in `Reactive`; the speed is a limit,
        and c is so far ahead.
    horizon, dt : K steps of dt s.
    people_speed : highest speed of people, m/s.
    time_horizon, obstacle_horizon : s, of people's half-planes, of others and of walls.
    most_people : nearest ones in the programme, at most 10; who is farther away is left out.
    speeding_up : a, m/s^2, besides the robot's own limits; None for those alone.
    most_iterations : of the solver.

    Raises
    ------
    WideberthError : a number out of range, a robot that moves in space or has no hash.

    References
    ----------
    S. Samavi, J. R. Han, F. Shkurti and A. P. Schoellig, SICNav: Safe and Interactive Crowd
    Navigation Using Model Predictive Control and Bilevel Optimization, IEEE Transactions on
    Robotics (2024).
    """

    reference: ClassVar[str] = "samavi2024sicnav,vandenberg2011reciprocal"

    period: float = 0.25
    reference_speed: float = 0.95
    look_ahead: float = 1.0
    horizon: int = 4
    dt: float = 0.25
    people_speed: float = 0.5
    time_horizon: float = 2.0
    obstacle_horizon: float = 0.5
    most_people: int = 5
    speeding_up: float | None = None
    most_iterations: int = 100

    def __post_init__(self) -> None:
        whole("BilevelOrca.horizon", self.horizon, least=2)
        if whole("BilevelOrca.most_people", self.most_people) > MOST_PEOPLE:
            raise WideberthError(
                f"BilevelOrca.most_people is {self.most_people}; wanted at most {MOST_PEOPLE}"
            )
        whole("BilevelOrca.most_iterations", self.most_iterations)
        super().__post_init__()
        try:
            hash(self.robot)
        except TypeError as error:
            raise WideberthError(
                f"bilevel_orca keeps a programme per robot, and {type(self.robot).__name__} has "
                f"no hash ({error}); make it a frozen dataclass of numbers and tuples"
            ) from None

    def prepare(self) -> None:
        """Build the programmes for every number of people."""
        for people in range(self.most_people + 1):
            program(self.robot, self._rules(), people)

    def decide(self, observation: Observation, place: Array) -> Command:
        """Return the first step of the plan."""
        found = self._guide.ahead(place, self.look_ahead)
        assert found is not None  # seen to by `command`
        if self._velocity is None:  # the first decision after `reset`
            self._velocity, self._last = np.zeros(2), np.zeros((0, len(self.robot.inputs)))
        now = velocity_of(self.robot, observation.state)
        scene = self._scene(observation, place, self._velocity if now is None else now, found[0])
        self._last = self._planned(scene)
        state = follow(self.robot, scene.state, self._last[:1], self.dt)[1]
        twist = self.robot.twist(tuple(state), tuple(self._last[0]))
        command = limited(self.robot, observation.state, twist)
        if now is None:  # a robot without inertia moves as commanded
            self._velocity = np.array(command.linear)
            return command
        return replace(command, ramp=self.dt)

    def _rules(self) -> OrcaRules:
        """Return the fixed numbers of the programmes."""
        return OrcaRules(**{entry.name: getattr(self, entry.name) for entry in fields(OrcaRules)})

    def _planned(self, scene: CrowdScene) -> Array:
        """Return the inputs of a plan, (K, m); from the last plan, then from braking."""
        solver = program(self.robot, self._rules(), len(scene.radii))
        carried = solver.course(scene, self._begun(scene))
        planned, why = solver.solved(scene, carried)
        if why:
            stopping = brake(self.robot, scene.state, self.horizon, self.dt)[1]
            planned, why = solver.solved(scene, solver.course(scene, stopping))
        if not why:
            return planned
        if solver.touches(scene, carried):
            self._last, self._velocity = self._last[:0], np.zeros(2)  # it will stand
            raise WideberthError(f"{why}, and the last plan carried on leads to a contact: brake")
        return carried.inputs

    def _scene(
        self, observation: Observation, place: Array, own: Array, ahead: Array
    ) -> CrowdScene:
        """Return what a plan starts from, with the nearest people."""
        _, places, velocities, radii = self._neighbours.now()
        away = np.hypot(*(places - place).T) - radii
        near = np.sort(np.argsort(away, kind="stable")[: self.most_people])
        state = within_bounds(self.robot, observation.state)
        fastest = max(self.reference_speed, float(np.hypot(*own)))
        people = places[near], velocities[near], radii[near]
        return CrowdScene(state, own, ahead, fastest, *people, tuple(observation.polygons))

    def _begun(self, scene: CrowdScene) -> Array:
        """Return the inputs to begin with, (K, m): the last plan's, and then towards c."""
        share = self.period / self.dt
        left = max(len(self._last) - int(np.ceil(share - 1e-9)), 0)
        kept = shift(self._last, share)[:left]
        limits = self.robot.input_bounds()
        rows = list(np.clip(kept, limits.lower, limits.upper))
        state = follow(self.robot, scene.state, kept, self.dt)[-1]
        while len(rows) < self.horizon:
            way = scene.ahead - np.array(self.robot.pose(tuple(state)).position)
            length = float(np.hypot(*way))
            speed = min(self.reference_speed, length / self.dt)
            wanted = way * (speed / length) if length else way
            twist = steer(self.robot, state, wanted, 1.0 / self.dt).twist
            now = tuple(float(value) for value in state)
            inputs = np.array([self.robot.drive(now, twist, self.dt)])
            rows.append(np.clip(inputs, limits.lower, limits.upper)[0])
            state = np.array(step(self.robot, now, tuple(rows[-1]), self.dt))
        return np.array(rows)
