"""The planning cycle is a function: settings and state in, a new state and a decision out."""

from dataclasses import FrozenInstanceError, fields

import numpy as np
import pytest

from wideberth.framework.mpc.planner.best_response import Agent, BestResponsePlanner
from wideberth.framework.mpc.planner.cycle import PlannerState, Services, remember, step
from wideberth.framework.mpc.planner.settings import PlannerSettings, changed
from wideberth.framework.plugins.config import describe
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.plan import Rung
from wideberth.predictors.adaptive_conformal import AdaptiveConformal
from wideberth.predictors.kalman import Kalman
from wideberth.tests.helpers.planning import STRAIGHT, at, planner


def seen(k: int) -> Observation:
    """Somebody comes towards the robot, which drives on."""
    return at(0.5 * k, 0.25 * k, ("other", 9.0 - 0.25 * k, 0.8))


def settings(**changes) -> PlannerSettings:
    return changed(planner(predictor=AdaptiveConformal(Kalman()), latency=0.1, **changes))


def test_the_same_state_and_observation_give_the_same_decision_and_change_nothing() -> None:
    own = settings()
    services, state = Services.of(own), PlannerState.initial(own, STRAIGHT)
    states, decisions = [state], []
    for k in range(6):
        state, decision = step(own, state, seen(k), services)
        states.append(state)
        decisions.append(decision)
    for k in (4, 0, 3):  # again, out of order, from the states as they were kept
        after, again = step(own, states[k], seen(k), services)
        assert again.command == decisions[k].command
        np.testing.assert_array_equal(again.plan.states, decisions[k].plan.states)
        kept, made = states[k + 1].perception.history, after.perception.history
        for name, log in kept.logs.items():
            np.testing.assert_array_equal(log.positions, made.logs[name].positions)
        assert after.obstacle_in_way == states[k + 1].obstacle_in_way


def test_a_planner_is_the_cycle_with_its_state() -> None:
    own = settings()
    services, state = Services.of(own), PlannerState.initial(own, STRAIGHT)
    made = planner(predictor=AdaptiveConformal(Kalman()), latency=0.1)
    for k in range(3):
        state = remember(own, state, seen(k))
        made.remember(seen(k))
    for k in range(3, 6):
        state, decision = step(own, state, seen(k), services)
        assert made.command(seen(k)) == decision.command
    assert decision.solved is not None and made.explain().key == decision.solved.check.problem.key


def test_settings_and_state_cannot_be_changed() -> None:
    made = planner()
    with pytest.raises(FrozenInstanceError):
        made.horizon = 3  # type: ignore[misc]
    with pytest.raises(FrozenInstanceError):
        PlannerState.initial(made).plan = None  # type: ignore[misc]
    shorter = changed(made, horizon=3)
    assert (made.horizon, shorter.horizon) == (15, 3)
    others = [entry.name for entry in fields(PlannerSettings) if entry.name != "horizon"]
    assert all(getattr(made, name) is getattr(shorter, name) for name in others)


def test_what_was_learnt_before_an_emergency_is_kept() -> None:
    """An observation that cannot be used stops the robot; the obstacles stay known."""
    own = settings()
    services, state = Services.of(own), PlannerState.initial(own, STRAIGHT)
    state, _ = step(own, state, seen(0), services)
    blind = Observation(0.5, np.full(5, np.nan), seen(1).detections)
    state, decision = step(own, state, blind, services)
    assert decision.plan.rung is Rung.BRAKE and decision.solved is None
    assert state.smoother is None and state.perception.stamp == 0.5
    assert len(state.perception.history.logs["other"].times) == 2


def test_without_a_path_nothing_is_planned() -> None:
    own = settings()
    with pytest.raises(WideberthError, match="no path is set"):
        step(own, PlannerState.initial(own), seen(0), Services.of(own))


def test_a_best_response_leaves_its_planner_as_it_is() -> None:
    made = planner(horizon=5)
    before = describe(made)
    model = BestResponsePlanner(made)
    one = Agent(at(0.0, 0.0).state, np.array([1.0, 0.0]), 0.3, 0.75)
    ahead = Forecast.single(
        np.full((1, 20, 2), (2.6, 0.1)), np.tile(0.04 * np.eye(2), (1, 20, 1, 1)), 0.25
    )
    first = model.respond(one, ahead, [0.75])
    alone = model.respond(one, None, ())
    second = model.respond(one, ahead, [0.75])
    assert not isinstance(first, str) and not isinstance(second, str)
    np.testing.assert_array_equal(first[1], second[1])
    assert not isinstance(alone, str) and np.abs(first[1] - alone[1]).max() > 1e-3
    assert describe(made) == before and made.plan is None
