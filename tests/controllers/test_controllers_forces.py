"""Social forces: by hand, by the other sign convention, and what they do in company."""

from math import exp, pi, sqrt

import numpy as np
import pytest

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.controllers.moussaid_force import MoussaidForce
from wideberth.controllers.social_force import SocialForceController
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.people.walls import away_from_walls
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel

WALKER = HolonomicVelocity(radius=0.3, max_speed=2.0)
EAST = Path(np.array([[0.0, 0.0], [8.0, 0.0]]))
WALL = Polygon(((-1.0, 0.5), (9.0, 0.5), (9.0, 1.0), (-1.0, 1.0)))
LOOP = Settings(time_limit=40.0, history=1.0, channel=Channel(noise=0.0))


def seen(stamp, others=(), polygons=(), place=(0.0, 0.0)):
    found = tuple(
        Detection(f"p{i}", np.array(where), np.zeros((2, 2)), 0.2)
        for i, where in enumerate(others)
    )
    return Observation(stamp, np.array(place), found, polygons=polygons)


def walker(kind, **settings):
    made = kind(WALKER, reference_speed=1.0, **settings)
    made.set_path(EAST)
    return made


def force_of(controller, velocity, first, second, polygons=()):
    """Force on a walker in the origin who has seen others at two instants, 1 s apart."""
    controller.remember(seen(0.0, first))
    last = seen(1.0, second, polygons)
    controller.remember(last)
    return controller.acceleration(last, np.zeros(2), np.array(velocity), np.array([1.0, 0.0]))


def test_circular_force_by_hand():
    """One at (0.6, 0.8), 1 m off; a wall 0.5 m to the left: n = -(0.6, 0.8) and (0, -1)."""
    place = [(0.6, 0.8)]
    push = 3.0 * exp((0.3 + 0.2 + 0.01 - 1.0) / 0.18)
    wall = 2.0 * exp((0.3 + 0.01 - 0.5) / 0.025)
    found = force_of(walker(SocialForceController), (0.4, 0.1), place, place, (WALL,))
    np.testing.assert_allclose(found, (0.6 - 0.6 * push, -0.1 - 0.8 * push - wall), rtol=1e-12)
    moving = force_of(walker(SocialForceController), (0.4, 0.1), [(3.0, 3.0)], place, (WALL,))
    np.testing.assert_allclose(moving, found)  # how others move plays no part


def test_velocity_approaches_the_wanted_one_geometrically():
    controller = walker(SocialForceController, stiffness=2.0, period=0.1)
    for k in range(1, 8):
        command = controller.command(seen(0.1 * k))
        np.testing.assert_allclose(command.linear, (1.0 - 0.8**k, 0.0), rtol=1e-12)
    controller = walker(MoussaidForce, relaxation=0.5, period=0.1)
    for k in range(1, 8):
        command = controller.command(seen(0.1 * k))
        np.testing.assert_allclose(command.linear, (1.0 - 0.8**k, 0.0), rtol=1e-12)


@pytest.mark.parametrize(("kind", "fastest"), [(SocialForceController, 1.0), (MoussaidForce, 1.3)])
def test_speed_is_limited(kind, fastest):
    controller = walker(kind)
    speeds = []
    for k in range(20):  # people come running from behind, again and again
        command = controller.command(seen(0.1 * k, [(-1.25 + 0.25 * (k % 4), 0.0)]))
        speeds.append(np.hypot(*command.linear))
    assert max(speeds) == pytest.approx(fastest)
    controller = walker(kind)
    inside = seen(0.0, [(1e-9, 0.0), (0.0, 0.0)], (WALL,), (0.0, 0.75))
    assert np.isfinite(controller.command(inside).linear).all() and not controller.reason


def test_robots_start_with_the_velocity_they_have():
    robot = Holonomic(radius=0.3, max_speed=2.0)
    controller = SocialForceController(robot, reference_speed=1.0)
    controller.set_path(EAST)
    command = controller.command(Observation(0.0, np.array([0.0, 0.0, 1.0, 0.0])))
    np.testing.assert_allclose(command.linear, (1.0, 0.0), rtol=1e-12)


def test_moussaid_by_hand():
    """Both at 1 m/s towards each other, 2 m apart, 0.2 m aside."""
    e = np.array([2.0, 0.2]) / sqrt(4.04)
    interaction = 2.0 * np.array([2.0, 0.0]) + e
    size = sqrt(interaction @ interaction)
    t = interaction / size
    theta = np.arctan2(e[1], e[0]) - np.arctan2(t[1], t[0])
    reach = 0.35 * size
    far = exp(-sqrt(4.04) / reach)
    slow, turn = far * exp(-((3 * reach * theta) ** 2)), far * exp(-((2 * reach * theta) ** 2))
    want = -5.1 * (slow * t + turn * np.array([-t[1], t[0]]))  # theta > 0: to the right
    got = force_of(walker(MoussaidForce), (1.0, 0.0), [(3.0, 0.2)], [(2.0, 0.2)])
    np.testing.assert_allclose(got, want, rtol=1e-12)
    assert got[1] < 0.0
    mirrored = force_of(walker(MoussaidForce), (1.0, 0.0), [(3.0, -0.2)], [(2.0, -0.2)])
    np.testing.assert_allclose(mirrored, want * (1.0, -1.0), rtol=1e-12)


def other_convention(place, velocity, other, moving):
    """PySocialForce's formula: all vectors from the other to oneself, theta from e to t."""
    apart = place - other
    length = np.linalg.norm(apart)
    interaction = 2.0 * (moving - velocity) + apart / length
    size = np.linalg.norm(interaction)
    t = interaction / size
    theta = np.arctan2(t[1], t[0]) - np.arctan2(apart[1], apart[0])
    theta = (theta + pi) % (2 * pi) - pi  # which it leaves out
    reach = 0.35 * size
    along = np.exp(-length / reach - (3.0 * reach * theta) ** 2)
    aside = -np.sign(theta) * np.exp(-length / reach - (2.0 * reach * theta) ** 2)
    return 5.1 * (along * t + aside * np.array([-t[1], t[0]]))


def test_moussaid_against_the_other_sign_convention():
    rng = np.random.default_rng(2)
    for _ in range(50):
        first, second, velocity = rng.normal(size=(3, 2))
        first = 2.0 * first
        second = first + 0.3 * second  # no farther than a person moves between two sightings
        want = other_convention(np.zeros(2), velocity, second, second - first)
        want = want + (np.array([1.0, 0.0]) - velocity) / 0.5
        got = force_of(walker(MoussaidForce), velocity, [first], [second])
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-12)


def test_moussaid_walls_push_near_and_not_far():
    controller = walker(MoussaidForce)
    near = force_of(controller, (1.0, 0.0), [], [], (WALL,))
    np.testing.assert_allclose(near, (0.0, -10.0 * exp(-(0.5 - 0.3) / 0.2)), atol=1e-12)
    far = Polygon(((-1.0, 0.81), (9.0, 0.81), (9.0, 1.2), (-1.0, 1.2)))  # 0.3 + 0.3 + 0.2 m
    controller.reset()
    np.testing.assert_allclose(force_of(controller, (1.0, 0.0), [], [], (far,)), 0.0, atol=1e-12)


def test_distance_from_polygons():
    el = Polygon(((0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)))
    distance, away = away_from_walls(np.array([2.0, 1.5]), (el, WALL))
    np.testing.assert_allclose(distance, (0.5, 0.5))
    np.testing.assert_allclose(away, ((0.0, 1.0), (0.0, 1.0)), atol=1e-12)
    distance, away = away_from_walls(np.array([4.0, 2.0]), (el,))
    np.testing.assert_allclose(away, [[sqrt(0.5), sqrt(0.5)]])
    assert distance[0] == pytest.approx(sqrt(2.0))
    distance, away = away_from_walls(np.array([2.5, 0.9]), (el,))  # inside: the nearest way out
    assert distance[0] == pytest.approx(-0.1)
    np.testing.assert_allclose(away, [[0.0, 1.0]], atol=1e-12)
    assert away_from_walls(np.zeros(2), ())[1].shape == (0, 2)


def meeting(kind, robot, offset):
    """Least gap, and when both are at their goals, of two who meet head-on."""
    ways = np.array([[[0.0, 0.0], [8.0, 0.0]], [[8.0, offset], [0.0, offset]]])
    agents = [
        RobotAgent(name, robot, kind(robot), Path(way), 0.5)
        for name, way in zip("ab", ways, strict=True)
    ]
    logs = run_episode(agents, LOOP).agents
    apart = np.linalg.norm(logs[0].positions - logs[1].positions, axis=1)
    return float(apart.min()) - 2.0 * robot.radius, [log.reached for log in logs]


@pytest.mark.parametrize("kind", [SocialForceController, MoussaidForce])
@pytest.mark.parametrize(
    "robot", [Holonomic(radius=0.3), HolonomicVelocity(radius=0.3), Unicycle(radius=0.3)]
)
def test_two_who_meet_get_past_each_other(kind, robot):
    """No promise of the method; people of this size do, 0.2 m off the middle."""
    gap, reached = meeting(kind, robot, 0.2)
    assert gap > 0.0 and np.isfinite(reached).all()


def test_constant_velocity_walks_straight_through():
    gap, reached = meeting(ConstantVelocityController, Unicycle(radius=0.3), 0.0)
    assert gap < -0.5
    # 15 s at 0.5 m/s leave 0.5 m, which then falls as exp(-t): 0.25 m, the tolerance, at ln 2.
    assert reached[0] == pytest.approx(15.0 + np.log(2.0), abs=0.1)
