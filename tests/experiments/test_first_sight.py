"""The study of first sights: what it counts, that it begins without memory, and that it runs."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
import pytest

from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.first_sight import (
    MOTIONS,
    SEEN,
    SHOWN,
    FirstSight,
    Sights,
    _line,
    counted,
)
from wideberth.framework.predictor import Adaptive, Predictor
from wideberth.framework.tracking.noise import USUAL
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks
from wideberth.predictors.data.recordings import Recording

DT = 0.4


@final
@dataclass(frozen=True)
class Stay(Predictor):
    """Stays, with the deviation of a random walk whose steps have ``spread``, m."""

    spread: float

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        mean = np.repeat(tracks.positions[:, -1:], steps, axis=1)
        variance = self.spread**2 * np.arange(1.0, steps + 1)[:, None, None] * np.eye(2)
        return Forecast.single(mean, np.tile(variance, (len(tracks), 1, 1, 1)), tracks.dt)


def recording_of(positions: Array) -> Recording:
    count, rows, _ = positions.shape
    names = tuple(f"p{i}" for i in range(count))
    return Recording(DT, DT * np.arange(rows), names, positions, (None,) * count)


def sights(base: Predictor, positions: Array, begin: int = 0, **settings: int) -> list[Sights]:
    study = FirstSight({}, ahead=4 * DT, **settings)  # type: ignore[arg-type]
    rng = np.random.default_rng(0)
    return list(study._episode(base, recording_of(positions), begin, DT, 0.0, rng))


def test_a_true_forecast_is_missed_as_often_as_it_says() -> None:
    """Of random walks that come and go, in every class of people, within three deviations."""
    rng = np.random.default_rng(1)
    walks = 0.3 * rng.standard_normal((600, 60, 2)).cumsum(axis=1)
    for one, walk in enumerate(walks):
        begin = one % 50
        walk[:begin] = walk[begin + 12 :] = np.nan
    rows = counted(sights(Stay(0.3), walks, rows=60))
    found = {row["seen"]: row for row in rows if row["motion"] == "all"}
    assert set(found) == {"all", *SEEN}
    kinds = [row for row in rows if row["motion"] in MOTIONS]
    for name in ("people", "steps", "steps_missed"):
        assert sum(row[name] for row in kinds) == found["all"][name]
    assert sum(found[name]["people"] for name in SEEN) == found["all"]["people"]
    for row in found.values():
        share, most = row["steps_missed"] / row["steps"], row["steps"] / 4  # steps hang together
        assert abs(share - 0.05) < 3.0 * np.sqrt(0.05 * 0.95 / most)
        assert row["radius_first_m"] == pytest.approx(0.3 * np.sqrt(-2 * np.log(0.05)))
        assert row["radius_last_m"] == pytest.approx(2 * row["radius_first_m"])


def test_who_counts_and_for_how_long() -> None:
    """One who stays, one who comes at row 2 and goes after row 4; a gap ends what is known."""
    positions = np.zeros((2, 9, 2))
    positions[1, :2] = positions[1, 5:] = np.nan
    found = sights(Stay(0.3), positions, rows=9)
    assert [one.seen.tolist() for one in found[:6]] == [[1], [2], [3, 1], [4, 2], [5, 3], [6]]
    assert found[2].known.tolist() == [[True] * 4, [True, True, False, False]]
    assert found[7].known.tolist() == [[True, False, False, False]]
    assert not any(one.missed.any() for one in found)
    later = sights(Stay(0.3), positions, begin=4, rows=5)
    assert [one.seen.tolist() for one in later[:2]] == [[1, 1], [2]], "nothing is remembered"
    positions[1, 4] = 50.0, 0.0
    found = sights(Stay(0.3), positions, rows=9)
    assert found[3].missed.tolist() == [[False] * 4, [True, False, False, False]]


@final
@dataclass(frozen=True)
class Witness(Adaptive):
    """Keeps the stamps of what it was shown, and the noise of it."""

    stamps: tuple[float, ...] = ()

    def update(self, tracks: Tracks, scene: Scene | None = None) -> "Witness":
        assert np.allclose(tracks.noise, USUAL**2 * np.eye(2)), "not stated"
        return Witness((*self.stamps, tracks.stamp))

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        assert self.stamps and np.allclose(self.stamps, DT * np.arange(len(self.stamps)))
        return Stay(0.3).predict(tracks, steps)


def test_what_adapts_learns_before_each_forecast_and_begins_anew() -> None:
    positions = np.zeros((1, 30, 2))
    for begin in (0, 10):
        assert len(sights(Witness(), positions, begin, rows=6)) == 6


def test_shares_are_counted_over_people_and_steps() -> None:
    seen, known = np.array([1, 9]), np.array([[True, True, False], [True, True, True]])
    missed = np.array([[True, False, False], [False, False, True]])
    radius = np.array([[1.0, 2.0, 3.0], [3.0, 4.0, 9.0]])
    motion = np.array([1, 4])
    fine = Sights(
        np.array([9]), motion[:1], np.ones((1, 3), bool), np.zeros((1, 3), bool), radius[:1]
    )
    rows = counted([Sights(seen, motion, known, missed, radius), fine])
    every, once, _, _, often = (row for row in rows if row["motion"] == "all")
    starting, walking = (row for row in rows if row["motion"] in ("starting", "walking on"))
    assert (every["people"], every["steps"], every["steps_missed"]) == (3, 8, 2)
    assert (every["plans"], every["plans_missed"]) == (2, 1)
    assert (once["people"], once["steps"], once["steps_missed"]) == (1, 2, 1)
    assert (often["known_last"], often["missed_last"], often["radius_last_m"]) == (2, 1, 6.0)
    assert (starting["people"], starting["steps"], starting["steps_missed"]) == (2, 5, 1)
    assert (walking["people"], walking["steps_missed"], walking["missed_last"]) == (1, 1, 1)
    assert (once["known_last"], once["missed_first"], once["radius_middle_m"]) == (0, 1, 2.0)


def test_motions_are_those_of_the_path() -> None:
    """Of paths of 12 s, at their middle; speeds of 1 m/s and steps of 0.4 s."""
    halves = {
        "standing": ((0, 0), (0, 0)), "starting": ((0, 0), (1, 0)), "stopping": ((1, 0), (0, 0)),
        "turning": ((1, 0), (0, 1)), "walking on": ((1, 0), (0.9, 0.3)),
        "other": ((0.3, 0), (1, 0)),
    }  # fmt: skip
    assert tuple(halves) == MOTIONS
    steps = np.arange(-15, 16)[:, None]
    paths = [DT * np.where(steps < 0, steps * np.array(old), steps * np.array(new))
             for old, new in halves.values()]  # fmt: skip
    found = sights(Stay(0.3), np.array(paths), rows=31)
    assert [MOTIONS[kind] for kind in found[15].motion] == list(MOTIONS)
    alone = np.array(paths)[:, 15:]
    first = sights(Stay(0.3), alone, rows=16)[0]
    wanted = ["standing", "walking on", "standing", "walking on", "walking on", "walking on"]
    assert [MOTIONS[kind] for kind in first.motion] == wanted, "the first step counts"


def test_the_interval_is_that_of_whole_episodes() -> None:
    """Of four episodes one is missed: a share of 0 to 0.75, however many steps they have."""
    row = {"people": 1, "plans": 1, "plans_missed": 0, "scene": "hall"}
    row |= {f"{name}_{at}": 1 for name in ("known", "missed") for at in SHOWN}
    row |= {f"radius_{at}_m": 1.0 for at in SHOWN}
    rows = [row | {"episode": k, "steps": 50, "steps_missed": 50 * (k == 2)} for k in range(4)]
    line = _line(rows, "scene")
    assert (line["missed"], line["missed_low"], line["missed_high"]) == (0.25, 0.0, 0.75)


@pytest.fixture(scope="module")
def shipped() -> FirstSight:
    experiment, _ = read_experiment("first_sight", [])
    assert isinstance(experiment, FirstSight)
    return experiment


def test_episodes_are_spread_over_a_recording(shipped: FirstSight) -> None:
    positions = np.zeros((1, 95, 2))
    positions[:, 20:40] = np.nan
    study = replace(shipped, rows=10, starts=3)
    assert study._begins(recording_of(positions)) == [0, 50, 80]
    assert replace(study, rows=200)._begins(recording_of(positions)) == [0]


def test_predictors_learn_from_the_other_scenes_alone(shipped: FirstSight) -> None:
    small = replace(shipped, rows=10, starts=1, as_given=("imm",))
    texts = {}
    for task in small.tasks():
        one = task.settings
        if (one["scene"], one["dt"], one["noise"], task.seed) == ("plaza", 0.5, 0.0, 0):
            texts[one["predictor"]] = small.measure(task).rows[0]["fitted"]
    assert texts["imm"] == "as given" and texts["kalman"] == "fitted to 1 recording"


def test_quick_run(shipped: FirstSight, tmp_path: Path) -> None:
    result = run(shipped, tmp_path / "out", quick=True)
    assert {row["seen"] for row in result.rows} == {"all", *SEEN}
    lines = read_table(tmp_path / "out" / "summary.csv")
    assert lines[0]["scene"] == "mean of 2" and 0.0 <= lines[0]["missed"] <= 1.0
    assert len(draw(tmp_path / "out")) == 2


def test_bad_settings_are_refused() -> None:
    for settings in ({"ahead": 0.0}, {"dt": (0.0,)}, {"noise": (-0.1,)}, {"rows": 0}):
        with pytest.raises(WideberthError, match=next(iter(settings))):
            FirstSight({}, **settings)  # type: ignore[arg-type]
