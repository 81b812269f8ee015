"""Scenarios with walls and crowds: what is drawn lies where the docstrings say."""

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent, ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.scenarios import antipodal_swap, doorway, pedestrian_corridor
from wideberth.simulation.scenarios.antipodal_swap import AntipodalSwap
from wideberth.simulation.scenarios.corridor import Corridor
from wideberth.simulation.scenarios.doorway import Doorway
from wideberth.simulation.scenarios.overtaking import Overtaking
from wideberth.simulation.scenarios.pedestrian_corridor import FIXED, PedestrianCorridor
from wideberth.simulation.scenarios.placing import wall_distance
from wideberth.simulation.scenarios.random_crowd import RandomCrowd


@pytest.mark.parametrize(("robots", "radius"), [(2, 4.0), (6, 4.0), (7, 4.2), (10, 6.0)])
def test_robots_swap_on_the_circle(
    robots: int, radius: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(antipodal_swap, "ANGLE", (0.0, 0.0))
    cast = AntipodalSwap(robots=robots).cast(0)
    starts = np.array([one.path.points[0] for one in cast.placements])
    goals = np.array([one.path.goal for one in cast.placements])
    assert goals == pytest.approx(-starts)
    assert np.hypot(*starts.T) == pytest.approx(np.full(robots, radius))
    turns = np.unwrap(np.arctan2(starts[:, 1], starts[:, 0]))
    assert np.diff(turns) == pytest.approx(np.full(robots - 1, 2.0 * np.pi / robots))


def test_angles_and_phases_are_uniform(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(antipodal_swap, "ANGLE", (-0.04, 0.08))
    swap = AntipodalSwap(robots=8)
    placed = [one for seed in range(60) for one in swap.cast(seed).placements]
    starts = np.array([one.path.points[0] for one in placed])
    even = np.tile(2.0 * np.pi * np.arange(8) / 8, 60)
    angle = np.arctan2(starts[:, 1], starts[:, 0]) - even
    angle = np.mod(angle + np.pi, 2.0 * np.pi) - np.pi
    assert stats.kstest(angle, stats.uniform(-0.04, 0.12).cdf).pvalue > 1e-3
    assert stats.kstest([one.phase for one in placed], stats.uniform(0, 0.99).cdf).pvalue > 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_the_door_is_reached_with_the_drawn_lag(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    lag = 1.5
    monkeypatch.setattr(doorway, "LAG", (lag, lag))
    for oncoming in ("walker", "robot"):
        scene = Doorway(oncoming=oncoming)
        cast = scene.cast(seed)
        robot = cast.placements[0]
        assert robot.path.points[1].tolist() == [0.0, 0.0]
        other = cast.placements[1] if oncoming == "robot" else cast.bystanders[0]
        assert not isinstance(other, ReplayAgent)
        assert other.path.points[1].tolist() == [0.0, 0.0] and other.path.points[0][0] > 0.0
        times = other.path.arc[1] / other.speed, robot.path.arc[1] / robot.speed
        assert times[0] - times[1] == pytest.approx(lag)
        # The door is 1.2 robots wide: its middle is 0.36 m from the wall.
        assert wall_distance(np.zeros(2), cast.polygons) == pytest.approx(0.36)


def test_the_leader_is_caught_up_with() -> None:
    scene = Overtaking()
    for seed in range(20):
        cast = scene.cast(seed)
        (leader,), (robot,) = cast.bystanders, cast.placements
        assert isinstance(leader, ScriptedAgent)
        gap = leader.path.points[0][0] - robot.path.points[0][0]
        assert 2.5 <= gap <= 4.0 and 0.2 <= leader.speed <= 0.4
        assert gap / (robot.speed - leader.speed) < robot.path.length / robot.speed
        assert wall_distance(np.array([5.0, 0.0]), cast.polygons) == pytest.approx(1.5)


def test_people_come_the_other_way() -> None:
    for seed in range(10):
        cast = Corridor(persons=5).cast(seed)
        assert len(cast.people) == 5
        for one in cast.people:
            step = one.path.goal - one.path.points[0]
            assert step == pytest.approx([-28.0, 0.0])
            assert 0.5 <= one.speed <= 1.0 and 0.2 <= one.radius <= 0.3
            assert wall_distance(one.path.points[0], cast.polygons) >= one.radius + 0.1 - 1e-9


def test_the_crowd_has_the_stated_density_and_speeds() -> None:
    pytest.importorskip("pyrvo")
    crowd = RandomCrowd(persons=20, density=0.2)
    assert crowd.side == pytest.approx(10.0)
    people = [one for seed in range(20) for one in crowd.cast(seed).people]
    places = np.array([one.path.points for one in people])
    assert np.abs(places).max() <= 5.0
    legs = np.linalg.norm(np.diff(places, axis=1), axis=2)
    assert legs.min() >= 5.0
    speeds = np.array([one.speed for one in people])
    inside = speeds[(speeds > 0.82) & (speeds < 1.86)]
    cut = stats.truncnorm(-2.0, 2.0, loc=1.34, scale=0.26)
    assert stats.kstest(inside, cut.cdf).pvalue > 1e-3
    assert stats.binomtest(len(speeds) - len(inside), len(speeds), 0.0455).pvalue > 1e-3
    radii = [one.radius for one in people]
    assert stats.kstest(radii, stats.uniform(0.2, 0.1).cdf).pvalue > 1e-3
    kinds = [type(one.controller).__name__ for one in people]
    names = "Orca", "SocialForceController", "ConstantVelocityController"
    counts = [kinds.count(name) for name in names]
    assert sum(counts) == 400 and stats.chisquare(counts).pvalue > 1e-3


@pytest.mark.parametrize("seed", [100, 101])
def test_people_of_a_crowd_go_from_goal_to_goal(seed: int) -> None:
    """While the robot waits outside, they still walk when it could have been there."""
    pytest.importorskip("pyrvo")
    crowd = RandomCrowd(persons=8, density=0.1)
    cast = crowd.cast(seed)
    far = Path(np.array([[-90.0, 0.0], [-80.0, 0.0]]))
    robot = HolonomicVelocity(0.3, 0.7)
    waits = RobotAgent("robot", robot, ConstantVelocityController(robot, 0.25, 0.01), far, 0.0)
    last = 1.4 * crowd.side / cast.placements[0].speed
    settings = Settings(time_limit=last, history=0.0, deadlock_after=2.0 * last)
    episode = run_episode([waits, *cast.people], settings)
    kinds = {one.name: type(one.controller).__name__ for one in cast.people}
    assert {"Orca", "ConstantVelocityController"} <= set(kinds.values())
    for one in cast.people:
        log = episode.agent(one.name)
        assert np.linalg.norm(log.positions[-1] - one.path.goal) > 0.5  # nobody is at the last one
        if kinds[one.name] in ("Orca", "ConstantVelocityController"):
            away = np.linalg.norm(log.positions - one.path.points[1], axis=1)
            assert away.min() < 0.6  # they cut the corner
            assert np.median(log.speeds) > 0.6 * one.speed


@pytest.mark.parametrize(
    ("layout", "onward", "ahead", "against", "least_speed", "more_speed"),
    [
        ("random", 30.0, (4.0, 8.0, -3.0, 6.0), (20.0, 15.0, -3.0, 6.0), 1.14, 0.52),
        ("16_random", 40.0, (2.0, 8.0, -3.0, 4.0), (38.0, 6.0, -1.0, 4.0), 0.7, 0.6),
    ],
)
def test_two_groups_share_the_long_corridor(
    layout, onward, ahead, against, least_speed, more_speed
) -> None:
    starts, steps, speeds = [], [], []
    for seed in range(40):
        for one in PedestrianCorridor(layout=layout, pedestrians=4).cast(seed).people:
            starts.append(one.path.points[0])
            steps.append(one.path.goal - one.path.points[0])
            speeds.append(one.speed)
    x, y = np.array(starts).T
    along = np.array(steps)[:, 0] > 0.0
    assert np.abs(steps) == pytest.approx(np.tile([onward, 0.0], (len(steps), 1)))
    assert stats.binomtest(int(along.sum()), len(along), 0.5).pvalue > 1e-3
    for group, box in ((along, ahead), (~along, against)):
        assert stats.kstest(x[group], stats.uniform(*box[:2]).cdf).pvalue > 1e-3
        assert stats.kstest(y[group], stats.uniform(*box[2:]).cdf).pvalue > 1e-3
    assert stats.kstest(speeds, stats.uniform(least_speed, more_speed).cdf).pvalue > 1e-3


def test_both_ways_is_fixed() -> None:
    for layout, speed, count in (("both_ways", 1.3, 4), ("8_gaussian", 0.7, 8)):
        for seed in (0, 7):
            cast = PedestrianCorridor(layout=layout).cast(seed)
            ways = tuple(tuple(map(tuple, one.path.points.tolist())) for one in cast.people)
            assert ways == FIXED[layout].ways and {one.speed for one in cast.people} == {speed}
            assert len(ways) == count and len(cast.polygons) == (2 if count == 4 else 0)
    assert len(PedestrianCorridor().cast(0).people) == 8
    assert len(PedestrianCorridor(layout="16_random").cast(0).people) == 16
    assert PedestrianCorridor(pedestrians=0).cast(0).people == ()


@pytest.mark.parametrize("layout", FIXED)
def test_the_people_of_a_fixed_layout_do_not_touch(layout, monkeypatch) -> None:
    starts = [start for start, _ in FIXED[layout].ways]
    nearest = min(np.hypot(a[0] - b[0], a[1] - b[1]) for a, b in combinations(starts, 2))
    room = min(0.5 * nearest, min(np.hypot(*start) for start in starts) - 0.325)
    monkeypatch.setattr(pedestrian_corridor, "PEDESTRIAN_RADIUS", room - 1e-6)
    assert PedestrianCorridor(layout=layout).cast(0).people
    words = f"person . of {layout} would touch another body"
    with pytest.raises(WideberthError, match=words):
        PedestrianCorridor(layout=layout, robot_radius=5.0)
    monkeypatch.setattr(pedestrian_corridor, "PEDESTRIAN_RADIUS", room + 1e-6)
    with pytest.raises(WideberthError, match=words):
        PedestrianCorridor(layout=layout)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: AntipodalSwap(robots=1), "robots"),
        (lambda: AntipodalSwap(robots=20, robot_radius=2.0), "20 robots .* overlap"),
        (lambda: AntipodalSwap(robots=80), "take fewer or smaller"),
        (lambda: Doorway(opening=1.0), "does not fit through it"),
        (lambda: Doorway(robot_radius=0.2), "does not fit through it"),
        (lambda: Overtaking(width=1.5), "take a wider corridor"),
        (lambda: Corridor(width=1.0), "take a wider corridor"),
        (lambda: Corridor(persons=80).cast(0), "person .* of 80: take fewer"),
        (lambda: RandomCrowd(density=0.0), "density"),
        (lambda: PedestrianCorridor(pedestrians=400).cast(0), "of 400: take fewer"),
        (lambda: PedestrianCorridor(process_noise=-0.3), "process_noise"),
        (lambda: PedestrianCorridor(layout="8_random"), "16_random"),
        (
            lambda: PedestrianCorridor(layout="both_ways", pedestrians=3),
            "pedestrians is 3, and both_ways lists its people; leave it out, or take random or 16",
        ),
    ],
)
def test_what_cannot_be_placed_says_what_to_change(make, message) -> None:
    with pytest.raises(WideberthError, match=message):
        make()


def test_too_dense_a_crowd_says_so() -> None:
    pytest.importorskip("pyrvo")
    with pytest.raises(WideberthError, match=r"in a square of .* take a lower density"):
        RandomCrowd(persons=30, density=5.0).cast(0)
