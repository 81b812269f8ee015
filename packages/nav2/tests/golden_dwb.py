"""DWB equals evaluations recorded from Nav2."""

from typing import Any

import numpy as np
import pytest

from wideberth.packages.nav2.tests.golden import (
    Case,
    Checks,
    assert_equal_answer,
    costmap_of,
    footprint_of,
)
from wideberth_nav2.controllers.dwb import DWB, Evaluation
from wideberth_nav2.controllers.local_controller import Tick
from wideberth_nav2.controllers.local_controllers import built
from wideberth_nav2.goal_checker import GoalChecker


def ticks_of(case: Case) -> list[Tick]:
    return [
        Tick(
            time=0.05 * i,
            pose=np.array(tick["pose"]),
            speed=np.array([tick["speed_v"], 0.0, tick["speed_w"]]),
            plan=np.array(case["path"]),
            goal=np.array(case["global_goal"]),
            costmap=costmap_of(case["costmap"]),
            footprint=footprint_of(case["robot"]),
            track_unknown=case["robot"]["track_unknown"],
            checker=GoalChecker(),
        )
        for i, tick in enumerate(case["ticks"])
    ]


def apart(found: np.ndarray, stored: list[Any]) -> float:
    """Largest difference of poses; recorded yaws are within (-pi, pi]."""
    difference = found - np.array(stored)
    difference[..., 2] = np.arcsin(np.sin(difference[..., 2])) + (np.cos(difference[..., 2]) < 0.0)
    return float(np.abs(difference).max())


def compared(found: Evaluation, k: int, stored: Case) -> None:
    trajectories = found.trajectories
    count = stored["n_poses"]
    assert np.abs(trajectories.twists[k, [0, 2]] - stored["twist"]).max() < 1e-9
    assert trajectories.counts[k] == count
    assert apart(trajectories.poses[k, count - 1], stored["last_pose"]) < 1e-9
    if "poses" in stored:
        assert apart(trajectories.poses[k, :count], stored["poses"]) < 1e-9
    if stored["total_f32"] == -1:
        assert found.totals[k] == -1.0
        assert found.names[found.evaluated[k] - 1] in stored["critics"]
        return
    assert found.totals[k] == pytest.approx(stored["total_f32"], rel=1e-6)
    assert found.names[: found.evaluated[k]] == tuple(stored["critics"])
    for c, (raw, weight) in enumerate(stored["critics"].values()):
        assert found.raw[c, k] == pytest.approx(raw, rel=1e-6, abs=1e-6), found.names[c]
        assert found.weights[c] == pytest.approx(weight, rel=1e-6), found.names[c]


def evaluations_are_equal(dwb: Case) -> None:
    controller = built("dwb", dwb["params"])
    assert isinstance(controller, DWB)
    for tick, stored in zip(ticks_of(dwb), dwb["ticks"], strict=True):
        answer, expect = controller.velocity(tick), stored["expect"]
        found = controller.evaluation
        assert found is not None and len(found.trajectories) == len(expect["trajectories"])
        for k, trajectory in enumerate(expect["trajectories"]):
            compared(found, k, trajectory)
        assert_equal_answer(answer, expect, 1e-9)
        assert found.best == expect.get("best_index")


CHECKS: dict[str, Checks] = {
    "dwb": (evaluations_are_equal,),
}
