"""Clearances of footprints and polygons against Shapely, and episodes that keep both."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.controller import Controller
from wideberth.framework.mpc.planner.emergency import emergency
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs, Footprint, Outline
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Breach, BreachKind, GivenWay, Plan
from wideberth.framework.values.polygon import Polygon
from wideberth.metrics.gaps import BodyMotion, gaps, wall_gaps
from wideberth.robots.holonomic_3d import Holonomic3D
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.summary import clearances, robot_rows, summarise

DISCS = Discs(((0.6, 0.0), (0.0, 0.1), (-0.5, 0.0)), 0.35)
CAR = Outline(((0.9, 0.3), (-0.3, 0.35), (-0.4, -0.2), (0.7, -0.3)))
FOOTPRINTS = [None, DISCS, CAR]
EL = Polygon(((0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 2.5), (0.0, 2.5)), "el")
WEDGE = Polygon(((-1.0, -1.0), (2.0, -0.5), (0.5, 1.5)), "wedge")
COUNT = 60


def course(footprint: Footprint | None, seed: int) -> BodyMotion:
    rng = np.random.default_rng(seed)
    return BodyMotion(
        0.5, rng.uniform(-2.5, 4.0, (COUNT, 2)), rng.uniform(-7.0, 7.0, COUNT), footprint
    )


def bodies(moving: BodyMotion) -> list[tuple[Any, float]]:
    """Shape and rounding, m, at each instant, by Shapely's own rotation and shift."""
    footprint, made = moving.footprint, []
    shape, rounding = shapely.Point(0.0, 0.0), moving.radius
    if isinstance(footprint, Discs):
        shape, rounding = shapely.MultiPoint(footprint.centres), footprint.radius
    if isinstance(footprint, Outline):
        shape, rounding = shapely.Polygon(footprint.vertices), 0.0
    for (x, y), heading in zip(moving.positions, moving.headings, strict=True):
        turned = shapely.affinity.rotate(shape, heading, origin=(0.0, 0.0), use_radians=True)
        made.append((shapely.affinity.translate(turned, x, y), rounding))
    return made


def agree(found: Any, wanted: np.ndarray) -> None:
    """The worse end of each interval; an overlap has no distance, only a sign."""
    wanted = np.minimum(wanted[:-1], wanted[1:])
    apart = wanted > 0.0
    assert 0.1 < apart.mean() < 0.95
    assert np.allclose(found[apart], wanted[apart], atol=1e-9)
    assert (found[~apart] <= 1e-9).all()


@pytest.mark.parametrize("first", FOOTPRINTS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("second", FOOTPRINTS, ids=lambda one: type(one).__name__)
def test_gaps_of_two_bodies(first: Footprint | None, second: Footprint | None) -> None:
    one, two = course(first, 1), course(second, 2)
    pairs = zip(bodies(one), bodies(two), strict=True)
    wanted = np.array([shapely.distance(a, b) - r - s for (a, r), (b, s) in pairs])
    found = gaps(one, two)
    assert np.allclose(found, gaps(two, one), atol=1e-12)
    if first is None and second is None:  # they move between the instants
        assert (found <= np.minimum(wanted[:-1], wanted[1:]) + 1e-12).all()
        ahead = np.linspace(0.0, 1.0, 2001)[:, None, None]
        apart = one.positions - two.positions
        between = np.linalg.norm((1.0 - ahead) * apart[:-1] + ahead * apart[1:], axis=2)
        assert np.allclose(found, between.min(axis=0) - 1.0, atol=1e-3)
    else:
        agree(found, wanted)


@pytest.mark.parametrize("footprint", FOOTPRINTS, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("polygon", [EL, WEDGE], ids=lambda one: one.name)
def test_gaps_to_polygons(footprint: Footprint | None, polygon: Polygon) -> None:
    moving = course(footprint, 3)
    wall = shapely.Polygon(polygon.vertices)
    made = bodies(moving)
    if isinstance(footprint, Outline):
        agree(
            wall_gaps(moving, polygon), np.array([shapely.distance(one, wall) for one, _ in made])
        )
        return
    wanted = []  # discs move in a straight line between the instants
    for (one, rounding), (two, _) in pairwise(made):
        centres = zip(shapely.get_parts(one), shapely.get_parts(two), strict=True)
        ways = [shapely.LineString([a.coords[0], b.coords[0]]) for a, b in centres]
        wanted.append(min(shapely.distance(way, wall) for way in ways) - rounding)
    found, apart = wall_gaps(moving, polygon), np.array(wanted) > 0.0
    assert 0.05 < apart.mean() < 0.95
    assert np.allclose(found[apart], np.array(wanted)[apart], atol=1e-9)
    assert (found[~apart] <= 1e-9).all()


@pytest.mark.parametrize("footprint", FOOTPRINTS, ids=lambda one: type(one).__name__)
def test_the_absent_have_no_gap(footprint: Footprint | None) -> None:
    moving, other = course(footprint, 4), course(None, 5)
    positions = other.positions.copy()
    positions[[0, 7, 8, 20]] = np.nan
    there = BodyMotion(0.5, positions, np.full(COUNT, np.nan))
    missing = np.isnan(positions[:, 0])
    wanted = missing[:-1] | missing[1:]
    assert np.array_equal(np.isnan(gaps(moving, there)), wanted)
    assert np.array_equal(np.isnan(gaps(there, moving)), wanted)
    assert np.array_equal(np.isnan(wall_gaps(there, EL)), wanted)
    assert np.allclose(gaps(moving, there)[~wanted], gaps(moving, other)[~wanted])


# episodes


class Straight(Controller):
    """Keeps its speed, and what it was told."""

    period = 0.5

    def __init__(self) -> None:
        self.seen: list[Observation] = []

    def reset(self) -> None:
        self.seen = []

    def set_path(self, path: Path) -> None:
        pass

    def remember(self, observation: Observation) -> None:
        self.seen.append(observation)

    def command(self, observation: Observation) -> Command:
        self.seen.append(observation)
        return Command((0.5, 0.0))

    @property
    def last_plan(self) -> Plan | None:
        return None


EAST = Path(np.array([[0.0, 0.0], [4.0, 0.0]]))


def drive(footprint: Footprint | None, *polygons: Polygon, **settings: Any) -> Episode:
    robot = Unicycle(radius=1.0, footprint=footprint)
    walker = ReplayAgent("walker", np.array([0.0, 9.0]), np.array([[9.0, 2.5], [0.0, 2.5]]), 0.3)
    agent = RobotAgent("robot", robot, Straight(), EAST)
    settings = {"history": 0.0, "time_limit": 8.0, **settings}
    return run_episode([agent], Settings(**settings), others=[walker], polygons=polygons)


def block(x: float, y: float, name: str = "") -> Polygon:
    return Polygon(((x, y), (x + 1.0, y), (x + 1.0, y + 1.0), (x, y + 1.0)), name)


@pytest.mark.parametrize("footprint", FOOTPRINTS, ids=lambda one: type(one).__name__)
def test_the_summary_knows_the_form_of_the_robot(footprint: Footprint | None) -> None:
    """It passes beside a block; how far is known by pencil."""
    left, right = {None: (1.0, 1.0), DISCS: (0.45, 0.35), CAR: (0.35, 0.3)}[footprint]
    episode = drive(footprint, block(1.5, 1.1, "near"), block(2.0, -9.0, "far"))
    apart = clearances(episode)
    assert apart["robot", "near"] == pytest.approx(1.1 - left, abs=1e-3)
    assert apart["robot", "far"] == pytest.approx(8.0 - right, abs=1e-3)
    assert set(apart) == {("robot", "near"), ("robot", "far"), ("robot", "walker")}
    assert summarise(episode)["clearance"] == min(apart.values()) > 0.0
    assert robot_rows(episode)[0]["clearance"] == min(apart.values())
    assert summarise(episode)["success"]


@pytest.mark.parametrize(
    ("footprint", "front"), [(None, 1.0), (DISCS, 0.95), (CAR, 0.9)], ids=["disc", "discs", "car"]
)
def test_collisions_with_polygons(footprint: Footprint | None, front: float) -> None:
    wall = block(2.0, -0.5, "wall")
    ran = drive(footprint, wall)
    assert ran.ended == "goals"
    assert summarise(ran)["collision"] and not summarise(ran)["success"]
    assert clearances(ran)["robot", "wall"] < 0.0
    stopped = drive(footprint, wall, stop_on_collision=True)
    assert stopped.ended == "collision"
    assert stopped.duration == pytest.approx((2.0 - front) / 0.5, abs=0.03)


def test_every_robot_knows_all_polygons_by_name() -> None:
    controller = Straight()
    agent = RobotAgent("robot", Unicycle(), controller, EAST)
    walls = [block(9.0, 9.0), block(9.0, 5.0, "hut"), EL]
    episode = run_episode([agent], Settings(history=1.0, time_limit=1.0), polygons=walls)
    told = ("polygon 1", "hut", "el")
    assert tuple(one.name for one in episode.polygons) == told
    assert len(controller.seen) >= 4
    for observation in controller.seen:
        assert tuple(one.name for one in observation.polygons) == told


def test_polygons_that_make_no_episode_are_refused() -> None:
    agent = RobotAgent("robot", Unicycle(), Straight(), EAST)
    with pytest.raises(WideberthError, match=r"share the name.*robot"):
        run_episode([agent], polygons=[block(9.0, 9.0, "robot")])
    with pytest.raises(WideberthError, match=r"share the name.*hut"):
        run_episode([agent], polygons=[block(9.0, 9.0, "hut"), block(5.0, 5.0, "hut")])
    high = Path(np.array([[0.0, 0.0, 1.0], [4.0, 0.0, 1.0]]))
    flying = RobotAgent("robot", Holonomic3D(), Straight(), high)
    with pytest.raises(WideberthError, match="polygons lie in the plane"):
        run_episode([flying], polygons=[EL])


@pytest.mark.parametrize("footprint", FOOTPRINTS, ids=lambda one: type(one).__name__)
def test_bytes_keep_footprints_and_polygons(footprint: Footprint | None) -> None:
    episode = drive(footprint, EL, block(5.0, 5.0))
    data = episode.to_bytes()
    again = Episode.from_bytes(data)
    assert again.to_bytes() == data
    assert again.agent("robot").footprint == footprint
    assert again.agent("walker").footprint is None
    assert again.polygons == episode.polygons
    assert clearances(again) == clearances(episode)


def test_what_a_plan_breaks_and_gives_up_is_kept() -> None:
    seen = Observation(0.0, np.array([0.0, 0.0, 0.0, 0.5, 0.0]))
    plan, _ = emergency(Unicycle(), seen, "", 3, 0.5)
    breaches = (
        None,
        Breach(BreachKind.REGION, "walker", 2, 0.1 + 0.2),
        Breach(BreachKind.MOTION, "", 1, 3.0),
    )
    ways = (None, GivenWay(0.05, 1.0 - 7e-5, "content", 3, "walker"), None)
    plans = tuple(
        replace(plan, breach=one, given_way=way) for one, way in zip(breaches, ways, strict=True)
    )
    episode = drive(DISCS, EL)
    robot, *others = episode.agents
    episode = replace(episode, agents=(replace(robot, plans=plans), *others))
    again = Episode.from_bytes(episode.to_bytes())
    assert tuple(one.breach for one in again.agent("robot").plans) == breaches
    assert tuple(one.given_way for one in again.agent("robot").plans) == ways
    assert again.to_bytes() == episode.to_bytes()
