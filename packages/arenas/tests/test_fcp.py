"""FCP: the contract, what it forbids, and an episode against a second implementation."""

from functools import partial

import numpy as np
import pytest

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.testing.controller import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.data.recordings import Recording
from wideberth.tests.helpers.contracts import Contract
from wideberth_arenas.controllers.fcp import SOFT, FunctionalConformalPlanner
from wideberth_arenas.controllers.functional_envelope import OUTSIDE, FieldGrid, FunctionalEnvelope
from wideberth_arenas.controllers.sampled_paths import SampledPaths, SeenPeople
from wideberth_arenas.studies.conformal_protocol import (
    PERSON,
    REACH,
    ROBOT,
    RecordedCourse,
    drive,
)

STEPS = 12
GRID = FieldGrid((4.0, 0.0), 16.0, 9)

CONTRACT = Contract(
    {
        f"soft={soft}, as_published={published}": partial(
            build,
            "controllers",
            {
                "type": "fcp",
                "robot": "unicycle",
                "soft": soft,
                "as_published": published,
                "paths": 60,
            },
        )
        for soft in (False, True)
        for published in (False, True)
    },
    check_controller.laws,
)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_contract(name, law):
    CONTRACT.check(name, law)


def envelope(rng):
    """An envelope that grows with the step, and differs from cell to cell."""
    size = 0.2 * np.arange(1, STEPS + 1)[:, None]
    upper = size * rng.uniform(0.2, 2.0, (STEPS, GRID.cells**2))
    return FunctionalEnvelope(GRID, tuple(map(tuple, upper.tolist())), 0.4)


def test_config_with_an_envelope():
    small = FunctionalEnvelope(FieldGrid((0.0, 1.0), 2.0, 2), ((0.1, 0.2, 0.3, 0.4),), 0.4)
    made = build("controllers", {"type": "fcp", "robot": "unicycle", "envelope": small})
    assert build("controllers", describe(made)).envelope == small
    with pytest.raises(WideberthError, match=r"envelope\.upper"):
        wrong = {"grid": {"centre": [0.0, 0.0], "width": 1.0, "cells": 2}, "upper": [[0.1]]}
        build("controllers", {"type": "fcp", "robot": "unicycle", "envelope": wrong | {"dt": 0.4}})


def constant(*upper):
    return FunctionalEnvelope(GRID, tuple((u,) * GRID.cells**2 for u in upper), 0.4)


def straight(speed, steps):
    velocities = np.zeros((1, steps, 2), dtype=np.float32)
    velocities[..., 0] = speed
    return SampledPaths.rolled_out(np.zeros(3), velocities, 0.4)


def standing(away, steps):
    place = np.array([[away, 0.0]])
    return SeenPeople(0, ("a",), np.array([0.5]), place, np.repeat(place[None], steps, axis=1))


@pytest.mark.parametrize(("away", "allowed"), [(1.9, False), (2.1, True)])
def test_hard_forbids_what_the_envelope_does(away, allowed):
    """The robot stands; at step 2 it keeps 0.4 + 0.5 m of what is 1.1 m less than it looks."""
    made = FunctionalConformalPlanner(ROBOT, steps=2, envelope=constant(0.2, 1.1))
    cost = made.cost(straight(0.0, 2), np.array([7.0]), standing(away, 2))
    assert cost[0] == (7.0 if allowed else np.inf)


def test_soft_pays_for_the_squared_shortfall():
    made = FunctionalConformalPlanner(ROBOT, steps=2, envelope=constant(0.2, 1.1), soft=True)
    cost = made.cost(straight(0.0, 2), np.array([7.0]), standing(1.6, 2))
    assert cost[0] == pytest.approx(7.0 + SOFT * 0.4**2)  # 0.9 - (1.6 - 1.1)
    # Beyond the envelope no distance is left, not less than none.
    cost = made.cost(straight(0.0, 2), np.array([7.0]), standing(0.1, 2))
    assert cost[0] == pytest.approx(7.0 + SOFT * 2 * 0.9**2)


def test_as_published_nothing_is_kept_at_the_last_seven_steps():
    people = SeenPeople(0, ("a",), np.array([PERSON]), np.zeros((1, 2)), np.zeros((1, STEPS, 2)))
    for published, kept in ((True, 5), (False, STEPS)):
        made = FunctionalConformalPlanner(ROBOT, as_published=published)
        lack = made.shortfall(straight(0.0, STEPS).points[:, 1:], people)[0]
        assert (lack[:kept] > 0.0).all() and (lack[kept:] == 0.0).all()
        assert lack[0] == pytest.approx(REACH)
    relaxed = FunctionalConformalPlanner(ROBOT, as_published=True)
    lack = relaxed.shortfall(straight(0.0, STEPS).points[:, 1:], people)[0]
    assert lack[3] == pytest.approx(REACH - 0.5 * 0.8 * 0.7 * 1.2**2)


def test_people_of_different_sizes_count_from_their_surface():
    made = FunctionalConformalPlanner(ROBOT, steps=1, envelope=constant(0.2))
    ahead = np.array([[[1.6, 0.0]], [[-1.3, 0.0]]])
    people = SeenPeople(0, ("a", "b"), np.array([0.8, 0.3]), ahead[:, 0], ahead)
    # Surfaces at 0.8 and 1.0 m; 0.4 + 0.8 - (0.8 + 0.8 - 0.2) < 0, nothing is lacking.
    assert made.shortfall(straight(0.0, 1).points[:, 1:], people)[0, 0] == 0.0
    nearer = np.array([[[1.3, 0.0]], [[-1.3, 0.0]]])
    people = SeenPeople(0, ("a", "b"), np.array([0.8, 0.3]), nearer[:, 0], nearer)
    lack = made.shortfall(straight(0.0, 1).points[:, 1:], people)[0, 0]
    assert lack == pytest.approx(0.4 - (0.5 - 0.2))


def test_without_an_envelope_a_metre_is_given_up():
    made = FunctionalConformalPlanner(ROBOT, steps=1)
    gap = 0.4 + 0.5 + OUTSIDE
    for away, allowed in ((gap - 0.01, False), (gap + 0.01, True)):
        cost = made.cost(straight(0.0, 1), np.zeros(1), standing(away, 1))
        assert np.isfinite(cost[0]) == allowed


def crowd(rows=60):
    """Three people cross the way."""
    time = 0.4 * np.arange(rows)
    tracks = [np.stack([x + vx * time, y + vy * time], axis=1)
              for x, y, vx, vy in ((3.0, -4.0, 0.0, 0.6), (8.0, 0.4, -0.5, 0.0),
                                   (5.0, 5.0, 0.05, -0.5))]  # fmt: skip
    ids, times = ("a", "b", "c"), 0.4 * np.arange(rows)
    return Recording(0.4, times, ids, np.array(tracks), (None,) * 3)


def episode(soft, published, seed=0):
    course = RecordedCourse(crowd(), (0.0, 0.0, 0.0), (8.0, 0.5))
    made = FunctionalConformalPlanner(
        ROBOT, envelope=envelope(np.random.default_rng(1)), soft=soft, as_published=published,
        seed=seed, paths=300,
    )  # fmt: skip
    return drive(made, course, range(1, 41), standing=0)


class Plain:
    """The published planner a path and a step at a time, in double precision."""

    def __init__(self, known, soft):
        self.rng, self.known, self.soft, self.last = np.random.default_rng(0), known, soft, None

    def limits(self, step):
        return max(0.0, REACH - 0.5 * 0.8 * 0.7 * (0.4 * step) ** 2)

    def upper(self, place, step):
        cells, width = GRID.cells, GRID.width
        across, along = (place - np.array(GRID.centre) + width / 2) / width * (cells - 1)
        if not (0 <= across <= cells - 1 and 0 <= along <= cells - 1):
            return 1.0
        return self.known.upper[step][int(np.rint(along)) * cells + int(np.rint(across))]

    def price(self, pose, velocities, goal, people):
        place, heading, total = pose[:2].copy(), pose[2], 0.0
        for step, (v, w) in enumerate(velocities):
            total += ((place - goal) ** 2).sum() + 1e-3 * (v**2 + w**2)
            place = place + 0.4 * v * np.array([np.cos(heading), np.sin(heading)])
            heading += 0.4 * w
            away = min(np.hypot(*(place - person)) for person in people[step])
            lack = self.limits(step) - max(away - self.upper(place, step), 0.0)
            if lack > 0.0:
                if not self.soft:
                    return np.inf
                total += 100.0 * lack**2
        return total + 10.0 * ((place - goal) ** 2).sum()

    def command(self, pose, goal, people):
        speeds = self.rng.uniform(-0.8, 0.8, (300, 6))
        turns = self.rng.uniform(-0.7, 0.7, (300, 6))
        if self.last is not None:
            speeds[0] = self.last[1:7, 0]
            turns[0] = self.last[1:7, 1]
            self.rng.uniform(size=2)  # drawn for a block that is cut off
        drawn = np.repeat(np.stack([speeds, turns], axis=2), 2, axis=1)
        prices = [self.price(pose, one, goal, people) for one in drawn]
        best = int(np.argmin(prices))
        if prices[best] == np.inf:
            return None
        self.last = drawn[best]
        return drawn[best, 0]


@pytest.mark.parametrize("soft", [False, True])
def test_published_episode_against_a_plain_one(soft):
    found = episode(soft, True)
    recorded = crowd().positions
    plain = Plain(envelope(np.random.default_rng(1)), soft)
    pose, goal, failures = np.array([0.0, 0.0, 0.0]), np.array([8.0, 0.5]), 0
    for row, seen, failed in zip(found.rows[:-1], found.poses, found.failed, strict=False):
        np.testing.assert_allclose(pose, seen, atol=2e-5)
        now, before = recorded[:, row], recorded[:, row - 1]
        people = [now + (now - before) * k for k in range(1, STEPS + 1)]  # as they walk
        chosen = plain.command(pose, goal, people)
        assert (chosen is None) == failed
        failures += failed
        v, w = (0.0, 0.0) if chosen is None else chosen
        way = 0.4 * v * np.array([np.cos(pose[2]), np.sin(pose[2])])
        pose = pose + np.array([*way, 0.4 * w])
    assert len(found.rows) > 12
    assert (failures > 0) == (not soft)


def test_same_seed_same_bytes():
    first, second, other = (episode(False, False, seed) for seed in (3, 3, 4))
    assert first.poses.tobytes() == second.poses.tobytes()
    assert first.poses.tobytes() != other.poses.tobytes()
