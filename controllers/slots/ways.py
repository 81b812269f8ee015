"""The ways that people go next, which a plan gives up before it enters their bodies."""

from dataclasses import dataclass, replace
from typing import ClassVar, final

import numpy as np

from ...framework.mpc.levels.base import LevelPolicy, SharedLevel
from ...framework.mpc.ocp.problem import SlotNumbers, Slots
from ...framework.mpc.ocp.stage import Frame, slots_of
from ...framework.mpc.slots.base import (
    CAPACITIES,
    PlanningContext,
    SelectiveKind,
    SlotAssignment,
    SlotSizes,
    next_capacity,
)
from ...framework.mpc.slots.gaussian_discs import KnownDiscs, ObstacleSet, OfDiscs, fill
from ...framework.region import Constraint, Region
from ...framework.robot import Robot
from ...framework.values.arrays import Array, Scalar, positive
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Pose


@final
@dataclass(frozen=True)
class Ways(OfDiscs, SelectiveKind):
    """Obstacles of the forecast, and behind them their ways: a slot for each mode of each.

    In a planner's ``further_kinds`` it takes the place of `GaussianDiscs`, whose name it has. A
    plan then keeps out of two regions for each obstacle and step: that of the obstacle itself, and
    that of its way during the next ``span`` seconds. Both are soft; to enter a way costs a share
    of what it costs to enter a body equally far, so that where no plan keeps everything free, the
    solver gives ways up first.

    Constraint: k h(x) >= 0 with h that of the region, and k = 1 for bodies and ``share`` for
    ways. A step has one slack, the largest k (-h) of all its slots, so that k is a share of the
    price, and a way adds nothing where a body is entered more.

    A plan that enters a way counts as one that enters regions. It is no longer ``optimal``: of
    the plans at hand the one is driven that enters least, the entry of a way times ``share``,
    whatever the plans cost; see `wideberth.framework.mpc.planner.rungs`. What a plan says of
    levels is about bodies alone, and so is contact.

    Parameters
    ----------
    region : states the sets that the robot keeps out of; the planner's.
    span : s, above 0.
    share : of the price, above 0 and at most 1.
    margin : m, added to the radii of robot and obstacle; stands in place of the planner's.

    Raises
    ------
    WideberthError : a number out of range.
    """

    region: Region
    span: float = 1.25
    share: float = 0.1
    margin: float = 0.05

    name: ClassVar[str] = "obstacle"

    def __post_init__(self) -> None:
        positive("ways.span", self.span)
        positive("ways.share", self.share)
        positive("ways.margin", self.margin, zero=True)
        if self.share > 1.0:
            raise WideberthError(
                f"ways.share is {self.share:g}; wanted at most 1: a way costs no more than a body"
            )

    def refuse(self, level: LevelPolicy, penalty: float | None, most: int) -> None:
        """Refuse ways without a price, more than there are slots for, or a level that moves.

        A level that gives way does so for the way as it does for the body, at the level's own
        price.

        Raises
        ------
        WideberthError : no penalty, too many obstacles, or a level that is a variable of the plan.
        """
        if isinstance(level, SharedLevel):
            raise WideberthError(
                f"planner.level is {type(level).__name__}, which would give way for people's ways "
                "at the price of their bodies; wanted a level that is held with the slot kind "
                "ways, such as discounted or fixed"
            )
        if penalty is None:
            raise WideberthError(
                "the slot kind ways has a share of the price of soft regions, and planner.penalty "
                "is None: give a penalty, such as 1e4, or leave the ways out"
            )
        if 2 * most > CAPACITIES[-1]:
            raise WideberthError(
                f"planner.most_obstacles is {most}; wanted at most {CAPACITIES[-1] // 2} with the "
                "slot kind ways, which takes a slot for each way"
            )

    def ways_of(self, discs: ObstacleSet, dt: float) -> ObstacleSet:
        """Return the ways of some discs.

        The way at step i has the moments of where the disc is at step i + J, J drawn evenly from
        0 .. min(c, N - i)::

            mu_i' = mean_j mu_{i+j},    Sigma_i' = mean_j (Sigma_{i+j} + (mu_{i+j} - mu_i')(..)')

        with c = span / dt to the nearest whole number: behind the forecast's end nothing is known.

        Parameters
        ----------
        discs : on the plan's grid.
        dt : s between its steps.
        """
        steps = len(discs.mean)
        ahead = min(round(self.span / dt), steps - 1)
        count = np.minimum(ahead, np.arange(steps - 1, -1, -1)) + 1
        mean, spread = np.zeros_like(discs.mean), np.zeros_like(discs.covariance)
        for later in range(ahead + 1):
            mean[: steps - later] += discs.mean[later:]
        mean /= count[:, None, None]
        for later in range(ahead + 1):
            apart = discs.mean[later:] - mean[: steps - later]
            square = apart[..., :, None] * apart[..., None, :]
            spread[: steps - later] += discs.covariance[later:] + square
        spread /= count[:, None, None, None]
        return replace(discs, mean=mean, covariance=spread)

    def slots(self, room: SlotSizes, frame: Frame) -> Slots:
        """State that every body is outside of the region, at the price that is the last number."""
        size, region = frame.robot.dimension, self.region
        own, width = region.auxiliary(size), region.parameter_count(size) + 1
        parts, count = self.bodies(frame.robot), room[0] if room else 0

        def state(pose: Pose, numbers: Scalar, level: Scalar, auxiliary: Scalar) -> Constraint:
            found = region.constraint(pose, numbers[: width - 1], level, auxiliary)
            share = numbers[width - 1]
            return Constraint(tuple(share * one for one in found.inequalities), found.equalities)

        return slots_of(self.name, count, width, own, parts, state, frame, levelled=True)

    def choose(self, robot: Robot, view: PlanningContext) -> SlotAssignment:
        """Choose discs as without ways, and add the way of each that has a slot."""
        chosen = self.discs.choose(robot, view)
        assert isinstance(chosen.known, KnownDiscs)
        discs, radius = chosen.known.obstacles, self.bodies(robot)[0].radius + view.margin
        count, room = len(discs), next_capacity(2 * len(discs))
        ways = self.ways_of(discs, view.dt)
        both = replace(
            discs,
            mean=np.concatenate([discs.mean, ways.mean], axis=1),
            covariance=np.concatenate([discs.covariance, ways.covariance], axis=1),
            radius=np.concatenate([discs.radius, discs.radius + (self.margin - view.margin)]),
            ids=(*discs.ids, *discs.ids),
        )
        numbers = fill(view.reference, both, self.region, view.level, radius, room, view.own)
        share = np.ones((*numbers.parameters.shape[:2], 1))
        share[:, count : 2 * count] = self.share
        priced, end = np.concatenate([numbers.parameters, share], axis=2), None
        if chosen.at_end is not None:
            end = priced[-1].copy()
            end[:count, :-1] = chosen.at_end[:count]
        return replace(
            chosen,
            room=(room,),
            numbers=replace(numbers, parameters=priced),
            lesser=tuple(f"way of {name}" for name in discs.ids),
            at_end=end,
        )

    def auxiliary_start(self, robot: Robot, pose: Pose, numbers: SlotNumbers) -> Array:
        """Best auxiliaries of the region, whatever the price."""
        plain = replace(numbers, parameters=numbers.parameters[..., :-1])
        return self.discs.auxiliary_start(robot, pose, plain)

    def explanation(self, dimension: int) -> str:
        """Quote the region, and say what the last number is."""
        last = f"The last number is the share of the price: 1, or {self.share:g} for a way."
        return f"{self.discs.explanation(dimension)}\n\n{last}"
