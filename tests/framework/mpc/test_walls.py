"""Static polygons in the MPC: which are kept, what feasible means, and closed loops."""

from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.mpc.assembly import assemble as make
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.bodies import Body, BodyPath, bodies
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.instance import Instance
from wideberth.framework.mpc.planner.rollout import steer
from wideberth.framework.mpc.planner.verify import verify, violation
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.mpc.slots.static_polygons import (
    CORNERS,
    NONE,
    Walls,
    choose_walls,
    fill_walls,
    padded,
)
from wideberth.framework.mpc.solver import Solver
from wideberth.framework.static_region import StaticRegion
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs, Footprint, Outline
from wideberth.framework.values.motion import Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Status
from wideberth.framework.values.polygon import Polygon, separation
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.static.dual import Dual
from wideberth.regions.static.separating_line import StaticSeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.tests.helpers.problems import (
    among,
    assemble,
    built_in,
    slots_of,
    surroundings,
    with_auxiliaries,
)

DISCS = Discs(((0.35, 0.0), (-0.05, 0.0)), 0.25)
CAR = Outline(((0.55, 0.25), (-0.25, 0.25), (-0.25, -0.25), (0.55, -0.25)))
FORMS = [None, DISCS, CAR]
REGIONS = [StaticSeparatingLine(), Dual()]
EL = Polygon(((0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 2.5), (0.0, 2.5)), "el")
SHED = Polygon(((-3.0, -2.0), (-1.5, -2.5), (-1.0, -1.2), (-2.4, -0.8)), "shed")
HERE = np.zeros((1, 2))


def block(x: float, y: float, name: str, size: float = 1.0) -> Polygon:
    return Polygon(((x, y), (x + size, y), (x + size, y + size), (x, y + size)), name)


# which polygons count


def test_the_nearest_parts_are_kept_and_the_others_named() -> None:
    route = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    far = [block(2.0, 3.0, "third"), block(0.0, 1.0, "first"), block(2.0, -3.0, "second")]
    away = block(30.0, 0.0, "away")
    kept = choose_walls([*far, away], StaticSeparatingLine(), route, 5.0, 2)
    assert kept.names == ("first", "second") and kept.left_out == ("third",)
    assert len(kept) == 2 and kept.parts.shape == (2, 4, 2)
    all_of = choose_walls([*far, away], StaticSeparatingLine(), route, 5.0, 9)
    assert all_of.names == ("third", "first", "second") and all_of.left_out == ()
    near = choose_walls([*far, away], StaticSeparatingLine(), route, 1.5, 9)
    assert near.names == ("first",) and near.left_out == ()
    assert len(choose_walls([away], StaticSeparatingLine(), route, 5.0, 9)) == 0
    assert choose_walls([], None, route, 5.0, 9) is NONE
    assert NONE.parts.shape == NONE.known.shape == (0, 4, 2)


def test_problems_are_compiled_for_few_numbers_of_vertices() -> None:
    rooms = {3: 4, 4: 4, 5: 6, 6: 6, 7: 8, 8: 8, 9: 12, 12: 12, 13: 16, 16: 16}
    for count, room in rooms.items():
        angle = 2.0 * pi * np.arange(count) / count
        gone = Polygon(tuple(zip(np.cos(angle), np.sin(angle), strict=True)), "round")
        assert choose_walls([gone], StaticSeparatingLine(), HERE, 50.0, 9).parts.shape == (
            1,
            room,
            2,
        )


def test_polygons_that_are_not_convex_come_in_parts() -> None:
    kept = choose_walls([EL, SHED], StaticSeparatingLine(), HERE, 50.0, 9)
    assert sorted(set(kept.names)) == ["el", "shed"] and kept.names.count("el") >= 2
    area = sum(shapely.Polygon(part).area for part in kept.parts[[n == "el" for n in kept.names]])
    assert area == pytest.approx(shapely.Polygon(EL.vertices).area)
    angle = 2.0 * pi * np.arange(40) / 40
    round_one = Polygon(tuple(zip(np.cos(angle) + 5.0, np.sin(angle), strict=True)), "round")
    parts = choose_walls([round_one], StaticSeparatingLine(), HERE, 50.0, 9).parts
    assert parts.shape[1] in CORNERS
    assert sum(shapely.Polygon(part).area for part in parts) == pytest.approx(
        shapely.Polygon(round_one.vertices).area
    )
    assert padded(np.array(SHED.vertices), 8)[4:].tolist() == [list(SHED.vertices[-1])] * 4


def test_what_walls_need() -> None:
    with pytest.raises(WideberthError, match=r"2 static polygons are observed.*static_region"):
        choose_walls([EL, SHED], None, HERE, 5.0, 9)
    with pytest.raises(WideberthError, match="3 dimensions"):
        choose_walls([EL], StaticSeparatingLine(), np.zeros((1, 3)), 5.0, 9)
    with pytest.raises(WideberthError, match="2 static polygons need a static region"):
        general = built_in(MinkowskiSum())
        make(Unicycle(), general, Fixed(), horizon=3, dt=0.5, rooms=((0,), (2, 4)))


# what feasible means

STEPS = 150


def instance(
    robot: Unicycle, region: StaticRegion, walls: Walls, states: np.ndarray
) -> tuple[Problem, Parameters, Guess]:
    """One problem over the walls alone, at any states."""
    steps = len(states) - 1
    reference = lay_reference(Path(np.array([[-5.0, 0.2], [9.0, 0.2]])), 0.0, 0.5, steps, 0.5)
    own = np.zeros((steps, 2, 2))
    plugs = robot, MinkowskiSum(), Fixed(), 0.05, region
    parameters = among(states[0], reference, ObstacleSet.none(steps, 2), walls, own, plugs)
    problem = assemble(
        robot, MinkowskiSum(), Fixed(), horizon=steps, dt=0.5, capacity=0, static_region=region,
        statics=len(parameters.slots[1].active), corners=walls.parts.shape[1],
    )  # fmt: skip
    bare = Guess.bare(states, np.zeros((steps, 2)), float("nan"))
    point = with_auxiliaries(robot, MinkowskiSum(), parameters, bare, region)
    return problem, point.pull(parameters), point


def shape(footprint: Footprint | None, radius: float, place: Any, heading: float) -> Any:
    """The body as Shapely sees it; discs as fine polygons that are at most 3e-5 m too small."""
    body = shapely.Point(0.0, 0.0).buffer(radius, 64)
    if isinstance(footprint, Discs):
        body = shapely.MultiPoint(footprint.centres).buffer(footprint.radius, 64)
    if isinstance(footprint, Outline):
        body = shapely.Polygon(footprint.vertices)
    turned = shapely.affinity.rotate(body, heading, origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, *place)


@pytest.mark.parametrize("region", REGIONS, ids=repr)
@pytest.mark.parametrize("footprint", FORMS, ids=lambda one: type(one).__name__)
def test_feasible_is_what_shapely_calls_clear(region: Any, footprint: Any) -> None:
    rng = np.random.default_rng(0)
    states = np.zeros((STEPS + 1, 5))
    states[:, :2] = rng.uniform([-3.5, -3.0], [4.0, 3.5], (STEPS + 1, 2))
    states[:, 2] = rng.uniform(-pi, pi, STEPS + 1)
    walls = choose_walls([EL, SHED], region, HERE, 50.0, 9)
    robot = Unicycle(radius=0.75, footprint=footprint)
    problem, parameters, point = instance(robot, region, walls, states)
    assert problem.slots[1].count > len(walls)  # some slots are empty
    entered = violation(problem, parameters, point).regions
    assert entered.shape == (STEPS, problem.slots[1].count)
    assert not entered[:, len(walls) :].any()
    seen = []
    for step, state in enumerate(states[1:]):
        body = shape(footprint, robot.radius, state[:2], state[2])
        for name, polygon in (("el", EL), ("shed", SHED)):
            gap = float(shapely.distance(body, shapely.Polygon(polygon.vertices))) - 0.05
            told = max(entered[step, [i for i, n in enumerate(walls.names) if n == name]])
            if abs(gap) > 2e-4:
                assert (told > 1e-9) == (gap < 0.0), (step, name, gap, told)
                seen.append(gap < 0.0)
    assert len(seen) > 280 and 0.1 < np.mean(seen) < 0.8


def placed(walls: Walls, region: StaticRegion) -> tuple[Problem, Parameters, Guess]:
    robot = Unicycle(radius=0.75, footprint=CAR)
    start = np.array([-4.5, 0.2, 0.0, 0.4, 0.0])
    states, inputs = steer(robot, start, Twist((0.4, 0.0), 0.05), 12, 0.5)
    problem, parameters, point = instance(robot, region, walls, states)
    return problem, parameters, replace(point, inputs=inputs)


@pytest.mark.parametrize("region", REGIONS, ids=repr)
@pytest.mark.parametrize("solver", [Fatrop(), Ipopt()], ids=repr)
def test_empty_slots_change_nothing(region: StaticRegion, solver: Solver) -> None:
    two = choose_walls([block(-1.8, 0.4, "a"), block(-1.0, -2.5, "b")], region, HERE, 9.0, 9)
    problem, parameters, point = placed(two, region)
    (tight,) = solver.solve(problem, parameters, [point])
    assert problem.slots[1].count == 2 and tight.status is Status.SOLVED
    empty = np.concatenate([two.parts, two.parts[:1], two.parts[:1], two.parts[:1]])
    roomy, wider, start = placed(Walls(empty, ("x",) * 5, empty, ("x",) * 5), region)
    still = np.zeros_like(wider.slots[1].auxiliaries)  # empty slots hold anything finite
    still[:, :2], statics = parameters.slots[1].auxiliaries, wider.slots[1].parameters.copy()
    on = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    statics[:, 2:] = 1.0
    wider = slots_of(wider, 1, active=on, auxiliaries=still, parameters=statics)
    begin = replace(start, auxiliaries=(start.auxiliaries[0], still))
    (loose,) = solver.solve(roomy, wider, [begin])
    assert roomy.slots[1].count == 5 and loose.status is Status.SOLVED
    assert np.allclose(loose.point.states, tight.point.states, atol=1e-6)
    assert 0.0 <= loose.cost - tight.cost + 1e-5 < 2e-3  # of holding idle auxiliaries
    free = slots_of(parameters, 1, active=np.zeros(2))
    (without,) = solver.solve(problem, free, [point])
    assert without.cost < 0.9 * tight.cost  # the walls do matter here


@pytest.mark.parametrize("region", REGIONS, ids=repr)
def test_a_thin_wall_is_not_passed_between_two_steps(region: StaticRegion) -> None:
    """Bodies of 0.2 m in steps of 0.4 m: the constraints at the steps alone see nothing."""
    thin = Polygon(((2.0, -9.0), (2.001, -9.0), (2.001, 9.0), (2.0, 9.0)), "sheet")
    box = Outline(((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)))
    for footprint in (None, Discs(((0.0, 0.0),), 0.1), box):
        robot = Unicycle(radius=0.15 if footprint is box else 0.1, footprint=footprint)
        states = np.zeros((9, 5))
        states[:, 0] = 0.2 + 0.4 * np.arange(9)
        walls = choose_walls([thin], region, states[:, :2], 50.0, 9)
        problem, parameters, point = instance(robot, region, walls, states)
        none = ObstacleSet.none(len(states) - 1, 2)
        around = surroundings(robot, MahalanobisEllipse(), region, none, walls, 0.0)
        found = verify(Instance(problem, parameters, around, Fixed()), point)
        assert not found.regions.any()
        assert np.flatnonzero(found.touched).tolist() == [4]
        assert found.worst > 0.05 and "'sheet' touched" in found.where(walls.names)


def test_parts_that_did_not_fit_are_not_driven_through() -> None:
    hut = Polygon(((1.0, -0.5), (2.0, -0.5), (2.0, 0.5), (1.0, 0.5)), "hut")
    states = np.zeros((9, 5))
    states[:, 0] = 0.5 * np.arange(9)
    walls = choose_walls([hut], REGIONS[0], states[:, :2], 50.0, 0)
    assert len(walls) == 0 and walls.left_out == ("hut",)
    none = ObstacleSet.none(len(states) - 1, 2)
    robot = Unicycle(radius=0.3)
    around = surroundings(robot, MahalanobisEllipse(), REGIONS[0], none, walls, 0.0)
    touch = around.touched(states)
    assert touch.depth[2] == pytest.approx(0.3 + 0.5) and "hut" in touch.names


def test_states_that_are_no_numbers_are_left_to_the_re_check() -> None:
    walls = choose_walls([EL], REGIONS[0], HERE, 50.0, 9)
    around = surroundings(
        Unicycle(), MahalanobisEllipse(), REGIONS[0], ObstacleSet.none(2, 2), walls, 0.0
    )
    assert not around.touched(np.full((3, 5), np.nan)).depth.any()


@pytest.mark.parametrize("footprint", FORMS, ids=lambda one: type(one).__name__)
def test_all_parts_are_looked_at_as_by_their_distances(footprint: Any) -> None:
    radius = 0.4 if footprint is None else footprint.reach
    robot, rng, met = Unicycle(radius=radius, footprint=footprint), np.random.default_rng(5), 0
    walls = choose_walls([EL, SHED, block(1.5, -2.0, "box")], REGIONS[0], HERE, 50.0, 9)
    around = surroundings(robot, MahalanobisEllipse(), REGIONS[0], walls=walls)
    for _ in range(60):
        states = np.zeros((6, 5))
        states[:, :3] = rng.uniform([-3.5, -3.0, -pi], [4.0, 3.5, pi])
        states[:, :3] += np.cumsum(rng.uniform(-0.3, 0.3, (6, 3)), axis=0)
        depth, names = np.zeros(5), [""] * 5
        for body in bodies(robot):
            way = BodyPath.of(robot, body, states)
            gaps = separation(way.corners[:, :, None], walls.known)[0].min(axis=1) - body.radius
            for i, k in enumerate(gaps.argmin(axis=1)):
                if -gaps[i, k] > max(depth[i], way.cut[i]):
                    depth[i], names[i] = -gaps[i, k], walls.known_names[k]
        touch = around.touched(states)
        assert touch.depth.tolist() == depth.tolist() and list(touch.names) == names
        met += bool(depth.any())
    assert 10 < met < 50


@pytest.mark.parametrize("box", [False, True])
@pytest.mark.parametrize("stride", [0.3, 0.5, 1.2])
def test_only_the_corner_between_two_steps_may_be_cut(box: bool, stride: float) -> None:
    """By h - sqrt(h^2 - L^2 / 4), h / 2 at most, by a body of half-width h that moves L."""
    half = 0.3 if box else 0.5
    cut = min(half - np.sqrt(max(half**2 - stride**2 / 4.0, 0.0)), half / 2.0)
    outline = Outline(((-0.4, -0.3), (0.4, -0.3), (0.4, 0.3), (-0.4, 0.3))) if box else None
    robot = Unicycle(radius=0.5, footprint=outline)
    states = np.zeros((5, 5))
    states[:, 0] = stride * np.arange(5)
    for beyond in (-0.01, 0.01):
        edge = half - cut - beyond
        beam = Polygon(((-9.0, edge), (9.0, edge), (9.0, edge + 5.0), (-9.0, edge + 5.0)), "beam")
        past = Polygon(
            ((-9.0, -9.0), (9.0, -9.0), (9.0, -half - 0.1), (-9.0, -half - 0.1)), "past"
        )
        walls = choose_walls([past, beam], REGIONS[0], states[:, :2], 50.0, 9)
        none = ObstacleSet.none(4, 2)
        around = surroundings(robot, MahalanobisEllipse(), REGIONS[0], none, walls, 0.0)
        touch = around.touched(states)
        depth = touch.depth
        assert set(touch.names) == {"beam" if beyond > 0.0 else ""}
        np.testing.assert_allclose(depth, cut + beyond if beyond > 0.0 else 0.0, atol=1e-9)


def test_what_is_touched_is_seen_wherever_the_plan_is() -> None:
    """Far from the origin, long walls of which one end alone is near, against Shapely."""
    robot = Unicycle(radius=0.3)
    rng = np.random.default_rng(8)
    met = 0
    for _ in range(40):
        states = np.zeros((9, 5))
        turn, begin = rng.uniform(-pi, pi), rng.uniform(-60.0, 60.0, 2)
        ahead = np.array([np.cos(turn), np.sin(turn)])
        states[:, :2] = begin + 0.4 * np.arange(9)[:, None] * ahead
        end = begin + rng.uniform(-1.0, 5.0) * ahead + rng.uniform(-1.0, 1.0, 2)
        way = rng.uniform(-pi, pi)
        along = np.array([np.cos(way), np.sin(way)])
        aside = 0.05 * np.array([-along[1], along[0]])
        far = end + 20.0 * along
        bar = Polygon(tuple(map(tuple, (end - aside, far - aside, far + aside, end + aside))))
        walls = choose_walls([bar], REGIONS[0], states[:, :2], 100.0, 9)
        touch = surroundings(robot, MahalanobisEllipse(), REGIONS[0], walls=walls).touched(states)
        body, wall = shapely.LineString(states[:, :2]).buffer(0.3), shapely.Polygon(bar.vertices)
        deep = shapely.intersection(body, wall).area
        assert (touch.depth.any() or deep < 0.1) and (deep > 0.0 or not touch.depth.any())
        met += bool(touch.depth.any())
    assert 5 < met < 35


@pytest.mark.parametrize(("stride", "looks"), [(0.3, 1), (0.31, 2), (1.0, 4), (99.0, 32)])
def test_the_way_is_looked_at_every_half_width(stride: float, looks: int) -> None:
    states = np.zeros((3, 5))
    states[1:, 0], states[2, 2] = stride, 0.5
    found = BodyPath.of(Unicycle(), Body(0.3), states)
    np.testing.assert_allclose(found.share, np.arange(1, looks + 1) / looks)
    assert found.corners.shape == (2, looks, 1, 2)
    np.testing.assert_allclose(found.corners[0, :, 0, 0], stride * found.share)
    np.testing.assert_allclose(found.corners[1, :, 0], [[stride, 0.0]] * looks)
    cut = 0.3 - np.sqrt(max(0.3**2 - 0.25 * stride**2, 0.25 * 0.3**2))
    np.testing.assert_allclose(found.cut, [cut, 0.0], atol=1e-12)
    turned = BodyPath.of(
        Unicycle(), Body(0.0, outline=((0.5, 0.2), (-0.5, 0.2), (0.0, -0.4))), states
    )
    last = turned.corners[1, -1]
    np.testing.assert_allclose(
        last[0], [stride + 0.5 * np.cos(0.5) - 0.2 * np.sin(0.5),
                  0.5 * np.sin(0.5) + 0.2 * np.cos(0.5)],
    )  # fmt: skip


def test_an_empty_slot_holds_a_triangle() -> None:
    parts = np.stack([np.array(block(k, 5.0, "a").vertices) for k in range(3)])
    walls = Walls(parts, ("a",) * 3, parts, ("a",) * 3)
    spread = np.tile(0.01 * np.eye(2), (2, 1, 1))
    for region in REGIONS:
        found = fill_walls(walls, region, 0.4, spread)
        assert found.active.tolist() == [1.0, 1.0, 1.0, 0.0, 0.0] and found.level is None
        triangle = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 1.0]])
        for slot, part in enumerate([*parts, triangle, triangle]):
            wanted = region.parameters(part, np.array(0.4), spread[0])
            np.testing.assert_allclose(found.parameters[1, slot], wanted)
