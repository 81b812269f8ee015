"""Warnings of controllers: at once what is new, seldom what repeats, none in an experiment."""

import logging
from collections.abc import Iterator
from typing import cast

import numpy as np
import pytest

from wideberth.controllers.pure_pursuit import PurePursuit
from wideberth.experiments.engine.base import Experiment, Task, TaskOutcome
from wideberth.experiments.engine.worker import measured
from wideberth.framework.control import rate_limited_warnings as notices
from wideberth.framework.control.rate_limited_warnings import RateLimitedWarnings, quiet
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Detection, Observation
from wideberth.predictors.core.best_response import BestResponsePlanner, Player
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.planning import STRAIGHT, Failing, at, planner

REST = np.zeros(5)


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> Iterator[Clock]:
    """Start without memory of what was said in other tests."""
    made = Clock()
    fresh = RateLimitedWarnings(clock=made)
    monkeypatch.setattr(notices.WARNINGS, "_last", fresh._last)
    monkeypatch.setattr(notices.WARNINGS, "_held", fresh._held)
    monkeypatch.setattr(notices.WARNINGS, "_clock", made)
    caplog.set_level(logging.WARNING, notices.ROOT)
    yield made


def test_the_first_is_said_at_once_and_repeats_are_counted(
    clock: Clock, caplog: pytest.LogCaptureFixture
) -> None:
    for k in range(25):
        clock.now = 0.5 * k
        notices.WARNINGS.warn("Planner", "brake", f"number {k}")
    notices.WARNINGS.warn("Planner", "gave way", "asked much")
    notices.WARNINGS.warn("PurePursuit", "brake", "another class")
    notices.WARNINGS.warn("Planner", "solved", "solved by fatrop")
    assert caplog.messages == [
        "brake: number 0",
        "brake: number 20 (and 19 times since the last warning of this kind)",
        "gave way: asked much",
        "brake: another class",
        "solved by fatrop",
    ]
    assert {one.name for one in caplog.records} == {
        "wideberth.controllers.Planner", "wideberth.controllers.PurePursuit",
    }  # fmt: skip


def test_a_planner_that_gives_way_brakes_or_refuses_says_so(
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = planner(level=Paper(), solver=Failing(good=1))
    made.command(at(0.0, 0.0, ("ahead", 5.5, 0.3)))
    made.command(at(0.5, 0.25, ("ahead", 2.1, 0.0)))
    assert made.plan is not None
    gave_way, brakes = caplog.messages
    assert gave_way.startswith("gave way: asked 95 %, holds ")
    assert brakes == f"{made.plan.rung}: {made.plan.reason}"
    caplog.clear()
    ghost = Detection("ghost", np.array([np.nan, 0.0]), np.eye(2), 0.3)
    made.command(Observation(1.0, at(0.0, 0.5).state, (ghost,)))
    assert any(one.startswith("detection 'ghost' refused: ") for one in caplog.messages)


@pytest.mark.parametrize("rival", [False, True])
def test_refused_detections_are_limited_however_many_there_are(
    rival: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """Their number changes from call to call; that makes them no other kind of warning."""
    made = PurePursuit(Unicycle()) if rival else planner()
    made.set_path(STRAIGHT)
    for k in range(6):
        ghosts = [Detection(f"g{i}", [40.0, 20.0], np.eye(2), np.nan) for i in range(7 + k)]
        made.command(Observation(0.5 * k, at(0.5 * k, 0.25 * k).state, tuple(ghosts)))
    assert len(caplog.messages) == (1 if rival else 2)


def test_a_planner_with_nothing_to_say_is_silent_and_so_is_its_warm_up(
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = planner()
    made.command(at(0.0, 0.0, ("far", 40.0, 20.0)))
    made.command(at(0.5, 0.25, ("far", 40.0, 20.0)))
    planner(solver=Failing(good=0))
    assert caplog.messages == []


def test_what_others_might_do_is_nothing_to_warn_of(caplog: pytest.LogCaptureFixture) -> None:
    model = BestResponsePlanner(planner(level=Paper(), horizon=5))
    state = at(0.0, 0.0).state
    one = Player(state, np.array([1.0, 0.0]), 0.5, 0.75)
    ahead = Forecast.single(
        np.full((1, 20, 2), (2.0, 0.1)), np.tile(0.04 * np.eye(2), (1, 20, 1, 1)), 0.5
    )
    assert not isinstance(model.respond(one, ahead, [0.75]), str)
    assert caplog.messages == []


def test_rivals_say_so_too(
    caplog: pytest.LogCaptureFixture,
) -> None:
    made = PurePursuit(Unicycle())
    made.set_path(STRAIGHT)
    ghost = Detection("ghost", np.zeros(2), -np.eye(2), 0.3)
    made.command(Observation(0.0, REST, (ghost,)))
    made.command(Observation(0.5, REST * np.nan))
    refused, stands = caplog.messages
    assert refused.startswith("detection 'ghost' taken in part: ")
    assert stands == f"stands still: {made.reason}"
    assert {one.name for one in caplog.records} == {"wideberth.controllers.PurePursuit"}


def test_a_handler_that_fails_stops_nothing(caplog: pytest.LogCaptureFixture) -> None:
    def fails(record: logging.LogRecord) -> bool:
        raise RuntimeError("disk full")

    logger = logging.getLogger(f"{notices.ROOT}.Planner")
    logger.addFilter(fails)
    try:
        notices.WARNINGS.warn("Planner", "brake", "anything")
    finally:
        logger.removeFilter(fails)


class Braking:
    """One task that makes a controller warn."""

    def measure(self, task: Task) -> TaskOutcome:
        notices.WARNINGS.warn("Planner", "brake", "in an experiment")
        return TaskOutcome(rows=[{"seed": task.seed}])


def test_an_experiment_warns_of_nothing_and_then_all_is_as_before(
    caplog: pytest.LogCaptureFixture,
) -> None:
    measured(cast(Experiment, Braking()), Task("one", 0, {}))
    assert caplog.messages == []
    notices.WARNINGS.warn("Planner", "brake", "after it")
    assert caplog.messages == ["brake: after it"]
    with quiet():
        notices.WARNINGS.warn("Planner", "shift", "quiet")
    assert len(caplog.messages) == 1
