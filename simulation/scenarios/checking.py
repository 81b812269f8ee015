"""The laws of `Scenario` as a check that any scenario can run on itself."""

from collections.abc import Callable, Iterable
from functools import cache
from itertools import combinations, product
from typing import Any

import numpy as np

from ...framework.plugins.config import describe
from ...framework.testing.laws import Contract, Law, each
from ...framework.values.arrays import Array
from ..engine.agents import Bystander, CrowdMember, ReplayAgent, RobotAgent
from .base import Cast, Placement, Scenario
from .placing import wall_distance

CLOSE = 1e-9
"""m by which bodies may overlap in rounding."""


@Contract
def check_scenario(
    scenario: Scenario,
    seeds: Iterable[int] = range(8),
    *,
    robot_radius: float | None = None,
    varied: bool = True,
) -> tuple[Law, ...]:
    """Check every law of `wideberth.simulation.scenarios.base.Scenario`.

    The same seed gives the same cast, and the same generator state the same parts of it; other
    seeds give other situations. Everything is finite, names are unique, all move in the
    same number of dimensions, phases lie in [0, 1), reference speeds are known. At time 0 no
    agent overlaps another one or a polygon, and no robot's goal lies in a polygon. Only bystanders
    may overlap each other, as recordings and random processes do, and a `ReplayAgent` may be in a
    polygon: it moves as it did, and nothing stops it.

    Parameters
    ----------
    scenario : to be checked.
    seeds : whose casts are drawn.
    robot_radius : m, of the robots; the scenario's field of that name by default.
    varied : whether seeds differ; False for one whose fields fix everything.

    Raises
    ------
    AssertionError : names every law that does not hold, and the seed.
    """
    radius = scenario.robot_radius if robot_radius is None else robot_radius
    numbers = tuple(seeds)

    @cache
    def casts() -> dict[int, Cast]:
        return {seed: scenario.cast(seed) for seed in numbers}

    def law(name: str, check: Callable[[Cast, int], None]) -> Law:
        return Law(name, each(lambda one: check(one[1], one[0]), lambda: casts().items()))

    def check_same(cast: Cast, seed: int) -> None:
        again = fingerprint(scenario.cast(seed))
        assert fingerprint(cast) == again, f"seed {seed} gives two casts"

    def check_varied() -> None:
        seen = {repr(fingerprint(cast)) for cast in casts().values()}
        assert len(seen) > 1, (
            "all seeds give the same situation; where the fields fix everything, check with "
            "varied=False"
        )

    alike = "its fields fix everything" if not varied else ""
    return (
        law("same seed, same cast", check_same),
        Law("parts depend on their generator alone",
            each(lambda seed: _check_parts(scenario, seed), lambda: numbers)),
        law("names, speeds and phases", _check_values),
        law("no overlap at time 0", lambda cast, seed: _check_room(cast, radius, seed)),
        Law("other seeds, other situations", check_varied,
            alike or ("" if len(numbers) > 1 else "one seed alone")),
    )  # fmt: skip


def fingerprint(cast: Cast) -> list[Any]:
    """Return all that a cast says, to the last digit, as something to compare."""

    def who(person: RobotAgent) -> tuple[dict[str, Any], dict[str, Any]]:
        return describe(person.robot), describe(person.controller)

    def placed(one: Placement | RobotAgent) -> tuple[Any, ...]:
        points = one.path.points.tolist()
        return one.name, points, one.speed, one.phase, one.visible, one.reference_speed

    return [
        [placed(one) for one in cast.placements],
        [(*placed(one), one.truth, one.respawn, who(one)) for one in cast.people],
        [_moving(one) for one in cast.bystanders],
        list(cast.polygons),
        cast.rules,
    ]


def _moving(one: Bystander) -> tuple[Any, ...]:
    if isinstance(one, ReplayAgent):
        return one.name, one.radius, one.times.tolist(), repr(one.positions.tolist())
    if isinstance(one, CrowdMember):
        return one.name, one.radius
    return one.name, one.radius, one.path.points.tolist(), one.speed, one.start


def _check_parts(scenario: Scenario, seed: int) -> None:
    """Every part from the same state of its generator twice."""
    first, second = (_parts(scenario, seed) for _ in range(2))
    assert first == second, f"seed {seed}: a part hangs on more than its generator"


def _parts(scenario: Scenario, seed: int) -> list[Any]:
    def rng() -> np.random.Generator:
        return np.random.default_rng([seed, 1])

    robots = scenario.build(rng())
    others = scenario.bystanders(rng(), robots)
    return fingerprint(
        Cast(robots, scenario.people(rng(), robots), others, scenario.polygons(rng()))
    )


def _check_values(cast: Cast, seed: int) -> None:
    assert cast.placements, f"seed {seed} has no robot"
    names = [one.name for one in (*cast.placements, *cast.people, *cast.bystanders)]
    names += [one.name for one in cast.polygons if one.name]
    repeated = sorted({name for name in names if names.count(name) > 1})
    assert not repeated, f"seed {seed}: {repeated} is the name of several"
    sizes = {one.path.points.shape[1] for one in cast.placements}
    sizes |= {one.path.points.shape[1] for one in cast.people}
    sizes |= {len(_place(one)) for one in cast.bystanders}
    assert len(sizes) == 1, f"seed {seed}: they move in {sorted(sizes)} dimensions"
    for placement in cast.placements:
        assert 0.0 <= placement.phase < 1.0, f"seed {seed}: phase {placement.phase}"
        assert 0.0 <= placement.speed < np.inf, f"seed {seed}: speed {placement.speed}"
        known = placement.speed if placement.reference_speed is None else placement.reference_speed
        assert 0.0 < known < np.inf, (
            f"seed {seed}: {placement.name} stands at time 0 and has no reference_speed"
        )
    held = [id(one.controller) for one in cast.people]
    assert len(set(held)) == len(held), f"seed {seed}: two people share one controller"


def _check_room(cast: Cast, radius: float, seed: int) -> None:
    """Check that no agents overlap at time 0 in the plane, and that robots fit at their goals."""
    if _dimension(cast) != 2:
        return
    deciding = [
        *((p.name, p.path.points[0], radius) for p in cast.placements),
        *((p.name, p.path.points[0], p.radius) for p in cast.people),
    ]
    present = [b for b in cast.bystanders if np.isfinite(_place(b)).all()]  # the rest come later
    others = [(b.name, _place(b), b.radius) for b in present]
    stopped = [(b.name, _place(b), b.radius) for b in present if not isinstance(b, ReplayAgent)]
    pairs = [*combinations(deciding, 2), *product(deciding, others)]
    for (one, here, size), (other, there, more) in pairs:
        gap = float(np.hypot(*(here - there))) - size - more
        assert gap >= -CLOSE, f"seed {seed}: {one} and {other} overlap by {-gap:.3g} m at time 0"
    for name, place, size in deciding + stopped:
        gap = wall_distance(place, cast.polygons) - size
        assert gap >= -CLOSE, f"seed {seed}: {name} is {-gap:.3g} m deep in a polygon at time 0"
    for placement in cast.placements:
        gap = wall_distance(placement.path.goal, cast.polygons) - radius
        assert gap >= -CLOSE, f"seed {seed}: the goal of {placement.name} is in a polygon"


def _place(one: Bystander) -> Array:
    return np.asarray(one.at(np.zeros(1))[0])


def _dimension(cast: Cast) -> int:
    return int(cast.placements[0].path.points.shape[1])
