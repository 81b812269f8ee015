"""A plan that keeps less than was asked says so, in the same words everywhere."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.controllers.levels.discounted import Discounted
from wideberth.experiments.engine.closed_loop import condense
from wideberth.experiments.engine.text_tables import markdown_table
from wideberth.experiments.report.player import content
from wideberth.framework.mpc.levels.base import LevelPolicy, Promise, level_of, tail_of
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.region import Region
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import GivenWay, Plan, Rung
from wideberth.regions.half_plane import HalfPlane
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.simulation.engine.agents import RobotAgent, ScriptedAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.summary import summarise
from wideberth.tests.helpers.planning import STRAIGHT, Failing, at, planner

FREE = Relaxed(weight=1.0, minimum=0.0)
"""Gives way at the paper's price."""


def decided(made: Planner, observation: Observation) -> Plan:
    made.command(observation)
    assert made.plan is not None
    return made.plan


def entered(region: Region, plan: Plan, level: Array) -> Array:
    """Whether each step is inside each region of those levels, without the planner's code."""
    assert plan.forecast is not None
    mean, spread = plan.forecast.mean[:, 0], plan.forecast.covariance[:, 0]
    gaussian = GaussianObstacle(mean.swapaxes(0, 1), spread.swapaxes(0, 1))
    numbers = region.parameters(gaussian, np.full(level.shape, 1.5))
    places = np.broadcast_to(plan.positions[1:, None], (*level.shape, 2))
    return np.asarray(region.contains(places, numbers, level))


def check_held(region: Region, plan: Plan) -> None:
    """What the plan says it holds it holds, and a little more it does not."""
    way = plan.given_way
    assert way is not None
    slot = plan.ids.index(way.name)
    inside = entered(region, plan, plan.target)[:, slot]
    assert inside[way.step - 1] and not inside[: way.step - 1].any()
    assert not entered(region, plan, plan.level - 2e-3).any()
    assert entered(region, plan, plan.level + 5e-3).any()


def test_an_optimal_plan_that_gives_way_says_so_first() -> None:
    """Somebody ahead: at the paper's price the optimum leaves nearly nothing of 95 %."""
    made = planner(level=FREE)
    plan = decided(made, at(0.0, 0.0, ("ahead", 5.5, 0.3), ("aside", 5.0, 6.0)))
    assert plan.rung is Rung.OPTIMAL and plan.violation <= 1e-4
    assert plan.given_way is not None and plan.given_way.name == "ahead"
    assert plan.given_way.held == pytest.approx(np.exp(-0.5 * plan.level[0, 0] ** 2))
    assert plan.given_way.held > 0.9
    check_held(made.region, plan)
    words = str(plan.given_way)
    assert words.startswith("asked 95 %, holds 0.") and words.endswith("because of 'ahead'")
    assert plan.reason == words
    first, _, *rest = made.explain().text().splitlines()
    assert words in first
    assert rest[-1].endswith("every constraint of the problem, at the level to which it gave way")


@pytest.mark.parametrize(
    "level", [FREE, Relaxed(weight=1000.0, minimum=0.0), Fixed(), Discounted()], ids=repr
)
def test_a_plan_that_keeps_what_was_asked_says_nothing(level: LevelPolicy) -> None:
    made = planner(level=level)
    plan = decided(made, at(0.0, 0.0, ("far", 40.0, 20.0)))
    assert plan.rung is Rung.OPTIMAL and plan.given_way is None and plan.reason == ""
    assert np.array_equal(plan.level, plan.target)
    assert plan.below_reference is False
    assert "gave way" not in made.explain().text()


@pytest.mark.parametrize("region", [MahalanobisEllipse(), MinkowskiSum()], ids=repr)
@pytest.mark.parametrize(
    "level", [Fixed(), Discounted(), Relaxed(weight=1e4, minimum=1.5)], ids=repr
)
def test_what_a_plan_holds_that_enters_regions_is_found(
    level: LevelPolicy, region: Region
) -> None:
    """Soft regions, and too little room: the worst step and obstacle count, at every level."""
    made = planner(level=level, region=region)
    plan = decided(made, at(0.0, 0.0, ("ahead", 4.5, 0.6), ("aside", 6.0, 3.0)))
    assert plan.violation > 1e-2 and plan.below_reference is True
    assert plan.given_way is not None and plan.given_way.asked < plan.given_way.held
    check_held(region, plan)
    assert plan.reason.startswith(f"{plan.given_way}; ")
    assert plan.lowest_content <= 1.0 - plan.given_way.held + 1e-9


def test_log_player_tables_and_report_say_it_in_the_same_words() -> None:
    made = planner(level=FREE)
    walker = ScriptedAgent("walker", Path(np.array([[5.5, 0.3], [0.0, 0.3]])), 0.1, 0.75)
    robot = RobotAgent("robot", made.robot, made, STRAIGHT)
    episode = run_episode([robot], Settings(history=2.0, time_limit=2.0), others=[walker])
    read = Episode.from_bytes(episode.to_bytes())
    (log,) = read.robots
    ways = [plan.given_way for plan in log.plans]
    assert None not in ways and all(plan.rung is Rung.OPTIMAL for plan in log.plans)
    shown = content(read, 0.05)["agents"][0]["plans"]
    assert [one["reason"] for one in shown] == [str(way) for way in ways]
    row = summarise(read)
    assert row["gave_way"] in {str(way) for way in ways} and row["fallbacks"] == 0
    assert row["least_content"] == min(1.0 - way.held for way in ways if way is not None)
    line = condense([row, {**row, "least_content": 0.9, "gave_way": "less so"}])
    assert line["gave_way"] == row["gave_way"] and line["below_reference"] == 1.0
    assert row["gave_way"] in markdown_table([line])


def test_levels_and_contents_do_not_need_a_region_that_can_be_hashed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Those of regions that can be are kept from decision to decision."""
    plans = []
    for hashed in (MahalanobisEllipse.__hash__, None):
        monkeypatch.setattr(MahalanobisEllipse, "__hash__", hashed)
        made = planner(level=Discounted())
        for k in range(3):
            plans.append(decided(made, at(0.5 * k, 0.25 * k, ("other", 6.0, 12.0))))
    for own, other in zip(plans[:3], plans[3:], strict=True):
        assert own.content.shape == (15, 1)
        tails = Discounted().tails(15)[:, None]
        np.testing.assert_allclose(own.content, 1.0 - tails, rtol=0, atol=1e-12)
        for name in ("states", "level", "target", "content"):
            np.testing.assert_array_equal(getattr(own, name), getattr(other, name))


def test_a_stop_that_keeps_all_that_was_asked_did_not_give_way() -> None:
    """Fallbacks are held against the lowest level; that is not what they hold."""
    made = planner(level=Relaxed(weight=100.0, minimum=0.5), solver=Failing(good=0))
    plan = decided(made, at(1.0, 0.5, ("other", 30.0, 5.0)))
    assert plan.rung is not Rung.OPTIMAL
    assert plan.given_way is None and plan.reason.startswith("solver: ")
    assert plan.level == pytest.approx(plan.target)


def test_a_collision_risk_is_called_one() -> None:
    made = planner(region=MinkowskiSum(), level=replace(FREE, promise="risk"))
    plan = decided(made, at(0.0, 0.0, ("ahead", 5.5, 0.3)))
    way = plan.given_way
    assert way is not None and way.promise == "risk" and way.asked == pytest.approx(0.05)
    assert way.held == pytest.approx(MinkowskiSum().risk(float(plan.level[0, 0])))
    assert plan.reason.startswith("asked a risk of at most 5 %, holds ")


def test_who_is_in_contact_holds_nothing() -> None:
    """Not even the risk of a region of level 0, which is below 1."""
    made = planner(region=MinkowskiSum(), level=Fixed(promise="risk"))
    plan = decided(made, at(0.0, 0.0, ("ahead", 1.0, 0.0)))
    assert plan.given_way is not None and plan.given_way.held == 1.0
    assert MinkowskiSum().risk(0.0) < 1.0 and plan.level[0, 0] == 0.0


@pytest.mark.parametrize("promise", ["content", "risk"])
def test_a_tail_is_the_inverse_of_its_level(promise: Promise) -> None:
    for region in (MinkowskiSum(), HalfPlane()):
        for tail in (1e-9, 0.05, 0.4):
            level = level_of(region, promise, tail, 2)
            assert tail_of(region, promise, level, 2) == pytest.approx(tail)
        assert tail_of(region, promise, -0.1, 2) == 1.0


@pytest.mark.parametrize(
    ("asked", "held", "promise", "words"),
    [
        (0.05, 1.0 - 7e-5, "content", "asked 95 %, holds 0.007 % from"),
        (0.05, 1.0, "content", "asked 95 %, holds 0 % from"),
        (0.050012, 0.5, "content", "asked 95 %, holds 50 % from"),
        (0.05, 0.0501, "content", "asked 95 %, holds 94.99 % from"),
        (1e-6, 2e-6, "content", "asked 99.9999 %, holds 99.9998 % from"),
        (0.05, 0.62, "risk", "asked a risk of at most 5 %, holds 62 % from"),
        (1e-6, 0.9999, "risk", "asked a risk of at most 0.0001 %, holds 99.99 % from"),
        (0.05, 0.05004, "risk", "asked a risk of at most 5 %, holds 5.004 % from"),
    ],
)
def test_small_and_near_numbers_can_be_read(
    asked: float, held: float, promise: str, words: str
) -> None:
    said = str(GivenWay(asked, held, promise, 3, "a b"))
    assert said == f"{words} step 3 on, because of 'a b'"
