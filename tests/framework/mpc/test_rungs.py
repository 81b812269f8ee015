"""The tuple of rungs: names, order, a user's own, and what happens where none holds."""

from dataclasses import dataclass, replace
from typing import ClassVar, final

import pytest

from wideberth.framework.mpc.fallback.instance_check import Candidate
from wideberth.framework.mpc.fallback.rungs import RUNGS, FallbackRung, NotHeld, Trial, rungs_of
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.plan import Rung, Status
from wideberth.simulation.log.episode_log import read_episode, write_episode
from wideberth.simulation.measures.summary import robot_rows
from wideberth.tests.framework.mpc.test_judged_in_time import AWAY, clock, episode, plan, runner
from wideberth.tests.helpers.planning import Failing, approach, at, planner

BUILT_IN = tuple(str(one) for one in Rung)
OWN = f"{__name__}:Still"


@final
@dataclass(frozen=True)
class Still(FallbackRung):
    """The first point of the solver's guess, whatever it breaks."""

    name: ClassVar[str] = "still"

    def attempt(self, trial: Trial) -> Candidate | NotHeld:
        if trial.check.last_inputs is None:
            return NotHeld(("still: there is no last plan",))
        first = trial.outcome.guesses[0]
        return trial.at_lowest_level(first.states, first.inputs)


def test_the_built_in_rungs_are_those_of_plans_best_first() -> None:
    assert tuple(RUNGS) == BUILT_IN == tuple(one.name for one in rungs_of(BUILT_IN))
    assert planner().rungs == BUILT_IN


def test_a_rung_of_ones_own_stands_where_the_tuple_has_it() -> None:
    made = planner(solver=Failing(good=1), rungs=("optimal", OWN, "brake"))
    assert approach(made, ticks=1).rung is Rung.OPTIMAL
    plan = approach(made, ticks=2)
    assert plan.rung == "still" and plan.status is Status.INFEASIBLE
    assert "; solver: told to fail" in plan.reason and "still taken: region of" in plan.reason
    fresh = planner(solver=Failing(good=0), rungs=("optimal", OWN, "brake"))
    fresh.command(at(0.0, 0.0, ("other", 1.2, 0.0)))
    assert fresh.plan is not None and fresh.plan.rung is Rung.BRAKE
    assert "still: there is no last plan" in fresh.plan.reason


def test_rungs_are_config() -> None:
    made = planner(rungs=("optimal", OWN, "brake"))
    assert describe(made)["rungs"] == ["optimal", OWN, "brake"]
    assert build("controllers", describe(made)).rungs == ("optimal", OWN, "brake")


def test_a_ladder_without_a_stop_ends_in_an_emergency_stop() -> None:
    made = planner(solver=Failing(good=0), rungs=("optimal",))
    command = made.command(at(0.0, 0.0, ("other", 1.2, 0.0)))
    assert made.plan is not None and made.plan.rung is Rung.BRAKE
    assert "no rung of ['optimal'] holds (solver: told to fail" in made.plan.reason
    assert command.linear[0] < 0.5


def test_brake_holds_where_the_rung_above_was_left_out() -> None:
    seen = at(0.0, 0.0, ("other", 1.2, 0.0))
    for rungs in (BUILT_IN, ("brake",), ("optimal", "brake")):
        made = planner(solver=Failing(good=0), rungs=rungs)
        made.command(seen)
        assert made.plan is not None and made.plan.rung in (Rung.BRAKE, Rung.LEAST)
        assert rungs == BUILT_IN or made.plan.rung is Rung.BRAKE


@pytest.mark.parametrize(
    ("rungs", "words"),
    [
        ((), "wanted some of"),
        (("optimum",), "did you mean 'optimal'"),
        (("nowhere.at_all:Rung",), "cannot be imported"),
        ((f"{__name__}:planner",), "no FallbackRung"),
    ],
)
def test_names_that_are_no_rungs_are_refused(rungs: tuple[str, ...], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        planner(rungs=rungs)


def test_a_plan_on_a_rung_of_ones_own_is_logged_and_counted() -> None:
    one = replace(plan(1.0, AWAY, runner(clock(1.0))), rung="still")
    played = episode(one, replace(one, rung=Rung.SHIFTED, stamp=1.5))
    again = read_episode(write_episode(played))
    assert [type(one.rung) for one in again.robots[0].plans] == [str, Rung]
    assert [one.rung for one in again.robots[0].plans] == ["still", Rung.SHIFTED]
    (row,) = robot_rows(played)
    assert row["fallbacks"] == 2 and row["rung_shifted"] == 1
