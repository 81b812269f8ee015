"""Starts of the solver that are sampled among people who react to the robot.

The starts of `multistart` are a few twists that are held, chosen without looking at anybody. Here
ways of the robot are drawn in every decision in which something is in the way, all people are
rolled out beside each by a model, and the best way becomes a further start. A predictor that looks
at the robot's plan is asked anew with that way: somebody may make room only for a robot that
comes, so that a forecast for a plan that waits says for ever that he stays.
"""

from dataclasses import dataclass, field
from typing import final

import numpy as np

from ...people.models import CircularForce, PersonModel, Reciprocal, Straight, Walkers
from ...people.walls import WallField
from ...people.ways import Neighbourhood, WayCost, drawn, walkers_of
from ...robot import Robot
from ...values.arrays import Array, positive, whole
from ...values.errors import WideberthError
from ...values.motion import Observation, Twist
from ...values.plan import Plan
from ...values.tracks import Tracks
from ..fallback.instance_check import TOLERANCE, Outcome
from ..fallback.rollout import drive_along, steer_each
from ..fallback.rungs import SWITCHING_MARGIN
from ..solvers.base import pressed
from .standing_off import generator_of

COST = WayCost(contact=100.0, closeness=1.0, margin=0.3)
"""Of a way, around the reference: that of `crowd_mppi`."""
SPREAD = 0.4
"""Deviation of the noise on the plan's twists, over the robot's speed and yaw rate."""
MOST_SAMPLES, MOST_PEOPLE = 10_000, 200
"""Of a decision: more means that a number is wrong."""
MOST_WALLS = 32
"""Polygons that count, those nearest to the robot and the people."""


@final
@dataclass(frozen=True)
class Sampling:
    """How many ways of the robot are sampled in a decision, among how many people, who react how.

    Half of the ways are the plan's own twists with noise on them, the others one random twist and
    then another, see `wideberth.framework.people.ways.drawn`. The best one has the least
    `wideberth.framework.people.ways.WayCost` around the reference.

    Parameters
    ----------
    samples : ways.
    people : who are rolled out, the nearest ones; the others go straight on.
    model : the rule of the people.
    memory : s, over which the velocity of a person is averaged; the mean is what he wants.
    seed : of the draws, with the robot's state and clock.

    Raises
    ------
    WideberthError : a number out of range, or a model that is no `PersonModel`.
    """

    samples: int = 60
    people: int = 10
    model: Straight | CircularForce | Reciprocal | PersonModel = field(
        default_factory=CircularForce
    )
    memory: float = 2.0
    seed: int = 0

    def __post_init__(self) -> None:
        whole("sampling.samples", self.samples, least=4)
        whole("sampling.people", self.people, least=0)
        whole("sampling.seed", self.seed, least=0)
        positive("sampling.memory", self.memory)
        for name, most in (("samples", MOST_SAMPLES), ("people", MOST_PEOPLE)):
            if getattr(self, name) > most:
                raise WideberthError(
                    f"sampling.{name} is {getattr(self, name)}; wanted at most {most}"
                )
        if not isinstance(self.model, PersonModel):
            raise WideberthError(
                f"sampling.model is {self.model!r}; wanted a PersonModel, such as CircularForce()"
            )

    def best(
        self,
        robot: Robot,
        plan: Plan,
        tracks: Tracks | None,
        observation: Observation,
        fastest: float,
    ) -> "SampledWay | None":
        """Return the best way, or None where none is clearly better than the plan.

        The plan is the first sample. Another one has to save `SWITCHING_MARGIN` of its cost. The
        draws depend on the robot's state, the observation's stamp and the seed alone.

        Parameters
        ----------
        robot : in the plane.
        plan : from where, and the reference that ways are held against.
        tracks : of the people; None where there are none.
        observation : whose polygons count.
        fastest : m/s, of ways, unless the plan is faster.

        Raises
        ------
        WideberthError : every way costs infinitely much, or is no number.
        """
        about = _twists(robot, plan)
        speed = max(fastest, float(np.hypot(about[:, 0], about[:, 1]).max()))
        rng = generator_of(observation, self.seed)
        start = plan.states[0]
        twists = drawn(robot, start, rng, about, speed, SPREAD, self.samples)
        states = drive_along(robot, start, twists, plan.dt)
        ways = robot.pose(tuple(np.moveaxis(states, -1, 0))).points()
        around = self._around(tracks, plan, observation)
        cost = COST.of(around, ways, robot.radius, plan.reference, plan.dt)
        cost = np.where(np.isfinite(cost), cost, np.inf)
        best = int(cost.argmin())
        if not np.isfinite(cost[best]):
            raise WideberthError(
                f"none of {self.samples} ways has a finite cost; look at {self.model!r}"
            )
        if not cost[best] < (1.0 - SWITCHING_MARGIN) * cost[0]:
            return None
        held = [(Twist(tuple(row[:-1]), row[-1]), 1) for row in twists[best].tolist()]
        driven, inputs = steer_each(robot, start, [held], plan.dt)[0]
        return SampledWay(driven, inputs, ways[best])

    def _around(
        self, tracks: Tracks | None, plan: Plan, observation: Observation
    ) -> Neighbourhood:
        """Return people as they will be when the plan begins, and the nearest walls."""
        if tracks is None:
            nowhere = np.zeros((0, 2))
            people = Walkers(nowhere, nowhere, nowhere, np.zeros(0))
        else:
            people = walkers_of(tracks, plan.stamp, self.memory)
        near = np.concatenate([people.place, plan.positions, plan.reference])
        walls = WallField(observation.polygons).nearest(near, MOST_WALLS)
        return Neighbourhood(self.model, people, walls, self.people)


@final
@dataclass(frozen=True, eq=False)
class SampledWay:
    """A way that the robot can drive.

    Attributes
    ----------
    states : (N + 1, n). inputs : (N, m).
    positions : (N + 1, 2), m.
    """

    states: Array
    inputs: Array
    positions: Array


def _twists(robot: Robot, plan: Plan) -> Array:
    """Return the twists at a plan's steps, (N, 3), m/s and rad/s."""
    twist = robot.twist(tuple(plan.states[1:].T), tuple(plan.inputs.T))
    parts = np.broadcast_arrays(*twist.linear, twist.angular, np.zeros(len(plan.inputs)))
    return np.stack(parts[:-1], axis=-1).astype(np.float64)


def worth_sampling(outcome: Outcome) -> bool:
    """Whether another start may lead to a better plan than the first: see `MultiStart`.

    Something is in the way, and regions press on the plan; and the solver has returned from every
    start.
    """
    if not outcome.solutions or outcome.note or not outcome.obstacle_in_way:
        return False
    first = outcome.candidates[0]
    return first.solution is None or not first.optimal or pressed(first.solution)


def better(other: Plan, own: Plan) -> bool:
    """Whether a plan that keeps every constraint is to be driven instead of another one.

    So it is where the other one breaks a constraint or was not priced, as the shifted plan, or
    where it saves `SWITCHING_MARGIN` of 1 + |cost|.

    Parameters
    ----------
    other : from a sampled way. own : that is driven else.
    """
    if not other.violation <= TOLERANCE or not np.isfinite(other.cost):
        return False
    if not own.violation <= TOLERANCE or not np.isfinite(own.cost):
        return True
    return own.cost - other.cost > SWITCHING_MARGIN * (1.0 + abs(own.cost))


def summary(plan: Plan) -> str:
    """Say by which rung a plan came, and at which cost, where it has one."""
    return f"{plan.rung}" + (f" at cost {plan.cost:.4g}" if np.isfinite(plan.cost) else "")
