"""State estimators: the contract, and configs."""

from functools import partial

import pytest

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.helpers.contracts import Contract
from wideberth_perception.state.noise import SETTINGS
from wideberth_perception.testing.state_estimator import check_state_estimator

SQUARE = [{"vertices": [[20, 20], [21, 20], [21, 21], [20, 21]]}]
ESTIMATORS = {
    "ekf": {"type": "ekf"},
    "ekf, robot_localization": {"type": "ekf", "noise": "robot_localization"},
    "scan_matching": {"type": "scan_matching", "walls": SQUARE},
    "ukf": {"type": "ukf"},
    "ukf, no rest": {"type": "ukf", "rest": 0.0},
}
CONTRACT = Contract(
    {name: partial(build, "state_estimators", config) for name, config in ESTIMATORS.items()},
    check_state_estimator.laws,
)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_contract(name, law):
    CONTRACT.check(name, law)


@pytest.mark.parametrize("name", sorted(ESTIMATORS))
def test_config_is_rebuilt(name):
    made = build("state_estimators", ESTIMATORS[name])
    config = describe(made)
    assert describe(build("state_estimators", config)) == config


def test_noise_comes_by_name_or_as_numbers():
    made = build("state_estimators", {"type": "ekf", "noise": {"position": 0.1}})
    assert made.noise.position == 0.1
    assert made.noise.heading == SETTINGS["small"].heading
    with pytest.raises(WideberthError, match=r"unknown noise 'smal': did you mean 'small'\?"):
        build("state_estimators", {"type": "ekf", "noise": "smal"})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"wheel_radius": 0.0}, r"ekf.wheel_radius is 0; wanted a finite number above 0"),
        ({"rest": -1.0}, r"ekf.rest is -1"),
        ({"noise": {"wheels": 0.0}}, r"motion_noise.wheels is 0"),
        ({"noise": {"gyro": 0.0, "jitter": 0.0}}, r"gyro and motion_noise.jitter are both 0"),
    ],
)
def test_bad_settings_name_themselves(settings, message):
    with pytest.raises(WideberthError, match=message):
        build("state_estimators", {"type": "ekf", **settings})
