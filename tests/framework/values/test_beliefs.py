"""Where a filter goes on, and where it begins again, in logs that change in any way."""

from collections.abc import Sequence

import numpy as np
import pytest

from wideberth.framework.values.beliefs import Beliefs
from wideberth.framework.values.measurements import NO_LOG, Measurements

SHAPES = ((3,), (2, 2))


def sighted(*logs: tuple[int, Sequence[float]]) -> Measurements:
    """Return sightings with measurements at these times, by number of the log."""
    times = [list(times) for _, times in logs]
    positions = [np.zeros((len(one), 2)) for one in times]
    noise = [np.zeros((len(one), 2, 2)) for one in times]
    return Measurements(times, positions, noise, [number for number, _ in logs])


def beliefs_of(*logs: tuple[int, float, int]) -> Beliefs:
    """Return beliefs by number of the log, newest time and count; values tell them apart."""
    count = len(logs)
    first = np.arange(3.0 * count).reshape(3, count)
    second = 100.0 + np.arange(4.0 * count).reshape(2, 2, count)
    newest, number = np.array([one[1] for one in logs]), np.array([one[2] for one in logs])
    return Beliefs(tuple(one[0] for one in logs), newest, number, (first, second))


@pytest.mark.parametrize(
    ("log", "times", "row", "first"),
    [
        (8, [1.0, 2.0, 3.0], 1, 3),  # nothing new
        (8, [1.0, 2.0, 3.0, 4.0], 1, 3),  # one measurement more
        (8, [3.0, 3.5, 4.0, 9.0], 1, 1),  # updates were missed, old measurements are forgotten
        (8, [3.0], 1, 1),  # all but the newest one are forgotten
        (8, [3.5, 4.0], -1, 0),  # the newest one that was used is forgotten too
        (8, [1.0, 2.0], -1, 0),  # the clock went back
        (8, [1.0, 2.0, 3.0 + 1e-9], -1, 0),  # the newest one was another
        (8, [], -1, 0),  # no measurement at all
        (9, [1.0, 2.0, 3.0], -1, 0),  # a name used again: another log
        (NO_LOG, [1.0, 2.0, 3.0], -1, 0),  # nobody counted
    ],
)
def test_a_belief_counts_where_its_newest_measurement_is_in_its_log(
    log: int, times: list[float], row: int, first: int
) -> None:
    """Whatever other logs are there, in any order."""
    beliefs = beliefs_of((5, 2.0, 2), (8, 3.0, 3), (NO_LOG, 3.0, 3))
    for others in ((), ((5, [1.0, 2.0]),), ((5, [2.0, 2.5]), (11, [3.0]))):
        rows, used = beliefs.continued(sighted(*others, (log, times)))
        assert list(rows)[-1] == row and list(used)[-1] == first
        assert list(rows)[: len(others)] == [0, -1][: len(others)]


def test_none_and_nobody() -> None:
    nobody = Beliefs.none()
    assert len(nobody) == 0
    rows, first = nobody.continued(sighted((1, [0.0])))
    assert list(rows) == [-1] and list(first) == [0]
    rows, first = beliefs_of((1, 0.0, 1)).continued(sighted())
    assert len(rows) == len(first) == 0
    first, newest, count, values = nobody.resumed(sighted(), SHAPES)
    assert len(first) == len(newest) == len(count) == 0
    assert [part.shape for part in values] == [(3, 0), (2, 2, 0)]


def test_a_filter_resumes_with_the_rows_of_those_who_are_still_there() -> None:
    beliefs = beliefs_of((5, 2.0, 2), (8, 3.0, 3), (6, 1.0, 1))
    sightings = sighted((6, [1.0, 4.0]), (7, [4.0]), (5, [0.0, 1.0, 2.0]), (8, [4.0]))
    first, newest, count, values = beliefs.resumed(sightings, SHAPES)
    assert list(first) == [1, 0, 3, 0] and list(count) == [1, 0, 2, 0]
    np.testing.assert_array_equal(newest, [1.0, -np.inf, 2.0, -np.inf])
    for part, old in zip(values, beliefs.values, strict=True):
        np.testing.assert_array_equal(part[..., [0, 2]], old[..., [2, 0]])
        assert not part[..., [1, 3]].any()


def test_what_is_resumed_may_be_changed_but_where_nothing_is_new() -> None:
    """Then the values are those of the beliefs, so that a filter can return these."""
    beliefs = beliefs_of((5, 2.0, 2), (8, 3.0, 3))
    same = beliefs.resumed(sighted((5, [1.0, 2.0]), (8, [2.0, 3.0])), SHAPES)
    assert same[3] is beliefs.values
    kept = [part.copy() for part in (beliefs.newest, beliefs.count, *beliefs.values)]
    for sightings in (
        sighted((5, [1.0, 2.0, 3.0]), (8, [2.0, 3.0])),
        sighted((8, [2.0, 3.0]), (5, [1.0, 2.0])),
        sighted((5, [1.0, 2.0])),
    ):
        _, newest, count, values = beliefs.resumed(sightings, SHAPES)
        assert values is not beliefs.values
        for part in (newest, count, *values):
            part[...] = -7
        for part, old in zip((beliefs.newest, beliefs.count, *beliefs.values), kept, strict=True):
            np.testing.assert_array_equal(part, old)
