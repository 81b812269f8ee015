"""The robot's plan and the people's answers as one nonlinear programme, after SICNav."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from wideberth.framework.mpc.planner.rollout import follow
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.robot import Robot, step
from wideberth.framework.values.arrays import Array, Scalar
from wideberth.framework.values.polygon import Polygon
from wideberth.people.walls import WallField

from .orca_conditions import (
    TINY,
    TOUCHING,
    conditions,
    half_plane,
    on_the_central_path,
    wanted_velocity,
)

PADDING = 0.02
"""m, added to every radius in half-planes: 0.01 and a safety space of 0.01."""
ROOM = 0.03
"""m, that the robot keeps to people besides the radii."""
WALL_ROOM = 0.05
"""m, that the robot keeps to walls besides its radius."""
FAR_GOAL = 2.0
"""s; a person's goal is where they would be then at their present velocity."""
TERMINAL, TURNING = 100.0, 0.1
"""Weights of the last place and of the squared yaw rate, beside 1 of the other places."""
PRICE = 1e4
"""Of a metre too near to a person or to a wall, m."""
SCALE = 1e-2
"""Of the whole cost, for the solver."""
PERSON_WALLS, EDGES = 3, 10
"""Nearest walls that a person has half-planes of, and nearest edges that the robot keeps off."""
RELAXATION = 1e-5
"""rho of the conditions, m^2/s^2."""
KEPT = 1e-3
"""Largest violation of a constraint, in its own unit, with which a plan is driven."""
NOWHERE = 1e3
"""m, where an edge is that does not exist."""


@dataclass(frozen=True)
class OrcaRules:
    """Fixed numbers of a programme; see `wideberth_arenas.controllers.bilevel_orca`."""

    horizon: int
    dt: float
    people_speed: float
    time_horizon: float
    obstacle_horizon: float
    speeding_up: float | None
    most_iterations: int


@dataclass(frozen=True, eq=False)
class CrowdScene:
    """What a plan starts from.

    Attributes
    ----------
    state : (n,) of the robot.
    own : (2,), m/s, its velocity.
    ahead : (2,), m, where it heads for.
    fastest : m/s, its limit.
    places, velocities, radii : (N, 2), m; (N, 2), m/s; (N,), m; of the people.
    polygons : walls.
    """

    state: Array
    own: Array
    ahead: Array
    fastest: float
    places: Array
    velocities: Array
    radii: Array
    polygons: tuple[Polygon, ...]


@dataclass(frozen=True, eq=False)
class PersonCourse:
    """A way of the robot, and how people answer it.

    Attributes
    ----------
    inputs, states : (K, m) and (K + 1, n).
    people : (K + 1, N, 2), m.
    answers : (K, N, L + 5): velocity, slack, and multipliers of L half-planes, of the highest
        speed, and of the slack.
    walls : (K, N, W, 3): the unit vector away from a wall, and the gap that goes with it where a
        person is in the origin, m.
    """

    inputs: Array
    states: Array
    people: Array
    answers: Array
    walls: Array


class BilevelProgram:
    """The programme for N people, built once, and its solution.

    Its variables are the inputs, the states that follow, the answers, and slacks: one of each
    person's distance, and one of all walls'.

    Parameters
    ----------
    robot, rules : whose it is.
    people : N.
    """

    def __init__(self, robot: Robot, rules: OrcaRules, people: int) -> None:
        self._robot, self._rules, self._people = robot, rules, people
        self._walls = PERSON_WALLS if people else 0
        self._width = people + self._walls + 5
        self._asked = self._half_planes()
        self._rows: list[Any] = []
        self._low: list[float] = []
        self._high: list[float] = []
        self._solver = self._made()

    def course(self, scene: CrowdScene, inputs: Array) -> PersonCourse:
        """Return how people answer a way of the robot, each by the relaxed programme."""
        rules, count = self._rules, self._people
        states = follow(self._robot, scene.state, inputs, rules.dt)
        answers = np.zeros((rules.horizon, count, self._width))
        walls = np.zeros((rules.horizon, count, self._walls, 3))
        people = np.tile(scene.places, (rules.horizon + 1, 1, 1))
        field, goals = WallField(scene.polygons), scene.places + FAR_GOAL * scene.velocities
        pace, moving = scene.velocities, scene.own
        for k in range(rules.horizon if count else 0):
            here = np.array(self._robot.pose(tuple(states[k])).position)
            around = people[k].T, pace.T, goals.T, scene.radii, here, moving
            normals, bounds, wanted = (one.full() for one in self._asked(*around))
            walls[k] = _beside(field, people[k], scene.radii + PADDING, self._walls)
            away, gaps = walls[k, ..., :2], _gaps(walls[k], people[k])
            held = -np.maximum(gaps, TOUCHING) / rules.obstacle_horizon
            pace, slack, multipliers = on_the_central_path(
                np.concatenate([normals.T.reshape(count, count, 2), away], axis=1),
                np.concatenate([bounds.reshape(count, count), held], axis=1),
                self._walls,
                wanted.T,
                rules.people_speed,
                RELAXATION,
            )
            answers[k] = np.concatenate([pace, slack[:, None], multipliers], axis=1)
            people[k + 1] = people[k] + rules.dt * pace
            moving = np.array(world_velocity(self._robot, states[k + 1], inputs[k]))
        return PersonCourse(inputs, states, people, answers, walls)

    def solved(self, scene: CrowdScene, guess: PersonCourse) -> tuple[Array, str]:
        """Return inputs (K, m), and why they cannot be driven; empty if they can.

        The words are IPOPT's status and the largest violation.
        """
        edges = _edges(scene.polygons, np.array(self._robot.pose(tuple(scene.state)).position))
        people = scene.places, scene.velocities, scene.radii
        given = scene.state, scene.own, scene.ahead, [scene.fastest], *people, guess.walls, edges
        start = guess.inputs, guess.states[1:], guess.answers, self._short(scene, guess)
        low, high = self._limits()
        result = self._solver(
            x0=np.concatenate([np.ravel(one) for one in start]),
            p=np.concatenate([np.ravel(one) for one in given]),
            lbx=low,
            ubx=high,
            lbg=self._low,
            ubg=self._high,
        )
        found, rows = result["x"].full()[:, 0], result["g"].full()[:, 0]
        off = float(np.maximum(self._low - rows, rows - self._high).max(initial=0.0))
        inputs = found[: guess.inputs.size].reshape(guess.inputs.shape)
        if off <= KEPT:
            return inputs, ""
        return inputs, f"IPOPT says {self._solver.stats()['return_status']}, {off:.2g} off"

    def touches(self, scene: CrowdScene, course: PersonCourse) -> bool:
        """Whether a course comes nearer to a person or a wall than the radii."""
        allowed = np.array([*np.full(self._people, ROOM), WALL_ROOM])
        return bool((self._short(scene, course) > allowed).any())

    def _short(self, scene: CrowdScene, course: PersonCourse) -> Array:
        """Return by how much the robot comes too near to each person and to walls, (N + 1,), m."""
        ways = np.array([self._robot.pose(tuple(one)).position for one in course.states])
        edges, radius = _edges(scene.polygons, ways[0]), self._robot.radius
        apart = np.hypot(*np.moveaxis(course.people[1:] - ways[1:, None], -1, 0)).min(axis=0)
        beside = _to_edges(ways[1:], edges).min()
        room = scene.radii + radius + ROOM
        return np.maximum([*(room - apart), radius + WALL_ROOM - beside], 0.0)

    def _limits(self) -> tuple[Array, Array]:
        """Return the bounds of all variables."""
        steps, inputs, states = (
            self._rules.horizon, self._robot.input_bounds(), self._robot.state_bounds(),
        )  # fmt: skip
        free = np.full(steps * self._people * self._width, np.inf)
        slacks = np.zeros(self._people + 1), np.full(self._people + 1, np.inf)
        lower = [*inputs.lower] * steps, [*states.lower] * steps, -free, slacks[0]
        upper = [*inputs.upper] * steps, [*states.upper] * steps, free, slacks[1]
        return np.concatenate(lower), np.concatenate(upper)

    def _half_planes(self) -> Any:
        """Return normals, bounds and wanted velocities of all people as a function.

        Of each person the other people in order, then the robot.
        """
        rules, count = self._rules, self._people
        place, pace, goal = (_symbol(name, 2, count) for name in ("q", "w", "goal"))
        radius, here, moving = _symbol("r", count), _symbol("p", 2), _symbol("v", 2)
        normals, bounds, wanted = [], [], []
        for i in range(count):
            others = [(place[:, j], pace[:, j], radius[j]) for j in range(count) if j != i]
            for there, speed, size in [*others, (here, moving, self._robot.radius)]:
                normal, bound = half_plane(
                    there - place[:, i],
                    pace[:, i] - speed,
                    pace[:, i],
                    radius[i] + size + 2.0 * PADDING,
                    rules.time_horizon,
                    rules.dt,
                )
                normals.append(normal)
                bounds.append(bound)
            wanted.append(wanted_velocity(place[:, i], goal[:, i], rules.people_speed))
        given = [place, pace, goal, radius, here, moving]
        return ca.Function("asked", given, [ca.horzcat(*x) for x in (normals, bounds, wanted)])

    def _made(self) -> Any:
        """Write the programme down and hand it to the solver."""
        robot, rules, count = self._robot, self._rules, self._people
        steps, size = rules.horizon, len(robot.states)
        inputs, states = _symbol("u", len(robot.inputs), steps), _symbol("x", size, steps)
        answers = [_symbol(f"a{k}", self._width, count) for k in range(steps)]
        walls = [_symbol(f"b{k}", 3, count * self._walls) for k in range(steps)]
        slack, fastest, radius = _symbol("s", count + 1), _symbol("f", 1), _symbol("r", count)
        start, own, ahead = _symbol("x0", size), _symbol("v", 2), _symbol("c", 2)
        place, pace, edges = _symbol("q", 2, count), _symbol("w", 2, count), _symbol("e", 4, EDGES)
        given = [start, own, ahead, fastest, place, pace, radius, *walls, edges]
        free = [inputs, states, *answers, slack]
        goal, people, before, moving = place + FAR_GOAL * pace, place, start, own
        cost = ca.SX(0.0)
        for k in range(steps):
            control, state = inputs[:, k], states[:, k]
            here = ca.vertcat(*robot.pose(ca.vertsplit(before)).position)
            around = people, pace, goal, radius, here, moving
            self._answers(around, answers[k], walls[k])
            speed = ca.vertcat(*world_velocity(robot, ca.vertsplit(state), ca.vertsplit(control)))
            self._motion(before, control, state, moving, speed, fastest)
            pace = answers[k][:2, :]
            people, before, moving = people + rules.dt * pace, state, speed
            here = ca.vertcat(*robot.pose(ca.vertsplit(state)).position)
            self._distances(here, people, radius, edges, slack)
            turning = robot.twist(ca.vertsplit(state), ca.vertsplit(control)).angular
            weight = TERMINAL if k == steps - 1 else 1.0
            cost += 0.5 * (weight * ca.sumsqr(here - ahead) + TURNING * turning * turning)
        program = {
            "x": ca.vertcat(*map(ca.vec, free)),
            "p": ca.vertcat(*map(ca.vec, given)),
            "f": SCALE * (cost + PRICE * ca.sum1(slack)),
            "g": ca.vertcat(*self._rows),
        }
        return ca.nlpsol("bilevel", "ipopt", program, _options(rules.most_iterations))

    def _constrain(self, row: Any, low: float, high: float) -> None:
        self._rows.append(row)
        self._low += [low] * row.numel()
        self._high += [high] * row.numel()

    def _answers(self, around: tuple[Any, ...], answers: Any, walls: Any) -> None:
        """Add the conditions of all people in a step."""
        rules, count = self._rules, self._people
        normals, bounds, wanted = self._asked(*around)
        for i in range(count):
            lines = [(normals[:, j], bounds[j]) for j in range(i * count, (i + 1) * count)]
            for j in range(i * self._walls, (i + 1) * self._walls):
                gap = ca.dot(walls[:2, j], around[0][:, i]) + walls[2, j]
                held = -ca.fmax(gap, TOUCHING) / rules.obstacle_horizon
                lines.append((walls[:2, j], held))
            answer = answers[:, i]
            rows = conditions(
                answer[:2],
                answer[2],
                ca.vertsplit(answer[3:]),
                lines,
                self._walls,
                wanted[:, i],
                rules.people_speed,
                RELAXATION,
            )
            self._constrain(ca.vertcat(*rows), 0.0, 0.0)

    def _motion(
        self, before: Any, control: Any, state: Any, moving: Any, speed: Any, fastest: Any
    ) -> None:
        """Add the robot's dynamics and limits in a step."""
        robot, rules = self._robot, self._rules
        reached = step(robot, ca.vertsplit(before), ca.vertsplit(control), rules.dt)
        self._constrain(state - ca.vertcat(*reached), 0.0, 0.0)
        kept = robot.constraints(ca.vertsplit(state), ca.vertsplit(control))
        if kept:
            self._constrain(ca.vertcat(*kept), 0.0, np.inf)
        self._constrain(fastest * fastest - ca.sumsqr(speed), 0.0, np.inf)
        if rules.speeding_up is not None:
            grown = ca.sqrt(ca.sumsqr(speed) + TINY) - ca.sqrt(ca.sumsqr(moving) + TINY)
            self._constrain(grown, -np.inf, rules.speeding_up * rules.dt)

    def _distances(self, here: Any, people: Any, radius: Any, edges: Any, slack: Any) -> None:
        """Add the distances that the robot keeps in a step."""
        for i in range(self._people):
            apart = ca.sqrt(ca.sumsqr(here - people[:, i]) + TINY)
            room = radius[i] + self._robot.radius + ROOM
            self._constrain(apart + slack[i] - room, 0.0, np.inf)
        for j in range(EDGES):
            beside = _to_edge(here, edges[:, j])
            room = self._robot.radius + WALL_ROOM
            self._constrain(beside + slack[self._people] - room, 0.0, np.inf)


@lru_cache(maxsize=64)
def program(robot: Robot, rules: OrcaRules, people: int) -> BilevelProgram:
    """Return the programme of a robot, a frozen dataclass, among so many people."""
    return BilevelProgram(robot, rules, people)


def world_velocity(robot: Robot, state: Any, control: Any) -> tuple[Scalar, Scalar]:
    """Return the velocity in the world frame, m/s; numbers or expressions."""
    twist, heading = robot.twist(state, control), robot.pose(state).heading
    along, across = twist.linear
    if heading is None:
        return along, across
    cosine, sine = np.cos(heading), np.sin(heading)
    return cosine * along - sine * across, sine * along + cosine * across


def _symbol(name: str, rows: int, columns: int = 1) -> Any:
    return ca.SX.sym(name, rows, columns)


def _beside(field: WallField, places: Array, radii: Array, count: int) -> Array:
    """Return the nearest walls of each person, (N, count, 3), see `PersonCourse`."""
    found = np.tile([0.0, 0.0, 1.0], (len(places), count, 1))
    every = field.beside(places)
    near = np.argsort(every[..., 0], axis=1, kind="stable")[:, :count]
    kept = np.take_along_axis(every, near[..., None], axis=1)
    away = kept[..., 1:]
    found[:, : kept.shape[1], :2] = away
    found[:, : kept.shape[1], 2] = (
        kept[..., 0] - radii[:, None] - (away * places[:, None]).sum(axis=-1)
    )
    return found


def _gaps(walls: Array, places: Array) -> Array:
    """Return the gaps of people at these places to their walls, (N, W), m."""
    return np.asarray((walls[..., :2] * places[:, None]).sum(axis=-1) + walls[..., 2])


def _edges(polygons: tuple[Polygon, ...], place: Array) -> Array:
    """Return the ends of the edges nearest to a place, (`EDGES`, 4), m."""
    corners = [np.array(polygon.vertices, dtype=np.float64) for polygon in polygons]
    every = [np.concatenate([one, np.roll(one, -1, axis=0)], axis=1) for one in corners]
    found = np.concatenate([np.zeros((0, 4)), *every])
    near = found[np.argsort(_to_edges(place[None], found)[0], kind="stable")[:EDGES]]
    absent = [[NOWHERE, NOWHERE, NOWHERE + 1.0, NOWHERE]] * (EDGES - len(near))
    return np.concatenate([near, np.reshape(absent, (-1, 4))])


def _to_edges(places: Array, edges: Array) -> Array:
    """Return the distances of points (K, 2) from edges (E, 4), (K, E), m."""
    begin, along = edges[:, :2], edges[:, 2:] - edges[:, :2]
    off = places[:, None] - begin
    share = (off * along).sum(axis=-1) / np.maximum((along * along).sum(axis=-1), TINY)
    off = off - np.clip(share, 0.0, 1.0)[..., None] * along
    return np.asarray(np.hypot(off[..., 0], off[..., 1]))


def _to_edge(place: Any, edge: Any) -> Any:
    """Return the distance of a point from an edge, m, as an expression."""
    dx, dy = edge[2] - edge[0], edge[3] - edge[1]
    px, py = place[0] - edge[0], place[1] - edge[1]
    share = ca.fmax(0.0, ca.fmin(1.0, (px * dx + py * dy) / (dx * dx + dy * dy + TINY)))
    return ca.sqrt((px - share * dx) ** 2 + (py - share * dy) ** 2 + TINY)


def _options(most: int) -> dict[str, Any]:
    """Return the solver's options: quiet, a bounded number of iterations, no clock."""
    quiet = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
    ipopt = {"print_level": 0, "sb": "yes", "max_iter": most, "mu_init": 1e-2}
    ipopt |= {"acceptable_constr_viol_tol": KEPT, "acceptable_compl_inf_tol": 1e-3,
              "acceptable_tol": 1e-4, "acceptable_iter": 5, "tol": 1e-5}  # fmt: skip
    return {**quiet, "calc_lam_p": False, **{f"ipopt.{name}": x for name, x in ipopt.items()}}
