"""At the end of its path a robot stands: it runs past it a little at most, and does not circle."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from wideberth import Detection, Observation, Path, names, recommended
from wideberth.framework.control.command_limits import within_reach
from wideberth.framework.control.velocity_smoother import VelocitySmoother
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.robot import start_state, step
from wideberth.robots import Bicycle

TICK = 0.05
NEAR, SLOW = 0.25, 0.1
"""m and m/s: where and at what speed a robot has arrived, Nav2's numbers."""
PAST, SOON = 0.2, 3.0
"""m, by which it may run past the end; s, within which it stands once it is near."""
STRAIGHT, SHORT = ((0.0, 0.0), (6.0, 0.0)), ((0.0, 0.0), (3.0, 0.0))
CORNER = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0))
"""The car's smallest circle has a radius of 2.4 m."""


@dataclass(frozen=True)
class Arrival:
    """How a drive ended: time until it is near, then until it stands, and way past the end."""

    near: float
    stands: float
    past: float
    strayed: float
    """m from the end, at most, once it has been near."""


def drive(
    planner: Planner,
    points: Any = STRAIGHT,
    aside: float = 0.0,
    ahead: float = 0.0,
    bodies: tuple[Detection, ...] = (),
) -> Arrival:
    """Drive from rest, exactly as planned, for some seconds beyond the first time that it is near.

    Parameters
    ----------
    points : of the path, in the plane. aside, ahead : m, by which the robot begins beside it and
        after its first point. bodies : that stand.
    """
    robot, size = planner.robot, planner.robot.dimension
    path = Path(np.pad(np.array(points), ((0, 0), (0, size - 2))))
    place = path.points[0] + np.eye(size)[1] * aside + np.eye(size)[0] * ahead
    state, twist = start_state(robot, tuple(place), tuple(path.direction(np.zeros(1))[0]), 0.0)
    smoother = VelocitySmoother.at_rest(twist)
    (last,) = path.direction(np.array([path.length]))
    planner.set_path(path)
    rows: list[tuple[float, ...]] = []
    first, time, due = np.inf, 0.0, 0.0
    while time < min(first + SOON + 5.0, 4.0 * path.length / planner.reference_speed + 20.0):
        if time >= due - 1e-9:
            seen = Observation(time, np.array(state), bodies)
            smoother = smoother.aim(within_reach(robot, planner.command(seen)), time)
            due += planner.period
        control = robot.drive(state, smoother.at(time + TICK), TICK)
        state = tuple(float(value) for value in step(robot, state, control, TICK))
        time += TICK
        away = np.array(robot.pose(state).position, dtype=float) - path.goal
        speed = np.linalg.norm(np.array(robot.twist(state, control).linear, dtype=float))
        rows.append((time, float(np.linalg.norm(away)), float(speed), float(away @ last)))
        first = min(first, time) if rows[-1][1] <= NEAR else first
    found = np.array(rows)
    after = found[found[:, 0] >= first]
    moves = after[(after[:, 1] > NEAR) | (after[:, 2] > SLOW), 0]
    stands = float(moves.max(initial=first) - first)
    return Arrival(first, stands, float(found[:, 3].max()), float(after[:, 1].max(initial=0.0)))


def check(found: Arrival) -> None:
    assert found.near < np.inf
    assert found.past <= PAST and found.stands <= SOON
    assert found.strayed <= NEAR + 1e-9


SPEEDS = [pytest.param(0.3, marks=pytest.mark.slow), 0.5, 1.0,
          pytest.param(1.5, marks=pytest.mark.slow)]  # fmt: skip


QUICK = {"bicycle": 1.0, "differential_drive": 0.5, "holonomic": 0.5, "holonomic_velocity": 1.0}
"""Speed at which a robot is tried each time; at the others in the slow tests."""
ROBOTS = [
    pytest.param(name, speed, marks=(
        () if speed in (QUICK.get(name, 0.5), QUICK.get(name, 1.0)) else pytest.mark.slow))
    for name in names("robots") for speed in (0.3, 0.5, 1.0, 1.5)
]  # fmt: skip


@pytest.mark.parametrize(("name", "speed"), ROBOTS)
def test_the_recommended_planner_stands_at_the_end(name: str, speed: float) -> None:
    check(drive(recommended(name, speed, quiet=True)))


@pytest.mark.parametrize("speed", SPEEDS)
def test_it_does_so_with_a_step_of_its_own(speed: float) -> None:
    """A finer step makes no shorter plan: one of 5 s at 0.5 m/s ran 0.5 m past the end."""
    step_size = 0.25 / max(speed / 0.5, 1.0)
    check(drive(recommended("unicycle", speed, quiet=True, dt=step_size)))


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.5, 1.0])
@pytest.mark.parametrize(("points", "aside"), [(SHORT, 0.5), (CORNER, 0.0)])
@pytest.mark.parametrize("name", ["bicycle", "holonomic", "unicycle"])
def test_it_does_so_from_beside_the_path_and_after_a_corner(
    name: str, points: Any, aside: float, speed: float
) -> None:
    check(drive(recommended(name, speed, quiet=True), points, aside))


def car(speed: float, back: float | None = None) -> Bicycle:
    k = max(speed / 0.5, 1.0)
    return Bicycle(
        radius=0.3,
        max_speed=0.7 * k,
        max_acceleration=0.7 * k,
        max_steering_rate=0.3 * k,
        max_reverse_speed=back,
    )


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.5])
@pytest.mark.parametrize("aside", [0.4, -0.8])
def test_a_car_beside_its_goal_backs_off_and_arrives(speed: float, aside: float) -> None:
    """Its turning circle of 2.4 m leads past a goal that is 0.4 m aside and 0.3 m ahead."""
    planner = recommended(car(speed), speed, quiet=True)
    arrival = drive(planner, SHORT, aside, SHORT[1][0] - 0.3)
    assert arrival.near < np.inf and arrival.stands <= SOON


def test_a_car_drives_round_a_person_who_stands_close_before_it() -> None:
    person = Detection("1", np.array([1.3, 0.02]), 1e-4 * np.eye(2), 0.3)
    arrival = drive(recommended(car(0.5), 0.5, quiet=True), STRAIGHT, ahead=0.5, bodies=(person,))
    assert arrival.near < np.inf


def test_a_car_without_a_reverse_gear_says_that_its_circle_is_in_the_way() -> None:
    planner = recommended(car(0.5, back=0.0), 0.5, quiet=True)
    planner.set_path(Path(np.array(SHORT)))
    state, _ = start_state(planner.robot, (2.7, 0.6), (1.0, 0.0), 0.0)
    for tick in range(13):
        planner.command(Observation(tick * planner.period, np.array(state)))
    assert planner.last_plan is not None
    assert "turning circle is 2.4 m" in planner.last_plan.reason


def test_a_car_that_backs_off_drives_on_at_once_to_another_goal() -> None:
    planner = recommended(car(0.5), 0.5, quiet=True)
    planner.set_path(Path(np.array(SHORT)))
    state, _ = start_state(planner.robot, (2.7, 0.6), (1.0, 0.0), 0.0)
    for tick in range(6):
        planner.command(Observation(tick * planner.period, np.array(state)))
    assert planner.last_plan is not None and "backs off" in planner.last_plan.reason
    planner.set_path(Path(np.array([(2.7, 0.6), (9.0, 0.6)])))
    planner.command(Observation(6 * planner.period, np.array(state)))
    assert planner.last_plan is not None and planner.last_plan.reason == ""
