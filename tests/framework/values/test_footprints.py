"""Footprints and the bodies that stand for them: bad input, corners, and Shapely as the judge."""

from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.bodies import Body
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.slots.base import SlotKind, farthest
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.mpc.slots.static_polygons import NONE
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.region import Region
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Discs, Footprint, Outline
from wideberth.framework.values.motion import Pose
from wideberth.framework.values.path import Path
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.problems import among, assemble, built_in, with_auxiliaries
from wideberth.tests.helpers.residuals import residuals

DISCS = Discs(((0.6, 0.0), (0.1, 0.05), (-0.4, -0.1)), 0.35)
CAR = Outline(((0.9, 0.3), (-0.3, 0.35), (-0.4, -0.2), (0.7, -0.3)))
REGIONS = [load("regions", name)() for name in names("regions")]
PLANAR = [region for region in REGIONS if 2 in region.dimensions]


# the values


@pytest.mark.parametrize(
    ("centres", "radius", "words"),
    [
        ((), 0.3, "discs.centres"),
        ((("a", "b"),), 0.3, "discs.centres is not an array of numbers"),
        (((0.0, 0.0, 0.0),), 0.3, "discs.centres has shape"),
        (((0.0, np.nan),), 0.3, "discs.centres.*finite"),
        (((0.0, 0.0),), 0.0, "discs.radius is 0"),
        (((0.0, 0.0),), np.inf, "discs.radius is inf"),
        (((0.0, 0.0),), "wide", "discs.radius is 'wide'"),
    ],
)
def test_bad_discs_are_refused(centres: Any, radius: Any, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        Discs(centres, radius)


SQUARE = ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0))
STAR = tuple((cos(4 * pi * i / 5), sin(4 * pi * i / 5)) for i in range(5))


@pytest.mark.parametrize(
    ("vertices", "words"),
    [
        (SQUARE[:2], "2 places; wanted at least 3"),
        (SQUARE[::-1], "counter-clockwise"),
        ((*SQUARE, SQUARE[0]), "corner at each"),
        ((SQUARE[0], *SQUARE), "corner at each"),
        ((*SQUARE[:2], (-1.0, 0.0), *SQUARE[2:]), "corner at each"),  # on an edge
        ((*SQUARE, (0.5, 0.0)), "convex"),
        (STAR, "convex"),  # turns left at each corner, and runs around twice
        (((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)), "convex"),
        ((*SQUARE[:3], (np.inf, -1.0)), "finite"),
        ((*SQUARE[:3], ("x", 0.0)), "not an array of numbers"),
        ([1.0, 2.0, 3.0], "has shape"),
    ],
)
def test_bad_outlines_are_refused(vertices: Any, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        Outline(vertices)


@pytest.mark.parametrize("robot", [Unicycle, DifferentialDrive, Bicycle])
@pytest.mark.parametrize("footprint", [DISCS, CAR], ids=lambda one: type(one).__name__)
def test_the_disc_has_to_enclose_the_footprint(robot: Any, footprint: Footprint) -> None:
    assert robot(radius=footprint.reach, footprint=footprint).footprint == footprint
    with pytest.raises(WideberthError, match=r"footprint reaches .* beyond .*radius"):
        robot(radius=0.99 * footprint.reach, footprint=footprint)


def test_reach_is_the_farthest_point() -> None:
    assert pytest.approx(0.95) == DISCS.reach
    assert pytest.approx(np.hypot(0.9, 0.3)) == CAR.reach


@pytest.mark.parametrize("footprint", [None, DISCS, CAR], ids=lambda one: type(one).__name__)
def test_configs_hold_footprints(footprint: Footprint | None) -> None:
    robot = Unicycle(radius=1.0, footprint=footprint)
    assert build("robots", describe(robot)) == robot
    if footprint is not None:
        told = {"type": "unicycle", "radius": 1.0, "footprint": describe(footprint)}
        assert build("robots", told) == robot


@pytest.mark.parametrize(
    ("footprint", "words"),
    [
        ({"vertices": [[1.0, 0.0], [0.0, 1.0]]}, "2 places; wanted at least 3"),
        ({"centres": [[0.0, 0.0]], "radius": 0.3, "colour": 1}, "colour"),
        ({"centres": [[0.0, 0.0]]}, "radius"),
        ({"centres": [[0.9, 0.0]], "radius": 0.3}, "beyond unicycle.radius"),
        (0.5, "footprint"),
    ],
)
def test_configs_refuse_bad_footprints(footprint: Any, words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        build("robots", {"type": "unicycle", "radius": 1.0, "footprint": footprint}, "robot")


# corners


def rotated(places: Any, position: Any, heading: float) -> np.ndarray:
    turn = np.array([[cos(heading), -sin(heading)], [sin(heading), cos(heading)]])
    return np.asarray(position) + np.asarray(places) @ turn.T


def test_corners_are_rotated_and_moved() -> None:
    rng = np.random.default_rng(0)
    positions, headings = rng.normal(0.0, 5.0, (50, 2)), rng.uniform(-9.0, 9.0, 50)
    batch = Pose((positions[:, 0], positions[:, 1]), headings, CAR.vertices).corners()
    x, phi = ca.SX.sym("x", 2), ca.SX.sym("phi")
    stated = Pose((x[0], x[1]), phi, CAR.vertices).corners()
    symbolic = ca.Function("corners", [x, phi], [ca.horzcat(*(ca.vertcat(*c) for c in stated))])
    for i, (position, heading) in enumerate(zip(positions, headings, strict=True)):
        wanted = rotated(CAR.vertices, position, heading)
        single = Pose(tuple(position), heading, CAR.vertices).corners()
        assert np.allclose(single, wanted, atol=1e-12)
        assert np.allclose([[c[0][i], c[1][i]] for c in batch], wanted, atol=1e-12)
        assert np.allclose(symbolic(position, heading).full().T, wanted, atol=1e-12)


def test_a_point_has_one_corner_and_no_heading_is_needed() -> None:
    assert Pose((1.0, 2.0)).corners() == ((1.0, 2.0),)
    assert Pose((1.0, 2.0), 0.7).corners() == ((1.0, 2.0),)
    assert Pose((1.0, 2.0, 3.0)).offset((0.0, 0.0)) == (1.0, 2.0, 3.0)


# bodies in the problem


def test_the_body_that_a_region_sees() -> None:
    long, car = Unicycle(radius=1.0, footprint=DISCS), Unicycle(radius=1.0, footprint=CAR)
    for region in PLANAR:
        discs, none = built_in(region)
        assert discs.bodies(Unicycle()) == (Body(0.75),) and none.bodies(Unicycle()) == ()
        assert discs.bodies(long) == tuple(Body(0.35, place) for place in DISCS.centres)
    ellipse, line = built_in(MahalanobisEllipse()), built_in(SeparatingLine())
    assert ellipse[0].bodies(car) == (Body(1.0),)
    assert line[0].bodies(car) == (Body(0.0, outline=CAR.vertices),)
    among = built_in(MahalanobisEllipse(), load("static_regions", "dual")())
    assert among[1].bodies(car) == (Body(0.0, outline=CAR.vertices),)

    def reach(robot: Unicycle, kinds: tuple[SlotKind, ...]) -> float:
        return farthest(body for kind in kinds for body in kind.bodies(robot))

    assert reach(car, ellipse) == 0.0  # a disc does not turn
    assert reach(car, among) == pytest.approx(CAR.reach)
    assert reach(car, line) == pytest.approx(CAR.reach)
    assert reach(long, ellipse) == np.hypot(*DISCS.centres[0])


STEPS, SLOTS, SIZE = 100, 3, 0.3


def scattered(
    robot: Unicycle, region: Region, level: LevelPolicy, s: float = float("nan")
) -> tuple[Problem, Parameters, Guess, ObstacleSet]:
    """One problem whose steps are as many random poses and obstacles; two slots are empty."""
    rng = np.random.default_rng(1)
    mean = rng.uniform(-2.5, 2.5, (STEPS, SLOTS, 2))
    root = rng.uniform(-0.5, 0.5, (STEPS, SLOTS, 2, 2))
    covariance = root @ root.swapaxes(-1, -2) + 0.002 * np.eye(2)
    found = ObstacleSet(mean, covariance, np.full(SLOTS, SIZE), ("a", "b", "c"))
    states = np.zeros((STEPS + 1, 5))
    states[:, :2] = rng.uniform(-1.5, 1.5, (STEPS + 1, 2))
    states[:, 2] = rng.uniform(-pi, pi, STEPS + 1)
    reference = lay_reference(Path(np.array([[0.0, 0.0], [9.0, 0.0]])), 0.0, 0.5, STEPS, 0.5)
    plugs = robot, region, level, 0.0, None
    parameters = among(states[0], reference, found, NONE, np.zeros((STEPS, 2, 2)), plugs)
    capacity = len(parameters.slots[0].active)
    problem = assemble(robot, region, level, horizon=STEPS, dt=0.5, capacity=capacity)
    guess = Guess.bare(states, np.zeros((STEPS, 2)), s)
    point = with_auxiliaries(robot, region, parameters, guess)
    return problem, point.pull(parameters), point, found


def rows(problem: Problem, parameters: Parameters, point: Guess) -> tuple[np.ndarray, np.ndarray]:
    """Smallest inequality per step, slot and body, and all equalities."""
    level = np.full((int(problem.shared), STEPS), point.level)
    path = (point.states[:-1].T, point.inputs.T, point.states[1:].T)
    lifted = [own.reshape(STEPS, -1).T for own in point.auxiliaries]
    stated = residuals(problem)(*path, level, parameters.stages().T, *lifted)
    free, tied = stated[4], stated[5]
    values = free.full().reshape(problem.slots[0].count, len(DISCS.centres), -1, STEPS)
    return np.moveaxis(values.min(axis=2), -1, 0), tied.full()


@pytest.mark.parametrize("region", PLANAR, ids=lambda region: type(region).__name__)
@pytest.mark.parametrize(
    "level", [Fixed(0.2), Relaxed(0.2, weight=1.0, minimum=0.0)], ids=["fixed", "shared"]
)
def test_every_disc_has_the_rows_of_its_region(region: Region, level: LevelPolicy) -> None:
    robot = Unicycle(radius=1.0, footprint=DISCS)
    s = (
        region.level(0.1) if isinstance(level, SharedLevel) else np.nan
    )  # the shared level counts, not the target
    problem, parameters, point, _ = scattered(robot, region, level, s)
    values, tied = rows(problem, parameters, point)
    (discs,) = parameters.slots
    assert np.abs(tied).max(initial=0.0) < 1e-8 and (values[:, SLOTS:] == 1.0).all()
    held = np.full((STEPS, SLOTS), s) if isinstance(level, SharedLevel) else discs.level[:, :SLOTS]
    for i, place in enumerate(DISCS.centres):
        centres = np.array([rotated([place], x[:2], x[2])[0] for x in point.states[1:]])
        inside = region.contains(centres[:, None], discs.parameters[:, :SLOTS], held)
        clear = np.abs(values[:, :SLOTS, i]) > 1e-6
        assert np.array_equal(values[:, :SLOTS, i][clear] < 0.0, inside[clear])
        assert inside.sum() > 10 and (~inside).sum() > 10 and clear.mean() > 0.95


def shapes(robot: Unicycle, disc: bool, state: np.ndarray) -> tuple[Any, float]:
    """Shape without its rounding, and the rounding, m."""
    footprint = None if disc else robot.footprint
    if isinstance(footprint, Discs):
        return shapely.MultiPoint(rotated(footprint.centres, state[:2], state[2])), 0.35
    if isinstance(footprint, Outline):
        return shapely.Polygon(rotated(footprint.vertices, state[:2], state[2])), 0.0
    return shapely.Point(state[:2]), robot.radius


def ellipse(mean: np.ndarray, covariance: np.ndarray, level: float) -> Any:
    angle = np.linspace(0.0, 2.0 * pi, 1000, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return shapely.Polygon(mean + level * (np.linalg.cholesky(covariance) @ circle).T)


@pytest.mark.parametrize("region", [MinkowskiSum(), SeparatingLine()], ids=repr)
@pytest.mark.parametrize("footprint", [None, DISCS, CAR], ids=lambda one: type(one).__name__)
def test_feasible_is_what_shapely_calls_clear(region: Region, footprint: Any) -> None:
    robot = Unicycle(radius=1.0, footprint=footprint)
    problem, parameters, point, found = scattered(robot, region, Fixed(0.2))
    entered = violation(problem, parameters, point).regions
    assert not entered[:, SLOTS:].any()
    level, seen = region.level(0.2), []
    disc = isinstance(region, MinkowskiSum) and isinstance(footprint, Outline)
    for step, state in enumerate(point.states[1:]):
        body, rounding = shapes(robot, disc, state)
        for slot in range(SLOTS):
            set_ = ellipse(found.mean[step, slot], found.covariance[step, slot], level)
            gap = float(shapely.distance(body, set_)) - rounding - SIZE
            if abs(gap) > 1e-4:  # the inscribed polygon is up to 1e-5 of the axis too small
                assert (entered[step, slot] > 0.0) == (gap < 0.0), (step, slot, gap)
                seen.append(gap < 0.0)
    assert len(seen) > 200 and 0.15 < np.mean(seen) < 0.9


def test_a_closer_footprint_gives_room() -> None:
    """Whatever the enclosing disc may do the outline may do too, and more."""
    region, level = SeparatingLine(), Fixed(0.2)
    feasible = {}
    for name, footprint in (("disc", None), ("outline", CAR)):
        problem, parameters, point, _ = scattered(
            Unicycle(radius=1.0, footprint=footprint), region, level
        )
        feasible[name] = violation(problem, parameters, point).regions <= 0.0
    assert (feasible["outline"] | ~feasible["disc"]).all()
    assert feasible["outline"].sum() > feasible["disc"].sum() + 20
