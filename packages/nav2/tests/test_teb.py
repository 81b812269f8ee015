"""TEB by laws and second implementations: solver, derivatives, classes, oscillation, one drive."""

from dataclasses import replace
from math import cos, pi, sin
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from wideberth.framework.values.costmap import LETHAL, Costmap
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth_nav2.controllers import _teb_kernel as kernel
from wideberth_nav2.controllers import _teb_signature as signatures
from wideberth_nav2.controllers.local_controller import INVALID_PATH, NO_VALID_CONTROL, Tick
from wideberth_nav2.controllers.teb import (
    TEB,
    _OscillationDetector,
    lethal_points,
    local_plan,
    obstacles_of,
    saturated,
)
from wideberth_nav2.controllers.teb_band import Band, TebParameters
from wideberth_nav2.controllers.teb_classes import BandCandidate, BandCandidates, signature_of
from wideberth_nav2.controllers.teb_edges import (
    Pull,
    TebObstacles,
    associated,
    cost_of,
    edges_of,
    limits_of,
    minimised,
)
from wideberth_nav2.costmap.footprint import RobotFootprint
from wideberth_nav2.goal_checker import GoalChecker
from wideberth_nav2.server.params_file import read_params_file

NOTHING = TebObstacles(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)))
CELL = 0.05


def discs(*rows: tuple[float, ...]) -> TebObstacles:
    """Obstacles from rows x, y, radius and perhaps vx, vy."""
    table = np.array([[*row, 0.0, 0.0][:5] for row in rows])
    return TebObstacles(table[:, :2], table[:, 2], table[:, 3:])


def straight(length: float, bend: float = 0.0) -> np.ndarray:
    """A plan along x, bent to the side by a sine."""
    x = np.arange(0.0, length + 1e-9, 0.1)
    y = bend * np.sin(x)
    return np.column_stack([x, y, np.arctan(bend * np.cos(x))])


def map_of(rows: list[tuple[float, ...]], middle: np.ndarray, size: float = 6.0) -> Costmap:
    """A square map about the robot in which discs are lethal."""
    count = round(size / CELL)
    left, low = (np.floor(middle[:2] / CELL) - count // 2) * CELL
    x = left + (np.arange(count) + 0.5) * CELL
    y = low + (np.arange(count) + 0.5) * CELL
    cells = np.zeros((count, count), np.uint8)
    for cx, cy, radius in rows:
        cells[np.hypot(x[None] - cx, y[:, None] - cy) <= radius] = LETHAL
    return Costmap(cells, CELL, (float(left), float(low)))


def tick_of(
    plan: np.ndarray, rows: list[tuple[float, ...]], pose: np.ndarray | None = None,
    time: float = 0.0, speed: tuple[float, float] = (0.0, 0.0), moving: np.ndarray | None = None,
) -> Tick:  # fmt: skip
    pose = plan[0] if pose is None else pose
    return Tick(
        time, pose, np.array([speed[0], 0.0, speed[1]]), plan, plan[-1], map_of(rows, pose),
        RobotFootprint.round_of(0.2), False, GoalChecker(), observed(time, pose, moving),
    )  # fmt: skip


def observed(time: float, pose: np.ndarray, moving: np.ndarray | None) -> Observation | None:
    """What a tracker reports of discs x, y, radius, vx, vy."""
    if moving is None:
        return None
    people = [
        Detection(
            str(i),
            row[:2],
            None,
            float(row[2]),
            velocity=row[3:],
            state_covariance=1e-4 * np.eye(4),
        )
        for i, row in enumerate(moving)
    ]
    return Observation(time, pose, tuple(people))


def drive(
    teb: TEB, rows: list[tuple[float, ...]], length: float, moving: np.ndarray | None = None
) -> tuple[list[np.ndarray], list[float]]:
    """Drive along x for 30 s at most; return the poses, and how near each disc came."""
    path, pose, speed, time = straight(length), np.zeros(3), (0.0, 0.0), 0.0
    poses, near = [pose], [9.0]
    there = np.zeros((0, 5)) if moving is None else moving.copy()
    while time < 30.0 and np.hypot(*(pose - path[-1])[:2]) > 0.25:
        begin = int(np.argmin(np.hypot(*(path - pose)[:, :2].T)))
        plan = path[begin : begin + 21]
        now = replace(tick_of(plan, rows, pose, time, speed, there), goal=path[-1])
        answer = teb.velocity(now)
        speed = (0.0, 0.0)
        if answer.twist is not None:
            speed = answer.twist.linear[0], answer.twist.angular
        pose = pose + 0.05 * np.array([speed[0] * cos(pose[2]), speed[0] * sin(pose[2]), speed[1]])
        there[:, :2] += 0.05 * there[:, 3:]
        time += 0.05
        poses.append(pose)
        for x, y, radius in [*rows, *there[:, :3]]:
            near.append(float(np.hypot(pose[0] - x, pose[1] - y)) - radius)
    return poses, near


def settings_of(**changes: float) -> TebParameters:
    """Parameters of a robot of 0.2 m."""
    return TebParameters(
        **{
            "max_global_plan_lookahead_dist": 3.0,
            "robot_radius": 0.2,
            "min_obstacle_dist": 0.2,
            "inflation_dist": 0.4,
            "max_vel_theta": 1.0,
            **changes,
        }
    )


def teb_of(**changes: object) -> TEB:
    given = {name: getattr(settings_of(), name) for name in vars(settings_of())}
    return TEB(**{**given, **changes})  # type: ignore[arg-type]


def test_the_solver_reaches_what_scipy_reaches() -> None:
    settings = settings_of(no_inner_iterations=400)
    band = Band.from_plan(straight(3.0, 0.3), settings).resized(settings)
    edges = edges_of(band, Pull(discs((1.5, 0.7, 0.1)), (0.1, 0.0)), settings)
    found, cost, _ = minimised(edges, band, settings)

    def weighted(free: np.ndarray) -> np.ndarray:
        z = found.packed()
        z[3:-3] = free
        errors = np.zeros((len(edges.kind), 2))
        kernel.compiled()[0](edges, z, limits_of(settings), errors)
        return (np.sqrt(edges.weight) * errors).ravel()

    better = least_squares(weighted, found.packed()[3:-3], max_nfev=40)
    assert 2.0 * better.cost >= cost * (1.0 - 1e-3)
    before = cost_of(edges, band, settings)[1]
    assert cost < 0.9 * before


def test_the_banded_system_is_solved_as_a_dense_one() -> None:
    rng = np.random.default_rng(1)
    size, half = 30, kernel.HALF
    root = np.triu(rng.normal(size=(size, size))) + 3.0 * np.eye(size)
    root[np.subtract.outer(np.arange(size), np.arange(size)) < -half] = 0.0
    dense, b = root.T @ root, rng.normal(size=size)
    band = np.array([[dense[i, i + k] if i + k < size else 0.0 for k in range(half + 1)]
                     for i in range(size)])  # fmt: skip
    x, factor = np.zeros(size), np.zeros_like(band)
    assert kernel.solved(band, 0.5, b, factor, x)
    assert x == pytest.approx(np.linalg.solve(dense + 0.5 * np.eye(size), b), abs=1e-12)
    band[7, 0] = -1.0
    assert not kernel.solved(band, 0.5, b, factor, x)


@pytest.mark.parametrize("kind", [kernel.INFLATED, kernel.KINEMATICS])
def test_exact_derivatives_equal_differences(kind: int) -> None:
    rng = np.random.default_rng(2)
    limits = limits_of(settings_of())
    for _ in range(50):
        z = rng.normal(size=7)
        data = np.array([*rng.normal(size=2), 0.1, 1.5, 2.5])
        slope, wanted = np.zeros((2, 11)), np.zeros((2, 11))
        kernel.slopes_of(kind, z, 0, data, limits, (0, 7), slope)
        for k in range(kernel.WIDTH[kind]):
            ends = []
            for step in (1e-6, -1e-6):
                moved, e = z.copy(), np.zeros(2)
                moved[k] += step
                kernel.errors_of(kind, moved, 0, data, limits, e)
                ends.append(e)
            wanted[:, k] = (ends[0] - ends[1]) / 2e-6
        assert slope == pytest.approx(wanted, abs=1e-6)


def test_plain_code_does_what_compiled_code_does() -> None:
    settings = settings_of(no_inner_iterations=2)
    band = Band.from_plan(straight(1.0, 0.2), settings)
    edges = edges_of(band, Pull(discs((0.5, 0.4, 0.1)), (0.2, 0.1), turn=1), settings)
    z = band.packed()
    cost, _ = kernel.minimise(edges, limits_of(settings), z, 2)
    found, wanted, _ = minimised(edges, band, settings)
    assert cost == pytest.approx(wanted, rel=1e-6)
    assert z == pytest.approx(found.packed(), abs=1e-5)


def test_a_full_turn_about_an_obstacle_is_one() -> None:
    angles = np.linspace(0.0, 2.0 * pi, 200)
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.full(200, 60.0)])
    for place, wanted in ((0.3, 1.0), (1.7, 0.0)):
        there = np.array([[place, 0.0]])
        found = signatures.signature_of(circle, there, np.zeros((1, 2)), True)
        assert abs(abs(found[0]) - wanted) < 2e-3
        found = signatures.signature_of(circle, there, np.zeros((1, 2)), False)
        assert found[0] == pytest.approx(2.0 * pi * wanted, abs=1e-9)


def test_turns_about_a_moving_obstacle_are_gauss_integral() -> None:
    rng = np.random.default_rng(4)
    nodes, weights = np.polynomial.legendre.leggauss(200)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    low, high = np.arcsinh([-20.0, signatures.AHEAD - 20.0])
    sinh, cosh = (f(low + nodes * (high - low)) for f in (np.sinh, np.cosh))
    times, density = 20.0 + sinh, (high - low) * cosh * weights  # many where the segment is
    for _ in range(8):
        begin = np.array([*rng.normal(size=2), 20.0 + rng.normal()])
        end = begin + np.array([*rng.normal(size=2), 3.0])
        place, velocity = rng.normal(size=2), 0.1 * rng.normal(size=2)
        line = np.array([*velocity, 1.0])
        segment = begin + nodes[:, None] * (end - begin)
        apart = segment[:, None] - (np.array([*place, 0.0]) + times[:, None] * line)[None]
        field = apart @ np.cross(end - begin, line) / np.linalg.norm(apart, axis=2) ** 3
        wanted = float(weights @ field @ density) / (4.0 * pi)
        found = signatures.turn_about(begin, end, place, velocity)
        assert found == pytest.approx(wanted, abs=1e-6)
    assert signatures.turn_about(begin, begin, place, velocity) == 0.0


def test_work_is_bounded_whatever_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    settings, ahead = settings_of(), discs((1.5, 0.0, 0.2))
    band = Band.from_plan(straight(3.0), settings)
    for time in (1e12, np.inf, -1e12):
        endless = Band(band.poses, np.full_like(band.intervals, time))
        assert signature_of(endless, ahead, settings).shape == (1,)
    away = replace(tick_of(straight(2.0), []), pose=np.array([-1e9, -1e9, 0.0]))
    answer = teb_of().velocity(away)
    assert answer.error == NO_VALID_CONTROL and "stand" in answer.reason
    far = np.concatenate([straight(2.0), [[1e9, 0.0, 0.0]]])
    assert teb_of().velocity(tick_of(far, [])).error == NO_VALID_CONTROL
    calls = []
    monkeypatch.setattr(signatures, "MOST", 100)
    monkeypatch.setattr(signatures, "add_segment", lambda *given: calls.append(given))
    places = np.zeros((4, 2))
    vertices = np.column_stack([np.arange(17.0), np.zeros(17)])
    joined = np.triu(np.ones((17, 17), bool), 1)  # more than 30 000 paths
    signatures.new_paths(vertices, joined, 1.0, places, places, True, 0.1, np.zeros((5, 4)), 1)
    assert 25 <= len(calls) <= 26


@pytest.mark.parametrize("moving", [False, True])
def test_sides_are_told_apart(moving: bool) -> None:
    settings = settings_of(include_dynamic_obstacles=moving)
    ahead = discs((1.5, 0.0, 0.2))
    sides = []
    for bend in (0.8, 0.4, -0.8):
        x = np.linspace(0.0, 3.0, 31)
        y = bend * np.sin(pi * x / 3.0)
        plan = np.column_stack([x, y, np.zeros(31)])
        sides.append(signature_of(Band.from_plan(plan, settings), ahead, settings))
    same = signatures.compiled()[1]
    assert same(sides[0], sides[1], moving, 0.1)
    assert not same(sides[0], sides[2], moving, 0.1)


@pytest.mark.parametrize("moving", [False, True])
def test_both_sides_of_an_obstacle_compete_and_the_cheaper_wins(moving: bool) -> None:
    settings = settings_of(include_dynamic_obstacles=moving)
    ahead = discs((1.5, 0.15, 0.2))
    candidates = BandCandidates()
    rng = np.random.default_rng(3)
    for _ in range(5):
        candidates.update(straight(3.0), Pull(ahead, (0.3, 0.0)), settings, 0.25, rng)
    assert len(candidates.bands) == 2 and candidates.best is not None
    middle = [float(np.interp(1.5, *one.band.poses[:, :2].T)) for one in candidates.bands]
    assert min(middle) < -0.1 < 0.4 < max(middle)
    costs = [one.cost(settings) for one in candidates.bands]
    assert candidates.best is candidates.bands[int(np.argmin(costs))]
    assert np.interp(1.5, *candidates.best.band.poses[:, :2].T) < 0.0


def test_a_rejected_best_gives_way_unless_it_was_driven_before() -> None:
    settings, rng = settings_of(), np.random.default_rng(3)
    candidates, pull = BandCandidates(), Pull(discs((1.5, 0.1, 0.2)), (0.3, 0.0))
    candidates.update(straight(3.0), pull, settings, 0.25, rng)
    first = candidates.best
    assert len(candidates.bands) == 2
    candidates.reject_best(settings)
    assert candidates.best is not None and candidates.best is not first
    candidates.update(straight(3.0), pull, settings, 0.25, rng)
    while candidates.best is not None:
        candidates.update(straight(3.0), pull, settings, 0.25, rng)
        candidates.reject_best(settings)
    assert candidates.best is None


def test_detours_are_dropped() -> None:
    settings, x = settings_of(), np.linspace(0.0, 2.0, 11)
    ahead, slow, back = (
        BandCandidate(
            Band(np.column_stack([sign * x, 0.0 * x, 0.0 * x]), np.full(10, step)), np.zeros(0)
        )
        for sign, step in ((1.0, 0.3), (1.0, 1.0), (-1.0, 0.3))
    )
    candidates = BandCandidates()
    candidates.bands, candidates.best = [ahead, slow, back], ahead
    candidates._drop_detours(settings)
    assert candidates.bands == [ahead]
    candidates.bands = [ahead, slow, back]
    candidates._drop_detours(
        settings_of(
            detours_orientation_tolerance=4.0, max_ratio_detours_duration_best_duration=4.0
        )
    )
    assert candidates.bands == [ahead, slow, back]


def test_a_parameter_file_of_the_original_is_read(tmp_path: Path) -> None:
    given = """
controller_server:
  ros__parameters:
    controller_plugins: ["FollowPath"]
    FollowPath:
      plugin: "teb_local_planner::TebLocalPlannerROS"
      teb_autosize: True
      max_vel_x: 0.26
      max_vel_y: 0.0
      footprint_model: {type: "circular", radius: 0.2}
      enable_multithreading: True
      max_number_classes: 3
"""
    file = tmp_path / "nav2_params.yaml"
    file.write_text(given)
    made = read_params_file(file).make_controller()
    assert isinstance(made, TEB)
    assert (made.max_vel_x, made.robot_radius, made.max_number_classes) == (0.26, 0.2, 3)
    for old, new, message in (
        ("max_vel_y: 0.0", "max_vel_y: 0.1", "max_vel_y is 0.1"),
        ('"circular"', '"two_circles"', "footprint_model.type"),
        ("max_number_classes", "max_number_clases", "did you mean 'max_number_classes'"),
    ):
        file.write_text(given.replace(old, new))
        with pytest.raises(WideberthError, match=message):
            read_params_file(file).make_controller()


def test_lethal_cells_become_points_but_for_the_last_row_and_column() -> None:
    cells = np.zeros((4, 5), np.uint8)
    cells[1, 2] = cells[2, 0] = cells[3, 1] = cells[0, 4] = LETHAL
    cells[0, 0] = 253
    points = lethal_points(Costmap(cells, 0.5, (1.0, 2.0)))
    assert points.tolist() == [[1.25, 3.25], [2.25, 2.75]]


def test_the_plan_is_cut_and_faces_where_it_goes_on() -> None:
    plan = np.column_stack([np.arange(41) * 0.1, np.zeros(41), np.full(41, 2.0)])
    plan[11:, 1] = np.arange(30) * 0.1 + 0.1
    tick = tick_of(plan, [])
    cut = local_plan(tick, settings_of(max_global_plan_lookahead_dist=0.85))
    assert len(cut) == 10 and cut[0] == pytest.approx(plan[0])
    assert cut[-1, 2] == pytest.approx(np.angle(1.0 + np.exp(0.25j * pi) * 2.0), abs=1e-9)
    whole = local_plan(replace(tick, plan=plan[:1], goal=plan[0]), settings_of())
    assert whole.shape == (2, 3) and whole[1, 2] == 2.0


def test_commands_keep_the_limits() -> None:
    settings = settings_of()
    assert saturated((0.8, 2.0), settings) == (0.4, 1.0)
    assert saturated((-0.8, -0.5), settings) == (-0.2, -0.5)
    both = saturated((0.8, 0.5), settings_of(use_proportional_saturation=True))
    assert both == pytest.approx((0.4, 0.25))


def test_refusals_are_answers() -> None:
    teb = teb_of()
    empty = replace(tick_of(straight(2.0), []), plan=np.zeros((0, 3)))
    assert teb.velocity(empty).error == INVALID_PATH
    inside = teb.velocity(tick_of(straight(2.0), [(0.0, 0.0, 0.3)]))
    assert inside.error == NO_VALID_CONTROL and "stand" in inside.reason
    unknown = replace(tick_of(straight(2.0), []), pose=np.array([np.nan, 0.0, 0.0]))
    assert teb.velocity(unknown).twist is None
    assert teb.velocity(tick_of(straight(2.0), [], speed=(np.nan, 0.0))).twist is None
    assert teb.velocity(tick_of(np.zeros((2, 3)), [])).twist is None  # two equal poses
    teb.limit_speed(1.0, True)
    assert "slow" in teb.velocity(tick_of(straight(2.0), [])).reason
    teb.limit_speed(0.0, False)
    assert teb.velocity(tick_of(straight(2.0), [])).twist is not None


def test_a_speed_limit_lowers_the_band() -> None:
    teb = teb_of()
    teb.limit_speed(50.0, True)
    answer = teb.velocity(tick_of(straight(2.0), [], speed=(0.4, 0.0)))
    assert answer.twist is not None and answer.twist.linear[0] <= 0.2


def test_wrong_parameters_are_named() -> None:
    with pytest.raises(WideberthError, match=r"teb\.max_vel_x"):
        TEB(max_vel_x=0.0)
    with pytest.raises(WideberthError, match=r"teb\.min_samples"):
        TEB(min_samples=2)
    with pytest.raises(WideberthError, match=r"teb\.weight_obstacle"):
        TEB(weight_obstacle=-1.0)


def test_swaying_is_noticed_and_one_sense_kept() -> None:
    sway = _OscillationDetector(TebParameters())
    senses = []
    for k in range(400):
        sway.commanded(0.0, 0.2 if k // 5 % 2 else -0.2)
        senses.append(sway.turn(0.05 * k, 0.1))
    assert senses[98] == 0 and senses[120] == 1
    for k in range(400, 900):
        sway.commanded(0.4, 0.0)
        senses.append(sway.turn(0.05 * k, -0.1))
    assert senses[-1] == 0
    calm = _OscillationDetector(TebParameters(oscillation_recovery=False))
    assert {calm.turn(0.05 * k, 0.1) for k in range(300)} == {0}


def test_a_disc_on_the_way_is_passed_and_the_goal_reached() -> None:
    poses, near = drive(teb_of(), [(2.0, 0.05, 0.3)], 4.0)
    assert np.hypot(poses[-1][0] - 4.0, poses[-1][1]) < 0.25
    assert min(near) > 0.3


def test_a_moving_disc_is_given_way_only_if_it_is_told() -> None:
    crossing = np.array([[2.0, -1.8, 0.3, 0.0, 0.35]])
    _, told = drive(teb_of(include_costmap_obstacles=False), [], 4.0, crossing)
    _, untold = drive(
        teb_of(include_costmap_obstacles=False, use_dynamic_obstacles=False), [], 4.0, crossing
    )
    assert min(told) > 0.3 > min(untold)


def test_what_moves_is_taken_out_of_the_costmap() -> None:
    pose, settings = np.zeros(3), settings_of()
    both = [(1.0, 0.0, 0.2), (1.0, 1.5, 0.2)]
    walking = np.array([[1.0, 0.0, 0.2, 0.3, 0.0], [1.0, 1.5, 0.2, 0.0, 0.0]])
    tick = tick_of(straight(2.0), both, pose, moving=walking)
    discs = teb_of()._moving(tick)
    assert discs.tolist() == [[1.0, 0.0, 0.2, 0.3, 0.0]]
    found = obstacles_of(tick, discs, settings)
    assert int(found.moving.sum()) == 1 and found.places[found.moving].tolist() == [[1.0, 0.0]]
    assert (found.places[~found.moving][:, 1] > 1.2).all() and len(found.places) > 30
    without = obstacles_of(tick, np.zeros((0, 5)), settings)
    assert (without.places[:, 1] < 0.3).any() and not without.moving.any()


def test_equal_ticks_have_equal_answers_after_a_reset() -> None:
    teb, rows = teb_of(), [(1.2, 0.1, 0.2)]
    ticks = [tick_of(straight(3.0), rows, time=0.05 * k, speed=(0.2, 0.0)) for k in range(6)]
    runs = []
    for _ in range(2):
        runs.append([teb.velocity(tick).twist for tick in ticks])
        teb.reset()
    assert all(one is not None for one in runs[0])
    assert [(one.linear, one.angular) for one in runs[0] if one] == [
        (one.linear, one.angular) for one in runs[1] if one
    ]


def test_a_filter_shorter_than_a_tick_notices_nothing() -> None:
    for duration in (0.0, 0.02):
        teb = TEB(oscillation_filter_duration=duration)
        assert teb.velocity(tick_of(straight(1.0), [])).twist is not None


@pytest.mark.parametrize("factors", [(1.5, 5.0), (3.0, 2.0)])
def test_obstacles_beyond_the_reach_of_a_band_are_left_out_first(
    factors: tuple[float, float],
) -> None:
    rng = np.random.default_rng(4)
    settings = settings_of(
        min_obstacle_dist=0.3,
        obstacle_association_force_inclusion_factor=factors[0],
        obstacle_association_cutoff_factor=factors[1],
    )
    poses = rng.uniform((0.0, -0.5, -3.0), (3.0, 0.5, 3.0), (8, 3))
    places, reach = rng.uniform(-8.0, 8.0, (600, 2)), rng.uniform(0.0, 0.4, 600)
    wanted: list[tuple[int, int]] = []
    for k, (x, y, yaw) in enumerate(poses):
        sides: dict[bool, list[tuple[float, int]]] = {True: [], False: []}
        for m, (px, py) in enumerate(places):
            apart = np.hypot(px - x, py - y) - reach[m]
            if apart < 0.3 * factors[0]:
                wanted.append((k, m))
            elif apart <= 0.3 * factors[1]:
                sides[np.cos(yaw) * py - np.sin(yaw) * px > 0.0].append((apart, m))
        wanted += [(k, min(sides[left])[1]) for left in (True, False) if sides[left]]
    pose, which = associated(poses, places, reach, settings)
    assert list(zip(pose.tolist(), which.tolist(), strict=True)) == wanted and len(wanted) > 8
    for none in (places[:0], places + 100.0):
        pose, which = associated(poses, none, reach[: len(none)], settings)
        assert len(pose) == len(which) == 0


def test_what_is_far_from_a_band_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    hypot_of = np.hypot

    def noted(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        sizes.append(np.size(x))
        return hypot_of(x, y)

    monkeypatch.setattr(np, "hypot", noted)
    poses, far = straight(1.0), np.random.default_rng(5).uniform(9.0, 99.0, (20_000, 2))
    associated(poses, far, np.zeros(len(far)), settings_of())
    assert max(sizes, default=0) <= len(far)
