"""Regions of every choice, and obstacles of every size to check them on."""

from dataclasses import fields
from itertools import product
from typing import Literal, get_args, get_origin, get_type_hints

import numpy as np

from wideberth.framework.region import Region
from wideberth.framework.testing.region_cases import RegionCase, turned


def draw_cases(
    region: Region, size: int, count: int, rng: np.random.Generator, *, condition: float = 1e8
) -> RegionCase:
    """Draw a batch of obstacles, margins and tails of all sizes.

    Largest deviations of 0.01 m to 10 m, margins of 0.01 m to 10 m, tails of 1e-12 to 0.9, all
    log-uniform, and conditions of the covariance up to ``condition``.
    """
    share = rng.uniform(-0.5 * np.log10(condition), 0.0, (count, size))
    share[:, 0] = 0.0
    deviations = 10.0 ** (rng.uniform(-2.0, 1.0, (count, 1)) + share)
    covariance = turned(rng, deviations)
    margin = 10.0 ** rng.uniform(-2.0, 1.0, count)
    tail = 10.0 ** rng.uniform(-12.0, np.log10(0.9), count)
    return RegionCase(region, rng.uniform(-3.0, 3.0, (count, size)), covariance, margin, tail)


def variants(kind: type[Region]) -> list[Region]:
    """Every region of a class that its choices tell apart; other fields at their defaults."""
    hints = get_type_hints(kind)
    names = [one.name for one in fields(kind) if get_origin(hints[one.name]) is Literal]  # type: ignore[arg-type]
    choices = [get_args(hints[name]) for name in names]
    return [kind(**dict(zip(names, values, strict=True))) for values in product(*choices)]
