"""Three dimensions in closed loop: robot, scenario, every predictor, every region, the figure."""

from dataclasses import replace
from math import nan
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.experiments.drawing.episodes_3d import draw_flight, ellipsoid, expected
from wideberth.experiments.engine.closed_loop import play
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.planner_parts import PlannerParts, area_ratio
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import sweep
from wideberth.framework.numerics.integration import runge_kutta
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path as Way
from wideberth.framework.values.path_progress import PathProgress
from wideberth.framework.values.plan import Rung
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minimum_area import MinimumArea
from wideberth.robots.holonomic_3d import Holonomic3D
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.summary import robot_rows, summarise
from wideberth.simulation.scenarios import crossing_3d
from wideberth.simulation.scenarios.crossing_3d import Crossing3D
from wideberth.solvers.riccati.solver import Riccati

SLOW = {"risk_contour"}  # half a minute: its constraint integrates the collision probability
REGIONS = [
    name for name in names("regions") if 3 in load("regions", name).dimensions and name not in SLOW
]
STEPS = {"whitened_box": 5}  # of which every iteration takes ten times as long
UNSAFE = {"du_toit"}  # the density at the robot's centre says little about a ball of 0.8 m
SHORT = Crossing3D(passers=2)
PREDICTORS = {
    "constant_velocity": {"acceleration_density": 0.007},
    "kalman": {"acceleration_density": 0.007},
    "oracle": {"spread": 0.03},
}
PLANE = {
    "coordinated_turn", "game", "mixture_density", "reacting_people", "single_gaussian",
    "social_force", "turning",
}  # fmt: skip
"""Predictors that leave space to their fallback, and say so."""


def shipped(*overrides: str) -> PlannerParts:
    experiment = read_experiment("flight", list(overrides))[0]
    assert isinstance(experiment, PlannerParts)
    return experiment


def flown(flight: PlannerParts, **parts: object) -> Episode:
    """Play the short scenario under the shipped planner with some parts exchanged."""
    planner = flight.planner
    assert isinstance(planner, Planner)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(crossing_3d, "REACH", (3.0, 3.0))
        patch.setattr(crossing_3d, "LAG", (0.2, 0.4))
        return play(SHORT, flight.robot, replace(planner, **parts), flight.settings, 1)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def flight() -> PlannerParts:
    return shipped()


@pytest.fixture(scope="module")
def episode(flight: PlannerParts) -> Episode:
    return flown(flight, solver=Riccati())


def rotation(seed: int) -> np.ndarray:
    turned, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return turned * np.sign(np.linalg.det(turned))


def test_robot_flies_the_parabola_and_keeps_limits_by_norm() -> None:
    robot = Holonomic3D(max_speed=1.5, max_acceleration=1.5)
    start = (0.0, 0.0, 1.0, 0.1, 0.2, -0.1)
    end = runge_kutta(robot.derivative, start, (0.3, -0.1, 0.2), 2.0)
    assert end == pytest.approx((0.8, 0.2, 1.2, 0.7, 0.0, 0.3), abs=1e-14)
    pushed = robot.drive((0.0,) * 6, Twist((2.0, 3.0, 6.0)), 0.01)
    assert pushed == pytest.approx(1.5 / 7.0 * np.array([2.0, 3.0, 6.0]))
    assert robot.drive((0.0,) * 6, Twist((2.0, 3.0, 6.0)), 100.0) == pytest.approx(
        0.015 / 7.0 * np.array([2.0, 3.0, 6.0])
    )
    on_sphere = (0.0, 0.0, 0.0, *(1.5 / 7.0 * np.array([2.0, 3.0, 6.0])))
    assert robot.constraints(on_sphere, pushed) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_robot_knows_no_preferred_direction() -> None:
    """Turned about any axis, not the vertical one alone as in the contract check."""
    robot, turn = Holonomic3D(), rotation(3)
    state, wanted = np.array([1.0, 2.0, 3.0, 0.4, -0.3, 0.2]), np.array([-0.9, 1.1, 0.8])
    turned = np.concatenate([turn @ state[:3], turn @ state[3:]])
    for duration in (0.05, 4.0):
        plain = robot.drive(tuple(state), Twist(tuple(wanted)), duration)
        other = robot.drive(tuple(turned), Twist(tuple(turn @ wanted)), duration)
        assert other == pytest.approx(turn @ plain)


@pytest.mark.parametrize("velocity", [(1.0, 0.0, 0.0), (0.6, 0.0, 0.8), (0.0, 0.0, 1.0)])
def test_side_steps_leave_the_way(velocity: tuple[float, float, float]) -> None:
    robot = Holonomic3D()
    start = np.array(robot.state_at(Pose((0.0, 0.0, 0.0)), Twist(velocity)))
    left, right = (np.array(sweep(robot, start, name, 1.0).linear) for name in ("left", "right"))
    across = np.cross(velocity, left)
    assert np.linalg.norm(across) > 0.3
    assert np.cross(velocity, right) == pytest.approx(-across)


def test_progress_on_a_helix_needs_the_height() -> None:
    """Seen from above the turns lie on each other."""
    angle = np.linspace(0.0, 6.0 * np.pi, 400)
    helix = Way(np.stack([2.0 * np.cos(angle), 2.0 * np.sin(angle), 0.3 * angle], axis=1))
    progress = PathProgress(helix)
    for arc in np.arange(0.0, helix.length, 0.7):
        progress, found = progress.advanced(helix.at(np.array(arc)))
        assert found == pytest.approx(arc, abs=1e-9)
    ahead = lay_reference(helix, 5.0, 1.0, 8, 0.3)
    assert np.linalg.norm(ahead.direction, axis=1) == pytest.approx(1.0)
    climb = 0.3 / np.hypot(2.0, 0.3)
    assert ahead.direction[:, 2] == pytest.approx(climb, rel=1e-3)


def test_scenario_meets_in_the_origin_with_the_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crossing_3d, "LAG", (0.7, 0.7))
    scene = Crossing3D()
    for seed in range(20):
        first, second = scene.cast(seed).placements
        waits = [np.linalg.norm(one.path.points[0]) / one.speed for one in (first, second)]
        assert waits[1] - waits[0] == pytest.approx(0.7) or waits[0] - waits[1] == pytest.approx(
            0.7
        )
        for one in (first, second):
            assert np.linalg.norm(np.cross(*one.path.points)) == pytest.approx(0.0, abs=1e-9)
            assert 7.0 <= np.linalg.norm(one.path.goal) <= 9.0
            climb = np.arcsin(one.path.direction(np.zeros(1))[0, 2])
            assert -0.35 <= climb <= 0.35


def test_passers_meet_their_robot_and_leave_the_starts_alone() -> None:
    scene, clock = Crossing3D(), np.linspace(0.0, 25.0, 2501)
    for seed in range(10):
        placements = scene.cast(seed).placements
        passers = scene.bystanders(np.random.default_rng(seed), placements)
        assert len(passers) == 4 and len({one.name for one in passers}) == 4
        assert repr(passers) == repr(scene.bystanders(np.random.default_rng(seed), placements))
        for number, passer in enumerate(passers):
            target = placements[number % 2]
            apart = np.linalg.norm(passer.at(clock) - target.path.at(target.speed * clock), axis=1)
            assert (
                apart.min() <= np.sqrt(2.0) * crossing_3d.SWAY + 0.02
            )  # how far the sway reaches
            for one in placements:
                gap = passer.at(clock[:300]) - one.path.at(one.speed * clock[:300])
                assert np.linalg.norm(gap, axis=1).min() > 1.1


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Crossing3D(passers=-1), "passers"),
        (lambda: Holonomic3D(max_acceleration=0.0), "holonomic_3d.max_acceleration"),
        (lambda: shipped("regions={}", "predictors={}"), "at least one"),
        (lambda: shipped("show=[10]"), r"show is \[10\]"),
    ],
)
def test_bad_values_name_themselves(build: object, message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        build()  # type: ignore[operator]


def test_no_room_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {
        "DRAWS": 50, "REACH": (3.0, 3.0), "PASSER_RADIUS": 1.0, "SHARE": (0.5, 0.5)
    }.items():  # fmt: skip
        monkeypatch.setattr(crossing_3d, name, value)
    crowd = Crossing3D(passers=60)
    with pytest.raises(WideberthError, match="passer 1 of 60 found no room"):
        crowd.cast(0)


def test_passers_are_drawn_anew_where_the_last_finds_no_room() -> None:
    # The first five that this seed draws leave no room for a sixth.
    assert len(Crossing3D(passers=6).cast(2).bystanders) == 6


def test_levels_are_those_of_three_degrees_of_freedom(episode: Episode) -> None:
    plans = [plan for log in episode.robots for plan in log.plans if plan.level.size]
    assert len(plans) > 20
    for plan in plans:
        assert plan.target == pytest.approx(np.sqrt(chi2.ppf(0.95, 3)))
        known = plan.level == pytest.approx(np.sqrt(chi2.ppf(0.95, 3)))
        assert known or plan.rung is not Rung.OPTIMAL
        assert plan.content == pytest.approx(chi2.cdf(plan.level**2, 3))


def test_episode_is_logged_and_summed_up_in_space(episode: Episode) -> None:
    assert [log.positions.shape[1] for log in episode.agents] == [3] * 4
    assert [log.commands.linear.shape[1] for log in episode.robots] == [3] * 2
    data = episode.to_bytes()
    again = Episode.from_bytes(data)
    assert again.to_bytes() == data and repr(summarise(again)) == repr(summarise(episode))
    row = summarise(episode)
    gaps = [
        np.linalg.norm(a.positions - b.positions, axis=1).min() - a.radius - b.radius
        for a in episode.robots
        for b in episode.agents
        if a is not b
    ]
    assert row["clearance"] == pytest.approx(min(gaps), abs=5e-3)
    for line, log in zip(robot_rows(episode), episode.robots, strict=True):
        until = log.positions[episode.times <= log.reached]
        assert line["length"] == pytest.approx(
            np.linalg.norm(np.diff(until, axis=0), axis=1).sum()
        )
        offset = until - until[0]
        along = log.paths[0][1].direction(np.zeros(1))[0]
        aside = np.linalg.norm(offset - np.outer(offset @ along, along), axis=1)
        assert line["deviation"] == pytest.approx(aside.max(), abs=1e-9)


def test_planner_is_warm_before_its_first_decision(flight: PlannerParts) -> None:
    """The rehearsal in `set_path` went as far as a compiled problem with an obstacle."""
    planner = replace(flight.planner)  # type: ignore[type-var]
    assert isinstance(planner, Planner)
    planner.set_path(SHORT.cast(0).placements[0].path)
    assert planner._services.problems


@pytest.mark.parametrize("name", names("predictors"))
def test_every_predictor_flies(name: str, flight: PlannerParts) -> None:
    predictor = load("predictors", name)(**PREDICTORS.get(name, {}))
    played = flown(flight, predictor=predictor, solver=Riccati())  # at a third of the time
    row = summarise(played)
    assert (row["ended"], row["errors"]) == ("goals", "")
    # The prior of bayesian_var is people's: wide regions, long ways round.
    assert row["time_ratio_worst"] < 2.5
    # Who takes passers-by for standing is flown into by those who make way for nobody.
    assert name == "static" or row["clearance"] > 0.0
    least = 0.3 if name == "var" else 0.0 if name == "cascade" else 0.99
    assert row["named_forecasts"] == 0.0 if name in PLANE else row["named_forecasts"] >= least
    assert name == "static" or row["coverage"] > 0.75
    assert all(p.forecast is None or p.forecast.mean.shape[-1] == 3
               for log in played.robots for p in log.plans)  # fmt: skip


@pytest.mark.parametrize("name", REGIONS)
def test_every_region_flies(name: str, flight: PlannerParts) -> None:
    """With the VAR's covariances, which are not round."""
    region, predictor = load("regions", name)(), load("predictors", "var")()
    played = flown(flight, region=region, predictor=predictor, horizon=STEPS.get(name, 10))
    row = summarise(played)
    assert (row["ended"], row["errors"]) == ("goals", "")
    assert name in UNSAFE or row["clearance"] > 0.0


def test_all_sums_are_one_ball_under_round_covariances(
    episode: Episode, flight: PlannerParts
) -> None:
    assert area_ratio(episode, MahalanobisEllipse(), 0.05) == pytest.approx(1.0, abs=1e-6)
    other = flown(flight, predictor=load("predictors", "var")(), solver=Riccati())
    assert area_ratio(other, MahalanobisEllipse(), 0.05) < 0.98  # inside the sum
    assert area_ratio(other, MinimumArea(), 0.05) > 1.0  # around it


def test_ellipsoid_and_expectation(episode: Episode) -> None:
    root = np.array([[0.5, 0.0, 0.0], [0.2, 0.1, 0.0], [-0.1, 0.3, 0.2]])
    mean, covariance = np.array([1.0, -2.0, 0.5]), root @ root.T
    offset = ellipsoid(GaussianObstacle(mean, covariance), 0.1) - mean
    square = np.einsum("...i,ij,...j->...", offset, np.linalg.inv(covariance), offset)
    assert square == pytest.approx(chi2.ppf(0.9, 3))
    plan = next(plan for plan in episode.robots[0].plans if plan.tracked)
    assert plan.forecast is not None
    name = plan.tracked[-1]
    there = expected(plan, name, plan.stamp + 2.5 * plan.dt)
    assert there is not None
    assert there.mean == pytest.approx(plan.forecast.mean[-1, 0, 1:3].mean(axis=0))
    assert there.covariance == pytest.approx(plan.forecast.covariance[-1, 0, 1:3].mean(axis=0))
    assert expected(plan, "nobody", plan.stamp + plan.dt) is None
    assert expected(plan, name, plan.stamp + 100.0) is None


def test_flat_episodes_are_refused(episode: Episode) -> None:
    flat = tuple(replace(log, positions=log.positions[:, :2]) for log in episode.agents)
    with pytest.raises(WideberthError, match="three dimensions"):
        draw_flight(replace(episode, agents=flat), tail=0.05, lead=1.0)
    for bad in ({"tail": 0.0, "lead": 1.0}, {"tail": 0.05, "lead": nan}):
        with pytest.raises(WideberthError):
            draw_flight(episode, **bad)


def test_quick_run_keeps_apart_and_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crossing_3d, "REACH", (3.0, 3.0))  # short ways, so that it is quick
    experiment = shipped("scenarios.flight.passers=2", "planner.horizon=10")
    result = run(experiment, tmp_path / "flight", quick=True)
    rows = result.rows
    assert [row["region"] for row in rows] == 2 * ["exact_sum", "paper_ellipsoid"]
    assert not any(row["collision"] or row["deadlock"] for row in rows)
    ball, same, exact, paper = experiment.quick().summary(rows)
    assert ball["area_ratio"] == 1.0 and same["area_ratio"] == pytest.approx(1.0, abs=1e-6)
    assert exact["area_ratio"] == 1.0 > paper["area_ratio"]
    files = draw(result.folder)
    wanted = {"planner_parts", "flight_kalman", "flight_var"}
    assert {file.stem for file in files} == wanted and len(files) == 6
    assert all(file.stat().st_size > 1000 for file in files)
