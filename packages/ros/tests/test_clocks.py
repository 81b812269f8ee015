"""Clocks that are set, messages that come late, silence."""

import numpy as np
import pytest

from wideberth_ros.clocks import stamps

TRUE = 0.1 * np.arange(100)


@pytest.mark.parametrize("place", [3, 4, 20, 50, 95, 97])
@pytest.mark.parametrize("step", [1.2, 2.0, 60.0, 1e4])
@pytest.mark.parametrize("back", [False, True])
def test_a_clock_that_is_set_does_not_change_the_series(
    place: int, step: float, back: bool
) -> None:
    rng = np.random.default_rng(place)
    stamped = 7.0 + TRUE + np.where(np.arange(100) >= place, -step if back else step, 0.0)
    found = stamps(stamped, TRUE + rng.uniform(0.0, 0.05, 100))
    after = found.times[place:] - found.times[place - 1]
    # It is known up to the delays of the receipt.
    np.testing.assert_allclose(after, TRUE[place:] - TRUE[place - 1], atol=0.06)
    np.testing.assert_array_equal(found.times[:place], stamped[:place])
    assert len(found.notes) == 1 and "its clock was set by" in found.notes[0]


def test_late_messages_keep_their_stamps() -> None:
    received = TRUE.copy()
    received[[20, 50, 51]] += 2.0
    found = stamps(TRUE, received)
    np.testing.assert_allclose(found.times, TRUE, atol=1e-12)
    assert found.notes == ("3 messages came more than 1 s late",)


def test_silence_is_named() -> None:
    keep = (TRUE < 3.0) | (TRUE > 5.05)
    found = stamps(TRUE[keep], TRUE[keep])
    assert found.notes == ("nothing from 2.9 s to 5.1 s",)
    assert stamps(TRUE[::20], TRUE[::20]).notes == ()  # a slow topic is not silent


def test_without_stamps_the_receipt_counts() -> None:
    none = np.full(100, np.nan)
    np.testing.assert_array_equal(stamps(none, TRUE).times, TRUE)
    some = np.where(np.arange(100) % 2 == 0, TRUE + 5.0, np.nan)
    np.testing.assert_allclose(stamps(some, TRUE).times, TRUE + 5.0)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_messages_are_no_error(count: int) -> None:
    assert len(stamps(TRUE[:count], TRUE[:count]).times) == count
