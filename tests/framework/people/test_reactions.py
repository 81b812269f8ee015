"""Roll-outs of people beside many ways of a robot: each world by itself, and by hand."""

import numpy as np
import pytest

from wideberth.framework.people.models import (
    CircularForce,
    Company,
    PersonModel,
    Reciprocal,
    Straight,
    Walkers,
)
from wideberth.framework.people.reactions import reactions
from wideberth.framework.people.walls import WallField
from wideberth.framework.values.polygon import Polygon

DT, RADIUS = 0.25, 0.4
WALLS = WallField((Polygon(((-4.0, 2.0), (4.0, 2.0), (4.0, 2.5), (-4.0, 2.5))),))


def crowd(count=4, seed=0):
    rng = np.random.default_rng(seed)
    place, velocity, wanted = (scale * rng.standard_normal((count, 2)) for scale in (2.0, 1, 1))
    return Walkers(place, velocity, wanted, np.full(count, 0.3))


def ways(count=3, steps=6, seed=1):
    start = np.zeros((count, 1, 2))
    moves = 0.2 * np.random.default_rng(seed).standard_normal((count, steps, 2))
    return np.concatenate([start, np.cumsum(moves, axis=1)], axis=1)


@pytest.mark.parametrize(
    "model", [Straight(), CircularForce(), Reciprocal()], ids=lambda m: m.name
)
def test_each_world_is_that_of_its_own_way(model: PersonModel):
    people, driven = crowd(), ways()
    together = reactions(model, people, driven, RADIUS, WALLS, DT)
    for way, found in zip(driven, together, strict=True):
        place, velocity = people.place, people.velocity
        for row in range(len(way) - 1):
            pace = (way[row + 1] - way[row]) / DT
            company = Company(
                np.concatenate([place, way[row : row + 1]]),
                np.concatenate([velocity, pace[None]]),
                np.append(people.radius, RADIUS),
                ~np.eye(4, 5, dtype=bool),
                WALLS.beside(place),
            )
            now = Walkers(place, velocity, people.wanted, people.radius)
            velocity = model.next_velocity(now, company, DT)
            place = place + DT * velocity
            assert np.allclose(found[:, row + 1], place, rtol=0.0, atol=1e-12)


def test_who_makes_way_for_nobody_walks_straight_whatever_the_robot_does():
    people, driven = crowd(), ways()
    found = reactions(Straight(), people, driven, RADIUS, WALLS, DT)
    times = DT * np.arange(driven.shape[1])[:, None]
    wanted = people.place[:, None] + times * people.wanted[:, None]
    assert found == pytest.approx(np.broadcast_to(wanted, found.shape))


def test_somebody_steps_aside_for_the_robot_that_comes_and_not_for_one_far_away():
    people = Walkers(*(np.array([one]) for one in ((2.0, 0.1), (-1.0, 0.0), (-1.0, 0.0))),
                     np.array([0.3]))  # fmt: skip
    near = np.stack([np.linspace(0.0, 2.0, 9), np.zeros(9)], axis=1)
    found = reactions(CircularForce(), people, np.stack([near, near + 50.0]), RADIUS,
                      WallField(), DT)  # fmt: skip
    assert found[0, 0, -1, 1] > 0.3  # to the side on which he is already
    assert found[1, 0, -1] == pytest.approx([0.0, 0.1])


def test_nobody_there_is_no_roll_out():
    nobody = Walkers(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    for model in (CircularForce(), Reciprocal()):
        assert reactions(model, nobody, ways(), RADIUS, WALLS, DT).shape == (3, 0, 7, 2)
