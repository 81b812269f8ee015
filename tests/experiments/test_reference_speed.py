"""Robots that start from a stand: their free time, and what is said where it is unknown."""

from dataclasses import dataclass

import numpy as np
import pytest

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.experiments.engine.closed_loop import condense, play
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.measures.summary import summarise
from wideberth.simulation.scenarios.base import Placement, Scenario
from wideberth.simulation.scenarios.hallway import Hallway
from wideberth.simulation.scenarios.recorded_scene import RecordedScene

BODY = HolonomicVelocity(0.3, 1.0)
SETTINGS = Settings(time_limit=12.0, plant_step=0.1, history=0.0, goal_tolerance=0.1)


@dataclass(frozen=True)
class Stands(Scenario):
    """Robots that stand at first, each with its way and reference speed."""

    speeds: tuple[float | None, ...]
    lengths: tuple[float, ...]

    def build(self, rng: np.random.Generator) -> tuple[Placement, ...]:
        return tuple(
            Placement(
                f"robot {k}", Path([[0.0, 3.0 * k], [length, 3.0 * k]]), 0.0, reference_speed=speed
            )
            for k, (speed, length) in enumerate(zip(self.speeds, self.lengths, strict=True))
        )


def played(speeds: tuple[float | None, ...], lengths: tuple[float, ...]) -> Episode:
    controller = ConstantVelocityController(BODY, 0.1, reference_speed=1.0)
    return play(Stands(speeds, lengths), BODY, controller, SETTINGS, 0)


def test_the_free_time_is_that_of_the_reference_speed() -> None:
    """4 m at 0.5 m/s; the robot drives 1 m/s, less in the last second."""
    episode = played((0.5,), (4.0,))
    row = summarise(episode)
    taken = episode.robots[0].reached
    assert 4.0 < taken < 8.0 and episode.robots[0].speed == 0.5
    assert row["time_ratio_worst"] == pytest.approx(taken / 8.0)
    assert row["extra_time_worst"] == pytest.approx(taken - 8.0)
    assert condense([row])["goals_in_time"] == 1.0
    slow = condense([summarise(played((5.0,), (4.0,)))])  # more than twice 0.8 s
    assert slow["goals_in_time"] == 0.0 and slow["time_ratio"] > 2.0


def test_without_reference_speed_nothing_is_said() -> None:
    row = summarise(played((None,), (4.0,)))
    line = condense([row, summarise(played((0.5,), (4.0,)))])
    for name in ("time_ratio", "extra_time"):
        assert np.isnan(row[f"{name}_worst"])
    for name in ("time_ratio", "extra_time_s", "goals_in_time"):
        assert np.isnan(line[name])


@pytest.mark.parametrize("speeds", [(None, 0.5), (0.5, None)])
def test_one_unknown_time_hides_the_worst_unless_somebody_never_came(speeds) -> None:
    row = summarise(played(speeds, (4.0, 4.0)))
    assert np.isnan(row["time_ratio_worst"]) and np.isnan(row["extra_time_worst"])
    row = summarise(played(speeds, (4.0, 40.0)))
    assert row["time_ratio_worst"] == row["extra_time_worst"] == np.inf
    assert condense([row])["goals_in_time"] == 0.0


def test_the_speed_at_the_start_is_the_reference_where_none_is_stated() -> None:
    (one,) = Stands((None,), (4.0,)).cast(0).placements
    moving = Placement("robot", one.path, 0.7).agent(
        BODY, ConstantVelocityController(BODY), truth=False
    )
    assert moving.reference == 0.7
    assert np.isnan(one.agent(BODY, ConstantVelocityController(BODY), truth=False).reference)


def test_scenarios_that_begin_from_a_stand_state_it() -> None:
    stated = {"start": (-9.0, 0.0, 0.0), "goal": (9.0, 0.0), "rows": (10,)}
    for scenario, speed in ((Hallway(), 1.0), (RecordedScene(**stated), 0.8)):
        (one,) = scenario.cast(0).placements
        assert (one.speed, one.reference_speed) == (0.0, speed)
    for build in (
        lambda: Hallway(reference_speed=0.0),
        lambda: played((-1.0,), (4.0,)),
        lambda: RecordedScene(**stated, reference_speed=np.inf),
    ):
        with pytest.raises(WideberthError, match="reference_speed"):
            build()
