"""The graceful controller equals Nav2's."""

from functools import cache

import numpy as np
import pytest

from wideberth.framework.plugins.njit import cached_njit
from wideberth.packages.nav2.tests.golden import (
    Case,
    Checks,
    assert_equal_answer,
    costmap_of,
    footprint_of,
)
from wideberth_nav2.controllers import smooth_control_law as law_module
from wideberth_nav2.controllers.graceful import Graceful
from wideberth_nav2.controllers.local_controller import Tick
from wideberth_nav2.controllers.local_controllers import built
from wideberth_nav2.goal_checker import GoalChecker
from wideberth_nav2.poses import in_base_frame

NAMES = ("egocentric", "regular_velocity", "next_pose")
INNER = [getattr(law_module, name) for name in ("wound", *NAMES)]
PLAIN = {name: getattr(law_module, name) for name in NAMES}


@cache
def compiled() -> dict:
    return dict(zip(PLAIN, cached_njit([*PLAIN.values()], INNER), strict=True))


def controller_of(case: Case) -> Graceful:
    """The one adapter from the parameters of a case."""
    made = built("graceful", case["params"])
    assert isinstance(made, Graceful)
    return made


def check_law(case: Case, law_functions: dict, tolerance: float) -> None:
    params = {("exponent" if n == "lambda" else n): float(v) for n, v in case["params"].items()}
    law, expect, backward = law_module.LawParameters(**params), case["expect"], case["backward"]
    target, pose = (tuple(map(float, case[name])) for name in ("target", "current"))
    wanted = [float(np.float32(expect[name])) for name in ("r_f32", "phi_f32", "delta_f32")]
    found = law_functions["egocentric"](target, pose, backward)
    assert np.abs(np.subtract(found, wanted)).max() <= tolerance
    found = law_functions["regular_velocity"](law, target, pose, backward)
    assert np.abs(np.subtract(found, (expect["v"], expect["w"]))).max() <= tolerance
    for wanted in expect.get("rollout", []):
        pose = law_functions["next_pose"](law, expect["rollout_dt"], target, pose, backward)
        assert np.abs(np.subtract(pose, wanted)).max() <= tolerance


def the_compiled_law_is_equal(gc_law: Case) -> None:
    check_law(gc_law, compiled(), 1e-9)


def the_plain_law_is_equal_but_for_single_precision(gc_law: Case) -> None:
    check_law(gc_law, PLAIN, 2e-6)


def commands_are_equal(gc_controller: Case) -> None:
    controller, probe = controller_of(gc_controller), controller_of(gc_controller)
    plan, goal = np.array(gc_controller["path"]), np.array(gc_controller["global_goal"])
    costmap, robot = costmap_of(gc_controller["costmap"]), gc_controller["robot"]
    footprint, checker = footprint_of(robot), GoalChecker()
    controller.new_path(plan)
    for i, stored in enumerate(gc_controller["ticks"]):
        expect, pose = stored["expect"], np.array(stored["pose"])
        tick = Tick(
            0.05 * i, pose, np.array([stored["speed_v"], 0.0, stored["speed_w"]]), plan, goal,
            costmap, footprint, robot["track_unknown"], checker,
        )  # fmt: skip
        if "motion_target_base" in expect:
            trajectory = probe.trajectory(*probe.seen(tick))
            assert trajectory is not None
            assert (
                np.abs(np.subtract(trajectory.target, expect["motion_target_base"])).max() < 1e-9
            )
        answer = controller.velocity(tick)
        assert_equal_answer(answer, expect, 1e-9)
        if "do_initial_rotation" in expect:  # a tick that throws has a state only where recorded
            assert controller._turns_first == expect["do_initial_rotation"]
        if expect.get("safe_approach_angle") is not None:
            assert controller._approach == pytest.approx(expect["safe_approach_angle"])
        if expect.get("local_plan_base"):
            assert answer.expected is not None
            assert len(answer.expected) == expect["local_plan_len"]
            found = in_base_frame(answer.expected, pose)
            assert np.abs(found - expect["local_plan_base"]).max() < 1e-9


CHECKS: dict[str, Checks] = {
    "gc_law": (
        the_compiled_law_is_equal,
        the_plain_law_is_equal_but_for_single_precision,
    ),
    "gc_controller": (commands_are_equal,),
}
