"""The planning cycle is a function: settings and state in, a new state and a decision out."""

from dataclasses import FrozenInstanceError, fields
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.mpc.planner import cycle, rollout
from wideberth.framework.mpc.planner import planner as shell
from wideberth.framework.mpc.planner.cycle import PlannerState, Services, remember, step
from wideberth.framework.mpc.planner.settings import PlannerSettings, changed
from wideberth.framework.mpc.planner.starts import OTHERS
from wideberth.framework.plugins.config import describe
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import GivenWay, Rung, Status
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.adaptive_conformal import AdaptiveConformal
from wideberth.predictors.core import best_response
from wideberth.predictors.core.best_response import BestResponsePlanner, Player, state_of
from wideberth.predictors.kalman import Kalman
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers.riccati.solver import Riccati
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
    assert (
        decision.solved is not None and made.explain().key == decision.solved.instance.problem.key
    )


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
    one = Player(at(0.0, 0.0).state, np.array([1.0, 0.0]), 0.3, 0.75)
    ahead = Forecast.single(
        np.full((1, 20, 2), (2.6, 0.1)), np.tile(0.04 * np.eye(2), (1, 20, 1, 1)), 0.25
    )
    first = model.respond(one, ahead, [0.75])
    alone = model.respond(one, None, ())
    second = model.respond(one, ahead, [0.75])
    assert not isinstance(first, str) and not isinstance(second, str)
    np.testing.assert_array_equal(first[1], second[1])
    assert not isinstance(alone, str) and np.abs(first[1] - alone[1]).max() > 1e-3
    assert describe(made) == before and made.last_plan is None


@pytest.mark.parametrize("robot", [Unicycle(), Holonomic()], ids=repr)
def test_a_best_response_is_planned_in_the_agent_s_own_frame(
    robot: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The agent at the origin, its goal on the x axis, the difference of the radii with theirs."""
    asked: list[Any] = []
    made = planner(robot=robot, horizon=5, dt=0.4)

    def step(settings: Any, state: Any, observation: Any, services: Any) -> Any:
        asked.append((settings, state, observation))
        positions = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.5]])
        known = dict(dt=0.4, status=Status.SOLVED, violation=0.0, reason="no plan", iterations=0)
        known |= {"positions": positions, **answer}
        return None, SimpleNamespace(plan=SimpleNamespace(**known))

    monkeypatch.setattr(best_response, "step", step)
    model = BestResponsePlanner(made)
    assert model.steps(0.25) == 8 and model.steps(0.4) == 5 and model.steps(2.0) == 1
    place, north = np.array([1.0, 2.0]), np.array([0.0, 1.0])
    state = state_of(robot, place, 0.3 * north, np.array([1.0, 0.0]))
    one = Player(state, north, 0.3, robot.radius + 0.1)
    spread = np.diag([0.04, 0.09])
    ahead = Forecast.single(
        np.array([[[1.0, 5.0]] * 9, [[0.0, 2.0]] * 9]), np.tile(spread, (2, 9, 1, 1)), 0.25
    )
    answer: dict[str, Any] = {}
    times, places = model.respond(one, ahead, [0.5, 0.0])
    np.testing.assert_allclose(times, [0.0, 0.4, 0.8])
    np.testing.assert_allclose(places, [[1.0, 2.0], [1.0, 3.0], [0.5, 4.0]])
    ((used, begun, seen),) = asked
    assert used.reference_speed == 0.3 and used.track_dt == 0.25 and used.latency == 0.0
    assert used.deadline is None and used.starts == () and used.horizon == 5
    assert begun.progress.path.length == pytest.approx(2.0 * 0.3 * 5 * 0.4)
    np.testing.assert_allclose(
        seen.state, state_of(robot, np.zeros(2), np.array([0.3, 0.0]), north), atol=1e-12
    )
    assert [one.ident for one in seen.detections] == ["0000", "0001"]
    np.testing.assert_allclose([one.position for one in seen.detections], [[3.0, 0.0], [0.0, 1.0]])
    assert [one.radius for one in seen.detections] == pytest.approx([0.6, 0.1])
    assert not any(np.any(one.covariance) for one in seen.detections)
    names, apart = ("0000", "0001"), np.array([[[3.0, 0.0]], [[0.0, 1.0]]])
    theirs = Tracks(apart, 0.25, names, np.full(2, 0.3), np.zeros((2, 2, 2)))
    forecast = used.predictor.predict(theirs, 3)
    np.testing.assert_allclose(forecast.mean[:, 0], [[[3.0, 0.0]] * 3, [[0.0, 1.0]] * 3])
    np.testing.assert_allclose(forecast.covariance[0, 0], [np.diag([0.09, 0.04])] * 3)

    small = Player(state, north, 0.3, 0.0)
    model.respond(small, ahead, [0.0, robot.radius + 0.2])
    assert [one.radius for one in asked[-1][2].detections] == pytest.approx([0.0, 0.2])
    model.respond(one, None, ())
    assert asked[-1][2].detections == ()
    for change, fails in (
        ({"status": Status.FAILED}, True),
        ({"status": Status.FAILED, "iterations": 3}, False),
        ({"violation": float("nan")}, True),
    ):
        answer = change
        assert (model.respond(one, None, ()) == "no plan") is fails


def test_a_state_looks_where_it_moves_or_as_asked() -> None:
    robot, place = Unicycle(), np.array([1.0, 2.0])
    moving = state_of(robot, place, np.array([0.0, -0.3]), np.array([1.0, 0.0]))
    np.testing.assert_allclose(moving, [1.0, 2.0, -0.5 * np.pi, 0.3, 0.0])
    still = state_of(robot, place, np.zeros(2), np.array([-0.6, 0.8]))
    np.testing.assert_allclose(still[2:], [np.arctan2(0.8, -0.6), 0.0, 0.0])


def test_a_path_is_warmed_up_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(shell, "warm_up", lambda *given: calls.append(given))
    made = planner()
    assert len(calls) == 1 and calls[0][0] is made and calls[0][2] is STRAIGHT
    made._services.problems.of(((0,), (0, 4)))
    made.set_path(STRAIGHT)
    assert len(calls) == 1


def test_every_manoeuvre_is_compiled_before_the_first_decision() -> None:
    """With a robot like no other test's. Somebody stands in it, so that no rung is left out."""
    made = planner(robot=Unicycle(max_yaw_rate=0.2931), solver=Riccati())
    every = (rollout._steering, rollout._driving, rollout._motion)
    before = [one.cache_info().misses for one in every]
    for k in range(2):
        made.command(at(0.5 * k, 0.0, ("other", 0.5, 0.1)))
    assert made.plan is not None and made.plan.rung in (Rung.LEAST, Rung.BRAKE)
    assert len(made.explain().guesses) == 1 + len(OTHERS)
    assert [one.cache_info().misses for one in every] == before


def test_commands_follow_one_another_and_stay_within_limits() -> None:
    robot = Unicycle()
    first = cycle._smoothed(None, Command((0.4, 0.0), ramp=0.5), 2.0)
    assert first.at(2.0).linear[0] == first.at(9.0).linear[0] == pytest.approx(0.4)
    then = cycle._smoothed(first, Command((0.2, 0.0), ramp=0.5), 3.0)
    assert [then.at(t).linear[0] for t in (3.0, 3.25, 3.5, 9.0)] == pytest.approx(
        [0.4, 0.3, 0.2, 0.2]
    )
    fine = Command((0.2, 0.0), 0.1, 0.5)
    assert cycle._limited(robot, fine) == (fine, "")
    fast, note = cycle._limited(robot, Command((50.0, 0.0), 0.1, 0.5))
    assert note.startswith("command: ") and 0.0 < fast.linear[0] < 50.0
    assert cycle.joined("a", "", "b") == "a; b" and cycle.joined("", "") == ""


def test_a_delay_carries_state_and_covariance() -> None:
    """At 0.5 m/s for 0.2 s: 0.1 m on, and the variance of the speed times 0.2 s squared beside."""
    late = changed(planner(), latency=0.2)
    state = PlannerState.initial(late, STRAIGHT)
    here = at(0.0, 1.0).state
    moved = cycle._delayed(late, state, 0.0, here)
    np.testing.assert_allclose(moved, here + np.array([0.1, 0.0, 0.0, 0.0, 0.0]), atol=1e-12)
    known = np.diag([0.01, 0.02, 0.0, 0.04, 0.0])
    seen = Observation(0.0, here, covariance=known)
    spread = cycle._spread(late, state, seen, known)
    assert spread is not None
    np.testing.assert_allclose(spread[0, 0], 0.01 + 0.04 * 0.2**2, rtol=1e-4)
    np.testing.assert_allclose(spread[0, 3], 0.04 * 0.2, rtol=1e-4)
    assert cycle._spread(late, state, Observation(0.0, here), None) is None
    now = planner()
    assert cycle._delayed(now, state, 0.0, here) is here
    assert cycle._spread(now, state, seen, known) is known
    assert cycle._place(now.robot, here).tolist() == [1.0, 0.0]


def test_what_is_not_as_asked_for_is_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[tuple[str, ...]] = []
    monkeypatch.setattr(shell, "WARNINGS", SimpleNamespace(warn=lambda *words: said.append(words)))
    good = SimpleNamespace(rung=Rung.OPTIMAL, reason="", given_way=None, left_out=(), dt=0.5)
    soon, later = (GivenWay(0.05, 0.1, "content", step, "a") for step in (4, 5))  # 2.0, 2.5 s
    for changes, notes, wanted in (
        ({}, (), []),
        ({"rung": Rung.BRAKE, "reason": "why"}, (), [(str(Rung.BRAKE), "why")]),
        ({"given_way": soon}, (), [("gave way", str(soon))]),
        ({"given_way": later}, (), []),
        ({"rung": Rung.BRAKE, "given_way": soon}, (), [(str(Rung.BRAKE), "")]),
        ({"left_out": ("a", "b")}, (), [("no room in the problem", "a, b")]),
        ({}, ("clock: back", "command too fast"),
         [("clock", "clock: back"), ("command", "command too fast")]),
    ):  # fmt: skip
        said.clear()
        plan: Any = SimpleNamespace(**{**vars(good), **changes})
        shell._warn("robot", plan, notes)
        assert said == [("robot", *words) for words in wanted]


def test_a_picture_shows_the_path_that_the_plan_was_made_for() -> None:
    made = planner()
    made.set_path(Path(np.array([[0.0, 0.0], [5.0, 0.0]])))
    made.command(Observation(0.0, np.zeros(5)))
    made.set_path(Path(np.array([[0.0, 0.0], [0.0, 9.0]])))
    plan = made.plan
    assert plan is not None and plan.situation is not None and plan.situation.path is not None
    np.testing.assert_array_equal(plan.situation.path.goal, [5.0, 0.0])
    assert made.plan is plan
    made.command(Observation(0.5, np.full(5, np.nan)))
    assert made.plan is made.plan and made.plan is not None and made.plan.situation is None
