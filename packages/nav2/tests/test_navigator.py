"""Nav2 as a controller: its contract, whole ways to a goal, and bad input."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.robot import step
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import PlacedScan, Scan
from wideberth.robots import DifferentialDrive, HolonomicVelocity, Unicycle
from wideberth.routes import NavFn
from wideberth_nav2.costmap.local_costmap import CostmapView
from wideberth_nav2.server.navigator import MOST_POSES, Nav2, Navigation, poses_along
from wideberth_nav2.server.settings import LoopSettings

ROBOT = Unicycle(0.3, 0.7, 1.5, 2.0, 3.0)
LOCAL = [
    "dwb", "graceful", "mppi", "mppi_foresight", "regulated_pure_pursuit", "rotation_shim", "teb",
    "vector_pursuit",
]  # fmt: skip
SMALL = {
    "mppi": {"batch_size": 200}, "mppi_foresight": {"batch_size": 200},
    "dwb": {"vx_samples": 6, "vtheta_samples": 9, "max_vel_x": 0.5, "max_speed_xy": 0.5},
}  # fmt: skip
People = Callable[[float], list[tuple[float, float]]]


def settings(local: str, **other: object) -> LoopSettings:
    made = LoopSettings.shipped(local)
    return replace(made, parameters={**made.parameters, **SMALL.get(local, {})}, **other)  # type: ignore[arg-type]


def observed(
    time: float, state: tuple[float, ...], places: list[tuple[float, float]],
    polygons: tuple[Polygon, ...] = (),
) -> Observation:  # fmt: skip
    people = tuple(
        Detection(f"p{i}", np.array(place), 1e-4 * np.eye(2), 0.3)
        for i, place in enumerate(places)
    )
    return Observation(time, np.array(state), people, polygons=polygons)


def driven(
    nav2: Nav2, end: float, people: People = lambda _: [], polygons: tuple[Polygon, ...] = (),
    start: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0),
) -> tuple[np.ndarray, list[str]]:  # fmt: skip
    """Drive until the navigation has ended; return all states, and every reason once."""
    states, reasons, state = [start], [], start
    for k in range(round(end / nav2.period)):
        time = k * nav2.period
        command = nav2.command(observed(time, state, people(time), polygons))
        if nav2.reason and nav2.reason not in reasons:
            reasons.append(nav2.reason)
        control = ROBOT.drive(state, command.twist, nav2.period)
        state = step(ROBOT, state, control, nav2.period)
        states.append(state)
        if nav2.navigation in (Navigation.SUCCEEDED, Navigation.FAILED):
            break
    return np.array(states), reasons


@pytest.mark.parametrize("local", LOCAL)
def test_it_keeps_the_laws_of_controllers(local: str) -> None:
    check_controller(Nav2(ROBOT, settings(local)), cycles=4)


@pytest.mark.parametrize("local", LOCAL)
def test_every_controller_comes_to_the_goal_of_a_free_path(local: str) -> None:
    nav2 = Nav2(ROBOT, settings(local))
    nav2.set_path(Path([(0.0, 0.0), (2.0, 0.0), (3.0, 1.0)]))
    states, _ = driven(nav2, 30.0, start=(0.0, 0.1, 0.2, 0.0, 0.0))
    assert nav2.navigation is Navigation.SUCCEEDED
    assert np.hypot(*(states[-1, :2] - [3.0, 1.0])) <= 0.3
    assert abs(states[:, 1] - np.clip(states[:, 0] - 2.0, 0.0, 1.0)).max() < 0.45


@pytest.mark.parametrize("local", ["dwb", "graceful", "regulated_pure_pursuit", "vector_pursuit"])
def test_who_stands_in_the_way_is_not_touched(local: str) -> None:
    nav2 = Nav2(ROBOT, settings(local))
    nav2.set_path(Path([(0.0, 0.0), (5.0, 0.0)]))
    states, reasons = driven(nav2, 20.0, lambda _: [(2.5, 0.1)])
    apart = np.hypot(*(states[:, :2] - [2.5, 0.1]).T) - 0.6
    assert apart.min() > -0.05 and states[:, 0].max() > 1.2  # to within a cell of the costmap
    assert local == "dwb" or reasons


def test_who_goes_away_lets_it_pass() -> None:
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit"))
    nav2.set_path(Path([(0.0, 0.0), (4.0, 0.0)]))
    states, reasons = driven(nav2, 40.0, lambda time: [(2.0, 0.0 if time < 6.0 else 9.0)])
    assert nav2.navigation is Navigation.SUCCEEDED and any("hits" in one for one in reasons)
    assert states[-1, 0] > 3.7


def test_a_blocked_path_leads_to_recoveries_and_then_to_failure() -> None:
    recoveries = {"wait_duration": 0.5, "number_of_retries": 4}
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit", recoveries=recoveries))
    nav2.set_path(Path([(0.0, 0.0), (4.0, 0.0)]))
    states, reasons = driven(nav2, 60.0, lambda _: [(2.0, 0.0), (2.0, 0.5), (2.0, -0.5)])
    assert nav2.navigation is Navigation.FAILED and nav2.recoveries == 4
    for words in ("PATIENCE_EXCEEDED", "clear costmaps", "spin", "wait", "back up"):
        assert any(words in one for one in reasons), words
    still = nav2.command(observed(90.0, tuple(states[-1]), []))
    assert still.linear == pytest.approx((0.0, 0.0), abs=0.15)
    nav2.set_path(Path([tuple(states[-1, :2]), (0.0, 0.0)]))
    assert nav2.navigation is Navigation.FOLLOWING and nav2.recoveries == 0


def test_a_path_that_is_given_again_does_not_begin_the_retries_anew() -> None:
    recoveries = {"wait_duration": 0.5, "number_of_retries": 2}
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit", recoveries=recoveries))
    path = Path([(0.0, 0.0), (4.0, 0.0)])
    nav2.set_path(path)

    def blocked(time: float) -> list[tuple[float, float]]:
        if round(time / nav2.period) % 20 == 0:
            nav2.set_path(path)
        return [(2.0, 0.0), (2.0, 0.5), (2.0, -0.5)]

    driven(nav2, 60.0, blocked)
    assert nav2.navigation is Navigation.FAILED and nav2.recoveries == 2


@pytest.mark.parametrize(("controller", "smoother"), [(20.0, 20.0), (20.0, 50.0), (10.0, 20.0),
                                                      (20.0, 5.0)])  # fmt: skip
def test_the_smoother_keeps_its_bounds_at_a_rate_of_its_own(
    controller: float, smoother: float
) -> None:
    made = settings("regulated_pure_pursuit", controller_frequency=controller)
    bounds = {**made.velocity_smoother, "smoothing_frequency": smoother,
              "max_accel": [0.5, 0.0, 3.5]}  # fmt: skip
    nav2 = Nav2(ROBOT, replace(made, velocity_smoother=bounds))
    assert nav2.period == 1.0 / max(controller, smoother)
    nav2.set_path(Path([(0.0, 0.0), (9.0, 0.0)]))
    speeds = [
        nav2.command(observed(k * nav2.period, (0.0, 0.0, 0.0, 0.0, 0.0), [])).linear[0]
        for k in range(round(0.8 / nav2.period))
    ]
    changes = np.diff([0.0, *speeds])
    assert changes.max() <= 0.5 / smoother + 1e-12
    assert (changes > 0.0).sum() == pytest.approx(0.8 * smoother, abs=1)
    assert speeds[-1] == pytest.approx(0.5 * 0.8, abs=1.01 * 0.5 / smoother)


def test_a_scan_comes_before_discs_and_lost_beams_show_nothing() -> None:
    start = (0.0, 0.0, 0.0, 0.0, 0.0)
    bearings = np.linspace(-np.pi, np.pi, 360, endpoint=False)
    ranges = np.full(360, np.inf)
    ranges[180], ranges[181] = 1.0, np.nan
    turn = Scan("lidar", np.zeros(360), bearings, ranges)
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit"))
    where = np.array([0.0, 0.5, 0.0])  # the robot stood there
    nav2.remember(replace(observed(0.0, start, [(-1.0, 0.0)]), scan=PlacedScan(turn, where)))
    costmap = nav2.costmap
    assert costmap is not None
    my, mx = np.nonzero(costmap.cells == 254)
    assert costmap.map_to_world(np.stack([mx, my], axis=1)) == pytest.approx(
        np.array([[1.0, 0.5]]), abs=0.05
    )
    lost = Scan("lidar", np.zeros(360), bearings, np.full(360, np.nan))
    nav2.reset()
    nav2.remember(replace(observed(0.0, start, []), scan=PlacedScan(lost, where)))
    assert nav2.costmap is not None and not nav2.costmap.cells.any()


def test_replanning_leads_it_round() -> None:
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit"), planner=NavFn())
    nav2.set_path(Path([(0.0, 0.0), (5.0, 0.0)]))
    states, _ = driven(nav2, 60.0, lambda _: [(2.5, 0.0)])
    assert nav2.navigation is Navigation.SUCCEEDED and nav2.recoveries == 0
    assert (np.hypot(*(states[:, :2] - [2.5, 0.0]).T) > 0.6).all()


def test_after_a_reset_it_follows_the_path_that_it_was_given() -> None:
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit"), planner=NavFn())
    nav2.set_path(Path([(0.0, 0.0), (5.0, 0.0)]))
    found = []
    for _ in range(2):
        nav2.reset()
        found.append(driven(nav2, 3.0, lambda _: [(2.5, 0.0)])[0].tobytes())
    assert found[0] == found[1]


def test_a_wall_around_the_goal_leaves_no_route() -> None:
    nav2 = Nav2(
        ROBOT, settings("regulated_pure_pursuit", recoveries={"number_of_retries": 0}),
        planner=NavFn(tolerance=0.1),
    )  # fmt: skip
    nav2.set_path(Path([(0.0, 0.0), (5.0, 0.0)]))
    bars = [(4.0, -1.0, 4.2, 1.0), (5.8, -1.0, 6.0, 1.0), (4.0, 0.8, 6.0, 1.0),
            (4.0, -1.0, 6.0, -0.8)]  # fmt: skip
    walls = tuple(Polygon(((a, b), (c, b), (c, d), (a, d))) for a, b, c, d in bars)
    _, reasons = driven(nav2, 5.0, polygons=walls)
    assert nav2.navigation is Navigation.FAILED and any(
        "NO_VALID_PATH: no route" in one for one in reasons
    )


def test_the_same_episode_gives_the_same_bytes() -> None:
    for local in ("mppi", "graceful"):
        found = []
        nav2 = Nav2(ROBOT, settings(local))
        nav2.set_path(Path([(0.0, 0.0), (2.0, 0.0)]))
        for _ in range(2):
            nav2.reset()
            found.append(driven(nav2, 4.0, lambda _: [(1.5, 0.6)])[0].tobytes())
        assert found[0] == found[1]


def test_the_privileged_view_sees_farther() -> None:
    near, far = (
        Nav2(ROBOT, settings("regulated_pure_pursuit", view=view))
        for view in (CostmapView(), CostmapView.privileged())
    )
    seen = observed(0.0, (0.0, 0.0, 0.0, 0.0, 0.0), [(4.0, 0.0)])
    for nav2, found in ((near, False), (far, True)):
        nav2.remember(seen)
        assert nav2.costmap is not None
        assert (nav2.costmap.cells == 254).any() == found


def test_bad_input_has_a_reason() -> None:
    nav2 = Nav2(ROBOT, settings("graceful"))
    nav2.set_path(Path([(0.0, 0.0), (2.0, 0.0)]))
    start = (0.0, 0.0, 0.0, 0.0, 0.0)
    assert nav2.command(observed(0.0, (np.nan, *start[1:]), [])).linear == (0.0, 0.0)
    assert "nan" in nav2.reason
    nav2.command(observed(0.05, start, [(np.nan, 1.0), (1e30, 1e30)]))
    assert nav2.reason == "seen without a place: 'p0', 'p1'"
    nav2.set_path(Path([(50.0, 0.0), (52.0, 0.0)]))
    nav2.command(observed(0.1, start, []))
    assert nav2.navigation is Navigation.FAILED and "INVALID_PATH" in nav2.reason


def test_a_goal_in_an_obstacle_is_never_reached() -> None:
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit", recoveries={"number_of_retries": 0}))
    nav2.set_path(Path([(0.0, 0.0), (3.0, 0.0)]))
    _, reasons = driven(nav2, 30.0, lambda _: [(3.0, 0.0)])
    assert nav2.navigation is Navigation.FAILED
    assert any("NO_VALID_CONTROL" in one or "PATIENCE" in one for one in reasons)


def test_a_costmap_smaller_than_the_look_ahead_leaves_no_valid_control() -> None:
    nav2 = Nav2(ROBOT, settings("regulated_pure_pursuit", view=CostmapView(width=0.8, height=0.8)))
    nav2.set_path(Path([(0.0, 0.0), (3.0, 0.0)]))
    _, reasons = driven(nav2, 60.0)  # an outline that leaves the map counts as a collision
    assert nav2.navigation is Navigation.FAILED
    assert any("PATIENCE_EXCEEDED: no valid control" in one for one in reasons)


def test_robots_without_heading_are_refused() -> None:
    with pytest.raises(WideberthError, match="heading"):
        Nav2(HolonomicVelocity())


def test_limits_of_the_robot_bind_controller_and_smoother() -> None:
    slow = Unicycle()  # 0.7 m/s, 0.3 rad/s, 0.7 m/s^2, 0.1 rad/s^2
    nav2 = Nav2(slow, settings("regulated_pure_pursuit"), robot_limits=True)
    controller, smoother = nav2._set.make_controller(), nav2._set.make_smoother()
    assert controller.max_linear_vel == pytest.approx(0.7)  # type: ignore[attr-defined]
    assert smoother.max_velocity == pytest.approx((0.7, 0.0, 0.3))
    assert smoother.max_accel == pytest.approx((0.7, 0.0, 0.1))


def test_a_robot_with_velocities_as_inputs_knows_its_last_command() -> None:
    check_controller(Nav2(DifferentialDrive(), settings("regulated_pure_pursuit")), cycles=4)


def test_poses_lie_along_the_path_at_equal_steps() -> None:
    poses = poses_along(Path([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]))
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    assert steps.max() <= 0.05 + 1e-9 and steps.sum() == pytest.approx(2.0)
    assert poses[0, 2] == 0.0 and poses[-1, 2] == pytest.approx(np.pi / 2)


def test_a_path_to_the_end_of_the_world_has_no_more_poses_than_memory_holds() -> None:
    path = Path([(0.0, 0.0), (1e9, 0.0)])
    poses = poses_along(path)
    assert len(poses) == MOST_POSES + 1
    np.testing.assert_array_equal(poses[[0, -1]], [(0.0, 0.0, 0.0), (1e9, 0.0, 0.0)])


@pytest.mark.parametrize("local", ["dwb", "regulated_pure_pursuit"])
def test_it_brakes_while_an_obstacle_is_seen_without_a_place(local: str) -> None:
    """It may be anywhere, and no costmap shows it; once it is gone the robot goes on."""
    nav2, state = Nav2(ROBOT, settings(local)), (0.0,) * 5
    nav2.set_path(Path(np.array([(0.0, 0.0), (9.0, 0.0)])))
    speeds, reasons = [], []
    for k in range(round(6.0 / nav2.period)):
        time = k * nav2.period
        seen = observed(time, state, [(np.nan, 0.0)] if 2.0 <= time < 4.0 else [])
        command = nav2.command(seen)
        state = step(ROBOT, state, ROBOT.drive(state, command.twist, nav2.period), nav2.period)
        speeds.append(state[3])
        reasons.append(nav2.reason)
    count = len(speeds) // 6
    assert speeds[2 * count - 1] > 0.1 and abs(speeds[4 * count - 1]) < 1e-3
    assert speeds[-1] > 0.1
    assert reasons[3 * count] == "seen without a place: 'p0'" and reasons[-1] == ""
    assert np.abs(np.diff(speeds)).max() <= ROBOT.max_acceleration * nav2.period + 1e-6
