"""The field of walkers: drawn as the docstring says, and as uncertain as Kalman forecasts are."""

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.metrics.episode import approach
from wideberth.simulation.engine.agents import ReplayAgent
from wideberth.simulation.scenarios import crossing_field
from wideberth.simulation.scenarios.base import Placement
from wideberth.simulation.scenarios.crossing_field import CALM, ROOM, CrossingField


def drawn(field: CrossingField, seed: int) -> tuple[Placement, tuple[ReplayAgent, ...]]:
    (robot,) = placed = field.build(np.random.default_rng([seed, 7]))
    return robot, field.bystanders(np.random.default_rng([seed, 8]), placed)


def test_seed_decides() -> None:
    one, two, other = (drawn(CrossingField(), seed)[1] for seed in (3, 3, 4))
    assert all(np.array_equal(a.positions, b.positions) for a, b in zip(one, two, strict=True))
    assert not np.array_equal(one[0].positions, other[0].positions)


@pytest.mark.parametrize("seed", range(5))
def test_walkers_meet_an_undisturbed_robot_and_leave_room(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crossing_field, "ASIDE", (0.0, 0.0))
    field = CrossingField(walkers=6)
    robot, walkers = drawn(field, seed)
    assert len(walkers) == 6
    times = walkers[0].times
    way = robot.path.at(robot.speed * np.clip(times, 0.0, None))
    for k, one in enumerate(walkers):
        gap = np.linalg.norm(one.positions - way, axis=1)
        assert gap[times >= 0.0].min() < 0.25  # on the clock of 0.2 s
        early = (times >= 0.0) & (times <= CALM)
        assert gap[early].min() >= 2 * field.walker_radius + ROOM
        for other in walkers[:k]:
            near = approach(one.positions, other.positions).min()
            assert near >= 2 * field.walker_radius + ROOM - 1e-9


def test_velocities_are_those_of_the_stated_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crossing_field, "ACCELERATION_DENSITY", 0.02)
    monkeypatch.setattr(crossing_field, "TIME_CONSTANT", 4.0)
    field = CrossingField()
    sway = field._sway(np.random.default_rng(0), 200_000)
    assert np.var(sway, axis=0) == pytest.approx([0.04, 0.04], rel=0.05)  # q tau / 2
    lag = 10  # 2 s
    correlation = np.mean(sway[lag:] * sway[:-lag], axis=0) / np.var(sway, axis=0)
    assert correlation == pytest.approx(np.exp([-0.5, -0.5]), abs=0.03)
    gained = np.var(sway[1:] - sway[:-1], axis=0)  # over one short step: q dt
    assert gained == pytest.approx([0.004, 0.004], rel=0.06)


def test_bad_ranges_are_refused() -> None:
    with pytest.raises(WideberthError, match="walkers"):
        CrossingField(walkers=0)
    with pytest.raises(WideberthError, match="no room for walker"):
        drawn(CrossingField(walkers=40, reach=2.0), 0)


@pytest.mark.parametrize(("reach", "speed"), [(60.0, 0.5), (110.0, 1.0), (10.0, 0.04)])
def test_walkers_stay_for_as_long_as_the_way_takes(reach: float, speed: float) -> None:
    field = CrossingField(walkers=3, reach=reach, speed=speed)
    for seed in range(5):
        for walker in drawn(field, seed)[1]:
            assert walker.times[-1] >= 2.0 * reach / speed
    usual = drawn(CrossingField(), 0)[1]
    assert all(walker.times[-1] == pytest.approx(200.0) for walker in usual)
