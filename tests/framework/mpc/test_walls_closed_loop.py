"""Static polygons in closed loop, alone and with someone who moves, and what a plan says."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.controllers.recommended import recommended
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.solver import Solver
from wideberth.framework.static_region import StaticRegion
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs, Footprint, Outline
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung
from wideberth.framework.values.polygon import Polygon
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.static import Static
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine as Line
from wideberth.regions.static.dual import Dual
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent, ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import AgentLog, Episode
from wideberth.simulation.sensing.localisation import Localisation
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt

DISCS = Discs(((0.35, 0.0), (-0.05, 0.0)), 0.25)
CAR = Outline(((0.55, 0.25), (-0.25, 0.25), (-0.25, -0.25), (0.55, -0.25)))
FORMS = [None, DISCS, CAR]
REGIONS = [StaticSeparatingLine(), Dual()]
EL = Polygon(((0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 2.5), (0.0, 2.5)), "el")


def block(x: float, y: float, name: str, size: float = 1.0) -> Polygon:
    return Polygon(((x, y), (x + size, y), (x + size, y + size), (x, y + size)), name)


def shape(footprint: Footprint | None, radius: float, place: Any, heading: float) -> Any:
    """The body as Shapely sees it; discs as fine polygons that are at most 3e-5 m too small."""
    body = shapely.Point(0.0, 0.0).buffer(radius, 64)
    if isinstance(footprint, Discs):
        body = shapely.MultiPoint(footprint.centres).buffer(footprint.radius, 64)
    if isinstance(footprint, Outline):
        body = shapely.Polygon(footprint.vertices)
    turned = shapely.affinity.rotate(body, heading, origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, *place)


# closed loops

ROUND = Path(np.array([[-1.2, -1.2], [-1.2, 3.2], [2.3, 3.2]]))
CORNER = Polygon(
    ((-1.0, 0.2), (-0.4, 0.2), (-0.4, 2.4), (1.2, 2.4), (1.2, 3.0), (-1.0, 3.0)), "corner"
)


def agent(footprint: Footprint | None, region: StaticRegion, solver: Solver) -> RobotAgent:
    """Leaving the wall costs up to 1.4e4 per metre here: a penalty of 1e4 is not exact."""
    robot = Unicycle(radius=0.7, max_yaw_rate=0.6, max_yaw_acceleration=0.4, footprint=footprint)
    planner = Planner(
        robot, Line(), Kalman(), Fixed(), solver, horizon=10, penalty=1e5, static_region=region,
        margin=0.03,
    )  # fmt: skip
    return RobotAgent("robot", robot, planner, ROUND)


def apart(log: AgentLog, polygon: Polygon) -> float:
    """Smallest distance of the body from a polygon by Shapely, m, at every fifth instant."""
    wall = shapely.Polygon(polygon.vertices)
    rows = zip(log.positions[::5], log.headings[::5], strict=True)
    return min(
        float(shapely.distance(shape(log.footprint, log.radius, place, turn), wall))
        for place, turn in rows
    )


QUICK = Settings(history=4.0, time_limit=40.0)


def drive(
    footprint: Footprint | None,
    region: StaticRegion,
    solver: Solver,
    *walkers: ScriptedAgent,
    settings: Settings = QUICK,
) -> Episode:
    robot = agent(footprint, region, solver)
    return run_episode([robot], settings, others=walkers, polygons=[CORNER])


alone = cache(drive)
"""The drives that several tests look at are driven once."""


@pytest.mark.parametrize(
    ("footprint", "region", "solver"),
    [
        (None, StaticSeparatingLine(), Fatrop()),
        (DISCS, StaticSeparatingLine(), Fatrop()),
        (CAR, StaticSeparatingLine(), Fatrop()),
        (CAR, Dual(), Fatrop()),
        (CAR, Dual(), Ipopt()),
    ],
    ids=lambda one: type(one).__name__,
)
def test_around_a_corner(footprint: Any, region: StaticRegion, solver: Solver) -> None:
    """The path leads 0.2 m past the wall, closer than any of the bodies can go."""
    episode = alone(footprint, region, solver)
    log = episode.robots[0]
    assert episode.ended == "goals"
    assert 0.0 < apart(log, CORNER) < 0.05
    assert np.mean([plan.rung is Rung.OPTIMAL for plan in log.plans]) > 0.9
    for plan in log.plans:
        assert plan.left_out == () and plan.violation == plan.violation
        assert plan.rung is Rung.OPTIMAL or "region of 'corner'" in plan.reason


@pytest.mark.parametrize("footprint", [DISCS, CAR], ids=lambda one: type(one).__name__)
def test_a_wall_and_someone_who_walks(footprint: Footprint) -> None:
    way = Path(np.array([[-2.8, -0.2], [9.0, -0.2]]))  # below the wall, through the robot
    walker = ScriptedAgent("walker", way, 0.5, 0.3)
    undisturbed = alone(footprint, StaticSeparatingLine(), Fatrop())
    episode = drive(footprint, StaticSeparatingLine(), Fatrop(), walker)
    log, other = episode.robots[0], episode.agent("walker")
    assert episode.ended == "goals" and apart(log, CORNER) > 0.0
    rows = zip(log.positions[::5], log.headings[::5], other.positions[::5], strict=True)
    gaps = [
        float(shapely.distance(shape(footprint, 0.7, place, turn), shapely.Point(there))) - 0.3
        for place, turn, there in rows
    ]
    assert np.nanmin(gaps) > 0.0
    together = zip(log.positions, other.positions, strict=False)
    before = zip(undisturbed.robots[0].positions, other.positions, strict=False)
    near, nearer = (min(np.linalg.norm(a - b) for a, b in pair) for pair in (together, before))
    assert near > nearer + 0.05  # it gave way


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_around_a_corner_without_knowing_quite_where(region: StaticRegion) -> None:
    unsure = replace(QUICK, localisation=Localisation(0.03, 0.02))
    log = (episode := drive(CAR, region, Fatrop(), settings=unsure)).robots[0]
    known = alone(CAR, region, Fatrop()).robots[0]
    assert episode.ended == "goals"
    assert apart(log, CORNER) > 0.0
    beside = [
        one.positions[(one.positions[:, 1] > 0.3) & (one.positions[:, 1] < 2.0), 0].mean()
        for one in (log, known)
    ]
    assert beside[0] < beside[1] - 0.05  # it keeps farther away


# what a plan says


def decided(*polygons: Polygon, walker: bool = False, **changes: Any) -> Plan:
    settings = {
        "robot": Unicycle(), "region": MinkowskiSum(), "predictor": Static(), "level": Fixed(),
        "solver": Fatrop(), "penalty": 1e4, "static_region": StaticSeparatingLine(), **changes,
    }  # fmt: skip
    planner = Planner(**settings)
    planner.set_path(Path(np.array([[0.0, 0.0], [20.0, 0.0]])))
    state = np.array([0.0, 0.0, 0.0, 0.4, 0.0])
    someone = Detection("walker", np.array([4.0, -2.0]), 1e-4 * np.eye(2), 0.4)
    seen = Observation(0.0, state, (someone,) * walker, polygons=polygons)
    command = planner.command(seen)
    assert np.isfinite([*command.linear, command.omega]).all() and planner.plan is not None
    return planner.plan


def test_a_plan_names_what_did_not_fit() -> None:
    walls = [block(1.0 + 1.1 * i, 1.0 + 0.2 * i, f"b{i}") for i in range(4)]
    assert decided(*walls).left_out == ()
    plan = decided(*walls, block(80.0, 0.0, "beyond"), most_obstacles=2, walker=True)
    assert plan.left_out == ("b2", "b3") and plan.ids == ("walker",)
    assert plan.rung is Rung.OPTIMAL
    few = decided(*walls, most_obstacles=0, walker=True)
    assert few.left_out == ("walker", "b0", "b1", "b2", "b3")


@pytest.mark.parametrize("region", REGIONS, ids=repr)
@pytest.mark.parametrize("solver", [Fatrop(), Ipopt()], ids=repr)
@pytest.mark.parametrize("penalty", [None, 1e4])
@pytest.mark.parametrize("footprint", FORMS, ids=lambda one: type(one).__name__)
def test_a_polygon_on_top_of_the_robot(
    region: StaticRegion, solver: Solver, penalty: float | None, footprint: Footprint | None
) -> None:
    robot = Unicycle(footprint=footprint)
    hut = block(-0.7, -0.6, "hut", 1.5)
    plan = decided(hut, robot=robot, static_region=region, solver=solver, penalty=penalty)
    assert plan.rung in (Rung.LEAST, Rung.BRAKE) and np.isfinite(plan.violation)
    assert plan.violation > 0.1 and "region of 'hut' entered" in plan.reason


def test_polygons_without_a_static_region_end_in_a_reason() -> None:
    plan = decided(EL, static_region=None)
    assert plan.rung is Rung.BRAKE and "planner.static_region is not set" in plan.reason
    assert decided(static_region=None).rung is Rung.OPTIMAL


def test_a_static_region_without_polygons_is_no_burden() -> None:
    bare = decided(static_region=None)
    for region in REGIONS:
        for polygons in ((), (block(50.0, 50.0, "far"),)):
            plan = decided(*polygons, static_region=region)
            assert plan.reason == "" and plan.left_out == ()
            assert np.array_equal(plan.states, bare.states)


def test_a_mirrored_wall_gives_the_mirrored_plan() -> None:
    wall = np.array([[2.0, -0.2], [4.0, -0.2], [4.0, 1.8], [2.0, 1.8]])
    left = decided(Polygon(tuple(map(tuple, wall)), "wall"))
    right = decided(Polygon(tuple(map(tuple, wall * [1.0, -1.0])), "wall"))
    assert left.rung is right.rung is Rung.OPTIMAL
    assert left.positions[:, 1].min() < -0.5
    assert np.allclose(left.positions, right.positions * [1.0, -1.0], atol=1e-3)


# the margin before walls

GAP = tuple(block(2.0, y, name, 1.5) for y, name in ((0.36, "left"), (-1.86, "right")))
"""0.72 m wide, for a robot of 0.6 m."""


@cache
def through(**margins: float | None) -> tuple[float, float]:
    """How far a robot gets whose path leads through the gap, and its least distance to it, m."""
    robot = Unicycle(radius=0.3, max_yaw_rate=1.0, max_yaw_acceleration=1.0)
    planner = recommended(robot, 0.5, quiet=True, **margins)
    made = RobotAgent("robot", robot, planner, Path(np.array([[0.0, 0.0], [5.0, 0.0]])))
    episode = run_episode([made], replace(QUICK, time_limit=20.0), polygons=list(GAP))
    log = episode.robots[0]
    return float(log.positions[-1, 0]), min(apart(log, wall) for wall in GAP)


def test_a_narrow_gap_is_passed_with_a_smaller_margin_before_walls() -> None:
    """And the margin before people stays as it is."""
    assert through(wall_margin=None)[0] < 2.0  # 0.1 m on either side would take 0.8 m
    end, room = through(wall_margin=0.02)
    assert end > 4.5 and 0.02 - 1e-3 < room
    assert through(margin=0.02, wall_margin=None) == (end, room)
    assert through(margin=0.02, wall_margin=0.1)[0] < 2.0


def test_people_keep_the_margin_that_is_theirs() -> None:
    """The same numbers of people, and those of walls from the other margin."""
    wall, person = block(2.0, 1.0, "wall"), Detection("a", np.array([3.0, -1.0]), None, 0.3)
    seen = Observation(0.0, np.zeros(5), (person,), polygons=(wall,))

    def numbers(**margins: float | None) -> Any:
        made = recommended("unicycle", 0.5, quiet=True, **margins)
        made.set_path(Path(np.array([[0.0, 0.0], [5.0, 0.0]])))
        made.command(seen)
        return [one.parameters for one in made.explain().parameters.slots]

    both, own, less = (
        numbers(margin=0.1, wall_margin=None),
        numbers(margin=0.1, wall_margin=0.02),
        numbers(margin=0.02, wall_margin=None),
    )
    np.testing.assert_array_equal(own[0], both[0])
    np.testing.assert_array_equal(own[1], less[1])
    assert np.abs(own[1] - both[1]).max() == pytest.approx(0.08)
    with pytest.raises(WideberthError, match=r"planner\.wall_margin is -1"):
        numbers(wall_margin=-1.0)
