"""What a robot is told of its own pose: noise, its covariance, and that they belong together."""

from math import pi
from typing import Any

import numpy as np
import pytest
from scipy import stats

from wideberth.framework.controller import Controller
from wideberth.framework.robot import Robot
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.robots.bicycle import Bicycle
from wideberth.robots.differential_drive import DifferentialDrive
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_3d import Holonomic3D
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel
from wideberth.simulation.sensing.localisation import Localisation

NOISE = Localisation(0.05, 0.02, 0.03)
ROBOTS: list[tuple[Robot, int]] = [  # and how many entries of the state are its heading
    (Unicycle(), 1),
    (DifferentialDrive(), 1),
    (Bicycle(), 1),
    (Holonomic(), 0),
    (Holonomic3D(), 0),
]


@pytest.mark.parametrize(("robot", "headed"), ROBOTS, ids=lambda one: type(one).__name__)
def test_noise_has_the_covariance_it_says(robot: Robot, headed: int) -> None:
    rng, count = np.random.default_rng(0), 4000
    state = np.linspace(0.1, 0.4, len(robot.states))
    control = (0.1,) * len(robot.inputs)
    drawn = [NOISE.measure(robot, state, control, rng) for _ in range(count)]
    error = np.array([estimate for estimate, _ in drawn]) - state
    said = drawn[0][1]
    assert said is not None
    size = robot.dimension
    diagonal = np.diagonal(said)
    assert np.allclose(diagonal[:size], 0.05**2) and np.allclose(
        diagonal[size : size + headed], 0.02**2
    )  # these models have the pose in front
    error_of = np.sqrt((np.outer(diagonal, diagonal) + said**2) / count)
    assert (np.abs(np.cov(error.T) - said) < 5.0 * error_of + 1e-12).all()
    assert (np.abs(error.mean(axis=0)) < 5.0 * np.sqrt(diagonal / count) + 1e-9).all()
    exact = robot.twist(tuple(state), control).linear
    seen = [robot.twist(tuple(state + e), control).linear for e in error]
    moved = np.array(seen, dtype=float) - np.array(exact, dtype=float)
    speeds = moved[:, :1] if headed else moved
    assert np.allclose(speeds.std(axis=0), 0.03, rtol=5.0 / np.sqrt(2.0 * count))


def test_without_noise_the_state_is_exact() -> None:
    state = np.arange(5.0)
    seen, said = Localisation().measure(Unicycle(), state, (0.0, 0.0), np.random.default_rng(0))
    assert said is None and np.array_equal(seen, state)
    _, said = Localisation(heading=0.1).measure(
        Unicycle(), state, (0.0, 0.0), np.random.default_rng(0)
    )
    assert said is not None and np.allclose(said, np.diag([0.0, 0.0, 0.01, 0.0, 0.0]))


@pytest.mark.parametrize(
    "changes", [{"position": -0.1}, {"heading": -0.1}, {"position": np.nan}, {"speed": -1.0}]
)
def test_bad_deviations_are_refused(changes: Any) -> None:
    with pytest.raises(WideberthError, match=f"localisation.{next(iter(changes))} is"):
        Localisation(**changes)


class Listener(Controller):
    """Stands, turns on the spot, and keeps what it was told."""

    period = 0.1

    def __init__(self) -> None:
        self.seen: list[Observation] = []

    def reset(self) -> None:
        self.seen = []

    def set_path(self, path: Path) -> None:
        pass

    def remember(self, observation: Observation) -> None:
        self.seen.append(observation)

    def command(self, observation: Observation) -> Command:
        self.seen.append(observation)
        return Command((0.0, 0.0), 0.2)

    @property
    def last_plan(self) -> Plan | None:
        return None


def heard(seed: int = 3, **settings: Any) -> tuple[list[Observation], np.ndarray]:
    """Observations of the first of two robots, and its true poses at their stamps."""
    listener = Listener()
    way, other = np.array([[0.0, 0.0], [9.0, 0.0]]), np.array([[0.0, 5.0], [9.0, 5.0]])
    robots = [
        RobotAgent("one", Unicycle(), listener, Path(way), 0.0),
        RobotAgent("two", Unicycle(), Listener(), Path(other), 0.0),
    ]
    given = {"time_limit": 20.0, "history": 1.0, "deadlock_after": 99.0, "plant_step": 0.1}
    episode = run_episode(robots, Settings(**{**given, **settings}), seed=seed)
    log = episode.robots[0]
    stamps = np.array([one.stamp for one in listener.seen])
    headings = np.interp(stamps, episode.times, np.unwrap(log.headings))
    return listener.seen, np.column_stack([0.0 * stamps, 0.0 * stamps, headings])


def test_observations_carry_what_was_added_to_them() -> None:
    seen, true = heard(localisation=NOISE)
    error: np.ndarray = np.array([one.state[:3] for one in seen]) - true
    assert len(seen) > 200 and np.ptp(true[:, 2]) > pi / 4
    squares = []
    for one, off in zip(seen, error, strict=True):
        assert one.covariance is not None
        squares.append(off @ np.linalg.solve(one.covariance[:3, :3], off))
    low, high = (float(stats.chi2.ppf(share, 3 * len(seen))) for share in (1e-5, 1.0 - 1e-5))
    assert low < sum(squares) < high
    following = (error[1:] * error[:-1]).mean(axis=0) / (error**2).mean(axis=0)
    assert (np.abs(following) < 5.0 / np.sqrt(len(seen))).all()  # anew at each decision


def test_the_noise_hangs_on_the_seed_and_nothing_else() -> None:
    first, _ = heard(localisation=NOISE)
    again, _ = heard(localisation=NOISE)
    louder, _ = heard(localisation=NOISE, channel=Channel(noise=0.5))
    for one, two, three in zip(first, again, louder, strict=True):
        assert np.array_equal(one.state, two.state) and np.array_equal(one.state, three.state)
    elsewhere, _ = heard(seed=4, localisation=NOISE)
    assert not np.isclose(first[5].state[0], elsewhere[5].state[0])
    exact, _ = heard()
    assert all(one.covariance is None for one in exact)
    for one, two in zip(first, exact, strict=True):  # what it hears of others is the same
        assert np.array_equal(one.detections[0].position, two.detections[0].position)
        own, other = one.state[0] - two.state[0], one.detections[0].position[0]
        assert not np.isclose(own / 0.05, other / 0.01)  # and not its own noise again
