"""DWB equals evaluations recorded from Nav2: `--golden-nav2 FOLDER` names other cases."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.nav2.dwb import DWB, Evaluation
from wideberth.controllers.nav2.footprint import RobotFootprint
from wideberth.controllers.nav2.goal_checker import GoalChecker
from wideberth.controllers.nav2.local_controller import Tick
from wideberth.framework.values.costmap import Costmap

Case = dict[str, Any]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    path = Path(str(metafunc.config.getoption("--golden-nav2"))) / "dwb.json"
    if "dwb" not in metafunc.fixturenames:
        return
    if path.is_file():
        cases = json.loads(path.read_text(encoding="utf-8"))["cases"]
        metafunc.parametrize("dwb", cases, ids=[f"dwb{case['id']}" for case in cases])
    else:
        reason = f"{path} is missing; --golden-nav2 names a folder that has it"
        missing = pytest.param(None, marks=pytest.mark.skip(reason=reason))
        metafunc.parametrize("dwb", [missing])


def costmap_of(stored: dict[str, Any]) -> Costmap:
    values, counts = zip(*stored["data_rle"], strict=True)
    cells = np.repeat(values, counts).reshape(stored["height"], stored["width"])
    return Costmap(
        cells.astype(np.uint8), stored["resolution"], (stored["origin_x"], stored["origin_y"])
    )


def ticks_of(case: Case) -> list[Tick]:
    robot = case["robot"]
    if robot["use_radius"]:
        footprint = RobotFootprint.round_of(robot["robot_radius"])
    else:
        footprint = RobotFootprint.of(robot["footprint"])
    return [
        Tick(
            time=0.05 * i,
            pose=np.array(tick["pose"]),
            speed=np.array([tick["speed_v"], 0.0, tick["speed_w"]]),
            plan=np.array(case["path"]),
            goal=np.array(case["global_goal"]),
            costmap=costmap_of(case["costmap"]),
            footprint=footprint,
            track_unknown=robot["track_unknown"],
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
        assert found.names[found.asked[k] - 1] in stored["critics"]
        return
    assert found.totals[k] == pytest.approx(stored["total_f32"], rel=1e-6)
    assert found.names[: found.asked[k]] == tuple(stored["critics"])
    for c, (raw, weight) in enumerate(stored["critics"].values()):
        assert found.raw[c, k] == pytest.approx(raw, rel=1e-6, abs=1e-6), found.names[c]
        assert found.weights[c] == pytest.approx(weight, rel=1e-6), found.names[c]


def test_evaluations_are_equal(dwb: Case) -> None:
    controller = DWB.from_parameters(dwb["params"])
    for tick, stored in zip(ticks_of(dwb), dwb["ticks"], strict=True):
        answer, expect = controller.velocity(tick), stored["expect"]
        found = controller.evaluation
        assert found is not None and len(found.trajectories) == len(expect["trajectories"])
        for k, trajectory in enumerate(expect["trajectories"]):
            compared(found, k, trajectory)
        if "exception" in expect:
            assert answer.twist is None and answer.error == expect["exception"]
            continue
        assert found.best == expect["best_index"]
        assert answer.twist is not None
        assert abs(answer.twist.linear[0] - expect["v"]) < 1e-9
        assert abs(answer.twist.angular - expect["w"]) < 1e-9
