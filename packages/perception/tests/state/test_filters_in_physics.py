"""The filters on robots in MuJoCo: NEES in its band, drift below a percent."""

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.plugins.config import build
from wideberth.framework.values.motion import Twist
from wideberth.simulation.sensing.perceived import InertialSample

FILTERS = ("ekf", "ukf")


def errors(run, seconds, noise):
    """Drive with a new speed and yaw rate every 4 s; return per filter NEES and drift per way.

    NEES of the pose and of forward speed and yaw rate, both means over time.
    """
    from wideberth_perception.physics.body import LARGE, SkidSteerBody
    from wideberth_perception.physics.scene import PhysicalRobot, PhysicalScene
    from wideberth_perception.physics.sensors import InertialUnit, WheelEncoders
    from wideberth_perception.physics.world import PhysicsWorld

    rng = np.random.default_rng([21, run])
    body = LARGE if noise == "large" else SkidSteerBody()
    sensors = WheelEncoders(phase=float(rng.uniform(0.0, 0.01))), InertialUnit()
    world = PhysicsWorld(
        PhysicalScene(robots=(PhysicalRobot("robot", body, sensors=sensors),)), rng
    )
    settings = {"wheel_radius": body.wheel_radius, "noise": noise}
    estimators = [build("state_estimators", {"type": name, **settings}) for name in FILTERS]
    for one in estimators:
        one.reset(np.zeros(3), 0.0)
    wanted, given, way, rest = np.zeros(2), np.zeros(2), 0.0, []
    found = [[] for _ in FILTERS]
    for step in range(round(50 * (2.0 + seconds))):
        if step >= 100 and step % 200 == 100:
            wanted = np.array([rng.uniform(0.2, 0.6), rng.uniform(-0.3, 0.3)])
        given = given + np.clip(wanted - given, (-0.014, -0.006), (0.014, 0.006))
        bias = float(np.mean(rest)) if rest else 0.0
        world.command("robot", Twist((given[0], 0.0), given[1]), gyro_bias=bias)
        world.advance(0.02)
        for sample in world.samples_due()["robot"]:
            for one in estimators:
                one.take(sample)
            if step < 100 and isinstance(sample, InertialSample):
                rest.append(sample.yaw_rate)
        truth = world.truth("robot")
        way += 0.02 * abs(truth.twist[0])
        if step > 100 and step % 25 == 0:
            for place, one in enumerate(estimators):
                found[place].append(nees(one.at(truth.time), truth))
    apart = [np.hypot(*(one.at(truth.time).pose - truth.pose)[:2]) for one in estimators]
    means = np.mean(found, axis=1)
    return np.column_stack([means, np.array(apart) / way])


def nees(estimate, truth):
    """Return squared Mahalanobis distances: of the pose, and of forward speed and yaw rate."""
    off = estimate.mean - np.concatenate([truth.pose, truth.twist])
    off[2] = np.angle(np.exp(1j * off[2]))
    parts = ([0, 1, 2], [3, 5])
    covariances = (estimate.covariance[np.ix_(part, part)] for part in parts)
    return [
        off[part] @ np.linalg.solve(covariance, off[part])
        for part, covariance in zip(parts, covariances, strict=True)
    ]


@pytest.mark.parametrize(
    ("noise", "runs", "seconds"),
    [
        ("small", 8, 20.0),
        pytest.param("small", 50, 40.0, marks=pytest.mark.slow),
        pytest.param("large", 50, 40.0, marks=pytest.mark.slow),
    ],
)
def test_nees_and_drift(noise, runs, seconds):
    pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    every = np.array([errors(run, seconds, noise) for run in range(runs)])
    for name, (pose, twist, drift) in zip(FILTERS, every.mean(axis=0), strict=True):
        for value, size in ((pose, 3), (twist, 2)):
            low, high = chi2.ppf([0.025, 0.975], size * runs) / runs
            assert low < value < high, (name, size, value)
        assert drift < 0.01, (name, drift)
    assert np.abs(every[:, 0] - every[:, 1]).max() < 0.1  # the model is almost linear
