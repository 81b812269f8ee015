"""What the recorded cases of the velocity smoother do not show."""

import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth_nav2.server.velocity_smoother import Nav2VelocitySmoother


def test_closed_loop_starts_at_the_mean_of_what_was_measured() -> None:
    smoother = Nav2VelocitySmoother(feedback="CLOSED_LOOP")
    smoother.measure((0.5, 0.0, 0.0), 0.0)  # too old
    smoother.measure((0.1, 0.0, 0.0), 1.00)
    smoother.measure((0.3, 0.0, 0.0), 1.05)
    smoother.take((0.5, 0.0, 0.0), 1.05)
    assert smoother.output(1.05) == pytest.approx((0.2 + 2.5 / 20, 0.0, 0.0))


def test_a_limit_of_the_wrong_sign_is_refused() -> None:
    with pytest.raises(WideberthError, match="max_decel 2"):
        Nav2VelocitySmoother(max_decel=(2.0, 0.0, -1.0))
    with pytest.raises(WideberthError, match="wanted 3 numbers"):
        Nav2VelocitySmoother(max_velocity=(2.0, 1.0))  # type: ignore[arg-type]
    with pytest.raises(WideberthError, match="OPEN_LOOP"):
        Nav2VelocitySmoother(feedback="HALF")


@pytest.mark.parametrize("time", [1e300, -1e11, float("inf"), float("nan")])
def test_a_time_that_ros_cannot_hold_is_refused(time: float) -> None:
    with pytest.raises(WideberthError, match="nanoseconds in 64 bits"):
        Nav2VelocitySmoother().measure((0.0, 0.0, 0.0), time)
