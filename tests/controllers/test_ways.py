"""Ways that people go next: their moments, their price, and what a plan says of them."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.controllers.slots.ways import Ways
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.stage import Frame
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs, ObstacleSet
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.region import Region
from wideberth.framework.testing.slot_kind import STEPS, sample_view
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.constant_velocity import ConstantVelocity
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati

WAYS = Ways(MahalanobisEllipse(), span=1.25, share=0.1, margin=0.05)


def test_a_way_is_where_somebody_is_within_the_span() -> None:
    """The moments of draws of the place at a time that is drawn within the span."""
    time = 0.25 * np.arange(-9.0, 1.0)[:, None]
    walk: Array = np.array(
        [[2.5, 0.2] + time * [-1.2, 0.3], [0.0, 3.0] + time * [0.1, -0.9]], dtype=np.float64
    )
    noise = np.tile(1e-4 * np.eye(2), (2, 1, 1))
    tracks = Tracks(walk, 0.25, ("anna", "ben"), np.array([0.25, 0.3]), noise)
    straight = ConstantVelocity(acceleration_density=0.05)
    near = ObstacleSet.of(straight.predict(tracks, 20), tracks.ids, tracks.radius)
    found, rng, count = WAYS.ways_of(near, 0.25), np.random.default_rng(0), 200_000
    for step, row in ((0, 0), (7, 1), (14, 0)):
        later = rng.integers(0, 6, count)  # 1.25 s are five steps of 0.25 s
        roots = np.linalg.cholesky(near.covariance[step : step + 6, row])
        drawn = roots[later] @ rng.standard_normal((count, 2, 1))
        places = near.mean[step + later, row] + drawn[..., 0]
        mean, covariance = places.mean(axis=0), np.cov(places.T)
        error = np.sqrt(np.diag(covariance) / count)
        assert (np.abs(found.mean[step, row] - mean) < 3.5 * error).all()
        scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)) / count)
        gap = np.abs(found.covariance[step, row] - covariance)
        assert (gap < 3.5 * np.sqrt(2.0) * scale).all()
    # behind the forecast's end nothing is known
    np.testing.assert_array_equal(found.mean[-1], near.mean[-1])
    np.testing.assert_array_equal(found.covariance[-1], near.covariance[-1])
    both = near.mean[-2:].mean(axis=0)
    np.testing.assert_allclose(found.mean[-2], both, rtol=0.0, atol=1e-12)
    assert found.ids == near.ids and found.radius is near.radius
    # a span of less than half a step is the place itself
    np.testing.assert_array_equal(replace(WAYS, span=0.1).ways_of(near, 0.25).mean, near.mean)


@pytest.mark.parametrize("region", [MahalanobisEllipse(), MinkowskiSum()], ids=repr)
def test_a_way_has_a_share_of_the_price_of_its_region(region: Region) -> None:
    robot, view = Unicycle(), sample_view()
    alone = GaussianDiscs(region).choose(robot, view)
    kind = replace(WAYS, region=region)
    chosen = kind.choose(robot, view)
    count = len(alone.names)
    assert count == 3 and chosen.names == alone.names and chosen.room == (10,)
    assert chosen.lesser == tuple(f"way of {name}" for name in alone.names)
    assert chosen.numbers.active.tolist() == [1.0] * 6 + [0.0] * 4
    bodies, ways = (chosen.numbers.parameters[:, k : k + count] for k in (0, count))
    np.testing.assert_array_equal(bodies[..., :-1], alone.numbers.parameters[:, :count])
    assert (bodies[..., -1] == 1.0).all() and (ways[..., -1] == 0.1).all()
    # they stand still in this view, so that a way is the body with another margin
    closer = GaussianDiscs(region).choose(robot, replace(view, margin=0.05))
    np.testing.assert_allclose(ways[..., :-1], closer.numbers.parameters[:, :count], atol=1e-12)

    x = ca.SX.sym("x", len(robot.states))
    pose = robot.pose(tuple(ca.vertsplit(x)))
    rows = [
        one.slots((10,), Frame(robot, x, pose, ca.SX(0, 1))).constraint
        for one in (GaussianDiscs(region), kind)
    ]
    rng = np.random.default_rng(3)
    states = rng.uniform(-3.0, 3.0, (STEPS, len(robot.states)))
    auxiliary = rng.uniform(0.1, 0.9, len(region.auxiliary(2)))
    for i in range(0, STEPS, 8):
        for k in (0, count):
            numbers = np.array([*chosen.numbers.parameters[i, k]])
            tail = [chosen.numbers.level[i, k] if chosen.numbers.level is not None else 0.0, 1.0]
            plain = np.concatenate([numbers[:-1], tail, auxiliary])
            priced = np.concatenate([numbers, tail, auxiliary])
            (free, _), (scaled, _) = (
                one(states[i], auxiliary, [], given)
                for one, given in zip(rows, (plain, priced), strict=True)
            )
            np.testing.assert_allclose(scaled, numbers[-1] * np.array(free), rtol=1e-12)


def crowded(ways: Ways | None, seed: int = 8) -> Planner:
    """A robot among six people who walk, so near that no plan keeps all regions."""
    planner = Planner(
        robot=build("robots", {"type": "holonomic_velocity", "radius": 0.25, "max_speed": 1.0}),
        region=MahalanobisEllipse(), predictor=ConstantVelocity(), level=Fixed(0.05),
        solver=Riccati(), horizon=6, dt=0.25, period=0.25, track_dt=0.25, penalty=1e4,
        margin=0.05, reference_speed=1.0, starts=(), further_kinds=() if ways is None else (ways,),
    )  # fmt: skip
    planner.set_path(Path(np.array([[0.0, 0.0], [5.0, 0.0]])))
    rng = np.random.default_rng(seed)
    places = rng.uniform([-0.2, -0.6], [1.2, 0.6], (6, 2))
    velocities = 0.6 * rng.standard_normal((6, 2))
    for tick in range(4):
        seen = (
            Detection(f"person {k}", place, 1e-4 * np.eye(2), 0.25)
            for k, place in enumerate(places + 0.25 * tick * velocities)
        )
        planner.command(Observation(0.25 * tick, np.zeros(2), tuple(seen)))
    return planner


def entered(planner: Planner) -> float:
    """How far the solver's plan enters bodies, summed over the steps."""
    record = planner.explain()
    point = record.again()[0].point
    problem, parameters = record.problem(), record.parameters
    deep = violation(problem, parameters, point).regions
    bodies = [name.startswith("person") for name in record.names]
    return float(deep[:, bodies].max(axis=1).sum())


def test_bodies_are_entered_less_where_ways_are_cheap() -> None:
    """At a small share as little as without ways, at the whole price far more."""
    more = 0
    for seed in (8, 10, 11, 12, 14):
        alone = entered(crowded(None, seed))
        assert entered(crowded(replace(WAYS, share=0.01), seed)) <= alone + 0.01
        more += entered(crowded(replace(WAYS, share=1.0), seed)) > alone + 0.1
    assert more == 4


def test_the_plan_is_that_of_another_solver() -> None:
    record = crowded(WAYS).explain()
    (ours,), (theirs,) = record.again(), record.again("ipopt")
    assert ours.cost <= theirs.cost * (1.0 + 1e-6) + 1e-6


def test_levels_are_said_of_bodies_alone() -> None:
    planner = crowded(WAYS)
    assert planner.plan is not None
    people = {f"person {k}" for k in range(6)}
    assert set(planner.plan.ids) == people and planner.plan.level.shape == (6, 6)
    names = planner.explain().names
    near = [name for name in names if name in people]
    assert len(near) == 5  # another one is out of reach
    assert names[:10] == (*near, *(f"way of {name}" for name in near))
    again = build("controllers", {"type": "mpc", **describe(planner)})
    assert again.further_kinds == (WAYS,)


def test_nobody_has_no_way() -> None:
    planner = crowded(WAYS)
    planner.reset()
    planner.command(Observation(0.0, np.zeros(2)))
    assert planner.plan is not None and planner.plan.rung == "optimal"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"span": 0.0}, r"ways\.span"),
        ({"share": 0.0}, r"ways\.share"),
        ({"share": 1.5}, r"ways\.share is 1\.5; wanted at most 1"),
        ({"margin": -0.1}, r"ways\.margin"),
    ],
)
def test_numbers_out_of_range_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        replace(WAYS, **change)


def test_a_planner_refuses_ways_that_it_cannot_price() -> None:
    planner = crowded(WAYS)
    with pytest.raises(WideberthError, match=r"give a penalty"):
        replace(planner, penalty=None)
    with pytest.raises(WideberthError, match=r"most_obstacles is 60; wanted at most 50"):
        replace(planner, most_obstacles=60)
    with pytest.raises(WideberthError, match=r"level is Relaxed, which would give way"):
        replace(planner, level=Relaxed())


@pytest.mark.parametrize("stamp", [0.1, 1e9, 1e17, 1e300, 1.7e308, -1e300])
def test_ways_are_the_same_on_any_clock(stamp: float) -> None:
    """The step was read off the clock: 0 s where that counts in larger ones, and 1 / 0."""
    view = sample_view()
    kind, robot = replace(WAYS, region=MinkowskiSum()), Unicycle()
    wanted = kind.choose(robot, view).numbers
    shifted = replace(view, times=stamp + view.times)
    found = kind.choose(robot, shifted).numbers
    np.testing.assert_array_equal(found.parameters, wanted.parameters)


@pytest.mark.parametrize("stamp", [1e17, 1e300])
def test_a_planner_with_ways_plans_on_any_clock(stamp: float) -> None:
    planner = crowded(WAYS)
    planner.reset()
    away = Detection("a", np.array([2.0, 3.0]), 1e-4 * np.eye(2), 0.25)
    planner.command(Observation(stamp, np.zeros(2), (away,)))
    assert planner.plan is not None and planner.plan.rung == "optimal", planner.plan


def test_a_kind_with_the_name_of_a_built_in_one_takes_its_place() -> None:
    plain, own = crowded(None), crowded(WAYS)
    assert own.kinds == (WAYS, plain.kinds[1])
    assert [kind.name for kind in own.kinds] == [kind.name for kind in plain.kinds]
