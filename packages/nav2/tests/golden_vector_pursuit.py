"""Vector pursuit equals the original."""

import numpy as np

from wideberth.packages.nav2.tests.golden import (
    Case,
    Checks,
    assert_equal_answer,
    costmap_of,
    footprint_of,
)
from wideberth_nav2.controllers.local_controller import NO_VALID_CONTROL, Tick
from wideberth_nav2.controllers.local_controllers import built
from wideberth_nav2.controllers.vector_pursuit import VectorPursuit
from wideberth_nav2.goal_checker import GoalChecker


def controller_of(case: Case) -> VectorPursuit:
    """The one adapter from the parameters of a case."""
    made = built("vector_pursuit", case["params"])
    assert isinstance(made, VectorPursuit)
    return made


def radii_are_equal(vpc_radius: Case) -> None:
    found = controller_of(vpc_radius).turning_radius(np.array(vpc_radius["target_base"]))
    wanted = vpc_radius["expect"]["turning_radius"]
    assert abs(found - wanted) <= 1e-9 * wanted


def commands_are_equal(vpc_controller: Case) -> None:
    controller, path = controller_of(vpc_controller), np.array(vpc_controller["path"])
    costmap, robot = costmap_of(vpc_controller["costmap"]), vpc_controller["robot"]
    footprint, probe = footprint_of(robot), controller_of(vpc_controller)
    controller.new_path(path)
    for i, stored in enumerate(vpc_controller["ticks"]):
        expect, pose = dict(stored["expect"]), np.array(stored["pose"])
        if expect.get("exception") == "PlannerException":  # see the class
            expect["exception"] = NO_VALID_CONTROL
        tick = Tick(
            0.05 * i, pose, np.zeros(3), path, path[-1], costmap, footprint,
            robot["track_unknown"], GoalChecker(),
        )  # fmt: skip
        probe = controller_of(vpc_controller)
        probe.new_path(controller._left)
        probe._last = controller._last
        assert_equal_answer(controller.velocity(tick), expect, 1e-9)
        if "target_base" in expect:
            target = probe.target(probe.pruned(costmap, pose))
            assert np.abs(target - expect["target_base"]).max() < 1e-9
        if "plan_left" in expect:
            assert len(controller._left) == expect["plan_left"]


CHECKS: dict[str, Checks] = {
    "vpc_radius": (radii_are_equal,),
    "vpc_controller": (commands_are_equal,),
}
