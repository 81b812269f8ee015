"""Every promise is stated: the event, the probability, what it assumes, and where it is shown."""

import pytest

from wideberth.experiments.engine.provenance import bibliography
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.values.coverage import Coverage, Event
from wideberth.framework.values.errors import WideberthError

STATED = {
    ("levels", "fixed"): Event.STEP,
    ("levels", "relaxed"): Event.STEP,
    ("levels", "paper"): Event.STEP,
    ("levels", "discounted"): Event.STEP,
    ("levels", "risk_allocation"): Event.PLAN,
    ("slot_kinds", "drawn_futures"): Event.PLAN,
    ("predictors", "conformal"): Event.STEP,
    ("predictors", "adaptive_conformal"): Event.LONG_RUN,
    ("predictors", "functional_constant"): Event.FIELD,
    ("calibrations", "per_step"): Event.STEP,
    ("calibrations", "boole"): Event.PLAN,
    ("calibrations", "joint_person"): Event.PERSON,
    ("calibrations", "joint_plan"): Event.PLAN,
    ("calibrations", "sample_and_discard"): Event.PLAN,
    ("calibrations", "task"): Event.TASK,
}


@pytest.mark.parametrize(("room", "name"), STATED)
def test_a_rung_states_its_event(room: str, name: str) -> None:
    assert build(room, name).coverage.event is STATED[room, name]


def test_every_source_of_a_promise_has_an_entry() -> None:
    known = bibliography()
    rooms = ("levels", "predictors", "calibrations")
    found = [build(room, name).coverage for room in rooms for name in names(room)]
    found += [load("slot_kinds", name).coverage for name in names("slot_kinds")]
    assert {one.source for one in found if one} <= set(known)


@pytest.mark.parametrize("name", names("levels"))
def test_every_level_says_what_it_promises(name: str) -> None:
    assert isinstance(load("levels", name).coverage, Coverage)


def test_a_promise_without_words_is_refused() -> None:
    for fields in (("", "b", "c"), ("a", " ", "c"), ("a", "b", "")):
        with pytest.raises(WideberthError, match=r"coverage\.\w+ is empty"):
            Coverage(Event.STEP, *fields)
