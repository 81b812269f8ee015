"""A robot that never drives backwards: its plans and commands, and the turn towards its path."""

from math import pi
from typing import Any

import numpy as np
import pytest
import shapely

from wideberth.controllers.costs.contouring import Contouring
from wideberth.controllers.recommended import recommended
from wideberth.framework.mpc.ocp.command_robot import command_robot_of
from wideberth.framework.mpc.ocp.progress_robot import progress_robot_of
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.starts import OTHERS, faces_away, other_starts
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Detection, Observation, Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.plant import KinematicPlant
from wideberth.tests.helpers.forwards import AHEAD, SPEED, forwards

EAST = Path(np.array([[0.0, 0.0], [8.0, 0.0]]))
CORRIDOR = tuple(
    Polygon(((-4.0, y), (12.0, y), (12.0, y + 0.2), (-4.0, y + 0.2)), name)
    for y, name in ((1.3, "left"), (-1.5, "right"))
)
"""2.6 m wide; the robot's disc of 2 m leaves 0.3 m on either side."""


class Drive:
    """A closed loop of a robot that stands and looks ``heading`` rad away from its path, east.

    Attributes
    ----------
    end : where it came to in ``time`` s. nearest : m, least distance of its disc from walls.
    slowest : m/s, of all plans and commands.
    """

    def __init__(
        self, robot: Robot, heading: float, limit: float, walls: Any = (), **settings: Any
    ) -> None:
        made = recommended(robot, SPEED, quiet=True, **settings)
        made.set_path(EAST)
        state = robot.state_at(Pose((0.0, 0.0), heading), Twist((0.0, 0.0)))
        plant = KinematicPlant(robot, state, Twist((0.0, 0.0)))
        solid = shapely.union_all([shapely.Polygon(wall.vertices) for wall in walls])
        self.time, self.slowest, self.nearest = 0.0, 0.0, np.inf
        while self.time < limit and np.hypot(*(self.place(plant) - EAST.goal)) > 0.5:
            command = made.command(Observation(self.time, np.array(plant.state), polygons=walls))
            self.slowest = min(self.slowest, command.linear[0], slowest(made))
            plant.command(command, self.time)
            for _ in range(5):
                plant.advance(self.time, made.period / 5)
                self.time += made.period / 5
                gap = shapely.distance(shapely.Point(self.place(plant)), solid) - robot.radius
                self.nearest = min(self.nearest, float(gap) if walls else np.inf)
        self.end = self.place(plant)

    @staticmethod
    def place(plant: KinematicPlant) -> Array:
        return np.array(plant.robot.pose(plant.state).position, dtype=np.float64)


def slowest(made: Planner) -> float:
    """Return the least speed of a plan after its first state, m/s."""
    plan = made.plan
    assert plan is not None
    found = made.robot.twist(tuple(plan.states[1:].T), tuple(plan.inputs.T))
    return float(np.min(found.linear[0]))


@pytest.mark.parametrize("name", ["unicycle", "differential_drive", "unicycle_velocity"])
@pytest.mark.parametrize("heading", [2.0, pi])
def test_it_turns_on_the_spot_in_a_corridor(name: str, heading: float) -> None:
    """A wide loop would end at a wall. Between two steps it may come nearer than 0.05 m."""
    drive = Drive(forwards(name), heading, 15.0, CORRIDOR)
    assert drive.time < 11.0 and drive.end[0] > 7.5
    assert drive.nearest > 0.045 and drive.slowest >= -1e-6


@pytest.mark.parametrize("name", ["unicycle", "differential_drive"])
def test_without_the_start_it_stays_where_it_stands(name: str) -> None:
    """To look away is a local optimum: it is no nearer once it has turned a little."""
    assert Drive(forwards(name), pi, 12.0, starts="auto").end[0] > 7.0
    assert np.hypot(*Drive(forwards(name), pi, 6.0, starts=()).end) < 1e-3


@pytest.mark.parametrize("name", ["unicycle", "differential_drive", "unicycle_velocity"])
@pytest.mark.parametrize(("start", "heading"), [(6.0, 0.4), (8.0, 0.5), (8.5, 0.0), (9.5, 0.0)])
def test_it_comes_to_its_goal_and_stays(name: str, start: float, heading: float) -> None:
    """It does not turn for what lies within its disc; from farther beyond it comes back."""
    robot = forwards(name)
    made = recommended(robot, SPEED, quiet=True)
    made.set_path(EAST)
    state = robot.state_at(Pose((start, 0.0), heading), Twist((0.0, 0.0)))
    plant = KinematicPlant(robot, state, Twist((0.0, 0.0)))
    for tick in range(120):
        plant.command(made.command(Observation(tick * made.period, np.array(plant.state))), 0.0)
        plant.advance(tick * made.period, made.period)
    assert abs(Drive.place(plant)[0] - 8.0) < (0.6 if start == 8.5 else 0.2)
    assert len(made.explain().guesses) == 1


@pytest.mark.parametrize("name", AHEAD)
@pytest.mark.parametrize("iterations", [100, 6])
def test_no_plan_and_no_command_is_backwards(name: str, iterations: int) -> None:
    """In a crowd, from noisy states, on every rung of the ladder."""
    rng, robot = np.random.default_rng(4), forwards(name)
    made = recommended(
        robot, SPEED, quiet=True, solver={"type": "riccati", "iterations": iterations}
    )
    made.set_path(EAST)
    people, speeds = rng.uniform((1, -3), (7, 3), (8, 2)), rng.normal(0.0, 0.7, (8, 2))
    state = np.array(robot.state_at(Pose((0.0, 0.0), 0.5), Twist((0.5, 0.0))), dtype=np.float64)
    rungs = set()
    for tick in range(60):
        seen = tuple(
            Detection(f"{k}", place, 1e-4 * np.eye(2), 0.3) for k, place in enumerate(people)
        )
        command = made.command(Observation(tick * made.period, state, seen))
        assert min(command.linear[0], slowest(made)) >= -1e-6
        assert made.plan is not None
        rungs.add(str(made.plan.rung))
        state = made.plan.states[1] + 0.01 * rng.standard_normal(len(state))
        people = people + made.period * speeds
        speeds = np.where(np.abs(people - [4.0, 0.0]) > [4.0, 3.0], -speeds, speeds)
    assert len(rungs) >= (3 if iterations < 10 else 1)


# ---- The starting point


def posed(robot: Robot, heading: float, path: Path = EAST, **settings: Any) -> Any:
    """Problem, numbers and first guess of a planner whose robot stands and looks that way."""
    made: Planner = build(
        "controllers",
        {"type": "recommended", "robot": robot, "reference_speed": SPEED, **settings},
    )
    made.set_path(path)
    state = robot.state_at(Pose((0.0, 0.0), heading), Twist((0.0,) * robot.dimension))
    made.command(Observation(0.0, np.array(state, dtype=np.float64)))
    return made.explain()


@pytest.mark.parametrize(
    ("robot", "heading", "away"),
    [
        (forwards("unicycle"), pi, True),
        (forwards("unicycle"), -1.6, True),
        (forwards("unicycle"), 1.7, True),
        (forwards("unicycle"), 1.5, False),
        (forwards("differential_drive"), 2.0 * pi, False),
        (forwards("unicycle_velocity"), 3.0 * pi, True),
        (Unicycle(max_speed=2.0, max_reverse_speed=0.3), pi, True),
        (Unicycle(max_speed=2.0), pi, False),
        (Bicycle(max_speed=2.0, max_reverse_speed=0.0), pi, False),
        (Holonomic(max_speed=2.0), 0.0, False),
    ],
)
@pytest.mark.parametrize("cost", ["tracking", "contouring"])
def test_who_faces_away(robot: Robot, heading: float, away: bool, cost: str) -> None:
    """Who turns on the spot, and is slower backwards than ahead; the others try what they did."""
    found = posed(robot, heading, cost=cost)
    model = progress_robot_of(robot) if cost == "contouring" else robot
    assert faces_away(model, found.parameters) == away
    assert len(found.guesses) == 1 + away


def test_a_way_that_begins_behind_it_is_one_to_turn_to() -> None:
    """Round a wall, where most of the reference lies ahead."""
    around = Path(np.array([(0.0, 0.0), (-1.0, 0.0), (-1.0, 1.0), (8.0, 1.0)]))
    found = posed(forwards("unicycle"), 0.0, around)
    assert found.parameters.reference[:, 0].mean() > 0.0
    assert faces_away(forwards("unicycle"), found.parameters)


@pytest.mark.parametrize("name", ["unicycle", "differential_drive", "unicycle_velocity"])
@pytest.mark.parametrize("heading", [-3.0, -1.7, 0.0, 0.4, 2.0, pi, 9.0])
def test_the_turn_ends_along_the_path(name: str, heading: float) -> None:
    """On the spot, the short way round, and to within what one step turns."""
    found = posed(forwards(name), heading)
    problem, parameters = found.problem(), found.parameters
    robot = forwards(name)
    robot = command_robot_of(robot, problem.dt) if name == "unicycle_velocity" else robot
    (turn,) = other_starts(robot, problem, parameters, found.guesses[0], ("turn",))
    pose = robot.pose(tuple(turn.states.T))
    headings = np.asarray(pose.heading, dtype=np.float64)
    nearest = 2.0 * pi * round(heading / (2.0 * pi))
    assert abs(headings[-1] - nearest) <= 1.0 * problem.dt + 1e-9
    assert np.abs(headings - heading).max() <= pi + 1.0 * problem.dt
    turning = np.abs(headings - nearest) > pi / 3
    assert np.hypot(*pose.points()[turning].T).max(initial=0.0) < 0.1
    assert problem.horizon * problem.dt < 7.0 and pose.points()[-1, 0] > 0.2


def test_a_car_and_a_robot_without_heading_have_a_turn_too() -> None:
    """It can be named for every robot: it drives ahead where there is nothing to turn."""
    for robot in (Bicycle(max_speed=2.0, max_reverse_speed=0.0), Holonomic(max_speed=2.0)):
        found = posed(robot, 0.1, starts=("turn",), cost=Contouring())
        assert len(found.guesses) == 2
        assert found.guesses[1].states[-1, 0] > 1.0


def test_it_is_no_start_of_every_planner() -> None:
    """What is tried round obstacles is as before."""
    assert "turn" not in OTHERS
