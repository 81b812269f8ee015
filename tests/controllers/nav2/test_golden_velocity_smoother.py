"""The velocity smoother equals Nav2's."""

import numpy as np
import pytest

from wideberth.controllers.nav2.velocity_smoother import VelocitySmoother
from wideberth.framework.values.errors import WideberthError
from wideberth.tests.controllers.nav2.golden import Case, parametrize


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    parametrize(metafunc, "velocity_smoother")


def smoother_of(case: Case) -> VelocitySmoother:
    """The one adapter from the parameters of a case; its odometry is averaged already."""
    return VelocitySmoother(**case["params"], odom_duration=0.0)


def test_outputs_are_equal(velocity_smoother: Case) -> None:
    smoother = smoother_of(velocity_smoother)
    for step in velocity_smoother["steps"]:
        time = step["t_ns"] * 1e-9
        if step["command"] is not None:
            smoother.take(tuple(step["command"]), time)
        if step.get("odom") is not None:
            smoother.measure(tuple(step["odom"]), time)
        out = smoother.output(time)
        if step["expect"] is None:
            assert out is None, time
        else:
            assert out is not None
            assert np.abs(np.subtract(out, step["expect"])).max() < 1e-12, time


def test_closed_loop_starts_at_the_mean_of_what_was_measured() -> None:
    smoother = VelocitySmoother(feedback="CLOSED_LOOP")
    smoother.measure((0.5, 0.0, 0.0), 0.0)  # too old
    smoother.measure((0.1, 0.0, 0.0), 1.00)
    smoother.measure((0.3, 0.0, 0.0), 1.05)
    smoother.take((0.5, 0.0, 0.0), 1.05)
    assert smoother.output(1.05) == pytest.approx((0.2 + 2.5 / 20, 0.0, 0.0))


def test_a_limit_of_the_wrong_sign_is_refused() -> None:
    with pytest.raises(WideberthError, match="max_decel 2"):
        VelocitySmoother(max_decel=(2.0, 0.0, -1.0))
    with pytest.raises(WideberthError, match="three numbers"):
        VelocitySmoother(max_velocity=(2.0, 1.0))  # type: ignore[arg-type]
    with pytest.raises(WideberthError, match="OPEN_LOOP"):
        VelocitySmoother(feedback="HALF")
