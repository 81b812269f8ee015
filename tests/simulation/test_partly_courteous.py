"""Scenario `partly_courteous`: who sees the robot, and what does not change with it."""

import numpy as np
import pytest

from wideberth import build
from wideberth.experiments.engine.closed_loop import play
from wideberth.framework.controller import Controller
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.scenarios.base import Scenario
from wideberth.simulation.scenarios.hallway import Hallway
from wideberth.simulation.scenarios.partly_courteous import PartlyCourteous
from wideberth.simulation.scenarios.random_crowd import RandomCrowd
from wideberth.simulation.sensing.channel import Channel
from wideberth.tests.helpers.straight import Straight

QUIET = Settings(time_limit=4.0, plant_step=0.25, history=0.0, channel=Channel(noise=0.0))
BODY = HolonomicVelocity(radius=0.3, max_speed=1.0)


def agent(name: str, y: float, **more: bool) -> RobotAgent:
    path = Path(np.array([[0.0, y], [2.0, y]]))
    return RobotAgent(name, BODY, Straight(), path, 0.0, **more)


def test_who_lacks_courtesy_sees_people_and_no_robot() -> None:
    people = [agent("p", 4.0, person=True, courteous=False), agent("q", 6.0, person=True)]
    robot = agent("r", 0.0)
    run_episode([robot, *people], QUIET)
    seen = [one.controller.first_seen for one in (robot, *people)]  # type: ignore[attr-defined]
    assert [set(one) for one in seen] == [{"p", "q"}, {"q"}, {"r", "p"}]


def test_a_robot_sees_robots() -> None:
    with pytest.raises(WideberthError, match="only people"):
        agent("r", 0.0, courteous=False)


def driven(scenario: Scenario) -> list[Array]:
    robot: Robot = build("robots", {"type": "holonomic_velocity", "radius": 0.25})
    straight: Controller = build("controllers", {"type": "constant_velocity", "robot": robot})
    episode = play(scenario, robot, straight, QUIET, 104)
    return [log.positions for log in episode.agents]


def test_all_who_see_it_are_the_scenario_and_none_are_an_invisible_robot() -> None:
    hall = Hallway()
    alike = zip(driven(hall), driven(PartlyCourteous(hall, 1.0)), strict=True)
    assert all(np.array_equal(one, other) for one, other in alike)
    crowd = {"persons": 4, "crowd": {"kinds": {"social_force": {"type": "social_force",
             "robot": {"type": "holonomic_velocity", "radius": 0.3}}}}}  # fmt: skip
    seen: RandomCrowd = build("scenarios", {"type": "random_crowd", **crowd})  # type: ignore[assignment]
    blind = build("scenarios", {"type": "random_crowd", **crowd, "visible": False})
    unseen = [driven(one) for one in (blind, PartlyCourteous(seen, 0.0))]
    assert all(np.array_equal(*pair) for pair in zip(*unseen, strict=True))
    changed = zip(unseen[0], driven(seen), strict=True)
    assert not all(one.shape == two.shape and np.array_equal(one, two) for one, two in changed)


def test_the_courteous_are_nested_and_as_many_as_stated() -> None:
    shares, counts = (0.0, 0.25, 0.5, 1.0), np.zeros(4)
    for seed in range(100, 140):
        casts = [PartlyCourteous(Hallway(head_start=0.0), share).cast(seed) for share in shares]
        polite = [{one.name for one in cast.people if one.courteous} for cast in casts]
        assert polite[0] <= polite[1] <= polite[2] <= polite[3]
        counts += [len(one) for one in polite]
        ways = [[one.path.points for one in cast.people] for cast in casts]
        assert all(np.array_equal(a, b) for own in ways for a, b in zip(own, ways[0], strict=True))
    whole = 3 * 40
    for share, count in zip(shares, counts, strict=True):
        assert abs(count / whole - share) <= 3.0 * np.sqrt(share * (1.0 - share) / whole)


def test_a_furnished_scenario_keeps_its_walls_and_walkers_and_who_sees_the_robot() -> None:
    shelf = {"name": "shelf", "vertices": [[5.0, 5.0], [6.0, 5.0], [6.0, 6.0]]}
    walker = {"way": [[0.0, 8.0], [4.0, 8.0]], "speed": [0.5, 0.6]}
    inner = {"type": "furnished", "scenario": {"type": "random_crowd", "persons": 4},
             "walls": [shelf], "walkers": [walker]}  # fmt: skip
    scene: Scenario = build(
        "scenarios", {"type": "partly_courteous", "scenario": inner, "share": 0}
    )  # type: ignore[assignment]
    cast = scene.cast(0)
    assert [one.name for one in cast.polygons] == ["shelf"]
    assert [one.name for one in cast.bystanders] == ["walker 1"]
    assert cast.people
    assert not any(one.courteous for one in cast.people)


def test_shares_and_scenarios_that_do_not_fit_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"partly_courteous.share is 1.5"):
        PartlyCourteous(share=1.5)
    dense = build("scenarios", {"type": "crowdsimplus"})
    with pytest.raises(WideberthError, match="rules of their own"):
        PartlyCourteous(dense, 0.5).cast(0)  # type: ignore[arg-type]
