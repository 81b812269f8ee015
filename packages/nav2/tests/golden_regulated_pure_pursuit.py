"""Regulated pure pursuit equals Nav2's."""

import numpy as np

from wideberth.packages.nav2.tests.golden import (
    Case,
    Checks,
    assert_equal_answer,
    costmap_of,
    footprint_of,
)
from wideberth_nav2.controllers.local_controller import Tick
from wideberth_nav2.controllers.local_controllers import built
from wideberth_nav2.controllers.regulated_pure_pursuit import RegulatedPurePursuit
from wideberth_nav2.goal_checker import GoalChecker
from wideberth_nav2.poses import in_base_frame, look_ahead


def controller_of(case: Case) -> RegulatedPurePursuit:
    """The one adapter from the parameters of a case."""
    made = built("regulated_pure_pursuit", case["params"])
    assert isinstance(made, RegulatedPurePursuit)
    return made


def ticks_of(case: Case) -> list[Tick]:
    costmap, footprint, checker = (
        costmap_of(case["costmap"]),
        footprint_of(case["robot"]),
        GoalChecker(),
    )
    plan, goal = np.array(case["path"]), np.array(case["global_goal"])
    return [
        Tick(
            0.05 * i, np.array(tick["pose"]),
            np.array([tick.get("speed_v", 0.0), 0.0, tick.get("speed_w", 0.0)]), plan, goal,
            costmap, footprint, case["robot"]["track_unknown"], checker,
        )
        for i, tick in enumerate(case["ticks"])
    ]  # fmt: skip


def commands_are_equal(rpp: Case) -> None:
    controller = controller_of(rpp)
    controller.new_path(np.array(rpp["path"]))
    for stored, tick in zip(rpp["ticks"], ticks_of(rpp), strict=True):
        expect = stored["expect"]
        assert_equal_answer(controller.velocity(tick), expect, 1e-7)
        plan = in_base_frame(tick.plan, tick.pose)
        carrot, _ = look_ahead(plan, controller.look_ahead_distance(tick.speed[0]))
        if "carrot" in expect:
            assert np.abs(carrot[:2] - expect["carrot"]).max() < 1e-9
        ahead = controller.curvature_carrot(plan, carrot)
        if "curvature_carrot" in expect:
            assert np.abs(ahead[:2] - expect["curvature_carrot"]).max() < 1e-9
        if "rotating" in expect:
            sign = -1.0 if controller.allow_reversing and carrot[0] < 0.0 else 1.0
            turning = controller.turn(tick, plan, ahead, sign) is not None
            assert turning == expect["rotating"]


CHECKS: dict[str, Checks] = {
    "rpp": (commands_are_equal,),
}
