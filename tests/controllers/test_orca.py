"""ORCA: the half-planes it keeps, against brute force; walls; who makes way."""

import sys

import numpy as np
import pytest

from wideberth.controllers.orca import Orca
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.measures.summary import clearances
from wideberth.simulation.sensing.channel import Channel

pytest.importorskip("pyrvo")
BODY = HolonomicVelocity(radius=0.3, max_speed=1.0)


def straight(*points):
    return Path(np.array(points, dtype=np.float64))


def seen(name, place, radius=0.3):
    return Detection(name, np.array(place, dtype=float), np.zeros((2, 2)), radius)


def answer(controller, observations):
    """Last command, as a velocity."""
    commands = [controller.command(one) for one in observations]
    assert not controller.reason
    return np.array(commands[-1].linear)


def test_alone_it_goes_to_its_goal_and_stops_there():
    controller = Orca(BODY)
    controller.set_path(straight((0, 0), (3, 4)))
    far = answer(controller, [Observation(0.0, np.zeros(2))])
    np.testing.assert_allclose(far, (0.6, 0.8), atol=1e-6)
    near = answer(controller, [Observation(0.25, np.array([3.0, 3.6]))])
    np.testing.assert_allclose(near, (0.0, 0.4), atol=1e-6)


def change(place, velocity, radius, horizon):
    """Smallest change of the relative velocity that leaves its obstacle, by search.

    Inside, the nearest of all velocities that touch at some time in (0, horizon] and not before.
    """
    times = np.linspace(horizon / 400, horizon, 400)
    angles = np.linspace(-np.pi, np.pi, 3601)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    edge = ((place + radius * around) / times[:, None, None]).reshape(-1, 2)
    square = np.einsum("ed,ed->e", edge, edge)
    first = np.clip(edge @ place / square, 0.0, horizon)  # when they are nearest
    gap = np.linalg.norm(place - first[:, None] * edge, axis=1)
    edge = edge[gap >= radius - 1e-4]  # touches, but does not go in
    return edge[np.argmin(np.linalg.norm(edge - velocity, axis=1))] - velocity


@pytest.mark.parametrize("place", [(3.0, 0.2), (2.0, -0.5), (4.0, 0.3)])
def test_takes_half_of_the_smallest_change(place):
    """One neighbour who comes; own velocity, wanted velocity and the half-plane by brute force."""
    controller = Orca(BODY, safety_space=0.0)
    controller.set_path(straight((0, 0), (50, 0)))
    other, step = np.array([-0.6, 0.1]), 0.25
    before = Observation(0.0, np.array([-0.25, 0.0]))  # nobody: own velocity becomes (1, 0)
    at = [Observation(0.25, np.zeros(2), (seen("a", place),))]
    controller.command(before)
    controller.remember(Observation(0.0, np.zeros(2), (seen("a", place - step * other),)))
    found = answer(controller, at)
    own = np.array([1.0, 0.0])
    u = change(np.array(place), own - other, 0.6, 5.0)
    normal = u / np.linalg.norm(u)
    values = np.linspace(-1.0, 1.0, 801)
    grid = np.stack(np.meshgrid(values, values), axis=-1).reshape(-1, 2)
    allowed = (np.linalg.norm(grid, axis=1) <= 1.0) & ((grid - own - 0.5 * u) @ normal >= 0.0)
    best = grid[allowed][np.argmin(np.linalg.norm(grid[allowed] - own, axis=1))]
    np.testing.assert_allclose(found, best, atol=6e-3)
    assert abs(found[1]) > 0.01  # it does give way


def met(robot, other, visible=True, **settings):
    """Two come towards each other, slightly aside; least clearance, m."""
    quiet = Settings(time_limit=30.0, plant_step=0.05, history=0.0, channel=Channel(noise=0.0))
    ways = straight((-4, 0.05), (4, 0.05)), straight((4, -0.05), (-4, -0.05))
    agents = [
        RobotAgent("a", robot, Orca(robot, **settings), ways[0], 0.0, visible=visible),
        RobotAgent("b", other, Orca(other, **settings), ways[1], 0.0, person=True),
    ]
    episode = run_episode(agents, quiet)
    assert episode.ended == "goals"
    return clearances(episode)[("a", "b")]


def test_two_who_see_each_other_do_not_touch():
    assert met(BODY, BODY) > 0.0
    assert met(BODY, BODY, safety_space=0.1) > 0.1


def test_with_inertia_and_with_heading_some_space_is_enough():
    holonomic = Holonomic(radius=0.3, max_speed=1.0, max_acceleration=1.0)
    assert met(holonomic, holonomic, safety_space=0.1) > 0.0
    unicycle = Unicycle(0.3, 1.0, 1.0, 1.0, 2.0)
    assert met(unicycle, unicycle, safety_space=0.1) > 0.0


def test_stops_before_a_wall():
    """Towards a wall no faster than gets there within the horizon."""
    controller = Orca(BODY, safety_space=0.0, obstacle_horizon=2.0)
    controller.set_path(straight((0, 0), (5, 0)))
    wall = Polygon(((1.3, -20.0), (1.5, -20.0), (1.5, 20.0), (1.3, 20.0)))
    found = answer(controller, [Observation(0.0, np.zeros(2), polygons=(wall,))])
    assert found[0] == pytest.approx((1.3 - 0.3) / 2.0, abs=1e-3)


@pytest.mark.parametrize("robot", [BODY, Unicycle()])
def test_keeps_the_laws_of_a_controller(robot):
    check_controller(Orca(robot))


def test_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyrvo", None)
    with pytest.raises(WideberthError, match=r"pip install 'wideberth\[arenas\]'"):
        Orca(BODY)
    with pytest.raises(WideberthError, match="most_neighbours"):
        Orca(BODY, most_neighbours=0)
