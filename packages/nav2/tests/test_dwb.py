"""DWB beside the recorded cases: plain re-computations, memory, limits and refusals."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.packages.nav2.tests import ticks
from wideberth.packages.nav2.tests.ticks import free
from wideberth_nav2.controllers.dwb import DWB
from wideberth_nav2.controllers.dwb_critics import (
    ObstacleFootprint,
    Oscillation,
    PathDist,
    RotateToGoal,
    Twirling,
    dense,
    distances,
    path_cells,
)
from wideberth_nav2.controllers.dwb_trajectories import GENERATORS, Trajectories
from wideberth_nav2.controllers.local_controller import Tick
from wideberth_nav2.costmap.footprint import RobotFootprint, line_cost, outline_costs

LIMITS = {
    "max_vel_x": 0.26, "max_vel_theta": 1.0, "max_speed_xy": 0.26, "acc_lim_x": 2.5,
    "acc_lim_theta": 3.2, "decel_lim_x": -2.5, "decel_lim_theta": -3.2, "vx_samples": 5,
    "vtheta_samples": 7, "linear_granularity": 0.05,
}  # fmt: skip


def tick_of(
    costmap: Costmap,
    pose: tuple[float, ...] = (0.0, 0.0, 0.0),
    speed: float = 0.1,
    **changes: object,
) -> Tick:
    plan = np.stack([np.linspace(0.0, 1.2, 25), np.zeros(25), np.zeros(25)], axis=1)
    given = {"costmap": costmap, "speed": np.array([speed, 0.0, 0.0]), **changes}
    return ticks.tick(plan, pose, **given)


def along(points: list[tuple[float, float]], costmap: Costmap) -> Trajectories:
    """One trajectory through given points."""
    poses = np.array([[(*point, 0.0) for point in points]])
    cells = costmap.world_to_map(poses[..., :2])
    index = cells[..., 1] * costmap.width + cells[..., 0]
    return Trajectories(np.zeros((1, 3)), poses, np.array([len(points)]), np.ones(1), index)


def test_distances_are_those_of_a_search_over_all_sources() -> None:
    rng = np.random.default_rng(1)
    costmap = Costmap(np.zeros((13, 17), np.uint8), 0.1)
    sources = rng.choice(13 * 17, 6, replace=False)
    rows, columns = np.divmod(np.arange(13 * 17), 17)
    wanted = np.min(
        [np.abs(rows - s // 17) + np.abs(columns - s % 17) for s in sources], axis=0
    ).reshape(13, 17)
    assert np.array_equal(distances(costmap, sources), wanted)
    assert (distances(costmap, sources[:0]) == 13 * 17 + 1).all()


def test_gaps_of_a_path_are_filled() -> None:
    points = dense(np.array([[0.0, 0.0], [0.5, 0.0], [0.58, 0.0]]), 0.05)
    assert points[:, 0] == pytest.approx([0.5 * i / 7 for i in range(8)] + [0.58])


def test_path_cells_end_where_the_path_leaves_the_map() -> None:
    costmap, plan = free(20), np.zeros((5, 3))
    plan[:, 0] = [-0.71, -0.41, -0.11, 0.61, 0.2]
    cells = path_cells(costmap, plan)
    columns = cells % 20
    assert columns[0] == 1 and columns[-1] == 19 and (np.diff(columns) >= 0).all()
    unknown = costmap.cells.copy()
    unknown[10, 11] = 255
    assert path_cells(Costmap(unknown, 0.05, (-0.5, -0.5)), plan)[-1] % 20 == 10


@pytest.mark.parametrize(("kind", "wanted"), [("last", 3.0), ("sum", 6.0), ("product", 6.0)])
def test_scores_of_poses_are_aggregated(kind: str, wanted: float) -> None:
    costmap = free(60)
    critic = PathDist(aggregation_type=kind)  # type: ignore[arg-type]
    critic.prepare(tick_of(costmap))
    points = [(0.3, 0.06), (0.4, 0.11), (0.5, 0.16)]
    assert critic.scores(along(points, costmap)).tolist() == [wanted]


def test_the_last_edge_runs_back_where_asked() -> None:
    rng = np.random.default_rng(2)
    costmap = Costmap(rng.integers(0, 253, (60, 60)).astype(np.uint8), 0.05, (-1.5, -1.5))
    shape = RobotFootprint.of([[0.31, 0.2], [0.3, -0.22], [-0.25, -0.2], [-0.27, 0.21]])
    poses = np.column_stack([rng.uniform(-0.9, 0.9, (300, 2)), rng.uniform(-3.0, 3.0, 300)])
    forth = outline_costs(costmap, shape.vertices, poses)
    assert forth.tolist() == [shape.cost(costmap, pose) for pose in poses]
    back = outline_costs(costmap, shape.vertices, poses, back=True)
    corners = [costmap.world_to_map(shape.at(pose)).tolist() for pose in poses]
    wanted = [
        max(line_cost(costmap.cells, *one[i - 1], *one[i]) for i in range(4)) for one in corners
    ]
    assert back.tolist() == wanted and (back != forth).any()
    one_each = Trajectories(np.zeros((300, 3)), poses[:, None], np.ones(300, int), np.ones(300),
                            np.zeros((300, 1), int))  # fmt: skip
    critic = ObstacleFootprint()
    critic.prepare(tick_of(costmap, footprint=shape))
    assert critic.scores(one_each).tolist() == wanted


def test_a_footprint_at_an_obstacle_is_not_allowed() -> None:
    cells = np.zeros((60, 60), np.uint8)
    cells[30, 38] = 254
    costmap = Costmap(cells, 0.05, (-1.5, -1.5))
    shape = RobotFootprint.of([[0.2, 0.1], [0.2, -0.1], [-0.2, -0.1], [-0.2, 0.1]])
    critic = ObstacleFootprint()
    critic.prepare(tick_of(costmap, footprint=shape))
    reach = [along([(x, 0.02)], costmap) for x in (0.1, 0.21, 0.75)]
    assert [critic.scores(one).tolist() for one in reach[::2]] == [[0.0], [0.0]]
    assert np.isnan(critic.scores(reach[1]))


def test_samples_hold_a_zero_where_the_sign_changes_but_no_standstill() -> None:
    sampling = DWB(**{**LIMITS, "min_vel_x": -0.26}).sampling
    twists = sampling.twists(np.zeros(3))
    assert {0.0} < set(twists[:, 0]) and (np.abs(twists).sum(axis=1) > 0.0).all()
    assert len(twists) == 5 * 8 - 1  # -0.26, -0.13, 0, 0.13, 0.26; 7 yaw rates and a zero
    tiny = twists[(np.abs(twists[:, 2]) > 0.0) & (np.abs(twists[:, 2]) < 1e-9)]
    assert len(tiny) == 5  # the rounding error of the added steps is a sample of its own


def test_slow_twists_are_left_out() -> None:
    sampling = DWB(**LIMITS, min_speed_xy=0.1, min_speed_theta=0.4).sampling
    twists = sampling.twists(np.array([0.1, 0.0, 0.0]))
    assert ((twists[:, 0] >= 0.1) | (np.abs(twists[:, 2]) >= 0.4)).all()


def test_a_speed_limit_scales_the_samples() -> None:
    controller = DWB(**LIMITS)
    most = controller.sampling.high
    controller.limit_speed(50.0, percentage=True)
    assert controller.sampling.high == pytest.approx(0.5 * most)
    controller.limit_speed(0.13, percentage=False)
    assert controller.sampling.fastest == pytest.approx(0.13)
    controller.limit_speed(0.0, percentage=False)
    assert controller.sampling.high == pytest.approx(most)


def test_rollouts_reach_their_twist_at_the_acceleration() -> None:
    sampling = DWB(**{**LIMITS, "acc_lim_x": 0.2}).sampling
    twists = np.array([[0.26, 0.0, 0.0]])
    found = sampling.trajectories(np.zeros(3), np.zeros(3), twists, free(60))
    steps = found.steps[0] * np.arange(1, found.counts[0] - 1)
    speeds = np.minimum(0.26, 0.2 * steps)
    assert found.last[0, 0] == pytest.approx((speeds * found.steps[0]).sum())
    half = found.at(0.5 * 1.7)[0, 0]
    assert found.poses[0, :, 0].searchsorted(half) == pytest.approx(found.counts[0] / 2, abs=1.5)


def test_lateral_speed_moves_to_the_left() -> None:
    sampling = DWB(**LIMITS, max_vel_y=0.2, acc_lim_y=9.0).sampling
    start = np.array([0.0, 0.2, 0.0])
    found = sampling.trajectories(np.array([0.0, 0.0, 0.5]), start, start[None], free(60))
    wanted = 1.7 * 0.2 * np.array([-np.sin(0.5), np.cos(0.5)])
    assert found.last[0, :2] == pytest.approx(wanted)


def test_while_it_moves_the_sign_of_turns_is_not_watched() -> None:
    critic = Oscillation()
    critic.prepare(tick_of(free(60)))
    for turn in (0.5, -0.5):
        critic.debrief(np.array([0.2, 0.0, turn]))
    twists = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]])
    both = Trajectories(twists, np.zeros((2, 1, 3)), np.ones(2, int), np.ones(2),
                        np.zeros((2, 1), int))  # fmt: skip
    assert not np.isnan(critic.scores(both)).any()
    for turn in (0.5, -0.5):
        critic.debrief(np.array([0.04, 0.0, turn]))
    assert np.isnan(critic.scores(both)).tolist() == [True, False]


def test_nothing_is_cut_short_by_a_total_of_zero() -> None:
    controller = DWB(critics=(Twirling(scale=1.0), Twirling(scale=2.0)), **LIMITS)
    found = controller.judged(tick_of(free(60)))
    turns = np.abs(found.trajectories.twists[:, 2])
    first = int(np.argmin(turns))  # the least total is exactly 0 from here on
    assert found.totals[first:] == pytest.approx(3.0 * turns[first:])
    assert turns[first] == 0.0 and (found.evaluated[first:] == 2).all()
    assert (found.evaluated[1:first] < 2).any() or first < 2


def test_turning_back_is_forbidden_until_the_robot_has_moved() -> None:
    critic, costmap = Oscillation(), free(60)
    twists = np.array([[0.2, 0.0, 0.0], [-0.2, 0.0, 0.0]])
    both = Trajectories(twists, np.zeros((2, 1, 3)), np.ones(2, int), np.ones(2),
                        np.zeros((2, 1), int))  # fmt: skip
    for sign in (1.0, -1.0):
        critic.prepare(tick_of(costmap))
        assert not np.isnan(critic.scores(both)).any()
        critic.debrief(np.array([0.2 * sign, 0.0, 0.5]))
    assert np.isnan(critic.scores(both)).tolist() == [True, False]
    critic.prepare(tick_of(costmap, pose=(0.04, 0.0, 0.1)))
    critic.debrief(np.array([-0.2, 0.0, 0.0]))
    assert np.isnan(critic.scores(both)).tolist() == [True, False]
    critic.prepare(tick_of(costmap, pose=(0.06, 0.0, 0.1)))
    critic.debrief(np.array([-0.2, 0.0, 0.0]))
    assert not np.isnan(critic.scores(both)).any()


def test_a_turn_across_pi_lets_the_robot_turn_back_as_in_the_original() -> None:
    twist = Trajectories(np.array([[0.2, 0.0, 0.0]]), np.zeros((1, 1, 3)), np.ones(1, int),
                         np.ones(1), np.zeros((1, 1), int))  # fmt: skip
    for before, after, forbidden in ((3.0, 3.1, True), (3.13, -3.13, False), (3.13, 3.16, False)):
        critic, costmap = Oscillation(), free(60)
        for sign, yaw in ((1.0, before), (-1.0, before), (-1.0, after)):
            critic.prepare(tick_of(costmap, pose=(0.0, 0.0, yaw)))
            critic.debrief(np.array([0.2 * sign, 0.0, 0.0]))
        assert np.isnan(critic.scores(twist))[0] == forbidden, (before, after)


def test_time_lets_the_robot_turn_back_where_it_is_given() -> None:
    critic, costmap = Oscillation(oscillation_reset_time=1.0), free(60)
    twist = Trajectories(np.array([[0.2, 0.0, 0.0]]), np.zeros((1, 1, 3)), np.ones(1, int),
                         np.ones(1), np.zeros((1, 1), int))  # fmt: skip
    for time, sign, forbidden in ((0.0, 1, False), (0.1, -1, True), (1.0, -1, True),
                                  (1.2, -1, False)):  # fmt: skip
        critic.prepare(tick_of(costmap, time=time))
        critic.debrief(np.array([0.2 * sign, 0.0, 0.0]))
        assert np.isnan(critic.scores(twist))[0] == forbidden, time


def test_the_goal_latches_until_the_next_path() -> None:
    costmap = free(60)
    controller = DWB(critics=(RotateToGoal(),), **LIMITS)
    tick = tick_of(costmap, pose=(1.15, 0.0, 0.5))
    near = replace(tick, plan=tick.plan[-2:], speed=np.zeros(3))
    answer = controller.velocity(near)
    assert answer.twist is not None and answer.twist.linear == (0.0, 0.0)
    assert answer.twist.angular < 0.0  # turns to the goal's heading
    away = replace(near, pose=np.array([0.5, 0.0, 0.5]))
    assert controller.velocity(away).twist.linear == (0.0, 0.0)  # type: ignore[union-attr]
    controller.new_path(tick.plan)
    raw = controller.judged(away).raw
    assert (raw == 0.0).all()


def test_a_blocked_robot_gets_a_reason() -> None:
    costmap = Costmap(np.full((60, 60), 254, np.uint8), 0.05, (-1.5, -1.5))
    answer = DWB(**LIMITS).velocity(tick_of(costmap))
    assert answer.twist is None and answer.error == "NoValidControl"
    assert "BaseObstacle forbids" in answer.reason


def test_the_limited_generator_samples_what_a_period_allows() -> None:
    controller = DWB(**LIMITS, trajectory_generator_name=GENERATORS[1], sim_period=0.02)
    twists = controller.sampling.twists(np.array([0.1, 0.0, 0.0]))
    assert twists[:, 0].min() == pytest.approx(0.05)
    assert twists[:, 0].max() == pytest.approx(0.15)


def test_equal_calls_have_equal_answers_after_a_reset() -> None:
    controller, tick = DWB(**LIMITS), tick_of(free(60))
    first = [repr(controller.velocity(tick).twist) for _ in range(3)]
    controller.reset()
    assert [repr(controller.velocity(tick).twist) for _ in range(3)] == first


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"vx_sample": 3}, "did you mean 'vx_samples'"),
        ({"critics": ["PathDists"]}, "did you mean 'PathDist'"),
        ({"PathDist.scales": 1.0}, r"PathDist.scales.*did you mean 'scale'"),
        ({"critics": []}, "at least one critic"),
        ({"vx_samples": 0}, "whole number of at least 1"),
        ({"trajectory_generator_name": "Standard"}, "dwb_plugins::StandardTrajectoryGenerator"),
    ],
)
def test_wrong_parameters_are_refused(parameters: dict[str, object], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        DWB.from_parameters(parameters)
