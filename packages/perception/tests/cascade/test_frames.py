"""Motions between the frame in which a robot believes and the world's."""

from math import cos, pi, sin

import numpy as np
import pytest

from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import GivenWay, Plan, Rung, Situation, Status
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.log.frames import RigidMotion

RNG = np.random.default_rng(0)
POSES = [RNG.uniform((-9.0, -9.0, -pi), (9.0, 9.0, pi)) for _ in range(5)]


def as_complex(pose: np.ndarray, place: np.ndarray) -> complex:
    """Return where a place in the frame of a pose lies: the closed form, in the complex plane."""
    x, y, heading = pose
    return complex(x, y) + (cos(heading) + 1j * sin(heading)) * complex(*place)


@pytest.mark.parametrize("believed", POSES[:2], ids=["first", "second"])
@pytest.mark.parametrize("true", POSES[2:], ids=["third", "fourth", "fifth"])
def test_what_is_seen_from_a_pose_moves_with_it(believed: np.ndarray, true: np.ndarray) -> None:
    motion = RigidMotion.between(believed, true)
    for seen in RNG.uniform(-15.0, 15.0, (10, 2)):
        there, wanted = as_complex(believed, seen), as_complex(true, seen)
        moved = motion.points(np.array([there.real, there.imag]))
        assert complex(*moved) == pytest.approx(wanted, abs=1e-12)


def test_there_and_back_is_nowhere() -> None:
    one, two = POSES[:2]
    there, back = RigidMotion.between(one, two), RigidMotion.between(two, one)
    places = RNG.uniform(-20.0, 20.0, (7, 3, 2))
    assert np.allclose(back.points(there.points(places)), places, rtol=0.0, atol=1e-12)
    spread = RNG.standard_normal((7, 2, 2))
    spread = spread @ spread.transpose(0, 2, 1)
    assert np.allclose(back.covariances(there.covariances(spread)), spread, rtol=1e-12)


def test_a_covariance_turns_with_its_points() -> None:
    motion = RigidMotion.between(*POSES[:2])
    points = RNG.standard_normal((500, 2)) @ np.diag([3.0, 0.5])
    turned = motion.covariances(np.cov(points.T))
    assert np.allclose(turned, np.cov(motion.points(points).T), rtol=1e-9)


def forecast() -> Forecast:
    mean = RNG.uniform(-5.0, 5.0, (2, 1, 4, 2))
    return Forecast(
        mean, np.tile(np.diag([0.4, 0.1]), (2, 1, 4, 1, 1)), np.ones((2, 1)), 0.5, (None, None)
    )


def test_a_forecast_keeps_its_distances_to_points() -> None:
    before, motion = forecast(), RigidMotion.between(*POSES[:2])
    after = motion.forecast(before)
    places = RNG.uniform(-5.0, 5.0, (4, 2))

    def squares(one: Forecast, where: np.ndarray) -> np.ndarray:
        away = where - one.mean
        return np.einsum(
            "...i,...i", away, np.linalg.solve(one.covariance, away[..., None])[..., 0]
        )

    assert np.allclose(squares(before, places), squares(after, motion.points(places)))
    assert np.array_equal(after.weight, before.weight) and after.joint_source is None


def test_a_plan_drives_on_from_the_true_pose() -> None:
    believed, true = POSES[:2]
    robot, motion = Unicycle(), RigidMotion.between(believed, true)
    states = np.column_stack([RNG.uniform(-3.0, 3.0, (5, 3)), np.full(5, 0.4), np.full(5, 0.1)])
    states[0, :3] = believed
    way = Path(RNG.uniform(-5.0, 5.0, (3, 2)))
    before = Plan(
        *(3.0, 0.5, states, np.zeros((4, 2)), states[:, :2], states[1:, :2]),
        *(np.zeros((4, 2, 0)), *np.ones((3, 4, 2)), ("7", "8"), Status.SOLVED, Rung.OPTIMAL),
        forecast=forecast(),
        tracked=("7", "8"),
        left_out=("8",),
        given_way=GivenWay(0.05, 0.2, "content", 2, "7"),
        situation=Situation(None, 1.0, np.ones(2), 0.75, believed[2], None, way),
    )
    after = motion.plan(before, robot, {"7": "right"})
    assert np.allclose(after.states[0, :3], true) and np.allclose(after.positions[0], true[:2])
    assert np.array_equal(after.states[:, 3:], states[:, 3:])
    steps = np.linalg.norm(np.diff(after.positions, axis=0), axis=1)
    assert np.allclose(steps, np.linalg.norm(np.diff(before.positions, axis=0), axis=1))
    assert after.tracked == after.ids == ("right", "8") and after.left_out == ("8",)
    assert after.given_way is not None and after.given_way.name == "right"
    assert after.situation is not None and after.situation.path is not None
    assert after.situation.heading == pytest.approx(true[2])
    assert np.allclose(after.situation.path.points, motion.points(way.points))
    assert after.forecast is not None
    assert np.allclose(after.forecast.mean, motion.points(forecast_means(before)))


def forecast_means(plan: Plan) -> np.ndarray:
    assert plan.forecast is not None
    return plan.forecast.mean
