"""What robots perceived is read again to the same values, and is small in a file."""

from dataclasses import fields, is_dataclass, replace
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.simulation.log.episode_log import AgentLog, CommandLog, Episode
from wideberth.simulation.log.perception_log import (
    Glance,
    PerceptionLog,
    PipelineStop,
    TrueBody,
    TrueStage,
)
from wideberth.simulation.sensing.perceived import (
    MotionEstimate,
    Segments,
    Sightings,
    TrackedObstacle,
)
from wideberth_perception.cascade.measures import perception_row
from wideberth_perception.cascade.naming import named

RNG = np.random.default_rng(0)


def spread(size: int) -> np.ndarray:
    root = RNG.standard_normal((size, size))
    return root @ root.T


def glance(time: float, seen: int, hits: int, note: str = "") -> Glance:
    """Return one with ``seen`` sightings, tracks and bodies, and half of its hits static."""
    bodies = tuple(
        TrueBody(f"body {i}", RNG.uniform(-9, 9, 2), RNG.standard_normal(2), 0.5)
        for i in range(seen)
    )
    own = MotionEstimate(time + 2.0, RNG.standard_normal(6), spread(6))
    places, walls = RNG.uniform(-9.0, 9.0, (hits, 2)), (hits + 20) // 50
    sightings = Sightings(
        *(time + 1.99, RNG.uniform(-9, 9, (seen, 2)), np.array([spread(2) for _ in range(seen)])
          .reshape(seen, 2, 2)),
        *(np.full(seen, 0.4), places[::2], note, time + 1.9 + 0.09 * RNG.random(seen)),
        RNG.standard_normal(2) if seen else None,
        segments=Segments(
            RNG.uniform(-9, 9, (walls, 2, 2)),
            np.array([spread(2) for _ in range(walls)]).reshape(-1, 2, 2),
        ),
    )  # fmt: skip
    tracks = tuple(
        TrackedObstacle(str(7 + i), time + 1.9, RNG.standard_normal(4), spread(4), 0.4, time + 1.8)
        for i in range(seen)
    )
    names = {one.ident: f"body {i}" if i else "" for i, one in enumerate(tracks)}
    truth = TrueStage(time, RNG.standard_normal(3), RNG.standard_normal(3), bodies)
    return Glance(truth, own, sightings, tracks, names, places).kept(-2.0)


def episode(**logs: PerceptionLog) -> Episode:
    times = np.array([0.0, 1.0])
    none = np.zeros(0)
    agent = AgentLog(
        *("one", "robot", 0.5, np.zeros((2, 2)), *np.zeros((3, 2)), (), 0.5, 0.5, np.nan, 0),
        *(CommandLog(none, none, np.zeros((0, 2)), none, none), ()),
    )
    return Episode(times, (agent,), "goals", 0.25, 0, perception=logs)


def same(one: Any, other: Any) -> bool:
    """Whether two values are the same to the last bit."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=True) and one.shape == other.shape
    if is_dataclass(one):
        names = [entry.name for entry in fields(one)]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    return bool(one == other)


def test_a_log_is_read_again_to_the_same_values() -> None:
    logs = {
        "one": PerceptionLog(
            (glance(0.1, 2, 30), glance(0.2, 0, 0, "the scan is empty"), glance(0.3, 3, 7)),
            {"the scan is empty": 1},
            (
                PipelineStop(0.15, 0.25, "lidar: nothing"),
                PipelineStop(0.4, 1.0, "pushed over: 90 degrees"),
            ),
        ),
        "two": PerceptionLog((glance(0.15, 0, 4),)),
        "three": PerceptionLog(),
    }
    written = episode(**logs).to_bytes()
    found = Episode.from_bytes(written)
    assert same(found.perception, logs)
    assert found.to_bytes() == written
    assert not same(glance(0.1, 2, 30), logs["one"].glances[0])  # the comparison can fail


def test_what_is_kept_has_the_clock_of_the_episode() -> None:
    one = glance(0.1, 2, 8)
    assert one.own.time == pytest.approx(0.1) and one.sightings.time == pytest.approx(0.09)
    assert all(track.seen == pytest.approx(-0.1) for track in one.obstacles)
    assert np.abs(1e3 * one.points - np.rint(1e3 * one.points)).max() < 1e-6


def test_a_scan_is_small_in_a_file() -> None:
    count, beams = 50, 360
    bare = len(episode().to_bytes())
    log = PerceptionLog(tuple(glance(0.1 * k, 1, beams) for k in range(count)))
    per_scan = (len(episode(one=log).to_bytes()) - bare) / count
    assert per_scan < 4000.0  # as numbers: 16 bytes per point, 8600 with those that are static


def test_the_glance_of_an_instant_is_the_newest() -> None:
    log = PerceptionLog((glance(0.1, 0, 0), glance(0.2, 0, 0)))
    assert log.at(0.05) is None and log.at(0.1) is log.glances[0] and log.at(9.0) is log.glances[1]


def test_who_is_who_goes_by_the_nearest_pair() -> None:
    bodies = [
        TrueBody(name, np.array([x, 0.0]), np.zeros(2), 0.3) for name, x in (("a", 0), ("b", 1))
    ]
    places = [np.array([0.6, 0.0]), np.array([0.9, 0.0]), np.array([5.0, 0.0])]
    assert named(places, ["1", "2", "3"], bodies) == {"1": "a", "2": "b", "3": ""}
    assert named([], [], bodies) == {} and named(places[:1], ["1"], []) == {"1": ""}


def off(aside: float) -> list[Glance]:
    """One body 5 m ahead, beliefs off by 0.3 m with covariances that say 0.1 m, its track more."""
    glances = []
    for k in range(1, 11):
        time, place = 0.1 * k, np.array([5.0, 0.1 * k])
        body = TrueBody("b", place, np.array([0.0, 1.0]), 0.4)
        truth = TrueStage(time, np.array([0.1 * k, 0.0, 0.0]), np.zeros(3), (body,))
        own = MotionEstimate(time, np.array([0.1 * k, 0.3, *np.zeros(4)]), 0.01 * np.eye(6))
        shifted = place + np.array([0.3, 0.3]) - 0.02 * body.velocity
        sightings = Sightings(
            *(time, shifted[None], 0.01 * np.eye(2)[None], np.array([0.4])),
            times=np.array([time - 0.02]),
        )
        state = np.concatenate([place + np.array([0.0, aside]), body.velocity])
        track = TrackedObstacle("7", time, state, 0.01 * np.eye(4), 0.4, time)
        ghost = TrackedObstacle("8", time, state + 9.0, 0.01 * np.eye(4), 0.4, time)
        names = {"7": "b", "8": ""}
        glances.append(Glance(truth, own, sightings, (track, ghost), names, np.zeros((0, 2))))
    return glances


def test_measures_of_a_belief_that_is_off_by_known_amounts() -> None:
    glances = off(0.6)
    stops = (PipelineStop(0.2, 0.7, "later"), PipelineStop(-1.0, 0.1, "first"))
    row = perception_row(episode(one=PerceptionLog(tuple(glances), {}, stops)))
    assert row["own_error"] == pytest.approx(0.3) and row["own_nees"] == pytest.approx(9.0)
    assert row["drift"] == pytest.approx(0.3 / 0.9)
    # Seen from its own frame, which lies 0.3 m aside: the errors of sight are what is left.
    assert row["detection_error"] == pytest.approx(0.3)
    assert row["detection_nees"] == pytest.approx(9.0)
    assert row["track_error"] == pytest.approx(0.3) and row["track_nees"] == pytest.approx(9.0)
    assert row["speed_error"] == pytest.approx(0.0) and row["identities"] == 1.0
    coverages = [row[f"{stage}_coverage"] for stage in ("own", "detection", "track")]
    assert coverages == [0.0, 0.0, 1.0]  # 9 against 7.8, 6.0 and 9.5
    assert row["false_tracks"] == pytest.approx(0.5)
    assert row["stopped"] == pytest.approx(0.6) and row["stop_reason"] == "first"


def test_a_track_is_judged_by_its_four_numbers_and_a_ghost_alone_is_false() -> None:
    """0.32 m: 10.2, against 9.5 of four degrees of freedom and 11.1 of five."""
    glances = off(0.62)
    row = perception_row(episode(one=PerceptionLog(tuple(glances), {})))
    assert row["track_nees"] == pytest.approx(10.24) and row["track_coverage"] == 0.0
    ghost = replace(glances[0], obstacles=glances[0].obstacles[1:], names={"8": ""})
    assert perception_row(episode(one=PerceptionLog((ghost,), {})))["false_tracks"] == 1.0


def test_without_perception_there_is_nothing_to_measure() -> None:
    with pytest.raises(WideberthError, match="run it in a WheeledWorld"):
        perception_row(episode())


def test_a_speed_that_nobody_measured_has_no_error() -> None:
    one = glance(0.1, 2, 2)
    still = np.zeros((4, 4))
    still[:2, :2] = 0.01 * np.eye(2)
    told = tuple(replace(track, covariance=still) for track in one.obstacles)
    row = perception_row(episode(one=PerceptionLog((replace(one, obstacles=told),), {})))
    assert np.isnan(row["speed_error"]) and np.isfinite(row["track_error"])
