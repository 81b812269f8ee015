"""What an oracle is told of people: they do it, if the robot keeps to its plan."""

from copy import deepcopy
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from wideberth.controllers.recommended import recommended
from wideberth.framework.controller import Controller
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation, Truth
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.predictors.oracle import Oracle
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import Run, run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.scenarios.crowd_mix import mix_of
from wideberth.simulation.scenarios.random_crowd import EQUAL_SHARES, RandomCrowd

SETTINGS = Settings(time_limit=6.0, history=1.0, truth_span=4.0)


@dataclass
class Listening(Controller):
    """Drives straight on at its speed, as it is taken to while it has no plan."""

    speed: float
    reads: tuple[float, ...] = (1.0,)
    period: float = 0.1
    heard: dict[float, dict[str, np.ndarray]] = field(default_factory=dict)
    kept: Truth | None = None

    def reset(self) -> None:
        """Forget what was heard."""
        self.heard.clear()

    def set_path(self, path: Path) -> None:
        """Nothing to follow."""

    def remember(self, observation: Observation) -> None:
        """Nothing to remember."""

    def command(self, observation: Observation) -> Command:
        """Listen at the stated times, and go on."""
        truth, now = observation.truth, round(observation.stamp, 6)
        assert truth is not None
        if now in self.reads:
            self.heard[now] = {name: truth.positions[name] for name in truth.positions}
            self.heard[now]["times"] = truth.times
        elif self.kept is None:
            self.kept = truth
        return Command((self.speed, 0.0))

    @property
    def last_plan(self) -> Plan | None:
        """No plan: the robot is taken to drive along its path."""
        return None


def agents(seed: int, controller: Controller, speed: float) -> list[RobotAgent]:
    pytest.importorskip("pyrvo")
    cast = RandomCrowd(persons=8, density=0.2).cast(seed)
    way = Path(np.array([[-3.2, 0.0], [9.0, 0.0]]))
    robot = HolonomicVelocity(0.3, 1.0)
    own = RobotAgent("robot", robot, controller, way, speed, truth=True)
    return [own, *cast.people]


@pytest.mark.parametrize("solve_time", ["zero", 0.06])
def test_people_do_what_an_oracle_was_told(solve_time: float) -> None:
    """To the last digit, turns at their goals and evasions included."""
    settings = Settings(time_limit=6.0, history=1.0, truth_span=4.0, solve_time=solve_time)
    listening = Listening(0.7, (0.0, 1.0, 1.7))
    crowd = agents(2, listening, 0.7)
    episode = run_episode(crowd, settings, seed=2)
    for told in listening.heard.values():
        times = told["times"]
        for one in crowd[1:]:
            known = (times >= 0.0) & (times <= 5.9)
            truth = episode.at(episode.agent(one.name), times[known])
            assert told[one.name][known] == pytest.approx(truth, abs=1e-9)
    assert len(listening.heard) == 3


def test_people_answer_to_the_plan() -> None:
    """One in the way of the robot goes elsewhere when the robot stands."""
    told = []
    for speed in (0.7, 0.0):
        listening = Listening(speed, (0.0,))
        run_episode(agents(2, listening, speed), SETTINGS, seed=2)
        told.append(listening.heard[0.0])
    names = [name for name in told[0] if name.startswith("person")]
    away = [float(np.abs(told[0][name] - told[1][name]).max()) for name in names]
    assert max(away) > 0.1


def test_who_does_not_ask_changes_nothing_and_cannot_ask_later() -> None:
    asking, silent = Listening(0.7, (0.0, 0.5)), Listening(0.7, ())
    episodes = [run_episode(agents(3, one, 0.7), SETTINGS, seed=3) for one in (asking, silent)]
    assert episodes[0].to_bytes() == episodes[1].to_bytes()
    assert silent.kept is not None and len(silent.kept.positions) == 8
    with pytest.raises(WideberthError, match="only at its own instant"):
        silent.kept.positions["person 1"]


def planner(predictor: Oracle) -> Planner:
    robot = HolonomicVelocity(0.3, 1.0)
    return replace(recommended(robot, 0.7, quiet=True), predictor=predictor, static_region=None)


def test_every_pass_plans_against_the_answer_to_the_plan_before() -> None:
    """A meeting head on with somebody who makes way: the second pass sees it at once."""
    crowd = mix_of({"orca": EQUAL_SHARES["orca"]})
    pytest.importorskip("pyrvo")
    way = Path(np.array([[4.0, 0.05], [-6.0, 0.05]]))
    plans = []
    for passes in (1, 2, 3):
        settings = Settings(time_limit=1.0, history=1.0, truth_span=8.0, truth_passes=passes)
        person = crowd.person(np.random.default_rng(0), "person 1", way, 1.2, 0.3)
        own = planner(Oracle())
        robot = RobotAgent(
            "robot", own.robot, own, Path(np.array([[0.0, 0.0], [9.0, 0.0]])), 0.7, truth=True
        )
        run = Run([robot, person], settings, 0, (), (), ())
        run.advance()
        forecast = run.episode().robots[0].plans[0].forecast
        assert forecast is not None and forecast.fallback == (None,)
        plans.append(forecast.mean[0, 0])
    assert np.abs(plans[0] - plans[1]).max() > 0.02
    assert np.abs(plans[2] - plans[1]).max() < np.abs(plans[1] - plans[0]).max()


def test_a_copied_planner_goes_on_as_its_original() -> None:
    own = recommended("unicycle", 0.5, quiet=True)
    own.set_path(Path(np.array([[0.0, 0.0], [9.0, 0.0]])))
    seen = [Observation(0.5 * k, np.array([0.25 * k, 0.02 * k, 0.0, 0.5, 0.0])) for k in range(4)]
    own.command(seen[0])
    twin = deepcopy(own)
    ahead = [own.command(one) for one in seen[1:]]
    assert [twin.command(one) for one in seen[1:]] == ahead
