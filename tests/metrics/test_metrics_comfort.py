"""How near and how annoying: closed forms, brute force, and symmetries."""

import numpy as np
import pytest

from wideberth.metrics import comfort as comfort
from wideberth.metrics.social_force import interaction_force


def test_the_nearest_of_those_who_are_there() -> None:
    apart = np.array([[1.0, np.nan, np.nan], [2.0, 0.5, np.nan]])
    assert comfort.nearest(apart).tolist() == [1.0, 0.5, np.inf]
    assert comfort.mean_distance(comfort.nearest(apart)) == 0.75
    assert comfort.nearest(np.zeros((0, 3))).tolist() == [np.inf] * 3
    assert np.isnan(comfort.mean_distance(np.full(3, np.inf)))


def test_zones_and_intrusion() -> None:
    closest = np.array([-0.1, 0.1, 0.45, 1.19, 1.2, 3.6, np.inf, np.inf])
    shares = comfort.proxemics(closest)
    assert shares == {"intimate": 0.25, "personal": 0.25, "social": 0.125, "public": 0.375}
    share, depth = comfort.intrusion(closest)
    assert share == 0.25 and depth == pytest.approx((0.3 + 0.1) / 2)
    share, depth = comfort.intrusion(np.array([0.2, 1.0]))
    assert share == 0.0 and np.isnan(depth)


def test_time_to_collision_against_a_march() -> None:
    """Move both on in small steps until they touch."""
    rng = np.random.default_rng(1)
    towards, approach = 4.0 * rng.standard_normal((300, 2)), rng.standard_normal((300, 2))
    radii = rng.uniform(0.3, 1.0, 300)
    found = comfort.time_to_collision(towards, approach, radii)
    times = np.linspace(0.0, 20.0, 20001)
    for p, w, size, time in zip(towards, approach, radii, found, strict=True):
        touch = np.linalg.norm(p - times[:, None] * w, axis=1) <= size
        expected = times[np.argmax(touch)] if touch.any() else np.inf
        if np.isfinite(time) and time < 20.0 and touch.any():
            assert time == pytest.approx(expected, abs=2e-3)
        else:  # a grazing touch may fall between two instants
            closest = np.linalg.norm(p - times[:, None] * w, axis=1).min()
            assert time >= 20.0 or closest < size + 1e-5


def test_time_to_collision_at_its_ends() -> None:
    towards = np.array([[5.0, 0.0], [0.5, 0.0], [5.0, 0.0], [5.0, 1.0], [np.nan, 0.0]])
    approach = np.array([[-1.0, 0.0], [-1.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 0.0]])
    found = comfort.time_to_collision(towards, approach, np.ones(5))
    assert found[:4].tolist() == [np.inf, 0.0, np.inf, 5.0] and np.isnan(found[4])
    far = comfort.time_to_collision(np.array([1e9, 0.0]), np.array([1.0, 0.0]), np.array(1.0))
    assert far == pytest.approx(1e9 - 1.0)


def test_who_runs_into_whom() -> None:
    still = np.zeros((4, 2))
    coming = np.stack([np.array([3.0, 2.0, 0.5, 3.0]), np.zeros(4)], axis=1)
    gaps = np.array([1.0, -0.5, -0.5])
    assert comfort.contacts(still, coming, gaps) == (0, 1)
    assert comfort.contacts(coming, still, gaps) == (1, 0)
    assert comfort.contacts(coming, -coming, gaps) == (1, 1)  # both alike
    # Who flees is not who runs into: the faster one behind is.
    fleeing = coming * 0.4 - np.array([3.0, 0.0])
    assert comfort.contacts(coming, fleeing, gaps) == (1, 0)
    twice = np.stack([np.array([3.0, 1.0, 3.0, 3.0, 1.0]), np.zeros(5)], axis=1)
    gaps_twice = np.array([0.005, 0.005, 1.0, 0.005])
    assert comfort.contacts(np.zeros((5, 2)), twice, gaps_twice) == (0, 2)
    assert comfort.contacts(still, coming, np.full(3, np.nan)) == (0, 0)
    assert comfort.contacts(still[:1], coming[:1], np.zeros(0)) == (0, 0)


def test_personal_space_is_deeper_ahead() -> None:
    walking = np.array([1.0, 0.0])
    ahead, behind, beside = (
        comfort.personal_space(np.array(place), walking)
        for place in ([2.0, 0.0], [-1.0, 0.0], [0.0, 4.0 / 3.0])
    )
    # One deviation each: 2 v ahead, half of it behind, two thirds aside.
    assert (ahead, behind, beside) == pytest.approx((np.exp(-0.5),) * 3)
    standing = comfort.personal_space(np.array([[0.5, 0.0], [0.0, -0.5]]), np.zeros((2, 2)))
    assert standing == pytest.approx(np.exp(-0.5))
    assert comfort.personal_space(np.zeros(2), walking) == 1.0


def force_by_hand(towards: np.ndarray, approach: np.ndarray) -> np.ndarray:
    """The force of the docstring for one pair, in complex numbers."""
    d, e = abs(complex(*towards)), complex(*towards) / abs(complex(*towards))
    big = 2.0 * complex(*approach) + e
    t, reach = big / abs(big), 0.35 * abs(big)
    theta = np.angle(e / t)
    slow = np.exp(-d / reach - (3.0 * reach * theta) ** 2)
    turn = np.exp(-d / reach - (2.0 * reach * theta) ** 2)
    force = -slow * t - np.sign(theta) * turn * t * 1j
    return np.array([force.real, force.imag])


def test_the_social_force_by_hand() -> None:
    rng = np.random.default_rng(2)
    towards, approach = 2.0 * rng.standard_normal((50, 2)), rng.standard_normal((50, 2))
    expected = np.array([force_by_hand(p, w) for p, w in zip(towards, approach, strict=True)])
    assert interaction_force(towards, approach) == pytest.approx(expected)
    # Turning the world turns the force.
    turn = np.array([[np.cos(2.0), -np.sin(2.0)], [np.sin(2.0), np.cos(2.0)]])
    turned = interaction_force(towards @ turn.T, approach @ turn.T)
    assert turned == pytest.approx(expected @ turn.T)


def test_the_social_force_of_a_head_on_pass_slows_alone() -> None:
    force = interaction_force(np.array([3.0, 0.0]), np.array([1.0, 0.0]))
    assert force == pytest.approx([-np.exp(-3.0 / (0.35 * 3.0)), 0.0])
    assert np.isfinite(interaction_force(np.zeros(2), np.zeros(2))).all()
    assert np.isfinite(interaction_force(np.array([1.0, 0.0]), np.array([-0.5, 0.0]))).all()


def test_social_work_of_one_pair() -> None:
    """Two who walk towards each other suffer alike, so that the work is twice one integral."""
    times = 0.1 * np.arange(21)
    robot = np.stack([-3.0 + times, np.zeros(21)], axis=1)
    person = -robot
    distance = 6.0 - 2.0 * times[:-1]
    expected = 2.0 * 5.1 * 0.1 * np.sum(np.exp(-distance / (0.35 * 5.0)))
    assert comfort.social_work(robot, person[None], 0.1) == pytest.approx(expected)
    absent = np.stack([person, np.full_like(person, np.nan)])
    assert comfort.social_work(robot, absent, 0.1) == pytest.approx(expected)
    assert comfort.social_work(robot, np.zeros((0, 21, 2)), 0.1) == 0.0
    # Of two on both sides the forces on the robot cancel, those on them add up.
    sides = robot + np.array([[[0.0, 1.0]], [[0.0, -1.0]]])
    alone = comfort.social_work(robot, sides[:1], 0.1)
    assert alone == pytest.approx(2.0 * 5.1 * 2.0 * np.exp(-1.0 / 0.35))
    assert comfort.social_work(robot, sides, 0.1) == pytest.approx(alone)


def test_one_instant_too_near_is_all_the_time() -> None:
    assert comfort.intrusion(np.array([0.15])) == pytest.approx((1.0, 0.05))
    assert comfort.proxemics(np.array([0.45]))["personal"] == 1.0
