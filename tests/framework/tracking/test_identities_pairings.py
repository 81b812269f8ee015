"""Which person a report is of: the edge of the reach, and all pairings by brute force."""

from itertools import permutations

import numpy as np
import pytest

from wideberth.framework.tracking.identities import Identities, _People
from wideberth.tests.framework.tracking.test_identities import idents
from wideberth_perception.tracking.motion import carried, corrected


@pytest.mark.parametrize("deviation", [0.01, 0.1])
@pytest.mark.parametrize(
    ("dt", "grown"), [(0.05, 0.15), (0.3, 0.9), (0.4, 1.2), (0.7, 1.2), (1.0, 1.2)]
)
def test_the_reach_grows_by_3_m_a_second_up_to_0_4_s(
    dt: float, grown: float, deviation: float
) -> None:
    """From where a person is expected, 6 deviations beside what the velocity may have changed."""
    velocity = np.array([[0.5, -1.0]])
    reach = grown + 6.0 * deviation
    for share, name in ((0.999, "1"), (1.001, "2")):
        people = Identities(deviation)
        assert idents(people, 5.0, [[1.0, 2.0]], velocity) == ["1"]
        place = np.array([[1.0, 2.0]]) + dt * velocity + share * reach * np.array([0.6, 0.8])
        assert idents(people, 5.0 + dt, place, velocity) == [name]


def test_reports_are_those_of_the_likeliest_people() -> None:
    """Brute force over all pairings of four people, last seen at several times, and fewer reports.

    The variance S of a gap after t s is twice that of a report and 0.5 t^3 / 3 m^2; minus twice
    the log likelihood is gap^2 / S + 2 ln S, with gaps cut at the reach.
    """
    rng, deviation, differing = np.random.default_rng(0), 0.1, 0
    for case in range(120):
        people, count = Identities(deviation), 1 + case % 4
        place, velocity = rng.uniform(0.0, 1.5, (2, 4, 2))
        after = rng.uniform(0.05, 0.9, 4)
        spread = np.tile([deviation**2, 0.0, 0.0], (4, 1))
        people._people = _People(np.arange(1, 5), 7.0 - after, place, velocity, spread)
        people._now, people._born = 6.95, 4
        reports, moving = rng.uniform(0.0, 2.5, (count, 2)), rng.uniform(0.0, 1.5, (count, 2))
        mean = 0.5 * (velocity[:, None] + moving)
        gap = np.linalg.norm(reports - place[:, None] - after[:, None, None] * mean, axis=2)
        reach = 3.0 * np.minimum(after, 0.4) + 6.0 * deviation
        variance = 2.0 * deviation**2 + 0.5 * after**3 / 3.0
        cost = np.minimum(gap, reach[:, None]) ** 2 / variance[:, None]
        cost += 2.0 * np.log(variance)[:, None]
        pairings = [list(rows) for rows in permutations(range(4), count)]
        best = min(pairings, key=lambda rows: float(cost[rows, range(count)].sum()))
        near = [bool(gap[row, k] < reach[row]) for k, row in enumerate(best)]
        unknown = [k for k in range(count) if not near[k]]
        in_order = sorted(unknown, key=lambda k: (reports[k, 1], reports[k, 0]))
        names = [
            str(row + 1) if near[k] else str(5 + in_order.index(k)) for k, row in enumerate(best)
        ]
        differing += best != gap.argmin(axis=0).tolist()
        assert idents(people, 7.0, reports, moving) == names
    assert differing > 30


def test_people_have_a_radius_of_0_4_m_unless_stated() -> None:
    assert [one.radius for one in Identities().named(0.0, [[1.0, 0.0], [3.0, 0.0]])] == [0.4, 0.4]


def test_what_is_known_of_a_person_is_that_of_a_kalman_filter() -> None:
    """Without velocities by the trackers' filter; a reported one is taken as it is."""
    rng, deviation, time = np.random.default_rng(1), 0.1, 3.0
    people, place = Identities(deviation), np.array([2.0, 1.0])
    people.named(time, place[None])
    state, spread = np.array([*place, 0.0, 0.0]), np.diag([0.01, 0.01, 1.0, 1.0])
    for _ in range(6):
        dt = float(rng.uniform(0.05, 0.3))
        time, place = time + dt, place + dt * np.array([0.7, -0.2]) + 0.05 * rng.normal(size=2)
        assert idents(people, time, place[None]) == ["1"]
        state, spread = corrected(*carried(state, spread, dt, 0.5), place, 0.01 * np.eye(2))
        filtered = people._people
        np.testing.assert_allclose([*filtered.place[0], *filtered.velocity[0]], state, atol=1e-9)
        wanted = spread[0, 0], spread[0, 2], spread[2, 2]
        np.testing.assert_allclose(filtered.spread[0], wanted, rtol=1e-9)
    people.named(time + 0.1, place[None], [[0.3, 0.4]])
    np.testing.assert_allclose(people._people.spread, [[0.01, 0.0, 0.0]], atol=1e-15)
    np.testing.assert_array_equal(people._people.velocity, [[0.3, 0.4]])


@pytest.mark.parametrize(("absent", "name"), [(0.99, "1"), (1.01, "2")])
def test_people_are_remembered_for_a_second(absent: float, name: str) -> None:
    people = Identities()
    assert idents(people, 2.0, [[1.0, 0.0]], [[0.0, 0.0]]) == ["1"]
    assert idents(people, 2.0 + absent, [[1.0, 0.0]], [[0.0, 0.0]]) == [name]
