"""Plans judged by time and by the first contact that they are to expect among many futures.

An optimisation around one likely future does not see that a person may turn. So manoeuvres are
driven, see `manoeuvres`, and judged over all modes of the forecast; the best one is where the
solver starts, and the solver's plan is judged like it: what is driven is the best of both.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ...framework.control.command_limits import deceleration
from ...framework.mpc.ocp.bodies import discs
from ...framework.mpc.ocp.transcription import Guess
from ...framework.mpc.planner.instance import Instance
from ...framework.mpc.planner.judge import Judge, Judging
from ...framework.mpc.planner.multistart import MultiStartResult
from ...framework.mpc.planner.starts import Starts, suited_each
from ...framework.mpc.planner.verify import Candidate, verify
from ...framework.mpc.problem_robot import with_carried
from ...framework.robot import Robot
from ...framework.values.arrays import Array, altered, positive
from ...framework.values.forecast import Forecast
from ...framework.values.path import Path
from ...framework.values.plan import Rung
from ...framework.values.polygon import Polygon
from ...framework.values.tracks import Tracks
from .first_contacts import compiled
from .manoeuvres import SLOWING, driven

CERTAIN, FADING = 1.0, 1.2
"""s, until which a contact counts in full, and how fast it fades afterwards."""
BRAKING = 1.0
"""s from the goal, within which a robot may be slow."""
REACH = 2.0
"""m beyond twice the way of a plan, within which the path is looked at."""
AHEAD = 0.5
"""m further along the path, where a robot should look."""
TURNING = 2.0
"""rad/s at which the angle to the path counts as time."""


@final
@dataclass(frozen=True)
class ExpectedContact(Judging):
    """How plans are judged among people who may turn.

    A trajectory of N steps, T s and L m costs, in s, with the reference speed v::

        J = max(L - v T, 0) / v + l / v + |e| / (2 rad/s) + (v - w)^2 / (2 a v)
            + price (1 - prod_o (1 - P_o)) + closeness sum_o G_o

        P_o = sum_m w_om g(t_om)
        g(t) = 1 up to 1 s, and exp(-(t - 1 s) / 1.2 s) after it

    The first term takes back what is gained by driving faster than v, which may avoid someone.
    l is the way left along the path at its end, with the distance from the path; e the angle from
    there to the path; w the speed there, below v, and a the robot's acceleration; w_om the weight
    of mode m of person o, a future in itself, and t_om when the bodies first touch in it. G_o is
    likewise the mean of the largest share by which a gap falls short of ``room``, times g. People
    are independent of each other. A contact counts less the later it is, since plans until then
    can still avoid it. What comes into a wall at a step costs the whole price, however late: there
    is no way on through it.

    Parameters
    ----------
    price : s that a contact is worth.
    closeness : s that it is worth to pass a person without a gap.
    room : m, gap below which it begins to cost.

    Raises
    ------
    WideberthError : a number that is not above 0; ``closeness`` may be 0.
    """

    price: float = 15.0
    closeness: float = 1.0
    room: float = 0.2

    usual: ClassVar[frozenset[Rung]] = frozenset({Rung.OPTIMAL, Rung.FEASIBLE})

    def __post_init__(self) -> None:
        for name in ("price", "closeness", "room"):
            value = getattr(self, name)
            positive(f"expected_contact.{name}", value, zero=name == "closeness")

    def held_clear(self, forecast: Forecast) -> Forecast:
        """Return the likeliest mode of each person's forecast."""
        return forecast.likeliest()

    def judge(
        self,
        robot: Robot,
        dt: float,
        way: tuple[Path, float, float],
        seen: tuple[Forecast, Tracks] | None,
        walls: Sequence[Polygon],
        margins: tuple[float, float],
    ) -> "ContactJudge":
        """Return the judge of one cycle."""
        parts = discs(robot)
        radii = np.array([part.radius for part in parts])
        if seen is None:
            futures, weights = np.zeros((0, 1, 2, robot.dimension)), np.zeros((0, 1))
            people = np.zeros(0)
        else:
            futures, weights, people = _from_now(seen[0]), seen[0].weight, seen[1].radius
        rooms = radii[:, None] + people[None] + margins[0]
        return ContactJudge(self, robot, dt, *way, futures, np.asarray(weights), rooms,
                            radii + margins[1], _corners(walls), deceleration(robot))  # fmt: skip


@final
@dataclass(frozen=True, eq=False)
class ContactJudge(Judge):
    """What trajectories of one planning cycle are judged against.

    Attributes
    ----------
    settings, robot, dt : the prices, whose discs move, and s per step.
    path, arc, speed : that is followed, how far along it the robot is, m, and at which speed, m/s.
    futures, weights : (O, M, N + 1, D), m, and (O, M), from the plan's first state on.
    rooms : (B, O), m, between the centres of each disc and person at which they touch.
    radii : (B,), m, with what walls are to be away.
    walls : (W, V, 2), m. acceleration : m/s^2, of the robot.
    """

    settings: ExpectedContact
    robot: Robot
    dt: float
    path: Path
    arc: float
    speed: float
    futures: Array
    weights: Array
    rooms: Array
    radii: Array
    walls: Array
    acceleration: float

    reason: ClassVar[str] = "a manoeuvre costs less than the solver's plan"

    def starts(self, names: Starts) -> Starts:
        """Return none: the manoeuvres take their place."""
        return ()

    def first(self, instance: Instance, guess: Guess) -> Guess:
        """Return the best of all manoeuvres and of the last plan."""
        robot, problem, size = self.robot, instance.problem, len(self.robot.states)
        start = instance.parameters.initial[:size]
        ahead = self.arc + self.speed * (problem.horizon * problem.dt + 2.0 * SLOWING)
        target = self.path.at(np.array(ahead))
        states, inputs = driven(robot, start, target, self.speed, problem.horizon, problem.dt)
        states = np.concatenate([guess.states[None, :, :size], states])
        best = int(self.costs(states).argmin())
        if best == 0:
            return guess
        bare = Guess.bare(states[best], inputs[best - 1], instance.target)
        bare = with_carried(instance.robot, bare, instance.parameters, problem.dt)
        return suited_each(instance, [bare])[0]

    def judged(self, instance: Instance, outcome: MultiStartResult) -> MultiStartResult:
        """Price the solutions and the manoeuvre solved from; the cheapest alone goes on."""
        start = outcome.guesses[0]
        every = [*outcome.candidates, Candidate(start, verify(instance, start), way="manoeuvre")]
        priced = [
            altered(one, cost=float(cost))
            for one, cost in zip(every, self.harm(every), strict=True)
        ]
        best = min(priced, key=lambda one: np.inf if np.isnan(one.cost) else one.cost)
        return altered(outcome, candidates=(best,))

    def harm(self, candidates: Sequence[Candidate]) -> Array:
        """Return what each costs."""
        states = np.array([one.point.states for one in candidates])
        return self.costs(states[..., : len(self.robot.states)])

    def costs(self, states: Array) -> Array:
        """Cost of trajectories (C, N + 1, n), (C,), s."""
        pose = self.robot.pose(tuple(np.moveaxis(states, -1, 0)))
        places = np.stack([one + np.zeros(states.shape[:2]) for one in pose.position], axis=-1)
        risk, near = self._contacts(states)
        headings = None if pose.heading is None else pose.heading[:, -1]
        time = self._way_left(places[:, -1], headings, self.dt * (states.shape[1] - 1))
        steps = np.linalg.norm(np.diff(places, axis=1), axis=2)
        pace = steps[:, -1] / self.dt
        gained = np.maximum(steps.sum(axis=1) / self.speed - self.dt * steps.shape[1], 0.0)
        slow = np.maximum(self.speed - pace, 0.0) ** 2 / (2.0 * self.acceleration * self.speed)
        far = np.linalg.norm(places[:, -1] - self.path.goal, axis=1) > BRAKING * self.speed
        price = self.settings.price * risk + self.settings.closeness * near
        return np.asarray(time + gained + np.where(far, slow, 0.0) + price)

    def _contacts(self, states: Array) -> tuple[Array, Array]:
        """Return the weight of contacts, and how near people are passed, (C,) each."""
        count, instants = states.shape[:2]
        pose = self.robot.pose(tuple(np.moveaxis(states, -1, 0)))
        centres = np.empty((count, len(self.radii), instants, self.robot.dimension))
        for b, part in enumerate(discs(self.robot)):
            for d, values in enumerate(part.at(pose).position):
                centres[:, b, :, d] = values
        risk, near = np.zeros(count), np.zeros(count)
        expected, walled = compiled()
        lasting = self._lasting(instants - 1)
        given = centres, self.rooms, self.futures, self.weights, self.settings.room, lasting
        expected(*given, risk, near)
        if len(self.walls):
            walled(centres, self.radii, self.walls, risk)
        return risk, near

    def _lasting(self, steps: int) -> Array:
        """Weight of a contact on the way to each step, (N,)."""
        late = self.dt * (np.arange(steps) + 0.5) - CERTAIN
        return np.asarray(np.exp(-np.maximum(late, 0.0) / FADING))

    def _way_left(self, ends: Array, headings: Array | None, span: float) -> Array:
        """Time from where trajectories of ``span`` s end, (C, D), to the path's end, (C,), s."""
        begin, step = self.path.points[:-1], np.diff(self.path.points, axis=0)
        lengths = np.diff(self.path.arc)
        apart = ends[:, None] - begin
        share = np.clip((apart * step).sum(axis=2) / lengths**2, 0.0, 1.0)
        gaps = np.linalg.norm(apart - share[..., None] * step, axis=2)
        arcs = self.path.arc[:-1] + share * lengths
        gaps[np.abs(arcs - self.arc) > 2.0 * self.speed * span + REACH] = np.inf
        best = gaps.argmin(axis=1)[:, None]
        arc, gap = (np.take_along_axis(one, best, axis=1)[:, 0] for one in (arcs, gaps))
        left = self.path.length - arc + gap
        if headings is None:
            return np.asarray(left / self.speed)
        ahead = self.path.at(arc + AHEAD) - ends
        angle = np.arctan2(ahead[:, 1], ahead[:, 0]) - headings
        off = np.abs(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))
        turning = np.where(left > self.robot.radius, off / TURNING, 0.0)
        return np.asarray(left / self.speed + turning)


def _from_now(forecast: Forecast) -> Array:
    """Return the modes of a forecast with where they begin, (O, M, N + 1, D), m."""
    mean = forecast.mean
    if mean.shape[2] < 2:
        return np.concatenate([mean, mean], axis=2)
    return np.concatenate([2.0 * mean[:, :, :1] - mean[:, :, 1:2], mean], axis=2)


def _corners(walls: Sequence[Polygon]) -> Array:
    """Return the corners of convex parts, (W, V, 2), m; the last one is repeated."""
    parts = [part for wall in walls for part in wall.parts]
    most = max((len(part) for part in parts), default=1)
    filled = [np.concatenate([part, np.repeat(part[-1:], most - len(part), 0)]) for part in parts]
    return np.array(filled).reshape(-1, most, 2)
