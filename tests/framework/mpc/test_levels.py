"""Level policies: their laws, their profiles, and what reaches the problem."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path as Folder
from typing import Any, final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wideberth import experiments
from wideberth.controllers.levels.discounted import Discounted
from wideberth.controllers.levels.risk_allocation import RiskAllocation
from wideberth.framework import names
from wideberth.framework.mpc.levels.base import LevelPolicy, Promise
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.reference import lay_reference
from wideberth.framework.mpc.slots.gaussian_discs import ObstacleSet
from wideberth.framework.plugins.registry import load
from wideberth.framework.plugins.yamlfile import read_config
from wideberth.framework.region import Region
from wideberth.framework.testing.level import check_level
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.predictors.game import Game
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.contracts import Contract
from wideberth.tests.helpers.problems import assemble, fill

POLICIES = [
    *(load("levels", name)() for name in names("levels")),
    Fixed(0.3, promise="risk"),
    Relaxed(minimum=-np.inf, weight=0.0),
    Relaxed(minimum=2.0, weight=1.0),
    Discounted(tail=0.01, final_tail=0.9, full_steps=4, promise="risk"),
    Discounted(tail=0.3, final_tail=0.3),
    RiskAllocation(tail=0.5, growth=0.0),
    RiskAllocation(tail=1e-6, growth=3.0, promise="risk"),
]
TAILS = st.floats(1e-12, 0.999)


CONTRACT = Contract.of(POLICIES, check_level.laws)


@pytest.mark.parametrize(("policy", "law"), CONTRACT.cases())
def test_policies_keep_their_laws(policy: str, law: str) -> None:
    CONTRACT.check(policy, law)


def test_who_names_relaxed_gets_what_is_recommended_and_the_paper_by_its_name() -> None:
    """The shipped experiments state no number that the defaults have."""
    assert Relaxed() == Relaxed(tail=0.05, weight=1000.0, minimum=1.0)
    paper, same = Paper(), Relaxed(0.050012, weight=1.0, minimum=0.0)
    region = MahalanobisEllipse()
    assert np.array_equal(paper.levels(region, 3, 2, 2), same.levels(region, 3, 2, 2))
    for one in (paper, same):
        assert (one.weight, one.minimum, one.promise) == (1.0, 0.0, "content")
    assert paper.levels(region, 1, 1, 2)[0, 0] == pytest.approx(np.sqrt(5.991), abs=1e-4)
    with pytest.raises(WideberthError, match="wanted at most"):
        Paper(minimum=3.0).levels(region, 1, 1, 2)
    with pytest.raises(WideberthError, match=r"level\.weight"):
        Paper(weight=-1.0)
    for file in Folder(experiments.__file__).parent.glob("configs/*.yaml"):
        for stated in relaxed_in(read_config(file)):
            for field in fields(Relaxed):
                assert stated.get(field.name) != field.default, (file.name, stated)
    assert Game().planner.level == Relaxed()


def relaxed_in(value: Any) -> Iterator[dict[str, Any]]:
    """Yield every mapping of a config that names `Relaxed` and numbers of its own."""
    if isinstance(value, dict) and value.get("type") == "relaxed":
        yield value
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    for one in inner:
        yield from relaxed_in(one)


@final
@dataclass(frozen=True)
class Broken(LevelPolicy):
    """Breaks one law, by its name."""

    law: str = ""
    tail: float = 0.05
    promise: Promise = "content"

    @property
    def coverage(self) -> object:
        return "95 %" if self.law == "coverage is '95 %'" else None

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        good = np.full((steps, obstacles), region.level(self.tail, dimension))
        if self.law == "no level is below 0":
            return -good
        if self.law == "half the tail":
            return 1.0 / good
        return good.T if self.law == "levels are" else good


@pytest.mark.parametrize(
    "law", ["no level is below 0", "half the tail", "levels are", "coverage is '95 %'"]
)
def test_a_policy_that_breaks_a_law_is_told_which(law: str) -> None:
    check_level(Broken())
    with pytest.raises(AssertionError, match=law):
        check_level(Broken(law))


@final
@dataclass(frozen=True)
class Unshared(LevelPolicy):
    """Promises a whole plan, and gives every obstacle what one alone may take."""

    tail: float = 0.05
    promise: Promise = "content"
    coverage = RiskAllocation.coverage

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        alone = RiskAllocation(self.tail).levels(region, steps, 1, dimension)
        return np.repeat(alone, obstacles, axis=1)


def test_a_policy_that_promises_a_plan_must_share_its_tail() -> None:
    with pytest.raises(
        AssertionError, match=r"event is missed with probability 0\.2; wanted 0\.05"
    ):
        check_level(Unshared())
    with pytest.raises(AssertionError, match=r"event is missed with probability"):
        check_level(replace(Twice(), tail=0.05))


@final
@dataclass(frozen=True)
class Twice(LevelPolicy):
    """Promises one person at one step, and takes twice its tail."""

    tail: float = 0.05
    promise: Promise = "content"
    coverage = Fixed.coverage

    def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
        return Fixed(2.0 * self.tail).levels(region, steps, obstacles, dimension)


def test_a_risk_must_not_be_promised_with_any_region() -> None:
    with pytest.raises(AssertionError, match="guarantees no risk"):
        check_level(Broken(promise="risk"))
    for policy in (Discounted(promise="risk"), RiskAllocation(promise="risk")):
        with pytest.raises(WideberthError, match="guarantees no collision risk"):
            policy.levels(MahalanobisEllipse(), 15, 1, 2)


@given(TAILS, TAILS, st.integers(1, 30), st.integers(1, 60))
def test_a_discounted_tail_is_full_first_and_grows_by_one_factor(
    one: float, other: float, full: int, steps: int
) -> None:
    low, high = sorted((one, other))
    tails = Discounted(low, high, full).tails(steps)
    assert tails[: min(full, steps)] == pytest.approx(low, rel=1e-12)
    if steps > full:
        assert tails[-1] == pytest.approx(high, rel=1e-9)
    ratios = tails[full:] / tails[full - 1 : -1]
    assert ratios == pytest.approx(np.full(len(ratios), max((high / low), 1.0)) ** (
        1.0 / max(steps - full, 1)
    ), rel=1e-9)  # fmt: skip


def test_discounted_levels_stand_for_their_tails() -> None:
    policy = Discounted(0.05, 0.5, full_steps=2)
    for region in (MahalanobisEllipse(), MinkowskiSum()):
        level = policy.levels(region, 12, 3, 2)
        found = [region.tail(value) for value in level[:, 2]]
        assert found == pytest.approx(policy.tails(12), rel=1e-9)
        assert level[0, 0] == level[1, 0] == region.level(0.05) > level[2, 0]
    # At a risk above one half the exact sum and the half-planes would be negative.
    final = replace(policy, final_tail=0.9, promise="risk")
    for region in (MinkowskiSum(), HalfPlane()):
        assert final.levels(region, 12, 1, 2)[-1, 0] == 0.0


@given(TAILS, st.floats(0.0, 5.0), st.integers(1, 100), st.integers(1, 50))
def test_shares_of_the_risk_sum_to_the_whole(
    tail: float, growth: float, steps: int, obstacles: int
) -> None:
    tails = RiskAllocation(tail, growth).tails(steps, obstacles)
    assert tails.shape == (steps,) and (tails > 0).all()
    assert (np.diff(tails) >= -1e-15).all()
    assert obstacles * tails.sum() == pytest.approx(tail, rel=1e-9)


@given(
    st.sampled_from([MinkowskiSum(), HalfPlane(), MahalanobisEllipse()]),
    st.floats(1e-6, 0.9),
    st.floats(0.0, 3.0),
    st.integers(1, 40),
    st.integers(1, 20),
)
def test_the_levels_risks_sum_to_no_more_than_the_whole(
    region: Region, tail: float, growth: float, steps: int, obstacles: int
) -> None:
    level = RiskAllocation(tail, growth).levels(region, steps, obstacles, 2)
    total = sum(region.tail(value) for value in level.ravel())
    assert total == pytest.approx(tail, rel=1e-6) or total < tail
    exact = MinkowskiSum()
    level = RiskAllocation(tail, growth, "risk").levels(exact, steps, obstacles, 2)
    assert sum(exact.risk(value) for value in level.ravel()) <= tail * (1 + 1e-6)


def test_one_step_and_one_obstacle_take_the_whole_risk() -> None:
    for promise in ("content", "risk"):
        whole = RiskAllocation(0.05, promise=promise).levels(MinkowskiSum(), 1, 1, 2)
        assert whole == pytest.approx(Fixed(0.05, promise=promise).levels(MinkowskiSum(), 1, 1, 2))


def filled(policy: LevelPolicy, ids: tuple[str, ...], capacity: int) -> Array:
    """Levels in the slots of a problem of six steps."""
    reference = lay_reference(Path(np.array([[0.0, 0.0], [9.0, 0.0]])), 0.0, 0.5, 6, 0.5)
    mean = np.zeros((6, len(ids), 2))
    covariance = np.broadcast_to(np.eye(2), (6, len(ids), 2, 2))
    obstacles = ObstacleSet(mean, covariance, np.full(len(ids), 0.3), ids)
    start = np.zeros(5)
    parameters = fill(start, reference, obstacles, MinkowskiSum(), policy, 0.75, capacity)
    level = parameters.slots[0].level
    assert level is not None and level.shape == (6, capacity)
    return level


def test_slots_do_not_share_in_the_risk_but_obstacles_do() -> None:
    policy = RiskAllocation(0.1)
    for ids, capacity in ((("a",), 1), (("a",), 5), (("a", "a", "a"), 5), ((), 2)):
        level = filled(policy, ids, capacity)
        alone = policy.levels(MinkowskiSum(), 6, 1, 2)
        assert np.array_equal(level, np.repeat(alone, capacity, axis=1))
    level = filled(policy, ("a", "b", "a", "c"), 5)
    assert np.array_equal(level[:, 0], policy.levels(MinkowskiSum(), 6, 3, 2)[:, 0])
    assert filled(policy, (), 0).size == 0


def test_every_obstacle_gets_its_own_column() -> None:
    @final
    @dataclass(frozen=True)
    class Numbered(LevelPolicy):
        """The obstacle's number as its level."""

        tail: float = 0.05
        promise: Promise = "content"

        def levels(self, region: Region, steps: int, obstacles: int, dimension: int) -> Array:
            return np.tile(np.arange(obstacles, dtype=np.float64), (steps, 1))

    level = filled(Numbered(), ("b", "a", "b", "c"), 5)
    assert level[0].tolist() == [0.0, 1.0, 0.0, 2.0, 0.0]


@pytest.mark.parametrize("weight", [1.0, 15.0])
def test_both_readings_of_the_paper_s_price(weight: float) -> None:
    """Once in the cost, or inside the sum over i = 1..15, which is the weight 15."""
    policy = Relaxed(weight=weight, minimum=0.0)
    problem = assemble(
        Unicycle(), MahalanobisEllipse(), policy, horizon=15, dt=0.5, capacity=1
    )  # fmt: skip
    level, target = 1.2, 2.4
    counted = sum((level - target) ** 2 for _ in range(round(weight)))
    assert float(problem.level_cost(level, target)) == pytest.approx(counted)
    assert problem.shared and problem.minimum == 0.0  # bounded below unless asked otherwise


def test_settings_out_of_range_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"final_tail is 0\.01; wanted at least"):
        Discounted(0.05, 0.01)
    with pytest.raises(WideberthError, match="full_steps"):
        Discounted(full_steps=0)
    with pytest.raises(WideberthError, match="growth"):
        RiskAllocation(growth=-1.0)
    for kind in (Discounted, RiskAllocation):
        with pytest.raises(WideberthError, match="tail"):
            kind(tail=0.0)
        with pytest.raises(WideberthError, match="promise"):
            kind(promise="luck")  # type: ignore[arg-type]
