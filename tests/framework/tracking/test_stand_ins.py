"""Every number of a detection that is of no use, and what stands in for it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.tracking.history import admitted
from wideberth.framework.tracking.stand_ins import LARGEST, OLDEST, RADIUS, LastGood, sound
from wideberth.framework.values.motion import Detection, Observation

GOOD = Detection("a", [3.0, 0.5], 0.01 * np.eye(2), 0.3)
TRACKED = replace(GOOD, velocity=[1.0, 0.0], state_covariance=0.1 * np.eye(4))
KNOWN = {"a": LastGood(0.4, 0.02 * np.eye(2))}


def seen(*detections: Detection) -> Observation:
    return Observation(5.0, np.zeros(5), detections)


def same(first: Detection, second: Detection) -> bool:
    pairs = [(vars(first)[name], vars(second)[name]) for name in vars(first)]
    return all(
        np.array_equal(one, other) if isinstance(one, np.ndarray) else one == other
        for one, other in pairs
    )


@pytest.mark.parametrize("good", [GOOD, TRACKED, replace(GOOD, covariance=None, age=2.0)])
def test_a_good_detection_is_returned_as_it_is(good: Detection) -> None:
    kept, notes, placeless = sound(seen(good), 2, KNOWN, np.zeros(2))
    assert kept == (good,) and kept[0] is good and not notes and not placeless


NO_COVARIANCE = {
    "negative": -np.eye(2),
    "nan": np.full((2, 2), np.nan),
    "infinite": np.diag([np.inf, 1.0]),
    "asymmetric": np.array([[1.0, 0.5], [0.0, 1.0]]),
    "indefinite": np.array([[1.0, 2.0], [2.0, 1.0]]),
}
CASES: list[tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = [
    *(({"radius": one}, {"radius": RADIUS}, {"radius": 0.4})
      for one in (-0.3, np.nan, np.inf, -np.inf, 1e12)),
    *(({"covariance": one}, {"covariance": None}, {"covariance": KNOWN["a"].covariance})
      for one in NO_COVARIANCE.values()),
    *(({"age": one}, {"age": 0.0}, {"age": 0.0}) for one in (-0.02, -OLDEST)),
]  # fmt: skip


@pytest.mark.parametrize(("bad", "instead", "remembered"), CASES)
def test_the_last_good_number_or_a_cautious_one_stands_in(
    bad: dict[str, Any], instead: dict[str, Any], remembered: dict[str, Any]
) -> None:
    one = replace(GOOD, **bad)
    for known, wanted in ((None, instead), (KNOWN, remembered)):
        kept, notes, placeless = sound(seen(one), 2, known)
        assert len(kept) == 1 and same(kept[0], replace(GOOD, **wanted)) and not placeless
        assert len(notes) == 1 and notes[0].startswith("detection 'a' taken in part: ")
        assert next(iter(bad)) in notes[0]


@pytest.mark.parametrize(
    "bad",
    [
        {"velocity": [np.nan, 0.0]},
        {"velocity": [1e12, 0.0]},
        {"state_covariance": -np.eye(4)},
        {"state_covariance": np.full((4, 4), np.inf)},
        {"state_covariance": 1e30 * np.eye(4)},
    ],
)
def test_a_motion_that_is_none_leaves_the_position(bad: dict[str, Any]) -> None:
    kept, notes, _ = sound(seen(replace(TRACKED, **bad)), 2)
    assert len(kept) == 1 and same(kept[0], GOOD) and "its velocity is left out" in notes[0]


def test_several_numbers_of_one_detection_have_stand_ins_of_their_own() -> None:
    bad = Detection("a", [3.0, 0.5], -np.eye(2), -1.0, -1.0)
    (kept,), (note,), _ = sound(seen(bad), 2)
    assert same(kept, Detection("a", [3.0, 0.5], None, RADIUS))
    assert all(word in note for word in ("radius is -1", "age is -1", "eigenvalue"))


@pytest.mark.parametrize("place", [[np.nan, 0.0], [0.0, np.inf], [1e200, 0.0], [2.0]])
def test_who_has_no_place_is_known_from_before_or_may_be_anywhere(place: list[float]) -> None:
    lost = Detection("a", place, None, 0.3)
    assert sound(seen(lost), 2).placeless == ("a",)
    kept, (note,), placeless = sound(seen(lost), 2, KNOWN)
    assert not kept and not placeless and "its last measurement stands in" in note
    # the one that is seen well is the one that is known; the other is somebody else
    kept, _, placeless = sound(seen(lost, GOOD), 2, KNOWN)
    assert kept == (GOOD,) and placeless == ("a",)
    assert sound(seen(lost, lost), 2, KNOWN).placeless == ("a",)


def test_a_detection_of_another_dimension_stands_where_it_is_seen() -> None:
    joint = np.diag([0.1, 0.2, 0.3])
    high = Detection("a", [1.0, 2.0, 3.0], joint, 0.3)
    (kept,), (note,), _ = sound(seen(high), 2)
    assert same(kept, Detection("a", [1.0, 2.0], joint[:2, :2], 0.3)) and "3 coordinates" in note
    (kept,), _, _ = sound(seen(replace(high, position=[1.0, 2.0, np.nan])), 2)
    assert kept.position.tolist() == [1.0, 2.0]
    (kept,), (note,), _ = sound(seen(GOOD), 3, here=np.array([9.0, 9.0, 7.0]))
    assert kept.position.tolist() == [3.0, 0.5, 7.0] and "own height" in note
    assert sound(seen(GOOD), 3).placeless == ("a",)
    assert sound(seen(GOOD), 3, here=np.full(3, np.nan)).placeless == ("a",)


@pytest.mark.parametrize("age", [np.nan, np.inf, -np.inf, 1.01 * OLDEST, 1.7e9, -1.7e9])
def test_a_detection_of_another_clock_has_no_place(age: float) -> None:
    """When the obstacle was there is not known: its place is not taken as that of now."""
    other = replace(GOOD, age=age)
    kept, (note,), placeless = sound(seen(other), 2)
    assert not kept and placeless == ("a",)
    assert f"age is {age:g} s" in note and "it may be anywhere" in note
    kept, (note,), placeless = sound(seen(other), 2, KNOWN)
    assert not kept and not placeless and "its last measurement stands in" in note


@pytest.mark.parametrize("radius", [40.0, 1e3])
def test_a_radius_in_centimetres_is_kept_and_noted(radius: float) -> None:
    (kept,), (note,), _ = sound(seen(replace(GOOD, radius=radius)), 2)
    assert kept.radius == radius and f"has a radius of {radius:g} m" in note
    assert not sound(seen(replace(GOOD, radius=LARGEST)), 2).notes


def test_reports_of_the_past_are_forgotten() -> None:
    for age, count in ((4.9, 1), (5.1, 0), (OLDEST, 0)):
        kept, _, placeless = admitted(seen(replace(GOOD, age=age)), 2, 5.0, None)
        assert len(kept) == count and not placeless
    kept, notes, _ = admitted(seen(replace(GOOD, age=90.0)), 2, 100.0, None)
    assert kept[0].age == 90.0 and not notes


def test_an_identity_that_is_seen_twice_is_named() -> None:
    kept, notes, _ = admitted(seen(GOOD, replace(GOOD, position=[9.0, 0.0])), 2, 5.0, None)
    assert len(kept) == 2
    assert notes == ["detection 'a' comes 2 times: each is an obstacle of its own"]
