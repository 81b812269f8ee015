"""Who the people of a scenario are, and what a head start does."""

import numpy as np
import pytest
from scipy import stats

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.controllers.moussaid_force import MoussaidForce
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.routes.walls import box
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.scenarios.corridor import Corridor
from wideberth.simulation.scenarios.crowd_mix import CrowdMix, individual, mix_of
from wideberth.simulation.scenarios.hallway import head_start
from wideberth.simulation.scenarios.placing import apart, draw_place, wall_distance

WAY = Path(np.array([[0.0, 0.0], [10.0, 0.0]]))
DISC = HolonomicVelocity(radius=0.3)


def mixed(**shares):
    return CrowdMix(
        {"blind": ConstantVelocityController(DISC), "polite": MoussaidForce(DISC)}, shares
    )


@pytest.mark.parametrize(("shares", "wanted"), [({}, 0.5), ({"blind": 1.0, "polite": 3.0}, 0.25)])
def test_kinds_are_drawn_by_their_shares(shares, wanted) -> None:
    rng = np.random.default_rng(0)
    people = [mixed(**shares).person(rng, "p", WAY, 1.0, 0.3) for _ in range(800)]
    blind = sum(isinstance(one.controller, ConstantVelocityController) for one in people)
    assert stats.binomtest(blind, 800, wanted).pvalue > 1e-3


def test_a_person_has_radius_and_speed_of_its_own() -> None:
    kind = MoussaidForce(DISC, relaxation=0.7)
    one, two = individual(kind, 1.2, 0.25), individual(kind, 1.2, 0.25)
    assert isinstance(one, MoussaidForce)
    assert one is not two and one is not kind
    assert one.robot == HolonomicVelocity(radius=0.25, max_speed=1.3 * 1.2)  # Moussaïd's haste
    assert (one.reference_speed, one.relaxation) == (1.2, 0.7)
    blind = individual(ConstantVelocityController(DISC), 1.2, 0.25)
    assert isinstance(blind, ConstantVelocityController)
    assert blind.robot == HolonomicVelocity(radius=0.25, max_speed=1.2)
    person = mixed().person(np.random.default_rng(1), "p", WAY, 0.8, 0.2)
    assert person.person and person.radius == 0.2 and person.speed == 0.8


def test_one_draw_whatever_the_kinds() -> None:
    first, second = np.random.default_rng(3), np.random.default_rng(3)
    mixed().person(first, "p", WAY, 1.0, 0.3)
    second.random()
    assert first.random() == second.random()


def test_a_mix_is_written_in_a_config() -> None:
    config = {
        "type": "corridor",
        "crowd": {
            "kinds": {"cv": {"type": "constant_velocity", "robot": "unicycle"}},
            "shares": {"cv": 2.0},
        },
    }
    scenario = build("scenarios", config)
    assert isinstance(scenario, Corridor)
    people = scenario.cast(0).people
    assert all(isinstance(one.robot, Unicycle) for one in people)
    again = build("scenarios", describe(scenario))
    assert describe(again) == describe(scenario)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CrowdMix({}), "kinds is empty"),
        (lambda: mixed(blind=1.0), "shares names"),
        (lambda: mixed(blind=1.0, polite=0.0), "crowd.shares.polite"),
        (lambda: mix_of({"social": {}}), "crowd.social.type: unknown controller"),
    ],
)
def test_bad_mixes_name_themselves(make, message) -> None:
    with pytest.raises(WideberthError, match=message):
        make()


def test_no_room_ends_with_a_message() -> None:
    with pytest.raises(WideberthError, match="no room for person 3: take fewer"):
        draw_place(lambda: np.zeros(2), lambda place: False, "person 3: take fewer")


def test_distances_by_hand() -> None:
    square = box((1.0, -1.0), (3.0, 1.0), "square")
    assert wall_distance(np.zeros(2), (square,)) == pytest.approx(1.0)
    assert wall_distance(np.array([4.0, 2.0]), (square,)) == pytest.approx(np.sqrt(2.0))
    assert wall_distance(np.array([2.0, 0.5]), (square,)) == pytest.approx(-0.5)
    assert wall_distance(np.zeros(2), ()) == np.inf
    other = [(np.array([3.0, 4.0]), 1.0)]
    assert apart(np.zeros(2), 3.0, other, 0.99) and not apart(np.zeros(2), 3.0, other, 1.01)


def straight(place, goal):
    return Path(np.stack([place, goal]))


def walker(start, end, speed=1.0):
    controller = ConstantVelocityController(
        HolonomicVelocity(radius=0.3, max_speed=speed), 0.25, speed
    )
    path = Path(np.array([start, end], dtype=np.float64))
    return RobotAgent("p", controller.robot, controller, path, speed, person=True)


def test_a_head_start_is_walked() -> None:
    (one,) = head_start([walker((0, 0), (9, 0))], 2.5, [], (), straight)
    assert one.path.points.tolist() == [[pytest.approx(2.5), 0.0], [9.0, 0.0]]
    assert one.speed == pytest.approx(1.0) and one.person
    waiting = walker((0, 0), (9, 0))
    assert head_start([waiting], 0.0, [], (), straight) == (waiting,)


def test_a_head_start_ends_before_contact() -> None:
    robot = [(np.array([2.0, 0.0]), 0.25)]
    (one,) = head_start([walker((0, 0), (9, 0))], 2.5, robot, (), straight)
    assert 2.0 - 0.55 - 0.06 < one.path.points[0][0] <= 2.0 - 0.55  # a step of 0.05 s before
    wall = (box((1.5, -1.0), (1.7, 1.0), "wall"),)
    (one,) = head_start([walker((0, 0), (9, 0))], 2.5, [], wall, straight)
    assert 1.2 - 0.06 < one.path.points[0][0] <= 1.2


def test_who_has_arrived_keeps_a_way() -> None:
    (one,) = head_start([walker((0, 0), (0.5, 0))], 12.0, [], (), straight)
    assert one.path.length <= 1.1e-3 and one.path.points[0] == pytest.approx([0.5, 0.0], abs=1e-3)
