"""The contract of a LevelPolicy, checked with every registered region."""

from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from ..mpc.levels.base import LevelPolicy, SharedLevel
from ..plugins.registry import load, names
from ..region import Guarantee, Region
from ..values.arrays import Array
from ..values.coverage import Event
from ..values.errors import WideberthError
from .laws import Contract, Law, check_coverage, law, stated

_SIZES = ((1, 1), (1, 4), (15, 1), (15, 3), (60, 20), (3, 0))
"""Steps and obstacles."""


@Contract
def check_level(policy: LevelPolicy) -> Iterator[Law]:
    """Check the laws of a level policy.

    It is a frozen dataclass with a tail in (0, 1), which states its coverage or None. With each
    registered region it gives the same finite levels (steps, obstacles) each time, all the same
    and not below ``minimum`` where one variable stands for them, else not negative; and no lower
    ones for half the tail. If what it promises is a content, the tails of its levels are those
    of its event: that of the first step, or of all steps and obstacles of a plan together.
    It may refuse a region with a WideberthError, and has to where it promises a collision
    risk that the region guarantees at no level.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    served = _Served(policy)
    yield from stated(_Served, policy, lambda: [served])
    yield from stated(_Levels, policy, lambda: served.levels)


def _promises_content(policy: LevelPolicy) -> bool:
    return policy.coverage is not None and policy.promise == "content"


def _has_tail(policy: LevelPolicy) -> bool:
    if not is_dataclass(policy):
        return False
    return any(entry.name == "tail" and entry.init for entry in fields(policy))


@dataclass(frozen=True, eq=False)
class _Served:
    """A policy, and the registered regions that it does not refuse."""

    policy: LevelPolicy

    @cached_property
    def regions(self) -> list[tuple[Region, int]]:
        """Each region with a number of dimensions."""
        every: list[Region] = [load("regions", name)() for name in names("regions")]
        pairs = [(region, size) for region in every for size in region.dimensions]
        return [pair for pair in pairs if self._serves(*pair)]

    def _serves(self, region: Region, dimension: int) -> bool:
        try:
            self.policy.levels(region, 1, 1, dimension)
        except WideberthError:
            return False
        return True

    @cached_property
    def levels(self) -> list["_Levels"]:
        return [_Levels(self.policy, *pair, *size) for pair in self.regions for size in _SIZES]

    @law("fields")
    def check_fields(self) -> None:
        policy = self.policy
        assert is_dataclass(policy), "a policy is a dataclass"
        assert 0.0 < policy.tail < 1.0, "the tail must lie between 0 and 1"
        if isinstance(policy, SharedLevel):
            assert policy.weight >= 0.0, "the weight must not be negative"
            assert policy.minimum < np.inf, "the minimum must be below infinity"
        assert replace(cast(Any, policy)) == policy, "its fields must rebuild it"

    @law("what it promises is stated")
    def check_coverage(self) -> None:
        check_coverage(self.policy.coverage)

    @law("serves some region")
    def check_serves(self) -> None:
        assert self.regions, "it must serve some registered region"

    @law("refuses a risk that no region keeps")
    def check_promise(self) -> None:
        for region, _ in self.regions:
            hollow = self.policy.promise == "risk" and region.guarantee is Guarantee.NONE
            name = type(region).__name__
            assert not hollow, f"{name} guarantees no risk, and it has to be refused"


@dataclass(frozen=True, eq=False)
class _Levels:
    """What a policy gives for one region and one size of the problem."""

    policy: LevelPolicy
    region: Region
    dimension: int
    steps: int
    obstacles: int

    def of(self, policy: LevelPolicy) -> Array:
        return policy.levels(self.region, self.steps, self.obstacles, self.dimension)

    @cached_property
    def found(self) -> Array:
        return self.of(self.policy)

    @law("shape and finite")
    def check_values(self) -> None:
        shape = (self.steps, self.obstacles)
        self._demand(self.found.shape == shape, "levels are (steps, obstacles)")
        self._demand(self.found.dtype == np.float64, "levels are float64")
        self._demand(bool(np.isfinite(self.found).all()), "levels are finite")

    @law("same input, same levels")
    def check_repeats(self) -> None:
        again = self.of(self.policy)
        self._demand(np.array_equal(self.found, again), "the same input gives the same")

    @law("one variable, one level", SharedLevel, "each obstacle and step has a level of its own")
    def check_constant(self) -> None:
        alike = not self.found.size or bool((self.found == self.found.flat[0]).all())
        self._demand(alike, "one variable has one aim")

    @law("not below the minimum")
    def check_least(self) -> None:
        least = self.policy.minimum if isinstance(self.policy, SharedLevel) else 0.0
        self._demand(bool((self.found >= least).all()), f"no level is below {least:g}")

    @law("half the tail, no lower level", _has_tail, "its tail is no field")
    def check_tail(self) -> None:
        strict = self.of(replace(cast(Any, self.policy), tail=0.5 * self.policy.tail))
        self._demand(bool((strict >= self.found).all()), "half the tail, no lower level")

    @law("keeps the event that it states", _promises_content, "it promises a risk, or nothing")
    def check_event(self) -> None:
        """Check the tails of its levels: of the first step, or the sum of those of a plan."""
        assert self.policy.coverage is not None
        single = self.policy.coverage.event is Event.STEP
        levels, counts = np.unique(self.found[:1] if single else self.found, return_counts=True)
        tails = np.array([self.region.tail(float(level), self.dimension) for level in levels])
        reached = tails.max(initial=0.0) if single else float(tails @ counts)
        text = f"its event is missed with probability {reached:.6g}; wanted {self.policy.tail:g}"
        self._demand(reached <= self.policy.tail * (1.0 + 1e-6), text)

    def _demand(self, holds: bool, law: str) -> None:
        region = type(self.region).__name__
        where = f"{region}, {self.steps} steps, {self.obstacles} obstacles, {self.dimension}-D"
        assert holds, f"{law} ({where})"
