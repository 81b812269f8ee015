"""One robot of an experiment's episode is driven from outside; the experiment still judges."""

from dataclasses import replace
from functools import partial
from importlib.util import find_spec

import numpy as np
import pytest

from wideberth.experiments.engine.base import Row
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.controller import Controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.avoidable import Repeating
from wideberth_ros.from_outside import chosen_task, play_from_outside

OF_PLANS = {
    "below_reference", "least_content", "gave_way", "plans", "errors", "fallbacks",
    "deadline_misses", "violation_worst", "named_forecasts", "coverage", "coverage_first",
    "coverage_last", "plan_change", "region_area", "plan_risk_mean", "plan_risk_max", "step_risk",
    "step_touched", "episode_risk", "episode_touched", "tail_nominal", "tail_observed",
    "recoveries", "gave_up", "feasible_successors", "infeasible_successors", "aimed_successors",
    "lowered_successors", "between_share", "between_depth",
}  # fmt: skip
"""Columns about a controller's plans, which who drives from outside keeps."""
PHYSICS = pytest.mark.skipif(not find_spec("mujoco"), reason="the extra `perception` is missing")
SHORT = "settings.nominal={history: 0.0, time_limit: 12}"


def without_plans(episode: Episode, name: str) -> bytes:
    """Return an episode as bytes, without the plans of one robot."""
    agents = [replace(one, plans=()) if one.name == name else one for one in episode.agents]
    return replace(episode, agents=tuple(agents)).to_bytes()


def repeating(known: Episode, run: Run, agent: RobotAgent) -> Controller:
    """Give the commands again that a robot had in an episode."""
    return Repeating.of(agent.robot, known.agent(agent.name))


def nothing(run: Run) -> None:
    """Look at nothing."""


@pytest.mark.parametrize(
    "config, settings, case, robot",
    [
        ("crossing", ["settings.time_limit=12"], [], "upper"),
        ("crowdnav", [], ["controller=ours", "scenario=square"], ""),
        ("crowdnav_plus", [], [], ""),
        ("nav2_rivals", [], ["scenario=doorway", "controller=rpp"], ""),
        pytest.param("cascade_crossing", [SHORT], [], "", marks=PHYSICS),
    ],
)
def test_the_same_commands_from_outside_give_the_same_episode_and_verdict(
    config: str, settings: list[str], case: list[str], robot: str
) -> None:
    """Two robots of the paper, a CrowdNav case, a crowd with rules, Nav2's view, and physics."""
    experiment, _ = read_experiment(config, settings)
    task = chosen_task(experiment, case)
    made = experiment.measure(task)
    known = Episode.from_bytes(next(iter(made.files.values())))
    seen: list[float] = []
    enter = partial(repeating, known)
    row, episode = play_from_outside(
        experiment, task, enter, lambda run: seen.append(run.clock[-1]), robot
    )
    name = robot or episode.robots[0].name
    assert without_plans(episode, name) == without_plans(known, name)
    assert sorted({*seen}) == episode.times[1:].tolist() and not episode.agent(name).plans
    assert judged(row, made.rows[0]) == judged(made.rows[0], made.rows[0])


def judged(row: Row, columns: Row) -> dict[str, str]:
    """Return what a row of the table says of the way that was driven."""
    return {name: repr(row[name]) for name in columns if name not in OF_PLANS}


def test_the_verdict_says_whether_it_arrived_and_when() -> None:
    experiment, _ = read_experiment("crowdnav", ["scenarios.circle.humans=0"])
    task = chosen_task(experiment, ["controller=pure_pursuit"])
    known = Episode.from_bytes(next(iter(experiment.measure(task).files.values())))
    row, episode = play_from_outside(experiment, task, partial(repeating, known), nothing)
    assert row["outcome"] == row["judged_outcome"] == "success"
    assert row["success_time"] == episode.robots[0].reached


def test_a_seed_that_the_experiment_does_not_play_is_played_too() -> None:
    experiment, _ = read_experiment("crowdnav", [])
    task = chosen_task(experiment, ["scenario=circle_10"], 77)
    assert (task.seed, task.settings["scenario"]) == (77, "circle_10")
    assert chosen_task(experiment, []).seed == 0


def test_leaving_in_the_middle_ends_the_task() -> None:
    experiment, _ = read_experiment("crowdnav", [])
    task = chosen_task(experiment, ["controller=pure_pursuit"])
    known = Episode.from_bytes(next(iter(experiment.measure(task).files.values())))

    def leave(run: Run) -> None:
        raise EOFError

    with pytest.raises(EOFError):
        play_from_outside(experiment, task, partial(repeating, known), leave)
    assert experiment.measure(task).files, "later episodes have their own controllers again"


def test_a_contact_is_judged_avoidable_whatever_the_period_of_who_drives() -> None:
    """The episode is repeated with the commands and instants that it had, not the planner's."""
    limits = "settings.noise_1_cm.time_limit=12"
    experiment, _ = read_experiment("random_crowd", [limits])
    task = chosen_task(experiment, [])

    def enter(run: Run, agent: RobotAgent) -> Controller:
        stamps = np.array([0.0, 1.0])
        return Repeating(agent.robot, 0.05, stamps, [Command((0.0, 0.0)), Command((1.0, 0.0))])

    row, episode = play_from_outside(experiment, task, enter, nothing)
    first = episode.robots[0].commands.stamp[0]
    assert first == 0.0 and row["collision"] and row["avoidable_2s"] in (True, False)


@pytest.mark.parametrize(
    "case, words",
    [
        (["scenario=cirle"], "unknown scenario 'cirle': did you mean 'circle'?"),
        (["place=circle"], "unknown column 'place'"),
        (["scenario"], "unknown scenario ''"),
    ],
)
def test_an_unknown_case_is_refused(case: list[str], words: str) -> None:
    experiment, _ = read_experiment("crowdnav", [])
    with pytest.raises(WideberthError, match=words):
        chosen_task(experiment, case)


def test_an_experiment_without_episodes_is_refused() -> None:
    experiment, _ = read_experiment("region_gallery", [])
    with pytest.raises(WideberthError, match="RegionGallery drives no robot; take a config that"):
        chosen_task(experiment, [])


@pytest.mark.parametrize(
    "config, robot, words",
    [
        ("crossing", "robot", "--robot: unknown robot 'robot'.*lower, upper"),
        ("flight", "", "moves in space"),
    ],
)
def test_a_robot_that_cannot_be_driven_is_refused(config: str, robot: str, words: str) -> None:
    experiment, _ = read_experiment(config, [])
    with pytest.raises(WideberthError, match=words):
        play_from_outside(
            experiment, chosen_task(experiment, []), lambda run, one: one.controller, nothing,
            robot,
        )  # fmt: skip
