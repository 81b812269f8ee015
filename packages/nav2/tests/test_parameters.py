"""Parameters are checked where they come in: kind, range, and the work that they ask for."""

from dataclasses import fields
from math import inf, nan
from typing import Annotated, Any, get_args, get_origin

import numpy as np
import pytest
from annotated_types import Ge, Gt

from wideberth.framework.values.errors import WideberthError
from wideberth.packages.nav2.tests import (
    golden_graceful,
    golden_regulated_pure_pursuit,
    golden_vector_pursuit,
)
from wideberth.packages.nav2.tests.ticks import Scripted, straight, tick
from wideberth_nav2.controllers import dwb_critics
from wideberth_nav2.controllers.dwb import DWB
from wideberth_nav2.controllers.graceful import Graceful
from wideberth_nav2.controllers.mppi import CRITICS, MPPI
from wideberth_nav2.controllers.pursuit import collision_arc
from wideberth_nav2.controllers.regulated_pure_pursuit import RegulatedPurePursuit
from wideberth_nav2.controllers.rotation_shim import RotationShim
from wideberth_nav2.controllers.teb import TEB
from wideberth_nav2.controllers.vector_pursuit import VectorPursuit
from wideberth_nav2.goal_checker import GoalChecker
from wideberth_nav2.parameters import annotations_of
from wideberth_nav2.path_handler import PathHandler
from wideberth_nav2.server.recoveries import Recoveries
from wideberth_nav2.server.server import ProgressChecker
from wideberth_nav2.server.settings import LoopSettings
from wideberth_nav2.server.velocity_smoother import Nav2VelocitySmoother

KINDS: list[type] = [
    RegulatedPurePursuit, VectorPursuit, Graceful, DWB, MPPI, TEB, RotationShim, GoalChecker,
    ProgressChecker, PathHandler, Recoveries, Nav2VelocitySmoother, *CRITICS.values(),
    *dwb_critics.CRITICS.values(),
]  # fmt: skip


def others(kind: type) -> dict[str, Any]:
    """What a class needs beside its parameters."""
    return {"primary": Scripted()} if kind is RotationShim else {}


@pytest.mark.parametrize("kind", KINDS)
def test_every_parameter_is_of_its_kind(kind: type) -> None:
    tried = 0
    for one in fields(kind):
        wrong: list[Any] = []
        bare: Any = one.type
        bare = get_args(bare)[0] if get_origin(bare) is Annotated else bare
        if bare in (int, float):
            wrong = ["a", nan, inf, True]
        elif bare is bool:
            wrong = ["true", 2]
        elif bare is str:
            wrong = [1]
        if bare is int:
            wrong.append(1.5)
        for value in wrong if one.init else []:
            with pytest.raises(WideberthError, match=rf"{one.name} is .*wanted"):
                kind(**others(kind), **{one.name: value})
            tried += 1
    assert tried


@pytest.mark.parametrize("kind", KINDS)
def test_every_bound_of_an_annotation_holds(kind: type) -> None:
    """What is on the wrong side of it is refused; what is on the right side has no such error."""
    for name, hint in annotations_of(kind).items():
        for bound in get_args(hint)[1:]:
            if not isinstance(bound, Gt | Ge):
                continue
            least = bound.gt if isinstance(bound, Gt) else bound.ge
            wanted = "above" if isinstance(bound, Gt) else "of at least"
            wrong = least if isinstance(bound, Gt) else least - 1
            message = (
                rf"{name} is {wrong:g}\b.*; wanted a (whole|finite) number {wanted} {least:g}$"
            )
            with pytest.raises(WideberthError, match=message):
                kind(**others(kind), **{name: wrong})


def test_every_kind_of_controller_has_a_bound() -> None:
    bounded = [
        any(isinstance(one, Gt | Ge) for hint in annotations_of(kind).values()
            for one in get_args(hint)) for kind in KINDS[:12]
    ]  # fmt: skip
    assert all(bounded)


def test_a_number_becomes_what_its_annotation_says() -> None:
    made = MPPI(batch_size=20.0, vx_max=1)  # type: ignore[arg-type]
    assert type(made.batch_size) is int and type(made.vx_max) is float
    for given in ([1, 0, 2], np.array([1.0, 0.0, 2.0])):
        smoother = Nav2VelocitySmoother(max_velocity=given)  # type: ignore[arg-type]
        assert smoother.max_velocity == (1.0, 0.0, 2.0)
    numbers = GoalChecker(np.float32(0.5), stateful=np.bool_(False))  # type: ignore[arg-type]
    assert (numbers.xy_goal_tolerance, numbers.stateful) == (0.5, False)
    assert Recoveries(np.int64(3)).number_of_retries == 3  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        (dwb_critics.PathDist, {"aggregation_type": "Last"}, "'last', 'sum' or 'product'"),
        (Nav2VelocitySmoother, {"feedback": "open"}, "'OPEN_LOOP' or 'CLOSED_LOOP'"),
        (Nav2VelocitySmoother, {"max_accel": [1.0, 2.0]}, "wanted 3 numbers"),
        (Nav2VelocitySmoother, {"max_accel": ["a", 0.0, 0.0]}, r"max_accel\[0\] is 'a'"),
        (CRITICS["CostCritic"], {"trajectory_point_step": 0}, "at least 1"),
        (CRITICS["PathAlignCritic"], {"trajectory_point_step": 0}, "at least 1"),
        (CRITICS["PathFollowCritic"], {"offset_from_furthest": -1}, "at least 0"),
        (PathHandler, {"max_robot_pose_search_dist": "far"}, "wanted a number"),
        (
            PathHandler,
            {"prune_distance": np.bool_(True)},
            "prune_distance is True; wanted a number",
        ),
        (GoalChecker, {"xy_goal_tolerance": 10**400}, "wanted a number"),
        (CRITICS["PathAngleCritic"], {"mode": 10**400}, "wanted another value"),
        (Nav2VelocitySmoother, {"max_accel": {1.0, 2.0, 3.0}}, "wanted 3 numbers"),
    ],
)
def test_values_out_of_range_are_refused(kind: type, given: dict[str, Any], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        kind(**given)


@pytest.mark.parametrize(
    ("kind", "given"),
    [
        (Graceful, {"footprint_scaling_step": 1e-6, "v_linear_max": 0.7}),
        (Graceful, {"final_rotation_search_step": 1e-5}),
        (Graceful, {"in_place_collision_resolution": 1e-6}),
        (RotationShim, {"simulate_ahead_time": 1e7}),
        (Recoveries, {"simulate_ahead_time": 1e7}),
        (MPPI, {"batch_size": 10**9}),
        (DWB, {"angular_granularity": 1e-9, "max_vel_theta": 1.0}),
        (DWB, {"discretize_by_time": True, "time_granularity": 1e-9}),
        (DWB, {"vx_samples": 10**9}),
        (TEB, {"no_inner_iterations": 10**9}),
    ],
)
def test_work_without_bound_is_refused(kind: type, given: dict[str, Any]) -> None:
    with pytest.raises(WideberthError, match=r"steps per tick; wanted at most"):
        kind(**others(kind), **given)


def test_names_without_effect_and_old_ones_are_known_to_every_adapter() -> None:
    stopping = {"use_cancel_deceleration": True, "cancel_deceleration": 3.2}
    found = golden_regulated_pure_pursuit.controller_of(
        {"params": {**stopping, "desired_linear_vel": 0.3}}
    )
    assert found.max_linear_vel == 0.3
    turned = golden_graceful.controller_of({"params": {"min_lookahead": 0.25, "lambda": 1.5}})
    assert turned.lambda_ == 1.5
    screw = {"transform_tolerance": 0.1, "desired_linear_vel": 0.2}
    assert golden_vector_pursuit.controller_of({"params": screw}).desired_linear_vel == 0.2


def test_an_arc_ends_after_a_whole_turn() -> None:
    for speed, turning in ((0.0, 1.8), (1e-9, -0.5), (0.3, 2.0)):
        poses, hit = collision_arc(tick(straight(1.0)), speed, turning, 2e4, 9.0)
        assert not hit
        turned = abs(poses[-1, 2] - poses[0, 2])
        step = abs(poses[1, 2] - poses[0, 2])
        assert 2.0 * np.pi < turned + step and turned <= 2.0 * np.pi + step
    ahead, _ = collision_arc(tick(straight(1.0)), 0.5, 0.0, 2e4, 1.0)
    assert ahead[-1, 0] == pytest.approx(1.0, abs=0.051)


def test_wrong_numbers_of_a_file_are_refused_before_the_first_tick() -> None:
    for local, name in (
        ("regulated_pure_pursuit", "rotate_to_heading_min_angle"), ("graceful", "k_phi"),
        ("vector_pursuit", "max_linear_accel"), ("dwb", "PathDist.scale"),
    ):  # fmt: skip
        with pytest.raises(WideberthError, match=f"{name} is 'a'; wanted a number"):
            LoopSettings(local, {name: "a"})
    with pytest.raises(WideberthError, match="wanted a number"):
        LoopSettings(velocity_smoother={"max_velocity": ["a", 0.0, 1.0]})
