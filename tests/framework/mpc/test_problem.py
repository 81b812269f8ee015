"""The assembled problem: the same meaning for every robot, region, size and form."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.assembly import _heading
from wideberth.framework.mpc.costs.base import Weights
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.base import LevelPolicy, SharedLevel
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.ocp.transcription import Guess, Transcription
from wideberth.framework.mpc.planner import verify
from wideberth.framework.mpc.planner.rollout import steer
from wideberth.framework.mpc.planner.verify import entered, violation
from wideberth.framework.mpc.slots.base import level_at_first
from wideberth.framework.mpc.slots.base import with_auxiliaries as with_auxiliaries_of
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, KnownDiscs, ObstacleSet
from wideberth.framework.mpc.slots.static_polygons import (
    StaticPolygons,
    choose_walls,
    fill_walls,
)
from wideberth.framework.numerics.symbolic import ca, evaluated
from wideberth.framework.programs import ColumnFunctions, evaluate
from wideberth.framework.region import Region
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Status
from wideberth.framework.values.polygon import Polygon
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.regions.static.dual import Dual
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.tests.helpers.problems import (
    DT,
    STEPS,
    assemble,
    built_in,
    fill,
    set_up,
    with_auxiliaries,
)
from wideberth.tests.helpers.region_samples import PAPER
from wideberth.tests.helpers.residuals import residuals

ROBOTS = [Unicycle(), DifferentialDrive(), Bicycle(), Holonomic()]


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: type(robot).__name__)
@pytest.mark.parametrize("region", PAPER, ids=repr)
def test_any_robot_and_region_solve(robot: Robot, region: Region) -> None:
    problem, parameters, guess = set_up(robot, region, Fixed(0.05), 1)
    for solver in (Ipopt(), Fatrop()):
        (solution,) = solver.solve(problem, parameters, [guess])
        assert solution.status is Status.SOLVED, (solver, solution.message)
        assert violation(problem, parameters, solution.point).worst < 1e-4
        place = np.stack(robot.pose(tuple(solution.point.states[1:].T)).position, -1)
        (numbers,) = parameters.slots
        assert numbers.level is not None
        inside = region.contains(
            place, numbers.parameters[:, 0], numbers.level[:, 0] * (1 - 1e-4) - 1e-4
        )
        assert not inside.any()


@pytest.mark.parametrize(
    "level", [Fixed(0.05), Relaxed(0.05, weight=100.0, minimum=0.0)], ids=repr
)
def test_empty_slots_change_nothing(level: LevelPolicy) -> None:
    costs = []
    for capacity in (1, 2, 5):
        for solver in (Ipopt(), Fatrop()):
            problem, parameters, guess = set_up(
                Unicycle(), MinkowskiSum(), level, capacity, penalty=1e4
            )
            (solution,) = solver.solve(problem, parameters, [guess])
            assert solution.status is Status.SOLVED
            costs.append(solution.cost)
    assert np.ptp(costs) < 1e-3 * abs(costs[0])


def test_no_obstacle_needs_no_slot() -> None:
    level = Relaxed(weight=1.0, minimum=0.0)
    robot, region = Unicycle(), MahalanobisEllipse()
    start = np.array([0.0, 0.3, 0.0, 0.5, 0.0])
    path = Path(np.array([[0.0, 0.0], [20.0, 0.0]]))
    none = ObstacleSet(np.zeros((STEPS, 0, 2)), np.zeros((STEPS, 0, 2, 2)), np.zeros(0), ())
    reference = lay_reference(path, 0.0, 0.5, STEPS, DT)
    parameters = fill(start, reference, none, region, level, 0.75, 0)
    problem = assemble(robot, region, level, horizon=STEPS, dt=DT, capacity=0, penalty=1e4)
    states, inputs = steer(robot, start, Twist((0.5, 0.0)), STEPS, DT)
    guess = Guess.bare(states, inputs, 0.0)
    costs = [solver.solve(problem, parameters, [guess])[0].cost for solver in (Ipopt(), Fatrop())]
    assert costs[0] == pytest.approx(costs[1], rel=1e-5)
    assert costs[0] > 0


def test_weights_mean_the_same_for_every_robot() -> None:
    """Straight ahead with the same acceleration costs the same whatever the robot is."""
    totals = []
    for robot in (Unicycle(), DifferentialDrive(), Bicycle(), Holonomic()):
        problem, parameters, _ = set_up(robot, MahalanobisEllipse(), Fixed(), 1)
        states, inputs = steer(robot, parameters.initial, Twist((0.45, 0.0)), STEPS, DT)
        heads = parameters.stages()[:, : problem.head_width]
        cost = 0.0
        for i in range(STEPS):
            cost += float(problem.input_cost(states[i], inputs[i], heads[i]))
            cost += float(problem.state_cost(states[i + 1], heads[i]))
        totals.append(cost)
    assert totals == pytest.approx([totals[0]] * 4, rel=1e-6)


def test_the_key_tells_problems_apart() -> None:
    keys = set()
    for cost in (Tracking(), Tracking(Weights(position=101.0))):
        for dt in (0.5, 0.4):
            for penalty in (None, 1e4):
                problem = assemble(
                    Unicycle(),
                    MahalanobisEllipse(),
                    Fixed(),
                    horizon=3,
                    dt=dt,
                    capacity=1,
                    cost=cost,
                    penalty=penalty,
                )
                keys.add(problem.key)
    assert len(keys) == 8
    again = assemble(Unicycle(), MahalanobisEllipse(), Fixed(), horizon=3, dt=0.5, capacity=1)
    assert again.key in keys


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"horizon": 0}, "horizon is 0"),
        ({"horizon": 2.5}, "horizon is 2.5"),
        ({"dt": 0.0}, "dt is 0"),
        ({"capacity": -1}, "room for each obstacle is -1"),
        ({"penalty": -1.0}, "penalty is -1"),
    ],
)
def test_sizes_that_make_no_problem_are_refused(change: dict[str, float], words: str) -> None:
    sizes = {"horizon": 15, "dt": 0.5, "capacity": 1, **change}
    with pytest.raises(WideberthError, match=words):
        assemble(Unicycle(), MahalanobisEllipse(), Fixed(), **sizes)  # type: ignore[arg-type]


def test_violation_names_obstacle_and_step() -> None:
    problem, parameters, guess = set_up(Unicycle(), MahalanobisEllipse(), Fixed(), 1, y=0.0)
    states, inputs = steer(Unicycle(), parameters.initial, Twist((0.5, 0.0)), STEPS, DT)
    found = violation(problem, parameters, replace(guess, states=states, inputs=inputs))
    assert found.worst > 0.5
    assert "region of 'a'" in found.where(("a",))
    broken = replace(guess, inputs=guess.inputs + 2.0)
    assert "motion limits" in violation(problem, parameters, broken).where(("a",))
    numb = replace(guess, states=guess.states * np.nan)
    assert violation(problem, parameters, numb).worst == np.inf


@pytest.mark.parametrize("level", [Fixed(0.05), Relaxed(weight=1.0)], ids=repr)
def test_every_row_constrains_something(level: LevelPolicy) -> None:
    """One level for all steps needs no rows that hold it constant; levels of steps do."""
    problem, _, _ = set_up(Unicycle(), MinkowskiSum(), level, 1, penalty=10.0)
    rows = {}
    for staged in (False, True):
        program = Transcription(problem, staged=staged, symbol=ca.SX).nlp()
        filled = ca.jacobian(program["g"], program["x"]).sparsity()
        rows[staged] = filled.size1()
        assert set(filled.row()) == set(range(rows[staged]))
    held = STEPS if isinstance(level, SharedLevel) else 0
    assert rows[True] - rows[False] == problem.states + held  # the first state is a variable


def test_what_is_free_needs_no_slack() -> None:
    """Where every region can be kept, a soft problem has the solution of the hard one."""
    found = []
    for penalty in (None, 1e4):
        problem, parameters, guess = set_up(Unicycle(), MinkowskiSum(), Fixed(0.05), 1, penalty)
        (solution,) = Fatrop().solve(problem, parameters, [guess])
        assert solution.status is Status.SOLVED
        found.append(solution)
    assert found[1].point.slack.max() < 1e-6
    assert found[1].cost == pytest.approx(found[0].cost, rel=1e-3)


def test_a_stop_is_one_row_more() -> None:
    """At the end of the horizon alone."""
    rows = [
        Transcription(
            assemble(
                Unicycle(), MahalanobisEllipse(), Fixed(0.05), horizon=5, dt=DT, capacity=1,
                stop_at_end=stop,
            ),
            staged=True, symbol=ca.SX,
        ).nlp()["g"].numel()
        for stop in (False, True)
    ]  # fmt: skip
    assert rows[1] - rows[0] == 1


def full(rng: np.random.Generator) -> tuple[Problem, Parameters, Guess]:
    """A problem with everything that one can have, and a point that keeps nothing of it."""
    robot, region, walls = DifferentialDrive(), SeparatingLine(), Dual()
    level = Relaxed(0.05, weight=3.0, minimum=0.2)
    _, parameters, guess = set_up(robot, region, level, 2, penalty=7.0)
    problem = assemble(
        robot, region, level, horizon=STEPS, dt=DT, capacity=2, penalty=7.0, static_region=walls,
        statics=2, corners=4, stop_at_end=True,
    )  # fmt: skip
    square = Polygon(((6.0, -2.0), (7.0, -2.0), (7.0, -1.0), (6.0, -1.0)))
    near = choose_walls([square, square], walls, np.zeros((1, 2)), 50.0, 9)
    own = np.tile(0.01 * np.eye(2), (STEPS, 1, 1))
    still = fill_walls(near, walls, 0.3, own)
    parameters = replace(parameters, slots=(*parameters.slots, still))
    point = with_auxiliaries(robot, region, parameters, guess, walls)

    def moved(values: Any) -> Any:
        return values + 0.1 * rng.standard_normal(np.shape(values))

    point = Guess(
        moved(point.states), moved(point.inputs), tuple(map(moved, point.auxiliaries)),
        float(moved(point.level)), moved(point.slack),
    )  # fmt: skip
    assert all(one.size for one in point.auxiliaries)
    aim = replace(point, auxiliaries=tuple(map(moved, point.auxiliaries)))
    return problem, aim.pull(replace(parameters, initial=point.states[0] + 0.5)), point


@pytest.mark.parametrize("symbol", [ca.SX, ca.MX], ids=["SX", "MX"])
@pytest.mark.parametrize("staged", [False, True])
def test_both_forms_hold_the_same_problem(staged: bool, symbol: Any) -> None:
    """Constraints, cost and bounds against `residuals`, a second implementation."""
    problem, parameters, point = full(np.random.default_rng(4))
    form = Transcription(problem, staged=staged, symbol=symbol)
    flat = form.pack(point)
    first = point.states[0] if staged else parameters.initial
    back = form.unpack(flat, parameters)
    np.testing.assert_array_equal(back.states[0], parameters.initial)
    for name in ("inputs", "level", "slack"):
        np.testing.assert_array_equal(getattr(back, name), getattr(point, name), err_msg=name)
    for one, other in zip(back.auxiliaries, point.auxiliaries, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(back.states[1:], point.states[1:])

    stages = (
        np.concatenate([[first], point.states[1:-1]]), point.inputs, point.states[1:],
        np.full((STEPS, 1), point.level), parameters.stages(),
        *(one.reshape(STEPS, -1) for one in point.auxiliaries),
    )  # fmt: skip
    gap, limits, room, cost, *rows = evaluated(residuals(problem), stages)
    pairs = (point.states[1:], problem.state_bounds), (point.inputs, problem.input_bounds)
    sides = [
        side
        for values, bounds in pairs
        for side in (values - np.array(bounds.lower), np.array(bounds.upper) - values)
    ]
    wanted = np.concatenate(sides, axis=1)
    wanted = wanted[:, np.isfinite(wanted).all(axis=0)]
    assert wanted.shape[1] > 2
    np.testing.assert_allclose(np.sort(room, axis=1), np.sort(wanted, axis=1), atol=1e-12)
    nlp = form.nlp()
    program = ca.Function("program", [nlp["x"], nlp["p"]], [nlp["f"], nlp["g"]])
    objective, found = (
        np.array(one).ravel() for one in program(flat, form.parameters(parameters))
    )
    total = cost.sum() + 7.0 * point.slack.sum()
    total += float(problem.level_cost(point.level, parameters.target))
    assert objective[0] == pytest.approx(total, rel=1e-12)
    stop = np.array(problem.terminal_constraints(point.states[-1])).ravel()
    soft = np.concatenate(rows[::2], axis=1) + point.slack[:, None]
    positive = np.concatenate([limits.ravel(), soft.ravel(), stop])
    again = np.zeros(STEPS + problem.states) if staged else np.zeros(0)  # levels, first state
    again[: problem.states] += (first - parameters.initial)[: len(again)]
    zero = np.concatenate([gap.ravel(), *(one.ravel() for one in rows[1::2]), again])
    lower, upper = np.array(form.row_lower), np.array(form.row_upper)
    assert not lower.any() and set(upper) == {0.0, np.inf}
    np.testing.assert_allclose(np.sort(found[upper > 0.0]), np.sort(positive), atol=1e-12)
    np.testing.assert_allclose(np.sort(found[upper == 0.0]), np.sort(zero), atol=1e-12)
    ahead = STEPS * problem.states + (problem.states + STEPS + 1 if staged else 0)
    sizes = [ahead, len(flat) - ahead - (not staged), len(found)]  # the level stands in front
    assert np.sum(form.sizes, axis=0).tolist() == sizes


@pytest.mark.parametrize("staged", [False, True])
def test_both_forms_hold_the_bounds_of_the_problem(staged: bool) -> None:
    problem, parameters, _ = full(np.random.default_rng(4))
    form = Transcription(problem, staged=staged, symbol=ca.SX)
    for values, side, slack in ((form.lower, "lower", 0.0), (form.upper, "upper", np.inf)):
        bounds = form.unpack(np.array(values), parameters)
        for found, wanted in (
            (bounds.states[1:], getattr(problem.state_bounds, side)),
            (bounds.inputs, getattr(problem.input_bounds, side)),
            *(
                (own, getattr(one.auxiliary, side))
                for own, one in zip(bounds.auxiliaries, problem.slots, strict=True)
            ),
        ):
            np.testing.assert_array_equal(found, np.broadcast_to(wanted, found.shape))
        assert set(bounds.slack) == {slack}
    free = problem.states + 1  # the first state and its level, which equations fix
    begin = form.lower[:free] if staged else form.lower[:1]
    assert begin == ([-np.inf] * free if staged else [0.2])


def test_a_violation_stands_at_the_step_where_it_is() -> None:
    """A first state that is another one, an input and a state beyond bounds, a last that moves."""
    robot, region = DifferentialDrive(), MahalanobisEllipse()
    problem, parameters, guess = set_up(robot, region, Fixed(), 1, y=9.0)
    stopping = assemble(robot, region, Fixed(), horizon=STEPS, dt=DT, capacity=1, stop_at_end=True)
    assert not violation(problem, parameters, guess).motion.max() > 1e-9
    off = replace(parameters, initial=guess.states[0] + [0.0, -0.7, 0.0, 0.0, 0.0])
    motion = violation(problem, off, guess).motion
    assert motion[0] == pytest.approx(0.7) and not motion[1:].max() > 1e-9
    wheels = guess.states.copy()
    wheels[5, 3:] = problem.state_bounds.upper[3:]  # each within its bounds, not both together
    limit = min(float(v) for v in robot.constraints(tuple(wheels[5]), tuple(guess.inputs[5])))
    found = violation(problem, parameters, replace(guess, states=wheels)).motion
    assert limit < -0.1 and found[4] >= -limit
    moving = violation(stopping, parameters, guess).motion
    wanted = -np.array(stopping.terminal_constraints(guess.states[-1])).min()
    assert moving[-1] == pytest.approx(wanted) and wanted > 0.1
    assert not moving[:-1].max() > 1e-9
    for side, sign in (("lower", -1.0), ("upper", 1.0)):
        inputs = guess.inputs.copy()
        inputs[3, 0] = getattr(problem.input_bounds, side)[0] + sign * 20.0
        assert violation(problem, parameters, replace(guess, inputs=inputs)).motion.argmax() == 3
        states = guess.states.copy()
        states[6, 3] = getattr(problem.state_bounds, side)[3] + sign * 20.0
        broken = violation(problem, parameters, replace(guess, states=states)).motion
        assert broken[5] >= 20.0 and broken.argmax() in (5, 6)


def test_kinds_without_slots_or_levels_are_passed_over() -> None:
    robot, region, level = Unicycle(), MahalanobisEllipse(), Relaxed(0.05, weight=1.0)
    discs, polygons = built_in(region)
    wanted = region.level(0.05)
    assert level_at_first((polygons, discs), level, 2) == pytest.approx(wanted)
    assert np.isnan(level_at_first((polygons,), level, 2))
    assert isinstance(polygons, StaticPolygons) and polygons.region is None
    _, parameters, guess = set_up(robot, region, level, 1)
    none = SlotNumbers.none(STEPS)
    assert none.level is None and SlotNumbers.none(STEPS, levelled=True).level.shape == (STEPS, 0)
    both = replace(parameters, slots=(*parameters.slots, none))
    found = with_auxiliaries_of(robot, (discs, polygons), both, guess)
    assert [one.shape for one in found.auxiliaries] == [(STEPS, 1, 0), (STEPS, 0, 0)]


def test_an_empty_slot_holds_its_auxiliaries_and_nothing_else() -> None:
    """1 >= 0, and each auxiliary that has an equality at its start, moved off its bounds."""
    problem, _, _ = full(np.random.default_rng(5))
    rng, ties = np.random.default_rng(6), []
    for slots in problem.slots:
        own = slots.auxiliary
        rest = []
        for start, low, high in zip(own.start, own.lower, own.upper, strict=True):
            room = min(1.0, 0.5 * (high - low))
            rest.append(min(max(start, low + room), high - room))
        lifted, numbers = rng.standard_normal(len(own)), rng.random(slots.size)
        numbers[slots.active] = 0.0
        keeps, tied = slots.constraint(rng.standard_normal(problem.states), lifted, 0.3, numbers)
        assert set(np.array(keeps).ravel()) == {1.0}
        ties.append(np.array(tied).ravel())
        np.testing.assert_allclose(ties[-1], (lifted - rest)[: len(ties[-1])])
    assert [len(one) for one in ties] == [0, 1]


def test_leaving_the_guess_of_auxiliaries_has_a_price() -> None:
    """regularisation times the squared distance, of all slots."""
    rng = np.random.default_rng(8)
    for slots in full(rng)[0].slots:
        own = len(slots.auxiliary)
        numbers, lifted = rng.random((slots.count, slots.size)), rng.random((slots.count, own))
        off = lifted - numbers[:, slots.size - own :]
        found = float(slots.regularisation(ca.DM(lifted.ravel()), ca.DM(numbers.ravel())))
        assert found == pytest.approx(slots.auxiliary.regularisation * (off**2).sum(), rel=1e-12)
        assert found > 0.0
    without = set_up(Unicycle(), MahalanobisEllipse(), Fixed(), 1)[0].slots[0]
    assert without.regularisation(ca.DM(0, 1), ca.DM(without.size, 1)) == 0


def test_an_equality_that_does_not_hold_enters_a_region_by_as_much() -> None:
    problem, parameters, point = full(np.random.default_rng(9))
    place = next(k for k, one in enumerate(problem.slots) if one.constraint.size1_out(1))
    slots, numbers, step = problem.slots[place], parameters.slots[place].columns, 4
    auxiliaries = [one.copy() for one in point.auxiliaries]
    auxiliaries[place][step] *= 40.0  # multipliers, whose normal has length 1
    far = replace(point, auxiliaries=tuple(auxiliaries))
    found = violation(problem, parameters, far).regions[step]
    assert numbers is not None and slots.count
    first = sum(one.count for one in problem.slots[:place])
    assert (found[first : first + slots.count] > 1.0).any()


def by_residuals(problem: Problem, parameters: Parameters, point: Guess) -> tuple[Any, Any]:
    """How far a point breaks the motion and enters regions, by `residuals`."""
    lifted = [own.reshape(problem.horizon, -1) for own in point.auxiliaries]
    stages = [point.states[:-1], point.inputs, point.states[1:], point.level, parameters.stages()]
    gaps, limits, bounds, _, *rows = evaluated(residuals(problem), [*stages, *lifted])
    motion = np.concatenate([np.abs(gaps), -limits, -bounds], axis=1).max(axis=1, initial=0.0)
    regions = [np.zeros((problem.horizon, 0))]
    pairs = zip(problem.slots, parameters.slots, rows[::2], rows[1::2], strict=True)
    for slots, numbers, outside, tied in pairs:
        for k in range(slots.count):
            broken = [np.split(-outside, slots.count, axis=1)[k]]
            broken += [np.split(np.abs(tied), slots.count, axis=1)[k]]
            deep = np.concatenate(broken, axis=1).max(axis=1, initial=0.0)
            regions.append((deep * numbers.active[k])[:, None])
    return motion, np.concatenate(regions, axis=1)


@pytest.mark.parametrize("built", [True, False])
def test_the_re_check_is_by_the_constraints_of_the_problem(
    built: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not built:
        monkeypatch.setattr(evaluate, "_evaluator", None)
    rng = np.random.default_rng(7)
    hard = set_up(Unicycle(), MinkowskiSum(), Fixed(), 3, y=0.5)
    bare = set_up(HolonomicVelocity(), MahalanobisEllipse(), Fixed(), 1)
    for problem, parameters, point in (full(rng), hard, bare):
        moved = replace(point, states=point.states + 0.3 * rng.standard_normal(point.states.shape))
        points = [point, moved, point]
        motion, regions = verify._motion(problem, points), entered(problem, parameters, points)
        for k, each in enumerate(points):
            wanted = by_residuals(problem, parameters, each)
            np.testing.assert_array_equal(motion[k], wanted[0])
            np.testing.assert_array_equal(regions[k], wanted[1])
        shares = (0.3, 1.0)
        for k, share in enumerate(shares):
            found = entered(problem, parameters, [moved], shares)[k]
            lower = verify.at_share(parameters, share)
            np.testing.assert_array_equal(found, by_residuals(problem, lower, moved)[1])
        again = pickle.loads(pickle.dumps(problem.constraint_values))
        assert isinstance(again, ColumnFunctions)


def test_a_bare_plan_is_checked_as_one_with_no_auxiliaries() -> None:
    problem, parameters, guess = set_up(Unicycle(), MahalanobisEllipse(), Fixed(), 1, y=0.0)
    bare = Guess.bare(guess.states, guess.inputs, guess.level)
    one, two = (violation(problem, parameters, point) for point in (bare, guess))
    assert bare.auxiliaries == () and one.worst > 0.1
    np.testing.assert_array_equal(one.regions, two.regions)


def test_the_heading_is_a_state_or_is_not_known() -> None:
    """An angle that is computed from states cannot be shifted by full turns."""
    x = ca.SX.sym("x", 3)
    for heading, wanted in ((x[1], 1), (x[2], 2), (2.0 * x[2], None), (None, None)):
        assert _heading(Pose((x[0], x[1]), heading), x) == wanted


@pytest.mark.parametrize("region", [MahalanobisEllipse(), MinkowskiSum()], ids=repr)
def test_the_parameters_of_one_disc_are_those_that_a_planner_fills_in(region: Region) -> None:
    """The margin is the sum of three: of the robot, of the obstacle, and the planner's own."""
    mean, covariance = np.array([1.0, -2.0]), np.array([[0.3, 0.1], [0.1, 0.2]])
    function = GaussianDiscs(region).parameters_of_one(Unicycle(radius=0.35), 0.2)
    found = np.asarray(function(mean, covariance, 0.4)).ravel()
    wanted = region.parameters(GaussianObstacle(mean, covariance), np.float64(0.35 + 0.2 + 0.4))
    ends = [
        region.area(numbers, np.float64(2.0)) for numbers in (found, wanted)
    ]  # eigenvectors may differ in sign
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-9)
    np.testing.assert_allclose(np.sort(np.abs(found)), np.sort(np.abs(wanted)), rtol=1e-9)


@pytest.mark.parametrize("outline", [False, True])
def test_how_deep_a_body_is_where_discs_are_expected(outline: bool) -> None:
    """Of the nearest disc, from the edge of the body: a disc or, with its corners, a car."""
    corners = ((1.0, 0.5), (-1.0, 0.5), (-1.0, -0.5), (1.0, -0.5))
    robot = Unicycle(1.2, footprint=Outline(corners)) if outline else Unicycle(0.5)
    kind = GaussianDiscs(SeparatingLine() if outline else MahalanobisEllipse())
    mean = np.array([[[2.0, 0.0], [0.0, 3.0]], [[9.0, 9.0], [3.0, 1.6]]])
    known = ObstacleSet(mean, np.zeros((2, 2, 2, 2)), np.array([0.4, 0.7]), ("a", "b"))
    states = np.zeros((3, 5))
    states[2, :3] = 3.0, 0.0, 0.5 * np.pi
    found = KnownDiscs(kind, known, 0.2).overlap(robot, states)
    # Gaps: 1 and 2.5 m from the car at (0, 0), 0.6 m from the one that looks up at (3, 0).
    gaps = [min(1.0 - 0.4, 2.5 - 0.7), 0.6 - 0.7] if outline else None
    gaps = gaps or [min(2.0 - 0.5 - 0.4, 3.0 - 0.5 - 0.7), 1.6 - 0.5 - 0.7]
    np.testing.assert_allclose(found, np.maximum(0.2 - np.array(gaps), 0.0), atol=1e-12)
    none = KnownDiscs(kind, ObstacleSet.none(2, 2), 0.2).overlap(robot, states)
    assert none.tolist() == [0.0, 0.0]
