"""The contract of a LevelPolicy, checked with every registered region."""

from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass, fields, is_dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from ..mpc.levels.base import LevelPolicy, SharedLevel
from ..plugins.registry import load, names
from ..region import Guarantee, Region
from ..values.arrays import Array
from ..values.errors import WideberthError
from .laws import Law, each, require

_SIZES = ((1, 1), (1, 4), (15, 1), (15, 3), (60, 20), (3, 0))
"""Steps and obstacles."""


def check_level(policy: LevelPolicy) -> None:
    """Check the laws of a level policy.

    It is a frozen dataclass with a tail in (0, 1). With each registered region it gives the
    same finite levels (steps, obstacles) each time, all the same and not below ``minimum``
    where one variable stands for them, else not negative; and no lower ones for half the tail.
    It may refuse a region with a WideberthError, and has to where it promises a collision
    risk that the region guarantees at no level.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """
    require(laws(policy))


def laws(policy: LevelPolicy) -> tuple[Law, ...]:
    """Return the laws of a level policy."""
    served = _Served(policy)
    shared = isinstance(policy, SharedLevel)
    separate = "" if shared else "each obstacle and step has a level of its own"
    fixed = "" if _has_tail(policy) else "its tail is no field"

    def law(name: str, check: Callable[[_Levels], None], exception: str = "") -> Law:
        return Law(name, each(check, lambda: served.levels), exception)

    return (
        Law("fields", lambda: _check_fields(policy)),
        Law("frozen", lambda: _check_frozen(policy)),
        Law("serves some region", lambda: _check_serves(policy, served)),
        Law("refuses a risk that no region keeps", lambda: _check_promise(policy, served)),
        law("shape and finite", _Levels.check_values),
        law("same input, same levels", _Levels.check_repeats),
        law("one variable, one level", _Levels.check_constant, separate),
        law("not below the minimum", _Levels.check_least),
        law("half the tail, no lower level", _Levels.check_tail, fixed),
    )


def _check_fields(policy: LevelPolicy) -> None:
    _demand(is_dataclass(policy), "a policy is a dataclass")
    _demand(0.0 < policy.tail < 1.0, "the tail must lie between 0 and 1")
    if isinstance(policy, SharedLevel):
        _demand(policy.weight >= 0.0, "the weight must not be negative")
        _demand(policy.minimum < np.inf, "the minimum must be below infinity")
    _demand(replace(cast(Any, policy)) == policy, "its fields must rebuild it")


def _check_frozen(policy: LevelPolicy) -> None:
    for one in fields(cast(Any, policy)):
        try:
            setattr(policy, one.name, getattr(policy, one.name))
        except FrozenInstanceError:
            continue
        _demand(False, f"it must be frozen, and {one.name} can be set")


def _has_tail(policy: LevelPolicy) -> bool:
    if not is_dataclass(policy):
        return False
    return any(one.name == "tail" and one.init for one in fields(cast(Any, policy)))


@dataclass(frozen=True, eq=False)
class _Served:
    """The registered regions that a policy does not refuse."""

    policy: LevelPolicy

    @cached_property
    def regions(self) -> list[tuple[Region, int]]:
        """Each region with a number of dimensions."""
        every: list[Region] = [load("regions", name)() for name in names("regions")]
        return [(one, size) for one in every for size in one.dimensions if self._serves(one, size)]

    def _serves(self, region: Region, dimension: int) -> bool:
        try:
            self.policy.levels(region, 1, 1, dimension)
        except WideberthError:
            return False
        return True

    @cached_property
    def levels(self) -> list["_Levels"]:
        return [_Levels(self.policy, *one, *size) for one in self.regions for size in _SIZES]


def _check_serves(policy: LevelPolicy, served: _Served) -> None:
    _demand(len(served.regions) > 0, "it must serve some registered region")


def _check_promise(policy: LevelPolicy, served: _Served) -> None:
    for region, _ in served.regions:
        hollow = policy.promise == "risk" and region.guarantee is Guarantee.NONE
        name = type(region).__name__
        _demand(not hollow, f"{name} guarantees no risk, and it has to be refused")


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

    def check_values(self) -> None:
        shape = (self.steps, self.obstacles)
        self._demand(self.found.shape == shape, "levels are (steps, obstacles)")
        self._demand(self.found.dtype == np.float64, "levels are float64")
        self._demand(bool(np.isfinite(self.found).all()), "levels are finite")

    def check_repeats(self) -> None:
        again = self.of(self.policy)
        self._demand(np.array_equal(self.found, again), "the same input gives the same")

    def check_constant(self) -> None:
        self._demand(_constant(self.found), "one variable has one aim")

    def check_least(self) -> None:
        least = self.policy.minimum if isinstance(self.policy, SharedLevel) else 0.0
        self._demand(bool((self.found >= least).all()), f"no level is below {least:g}")

    def check_tail(self) -> None:
        strict = replace(cast(Any, self.policy), tail=0.5 * self.policy.tail)
        higher = self.of(strict)
        self._demand(bool((higher >= self.found).all()), "half the tail, no lower level")

    def _demand(self, holds: bool, law: str) -> None:
        region = type(self.region).__name__
        where = f"{region}, {self.steps} steps, {self.obstacles} obstacles, {self.dimension}-D"
        _demand(holds, f"{law} ({where})")


def _constant(levels: Array) -> bool:
    return bool((levels == levels.flat[0]).all()) if levels.size else True


def _demand(holds: bool, law: str) -> None:
    if not holds:
        raise AssertionError(law)
