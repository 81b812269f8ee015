"""The social-force roll-out: straight motion alone, symmetric yielding, the robot's plan."""

import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest

from wideberth.framework.plugins.config import build
from wideberth.framework.predictor import Predictor
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.core.social_rollout import (
    Force,
    RobotCourse,
    SocialWalkers,
    course_of,
    roll_out,
)
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.social_force import GRID, WEIGHTS, SocialForce

DT = 0.4
QUIET = SocialForce(speed_spread=0.0, direction_spread=0.0)


def walking(places, velocities, samples=12, dt=DT, radius=0.3):
    """Tracks of people who walk straight and are at these places now."""
    time = dt * np.arange(1 - samples, 1)[:, None]
    positions = np.array(places, float)[:, None] + time * np.array(velocities, float)[:, None]
    count = len(positions)
    ids = tuple(f"o{i}" for i in range(count))
    return Tracks(
        positions, dt, ids, np.full(count, radius), np.tile(1e-4 * np.eye(2), (count, 1, 1))
    )


def closest(first, second):
    return np.linalg.norm(first - second, axis=-1).min()


@pytest.mark.parametrize(
    "predictor",
    [
        SocialForce(force=Force(strength=4.0, anticipation=0.0)),
        SocialForce(Force(reach=1.0, anticipation=4.0), 1.0, 0.3, 0.0, Kalman(0.1)),
    ],
    ids=repr,
)
def test_settings_keep_the_laws(predictor):
    check_predictor(predictor, dimensions=(2,), rng=np.random.default_rng(8))


def test_the_quadrature_has_the_moments_of_a_standard_gaussian():
    assert WEIGHTS.sum() == pytest.approx(1.0)
    for powers, wanted in {
        (1, 0): 0,
        (2, 0): 1,
        (0, 2): 1,
        (1, 1): 0,
        (2, 2): 1,
        (4, 0): 3,
    }.items():
        moment = WEIGHTS @ np.prod(GRID ** np.array(powers), axis=1)
        assert moment == pytest.approx(wanted, abs=1e-12)
    assert not GRID[0].any()


def test_alone_it_goes_straight_on_as_the_filter_does():
    tracks = walking([(3.0, 1.0)], [(1.1, -0.4)])
    forecast = SocialForce().predict(tracks, 12)
    straight = Kalman().predict(tracks, 12)
    np.testing.assert_allclose(forecast.mean, straight.mean, atol=1e-12)
    assert forecast.fallback == (None,)


def test_alone_its_spread_is_that_of_a_velocity_that_relaxes_to_the_wanted_one():
    predictor = SocialForce(speed_spread=0.2, direction_spread=0.3)
    tracks = walking([(0.0, 0.0)], [(1.2, 0.0)])
    forecast, known = predictor.predict(tracks, 10), Kalman().predict(tracks, 10)
    start = known.mean[0, 0, 1] - known.mean[0, 0, 0]
    speed = np.linalg.norm(start) / DT
    time = DT * np.arange(1, 11)
    way = time - 0.5 * (1.0 - np.exp(-time / 0.5))  # per m/s of difference, tau = 0.5 s
    for axis, share in enumerate((0.2, 0.3)):
        added = forecast.covariance[0, 0, :, axis, axis] - known.covariance[0, 0, :, axis, axis]
        np.testing.assert_allclose(added, (share * speed * way) ** 2, rtol=1e-6)
    joint = forecast.joint[0, 0].reshape(10, 2, 10, 2)
    each = np.arange(10)
    np.testing.assert_allclose(joint[each, :, each], forecast.covariance[0, 0], atol=1e-12)
    along = joint[:, 0, :, 0] - known.joint[0, 0].reshape(10, 2, 10, 2)[:, 0, :, 0]
    np.testing.assert_allclose(along, (0.2 * speed) ** 2 * np.outer(way, way), rtol=1e-6)


def test_two_who_meet_give_way_to_each_other_alike():
    places, velocities = np.array([(-4.0, 0.1), (4.0, -0.1)]), np.array([(1.2, 0.0), (-1.2, 0.0)])
    mean = SocialForce().predict(walking(places, velocities), 12).mean[:, 0]
    np.testing.assert_allclose(mean[0], -mean[1], atol=1e-9)
    assert mean[0, :, 1].max() > 0.2  # aside, away from the other
    straight = places[:, None] + DT * np.arange(1, 13)[:, None] * velocities[:, None]
    assert closest(*mean) > closest(*straight) + 0.1


def test_exactly_head_on_both_slow_down_and_neither_side_is_preferred():
    mean = SocialForce().predict(walking([(-3.0, 0.0), (3.0, 0.0)], [(1, 0), (-1, 0)]), 8).mean
    np.testing.assert_allclose(mean[0], -mean[1], atol=1e-9)
    assert np.abs(mean[..., 1]).max() < 1e-9
    assert mean[0, 0, -1, 0] < -3.0 + 8 * DT - 0.1


@pytest.mark.parametrize(
    ("places", "velocities"),
    [
        ([(0.0, 0.0), (0.0, 0.7)], [(1.2, 0.0), (1.2, 0.0)]),  # side by side
        ([(0.0, 0.0), (-1.0, 0.0)], [(1.2, 0.0), (1.2, 0.0)]),  # one after the other
        ([(0.0, 0.0), (-1.0, 0.3)], [(1.0, 0.0), (-1.0, 0.0)]),  # gone by already
        ([(0.0, 0.0), (0.0, 30.0)], [(1.0, 0.0), (-1.0, 0.0)]),  # far away
    ],
)
def test_who_does_not_come_nearer_is_not_pushed(places, velocities):
    tracks = walking(places, velocities)
    mean = QUIET.predict(tracks, 12).mean
    np.testing.assert_allclose(mean, Kalman().predict(tracks, 12).mean, atol=1e-9)


def test_a_person_yields_to_the_plan_of_the_robot():
    tracks = walking([(0.0, -3.0)], [(0.0, 1.0)])
    times = DT * np.arange(1, 13)
    plan = np.stack([-2.6 + times, 0.0 * times], axis=1)  # 0.4 m ahead at the crossing
    alone = SocialForce().predict(tracks, 12, Scene()).mean[0, 0]
    beside = SocialForce().predict(tracks, 12, Scene(plan=plan, radius=0.3)).mean[0, 0]
    assert closest(beside, plan) > closest(alone, plan) + 0.05
    assert beside[-1, 1] < alone[-1, 1] - 0.1  # it lets the robot pass
    larger = SocialForce().predict(tracks, 12, Scene(plan=plan, radius=0.8)).mean[0, 0]
    assert closest(larger, plan) > closest(beside, plan) + 0.05


def test_a_plan_with_times_is_laid_on_the_clock_of_the_tracks():
    tracks = replace(walking([(0.0, -3.0)], [(0.0, 1.0)]), stamp=50.0)
    times = DT * np.arange(1, 13)
    plan = np.stack([-3.2 + times, 0.0 * times], axis=1)
    wanted = SocialForce().predict(tracks, 12, Scene(plan=plan, radius=0.3))
    clock = 49.7 + 0.5 * np.arange(4)  # began 0.3 s ago; beyond its end it goes straight on
    coarse = np.stack([-3.2 + clock - 50.0, 0.0 * clock], axis=1)
    scene = Scene(plan=coarse, plan_times=clock, radius=0.3)
    found = SocialForce().predict(tracks, 12, scene)
    np.testing.assert_allclose(found.mean, wanted.mean, atol=1e-9)
    course = course_of(scene, DT, tracks.stamp)
    asked = np.array([-1.0, 0.1, 9.0])
    places, velocities = course.at(asked)
    np.testing.assert_allclose(places, np.stack([-3.2 + asked, 0 * asked], axis=1), atol=1e-9)
    np.testing.assert_allclose(velocities, [(1.0, 0.0)] * 3, atol=1e-9)
    assert course_of(Scene(plan=plan[:1]), DT, 0.0) is None


def test_goals_turn_the_way_and_are_not_overrun():
    tracks = walking([(0.0, 0.0), (20.0, 0.0)], [(1.0, 0.0), (0.0, 1.0)])
    goals = np.array([(2.0, 2.0), (20.0, 400.0)])
    mean = QUIET.predict(tracks, 20, Scene(goals=goals)).mean[:, 0]
    assert np.linalg.norm(mean[0, -1] - goals[0]) < 0.05
    straight = Kalman().predict(tracks, 20).mean[1, 0]
    np.testing.assert_allclose(mean[1], straight, atol=0.05)


def test_a_planner_tells_its_predictor_of_itself_and_its_last_plan():
    scenes = []

    @dataclass(frozen=True)
    class Spy(Predictor):
        def predict(self, tracks, steps, scene=None):
            scenes.append(scene)
            return Kalman().predict(tracks, steps)

    config = {
        "type": "mpc",
        "robot": "unicycle",
        "region": "mahalanobis_ellipse",
        "solver": "fatrop",
    }
    level = {"type": "relaxed", "tail": 0.05, "weight": 1000.0, "minimum": 1.0}
    planner = build("controllers", {**config, "level": level, "predictor": "kalman"})
    planner = replace(planner, predictor=Spy())
    planner.set_path(Path(np.array([[0.0, 0.0], [20.0, 0.0]])))
    scenes.clear()
    other = Detection("b", np.array([4.0, 3.0]), 1e-4 * np.eye(2), 0.75)
    states = [np.array([0.25 * tick, 0.0, 0.0, 0.5, 0.0]) for tick in range(2)]
    planner.command(Observation(7.0, states[0], (other,)))
    first = planner.plan
    planner.command(Observation(7.5, states[1], (other,)))
    assert scenes[0].plan is None and scenes[0].plan_times is None
    np.testing.assert_array_equal(scenes[1].ego, states[1])
    np.testing.assert_array_equal(scenes[1].plan, first.positions)
    np.testing.assert_allclose(scenes[1].plan_times, 7.0 + 0.5 * np.arange(16))
    assert scenes[1].radius == planner.robot.radius


def by_hand(place, velocity, radius, force, relaxation, steps):
    """Roll two or more walkers out one by one, straight from the formulas."""
    place, velocity, wanted = place.copy(), velocity.copy(), velocity.copy()
    h, rows = 0.1, []
    for tick in range(4 * steps):
        change = np.zeros_like(place)
        for i in range(len(place)):
            for j in range(len(place)):
                if i == j:
                    continue
                d, w, touch = place[i] - place[j], velocity[i] - velocity[j], radius[i] + radius[j]
                approach = max(-d @ w, 0.0) / np.linalg.norm(d)
                until = (-d @ w - touch * np.linalg.norm(w)) / (w @ w)
                d = d + np.clip(until, 0.0, force.anticipation) * w
                far = np.linalg.norm(d)
                cosine = -d @ velocity[i] / (far * np.linalg.norm(velocity[i]))
                push = force.strength * approach * (1 + cosine) / 2
                push *= np.exp(-max(far - touch, 0.0) / force.reach)
                change[i] += push * d / max(far, touch, force.reach)
        target, kept = wanted + relaxation * change, np.exp(-h / relaxation)
        place = place + h * target + relaxation * (1 - kept) * (velocity - target)
        velocity = target + kept * (velocity - target)
        if tick % 4 == 3:
            rows.append(place)
    return np.stack(rows, axis=1)


def test_the_batched_roll_out_is_that_of_the_formulas_one_by_one():
    rng = np.random.default_rng(3)
    place, velocity = rng.uniform(-3, 3, (6, 2)), rng.normal(0, 1, (6, 2))
    radius, force = rng.uniform(0.1, 0.5, 6), Force()
    walkers = SocialWalkers(place, velocity, radius, np.ones(6, dtype=bool), None)
    found = roll_out(walkers, None, force, 0.5, np.zeros((1, 2)), DT, 8)[0]
    wanted = by_hand(place, velocity, radius, force, 0.5, 8)
    # What keeps divisions finite: 1 mm beside the distances.
    np.testing.assert_allclose(found, wanted, atol=5e-3)
    straight = place[:, None] + DT * np.arange(1, 9)[:, None] * velocity[:, None]
    assert np.abs(wanted - straight).max() > 0.3


def test_the_robot_is_a_walker_that_nobody_pushes():
    place, velocity = np.array([(0.0, 0.0), (3.0, 0.2)]), np.array([(1.0, 0.0), (-1.0, 0.0)])
    times = np.linspace(-1.0, 5.0, 7)
    robot = RobotCourse(times, place[1] + times[:, None] * velocity[1], 0.4)
    one = SocialWalkers(place[:1], velocity[:1], np.array([0.3]), np.ones(1, dtype=bool), None)
    two = SocialWalkers(place, velocity, np.array([0.3, 0.4]), np.ones(2, dtype=bool), None)
    # Within one step of the integration nobody has left the straight course yet.
    pushed = roll_out(one, robot, Force(), 0.5, np.zeros((1, 2)), 0.1, 1)
    both = roll_out(two, None, Force(), 0.5, np.zeros((1, 2)), 0.1, 1)
    np.testing.assert_allclose(pushed[0, 0], both[0, 0], atol=1e-12)
    assert both[0, 0, 0, 0] < 0.1 - 1e-3


def test_unknown_obstacles_push_nobody_and_three_coordinates_are_left_to_the_filter():
    tracks = walking([(0.0, -1.0), (0.0, 0.0)], [(0.0, 1.0), (0.0, 0.0)])
    positions = tracks.positions.copy()
    positions[1] = np.nan
    forecast = SocialForce().predict(replace(tracks, positions=positions), 6)
    np.testing.assert_allclose(
        forecast.mean[0], Kalman().predict(tracks.select([0]), 6).mean[0], atol=1e-9
    )
    assert forecast.fallback[0] is None and "never observed" in forecast.fallback[1]
    space = Tracks(np.zeros((1, 3, 3)), DT, ("a",), np.ones(1), np.eye(3)[None])
    assert SocialForce().predict(space, 2).fallback == ("social_force: 3 coordinates, made for 2",)


def test_one_step_and_pickling():
    tracks = walking([(0.0, 0.0), (2.0, 0.1)], [(1.0, 0.0), (-1.0, 0.0)])
    forecast = SocialForce().predict(tracks, 6)
    short = SocialForce().predict(tracks, 1)
    np.testing.assert_allclose(short.mean, forecast.mean[:, :, :1], atol=1e-12)
    np.testing.assert_allclose(short.joint[0, 0], forecast.joint[0, 0, :2, :2], atol=1e-12)
    again = pickle.loads(pickle.dumps(forecast))
    np.testing.assert_array_equal(again.joint, forecast.joint)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"relaxation": 0.0}, "social_force.relaxation"),
        ({"speed_spread": -1.0}, "social_force.speed_spread"),
        ({"direction_spread": np.nan}, "social_force.direction_spread"),
    ],
)
def test_numbers_out_of_range_are_refused(wrong, message):
    with pytest.raises(WideberthError, match=message):
        SocialForce(**wrong)


def test_forces_out_of_range_are_refused():
    for name, value in {"strength": -1.0, "reach": 0.0, "anticipation": -1.0}.items():
        with pytest.raises(WideberthError, match=f"force.{name}"):
            Force(**{name: value})
