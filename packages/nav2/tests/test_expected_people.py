"""The critic of MPPI that is fed by forecasts, and where it takes people to be."""

from dataclasses import replace

import numpy as np
import pytest

from wideberth.framework.risk.collision_probability import collision_probability
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast
from wideberth.packages.nav2.tests import ticks
from wideberth_nav2.controllers.expected_people import ExpectedPeopleCritic
from wideberth_nav2.controllers.local_controller import ExpectedPeople, Tick
from wideberth_nav2.controllers.local_controllers import shipped_parameters
from wideberth_nav2.controllers.mppi import MPPI
from wideberth_nav2.controllers.mppi_rollouts import ControlLimits, MppiTick, Rollouts, driven
from wideberth_nav2.costmap.footprint import RobotFootprint
from wideberth_nav2.overlap_tables import ellipses_of

DT, STEPS, BATCH = 0.05, 56, 30
BODY = RobotFootprint.round_of(0.22)


def tick_of(people: ExpectedPeople | None, time: float = 0.0, y: float = 0.0) -> Tick:
    plan = np.stack([np.linspace(0.0, 3.0, 61), np.zeros(61), np.zeros(61)], axis=1)
    return ticks.tick(
        plan, (0.0, y, 0.0), time=time, costmap=ticks.free(200), footprint=BODY, people=people
    )


def situation_of(tick: Tick) -> MppiTick:
    return MppiTick(tick, ControlLimits(0.5, -0.35, 1.9, 3.0, -3.0, 3.5, 0.0), DT)


def fan(seed: int = 0) -> Rollouts:
    rng = np.random.default_rng(seed)
    vx = (0.4 + 0.2 * rng.standard_normal((1, BATCH)) + np.zeros((STEPS, 1))).astype(np.float32)
    wz = (0.5 * rng.standard_normal((1, BATCH)) + np.zeros((STEPS, 1))).astype(np.float32)
    return driven(vx, wz, np.zeros(3), DT)


def crowd(steps: int = 20, dt: float = 0.2, seed: int = 1) -> Forecast:
    """Three people with two modes each, which walk straight and are known ever less."""
    rng = np.random.default_rng(seed)
    start, velocity = rng.uniform(-0.5, 1.5, (3, 2, 1, 2)), rng.normal(0.0, 0.5, (3, 2, 1, 2))
    mean = start + np.arange(1, steps + 1)[:, None] * dt * velocity
    root = rng.normal(0.0, 0.06, (3, 2, 1, 2, 2)) + 0.3 * np.eye(2)
    grown = 1.0 + 0.1 * np.arange(steps)[:, None, None]
    covariance = root @ np.swapaxes(root, -1, -2) * grown
    return Forecast(mean, covariance, np.array([[0.7, 0.3], [1.0, 0.0], [0.2, 0.8]]), dt,
                    (None,) * 3)  # fmt: skip


def test_costs_are_the_expected_seconds_of_overlap() -> None:
    forecast, radii = crowd(), np.array([0.3, 0.25, 0.4])
    people, rollouts = ExpectedPeople(forecast, -0.1, radii), fan()
    found = ExpectedPeopleCritic(
        cost_weight=1.0, least_deviation=1e-3, trajectory_point_step=7
    ).cost(rollouts, situation_of(tick_of(people)))
    assert found is not None
    wanted = np.zeros(BATCH)
    for t in range(0, STEPS, 7):
        mean, covariance = people.at(np.array([(t + 1) * DT]))
        place = np.stack([rollouts.x[t], rollouts.y[t]], axis=1).astype(float)
        for o in range(3):
            for m in range(2):
                chance = collision_probability(
                    place - mean[o, m, 0], np.broadcast_to(covariance[o, m, 0], (BATCH, 2, 2)),
                    radii[o] + BODY.circumscribed,
                )  # fmt: skip
                wanted += forecast.weight[o, m] * chance * 7.0 * DT
    assert found == pytest.approx(wanted, abs=0.02)
    assert wanted.max() > 2.0 * wanted.min()


@pytest.mark.parametrize("deviations", [(0.1, 0.1), (0.1, 1.0), (0.4, 0.4), (0.3, 0.9)])
@pytest.mark.parametrize("turn", [0.0, 0.4, 2.5])
def test_probabilities_are_exact_within_a_hundredth(
    deviations: tuple[float, float], turn: float
) -> None:
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    covariance = rotation @ np.diag(np.square(deviations)) @ rotation.T
    forecast = Forecast.single(np.zeros((1, 1, 2)), covariance[None, None], 1.0)
    people = ExpectedPeople(forecast, -1.0, np.array([0.28]))
    x, y = np.random.default_rng(2).uniform(-2.0, 2.0, (2, 1, 2000)).astype(np.float32)
    rollouts = Rollouts(x, x, x, y, x)
    critic = ExpectedPeopleCritic(cost_weight=1.0 / DT, trajectory_point_step=1)
    found = critic.cost(rollouts, situation_of(tick_of(people)))
    wanted = collision_probability(
        np.stack([x[0], y[0]], axis=1), np.broadcast_to(covariance, (2000, 2, 2)), 0.5
    )
    assert found == pytest.approx(wanted, abs=0.01)


def test_people_walk_on_before_and_after_the_forecast() -> None:
    velocity = np.array([0.6, -0.2])
    mean = 1.0 + np.arange(1, 5)[:, None] * 0.5 * velocity
    spread = np.arange(1, 5)[:, None, None] * 0.01 * np.eye(2)
    people = ExpectedPeople(Forecast.single(mean[None], spread[None], 0.5), 3.0, np.array([0.3]))
    times = np.array([3.0, 3.5, 3.85, 5.0, 6.0])
    where, covariance = people.at(times)
    assert where[0, 0] == pytest.approx(1.0 + (times - 3.0)[:, None] * velocity)
    assert covariance[0, 0, :, 0, 0] == pytest.approx([0.01, 0.01, 0.017, 0.04, 0.04])
    single = ExpectedPeople(Forecast.single(mean[None, :1], spread[None, :1], 0.5), 3.0,
                            np.array([0.3]))  # fmt: skip
    assert single.at(times)[0][0, 0] == pytest.approx(np.tile(mean[0], (5, 1)))


def test_axes_of_covariances_are_their_eigenvectors() -> None:
    covariance = crowd().covariance
    deviations, turns = ellipses_of(covariance, 0.0)
    values, vectors = np.linalg.eigh(covariance)
    assert deviations == pytest.approx(np.sqrt(values))
    assert np.abs((vectors[..., :, 0] * turns).sum(axis=-1)) == pytest.approx(1.0)


def test_without_people_it_does_not_apply() -> None:
    rollouts, critic = fan(), ExpectedPeopleCritic()
    assert critic.cost(rollouts, situation_of(tick_of(None))) is None
    nobody = Forecast.single(np.zeros((0, 3, 2)), np.zeros((0, 3, 2, 2)), 0.2)
    empty = ExpectedPeople(nobody, 0.0, np.zeros(0))
    assert critic.cost(rollouts, situation_of(tick_of(empty))) is None


def crossing(critics: tuple[str, ...]) -> float:
    """Drive past somebody who crosses the path; return the least distance between centres."""
    controller = MPPI.from_parameters(
        {**shipped_parameters("mppi"), "batch_size": 300, "critics": critics}
    )
    pose, speed, gaps = np.zeros(3), np.zeros(3), []
    velocity, period = np.array([0.0, 0.5]), 0.05
    for i in range(150):
        now = i * period
        person = np.array([1.5, -1.7]) + now * velocity
        mean = person + np.arange(1, 13)[:, None] * 0.25 * velocity
        spread = (0.05 + 0.05 * np.arange(1, 13))[:, None, None] ** 2 * np.eye(2)
        people = ExpectedPeople(Forecast.single(mean[None], spread[None], 0.25), now,
                                np.array([0.25]))  # fmt: skip
        tick = replace(tick_of(people, now), pose=pose, speed=speed)
        first = int(np.searchsorted(tick.plan[:, 0], pose[0]))
        twist = controller.velocity(replace(tick, plan=tick.plan[first:])).twist
        assert twist is not None
        speed = np.array([twist.linear[0], 0.0, twist.angular])
        way = np.array([np.cos(pose[2]), np.sin(pose[2]), 0.0])
        pose = pose + period * (way * speed[0] + np.array([0.0, 0.0, speed[2]]))
        gaps.append(float(np.hypot(*(pose[:2] - person))))
    assert pose[0] > 1.8, "it has passed"
    return min(gaps)


def test_a_robot_that_expects_people_lets_them_pass() -> None:
    usual = tuple(type(critic).__name__ for critic in MPPI.critics)
    assert crossing(usual) < 0.3
    assert crossing((*usual, "ExpectedPeopleCritic")) > 0.47


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"least_deviation": 0.0}, "above 0"),
        ({"cost_weight": -0.1}, "at least 0"),
        ({"trajectory_point_step": 0}, "whole number of at least 1"),
    ],
)
def test_wrong_parameters_are_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        ExpectedPeopleCritic(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mean", "radii", "message"),
    [
        (np.zeros((1, 2, 3)), [0.3], "2 steps in 3 dimensions"),
        (np.zeros((1, 0, 2)), [0.3], "0 steps in 2 dimensions"),
        (np.zeros((1, 2, 2)), [0.3, 0.3], "one per person"),
        (np.zeros((1, 2, 2)), [-0.3], "must not be negative"),
    ],
)
def test_wrong_people_are_refused(mean: np.ndarray, radii: list[float], message: str) -> None:
    size = mean.shape[-1]
    forecast = Forecast.single(mean, np.zeros((*mean.shape, size)), 0.2)
    with pytest.raises(WideberthError, match=message):
        ExpectedPeople(forecast, 0.0, np.array(radii))
