"""A local controller that is told where the people it sees will be."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.predictor import Predictor
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.motion import Detection, Observation, Twist
from wideberth.framework.values.path import Path
from wideberth.packages.nav2.tests import ticks
from wideberth.predictors.kalman import Kalman
from wideberth.robots.unicycle import Unicycle
from wideberth_nav2.controllers.expected_people import ExpectedPeopleCritic
from wideberth_nav2.controllers.local_controller import Answer, LocalController, Tick
from wideberth_nav2.controllers.local_controllers import VelocityLimits, built, shipped_parameters
from wideberth_nav2.controllers.mppi import MPPI
from wideberth_nav2.controllers.people_forecasts import PeopleForecasts
from wideberth_nav2.server.navigator import Nav2
from wideberth_nav2.server.settings import LoopSettings

VELOCITY = np.array([0.4, 0.2])


@dataclass(eq=False)
class Told(LocalController):
    """Takes note of what it is told."""

    ticks: list[Tick] = field(default_factory=list)
    calls: list[Any] = field(default_factory=list)

    def reset(self) -> None:
        self.calls.append("reset")

    def new_path(self, path: np.ndarray) -> None:
        self.calls.append(path)

    def limit_speed(self, value: float, percentage: bool) -> None:
        self.calls.append((value, percentage))

    def velocity(self, tick: Tick) -> Answer:
        self.ticks.append(tick)
        return Answer(Twist((0.1, 0.0)))


class Broken(Predictor):
    """Raises."""

    def predict(self, tracks: Any, steps: int, scene: Any = None) -> Forecast:
        raise ValueError("broken")


def seen(time: float, state: np.ndarray | None = None) -> Observation:
    place = np.array([1.0, -1.0]) + time * VELOCITY
    somebody = Detection("somebody", place, 1e-4 * np.eye(2), 0.3)
    return Observation(time, np.zeros(3) if state is None else state, (somebody,))


def tick_of(observation: Observation | None, time: float) -> Tick:
    return ticks.tick(ticks.straight(1.2), time=time, observation=observation)


def test_somebody_who_walks_straight_is_expected_ahead() -> None:
    told = Told()
    foresight = PeopleForecasts(told, Kalman(acceleration_density=0.01), horizon=2.0)
    for time in np.arange(0.0, 2.0, 0.05).tolist():
        foresight.velocity(tick_of(seen(time), time))
    people = told.ticks[-1].people
    assert people is not None and people.radii.tolist() == [0.3]
    times = np.array([2.45, 3.95])
    mean, covariance = people.at(times)
    wanted = np.array([1.0, -1.0]) + times[:, None] * VELOCITY
    assert mean[0, 0] == pytest.approx(wanted, abs=0.1)
    assert (np.linalg.eigvalsh(covariance[0, 0]) > 0.0).all()


def test_without_an_observation_the_tick_is_passed_on() -> None:
    told = Told()
    foresight = PeopleForecasts(told, Kalman())
    tick = tick_of(None, 0.0)
    foresight.velocity(tick)
    assert told.ticks[-1] is tick
    nobody = replace(seen(0.0), detections=())
    foresight.velocity(tick_of(nobody, 0.0))
    assert told.ticks[-1].people is None
    foresight.limit_speed(0.3, False)
    foresight.new_path(tick.plan)
    foresight.reset()
    assert told.calls[0] == (0.3, False) and told.calls[2] == "reset"


def test_a_broken_predictor_is_a_refusal() -> None:
    answer = PeopleForecasts(Told(), Broken()).velocity(tick_of(seen(0.0), 0.0))
    assert answer.twist is None and answer.error == "NoValidControl"
    assert answer.reason.startswith(f"no forecast: ValueError: broken ({__file__}, line ")


def test_it_is_named_beside_the_originals() -> None:
    made = built("mppi_foresight", {**shipped_parameters("mppi_foresight"), "vx_max": 0.7})
    assert isinstance(made, PeopleForecasts) and isinstance(made.controller, MPPI)
    assert made.controller.vx_max == 0.7 and made.controller.batch_size == 2000
    assert isinstance(made.controller.critics[-1], ExpectedPeopleCritic)
    assert made.horizon == pytest.approx(2.8)
    named = {"critics": ["ExpectedPeopleCritic"], "ExpectedPeopleCritic.cost_weight": 0.1}
    other = built("mppi_foresight", {**named, "predictor": "constant_velocity"})
    assert isinstance(other, PeopleForecasts) and isinstance(other.controller, MPPI)
    assert [critic.cost_weight for critic in other.controller.critics] == [0.1]  # type: ignore[attr-defined]
    limits = VelocityLimits(0.7, 0.3, 0.7, 0.1)
    assert limits.parameters("mppi_foresight") == limits.parameters("mppi")
    with pytest.raises(WideberthError, match="did you mean 'kalman'"):
        built("mppi_foresight", {"predictor": "kalmann"})


def test_the_whole_loop_drives_with_it() -> None:
    robot = Unicycle()
    settings = LoopSettings("mppi_foresight", {"batch_size": 200})
    controller = Nav2(robot, settings)
    controller.set_path(Path([[0.0, 0.0], [2.5, 0.0]]))
    state = np.zeros(len(robot.states))
    for i in range(4):
        command = controller.command(seen(0.05 * i, state))
    assert not controller.reason
    assert controller.answer is not None and controller.answer.twist is not None
    assert np.isfinite(command.linear).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [({"horizon": 0.0}, "foresight.horizon"), ({"period": -1.0}, "foresight.period")],
)
def test_wrong_numbers_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        PeopleForecasts(Told(), Kalman(), **changes)
