"""Drawn futures: a plan keeps clear of a thousand of them at once, and says what it risks."""

from dataclasses import dataclass
from itertools import product
from math import sqrt
from typing import ClassVar, NamedTuple, final
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from ...framework.mpc.levels.base import LevelPolicy, Promise, SharedLevel
from ...framework.mpc.ocp.bodies import Body, discs
from ...framework.mpc.ocp.problem import SlotNumbers, Slots
from ...framework.mpc.ocp.stage import Frame, slots_of
from ...framework.mpc.slots.base import (
    WIDE,
    LevelledKind,
    OutOfReach,
    PlanningContext,
    SelectiveKind,
    SidedKind,
    SlotAssignment,
    SlotSizes,
    active_slots,
    farthest,
    next_capacity,
)
from ...framework.mpc.slots.gaussian_discs import (
    KnownDiscs,
    ObstacleSet,
    choose_obstacles,
    not_wider,
    within_reach,
)
from ...framework.mpc.slots.reachability import lengths
from ...framework.region import Auxiliary, Constraint
from ...framework.robot import Robot
from ...framework.values.arrays import Array, Scalar, probability, whole
from ...framework.values.coverage import Coverage, Event
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Pose
from ...framework.values.roots import factor
from .scenario_risk import largest_support, risk_of_support, scenarios_wanted

HALF = 0.5
"""Share of the gap between the last plan and an obstacle that the obstacle gets for nothing."""
SUPPORT = 20
"""Draws that hold the half-planes of a plan among a few people; fewer scenarios than leave the
risk asked for with these are refused."""
DEVIATIONS = 2.0
"""Size of the ellipse whose normal the half-planes take."""
WAYS = ((1.0, 0.0), (1.0, 0.4), (0.5, 0.0), (0.5, 0.4), (1.0, 0.8), (0.0, 0.0), (1.0, 1.3))
"""Share of the pace, and rad to either side: what is looked at, in turn, where the last plan
meets a person."""
ENOUGH = 0.4
"""m from the nearest mean, beside the radii, that such a way has to leave."""
NOTHING = Auxiliary((), (), ())


@final
@dataclass(frozen=True)
class DrawnFutures(LevelledKind, SelectiveKind, SidedKind):
    """Keeps a plan clear of drawn futures of all obstacles: scenario MPC in the plan.

    In a planner's ``further_kinds`` it takes the place of `GaussianDiscs`, whose name it has. One
    scenario is one future of all obstacles at all steps, drawn from the forecast with its joint
    covariance, and of the robot's own error of place. An obstacle k has one slot, a half-plane
    at each step h, however many scenarios there are::

        n_kh . p_h  >=  b_kh,       b_kh = max(c_kh,  max_s n_kh . x_skh + r_k)

    over the scenarios s that are not discarded. The normal n is that of an ellipse around the
    forecast's mean, on the side where the last plan, shifted, passes it; where that plan meets
    anyone's mean, on the side of another way that clears all of them most. c is what an obstacle
    gets for nothing, which no scenario has to hold: half of the gap between that way and it, and
    whatever the robot cannot reach.

    **Promise.** Neither n nor c depends on the draws, which are new at every stamp. Then the
    half-planes follow from those scenarios alone that hold one of them (attain b above c), and
    from those discarded, and no scenario that keeps the half-planes changes them. So a plan that
    keeps them, by whatever solver and however local its optimum, is met by an obstacle at any of
    its steps with probability at most eps(k + R), see
    `wideberth.controllers.slots.scenario_risk.risk_of_support`, but for a share ``doubt`` of
    plans, k scenarios holding half-planes and R being discarded. It is promised of the plan as a
    whole, driven to its end without planning anew, if the forecast is right about the joint
    distribution; obstacles left out are not counted. `Plan.risk` says eps. It bounds no episode.

    **Discarding.** Of the scenarios that hold half-planes the one is discarded first whose
    half-planes lie deepest over the reference (the sum of squares), while k + R stays at or below
    the largest for the risk asked for, also if each half-plane it held gets a holder of its own.
    The choice looks at the holders alone: a rule that looked at the runners-up would need them in
    the count.

    Where it departs from Safe Horizon MPC: there each scenario has a line of its own around the
    last iterate, and the support is that of a local optimum, taken for the whole algorithm's.

    Parameters
    ----------
    risk : aimed at for the whole plan and all obstacles, in (0, 1).
    doubt : beta, share of plans that may risk more than they say, in (0, 1).
    scenarios : S.
    seed : of the draws; with stamp and name of the obstacle it fixes them.

    Raises
    ------
    WideberthError : a number out of range, or too few scenarios for this risk.

    References
    ----------
    de Groot, Ferranti, Gavrila, Alonso-Mora, "Scenario-Based Motion Planning with Bounded
    Probability of Collision", 2023 (arXiv 2307.01070).
    """

    risk: float = 0.1
    doubt: float = 0.01
    scenarios: int = 1000
    seed: int = 0

    name: ClassVar[str] = "obstacle"
    reference: ClassVar[str] = "degroot2023scenario"
    coverage: ClassVar[Coverage | None] = Coverage(
        Event.PLAN,
        "at least 1 - Plan.risk, but for a share doubt of plans",
        "the forecast is right about the joint distribution of all people and steps",
        "campi2023compression",
    )

    def __post_init__(self) -> None:
        probability("drawn_futures.risk", self.risk)
        probability("drawn_futures.doubt", self.doubt)
        whole("drawn_futures.scenarios", self.scenarios)
        whole("drawn_futures.seed", self.seed, least=0)
        if largest_support(self.risk, self.scenarios, self.doubt) < SUPPORT:
            wanted = scenarios_wanted(self.risk, SUPPORT, self.doubt)
            raise WideberthError(
                f"drawn_futures.scenarios is {self.scenarios}; a risk of {self.risk:g} with doubt "
                f"{self.doubt:g} wants at least {wanted}, of which {SUPPORT} hold a plan"
            )

    def refuse(self, level: LevelPolicy, penalty: float | None, most: int) -> None:
        """Refuse a level that is a variable of the plan: the draws decide how far to keep away.

        Raises
        ------
        WideberthError : such a level.
        """
        if isinstance(level, SharedLevel):
            raise WideberthError(
                f"planner.level is {type(level).__name__}, and with the slot kind drawn_futures "
                "the draws say how far to keep away; wanted a level that is held, such as fixed"
            )

    def bodies(self, robot: Robot) -> tuple[Body, ...]:
        """Discs of the robot."""
        return discs(robot)

    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        """State that every body lies beyond the half-plane."""
        size, parts = frame.robot.dimension, self.bodies(frame.robot)

        def state(pose: Pose, numbers: Scalar, level: Scalar, auxiliary: Scalar) -> Constraint:
            along = sum(numbers[i] * pose.position[i] for i in range(size))
            return Constraint((along - numbers[size] - level * numbers[size + 1],))

        count = room[0] if room else 0
        return slots_of(self.name, count, size + 2, NOTHING, parts, state, frame, levelled=True)

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Draw futures, discard the dearest, and fill a half-plane per obstacle and step."""
        drawn = self.half_planes(robot, view)
        planes, kept, (holding, discarded) = drawn.planes, drawn.kept, drawn.support
        steps, count, size = planes.normal.shape
        room = next_capacity(count)
        numbers = np.zeros((steps, room, size + 2))
        numbers[..., 0] = numbers[..., -1] = 1.0
        numbers[:, :count, :size] = planes.normal
        numbers[:, :count, size] = planes.least
        numbers[:, :count, size + 1] = planes.room
        none, level = np.zeros((steps, room, 0)), np.ones((steps, room))
        beyond = kept.out_of_reach
        return SlotAssignment(
            (room,),
            kept.ids,
            kept.left_out,
            SlotNumbers(numbers, active_slots(count, room), none, level),
            KnownDiscs(self, kept, view.margin),
            OutOfReach(beyond, np.ones((steps, len(beyond)))) if beyond else None,
            risk=risk_of_support(holding + discarded, self.scenarios, self.doubt),
        )

    def half_planes(self, robot: Robot, view: PlanningContext) -> "DrawnHalfPlanes":
        """Return the half-planes, those that they keep clear of, and the scenarios behind them."""
        everyone = _obstacles(view)
        anchor = _anchor(robot, everyone, view)
        normal = _normals(robot, everyone, anchor, view)
        free = _Free.of(robot, everyone, normal, anchor, view)
        over = self._drawn(view, everyone, normal) - (free.given - free.least)[None]
        height = np.maximum(over.max(axis=0), 0.0)
        far = (free.given + height <= free.beyond).all(axis=0)
        kept, places = choose_obstacles(everyone, view.route, view.most, far)
        counted = np.sort(np.concatenate([places, np.flatnonzero(far)]))
        depth = free.given - np.einsum("nod,nd->no", normal, view.reference.position)
        height[:, counted], support = self.discard(over[:, :, counted], depth[:, counted])
        room = (free.given - free.least + height)[:, places]
        planes = HalfPlanes(normal[:, places], free.least[:, places], room)
        return DrawnHalfPlanes(planes, kept, support)

    def _drawn(self, view: PlanningContext, everyone: ObstacleSet, normal: Array) -> Array:
        """Draw futures along the normals, relative to the mean, m, (S, N, O)."""
        found = np.empty((self.scenarios, *normal.shape[:2]))
        with np.errstate(over="ignore", invalid="ignore"):
            for o, name in enumerate(everyone.ids):
                assert view.forecast is not None
                draws = view.forecast.sample_of(o, self._stream(name, view), self.scenarios)
                away = draws - view.forecast.weight[o] @ view.forecast.mean[o].swapaxes(0, 1)
                found[:, :, o] = np.einsum("snd,nd->sn", away, normal[:, o])
            if view.own.any():
                size = normal.shape[2]
                noise = self._stream("", view).standard_normal((self.scenarios, size))
                found += np.einsum("nij,sj,noi->sno", factor(view.own), noise, normal)
            found = np.nan_to_num(found, copy=False, nan=WIDE)
        return np.asarray(np.minimum(np.maximum(found, -WIDE), WIDE))

    def _stream(self, name: str, view: PlanningContext) -> np.random.Generator:
        """Return the draws of one obstacle at one instant: the same however many there are."""
        instant = int(np.float64(view.observation.stamp).view(np.uint64))
        return np.random.default_rng([self.seed, instant, crc32(name.encode())])

    def discard(self, over: Array, depth: Array) -> tuple[Array, "Support"]:
        """Discard the dearest scenarios; return how far the rest pass c, (N, O), and how many.

        ``over`` is how far each passes c, (S, N, O), and ``depth`` how far c lies over the
        reference, (N, O).
        """
        shape, most = depth.shape, largest_support(self.risk, self.scenarios, self.doubt)
        cells = over.reshape(len(over), -1)
        passed = np.flatnonzero(cells.max(axis=0, initial=0.0) > 0.0)
        some, deep = cells[:, passed], depth.ravel()[passed]
        order = _highest(some, most + 1)
        values = np.maximum(np.take_along_axis(some, order, 0), 0.0)
        place, gone = np.zeros(len(passed), dtype=np.intp), np.zeros(len(some), dtype=np.bool_)
        column = np.arange(len(passed))
        while True:
            holder, height = order[place, column], values[place, column]
            holds = height > 0.0
            cells_held = np.bincount(holder[holds], minlength=len(some))
            support, discarded = int((cells_held > 0).sum()), int(gone.sum())
            price = np.where(holds, np.maximum(deep + height, 0.0) ** 2, 0.0)
            prices = np.bincount(holder, weights=price, minlength=len(some))
            dearest = int(prices.argmax())
            if prices[dearest] <= 0.0 or support + discarded + cells_held[dearest] > most:
                break
            gone[dearest] = True
            while (stale := gone[order[place, column]]).any():
                place[stale] += 1
        found = np.zeros(cells.shape[1])
        found[passed] = height
        return found.reshape(shape), Support(support, discarded)

    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        """Return none: a half-plane has no extra variables."""
        return np.zeros((*numbers.parameters.shape[:2], 0))

    def levels(self, policy: LevelPolicy, steps: int, count: int, dimension: int) -> Array:
        """Return 1, whatever the policy: the draws say how far to keep away."""
        return np.ones((steps, count))

    def tail(self, level: float, promise: Promise, dimension: int) -> float:
        """Return risk^(s^2), as the content of a Gaussian ellipse would fall; 1 below level 0."""
        return float(self.risk ** (level * level)) if level >= 0.0 else 1.0

    def explanation(self, dimension: int) -> str:
        """Say what a slot holds."""
        return (
            f"They are the unit normal n of a half-plane ({dimension} numbers), the smallest "
            "n . p at which the robot's body is clear of the obstacle at its mean, m, and how "
            "much more of it the drawn futures ask for at level 1, m."
        )


class HalfPlanes(NamedTuple):
    """Half-planes n . p >= least + room of O obstacles at N steps.

    Attributes
    ----------
    normal : (N, O, D). least : (N, O), m, clear of the mean. room : (N, O), m, for the draws.
    """

    normal: Array
    least: Array
    room: Array


class Support(NamedTuple):
    """How many scenarios hold half-planes, and how many were discarded."""

    holding: int
    discarded: int


class DrawnHalfPlanes(NamedTuple):
    """Half-planes of those obstacles that have a slot, and how many scenarios they hang on."""

    planes: HalfPlanes
    kept: ObstacleSet
    support: Support


class _Free(NamedTuple):
    """Offsets that hang on no draw, (N, O), m, see `DrawnFutures`.

    ``least`` is clear of the mean, ``given`` is c, and below ``beyond`` no plan can come.
    """

    least: Array
    given: Array
    beyond: Array

    @classmethod
    def of(
        cls,
        robot: Robot,
        everyone: ObstacleSet,
        normal: Array,
        anchor: Array,
        view: PlanningContext,
    ) -> "_Free":
        """Compute them of all obstacles."""
        bodies = discs(robot)
        room = bodies[0].radius + view.margin + everyone.radius
        least = np.einsum("nod,nod->no", normal, everyone.mean) + room
        gap = np.einsum("nod,nd->no", normal, anchor) - farthest(bodies) - least
        here = np.einsum("nod,nd->no", normal, view.route[1])
        beyond = here - view.travel[:, None] - sqrt(robot.dimension) * farthest(bodies)
        given = np.maximum(least + HALF * np.maximum(gap, 0.0), beyond)
        return cls(least, given, beyond)


def _obstacles(view: PlanningContext) -> ObstacleSet:
    """Return one disc per obstacle, with mean and covariance of all its modes together."""
    if view.tracks is None or view.forecast is None:
        return ObstacleSet.none(*view.route.shape[1:])
    forecast, here = view.forecast, view.route[1, :1, None]
    with np.errstate(over="ignore", invalid="ignore"):
        mean = np.einsum("om,omnd->ond", forecast.weight, forecast.mean)
        apart = forecast.mean - mean[:, None]
        square = forecast.covariance + apart[..., :, None] * apart[..., None, :]
        covariance = np.einsum("om,omnij->onij", forecast.weight, square).swapaxes(0, 1)
    mean = within_reach(mean.swapaxes(0, 1), here)
    return ObstacleSet(mean, not_wider(covariance), view.tracks.radius, view.tracks.ids)


def _anchor(robot: Robot, everyone: ObstacleSet, view: PlanningContext) -> Array:
    """Return the way on whose side of everyone the half-planes lie, (N, D), m.

    The last plan, shifted, where it clears all means, also between steps. Else that plan and the
    reference are slowed down and turned about where the robot is: the first of `WAYS` that leaves
    `ENOUGH` is taken, or what leaves most.
    """
    room = everyone.radius + discs(robot)[0].radius + view.margin
    here, best = view.route[1], view.planned
    most = (_closest(best[:, None] - everyone.mean) - room).min(initial=np.inf)
    if most >= 0.0:
        return best
    for pace, turn in WAYS:
        for way, side in product((view.planned, view.reference.position), (1.0, -1.0)):
            cos, sin = np.cos(turn), side * np.sin(turn)
            tried = pace * (way - here)
            tried[:, :2] = tried[:, :2] @ np.array([[cos, sin], [-sin, cos]])
            tried += here
            clear = (_closest(tried[:, None] - everyone.mean) - room).min()
            if clear > most:
                best, most = tried, clear
        if most >= ENOUGH:
            break
    return best


def _normals(robot: Robot, everyone: ObstacleSet, anchor: Array, view: PlanningContext) -> Array:
    """Return unit normals of the half-planes, (N, O, D), on the side of the anchor.

    n is along (q^2 Sigma + rho^2 I)^-1 (p - mu), the normal at p of the ellipse around the mean,
    rho the radii of both bodies.
    """
    radius = everyone.radius + discs(robot)[0].radius + view.margin
    apart = anchor[:, None] - everyone.mean
    size = apart.shape[2]
    with np.errstate(all="ignore"):
        wide = DEVIATIONS**2 * everyone.covariance + (radius**2)[:, None, None] * np.eye(size)
        scale = np.abs(wide).max(axis=(2, 3), keepdims=True)
        found = np.linalg.solve(wide / scale, apart[..., None])[..., 0]
        found /= lengths(found)[..., None]
    back = np.broadcast_to(-view.reference.direction[:, None], found.shape)
    good = np.isfinite(found).all(axis=2, keepdims=True)
    return np.where(good, found, back)


def _highest(values: Array, count: int) -> NDArray[np.intp]:
    """Return the rows of the highest values of each column (and one more), from high to low."""
    last = min(count, len(values) - 1)
    rows = np.argpartition(-values, last, axis=0)[: last + 1]
    falling = np.argsort(-np.take_along_axis(values, rows, 0), axis=0, kind="stable")
    return np.take_along_axis(rows, falling, 0)


def _closest(apart: Array) -> Array:
    """Return how near to zero a broken line of places (N, O, D) comes, (O,)."""
    begin, step = apart[:-1], np.diff(apart, axis=0)
    square = np.maximum((step * step).sum(axis=2), 1e-12)
    share = np.clip(-(begin * step).sum(axis=2) / square, 0.0, 1.0)
    between = lengths(begin + share[..., None] * step)
    return np.asarray(np.concatenate([between, lengths(apart[-1:])]).min(axis=0))
