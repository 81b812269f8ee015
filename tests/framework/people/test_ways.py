"""Ways that are drawn among people: what people want, who is rolled out, and what is drawn."""

from itertools import pairwise

import numpy as np
import pytest

from wideberth.framework.people.models import CircularForce, Straight, Walkers
from wideberth.framework.people.reactions import reactions
from wideberth.framework.people.walls import WallField
from wideberth.framework.people.ways import (
    MOST_SAMPLES,
    Neighbourhood,
    WayCost,
    averaged,
    drawn,
    walkers_of,
)
from wideberth.framework.values.tracks import Tracks
from wideberth.robots import HolonomicVelocity, Unicycle

DT = 0.2


def tracks(positions, stamp=3.0):
    """Tracks of people with a radius of 0.3 m."""
    count = len(positions)
    ids = tuple(f"p{i}" for i in range(count))
    noise = np.tile(1e-4 * np.eye(2), (count, 1, 1))
    return Tracks(np.array(positions), DT, ids, np.full(count, 0.3), noise, stamp)


def test_what_is_wanted_is_the_mean_velocity_sample_by_sample():
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.standard_normal((3, 12, 2)), axis=1)
    walk[1, [4, 5]] = np.nan  # not seen for a while
    walk[2, :11] = np.nan  # seen once
    people = walkers_of(tracks(walk), 3.1, 1.5)
    for row in range(3):
        seen = np.flatnonzero(np.isfinite(walk[row, :, 0]))
        velocity, wanted = np.zeros(2), np.zeros(2)
        for k, (before, now) in enumerate(pairwise(seen.tolist())):
            span = DT * (now - before)
            velocity = (walk[row, now] - walk[row, before]) / span
            kept = np.exp(-span / 1.5)
            wanted = velocity if k == 0 else kept * wanted + (1.0 - kept) * velocity
        assert people.velocity[row] == pytest.approx(velocity)
        assert people.wanted[row] == pytest.approx(wanted)
        assert people.place[row] == pytest.approx(walk[row, seen[-1]] + 0.1 * velocity)


def test_who_has_left_is_carried_on_and_who_was_never_seen_is_left_out():
    walk = np.full((3, MOST_SAMPLES + 10, 2), np.nan)
    walk[0, -5:-2, 0], walk[0, -5:-2, 1] = (0.0, 0.2, 0.4), 1.0
    walk[1, 3] = 7.0  # longer ago than is looked at
    people = walkers_of(tracks(walk), 3.0, 1.0)
    assert people.place == pytest.approx(np.array([[0.8, 1.0]]))
    assert people.radius.tolist() == [0.3]
    assert np.isfinite(walkers_of(tracks(np.full((1, 4, 2), 1e200)), 3.0, 1.0).place).all()


def test_a_mean_forgets_as_the_exponential_says():
    found = averaged(np.array([1.0, 0.0]), np.array([0.0, 2.0]), 0.5, 2.0)
    assert found == pytest.approx([np.exp(-0.25), 2.0 * (1.0 - np.exp(-0.25))])


def test_the_nearest_react_and_the_others_go_straight_on():
    place = np.array([[2.0, 0.1], [2.0, 0.9], [-4.0, 0.0]])
    pace = np.array([[-1.0, 0.0], [-1.0, 0.0], [1.0, 0.0]])
    people = Walkers(place, pace, pace, np.full(3, 0.25))
    way = np.stack([0.25 * np.arange(9.0), np.zeros(9)], axis=1)[None]
    around = Neighbourhood(CircularForce(), people, WallField(), nearest=2)
    found = around.gaps(way, 0.3, 0.25)
    near = Walkers(place[:2], pace[:2], pace[:2], people.radius[:2])
    others = reactions(CircularForce(), near, way, 0.3, WallField(), 0.25)[0]
    for row, places in enumerate([*others, place[2] + 0.25 * np.arange(9.0)[:, None] * pace[2]]):
        fine = np.linspace(0.0, 1.0, 401)
        for step in range(8):
            ends = [np.array([one[step], one[step + 1]]) for one in (way[0], places)]
            apart = [one[0] + fine[:, None] * (one[1] - one[0]) for one in ends]
            least = np.linalg.norm(apart[0] - apart[1], axis=1).min() - 0.55
            assert found[0, row, step] == pytest.approx(least, abs=1e-4)
    alone = Neighbourhood(Straight(), people, WallField(), nearest=2).gaps(way, 0.3, 0.25)
    assert np.array_equal(alone[:, 2], found[:, 2])
    assert not np.allclose(alone[:, 0], found[:, 0])


def test_the_reference_may_move():
    """A robot that stands is off a reference that goes on by 0.5, 1, 1.5, 2 m."""
    nobody = Walkers(*[np.zeros((0, 2))] * 3, np.zeros(0))
    wanted = np.stack([0.5 * np.arange(1.0, 5.0), np.zeros(4)], axis=1)
    cost = WayCost(contact=1.0, closeness=1.0, margin=0.3)
    around = Neighbourhood(Straight(), nobody, WallField())
    found = cost.of(around, np.zeros((1, 5, 2)), 0.3, wanted, 0.5)
    assert found == pytest.approx([1.25])


@pytest.mark.parametrize(
    "robot", [Unicycle(radius=0.3), HolonomicVelocity(radius=0.3)], ids=lambda r: type(r).__name__
)
def test_draws_hold_what_is_given_and_keep_the_speed(robot):
    about = np.tile([0.3, 0.0, 0.1], (10, 1))
    state = np.zeros(len(robot.states))
    first, again = (
        drawn(robot, state, np.random.default_rng(3), about, 0.5, 0.4, 40) for _ in range(2)
    )
    assert np.array_equal(first, again)
    assert first.shape == (40, 10, 3)
    assert np.array_equal(first[0], about)
    assert not first[1].any()
    assert np.hypot(first[..., 0], first[..., 1]).max() <= 0.5 + 1e-12
    changes = np.abs(np.diff(first[20:], axis=1)).max(axis=2) > 0.0
    assert changes.sum(axis=1).max() == 1  # one twist and then another
    if robot.pose(tuple(state)).heading is not None:
        assert not first[..., 1].any()
