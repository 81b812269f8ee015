"""Dynamic window and pure pursuit: exact ways, closed-form braking, brute force, and stops."""

from math import pi, sqrt

import numpy as np
import pytest

from wideberth.controllers import pure_pursuit
from wideberth.controllers.arcs import free_way
from wideberth.controllers.dynamic_window import DynamicWindow
from wideberth.controllers.pure_pursuit import PurePursuit
from wideberth.framework.values.motion import Detection, Observation, Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon, separation
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent, ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel

ROBOTS = [
    Unicycle(radius=0.3),
    DifferentialDrive(radius=0.3),
    Bicycle(radius=0.3),
    Holonomic(radius=0.3),
    HolonomicVelocity(radius=0.3),
]
NAMES = [type(robot).__name__ for robot in ROBOTS]
EAST = Path(np.array([[0.0, 0.0], [8.0, 0.0]]))
LOOP = Settings(time_limit=25.0, history=1.0, channel=Channel(noise=0.0))
NOBODY = (np.zeros((0, 2)), np.zeros(0))


def seen(robot, others=(), polygons=(), heading=0.0, speed=0.0, stamp=0.0):
    pose = Pose((0.0, 0.0), heading)
    state = np.array(robot.state_at(pose, Twist((speed, 0.0))), dtype=float)
    found = tuple(
        Detection(f"p{i}", np.array(place), np.zeros((2, 2)), radius)
        for i, (place, radius) in enumerate(others)
    )
    return Observation(stamp, state, found, polygons=polygons)


def ready(kind, robot, **settings):
    made = kind(robot, **settings)
    made.set_path(EAST)
    return made


def test_free_way_by_hand():
    """r = 0.5 before a disc of 0.5 at 3 m: 2 m straight on; on a circle of radius 3 about
    (0, 3), a disc about the quarter point is met 2 asin(1 / 6) before it."""
    east = np.array([[1.0, 0.0]])
    ahead = np.array([[3.0, 0.0]]), np.array([0.5])
    assert free_way(np.zeros(2), east, np.zeros(1), 0.5, ahead)[0] == pytest.approx(2.0)
    assert free_way(np.zeros(2), -east, np.zeros(1), 0.5, ahead)[0] == np.inf
    aside = np.array([[3.0, 3.0]]), np.array([0.5])
    way = 3.0 * (pi / 2 - 2.0 * np.arcsin(1.0 / 6.0))
    assert free_way(np.zeros(2), east, np.full(1, 1 / 3), 0.5, aside)[0] == pytest.approx(way)
    mirrored = np.array([[3.0, -3.0]]), np.array([0.5])
    assert free_way(np.zeros(2), east, np.full(1, -1 / 3), 0.5, mirrored)[0] == pytest.approx(way)
    wall = Polygon(((2.0, -9.0), (3.0, -9.0), (3.0, 9.0), (2.0, 9.0)))
    straight = free_way(np.zeros(2), east, np.zeros(1), 0.5, NOBODY, (wall,))
    assert straight[0] == pytest.approx(1.5)
    curved = free_way(np.zeros(2), east, np.full(1, 0.5), 0.5, NOBODY, (wall,))
    assert curved[0] == pytest.approx(2.0 * np.arcsin(1.5 / 2.0))
    # What is touched already stops the ways into it, and no others.
    both = np.concatenate([east, -east])
    touched = np.array([[0.9, 0.0]]), np.array([0.5])
    assert free_way(np.zeros(2), both, np.zeros(2), 0.5, touched).tolist() == [0.0, np.inf]
    near = Polygon(((0.4, -9.0), (3.0, -9.0), (3.0, 9.0), (0.4, 9.0)))
    ways = free_way(np.zeros(2), both, np.zeros(2), 0.5, NOBODY, (near,))
    assert ways.tolist() == [0.0, np.inf]


def points_on(place, direction, curvature, lengths):
    """Places on an arc, (L, 2): the chord, at half the angle."""
    half = 0.5 * curvature * lengths
    angle = np.arctan2(direction[1], direction[0]) + half
    chord = lengths * np.sinc(half / pi)
    return place + chord[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def test_free_way_against_dense_steps():
    rng, lengths = np.random.default_rng(0), np.linspace(0.0, 8.0, 1001)
    el = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 3], [0, 3]], dtype=float)
    compared = 0
    for _ in range(30):
        place, angle = rng.normal(size=2), rng.uniform(-pi, pi, 6)
        direction = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        bend = rng.choice([0.0, 1.0, -1.0], 6) * rng.uniform(0.05, 3.0, 6)
        centres, radii = place + 3.0 * rng.normal(size=(3, 2)), rng.uniform(0.0, 0.6, 3)
        shapes = (
            Polygon(tuple(place + 3.0 * rng.normal(size=2) + rng.normal(size=(3, 2)))),
            Polygon(tuple(place + np.array([4.0, -1.0]) + el)),
        )
        radius = rng.uniform(0.1, 0.5)
        found = free_way(place, direction, bend, radius, (centres, radii), shapes)
        for i in range(6):
            there = points_on(place, direction[i], bend[i], lengths)
            gap = (np.linalg.norm(there[:, None] - centres, axis=2) - radii).min(axis=1)
            for part in (part for shape in shapes for part in shape.parts):
                gap = np.minimum(gap, separation(there[:, None], part)[0])
            hits = lengths[gap < radius]
            if gap[0] < radius:
                continue
            compared += 1
            if hits.size:
                assert hits[0] - lengths[1] - 1e-9 <= found[i] <= hits[0] + 1e-9
            else:
                assert found[i] > 7.99 or gap.min() < radius + 1e-5  # grazed between two steps
    assert compared > 100


@pytest.mark.parametrize("robot", [Unicycle(radius=0.3), Holonomic(radius=0.3)])
def test_admissible_speed_is_the_one_that_stops_in_time(robot):
    """v = sqrt(2 a (d - T v)): with a = 0.7 and T = 0.1 the root of v^2 + 0.14 v - 1.4 d."""
    window = ready(DynamicWindow, robot, margin=0.0)
    for speed in (0.2, 0.4, 0.6):
        just = speed**2 / 1.4 + 0.1 * speed
        for distance, right in ((just + 1e-3, True), (just - 1e-3, False)):
            window.reset()
            note = seen(robot, [((0.6 + distance, 0.0), 0.3)], speed=speed)
            window.remember(note)
            window.reference_speed = speed  # the grid then ends at it
            found = window.candidates(note, np.zeros(2), np.array([2.0, 0.0]), 9.0)
            brake = window.braking(note.state)
            assert brake == pytest.approx(0.7)
            fast = np.isclose(found.speed, speed) & (found.curvature == 0.0)
            fast &= found.direction[:, 0] > 1.0 - 1e-12
            assert fast.any()
            np.testing.assert_allclose(found.free[fast], distance, atol=1e-9)
            assert (window.admissible(found, note.state, brake)[fast] == right).all()


def best_by_hand(robot, grid, others, goal, period=0.1, view=3.0):
    """Fox's search for a unicycle at rest in the origin, written out; the winner's twist."""
    best = (-np.inf, None)
    for v, omega in grid:
        bend = omega / v if v > 1e-9 else 0.0
        free = np.inf
        if v > 1e-9:
            lengths = np.linspace(0.0, 4.0, 8001)
            way = points_on(np.zeros(2), np.array([1.0, 0.0]), bend, lengths)
            for place, radius in others:
                near = np.hypot(*(way - place).T) <= radius + robot.radius
                free = min(free, lengths[near.argmax()] if near.any() else np.inf)
        if v**2 > 2 * 0.7 * max(free - period * v, 0.0):
            continue
        stop = v * period + v * v / 1.4
        x, y = points_on(np.zeros(2), np.array([1.0, 0.0]), bend, np.array([stop]))[0]
        facing = omega * period + omega * abs(omega) / 0.2
        error = abs((np.arctan2(goal[1] - y, goal[0] - x) - facing + pi) % (2 * pi) - pi)
        value = 0.8 * (1 - error / pi) + 0.1 * min(free, view) / view + 0.1 * v / 0.5
        best = max(best, (value, (v, omega)), key=lambda entry: entry[0])
    return best[1]


@pytest.mark.parametrize(
    "others", [[], [((0.7, 0.1), 0.3)], [((1.0, -0.3), 0.3), ((0, 0.8), 0.4)]]
)
def test_dynamic_window_finds_what_brute_force_finds(others):
    """From rest one period reaches v <= 0.07 m/s and |omega| <= 0.01 rad/s."""
    robot = Unicycle(radius=0.3)
    window = DynamicWindow(robot, samples=9, margin=0.0, look_ahead=np.inf)
    window.set_path(Path(np.array([[0.0, 0.0], [3.0, 2.0]])))
    command = window.command(seen(robot, others))
    grid = [(v, w) for v in np.linspace(0, 0.07, 9) for w in np.linspace(-0.01, 0.01, 9)]
    want = best_by_hand(robot, grid, others, np.array([3.0, 2.0]))
    np.testing.assert_allclose((command.linear[0], command.omega), want, atol=1e-12)


def drive(kind, robot, others=(), polygons=(), **settings):
    """Least gap to those who stand, and when the goal was reached."""
    agent = RobotAgent("robot", robot, ready(kind, robot, **settings), EAST, 0.5)
    log = run_episode([agent], LOOP, others=others, polygons=polygons).agents[0]
    gaps = [np.inf]
    for one in others:
        there = one.at(np.zeros(1))[0]
        gaps.append(np.hypot(*(log.positions - there).T).min() - one.radius - robot.radius)
    for part in (part for shape in polygons for part in shape.parts):
        gaps.append(separation(log.positions[:, None], part)[0].min() - robot.radius)
    return min(gaps), log


def standing(x, y, radius):
    return ScriptedAgent(f"at {x}", Path(np.array([[x, y], [x, y + 1.0]])), 0.0, radius)


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
@pytest.mark.parametrize("kind", [DynamicWindow, PurePursuit])
def test_the_goal_is_reached_where_nobody_is(kind, robot):
    _, log = drive(kind, robot)
    assert log.reached == pytest.approx(15.0 + np.log(2.0), abs=0.3)
    assert log.speeds[-1] < 0.3


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
def test_dynamic_window_does_not_touch_who_stands(robot):
    gap, log = drive(DynamicWindow, robot, (standing(4.0, 0.1, 0.4),))
    assert gap > 0.1 - 0.02  # what the plant leaves of the margin
    assert np.isfinite(log.reached)
    wall = Polygon(((4.0, -1.0), (5.0, -1.0), (5.0, 1.2), (4.0, 1.2)))
    assert drive(DynamicWindow, robot, polygons=(wall,))[0] > 0.1 - 0.02


@pytest.mark.parametrize("robot", ROBOTS, ids=NAMES)
def test_pure_pursuit_stops_and_goes_on(robot):
    """It looks 1 s ahead at 0.5 m/s, and stops 0.5 m before contact less what braking takes."""
    gap, log = drive(PurePursuit, robot, (standing(4.0, 0.0, 0.4),))
    assert np.isnan(log.reached) and log.speeds[-1] < 1e-6
    assert 0.1 < gap < 0.1 + 0.5
    passing = ScriptedAgent("passing", Path(np.array([[4.0, -3.0], [4.0, 9.0]])), 0.4, 0.4)
    _, log = drive(PurePursuit, robot, (passing,))
    assert log.speeds.min() < 0.05 and log.reached > 16.0


def test_pure_pursuit_arc_and_speed(monkeypatch):
    """Carrot at (1, 1): kappa = 1 / m, tighter than 0.9 m is not: v = 0.3 / 1 by the yaw rate."""
    monkeypatch.setattr(pure_pursuit, "TURN_FROM", 1.0)
    robot = Unicycle(radius=0.3)
    controller = PurePursuit(robot, look_ahead=np.inf, reference_speed=0.5)
    controller.set_path(Path(np.array([[-9.0, 1.0], [1.0, 1.0]])))
    command = controller.command(seen(robot))
    np.testing.assert_allclose((command.linear[0], command.omega), (0.3, 0.3))
    quick = Unicycle(radius=0.3, max_yaw_rate=3.0)
    monkeypatch.setattr(pure_pursuit, "TIGHT", 2.0)
    controller = PurePursuit(quick, look_ahead=np.inf)
    controller.set_path(Path(np.array([[-9.0, 1.0], [1.0, 1.0]])))
    command = controller.command(seen(quick))
    np.testing.assert_allclose((command.linear[0], command.omega), (0.25, 0.25))
    monkeypatch.undo()
    turning = PurePursuit(quick, look_ahead=np.inf)
    turning.set_path(Path(np.array([[-9.0, 1.0], [1.0, 1.0]])))
    command = turning.command(seen(quick))  # 45 degrees are a little more than 0.785
    assert command.linear[0] == 0.0
    assert command.omega == pytest.approx(sqrt(2.0 * 0.1 * pi / 4), rel=1e-3)
