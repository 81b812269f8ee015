"""The path that the planner follows: none, a new one, a loop, a hairpin, and its end."""

from typing import Any

import numpy as np
import pytest

from wideberth import recommended
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.robot import step
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.predictors.kalman import Kalman
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.routes.walls import box
from wideberth.solvers.fatrop import Fatrop
from wideberth.tests.helpers.planning import approach, at, planner


def test_a_command_without_a_path_raises() -> None:
    made = Planner(
        Unicycle(), MahalanobisEllipse(), Kalman(), Relaxed(weight=1.0, minimum=0.0), Fatrop()
    )
    made.remember(at(0.0, 0.0))
    with pytest.raises(WideberthError, match="no path is set: call set_path before command"):
        made.command(at(0.0, 0.0))
    assert made.last_plan is None
    with pytest.raises(WideberthError, match="Planner has no plan: a planner has one after its"):
        _ = made.plan


def test_the_path_may_change_without_losing_history() -> None:
    made = planner()
    approach(made)
    made.set_path(Path(np.array([[1.0, 0.0], [1.0, 9.0]])))
    made.command(at(3.0, 1.5, ("other", 4.5, 0.1)))
    assert made.plan is not None
    assert made.plan.reference[-1, 1] > 2.0
    assert made.plan.fallbacks == (None,)
    with pytest.raises(WideberthError, match="columns"):
        made.set_path(Path(np.array([[1.0, 0.0, 0.0], [1.0, 9.0, 0.0]])))


def test_a_new_path_is_joined_where_the_robot_is() -> None:
    made = planner()
    made.command(at(0.0, 0.0))
    made.command(at(0.5, 12.0))
    made.set_path(Path(np.array([[0.0, 0.0], [30.0, 0.0]])))
    made.command(at(1.0, 12.2))
    assert made.plan is not None
    assert made.plan.reference[0, 0] == pytest.approx(12.45)


def test_a_loop_starts_at_its_start_and_a_hairpin_is_not_cut() -> None:
    angle = np.linspace(0, 2 * np.pi, 60)
    loop = planner()
    loop.set_path(Path(np.stack([5 * np.sin(angle), 5 - 5 * np.cos(angle)], -1)))
    loop.command(at(0.0, -0.02))
    assert loop.plan is not None
    assert loop.plan.reference[-1, 0] > 2.0
    hairpin = planner()
    hairpin.set_path(Path(np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 0.4], [0.0, 0.4]])))
    for k in range(5):
        hairpin.command(at(0.5 * k, 0.25 * k, y=0.1 * k))
    assert hairpin.plan is not None
    assert hairpin.plan.reference[0, 0] == pytest.approx(1.25, abs=0.05)
    assert hairpin.plan.reference[0, 1] == 0.0


def driven_end(made: Planner, points: Any, again: int = 0, seconds: float = 60.0) -> Any:
    """Return where a robot stands that drives as planned; the path comes again, 1 mm aside."""
    made.set_path(Path(points))
    state = np.zeros(len(made.robot.states))
    for k in range(round(seconds / made.period)):
        if again and k and k % again == 0:
            made.set_path(Path(np.array(points) + 0.001 * (k // again % 5)))
        made.command(Observation(made.period * k, state))
        assert made.plan is not None
        state = np.array(step(made.robot, state, made.plan.inputs[0], made.period))
    moves = made.plan.states[1] - made.plan.states[0]
    assert np.abs(moves[:2]).max() < 0.05, "it does not stand"
    return state[:2]


SPIKES = [((0.0, 0.0), (3.0, 0.0), (0.0, 0.0)),
          ((0.0, 0.0), (2.0, 0.0), (2.0, 1.5), (2.0, 0.0), (4.0, 0.0))]  # fmt: skip


@pytest.mark.parametrize("points", SPIKES)
@pytest.mark.parametrize("cost", ["tracking", "contouring"])
@pytest.mark.parametrize("robot", ["holonomic", "unicycle"])
def test_a_path_back_over_itself_is_followed_to_its_end(
    robot: str, cost: str, points: Any
) -> None:
    made = recommended(robot, quiet=True, cost=cost, predictor="kalman")
    assert driven_end(made, points) == pytest.approx(points[-1], abs=0.15)


def test_a_loop_that_is_sent_again_ends() -> None:
    loop = ((0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0), (0.0, 0.0))
    made = recommended("holonomic", quiet=True, predictor="kalman")
    assert driven_end(made, loop, again=2, seconds=45.0) == pytest.approx((0.0, 0.0), abs=0.15)
    made.reset()
    made.set_path(Path(loop))
    made.command(Observation(0.0, np.zeros(4)))
    assert made.plan is not None and made.plan.reference[-1, 0] > 2.0, "reset begins it anew"


@pytest.mark.parametrize("cost", ["tracking", "contouring"])
@pytest.mark.parametrize("robot", ["unicycle", "differential_drive"])
def test_a_robot_that_turns_at_its_goal_comes_to_rest(robot: str, cost: str) -> None:
    made = recommended(robot, quiet=True, cost=cost, predictor="kalman")
    made.set_path(Path([(0.0, 0.0), (4.0, 0.0)]))
    wheel = 0.24 * getattr(made.robot, "track_width", 0.0) / 2
    motion = (0.0, 0.24) if robot == "unicycle" else (-wheel, wheel)
    for k in range(2):
        command = made.command(Observation(0.5 * k, np.array([4.0, 0.0, 1.0, *motion])))
        assert command.omega == pytest.approx(0.0, abs=0.01)
    away = made.command(Observation(1.0, np.array([3.2, 0.0, 1.0, *motion])))
    assert abs(away.omega) > 0.1, "away from its goal it turns as planned"


@pytest.mark.parametrize(("robot", "cost"), [("unicycle", "tracking"), ("holonomic", "tracking"),
                                             ("unicycle", "contouring")])  # fmt: skip
def test_a_robot_rests_before_somebody_on_its_goal(robot: str, cost: str) -> None:
    made = recommended(robot, quiet=True, cost=cost, predictor="kalman")
    goal, body = np.array([4.0, 0.0]), Detection("p", np.array([4.0, 0.0]), 1e-4 * np.eye(2), 0.3)
    made.set_path(Path([(0.0, 0.0), goal]))
    state, places = np.zeros(len(made.robot.states)), []
    for k in range(150):
        command = made.command(Observation(0.5 * k, state, (body,) if 5 < k < 110 else ()))
        assert made.plan is not None
        state = np.array(made.plan.states[1])
        if robot == "unicycle":
            state[4] = command.omega
        places.append(state[:2])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps[60:108].sum() < 0.3, "it does not rest"
    assert np.linalg.norm(np.array(places[6:110]) - goal, axis=1).min() > made.robot.radius + 0.3
    assert places[-1] == pytest.approx(goal, abs=0.15), "it goes on once the goal is free"


WALL = Polygon(((1.2, -3.0), (1.5, -3.0), (1.5, 3.0), (1.2, 3.0)), "the wall")


@pytest.mark.parametrize("others", [False, True])
def test_a_robot_that_stands_before_its_goal_says_before_what(others: bool) -> None:
    made = recommended({"type": "unicycle", "radius": 0.3}, 0.5, quiet=True, predictor="kalman")
    made.set_path(Path([(0.0, 0.0), (8.0, 0.0)]))
    state, reasons = np.zeros(5), []
    bodies = (Detection("far", np.array([0.0, 2.5]), 1e-4 * np.eye(2), 0.3),) if others else ()
    for k in range(50):
        made.command(Observation(0.5 * k, state, bodies, polygons=(WALL,)))
        assert made.plan is not None
        reasons.append(made.plan.reason)
        state = np.array(made.plan.states[1])
    assert not reasons[5].startswith("blocked"), "it has not stood for long"
    assert reasons[-1].startswith("blocked: it has stood for") and "'the wall'" in reasons[-1]
    made.set_path(Path([(0.0, 0.0), (-8.0, 0.0)]))
    made.command(Observation(25.0, state, bodies, polygons=(WALL,)))
    assert made.plan is not None and "blocked" not in made.plan.reason, "another goal"


def test_a_robot_that_is_wider_than_a_door_says_so() -> None:
    made = recommended(Unicycle(radius=0.3), 0.5, quiet=True, predictor="kalman")
    made.set_path(Path([(0.0, 0.0), (4.0, 0.0)]))
    door = box((1.0, 0.32), (1.2, 8.0)), box((1.0, -8.0), (1.2, -0.32))
    for k in range(13):
        made.command(Observation(0.5 * k, np.array([0.6, 0.0, 0.0, 0.0, 0.0]), polygons=door))
    assert made.plan is not None
    assert "does not fit: no way within 3 m of its path is 0.70 m wide" in made.plan.reason


def test_a_robot_at_its_goal_is_not_blocked() -> None:
    made = recommended("unicycle", quiet=True, predictor="kalman")
    made.set_path(Path([(0.0, 0.0), (8.0, 0.0)]))
    for k in range(30):
        made.command(Observation(0.5 * k, np.array([8.0, 0.0, 0.0, 0.0, 0.0])))
        assert made.plan is not None and made.plan.reason == ""


def test_the_robot_stops_at_the_goal() -> None:
    made = planner()
    state = np.array([18.0, 0.0, 0.0, 0.5, 0.0])
    for k in range(30):
        made.command(Observation(0.5 * k, state))
        assert made.plan is not None
        state = np.array(step(made.robot, state, made.plan.inputs[0], 0.5))
    assert np.linalg.norm(state[:2] - [20.0, 0.0]) < 0.1
    assert abs(state[3]) < 0.05
