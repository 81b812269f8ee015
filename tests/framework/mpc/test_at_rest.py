"""Regions that a plan ends outside of, so that the next problem has a plan: laws and oracles."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.slots.between_steps import BetweenSteps
from wideberth.controllers.slots.drawn_futures import DrawnFutures
from wideberth.controllers.slots.ways import Ways
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.cycle import (
    Decision,
    PlannerState,
    Services,
    remember,
    step,
)
from wideberth.framework.mpc.planner.rungs import Fallback
from wideberth.framework.mpc.planner.settings import PlannerSettings
from wideberth.framework.mpc.planner.verify import entered
from wideberth.framework.mpc.slots.at_rest import EndOfPlan
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.predictor import Predictor
from wideberth.framework.region import Region
from wideberth.framework.robot import step as integrate
from wideberth.framework.testing.region_cases import turned
from wideberth.framework.testing.slot_kind import sample_view
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, GaussianObstacle, Scene
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung
from wideberth.framework.values.roots import reduced
from wideberth.framework.values.tracks import Tracks
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minimum_trace import MinimumTrace
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati

DT = 0.5


@dataclass(frozen=True)
class Nested(Predictor):
    """Straight on at the last velocity; a region of a time only shrinks as that time comes nearer.

    Where people do walk straight on, the forecast of each decision lies within the last one.
    """

    growth: float = 0.05

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        ahead = tracks.dt * np.arange(1, steps + 1)
        last = tracks.positions[:, -1]
        velocity = (last - tracks.positions[:, -2]) / tracks.dt
        mean = last[:, None] + ahead[:, None] * velocity[:, None]
        spread = (self.growth * ahead)[:, None, None] ** 2 * np.eye(2)
        return Forecast.single(
            mean, np.broadcast_to(spread, (len(mean), *spread.shape)), tracks.dt
        )


def held(region: Region, mean: Array, covariance: Array, level: float) -> tuple[Array, Array]:
    """Numbers of the region that holds the others, and of those, of one disc."""
    end = EndOfPlan.of(mean[:, None], covariance[:, None])
    middle, wide = end.at(np.array([level]))
    around = region.parameters(GaussianObstacle(middle, wide), np.array([0.6]))[0]
    margins = np.full(len(mean), 0.6)
    return around, region.parameters(GaussianObstacle(mean, covariance), margins)


@pytest.mark.parametrize("more", [1, 4])
@pytest.mark.parametrize("region", [MinkowskiSum(), MinimumTrace()])
def test_it_holds_the_regions_of_all_steps(region: Any, more: int) -> None:
    """Support functions of sums of ellipse and disc, in many directions."""
    rng, level = np.random.default_rng(0), 2.0
    angle = np.linspace(0.0, 2.0 * np.pi, 180)
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    exact, levels = MinkowskiSum(), np.full(180, level)
    for _ in range(40):
        mean = np.cumsum(rng.uniform(-0.5, 0.8, (more + 1, 2)), axis=0)
        covariance = turned(rng, rng.uniform(0.0, 0.6, (more + 1, 2)))
        around, each = held(exact, mean, covariance, level)
        reach = exact.support(normals, around, levels)
        for one in each:
            assert (exact.support(normals, one, levels) <= reach + 1e-9).all()
        if not isinstance(region, MinkowskiSum):
            around, _ = held(region, mean, covariance, level)
            assert (region.support(normals, around, levels) >= reach - 1e-6).all()


def test_who_stands_and_does_not_grow_costs_nothing() -> None:
    covariance = np.tile([[0.2, 0.05], [0.05, 0.1]], (3, 1, 1))
    mean = np.tile([1.0, 2.0], (3, 1))
    middle, wide = EndOfPlan.of(mean[:, None], covariance[:, None]).at(np.array([2.0]))
    np.testing.assert_allclose(middle[0], mean[0], atol=1e-12)
    np.testing.assert_allclose(wide[0], covariance[0], rtol=1e-5)


def test_points_on_a_line_are_held_without_loss() -> None:
    """Of certain places alone it is the segment between the first and the last."""
    mean = np.array([[0.0, 0.0], [0.5, 0.25], [1.0, 0.5]])
    middle, wide = EndOfPlan.of(mean[:, None], np.zeros((3, 1, 2, 2))).at(np.array([2.0]))
    half = 0.5 * (mean[-1] - mean[0])
    np.testing.assert_allclose(middle[0], [0.5, 0.25])
    np.testing.assert_allclose(4.0 * wide[0], np.outer(half, half), atol=1e-5)


def test_the_positive_part_is_least() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        root = rng.standard_normal((2, 2))
        matrix = root + root.T
        found = reduced(matrix)
        assert np.linalg.eigvalsh(found).min() >= -1e-12
        assert np.linalg.eigvalsh(found - matrix).min() >= -1e-12
        both = found @ (found - matrix)
        np.testing.assert_allclose(both, 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", [GaussianDiscs, BetweenSteps, Ways])
def test_every_kind_of_discs_gives_the_solver_the_larger_region(kind: Any) -> None:
    """At step N alone; what has no way and does not grow stays as it is."""
    robot, view = Unicycle(radius=0.4), sample_view()
    forecast = view.forecast
    assert forecast is not None
    beyond = replace(forecast, mean=forecast.mean[:, :, :2] + [0.4, 0.0],
                     covariance=2.0 * forecast.covariance[:, :, -2:])  # fmt: skip
    region = MahalanobisEllipse()
    plain = kind(region).choose(robot, view)
    asked = kind(region).choose(robot, replace(view, beyond=beyond))
    assert plain.at_end is None and asked.at_end is not None
    np.testing.assert_array_equal(plain.numbers.stages(), asked.numbers.stages())
    posed = asked.numbers.ending_in(asked.at_end).parameters
    np.testing.assert_array_equal(posed[:-1], plain.numbers.parameters[:-1])
    count = len(asked.names)
    moved = posed[-1, :count] - plain.numbers.parameters[-1, :count]
    np.testing.assert_allclose(moved[:, 0], 0.2, atol=1e-9)  # half of the way
    np.testing.assert_array_equal(posed[-1, count:], plain.numbers.parameters[-1, count:])
    # without `ways` a still obstacle is where it was
    still = replace(beyond, mean=forecast.mean[:, :, :2], covariance=forecast.covariance[:, :, :2])
    same = kind(region).choose(robot, replace(view, beyond=still)).at_end
    assert same is not None
    np.testing.assert_allclose(same, plain.numbers.parameters[-1], atol=1e-6)


class World:
    """A robot without noise among walkers who go straight on."""

    def __init__(self, seed: int, **changes: Any) -> None:
        rng = np.random.default_rng(seed)
        self.settings = PlannerSettings(**{
            "robot": Unicycle(radius=0.3), "region": MinkowskiSum(), "predictor": Nested(),
            "level": Fixed(), "solver": build("solvers", "riccati"), "horizon": 8,
            "fallback": Fallback(stop_at_end=True, steps_at_rest=1), **changes,
        })  # fmt: skip
        self.services = Services.of(self.settings)
        self.state = PlannerState.initial(self.settings, Path(np.array([[0.0, 0.0], [30.0, 0.0]])))
        self.x, self.time = np.array([0.0, 0.0, 0.0, 0.3, 0.0]), 0.0
        meets = np.stack([rng.uniform(1.0, 8.0, 5), rng.uniform(-0.6, 0.6, 5)], axis=-1)
        when, way = rng.uniform(4.0, 14.0, 5), rng.uniform(0.0, 2.0 * np.pi, 5)
        self.velocity = rng.uniform(0.4, 1.2, 5)[:, None] * np.stack([np.cos(way), np.sin(way)], 1)
        self.begin = meets - when[:, None] * self.velocity
        for tick in range(-2, 0):
            self.state = remember(self.settings, self.state, self.seen(tick * DT))

    def seen(self, time: float) -> Observation:
        places = self.begin + time * self.velocity
        some = (
            Detection(f"w{k}", place, 1e-12 * np.eye(2), 0.3) for k, place in enumerate(places)
        )
        return Observation(time, self.x, tuple(some))

    def decide(self) -> Decision:
        self.state, decision = step(self.settings, self.state, self.seen(self.time), self.services)
        inputs = decision.plan.inputs[0]
        self.x = np.array(integrate(self.settings.robot, tuple(self.x), tuple(inputs), DT))
        self.time += DT
        return decision


def successors(worlds: Sequence[World], count: int) -> tuple[int, int, int]:
    """How many decisions keep regions and end, how many keep regions, and successors that do not.

    Of those that keep their end the successors are asserted.
    """
    ended = kept = lost = 0
    for world in worlds:
        before = ends_well = False
        for _ in range(count):
            decision = world.decide()
            now = decision.plan.violation <= 1e-4
            assert now or not ends_well, decision.plan.reason
            lost += before and not now
            solved = decision.solved
            assert solved is not None
            instance = solved.instance
            if instance.posed is not None:
                deep = entered(instance.problem, instance.posed, [solved.point])
                ends_well = now and bool(deep.max(initial=0.0) <= 1e-4)
            ended, kept, before = ended + ends_well, kept + now, now
    return ended, kept, lost


@pytest.mark.parametrize("solver", ["riccati", "fatrop", "ipopt"])
@pytest.mark.parametrize("penalty", [None, 1e5])
def test_a_plan_that_ends_well_is_followed_by_a_plan(solver: str, penalty: float | None) -> None:
    """On forecasts that only shrink no successor is infeasible, with any solver."""
    seeds = range(4) if solver == "riccati" else range(1)
    worlds = [World(seed, solver=build("solvers", solver), penalty=penalty) for seed in seeds]
    ended, kept, _ = successors(worlds, 30)
    assert ended > 0.5 * kept > 0.25 * 30 * len(worlds)


@dataclass(frozen=True)
class Once(Solver):
    """Solves the first problem and then nothing any more."""

    calls: list[int] = field(default_factory=list)

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        self.calls.append(1)
        if len(self.calls) > 1:
            raise RuntimeError("out of order")
        return Riccati().solve(problem, parameters, guesses, deadline)


def carried(seed: int, steps_at_rest: int) -> int | None:
    """For how many of ten decisions the first plan holds, no other being found."""
    fallback = Fallback(stop_at_end=True, steps_at_rest=steps_at_rest)
    world = World(seed, solver=Once(), starts=(), fallback=fallback)
    solved = world.decide().solved
    assert solved is not None
    instance = solved.instance
    asked = instance.posed or instance.parameters
    if entered(instance.problem, asked, [solved.point]).max(initial=0.0) > 1e-4:
        return None
    rungs = [world.decide().plan.rung for _ in range(10)]
    return next((k for k, rung in enumerate(rungs) if rung is not Rung.SHIFTED), 10)


def test_the_last_plan_holds_for_as_long_as_its_end_is_kept_clear() -> None:
    """Ten steps at rest are ten decisions without a solver; without any, people come there."""
    held = {steps: [carried(seed, steps) for seed in range(24)] for steps in (0, 10)}
    known = [one for one in held[10] if one is not None]
    assert known == [10] * len(known) and len(known) > 10
    assert sum(one is not None and one < 10 for one in held[0]) > 2


def test_a_level_that_gives_way_takes_it_too() -> None:
    world = World(0, level=Relaxed(), penalty=1e5)
    decisions = [world.decide() for _ in range(8)]
    posed = decisions[-1].solved
    assert posed is not None and posed.instance.posed is not None


def test_plans_that_need_not_end_at_rest_are_refused() -> None:
    with pytest.raises(WideberthError, match="set fallback"):
        Fallback(steps_at_rest=1)
    with pytest.raises(WideberthError, match="steps_at_rest"):
        Fallback(stop_at_end=True, steps_at_rest=-1)


def test_kinds_that_know_no_regions_after_the_end_are_refused() -> None:
    with pytest.raises(WideberthError, match="none of the kinds"):
        World(0, further_kinds=(DrawnFutures(),))
    World(0, further_kinds=(DrawnFutures(),), fallback=Fallback(stop_at_end=True))


def test_a_forecast_is_cut_with_its_joint_covariance() -> None:
    rng = np.random.default_rng(5)
    root = rng.standard_normal((1, 1, 10, 10))
    joint = root @ root.swapaxes(2, 3)
    blocks = np.stack([joint[..., 2 * k : 2 * k + 2, 2 * k : 2 * k + 2] for k in range(5)], axis=2)
    mean = rng.standard_normal((1, 1, 5, 2))
    whole = Forecast(mean, blocks, np.ones((1, 1)), 0.5, (None,), joint)
    first, rest = whole.cut(3)
    assert first.steps == 3 and rest.steps == 2 and rest.joint is None
    np.testing.assert_array_equal(np.concatenate([first.mean, rest.mean], axis=2), mean)
    assert first.joint is not None
    np.testing.assert_allclose(first.joint, joint[..., :6, :6], atol=1e-12)
    assert whole.cut(3)[0].sample(rng, 2).shape == (2, 1, 3, 2)
