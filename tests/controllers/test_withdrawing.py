"""Deadlocks: when a robot withdraws, where to, and for how long; two robots in a door."""

import warnings
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from wideberth.controllers.withdrawing import AWAY, DeadlockResolver, Withdrawing, retreat
from wideberth.experiments.cli.export import planners
from wideberth.experiments.engine.closed_loop import play
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.comparison import Comparison
from wideberth.framework.plugins.config import build
from wideberth.framework.testing.controller import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.simulation.measures.episode_measures import verdict
from wideberth.simulation.scenarios import doorway
from wideberth.simulation.scenarios.doorway import Doorway
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.planning import planner

RADIUS = 0.3
TICK = 0.2


def seen(
    stamp: float,
    others: Mapping[str, tuple[float, float]],
    place: tuple[float, float] = (0.0, 0.0),
    polygons: tuple[Polygon, ...] = (),
) -> Observation:
    found = [Detection(name, np.array(at), np.eye(2), RADIUS) for name, at in others.items()]
    return Observation(stamp, np.array([*place, 0.0, 0.0, 0.0]), tuple(found), polygons=polygons)


def watched(known: DeadlockResolver, one: Observation, left: float = 5.0) -> DeadlockResolver:
    return known.after(one, one.state[:2], RADIUS, left)


def after(
    seconds: float, other: tuple[float, float] = (1.0, 0.0), left: float = 5.0
) -> DeadlockResolver:
    """What is known after standing before another one who stands."""
    known = DeadlockResolver()
    for tick in range(round(seconds / TICK) + 1):
        known = watched(known, seen(TICK * tick, {"b": other}), left)
    return known


def test_two_seconds_of_standing_are_a_deadlock() -> None:
    assert after(1.8).withdrawal is None
    known = after(2.0)
    assert known.withdrawal is not None and known.withdrawal.other == "b" and known.way is None
    assert 2.0 <= known.withdrawal.begin <= 4.0
    assert 4.0 <= known.withdrawal.end - known.withdrawal.begin <= 8.0


def test_what_is_no_deadlock() -> None:
    assert after(4.0, other=(2.0 * RADIUS + 1.51, 0.0)).withdrawal is None  # too far away
    assert after(4.0, left=0.2).withdrawal is None  # it has arrived
    assert after(2.0, other=(2.0 * RADIUS + 1.49, 0.0)).withdrawal is not None
    moving = [((0.08, 0.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, 0.16))]  # m/s: itself, the other
    for own, other in moving:
        known = DeadlockResolver()
        for tick in range(30):
            time = TICK * tick
            there = 1.0 + time * other[0], time * other[1]
            known = watched(known, seen(time, {"b": there}, (time * own[0], time * own[1])))
            assert known.withdrawal is None
    known = watched(after(3.8), seen(1.0, {"b": (1.0, 0.0)}))  # the clock was set back
    assert known.withdrawal is None and len(known.seen) == 1


def test_who_hesitates_stays_if_the_other_moves() -> None:
    known = after(2.0)
    assert watched(known, seen(2.01, {"b": (1.0, 0.31)})).withdrawal is None
    assert watched(known, seen(2.01, {})).withdrawal is None
    closer = watched(known, seen(2.01, {"b": (1.0, 0.0), "c": (0.0, -0.7)}))
    assert closer.withdrawal is None  # another one, who has just come


def withdrawing() -> DeadlockResolver:
    known = after(2.0)
    assert known.withdrawal is not None
    time = 2.0
    while known.way is None:
        time += TICK
        known = watched(known, seen(time, {"b": (1.0, 0.0)}))
    assert known.withdrawal is not None and 0.0 <= time - known.withdrawal.begin <= TICK + 1e-9
    return known


def test_it_goes_aside_and_comes_back() -> None:
    known = withdrawing()
    assert known.way is not None and known.withdrawal is not None
    goal = known.way.goal
    assert abs(goal[1]) == pytest.approx(2.0) and goal[0] == pytest.approx(0.0, abs=1e-9)
    assert "withdraws from 'b' to (" in known.note
    end = known.withdrawal.end
    room = 2.0 * RADIUS + AWAY + 0.01
    near, withdrawn, by = {"b": (1.0, 0.0)}, {"b": (room, 0.0)}, {"b": (-room, 0.1)}
    for one in (near, withdrawn, {"b": (-room + 0.1, 0.0)}):
        assert watched(known, seen(end - 0.1, one)).way is not None
    for one in (seen(end, near), seen(end - 0.1, by), seen(end - 0.1, {})):
        again = watched(known, one)
        assert again.withdrawal is None and again.note == "" and len(again.seen) == 1


def test_times_are_uniform_and_the_robots_own() -> None:
    """Of equal robots at other places; the same observation gives the same times."""
    drawn = []
    for k in range(300):
        known, place = DeadlockResolver(), (1e-3 * k, 0.5)
        for tick in range(11):
            known = watched(known, seen(TICK * tick, {"b": (1.0, 0.5)}, place))
        assert known.withdrawal is not None
        begin = known.withdrawal.begin
        drawn.append((begin - 2.0, known.withdrawal.end - begin))
    early, long = np.array(drawn).T
    assert stats.kstest(early, stats.uniform(0.0, 2.0).cdf).pvalue > 1e-3
    assert stats.kstest(long, stats.uniform(4.0, 4.0).cdf).pvalue > 1e-3
    assert abs(stats.pearsonr(early, long).statistic) < 0.2
    first, second = after(2.0).withdrawal, after(2.0).withdrawal
    assert first is not None and second is not None and first.begin == second.begin


def meeting(
    own: float = 1.0, other: float = 1.0, halt: float = 0.6, y: float = 0.0
) -> DeadlockResolver:
    """What is known when two who came at these speeds, m/s, have stood for a while, s."""
    known, came = DeadlockResolver(), 2.0
    for tick in range(round((came + halt) / TICK) + 1):
        before = min(TICK * tick - came, 0.0)
        there = {"b": (1.0 - other * before, y)}
        known = watched(known, seen(TICK * tick, there, (own * before, y)))
    return known


def test_two_who_come_to_a_halt_let_each_other_go() -> None:
    wait = meeting().wait
    assert wait is not None and wait.other == "b"
    assert 2.6 <= wait.end <= 5.6
    assert wait.way is not None and meeting().way is not None
    assert np.linalg.norm(wait.way.goal) < 0.02 and meeting().note == "waits for 'b'"
    assert meeting(halt=0.2).wait is None
    assert meeting(own=0.1).wait is None and meeting(other=0.1).wait is None
    assert after(1.8).wait is None  # the two were never seen to move


@pytest.mark.parametrize("period", [0.7, 1.0])
def test_who_walks_on_has_not_come_to_a_halt_however_seldom_it_is_looked_at(period: float) -> None:
    known = DeadlockResolver()
    for tick in range(12):
        way = 0.4 * period * tick
        known = watched(known, seen(period * tick, {"b": (1.0 + way, 0.0)}, (way, 0.0)))
        assert known.wait is None and known.way is None


def test_a_wait_ends_when_the_other_one_stays_or_has_gone() -> None:
    """One that is over before two seconds of standing have made it a deadlock."""
    y = next(y for y in 0.1 * np.arange(20) if meeting(y=y).wait.end < 4.4)  # type: ignore[union-attr]
    known, time = meeting(y=y), 2.6
    b = {"b": (1.0, float(y))}
    assert known.wait is not None
    end = known.wait.end
    while time + TICK < end:
        time += TICK
        known = watched(known, seen(time, b, (0.0, y)))
        assert known.wait is not None and known.wait.way is not None
    over = watched(known, seen(end, b, (0.0, y)))
    assert over.way is None and over.note == "" and over.wait is not None
    later = watched(over, seen(end + TICK, b, (0.0, y)))
    assert later.wait is not None and later.wait.way is None  # not again at this place
    assert watched(later, seen(end + TICK, b, (0.31, y))).wait is None
    gone = watched(known, seen(time, {"b": (2.0 * RADIUS + AWAY + 0.01, y)}, (0.0, y)))
    assert gone.way is None


def test_a_retreat_keeps_clear_of_walls_and_of_others() -> None:
    """A wall on the left: to the right; one on either side: back, as far as there is room."""
    wall = Polygon(((-3.0, 0.5), (3.0, 0.5), (3.0, 0.7), (-3.0, 0.7)), "left")
    other = Polygon(((-3.0, -0.7), (3.0, -0.7), (3.0, -0.5), (-3.0, -0.5)), "right")
    back = Polygon(((-1.9, -0.5), (-1.8, -0.5), (-1.8, 0.5), (-1.9, 0.5)), "back")
    here, them = np.zeros(2), {"b": (1.0, 0.0)}

    def place(polygons: tuple[Polygon, ...], more: Mapping[str, tuple[float, float]]) -> object:
        one = seen(0.0, {**them, **more}, polygons=polygons)
        found = retreat(one, one.detections, here, RADIUS, "b")
        return None if found is None else tuple(np.round(found, 6) + 0.0)

    assert place((wall,), {}) == (0.0, -2.0)
    assert place((wall, other), {}) == (-2.0, 0.0)
    assert place((wall, other, back), {}) == (-1.0, 0.0)
    assert place((wall, other), {"c": (-1.2, 0.0)}) is None
    # 1.2 m sin(30 deg) is less than 0.65 m, the room that two bodies need; of 45 deg it is not.
    assert place((wall,), {"c": (0.0, -1.2)}) == (round(-np.sqrt(2.0), 6),) * 2


def test_a_retreat_in_space_is_at_the_same_height() -> None:
    other = Detection("b", np.array([1.0, 0.0, 1.3]), np.eye(3), RADIUS)
    observation = Observation(0.0, np.zeros(6), (other,))
    found = retreat(observation, [other], np.array([0.0, 0.0, 1.2]), RADIUS, "b")
    assert found is not None and found[2] == 1.2
    assert abs(found[:2]) == pytest.approx([0.0, 2.0])


@pytest.mark.parametrize(("drift", "withdraws"), [(0.0, True), (0.29, True), (0.31, False)])
def test_a_path_that_is_planned_anew_keeps_what_is_known(drift: float, withdraws: bool) -> None:
    """Another goal begins anew; here it moves on by so much each second, m."""
    made = Withdrawing(planner(solver=Riccati()))
    reasons = []
    for tick in range(26):  # 2 s of standing, at most 2 s of hesitating, and one second
        if tick % 5 == 0:  # each second
            made.set_path(Path(np.array([[0.0, 0.0], [8.0, drift * tick / 5]])))
        made.command(seen(TICK * tick, {"b": (1.0, 0.0)}))
        assert made.plan is not None
        reasons.append(made.plan.reason)
    assert any("withdraws from 'b'" in words for words in reasons) == withdraws


@pytest.mark.parametrize("withdraw", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_two_robots_in_a_door_do_not_stand_for_ever(
    withdraw: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At some seed both stand in the door, unless one of them makes room.

    At which seed depends on how the processor rounds.
    """
    monkeypatch.setattr(doorway, "LAG", (-0.2, 0.2))
    experiment, _ = read_experiment("doorway", [])
    assert isinstance(experiment, Comparison)
    robot, settings = experiment.robots["unicycle"], experiment.settings["noise_1_cm"]
    ours = experiment.controllers["ours"]
    assert isinstance(ours, Withdrawing)
    ours = ours if withdraw else ours.controller  # type: ignore[assignment]
    short = replace(settings, time_limit=45.0)

    def found(seed: int) -> tuple[bool, str]:
        episode = play(Doorway(oncoming="robot"), robot, ours, short, seed)
        notes = [plan.reason for log in episode.robots for plan in log.plans]
        withdrew = any("withdraws from" in words for words in notes)
        return withdrew, str(verdict(episode, 45.0)["outcome"])

    wanted = (True, "success") if withdraw else (False, "timeout")
    assert any(found(seed) == wanted for seed in range(99, 109))


def test_somebody_at_the_end_of_the_world_is_not_looked_at() -> None:
    """Squares of such a distance are no numbers, which the whole decision then fell with."""
    known = DeadlockResolver()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for tick in range(15):
            one = seen(TICK * tick, {"b": (1e200, 0.0), "c": (1.0, 0.0)})
            known = watched(known, one)
    assert known.withdrawal is not None and known.withdrawal.other == "c"


@pytest.mark.parametrize("name", ["pure_pursuit", "mpc"])
def test_contract(name: str) -> None:
    rival = {"type": "pure_pursuit", "robot": "unicycle"}
    made = planner(solver=Riccati()) if name == "mpc" else build("controllers", rival)
    check_controller(Withdrawing(made), cycles=3)


def test_who_does_not_know_its_robot_is_refused() -> None:
    with pytest.raises(WideberthError, match=r"withdrawing.controller is .*, which does not know"):
        Withdrawing(object())  # type: ignore[arg-type]


def test_any_controller_is_led_out_of_a_deadlock() -> None:
    """A rival that stands before a person who stands follows the short way aside."""
    made = build(
        "controllers",
        {"type": "withdrawing", "controller": {"type": "pure_pursuit", "robot": "unicycle"}},
    )
    made.set_path(Path(np.array([[0.0, 0.0], [8.0, 0.0]])))
    turns = []
    for tick in range(30):
        command = made.command(seen(TICK * tick, {"b": (1.0, 0.0)}))
        turns.append(abs(command.omega))
    assert turns[0] == 0.0 and max(turns) > 0.0  # the way aside begins with a turn


def test_it_returns_to_where_it_left_a_path_that_crosses_itself() -> None:
    """The first of two passes of one place lies along x, the second one along -y."""
    inner = build("controllers", {"type": "pure_pursuit", "robot": "unicycle"})
    one = Withdrawing(inner)
    path = Path(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 3.0], [3.0, 3.0], [3.0, -3.0]]))
    one.set_path(path)
    arcs = np.linspace(0.0, 14.9, 150)
    for k, place in enumerate(path.at(arcs)):
        one.command(seen(0.1 * k, {}, tuple(place)))
    memory = one._memory
    assert memory.progress is not None and memory.progress.last is not None
    assert memory.progress.last[0] == pytest.approx(14.9, abs=0.01)
    memory.away = True  # as after a way out of a deadlock
    one.command(seen(20.0, {}, (3.0, 0.1)))
    assert memory.followed is not None and not memory.away
    np.testing.assert_allclose(memory.followed.points, [[3.0, 0.1], [3.0, -3.0]], atol=0.02)
    one.command(seen(20.1, {}, (3.0, 0.1)))
    assert memory.followed.length == pytest.approx(3.1, abs=0.02)  # handed on once


def test_a_planner_inside_is_found() -> None:
    experiment, _ = read_experiment("doorway", [])
    assert list(planners(experiment)) == ["ours"]
