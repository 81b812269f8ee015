"""Identities of people without names: against the names that our own crowds know."""

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import ArrayLike

from wideberth import Observation, WideberthError, recommended
from wideberth.framework.tracking.identities import DENSITY, MEMORY, Identities, _People
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.path import Path
from wideberth.people.models import CircularForce, Company, PersonModel, Reciprocal, Walkers
from wideberth_perception.tracking.motion import carried, corrected

EXACT = 0.01
"""m, the deviation that is stated for places without noise."""


def crowd(
    rng: np.random.Generator, count: int, model: PersonModel, dt: float, seconds: float
) -> Iterator[tuple[float, Array, Array]]:
    """Walk people to one goal after another in a square of 12 m; time, places and velocities."""
    place, goal = rng.uniform(0.0, 12.0, (2, count, 2))
    velocity, radius = np.zeros((count, 2)), np.full(count, 0.3)
    speed, walls = rng.uniform(0.6, 1.6, count), np.zeros((count, 0, 3))
    seen = ~np.eye(count, dtype=np.bool_)
    for step in range(round(seconds / dt)):
        way = goal - place
        away = np.hypot(*way.T)
        goal = np.where((away < 0.5)[:, None], rng.uniform(0.0, 12.0, (count, 2)), goal)
        wanted = way / np.maximum(away, 1e-9)[:, None] * speed[:, None]
        company = Company(place, velocity, radius, seen, walls)
        velocity = model.next_velocity(Walkers(place, velocity, wanted, radius), company, dt)
        place = place + dt * velocity
        yield step * dt, place, velocity


def switches(
    seed: int, count: int, model: PersonModel, dt: float,
    *, moving: bool, noise: float = 0.0, absent: float = 0.0,
) -> tuple[int, int]:  # fmt: skip
    """Count how often a person gets another name within 30 s, and all names."""
    rng = np.random.default_rng(seed)
    people, changes = Identities(max(noise, EXACT)), 0
    last: dict[int, str] = {}
    names: set[str] = set()
    for time, place, velocity in crowd(rng, count, model, dt, 30.0):
        order = rng.permutation(count)
        order = order[rng.random(count) >= absent]
        seen = place[order] + noise * rng.standard_normal((len(order), 2))
        found = people.named(time, seen, velocity[order] if moving else None)
        for person, one in zip(order.tolist(), found, strict=True):
            changes += last.get(person, one.ident) != one.ident
            last[person] = one.ident
            names.add(one.ident)
    return changes, len(names)


@pytest.mark.parametrize("moving", [True, False])
@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("model", [CircularForce(), Reciprocal()])
def test_people_in_a_crowd_keep_their_names_at_10_hz(
    model: PersonModel, noise: float, moving: bool
) -> None:
    for seed, count in enumerate((20, 40, 60)):
        assert switches(seed, count, model, 0.1, moving=moving, noise=noise) == (0, count)


@pytest.mark.parametrize("moving", [True, False])
def test_people_in_a_crowd_keep_their_names_at_4_hz(moving: bool) -> None:
    for seed, count in enumerate((20, 40, 60)):
        assert switches(seed, count, Reciprocal(), 0.25, moving=moving) == (0, count)


@pytest.mark.parametrize("model", [CircularForce(), Reciprocal()])
def test_names_outlast_absences(model: PersonModel) -> None:
    assert switches(1, 40, model, 0.1, moving=True, absent=0.1) == (0, 40)
    changes, names = switches(1, 40, Reciprocal(), 0.25, moving=True, absent=0.1)
    assert changes <= 2 and names <= 41  # of 4300 reports: some were absent for a second


def idents(
    people: Identities, time: float, places: ArrayLike, velocities: ArrayLike | None = None
) -> list[str]:
    return [one.ident for one in people.named(time, places, velocities)]


@pytest.mark.parametrize("dt", [0.1, 0.25])
@pytest.mark.parametrize("moving", [True, False])
def test_two_who_cross_keep_their_names(dt: float, moving: bool) -> None:
    velocity = np.array([[1.3, 0.0], [-1.3, 0.0]])
    people, mixed = Identities(), np.random.default_rng(0)
    for step in range(40):
        order = mixed.permutation(2)
        place = np.array([[-2.0, 0.0], [2.0, 0.02]]) + step * dt * velocity
        found = idents(people, step * dt, place[order], velocity[order] if moving else None)
        assert [found[i] for i in np.argsort(order)] == ["1", "2"]


def test_velocities_decide_where_two_stand_in_one_place() -> None:
    people, places = Identities(), [[-0.1, 0.0], [0.1, 0.0]]
    assert idents(people, 0.0, places, [[1.0, 0.0], [-1.0, 0.0]]) == ["1", "2"]
    assert idents(people, 0.1, np.zeros((2, 2)), [[-1.0, 0.0], [1.0, 0.0]]) == ["2", "1"]


@pytest.mark.parametrize("dt", [0.1, 0.25])
def test_who_jumps_is_another_person(dt: float) -> None:
    people, velocity = Identities(), np.array([[1.0, 0.0]])
    for step in range(5):
        assert idents(people, step * dt, step * dt * velocity, velocity) == ["1"]
    assert idents(people, 5 * dt, [[4.0, 0.0]], velocity) == ["2"]


def test_who_is_absent_for_long_is_another_person() -> None:
    for gap, name in ((0.8 * MEMORY, "1"), (1.2 * MEMORY, "2")):
        people, velocity = Identities(), np.array([[1.0, 0.0]])
        assert idents(people, 0.0, [[0.0, 0.0]], velocity) == ["1"]
        assert idents(people, 0.1, []) == []
        assert idents(people, gap, gap * velocity, velocity) == [name]


def test_names_do_not_depend_on_the_order_of_reports() -> None:
    rng = np.random.default_rng(0)
    one, other = Identities(), Identities()
    for time, place, velocity in crowd(rng, 30, CircularForce(), 0.1, 3.0):
        order = rng.permutation(30)
        first = idents(one, time, place, velocity)
        second = idents(other, time, place[order], velocity[order])
        assert [first[i] for i in order] == second


def test_detections_are_what_was_reported_with_the_stated_noise() -> None:
    places = np.array([[3.0, 1.0], [0.0, 2.0]])
    found = Identities(0.05).named(0.0, places, None, [0.3, 0.5])
    np.testing.assert_array_equal([one.position for one in found], places)
    assert [one.radius for one in found] == [0.3, 0.5]
    for one in found:
        np.testing.assert_array_equal(one.covariance, 0.05**2 * np.eye(2))
        assert not one.flaw


def test_the_filter_is_that_of_the_trackers() -> None:
    rng, deviation, time = np.random.default_rng(0), 0.1, 0.0
    people = _People.at(0.0, np.zeros((1, 2)), deviation**2)
    state, spread = np.zeros(4), np.diag([deviation**2, deviation**2, 1.0, 1.0])
    noise = deviation**2 * np.eye(2)
    for _ in range(20):
        dt, place = float(rng.uniform(0.05, 0.3)), rng.standard_normal(2)
        time += dt
        people = people.carried(time).corrected(time, place[None], deviation**2)
        state, spread = corrected(*carried(state, spread, dt, DENSITY), place, noise)
        own = np.concatenate([people.place[0], people.velocity[0]])
        np.testing.assert_allclose(own, state, rtol=1e-9, atol=1e-12)
        wanted = spread[0, 0], spread[0, 2], spread[2, 2]
        np.testing.assert_allclose(people.spread[0], wanted, rtol=1e-9)


def test_a_clock_that_goes_back_is_another_run() -> None:
    people = Identities()
    assert idents(people, 3.0, [[0.0, 0.0]]) == ["1"]
    assert idents(people, 0.0, [[0.0, 0.0]]) == ["2"]
    people.reset()
    assert idents(people, 0.1, [[0.0, 0.0]]) == ["1"]


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e300, -1e300, 1e9])
def test_nothing_that_is_measured_raises(number: float) -> None:
    people = Identities()
    assert idents(people, 0.0, [[0.0, 0.0], [5.0, 0.0]]) == ["1", "2"]
    for time in (0.1, number, 0.2):
        for places in ([[0.0, 0.0], [number, 0.0]], [], [[number, number]]):
            for velocities in (None, np.full(np.shape(places), number)):
                found = people.named(time, places, velocities, number)
                assert all(np.isfinite(one.position).all() for one in found)


def test_rows_of_padding_are_left_out() -> None:
    padding = [np.nan, np.nan]
    found = Identities().named(0.0, [[1.0, 0.0], padding], [padding, padding], [0.3, np.nan])
    assert [(one.ident, one.radius) for one in found] == [("1", 0.3)]


def test_shapes_that_do_not_fit_are_refused() -> None:
    people = Identities()
    with pytest.raises(WideberthError, match="velocities has 1 rows; wanted 2, as positions"):
        people.named(0.0, np.zeros((2, 2)), np.zeros((1, 2)))
    with pytest.raises(WideberthError, match=r"radius has shape \(1,\); wanted \(2,\)"):
        people.named(0.0, np.zeros((2, 2)), None, [0.3])
    with pytest.raises(WideberthError, match=r"positions has shape \(2, 4\)"):
        people.named(0.0, np.zeros((2, 4)))
    with pytest.raises(WideberthError, match=r"identities\.deviation is 0"):
        Identities(deviation=0.0)


def test_a_planner_remembers_people_by_these_names() -> None:
    planner = recommended("holonomic_velocity", speed=1.0, quiet=True)
    planner.set_path(Path(np.array([[0.0, 0.0], [8.0, 0.0]])))
    people = Identities()
    for step in range(3):
        time = 0.1 * step
        places = [[3.0 - time, 0.2], [4.0, 2.0]][:: 1 if step % 2 else -1]
        seen = people.named(time, places)
        planner.command(Observation(time, np.zeros(2), seen))
    assert planner.plan is not None
    assert {*planner.plan.tracked} == {"1", "2"}
