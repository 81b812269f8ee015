"""The pruned plan and the goal checker equal Nav2's."""

import numpy as np

from wideberth.packages.nav2.tests.golden import Case, Checks, costmap_of
from wideberth_nav2.goal_checker import GoalChecker
from wideberth_nav2.path_handler import PathHandler

CHECKER = {
    "xy_goal_tolerance", "yaw_goal_tolerance", "path_length_tolerance", "stateful",
    "xy_goal_tolerance_buffer", "symmetric_yaw_tolerance",
}  # fmt: skip


def parts_of(case: Case) -> tuple[PathHandler, GoalChecker]:
    """The one adapter from the parameters of a case."""
    params = {name.split(".")[-1]: value for name, value in case["params"].items()}
    checker = {name: value for name, value in params.items() if name in CHECKER}
    handler = {name: value for name, value in params.items() if name not in CHECKER}
    return PathHandler(**handler), GoalChecker(**checker)


def plans_and_flags_are_equal(path_handler: Case) -> None:
    handler, checker = parts_of(path_handler)
    costmap = costmap_of(path_handler["costmap_geometry"])
    handler.set_plan(np.array(path_handler["path"]))
    goal = np.array(path_handler["goal"])
    for tick in path_handler["ticks"]:
        pose, expect = np.array(tick["pose"]), tick["expect"]
        plan, reason = handler.local_plan(costmap, pose)
        if "exception" in expect:
            assert plan is None and reason
            continue
        assert plan is not None
        wanted = np.array(expect["local_plan"])
        assert plan.shape == wanted.shape
        assert np.abs(plan - wanted).max() < 1e-9
        assert len(handler._left) == expect["plan_left"]
        assert checker.xy_reached(pose, goal, plan) == expect["goal_xy_reached"]
        assert checker.reached(pose, goal, plan) == expect["goal_reached"]


CHECKS: dict[str, Checks] = {
    "path_handler": (plans_and_flags_are_equal,),
}
