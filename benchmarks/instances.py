"""Makes instances like the recorded ones, of any size, for any robot and region.

The robot drives along a straight reference among obstacles that cross it with growing
covariance. A gently winding trajectory is driven first and every obstacle placed so that its
region at the level aimed at, enlarged a little, never holds it: each instance has a known
feasible point, which is also what solvers start from. Obstacles are as dense for every number.
"""

from dataclasses import dataclass, replace

import numpy as np

from wideberth.framework import Path
from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.slots.base import with_auxiliaries
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, ObstacleSet, fill
from wideberth.framework.region import Region
from wideberth.framework.robot import Robot, start_state, step
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose, Twist

DT, PACE, WITNESS_PACE = 0.5, 0.5, 0.3
"""s; m/s of the reference; m/s of the known feasible trajectory."""
SPREAD, NEAREST = 0.9, 1.2
"""m. K obstacles cross the reference within SPREAD sqrt(K), at least NEAREST, of it."""
ROOM = 0.05
"""m, by which regions are enlarged when it is checked that the trajectory keeps out of them."""


@dataclass(frozen=True, eq=False)
class Made:
    """An instance with a feasible guess."""

    problem: Problem
    parameters: Parameters
    guess: Guess


@dataclass(frozen=True)
class Recipe:
    """Kind of instances to make.

    Attributes
    ----------
    robot, region, level : the plug-ins.
    obstacles : K.
    steps : N.
    """

    robot: Robot
    region: Region
    level: LevelPolicy
    obstacles: int
    steps: int

    def make(self, seeds: range) -> list[Made]:
        """Make one instance per seed; they share their problem."""
        problem = assemble(
            self.robot,
            (GaussianDiscs(self.region),),
            self.level,
            horizon=self.steps,
            dt=DT,
            rooms=((self.obstacles,),),
        )
        return [self._one(problem, np.random.default_rng(seed)) for seed in seeds]

    def _one(self, problem: Problem, rng: np.random.Generator) -> Made:
        robot, region = self.robot, self.region
        along = np.eye(robot.dimension)[0]
        start, twist = start_state(robot, 0.0 * along, along, WITNESS_PACE)
        states, inputs = winding(robot, start, twist, self.steps, rng)
        path = Path(np.stack([0.0 * along, 2.0 * PACE * DT * self.steps * along]))
        reference = lay_reference(path, 0.0, PACE, self.steps, DT)
        crowd = self._crowd(states, reference.position, rng)
        discs = fill(reference, crowd, region, self.level, robot.radius, self.obstacles)
        along = reference.position, reference.direction, reference.speed
        parameters = Parameters(states[0], *along, (discs,), reference.curve)
        target = parameters.target if isinstance(self.level, SharedLevel) else float("nan")
        guess = Guess.bare(states, inputs, target)
        guess = with_auxiliaries(robot, [GaussianDiscs(region)], parameters, guess)
        return Made(problem, guess.pull(parameters), guess)

    def _crowd(self, states: Array, reference: Array, rng: np.random.Generator) -> ObstacleSet:
        """Draw obstacles until K of them leave the trajectory free."""
        pose = self.robot.pose(tuple(states[1:].T))
        kept = [ObstacleSet.none(len(reference), self.robot.dimension)]
        while sum(len(one) for one in kept) < self.obstacles:
            drawn = drift(4 * self.obstacles, self.obstacles, reference, rng)
            free = self._free(drawn, pose)
            kept.append(_choose(drawn, np.flatnonzero(free)))
        joined = ObstacleSet(
            np.concatenate([one.mean for one in kept], axis=1),
            np.concatenate([one.covariance for one in kept], axis=1),
            np.concatenate([one.radius for one in kept]),
            sum((one.ids for one in kept), ()),
        )
        return _choose(joined, np.arange(self.obstacles))

    def _free(self, drawn: ObstacleSet, pose: Pose) -> Array:
        """Whether each obstacle's region never holds the trajectory."""
        steps, count = drawn.mean.shape[:2]
        margin = np.broadcast_to(drawn.radius + self.robot.radius + ROOM, (steps, count))
        numbers = self.region.parameters(GaussianObstacle(drawn.mean, drawn.covariance), margin)
        level = self.level.levels(self.region, steps, count, self.robot.dimension)
        inside = self.region.contains(pose.points()[:, None], numbers, level)
        return np.asarray(~inside.any(axis=0))


def winding(
    robot: Robot, start: tuple[float, ...], twist: Twist, steps: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Drive on with a turn, or a sideways speed, that swings: states (N + 1, n), inputs (N, m)."""
    phase, swing = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.1, 0.2)
    headed = robot.pose(start).heading is not None
    states, inputs = [start], []
    for i in range(steps):
        side = float(swing * np.sin(0.6 * DT * i + phase))
        wanted = replace(twist, angular=side)
        if not headed:
            wanted = Twist((twist.linear[0], 2.0 * side, *twist.linear[2:]))
        control = robot.drive(states[-1], wanted, DT)
        inputs.append(control)
        states.append(step(robot, states[-1], control, DT))
    return np.array(states, dtype=np.float64), np.array(inputs, dtype=np.float64)


def drift(count: int, among: int, reference: Array, rng: np.random.Generator) -> ObstacleSet:
    """Draw obstacles that pass near some point of the reference, each at its own time.

    Deviations are those of the recorded instances: 2 to 6 cm after one step, the smaller one
    0.4 to 1 times the larger, both growing with the root of time.
    """
    steps, size = reference.shape
    when = rng.integers(0, steps, count)
    way = rng.standard_normal((count, size))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    reach = max(SPREAD * np.sqrt(among), NEAREST)
    place = reference[when] + reach * np.sqrt(rng.uniform(0, 1, (count, 1))) * way
    velocity = rng.normal(scale=0.25, size=(count, size))
    time = DT * (np.arange(steps)[:, None] - when)
    mean = place + time[..., None] * velocity
    deviation = rng.uniform(0.02, 0.06, (count, 1)) * rng.uniform(0.4, 1.0, (count, size))
    frame = np.linalg.qr(rng.standard_normal((count, size, size)))[0]
    single = np.einsum("kij,kj,klj->kil", frame, deviation**2, frame)
    growth = np.arange(1, steps + 1, dtype=np.float64)[:, None, None, None]
    names = tuple(f"{i}" for i in range(count))
    return ObstacleSet(mean, growth * single, rng.uniform(0.3, 0.35, count), names)


def _choose(drawn: ObstacleSet, which: Array) -> ObstacleSet:
    """Take some of the obstacles."""
    names = tuple(drawn.ids[i] for i in which)
    return ObstacleSet(
        drawn.mean[:, which], drawn.covariance[:, which], drawn.radius[which], names
    )
