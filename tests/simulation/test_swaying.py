"""Noise on the motion of people: as large as stated, repeatable, and theirs alone."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.framework.plugins.config import build
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import check_cast, run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.scenarios import pedestrian_corridor
from wideberth.simulation.scenarios.pedestrian_corridor import (
    CROWDS,
    FIXED,
    HEAD_ROOM,
    PedestrianCorridor,
    Swaying,
    made_to_sway,
)
from wideberth.simulation.scenarios.placing import corridor_walls
from wideberth.simulation.sensing.channel import Channel

BODY = HolonomicVelocity(radius=0.4, max_speed=0.7)
FAR = Path(np.array([[0.0, 0.0], [1e6, 0.0]]))


def straight(period=0.1):
    return ConstantVelocityController(BODY, period=period, reference_speed=0.7)


def test_contract():
    made = Swaying(straight(), 0.3, 5)
    check_controller(made, replace(BODY, max_speed=BODY.max_speed + HEAD_ROOM * made.deviation))


@pytest.mark.parametrize("period", [0.05, 0.1, 0.2])
def test_positions_spread_as_stated(period):
    """The walk of the original: s every 0.05 s, so s^2 0.05 t after t."""
    moved = []
    for seed in range(60):
        made = Swaying(straight(period), 0.3, seed)
        made.set_path(FAR)
        stamps = period * np.arange(round(2.0 / period))
        told = [made.command(Observation(t, np.zeros(2), ())).linear for t in stamps]
        moved.append(period * np.sum(told, axis=0) - [1.4, 0.0])
    square = np.sum(np.square(moved)) / (0.3**2 * 0.05 * 2.0)
    assert 1e-3 < stats.chi2(120).cdf(square) < 1 - 1e-3
    assert stats.pearsonr(*np.transpose(moved)).pvalue > 1e-3


def test_without_noise_it_is_the_controller():
    plain, made = straight(), Swaying(straight(), 0.0, 7)
    for one in (plain, made):
        one.set_path(FAR)
    seen = Observation(1.3, np.array([2.0, 1.0]), ())
    assert made.command(seen) == plain.command(seen)
    assert made.period == plain.period and made.last_plan is None


def test_the_body_has_the_speed_for_it():
    """In an episode: mean speed along the way, and the spread, are not clipped."""
    settings = Settings(time_limit=2.0, plant_step=0.1, history=0.0, channel=Channel(noise=0.0))
    robot = RobotAgent("robot", BODY, straight(), FAR, 0.7)
    crowd = [
        made_to_sway(RobotAgent(f"p {k}", BODY, straight(), FAR, 0.7, person=True), 0.8, k)
        for k in range(60)
    ]
    episode = run_episode([robot, *crowd], settings)
    moved = np.array([log.positions[-1] for log in episode.agents[1:]]) - [1.4, 0.0]
    square = np.sum(np.square(moved)) / (0.8**2 * 0.05 * 2.0)
    assert 1e-3 < stats.chi2(120).cdf(square) < 1 - 1e-3
    assert np.abs(moved.mean(axis=0)).max() < 4.0 * 0.8 * np.sqrt(0.05 * 2.0 / 60)


def test_it_changes_nothing_else_of_a_cast():
    for layout in ("random", "8_gaussian"):
        calm, noisy = (
            PedestrianCorridor(layout=layout, process_noise=noise).cast(4).people
            for noise in (0.0, 0.3)
        )
        for one, other in zip(calm, noisy, strict=True):
            assert np.array_equal(one.path.points, other.path.points)
            assert (one.name, one.speed, one.radius) == (other.name, other.speed, other.radius)
        made = [one.controller for one in noisy if isinstance(one.controller, Swaying)]
        assert len({one.seed for one in made}) == len(made) == len(noisy)


@pytest.mark.parametrize("layout", ["random", "16_random", *FIXED])
def test_people_come_anew_in_every_layout(layout, monkeypatch):
    """The number of people stays, and someone comes anew."""
    hurried = {name: replace(crowd, speed=(4.0, 5.0)) for name, crowd in CROWDS.items()}
    monkeypatch.setattr(pedestrian_corridor, "CROWDS", hurried)
    scene = PedestrianCorridor(layout=layout, respawn=True, process_noise=0.3)
    cast = scene.cast(1)
    assert all(one.respawn for one in cast.people)
    way = Path(np.array([[-30.0, -50.0], [-30.0, 50.0]]))
    robot = RobotAgent("robot", BODY, straight(), way, 0.7)
    blind = [  # without neighbours and noise, so that it is quick
        replace(one, controller=ConstantVelocityController(one.robot, 0.2, one.speed))
        for one in cast.people
    ]
    settings = Settings(time_limit=14.0, plant_step=0.2, history=0.0, deadlock_after=20.0)
    settings = replace(settings, goal_tolerance=0.5)
    episode = run_episode([robot, *blind], settings)
    people = [log for log in episode.agents if log.kind == "person"]
    present = np.sum([np.isfinite(log.positions[:, 0]) for log in people], axis=0)
    assert (present == len(cast.people)).all() and len(people) > len(cast.people)


@pytest.mark.parametrize("region", [None, "separating_line"])
def test_walls_need_the_static_region_of_who_sways(region):
    """Noise hides neither that a planner has no static region nor that a rival needs none."""
    parts: Any = {
        "region": "half_plane",
        "predictor": "static",
        "level": "fixed",
        "solver": "riccati",
    }
    planner = build(
        "controllers", {"type": "mpc", "robot": BODY, "static_region": region, **parts}
    )
    swayed, rival = (
        made_to_sway(RobotAgent(name, BODY, controller, FAR, 0.7, person=True), 0.3, 1)
        for name, controller in (("p", planner), ("q", straight()))
    )
    robot = RobotAgent("robot", BODY, straight(), FAR, 0.7)
    walls = corridor_walls(7.0, 0.0, 10.0)
    check_cast([robot, rival], (), (), walls)
    if region is None:
        with pytest.raises(WideberthError, match=r"planner of \['p'\] has no static_region"):
            check_cast([robot, swayed], (), (), walls)
    else:
        check_cast([robot, swayed], (), (), walls)


@pytest.mark.parametrize("bad", [{"process_noise": -0.1}, {"seed": -1}, {"update": 0.0}])
def test_bad_input(bad):
    with pytest.raises(WideberthError, match=f"swaying.{next(iter(bad))}"):
        Swaying(straight(), **{"process_noise": 0.3, "seed": 0, **bad})
