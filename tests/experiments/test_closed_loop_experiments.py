"""The closed-loop experiments: what they count, and that their quick settings run."""

from dataclasses import dataclass, fields, replace
from pathlib import Path as File

import numpy as np
import pytest

from wideberth.experiments.engine.closed_loop import play
from wideberth.experiments.engine.result import condense_times
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.encounter import Encounter
from wideberth.experiments.studies.planner_parts import PlannerParts, kept, promised
from wideberth.framework.controller import Controller, fresh
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.testing import check_controller
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.simulation.log.episode_log import Episode

MADE: list["Asked"] = []
"""All that were given a path."""


@dataclass(eq=False)
class Asked(Controller):
    """Goes ahead slowly and keeps the states at which it was asked."""

    speed: float = 0.25
    period: float = 0.5

    def reset(self) -> None:
        self.states: list[Array] = []

    def set_path(self, path: Path) -> None:
        self.states, self.goal = [], path.goal.tolist()
        MADE.append(self)

    def remember(self, observation: Observation) -> None:
        pass

    def command(self, observation: Observation) -> Command:
        self.states.append(observation.state)
        return Command((self.speed, 0.0))

    @property
    def last_plan(self) -> None:
        return None


def shipped(name: str, *overrides: str) -> object:
    return read_experiment(name, list(overrides))[0]


@pytest.fixture(scope="module")
def encounter() -> Encounter:
    experiment = shipped("crossing", "seeds=1")
    assert isinstance(experiment, Encounter)
    return experiment


@pytest.fixture(scope="module")
def episode(encounter: Encounter) -> Episode:
    planner = encounter.planners["default"]
    return play(encounter.scenario, encounter.robot, planner, encounter.settings, 3)


def test_shipped_planners_keep_the_laws_of_a_controller(encounter: Encounter) -> None:
    for name, planner in encounter.planners.items():
        assert isinstance(planner, Planner), name
        check_controller(fresh(planner))


def test_every_robot_gets_a_controller_of_its_own(encounter: Encounter) -> None:
    """With the same settings; what one of them is asked, the others do not answer."""
    asked = Asked()
    MADE.clear()
    played = play(encounter.scenario, encounter.robot, asked, encounter.settings, 3)
    assert len(played.robots) == 2
    assert not hasattr(asked, "states")  # the one that was handed in decides for nobody
    paths = [log.paths[0][1].goal.tolist() for log in played.robots]
    assert len(MADE) == 2 and sorted(one.goal for one in MADE) == sorted(paths)
    for one in MADE:
        log = played.robots[paths.index(one.goal)]
        assert one.speed == 0.25 and len(one.states) == len(log.commands)
        np.testing.assert_allclose(one.states[0][:2], log.positions[0], atol=0.2)
    planner = encounter.planners["paper"]
    other = fresh(planner)
    assert isinstance(planner, Planner) and isinstance(other, Planner)
    mine, its = vars(planner), vars(other)
    settings = {entry.name for entry in fields(Planner) if entry.init}
    assert all(its[name] == mine[name] for name in settings)
    state = set(mine) - settings
    assert state and all(its[name] is not mine[name] for name in state)


def test_planners_meet_the_same_situation(encounter: Encounter) -> None:
    first, second = encounter.scenario.cast(5).placements, encounter.scenario.cast(5).placements
    for one, two in zip(first, second, strict=True):
        assert np.array_equal(one.path.points, two.path.points)
        assert one.phase == two.phase
    other = encounter.scenario.cast(6).placements
    assert not np.array_equal(first[0].path.points, other[0].path.points)


def test_an_episode_reaches_its_goals_without_collision(episode: Episode) -> None:
    assert episode.ended == "goals"
    first, second = episode.robots
    assert first.reached <= episode.duration and second.reached <= episode.duration
    for log in episode.robots:
        left = np.linalg.norm(log.positions[-1] - log.paths[0][1].goal)
        assert left <= episode.goal_tolerance
    apart = np.linalg.norm(first.positions - second.positions, axis=1)
    moves = np.linalg.norm(np.diff(first.positions - second.positions, axis=0), axis=1)
    # Nor between two instants, by which they can come closer at most half of how they move.
    assert (np.minimum(apart[:-1], apart[1:]) - 0.5 * moves).min() > first.radius + second.radius
    assert 0.0 < promised(episode) < 1.0
    assert 0.9 < kept(episode) <= 1.0


def test_kept_counts_planned_positions_against_the_truth(episode: Episode) -> None:
    count = clear = 0
    for log, other in (episode.robots, episode.robots[::-1]):
        for plan in log.plans:
            for i, position in enumerate(plan.positions[1:], start=1):
                time = plan.stamp + i * plan.dt
                if time <= episode.duration:
                    there = [np.interp(time, episode.times, c) for c in other.positions.T]
                    count += 1
                    clear += np.hypot(*(position - there)) >= 1.5 - 1e-3
    assert kept(episode) == pytest.approx(clear / count, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "episodes"), [("crossing", 4), ("blind_corner", 2), ("interaction_crossing", 2)]
)
def test_a_quick_encounter_plays_few_episodes(name: str, episodes: int) -> None:
    assert len(shipped(name).quick().tasks()) == episodes


@pytest.mark.parametrize("name", ["dynamic_matters", "conservativeness"])
def test_quick_settings_run_and_draw(name: str, tmp_path: File) -> None:
    experiment = shipped(name)
    assert isinstance(experiment, PlannerParts)
    experiment = replace(experiment, scenarios={"crossing": experiment.scenarios["crossing"]})
    result = run(experiment, tmp_path / name, quick=True)
    assert len(result.rows) == len(experiment.quick().tasks())
    lines = experiment.summary(result.rows)
    assert all(line["collisions"] == 0 for line in lines if line["predictor"] != "oracle")
    files = draw(tmp_path / name)
    assert {path.suffix for path in files} == {".png", ".pdf"}


def test_encounters_count_who_yields(encounter: Encounter, tmp_path: File) -> None:
    result = run(encounter, tmp_path / "crossing", quick=True)
    line, paper = encounter.summary(result.rows)
    assert (line["planner"], paper["planner"]) == ("default", "paper")
    assert line["episodes"] == 1
    assert line["collisions"] == 0
    assert line["goals_in_time"] == 1.0
    assert line["first"] in ("lower 1", "upper 1")
    assert result.names() == ["run-default-0.npz", "run-paper-0.npz"]
    again = Episode.from_bytes(result.read("run-default-0.npz"))
    assert again.robots[0].plans[0].seconds == 0.0
    assert len(result.times) == 4


def test_an_encounter_of_one_robot_draws_its_run(tmp_path: File) -> None:
    settings = ["seeds=1", "settings.time_limit=2", "scenario={type: doorway}"]
    follower = "planners={alone: {type: pure_pursuit, robot: unicycle, reference_speed: 0.5}}"
    run(shipped("crossing", *settings, follower), tmp_path / "door")  # type: ignore[arg-type]
    names = {path.name for path in draw(tmp_path / "door")}
    assert names == {"run_alone.png", "run_alone.pdf", "animation_alone.gif"}


def test_settings_that_make_no_experiment_are_refused(encounter: Encounter) -> None:
    with pytest.raises(WideberthError, match="planners is empty"):
        replace(encounter, planners={})
    with pytest.raises(WideberthError, match=r"show is \[7\]; wanted seeds in \[0, 1\)"):
        replace(encounter, show=(7,))
    conservativeness = shipped("conservativeness")
    assert isinstance(conservativeness, PlannerParts)
    with pytest.raises(WideberthError, match=r"relative_to\.predictor: .*'oracle'"):
        replace(conservativeness, predictors={"exact": conservativeness.predictors["exact"]})


def test_times_are_condensed_over_robots_and_seeds() -> None:
    row = {"scenario": "run", "planner": "a", "seed": 0, "agent": "left"}
    times = [
        {**row, "median": 0.004, "p95": 0.01, "p99": 0.02, "max": 0.03},
        {**row, "agent": "right", "median": 0.006, "p95": 0.02, "p99": 0.02, "max": 0.02},
        {**row, "planner": "b", "median": 0.001, "p95": 0.002, "p99": 0.003, "max": 0.004},
    ]
    first, second = condense_times(times)
    assert first == {
        "planner": "a",
        "median ms": pytest.approx(5.0),
        "p95 ms": pytest.approx(20.0),
        "p99 ms": pytest.approx(20.0),
        "max ms": pytest.approx(30.0),
    }
    assert second["planner"] == "b"
    (alone,) = condense_times(times[:1])  # one planner: the line has its name
    assert next(iter(alone)) == "planner" and alone["planner"] == "a"
    assert condense_times([]) == []
    assert condense_times([{"seconds": 1.0}]) == []
