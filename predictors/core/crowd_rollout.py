"""All people walk on together, each hypothesis on one among the others' expected motions."""

from dataclasses import dataclass

import numpy as np

from ...framework.values.arrays import Array
from ...people.models import Company, Walkers
from ...people.walls import WallField
from .person_belief import HypothesisSlots, PersonBeliefs, company_of, sight

LIGHTEST = 0.02
"""Hypotheses of less weight are not rolled out, beside the heaviest one of each person."""


@dataclass(frozen=True, eq=False)
class Movers:
    """Bodies whose courses are given, at the times 0, step, 2 step and so on.

    Attributes
    ----------
    courses : (M, K + 1, 2), m.
    radius : (M,), m.
    robot : whether the last one is the robot, which the courteous alone see.
    """

    courses: Array
    radius: Array
    robot: bool

    def at(self, row: int, step: float) -> Array:
        """Places, velocities and radii during a step, (M, 5)."""
        place, later = self.courses[:, row], self.courses[:, row + 1]
        return np.concatenate([place, (later - place) / step, self.radius[:, None]], axis=1)


def rolled_out(
    slots: HypothesisSlots,
    beliefs: PersonBeliefs,
    radius: Array,
    movers: Movers,
    walls: WallField,
    step: float,
) -> tuple[Array, Array]:
    """Roll all hypotheses out, (N, S, K + 1, 2), m, and return their weights, (N, S).

    Every step each hypothesis of each person takes the next velocity of its model, seeing the
    others where they are expected: at the weighted mean of their hypotheses. So 200 people with
    S hypotheses cost 200 S walkers, not S^200 crowds. Hypotheses lighter than `LIGHTEST` count
    for nothing and stay at 0.

    Parameters
    ----------
    radius : (N,), m.
    movers : who else is there; K follows from their courses.
    walls : people keep out of them.
    step : s.
    """
    weight = beliefs.weight
    heavy = weight >= np.minimum(LIGHTEST, weight.max(axis=1, keepdims=True, initial=0.0))
    weight = np.where(heavy, weight, 0.0)
    weight = weight / weight.sum(axis=1, keepdims=True)
    count = movers.courses.shape[1] - 1
    state = beliefs.state.copy()
    state[~heavy] = 0.0
    rows = [np.nonzero(heavy & (slots.kind == kind)) for kind in range(len(slots.models))]
    found = np.zeros((*weight.shape, count + 1, 2))
    found[:, :, 0] = state[..., :2]
    for row in range(count):
        mean = np.einsum("ns,nsd->nd", weight, state)
        around = np.concatenate([company_of(mean, radius, None), movers.at(row, step)])
        beside, visible = walls.beside(mean[:, :2]), sight(around, len(mean))
        for model, (owner, slot) in zip(slots.models, rows, strict=True):
            if not len(owner):
                continue
            now = state[owner, slot]
            walkers = Walkers(now[:, :2], now[:, 2:4], now[:, 4:], radius[owner])
            seen = visible[owner]
            if movers.robot:
                seen[:, -1] &= slots.courteous[slot]
            near = beside[owner]
            aside = (now[:, :2] - mean[owner, :2])[:, None] * near[..., 1:]
            near[..., 0] += aside.sum(axis=-1)
            company = Company(around[:, :2], around[:, 2:4], around[:, 4], seen, near)
            state[owner, slot, 2:4] = model.next_velocity(walkers, company, step)
        state[..., :2] += step * state[..., 2:4]
        found[:, :, row + 1] = state[..., :2]
    return found, weight


def on_grid(courses: Array, step: float, times: Array) -> Array:
    """Read courses (..., K + 1, 2) at times (T,), s, on straight lines between their steps."""
    last = courses.shape[-2] - 2
    place = np.clip(times / step, 0.0, last + 1.0)
    below = np.minimum(place.astype(np.int64), last)
    share = (place - below)[:, None]
    return np.asarray((1.0 - share) * courses[..., below, :] + share * courses[..., below + 1, :])
