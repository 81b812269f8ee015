"""The extended filter on a robot in MuJoCo: NEES in its band, drift below a percent."""

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.framework.plugins.config import build
from wideberth.framework.values.motion import Twist
from wideberth.framework.values.sensing import InertialSample


def errors(run, seconds):
    """Drive with a new speed and yaw rate every 4 s; return NEES over time and drift per way."""
    from wideberth.simulation.physics.scene import PhysicalRobot, PhysicalScene
    from wideberth.simulation.physics.sensors import InertialUnit, WheelEncoders
    from wideberth.simulation.physics.world import World

    rng = np.random.default_rng([21, run])
    sensors = WheelEncoders(phase=float(rng.uniform(0.0, 0.01))), InertialUnit()
    world = World(PhysicalScene(robots=(PhysicalRobot("robot", sensors=sensors),)), rng)
    estimator = build("state_estimators", "ekf")
    estimator.reset(np.zeros(3), 0.0)
    wanted, given, way, found, rest = np.zeros(2), np.zeros(2), 0.0, [], []
    for step in range(round(50 * (2.0 + seconds))):
        if step >= 100 and step % 200 == 100:
            wanted = np.array([rng.uniform(0.2, 0.6), rng.uniform(-0.3, 0.3)])
        given = given + np.clip(wanted - given, (-0.014, -0.006), (0.014, 0.006))
        bias = float(np.mean(rest)) if rest else 0.0
        world.command("robot", Twist((given[0], 0.0), given[1]), gyro_bias=bias)
        world.advance(0.02)
        for sample in world.samples_due()["robot"]:
            assert not estimator.take(sample)
            if step < 100 and isinstance(sample, InertialSample):
                rest.append(sample.yaw_rate)
        truth = world.truth("robot")
        way += 0.02 * abs(truth.twist[0])
        if step > 100 and step % 25 == 0:
            estimate = estimator.at(truth.time)
            off = estimate.pose - truth.pose
            off[2] = np.angle(np.exp(1j * off[2]))
            found.append(off @ np.linalg.solve(estimate.covariance[:3, :3], off))
    return np.mean(found), np.hypot(*off[:2]) / way


@pytest.mark.parametrize(
    ("runs", "seconds"), [(8, 20.0), pytest.param(50, 40.0, marks=pytest.mark.slow)]
)
def test_nees_and_drift(runs, seconds):
    pytest.importorskip("mujoco", reason="pip install 'wideberth[physics]'")
    nees, drift = np.array([errors(run, seconds) for run in range(runs)]).T
    low, high = chi2.ppf([0.025, 0.975], 3 * runs) / runs
    assert low < nees.mean() < high, nees.mean()
    assert drift.mean() < 0.01, drift
