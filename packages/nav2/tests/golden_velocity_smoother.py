"""The velocity smoother equals Nav2's."""

import numpy as np

from wideberth.packages.nav2.tests.golden import Case, Checks
from wideberth_nav2.server.velocity_smoother import Nav2VelocitySmoother


def smoother_of(case: Case) -> Nav2VelocitySmoother:
    """The one adapter from the parameters of a case; its odometry is averaged already."""
    return Nav2VelocitySmoother(**case["params"], odom_duration=0.0)


def outputs_are_equal(velocity_smoother: Case) -> None:
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


CHECKS: dict[str, Checks] = {
    "velocity_smoother": (outputs_are_equal,),
}
