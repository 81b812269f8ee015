"""How often people leave what plans kept clear: counts by hand, and shares by closed form."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from wideberth.controllers.levels.risk_allocation import RiskAllocation
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.plan import Plan, Rung, Situation, Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.simulation.measures.kept_clear import HeededRegions, KeptClear, Person
from wideberth.tests.helpers.planning import approach, planner

STEPS = 3
REGION = MahalanobisEllipse()


def plan_with(mean: Array, sigma: float, names: tuple[str, ...]) -> Plan:
    """Plan of a robot that stands, with a round forecast of means (O, N, 2)."""
    covariance = np.broadcast_to(sigma**2 * np.eye(2), (*mean.shape, 2)).copy()
    empty = np.zeros((STEPS, 0))
    return Plan(
        stamp=2.0,
        dt=0.5,
        states=np.zeros((STEPS + 1, 2)),
        inputs=np.zeros((STEPS, 2)),
        positions=np.zeros((STEPS + 1, 2)),
        reference=np.zeros((STEPS, 2)),
        auxiliaries=np.zeros((STEPS, 0, 0)),
        level=empty,
        target=empty,
        content=empty,
        ids=(),
        status=Status.SOLVED,
        rung=Rung.OPTIMAL,
        forecast=Forecast.single(mean, covariance, 0.5),
        tracked=names,
    )


def at(places: Array) -> Person:
    """Return somebody of 0.3 m who is there at 2.5, 3.0 and 3.5 s, and not asked otherwise."""

    def where(times: Array) -> Array:
        assert times == pytest.approx([2.5, 3.0, 3.5])
        return np.asarray(places)

    return Person(where, 0.3)


def test_counts_by_hand() -> None:
    """One stays, one leaves at the second step, one is seen for one step, one comes anew."""
    mean = np.zeros((3, STEPS, 2)) + 10.0 * np.arange(3)[:, None, None]
    bound = np.sqrt(chi2.ppf(0.95, 2))
    inside, outside = np.array([0.99 * bound, 0.0]), np.array([1.01 * bound, 0.0])
    stays = mean[0] + inside
    leaves = mean[1] + np.array([inside, outside, inside])
    lost = mean[2] + np.array([inside, [np.nan, np.nan], [np.nan, np.nan]])
    comes = np.array([[np.nan, np.nan], [50.0, 0.0], [50.0, 0.0]])
    people = {"a": at(stays), "b": at(leaves), "c": at(lost), "d": at(comes)}
    plan = plan_with(mean, 1.0, ("a", "b", "c"))
    found = KeptClear.of(plan, REGION, Fixed(0.05), people, 0.4)
    assert found is not None and found.newcomers == 1
    assert found.outside.tolist() == [[False] * 3, [False, True, False], [False] * 3]
    assert found.uncovered.tolist() == [False, True, False]
    assert found.counts() == {
        **{"steps": 7.0, "steps_missed": 1.0, "persons": 3.0, "persons_missed": 1.0},
        **{"plans": 1.0, "plans_missed": 1.0, "fields": 1.0, "fields_missed": 1.0},
        **{"meetings": 1.0, "meetings_missed": 0.0},
        **{"driven": 1.0, "driven_missed": 0.0, "plans_with_newcomers": 1.0},
    }
    assert found.radius == pytest.approx(np.full((3, 3), bound))


def test_another_persons_region_covers_the_field_and_not_the_person() -> None:
    mean = np.zeros((2, STEPS, 2))
    mean[1] += (3.0, 0.0)
    people = {"a": at(mean[1]), "b": at(mean[1])}
    found = KeptClear.of(plan_with(mean, 0.5, ("a", "b")), REGION, Fixed(0.05), people, 0.4)
    assert found is not None
    assert found.outside.tolist() == [[True] * 3, [False] * 3]
    assert not found.uncovered.any()


def test_a_plan_meets_whom_it_would_touch() -> None:
    """The robot of 0.4 m stands at the origin; somebody of 0.3 m comes as near as 0.69 m."""
    mean = np.full((1, STEPS, 2), 5.0)
    near = np.array([[0.71, 0.0], [0.0, 0.69], [np.nan, np.nan]])
    found = KeptClear.of(plan_with(mean, 1.0, ("a",)), REGION, Fixed(), {"a": at(near)}, 0.4)
    assert found is not None and found.met.tolist() == [[False, True, False]]
    assert found.counts()["meetings_missed"] == 1.0


def test_plans_without_people_say_nothing() -> None:
    plan = plan_with(np.zeros((1, STEPS, 2)), 1.0, ("a wall",))
    assert KeptClear.of(plan, REGION, Fixed(), {"a": at(np.zeros((STEPS, 2)))}, 0.4) is None
    assert KeptClear.of(replace(plan, forecast=None), REGION, Fixed(), {}, 0.4) is None


@pytest.mark.parametrize("level", [Fixed(0.1), RiskAllocation(0.3)])
def test_shares_are_those_of_the_model(level: Fixed | RiskAllocation) -> None:
    """Independent steps and people: a step is missed with its tail, a plan by their product."""
    people, draws, rng = 2, 4000, np.random.default_rng(0)
    mean = np.zeros((people, STEPS, 2)) + 10.0 * np.arange(people)[:, None, None]
    plan = plan_with(mean, 0.7, ("a", "b"))
    total = np.zeros(4)
    for _ in range(draws):
        truth = mean + 0.7 * rng.standard_normal(mean.shape)
        found = KeptClear.of(plan, REGION, level, {"a": at(truth[0]), "b": at(truth[1])}, 0.4)
        assert found is not None
        counts = found.counts()
        total += [
            counts[name] for name in ("steps_missed", "persons_missed", "plans_missed", "steps")
        ]
    tails = np.full(STEPS, 0.1) if isinstance(level, Fixed) else level.tails(STEPS, people)
    person = 1.0 - np.prod(1.0 - tails)
    for share, count, true in (
        (total[0] / total[3], total[3], tails.mean()),
        (total[1] / (people * draws), people * draws, person),
        (total[2] / draws, draws, 1.0 - (1.0 - person) ** people),
    ):
        assert abs(share - true) < 3.0 * np.sqrt(true * (1.0 - true) / count)


@pytest.mark.parametrize("gap", [16.0, 9.0, 3.5])
def test_the_regions_aimed_at_are_entered_by_plans_that_gave_way_alone(gap: float) -> None:
    plan = approach(planner(margin=0.1), gap=gap)
    regions = HeededRegions.aimed(plan, len(plan.inputs))
    assert regions is not None
    entered = regions.contain(plan.positions[None, 1:])
    assert entered.shape == (1, 1, len(plan.inputs))
    assert bool(entered.any()) is plan.below_reference is (gap < 10.0)
    first = HeededRegions.aimed(plan, 2)
    assert first is not None and first.contain(plan.positions[None, 1:3]).shape == (1, 1, 2)


def test_a_plan_without_regions_aims_at_none() -> None:
    made = plan_with(np.zeros((1, STEPS, 2)), 1.0, ("a",))
    assert HeededRegions.aimed(made, STEPS) is None
    known = replace(made, situation=Situation(REGION, 0.4, np.array([0.3]), 0.4))
    assert HeededRegions.aimed(known, STEPS) is None  # the problem holds no one
