"""The contract of a LevelPolicy, checked with every registered region."""

from dataclasses import FrozenInstanceError, fields, is_dataclass, replace
from typing import Any, cast

import numpy as np

from ..mpc.levels.base import LevelPolicy, SharedLevel
from ..plugins.registry import load, names
from ..region import Guarantee, Region
from ..values.arrays import Array
from ..values.errors import WideberthError

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
    AssertionError : a law does not hold; the message names it and says where.
    """
    _check_fields(policy)
    served = 0
    for name in names("regions"):
        region: Region = load("regions", name)()
        for dimension in region.dimensions:
            try:
                policy.levels(region, 1, 1, dimension)
            except WideberthError:
                continue
            served += 1
            hollow = policy.promise == "risk" and region.guarantee is Guarantee.NONE
            _demand(policy, not hollow, f"{name} guarantees no risk, and it has to be refused")
            for steps, obstacles in _SIZES:
                _check_levels(policy, region, steps, obstacles, dimension)
    _demand(policy, served > 0, "it must serve some registered region")


def _check_fields(policy: LevelPolicy) -> None:
    _demand(policy, is_dataclass(policy), "a policy is a dataclass")
    _demand(policy, 0.0 < policy.tail < 1.0, "the tail must lie between 0 and 1")
    if isinstance(policy, SharedLevel):
        _demand(policy, policy.weight >= 0.0, "the weight must not be negative")
        _demand(policy, policy.minimum < np.inf, "the minimum must be below infinity")
    _demand(policy, replace(cast(Any, policy)) == policy, "its fields must rebuild it")
    for one in fields(cast(Any, policy)):
        try:
            setattr(policy, one.name, getattr(policy, one.name))
        except FrozenInstanceError:
            continue
        _demand(policy, False, f"it must be frozen, and {one.name} can be set")


def _check_levels(
    policy: LevelPolicy, region: Region, steps: int, obstacles: int, dimension: int
) -> None:
    where = f" ({type(region).__name__}, {steps} steps, {obstacles} obstacles, {dimension}-D)"
    found = policy.levels(region, steps, obstacles, dimension)
    again = policy.levels(region, steps, obstacles, dimension)
    _demand(policy, found.shape == (steps, obstacles), f"levels are (steps, obstacles){where}")
    _demand(policy, found.dtype == np.float64, f"levels are float64{where}")
    _demand(policy, bool(np.isfinite(found).all()), f"levels are finite{where}")
    _demand(policy, np.array_equal(found, again), f"the same input gives the same{where}")
    least = 0.0
    if isinstance(policy, SharedLevel):
        _demand(policy, _constant(found), f"one variable has one aim{where}")
        least = policy.minimum
    _demand(policy, bool((found >= least).all()), f"no level is below {least:g}{where}")
    if any(one.name == "tail" and one.init for one in fields(cast(Any, policy))):
        strict = replace(cast(Any, policy), tail=0.5 * policy.tail)
        higher = strict.levels(region, steps, obstacles, dimension)
        _demand(policy, bool((higher >= found).all()), f"half the tail, no lower level{where}")


def _constant(levels: Array) -> bool:
    return bool((levels == levels.flat[0]).all()) if levels.size else True


def _demand(policy: LevelPolicy, holds: bool, law: str) -> None:
    if not holds:
        raise AssertionError(f"{policy!r} breaks a law: {law}")
