"""MPPI equals what was recorded from Nav2."""

from dataclasses import replace
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
from wideberth_nav2.controllers.local_controller import Tick
from wideberth_nav2.controllers.local_controllers import built
from wideberth_nav2.controllers.mppi import MPPI
from wideberth_nav2.controllers.mppi_rollouts import MppiTick
from wideberth_nav2.goal_checker import GoalChecker


def controller_of(case: Case) -> MPPI:
    """The one adapter from the parameters of a case."""
    inflation = {f"ObstaclesCritic.{name}": case["inflation"][name] for name in case["inflation"]}
    controller = built("mppi", {**inflation, **case["params"]})
    assert isinstance(controller, MPPI)
    noise = [case["noise_vx_f32"], case["noise_wz_f32"]]
    controller.memory.noise = np.array(noise, np.float32).transpose(0, 2, 1)
    return controller


def tick_of(case: Case, stored: Case, first: int = 0) -> Tick:
    return Tick(
        time=0.0,
        pose=np.array(stored["pose"]),
        speed=np.array([stored["speed_v"], 0.0, stored["speed_w"]]),
        plan=np.array(case["path"])[first:],
        goal=np.array(case["goal"]),
        costmap=costmap_of(case["costmap"]),
        footprint=footprint_of(case["robot"]),
        track_unknown=case["robot"]["track_unknown"],
        checker=GoalChecker(),
    )


def prepared(case: Case) -> MPPI:
    controller = controller_of(case)
    memory = controller.memory
    controls = [case["control_sequence_vx_f32"], case["control_sequence_wz_f32"]]
    memory.controls = np.array(controls, np.float32)
    memory.history = np.array([case["control_history_vx"], case["control_history_wz"]])
    memory.last = np.array([case["last_command_v"], case["last_command_w"]])
    if sent := case.get("delay_command_history"):
        memory.sent = (np.array(sent["vx"], np.float32), np.array(sent["wz"], np.float32))
    return controller


def near(found: np.ndarray, stored: list[Any], tolerance: float) -> None:
    wanted = np.array(stored, np.float64)
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() < tolerance


def equal_costs(found: np.ndarray, stored: list[Any]) -> None:
    np.testing.assert_allclose(found, np.array(stored, np.float64), rtol=1e-4, atol=1e-4)


def rollouts_are_equal(mppi_critics: Case) -> None:
    controller, expect = prepared(mppi_critics), mppi_critics["expect"]
    tick = tick_of(mppi_critics, mppi_critics)
    speed = controller.speed(tick)
    near(speed, expect["state_speed"], 1e-6)
    situation = MppiTick(tick, controller.limits, controller.model_dt)
    assert situation.length == pytest.approx(expect["local_path_length_f32"], rel=1e-6)
    controls, rollouts = controller.sampled(situation, speed)
    near(controls[0].T, expect["cvx_f32"], 1e-6)
    near(controls[1].T, expect["cwz_f32"], 1e-6)
    near(rollouts.vx.T, expect["vx_f32"], 1e-6)
    near(rollouts.wz.T, expect["wz_f32"], 1e-6)
    near(rollouts.yaw.T, expect["yaw_f32"], 1e-6)
    near(rollouts.x.T, expect["x_f32"], 1e-5)
    near(rollouts.y.T, expect["y_f32"], 1e-5)


def each_critic_is_equal(mppi_critics: Case) -> None:
    controller, expect = prepared(mppi_critics), mppi_critics["expect"]
    tick = tick_of(mppi_critics, mppi_critics)
    situation = MppiTick(tick, controller.limits, controller.model_dt)
    _, rollouts = controller.sampled(situation, controller.speed(tick))
    if "furthest_reached_path_point" in expect:  # otherwise no critic asked for it
        assert situation.furthest(rollouts) == expect["furthest_reached_path_point"]
    if "path_pts_valid" in expect:
        assert situation.valid.astype(int).tolist() == expect["path_pts_valid"]
    assert len(controller.critics) == len(expect["critics"])
    for critic in controller.critics:
        stored = expect["critics"][type(critic).__name__]
        situation.all_collide = False
        cost = critic.cost(rollouts, situation)
        equal_costs(np.zeros(len(stored["costs_f32"])) if cost is None else cost,
                    stored["costs_f32"])  # fmt: skip
        assert situation.all_collide == stored["fail_flag"], type(critic).__name__


def controls_are_equal(mppi_critics: Case) -> None:
    whole, expect = prepared(mppi_critics), mppi_critics["expect"]
    controller = replace(whole, critics=whole.critics[:8])
    controller.memory = whole.memory
    tick = tick_of(mppi_critics, mppi_critics)
    situation = MppiTick(tick, controller.limits, controller.model_dt)
    speed = controller.speed(tick)
    noisy, rollouts = controller.sampled(situation, speed)
    for critic in controller.critics:  # recorded without the stop where all collide
        cost = critic.cost(rollouts, situation)
        controller.costs += 0.0 if cost is None else cost
    equal_costs(controller.costs, expect["total_first_eight_f32"])
    controller.average(noisy, speed)
    equal_costs(controller.costs, expect["costs_after_gamma_f32"])
    near(controller.memory.controls[0], expect["new_control_sequence_vx_f32"], 2e-5)
    near(controller.memory.controls[1], expect["new_control_sequence_wz_f32"], 2e-5)
    ahead = controller.ahead(tick)
    near(ahead, expect["optimal_trajectory_f32"], 2e-5)
    assert controller.free(ahead, tick) == (expect["validator"] == "SUCCESS")
    near(controller.memory.controls[:, 1], expect["command"], 2e-5)


def ticks_are_equal(mppi_ticks: Case) -> None:
    controller = controller_of(mppi_ticks)
    for i, stored in enumerate(mppi_ticks["ticks"]):
        expect = stored["expect"]
        if "fallback" in stored or "fallback" in expect:
            return
        answer = controller.velocity(tick_of(mppi_ticks, stored, stored["path_start_index"]))
        tolerance = 1e-4 if i < 3 else 1e-3
        assert_equal_answer(answer, expect, tolerance)
        if answer.twist is None:
            return
        if i == 0:
            equal_costs(controller.costs, expect["costs_f32"])
        controls = controller.memory.controls
        near(controls[0], expect["control_sequence_after_shift_vx_f32"], tolerance)
        near(controls[1], expect["control_sequence_after_shift_wz_f32"], tolerance)


CHECKS: dict[str, Checks] = {
    "mppi_critics": (
        rollouts_are_equal,
        each_critic_is_equal,
        controls_are_equal,
    ),
    "mppi_ticks": (ticks_are_equal,),
}
