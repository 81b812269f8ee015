"""Bilevel planning among people who answer by ORCA: its lower level, its plans, its failures."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from wideberth.framework.mpc.planner.rollout import follow
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.people.models import Company, Reciprocal, Walkers
from wideberth.people.walls import WallField
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent, ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel
from wideberth_arenas.controllers import orca_conditions
from wideberth_arenas.controllers.bilevel_orca import BilevelOrca
from wideberth_arenas.controllers.bilevel_program import (
    PADDING,
    RELAXATION,
    ROOM,
    WALL_ROOM,
    BilevelProgram,
    CrowdScene,
    OrcaRules,
)
from wideberth_arenas.controllers.orca_conditions import (
    SLACK_WEIGHT,
    conditions,
    half_plane,
    on_the_central_path,
    wanted_velocity,
)

HORIZON, DT, SPEED = 2.0, 0.25, 0.5
RULES = OrcaRules(4, DT, SPEED, HORIZON, 0.5, None, 100)
BALL = HolonomicVelocity(radius=0.25, max_speed=1.0)
WHEELS = Unicycle(
    radius=0.25, max_speed=0.95, max_yaw_rate=4.18, max_acceleration=1.5, max_yaw_acceleration=33.5
)
NORTH = Path(np.array([[0.0, -1.5], [0.0, 1.5]]))
HALL = tuple(Polygon(((k, -4.0), (k + 0.2, -4.0), (k + 0.2, 4.0), (k, 4.0))) for k in (-1.2, 1.0))


def quick(count, rng):
    """Positions, velocities and radii of people, apart from the origin, where the robot is."""
    places = rng.uniform(0.6, 2.5, (count, 1)) * _units(rng.uniform(0.0, 2.0 * np.pi, count))
    return places, rng.normal(size=(count, 2)) * 0.4, rng.uniform(0.2, 0.35, count)


def _units(angles):
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def lines_of(place, pace, radius, others):
    """Half-planes of one person by the expressions of the programme."""
    apart, relative, own = (ca.SX.sym(name, 2) for name in "arv")
    room = ca.SX.sym("room")
    rule = ca.Function("rule", [apart, relative, own, room], half_plane(
        apart, relative, own, room, HORIZON, DT))  # fmt: skip
    found = [rule(q - place, pace - w, pace, radius + r + 2.0 * PADDING) for q, w, r in others]
    return (
        np.array([normal.full()[:, 0] for normal, _ in found]),
        np.array([float(bound) for _, bound in found]),
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_relaxed_velocity_is_that_of_orca(seed, monkeypatch):
    """To sqrt(2 m rho) where slacks are dear, in a hallway."""
    monkeypatch.setattr(orca_conditions, "SLACK_WEIGHT", 1e5)
    rng = np.random.default_rng(seed)
    model = Reciprocal(time_horizon=HORIZON, obstacle_horizon=0.5, safety_space=PADDING)
    field, held, off = WallField(HALL), 0, []
    for _ in range(60):
        place = np.array([rng.uniform(-0.65, 0.65), 0.0])
        pace, wanted = rng.normal(size=2) * 0.3, rng.normal(size=2)
        wanted *= SPEED / np.hypot(*wanted)
        away, moving, size = quick(4, rng)
        others = list(zip(place + away, moving, size, strict=True))
        company = Company(
            place + away, moving, size, np.ones((1, 4), dtype=bool), field.beside(place[None])
        )
        alone = Walkers(place[None], pace[None], wanted[None], np.array([0.3]))
        exact = model.next_velocity(alone, company, DT)[0]
        normals, bounds = lines_of(place, pace, 0.3, others)
        beside = field.beside(place[None])[0]
        gaps = np.maximum(beside[:, 0] - 0.3 - PADDING, 1e-3)
        found, slack, multipliers = on_the_central_path(
            np.concatenate([normals, beside[:, 1:]])[None],
            np.concatenate([bounds, -gaps / 0.5])[None],
            2,
            wanted[None],
            SPEED,
            RELAXATION,
        )
        if slack[0] < 1e-3:  # otherwise no velocity keeps all half-planes, and the two differ
            off.append(np.hypot(*(found[0] - exact)))
            held += bool(np.hypot(*(exact - wanted)) > 0.05)
        assert (multipliers > 0.0).all()
    assert len(off) > 25 and held > 10
    assert max(off) < np.sqrt(2 * 8 * RELAXATION)


def test_the_head_on_and_the_overlapping_half_plane_by_hand():
    """One ahead at 2 m who stands: the cut-off disc's edge is 1 - 0.32 m/s away; half of 0.18."""
    normals, bounds = lines_of(np.zeros(2), np.array([0.86, 0.0]), 0.3, [
        (np.array([2.0, 0.0]), np.zeros(2), 0.3)])  # fmt: skip
    assert normals[0] == pytest.approx([-1.0, 0.0]) and bounds[0] == pytest.approx(-0.77)
    normals, bounds = lines_of(np.zeros(2), np.zeros(2), 0.3, [
        (np.array([0.6, 0.0]), np.zeros(2), 0.3)])  # fmt: skip
    assert normals[0] == pytest.approx([-1.0, 0.0]) and bounds[0] == pytest.approx(0.5 * 0.04 / DT)


def test_the_central_path_satisfies_the_conditions_and_solves_the_programme():
    rng = np.random.default_rng(7)
    for _ in range(10):
        normals, wanted = _units(rng.uniform(0.0, 6.3, (1, 4))), rng.normal(size=(1, 2)) * 0.2
        bounds = rng.uniform(-0.4, 0.3, (1, 4))
        bounds[0, 3] = -0.1  # of a wall: standing keeps it
        point = on_the_central_path(normals, bounds, 1, wanted, SPEED, RELAXATION)
        velocity, slack, multipliers = (one[0] for one in point)
        lines = [(ca.DM(n), b) for n, b in zip(normals[0], bounds[0], strict=True)]
        rows = conditions(
            ca.DM(velocity),
            slack,
            list(multipliers),
            lines,
            1,
            ca.DM(wanted[0]),
            SPEED,
            RELAXATION,
        )
        assert np.abs(np.concatenate([np.ravel(ca.DM(row)) for row in rows])).max() < 5e-4 * max(
            1.0, multipliers.max()
        )

        def kept(z, n=normals[0], b=bounds[0]):
            return [
                *(n @ z[:2] - b + z[2] * np.array([1, 1, 1, 0])),
                SPEED**2 - z[:2] @ z[:2],
                z[2],
            ]

        exact = minimize(
            lambda z, aim=wanted[0]: ((z[:2] - aim) ** 2).sum() + SLACK_WEIGHT * z[2] ** 2,
            [0.0, 0.0, 1.0],
            constraints={"type": "ineq", "fun": kept},
            options={"ftol": 1e-12, "maxiter": 300},
        )
        assert np.hypot(*(exact.x[:2] - velocity)) < np.sqrt(2 * 6 * RELAXATION)


def test_wanted_velocities_stop_at_the_goal():
    place, goal = ca.SX.sym("p", 2), ca.SX.sym("g", 2)
    rule = ca.Function("rule", [place, goal], [wanted_velocity(place, goal, SPEED)])
    assert np.ravel(rule([0.0, 0.0], [3.0, 4.0])) == pytest.approx(
        0.999 * SPEED * np.array([0.6, 0.8])
    )
    assert np.ravel(rule([0.0, 0.0], [0.0, 0.2])) == pytest.approx([0.0, 0.2])
    assert np.ravel(rule([1.0, 1.0], [1.0, 1.0])) == pytest.approx([0.0, 0.0])


def scene_of(people=(), robot=BALL, ahead=(0.0, 1.0), polygons=HALL, speed=0.0):
    state = np.zeros(len(robot.states))
    if robot is WHEELS:
        state[2:4] = np.pi / 2, speed
    places, paces, radii = (
        np.array([one[k] for one in people], dtype=float).reshape(shape)
        for k, shape in enumerate(((-1, 2), (-1, 2), (-1,)))
    )
    own = np.array([0.0, speed])
    return CrowdScene(state, own, np.array(ahead), 0.95, places, paces, radii, polygons)


def test_the_plan_has_the_very_answers_of_the_lower_level():
    """Rolled out beside the plan, each person by their own programme, they are where it says."""
    people = [((0.3, 1.3), (0.0, -0.4), 0.3), ((-0.5, 1.8), (0.1, -0.3), 0.3)]
    for robot in (BALL, WHEELS):
        scene, program = scene_of(people, robot), BilevelProgram(robot, RULES, 2)
        guess = program.course(scene, np.zeros((4, len(robot.inputs))))
        solver, found = program._solver, []
        program._solver = lambda s=solver, f=found, **given: f.append(s(**given)) or f[-1]
        inputs, why = program.solved(scene, guess)
        assert not why
        plan = program.course(scene, inputs)
        first = inputs.size + plan.states[1:].size
        answers = found[0]["x"].full()[first:-3].reshape(plan.answers.shape)
        np.testing.assert_allclose(answers[..., :2], plan.answers[..., :2], atol=3e-3)
        apart = np.linalg.norm(plan.people[1:] - plan.states[1:, None, :2], axis=-1)
        assert apart.min() > 0.55 + ROOM - 2e-3  # kept among the answers, not the plan's own alone
        alone = program.course(scene, np.zeros((4, len(robot.inputs))))
        assert np.abs(plan.people - alone.people).max() > 0.02  # the robot makes them move


def test_without_people_it_is_a_plain_plan():
    """The same costs over the inputs alone, minimised by SciPy."""
    scene, program = scene_of((), WHEELS, (0.4, 0.3), (), 0.6), BilevelProgram(WHEELS, RULES, 0)
    inputs, why = program.solved(scene, program.course(scene, np.zeros((4, 2))))

    def cost(z):
        states = follow(WHEELS, scene.state, z.reshape(4, 2), DT)[1:]
        off = ((states[:, :2] - [0.4, 0.3]) ** 2).sum(axis=1)
        return 0.5 * (off @ [1.0, 1.0, 1.0, 100.0] + 0.1 * (states[:, 4] ** 2).sum())

    def speed(z):
        return 0.95 - np.abs(follow(WHEELS, scene.state, z.reshape(4, 2), DT)[1:, 3])

    exact = minimize(
        cost, inputs.ravel() + 0.1, bounds=[(-1.5, 1.5), (-33.5, 33.5)] * 4,
        constraints={"type": "ineq", "fun": speed}, options={"ftol": 1e-12, "maxiter": 500},
    )  # fmt: skip
    assert not why and exact.success and cost(inputs.ravel()) < exact.fun + 2e-3
    np.testing.assert_allclose(
        follow(WHEELS, scene.state, inputs, DT)[:, :2],
        follow(WHEELS, scene.state, exact.x.reshape(4, 2), DT)[:, :2],
        atol=5e-3,
    )


def test_walls_and_speeding_up_are_kept():
    scene = scene_of(robot=WHEELS, ahead=(-0.9, 0.2), speed=0.3)
    program = BilevelProgram(WHEELS, replace(RULES, speeding_up=0.5), 0)
    inputs, why = program.solved(scene, program.course(scene, np.zeros((4, 2))))
    states = follow(WHEELS, scene.state, inputs, DT)
    assert not why and states[:, 0].min() > -1.0 + 0.25 + WALL_ROOM - 2e-3
    assert np.diff(np.abs(states[:, 3])).max() < 0.5 * DT + 1e-3


def test_the_first_guess_knows_when_it_touches():
    program = BilevelProgram(BALL, RULES, 1)
    for x, touched in ((0.5, True), (0.56, False)):
        scene = scene_of([((x, 0.0), (0.0, 0.0), 0.3)], polygons=())
        still = program.course(scene, np.zeros((4, 2)))
        still = replace(still, people=np.tile(scene.places, (5, 1, 1)))
        assert program.touches(scene, still) is touched


@pytest.mark.parametrize("robot", [BALL, WHEELS], ids=["velocity", "unicycle"])
def test_a_person_head_on_in_a_hallway_is_passed(robot):
    """By the half of the hallway that is left, and the same way again to the byte."""
    person = ScriptedAgent("person", Path(np.array([[0.5, 2.0], [0.5, -6.0]])), 0.4, 0.25)
    agent = RobotAgent("robot", robot, BilevelOrca(robot), NORTH, 0.0, reference_speed=0.9)
    settings = Settings(time_limit=12.0, plant_step=0.05, history=1.0, channel=Channel(noise=0.0))
    logs = [run_episode([agent], settings, others=[person], polygons=HALL) for _ in range(2)]
    assert logs[0].to_bytes() == logs[1].to_bytes()
    way, other = (log.positions for log in logs[0].agents)
    assert logs[0].robots[0].reached < 10.0
    assert np.linalg.norm(way - other, axis=1).min() > 0.5
    assert np.abs(way[:, 0]).max() < 0.75


def test_where_nothing_is_found_it_brakes_and_says_why():
    controller = BilevelOrca(WHEELS, most_iterations=1)
    controller.set_path(NORTH)
    state = np.array([0.0, -1.5, np.pi / 2, 0.9, 0.0])
    near = Detection("near", np.array([0.05, -0.9]), np.zeros((2, 2)), 0.3)
    command = controller.command(Observation(0.0, state, (near,), polygons=HALL))
    assert command.linear == (0.0, 0.0) and "leads to a contact: brake" in controller.reason
    assert "IPOPT says Maximum_Iterations_Exceeded" in controller.reason
    gone = Observation(9.0, state, (), polygons=HALL)
    command = controller.command(gone)  # who was near is forgotten: what stands in the guess goes
    assert command.linear[0] > 0.5 and not controller.reason


def test_a_robot_without_inertia_stands_after_braking(monkeypatch):
    """It speeds up from 0 again, not from the velocity that it had before it braked."""
    controller = BilevelOrca(BALL, most_people=1)
    controller.set_path(NORTH)
    place = np.array([0.0, -1.5])
    command = controller.command(Observation(0.0, place, polygons=HALL))
    assert np.hypot(*command.linear) > 0.5
    near = Detection("near", np.array([0.05, -0.9]), np.zeros((2, 2)), 0.3)
    with monkeypatch.context() as patch:
        patch.setattr(BilevelProgram, "solved", lambda *_: (np.zeros((4, 2)), "nothing is found"))
        command = controller.command(Observation(0.25, place, (near,), polygons=HALL))
    assert command.linear == (0.0, 0.0) and controller.reason.endswith("leads to a contact: brake")
    controller.speeding_up = 0.5
    command = controller.command(Observation(9.0, place, polygons=HALL))
    assert not controller.reason and 0.0 < np.hypot(*command.linear) < 0.5 * DT + 1e-3


@pytest.mark.parametrize("period", [0.05, 0.25, 0.4, 0.5, 3.0])
def test_the_last_plan_is_carried_on_by_the_period(period):
    """Each step covers the ends of two of the last plan's; what lies beyond heads for c."""
    controller, share = BilevelOrca(BALL, period=period), period / DT
    controller._last = np.array([[0.1, 0.2], [0.3, 0.1], [0.0, 0.4], [0.2, 0.2]])
    begun = controller._begun(scene_of(ahead=(5.0, 0.0)))
    times, held = np.arange(0, 4 * DT, 1e-3), np.array([[0.95, 0.0]] * 4)
    for k in range(4):
        if k + 1 + share <= 4:  # the mean of what the last plan commands within the step
            within = times[
                (times >= period + k * DT - 1e-6) & (times < period + (k + 1) * DT - 1e-6)
            ]
            held[k] = controller._last[((within + 1e-9) / DT).astype(int)].mean(axis=0)
    kept = max(int(4 - share), 0)
    np.testing.assert_allclose(begun[:kept], held[:kept], atol=1e-9)
    assert len(begun) == 4 and (begun[kept:, 0] > 0.5).all()


def test_nothing_is_built_in_the_loop(monkeypatch):
    controller = BilevelOrca(BALL, most_people=2, people_speed=0.51)
    controller.set_path(NORTH)
    monkeypatch.setattr(BilevelProgram, "__init__", None)  # building one more fails
    for count in range(4):
        crowd = tuple(
            Detection(f"p{k}", np.array([k - 1.0, 1.0]), np.zeros((2, 2)), 0.2)
            for k in range(count)
        )
        controller.command(Observation(DT * count, np.array([0.0, -1.5]), crowd))
        assert not controller.reason
    other = BilevelOrca(BALL, most_people=1, people_speed=0.52)
    other.set_path(NORTH)  # where building fails, a decision says so
    assert other.command(Observation(0.0, np.array([0.0, -1.5]))).linear == (0.0, 0.0)
    assert other.reason.startswith("TypeError")


def test_two_hundred_people_are_bounded_work():
    controller = BilevelOrca(BALL, most_people=3)
    controller.set_path(NORTH)
    rng = np.random.default_rng(1)
    crowd = tuple(
        Detection(f"p{k}", np.array([0.0, -1.5]) + 1.5 * p, np.zeros((2, 2)), 0.2)
        for k, p in enumerate(_units(rng.uniform(0.0, 6.3, 200)))
    )
    command = controller.command(Observation(0.0, np.array([0.0, -1.5]), crowd, polygons=HALL))
    assert not controller.reason and np.hypot(*command.linear) < 0.96


def test_settings_are_looked_at():
    with pytest.raises(WideberthError, match="horizon is 1"):
        BilevelOrca(BALL, horizon=1)
    with pytest.raises(WideberthError, match="most_people is 0"):
        BilevelOrca(BALL, most_people=0)
    with pytest.raises(WideberthError, match="most_people is 11; wanted at most 10"):
        BilevelOrca(BALL, most_people=11)
    with pytest.raises(WideberthError, match="people_speed is -1"):
        BilevelOrca(BALL, people_speed=-1.0)
    with pytest.raises(WideberthError, match="HolonomicVelocity has no hash"):
        BilevelOrca(HolonomicVelocity(radius=np.array(0.3)))
