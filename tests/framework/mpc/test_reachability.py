"""What no plan can meet is left out of the problem, and no plan changes by it."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.levels.risk_allocation import RiskAllocation
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.cycle import Decision, PlannerState, Services, step
from wideberth.framework.mpc.planner.settings import PlannerSettings
from wideberth.framework.mpc.slots.gaussian_discs import DiscNumbers, GaussianDiscs, ObstacleSet
from wideberth.framework.mpc.slots.reachability import Travel, leaves_out, out_of_reach
from wideberth.framework.plugins import registry
from wideberth.framework.region import Bounded, Polygonal, Region
from wideberth.framework.robot import step as moved
from wideberth.framework.testing.region_cases import turned
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.footprint import Outline
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Detection, Observation, Pose, Twist
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan, Rung
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.separating_line import SeparatingLine
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.region_variants import variants

REGIONS = [
    one for name in registry.names("regions") for one in variants(registry.load("regions", name))
]
ROBOTS = {name: registry.load("robots", name)() for name in registry.names("robots")}
STEPS, DT = 6, 0.5


@pytest.mark.parametrize("region", REGIONS, ids=repr)
@pytest.mark.parametrize("size", [2, 3])
def test_no_place_within_reach_lies_in_a_region_that_is_left_out(
    region: Region, size: int
) -> None:
    """The farthest places of all in the direction of each obstacle, and in random ones."""
    if size not in region.dimensions:
        pytest.skip("it is not made for this dimension")
    assert isinstance(region, Bounded), "nothing is ever left out for a region without a radius"
    rng = np.random.default_rng(size)
    allowed = 0.4 * np.arange(1, STEPS + 1)
    radius = rng.uniform(0.2, 1.5, 200)
    deviations = rng.uniform(0.05, 1.0, (200, 1)) * rng.uniform(0.05, 1.0, (200, size))
    single = np.array([turned(rng, one) for one in deviations])
    covariance = np.arange(1.0, STEPS + 1)[:, None, None, None] * single
    way = rng.standard_normal((200, size))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    mean = np.tile(rng.uniform(1.0, 16.0, (200, 1)) * way, (STEPS, 1, 1))
    level = np.full((STEPS, 200), region.level(0.05, size))
    here = np.zeros((1, STEPS, size))
    found = out_of_reach(region, mean, covariance, radius, level, here, allowed[None])
    assert 20 < found.sum() < 180
    wide = np.broadcast_to(radius, level.shape)
    numbers = region.parameters(GaussianObstacle(mean, covariance), wide)
    turns = rng.standard_normal((50, STEPS, 200, size))
    turns /= np.linalg.norm(turns, axis=-1, keepdims=True)
    places = allowed[:, None, None] * np.concatenate(
        [mean[None] / np.linalg.norm(mean[0], axis=1)[:, None], turns]
    )
    inside = region.contains(places, numbers, level)
    assert not inside[..., found].any()
    assert inside[..., ~found].any()


def test_the_radius_of_an_ellipse_leaves_nothing_over() -> None:
    """On its long axis an obstacle is kept up to the rim, and left out a hundredth beyond it."""
    region, spread = MahalanobisEllipse(), np.diag([0.25, 0.01])
    level, allowed = 2.0, np.ones((1, 1))
    for surplus, expected in ((-1e-6, False), (0.01, True)):
        mean = np.array([[[1.0 + 2.0 * 0.5 + 0.7 + surplus, 0.0]]])
        found = out_of_reach(
            region, mean, spread[None, None], np.array([0.7]), np.full((1, 1), level),
            np.zeros((1, 1, 2)), allowed,
        )  # fmt: skip
        assert found.tolist() == [expected]


def test_a_body_with_corners_stays_clear_too() -> None:
    """The outline of a robot that stands anywhere within reach and looks anywhere."""
    rng, corners = np.random.default_rng(1), ((1.0, 0.4), (-0.5, 0.4), (-0.5, -0.4), (1.0, -0.4))
    robot = Unicycle(1.2, footprint=Outline(corners))
    for region in REGIONS:
        if not isinstance(region, Polygonal):
            continue
        assert isinstance(region, Bounded)
        spread = turned(rng, np.array([0.6, 0.1]))[None, None]
        level = np.full((1, 1), region.level(0.05, 2))
        reach = 1.0 + np.sqrt(2.0) * np.hypot(1.0, 0.4)
        for away in np.linspace(2.0, 8.0, 40):
            mean, margin = np.array([[[away, 0.0]]]), np.array([0.5])
            places, allowed = np.zeros((1, 1, 2)), np.array([[reach]])
            if not out_of_reach(region, mean, spread, margin, level, places, allowed)[0]:
                continue
            angle, heading = rng.uniform(-np.pi, np.pi, (2, 500))
            pose = Pose((np.cos(angle), np.sin(angle)), heading, robot.footprint.vertices)  # type: ignore[union-attr]
            numbers = region.parameters(GaussianObstacle(mean[0], spread[0]), margin)
            assert not region.overlaps(pose, numbers, level[0]).any()
            break
        else:
            raise AssertionError(f"{region!r}: nothing was left out up to 8 m away")


@pytest.mark.parametrize("name", sorted(ROBOTS))
def test_no_drive_within_the_limits_gets_farther(name: str) -> None:
    """Towards random twists far beyond the limits, and straight on as fast as it can."""
    robot, rng = ROBOTS[name], np.random.default_rng(3)
    travel, far = Travel.of(robot, STEPS, DT), 0.0
    for turn in range(200):
        state = tuple(np.zeros(len(robot.states)))
        ahead = Twist((10.0, *(0.0,) * (robot.dimension - 1)), 0.0)
        for _ in range(20 * (turn % 2)):
            state = moved(robot, state, robot.drive(state, ahead, DT), DT)
        bounds = travel.bounds(np.array(state, dtype=float))
        begin = np.array(robot.pose(state).position)
        for i in range(STEPS):
            wanted = Twist(tuple(rng.normal(0.0, 3.0, robot.dimension)), rng.normal(0.0, 1.0))
            control = robot.drive(state, ahead if turn == 1 else wanted, DT)
            state = moved(robot, state, control, DT)
            way = np.linalg.norm(np.array(robot.pose(state).position) - begin)
            assert way <= bounds[i]
            far = max(far, way / bounds[i])
    assert far > 0.95, "the bound is far from what the robot can do"


def test_a_robot_that_is_seen_faster_than_its_limit_gets_farther_at_first() -> None:
    travel = Travel.of(Unicycle(max_speed=1.0), 3, 0.5)
    slow, fast = (travel.bounds(np.array([0.0, 0.0, 0.0, v, 0.0])) for v in (0.9, 1.4))
    np.testing.assert_allclose(fast - slow, 0.5 * 0.4)
    assert travel.bounds(np.array([0.0, 0.0, 0.0, -1.4, 0.0])) == pytest.approx(fast)


def test_without_a_largest_speed_nothing_is_out_of_reach() -> None:
    class Unknown:
        """A robot of which no largest speed is known."""

        inputs = ()

        def twist(self, state: Any, control: Any) -> Twist:
            return Twist((0.0, 0.0))

    robot: Any = Unknown()
    assert np.isinf(Travel.of(robot, 3, 0.5).bounds(np.zeros(2))).all()


def test_levels_that_may_be_negative_or_cost_nothing_leave_nothing_out() -> None:
    assert leaves_out(Fixed()) and leaves_out(Relaxed()) and leaves_out(Relaxed(minimum=0.0))
    assert not leaves_out(Relaxed(minimum=-0.1)) and not leaves_out(Relaxed(weight=0.0))
    given = np.full((1, 1, 2), 50.0), np.eye(2)[None, None], np.ones(1)
    rest = np.zeros((1, 1, 2)), np.ones((1, 1))
    for level, expected in ((1.0, True), (-1.0, False)):
        found = out_of_reach(MahalanobisEllipse(), *given, np.full((1, 1), level), *rest)
        assert found.tolist() == [expected]


CAR = Unicycle(0.75, footprint=Outline(((0.6, 0.3), (-0.6, 0.3), (-0.6, -0.3), (0.6, -0.3))))
NEAR = [(5.0, 0.7), (6.5, -2.6), (3.0, 3.0)]
FAR = [(4.0, 30.0), (-25.0, 0.0), (3.0, -20.0), (40.0, 2.0), (0.0, 15.0), (-12.0, -12.0)]


def settings(**changes: Any) -> PlannerSettings:
    chosen: dict[str, Any] = {
        "robot": Unicycle(), "region": MahalanobisEllipse(), "predictor": Static(0.05),
        "level": Relaxed(), "solver": Riccati(), "penalty": 1e5, **changes,
    }  # fmt: skip
    return PlannerSettings(**chosen)


def seen(time: float, state: Array, places: list[tuple[float, float]]) -> Observation:
    found = tuple(
        Detection(f"{i}", np.array([x - 0.1 * time, y + 0.05 * time]), 1e-4 * np.eye(2), 0.4)
        for i, (x, y) in enumerate(places)
    )
    return Observation(time, state, found)


def drive(
    own: PlannerSettings, places: list[tuple[float, float]], screened: bool
) -> list[Decision]:
    """Four decisions; without the screen everything is taken to be within reach."""
    services = Services.of(own)
    if not screened:
        services = replace(services, travel=replace(services.travel, speed=np.inf))
    state = PlannerState.initial(own, Path(np.array([[0.0, 0.0], [30.0, 0.0]])))
    decisions, place = [], np.array([0.0, 0.0, 0.0, 0.5, 0.0])
    for k in range(4):
        now = seen(0.5 * k, place, places)
        state, decision = step(own, state, now, services)
        decisions.append(decision)
        place = decision.plan.states[1][:5]
    return decisions


def slots(decision: Decision) -> int:
    assert decision.solved is not None
    return sum(int(one.active.sum()) for one in decision.solved.instance.parameters.slots)


def by_name(plan: Plan, values: Array) -> dict[str, Array]:
    return {name: values[:, plan.ids.index(name)] for name in plan.ids}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"penalty": None},
        {"level": Fixed()},
        {"level": RiskAllocation()},
        {"region": MinkowskiSum()},
        {"region": SeparatingLine(), "robot": CAR, "level": Fixed()},
        {"starts": ()},
    ],
    ids=repr,
)
def test_plans_are_the_same_without_what_is_out_of_reach(changes: dict[str, Any]) -> None:
    own, places = settings(**changes), NEAR[:1] + FAR[:3] + NEAR[1:] + FAR[3:]
    pairs = zip(drive(own, places, True), drive(own, places, False), strict=True)
    for few, every in pairs:
        assert slots(few) < slots(every) == len(places)
        assert few.plan.rung == every.plan.rung == Rung.OPTIMAL
        np.testing.assert_allclose(few.plan.states, every.plan.states, atol=2e-4)
        np.testing.assert_allclose(few.plan.inputs, every.plan.inputs, atol=5e-4)
        assert few.plan.cost == pytest.approx(every.plan.cost, rel=1e-5)
        assert sorted(few.plan.ids) == sorted(every.plan.ids) and few.plan.left_out == ()
        for one in ("level", "target", "content"):
            ours, theirs = (by_name(d.plan, getattr(d.plan, one)) for d in (few, every))
            for name in ours:
                np.testing.assert_allclose(ours[name], theirs[name], atol=1e-5)


def test_what_is_within_reach_gets_the_room_that_others_do_not_need() -> None:
    """A crowd along the reference's far end takes no room from those whom the robot can meet."""
    own = settings(most_obstacles=3)
    places = NEAR + FAR
    (few, *_), (every, *_) = (drive(own, places, screened) for screened in (True, False))
    assert few.plan.left_out == () and sorted(few.plan.ids) == sorted(map(str, range(9)))
    assert set(every.plan.left_out) == {f"{i}" for i in range(3, 9)}
    tight = drive(settings(most_obstacles=2), places, True)[0].plan
    assert tight.left_out == ("1",) and len(tight.ids) == 8


def test_everything_may_be_out_of_reach() -> None:
    own = settings()
    few, every = (drive(own, FAR, screened)[-1] for screened in (True, False))
    assert slots(few) == 0 and slots(every) == len(FAR)
    np.testing.assert_allclose(few.plan.states, every.plan.states, atol=1e-4)
    assert few.plan.content == pytest.approx(every.plan.content)
    assert few.plan.auxiliaries.shape[:2] == few.plan.level.shape


def test_who_stands_on_the_reference_is_kept_though_nobody_gets_there() -> None:
    """A slow robot before a fast reference: it is in the way."""
    own = settings(robot=Unicycle(max_speed=0.1), reference_speed=0.5, level=Fixed())
    assert slots(drive(own, [(3.6, 0.0)], True)[0]) == 1
    assert slots(drive(own, [(2.5, 3.6)], True)[0]) == 0


def test_a_margin_is_as_a_larger_robot() -> None:
    rng, count = np.random.default_rng(4), 200
    discs = ObstacleSet(
        np.tile(rng.uniform(-6.0, 6.0, (count, 2)), (STEPS, 1, 1)),
        np.tile(0.02 * np.eye(2), (STEPS, count, 1, 1)), np.full(count, 0.3),
        tuple(map(str, range(count))),
    )  # fmt: skip
    still = np.zeros((STEPS, 2))

    def out(radius: float, margin: float) -> Array:
        view: Any = SimpleNamespace(
            level=Fixed(), travel=0.4 * np.arange(1.0, STEPS + 1), margin=margin, own=None,
            reference=SimpleNamespace(position=still), route=np.stack([still, still]),
        )  # fmt: skip
        kind = GaussianDiscs(MahalanobisEllipse())
        robot = Unicycle(radius=radius)
        given = view.reference, view.level, view.margin, view.own
        numbers = DiscNumbers.of(kind, robot, discs, *given)
        found = kind.out_of_reach(robot, discs, numbers, view)
        assert found is not None
        return found

    np.testing.assert_array_equal(out(0.3, 0.5), out(0.8, 0.0))
    assert 20 < out(0.3, 0.5).sum() < out(0.3, 0.0).sum() < count
