"""DynaBARN: the shipped key frames, the motion, the phases and the verdict."""

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from wideberth.experiments.engine.closed_loop import play
from wideberth.framework.plugins.config import build
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.path import Path as Way
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.log.episode_log import Episode
from wideberth.simulation.scenarios.placing import wall_distance
from wideberth.simulation.sensing.channel import Channel
from wideberth_arenas.scenarios.dynabarn import (
    WORLDS,
    DynaBarn,
    keys_of,
    obstacles_of,
    place_at,
)

JACKAL = {
    "type": "differential_drive", "radius": 0.334, "track_width": 0.3756, "max_speed": 2.0,
    "max_wheel_speed": 2.7512, "max_wheel_acceleration": 24.695, "max_yaw_rate": 4.0,
    "max_acceleration": 20.0, "max_yaw_acceleration": 25.0,
}  # fmt: skip
SETTINGS = Settings(
    time_limit=100.0, plant_step=0.02, history=0.0, channel=Channel(noise=0.0),
    goal_tolerance=1.0, stop_on_collision=True, deadlock_after=101.0,
)  # fmt: skip
ALL = sorted({name for world in range(60) for name in obstacles_of(world)})


def golden(folder: Path) -> Any:
    return json.loads((folder / "dynabarn.json").read_text(encoding="utf-8"))


def test_positions_are_the_golden_ones(dense_folder: Path) -> None:
    samples = golden(dense_folder)["golden_positions"]["samples"]
    assert samples
    for one in samples:
        asked = np.array([one["time_s"]])
        found = [place_at(keys_of(name), asked)[0] for name in obstacles_of(one["world"])]
        np.testing.assert_allclose(found, one["positions_m"], rtol=0.0, atol=1e-8)


def test_shipped_data_are_those_given(dense_folder: Path) -> None:
    """Where the folder holds the key frames as well, all of them; else their own checks below."""
    given = golden(dense_folder)
    for world, names in enumerate(given.get("worlds", [])):
        assert obstacles_of(world) == tuple(names)
    for name, keys in given.get("obstacles", {}).items():
        np.testing.assert_array_equal(keys_of(name), np.array(keys, float).T / 100.0)
    assert given["goal_m"] == DynaBarn().cast(0).placements[0].path.goal.tolist()


def test_key_frames_have_the_speeds_of_their_tier() -> None:
    """Length over duration of all 4508 segments is a multiple of 0.1 m/s within the rounding."""
    counts = {"easy": 179, "medium": 342, "hard": 442}
    lowest = {"easy": 0.5, "medium": 1.0, "hard": 1.5}
    assert len(ALL) == 469
    for tier, count in counts.items():
        worlds = [obstacles_of(world) for world in WORLDS[tier]]  # type: ignore[index]
        assert sum(map(len, worlds)) == count
        assert all(len(set(world)) == len(world) for world in worlds)
    segments = 0
    for name in ALL:
        keys = keys_of(name)
        step = np.diff(keys, axis=0)
        assert keys[0, 0] == 0.0 and (step[:, 0] > 0.0).all()
        assert np.abs(keys[:, 1:]).max() <= 10.0
        length = np.hypot(step[:, 1], step[:, 2])
        speed = length / step[:, 0]
        slow = lowest[name.partition("/")[0]]
        nearest = np.clip(np.round(10.0 * speed), 10 * slow, 10 * slow + 4) / 10.0
        rounding = (np.sqrt(2.0) * 0.01 + nearest * 0.01) / step[:, 0]
        assert (np.abs(speed - nearest) <= rounding).all(), name
        segments += len(step)
    assert segments == 4508


def hermite(keys: np.ndarray) -> CubicHermiteSpline:
    """The loop by another implementation, over the number of the key."""
    points = keys[:, 1:]
    if np.abs(points[0] - points[-1]).max() < 1e-3:
        ends = np.tile(0.5 * (points[1] - points[-2]), (2, 1))
    else:
        ends = 0.5 * np.stack([points[1] - points[0], points[-1] - points[-2]])
    inner = 0.5 * (points[2:] - points[:-2])
    return CubicHermiteSpline(np.arange(len(keys)), points, np.vstack([ends[:1], inner, ends[1:]]))


def test_the_motion_is_a_uniform_catmull_rom_spline() -> None:
    rng = np.random.default_rng(0)
    for name in ALL[::7]:
        keys = keys_of(name)
        times = rng.uniform(0.0, 3.0 * keys[-1, 0], 50)
        within = np.fmod(times, keys[-1, 0])
        number = np.interp(within, keys[:, 0], np.arange(len(keys)))
        np.testing.assert_allclose(place_at(keys, times), hermite(keys)(number), atol=1e-9)


def test_obstacles_dart() -> None:
    """378 of 469 exceed 3 m/s somewhere, 126 exceed 10 m/s, the worst 77 m/s; 31 are closed."""
    fastest, closed = [], 0
    shares = np.linspace(1e-4, 1.0 - 1e-4, 201)
    for name in ALL:
        keys = keys_of(name)
        duration = np.diff(keys[:, 0])[:, None]
        slope = hermite(keys).derivative()(np.arange(len(keys) - 1)[:, None] + shares)
        speed = np.hypot(slope[..., 0], slope[..., 1]) / duration
        times, small = (
            keys[:-1, :1] + shares * duration,
            np.broadcast_to(1e-5 * duration, speed.shape),
        )
        ahead, behind = (place_at(keys, (times + k * small).ravel()) for k in (1, -1))
        found = np.hypot(*(ahead - behind).T).reshape(speed.shape) / (2.0 * small)
        np.testing.assert_allclose(found, speed, rtol=1e-3, atol=1e-3)
        fastest.append(speed.max())
        closed += np.abs(keys[0, 1:] - keys[-1, 1:]).max() < 1e-3
    assert sum(value > 3.0 for value in fastest) == 378
    assert sum(value > 10.0 for value in fastest) == 126
    assert round(max(fastest)) == 77 and closed == 31


def test_every_lap_is_somebody_else() -> None:
    scenario = DynaBarn()
    cast, tau = scenario.cast(450), scenario.phase(450)
    names = obstacles_of(45)
    assert {one.name.partition(" (")[0] for one in cast.bystanders} == {
        f"obstacle {number}" for number in range(1, len(names) + 1)
    }
    rng = np.random.default_rng(1)
    times = np.append(rng.uniform(-5.0, 100.0, 300), [-5.0, 0.0, 100.0])
    for number, name in enumerate(names, start=1):
        keys = keys_of(name)
        laps = [one for one in cast.bystanders if one.name.split()[1] == str(number)]
        assert all(isinstance(one, ReplayAgent) and one.radius == 0.5 for one in laps)
        places = np.stack([one.at(times) for one in laps])
        there = np.isfinite(places[..., 0])
        assert (there.sum(axis=0) == 1).all()
        away = np.linalg.norm(np.nansum(places, axis=0) - place_at(keys, times + tau), axis=1)
        assert np.median(away) < 1e-3 and away.max() < 0.6  # chords of 0.02 s
        lap = np.argmax(there, axis=0)
        np.testing.assert_array_equal(lap, (times + tau) // keys[-1, 0] - (tau - 5) // keys[-1, 0])


def test_seeds_choose_world_and_phase() -> None:
    assert [DynaBarn().case(s) for s in (0, 9, 10, 599, 600)] == [
        (0, 0), (0, 9), (1, 10), (59, 599), (0, 600),
    ]  # fmt: skip
    assert [DynaBarn(tier="hard").case(s) for s in (0, 199, 200)] == [
        (40, 400), (59, 599), (40, 1000),
    ]  # fmt: skip
    later = 0
    for seed in range(0, 600, 3):
        drawn = float(np.random.default_rng(seed).uniform(5.0, 105.0))
        tau = DynaBarn().phase(seed)
        assert tau == drawn or (tau - drawn) % 1.0 == pytest.approx(0.0, abs=1e-9)
        later += tau != drawn
        clock = tau + np.arange(0.0, 1.01, 0.02)
        for name in obstacles_of(seed // 10):
            apart = place_at(keys_of(name), clock) - [11.0, 0.0]
            assert np.hypot(*apart.T).min() >= 0.834
    assert 0 < sum(DynaBarn().phase(s) > drawn_phase(s) for s in range(600)) < 20
    assert DynaBarn(tier="medium").phase(7) == DynaBarn().phase(207)


def drawn_phase(seed: int) -> float:
    return float(np.random.default_rng(seed).uniform(5.0, 105.0))


def driven(scenario: DynaBarn, seed: int, **changes: Any) -> Episode:
    robot = build("robots", JACKAL)
    config = {"type": "pure_pursuit", "robot": robot, "reference_speed": 1.25, "period": 0.1}
    controller = build("controllers", config)
    return play(scenario, robot, controller, replace(SETTINGS, **changes), seed)


def test_verdicts() -> None:
    """A collision with an obstacle, an arrival, and a time limit; each with its row."""
    easy = DynaBarn(tier="easy")
    arrived = driven(easy, 0)
    row = easy.judge(arrived)
    assert row["outcome"] == "success" and row["time_s"] == arrived.robots[0].reached
    assert row["score"] == 10.0 / max(row["time_s"], 20.0) and row["touched"] == ""
    medium = DynaBarn(tier="medium")
    hit = driven(medium, 0)
    row = medium.judge(hit)
    assert hit.ended == "collision" and row["time_s"] == hit.duration
    assert (row["outcome"], row["touched"], row["score"]) == ("collision", "obstacle", 0.0)
    here = hit.robots[0].positions[-1]
    touching = [
        one
        for one in hit.agents
        if one.kind == "replay" and np.hypot(*(one.positions[-1] - here)) < 0.834
    ]
    assert len(touching) == 1
    moved = np.hypot(*(touching[0].positions[-1] - touching[0].positions[-2]))
    assert row["contact_speed_m_s"] == pytest.approx(moved / 0.02, rel=1e-6)
    assert row["darted"] == (moved / 0.02 > 3.0)
    cut = easy.judge(driven(easy, 0, time_limit=3.0))
    assert (cut["outcome"], cut["time_s"], cut["score"]) == ("timeout", 3.0, 0.0)


def test_walls_are_touched() -> None:
    robot = build("robots", JACKAL)
    controller = build("controllers", {"type": "constant_velocity", "robot": robot})
    scenario = DynaBarn()
    walls = scenario.cast(0).polygons
    way = Way(np.array([[5.0, 8.0], [5.0, 13.0]]))
    agent = RobotAgent("robot", robot, controller, way, 0.0, reference_speed=1.0)
    episode = run_episode([agent], replace(SETTINGS, time_limit=30.0), polygons=walls)
    row = scenario.judge(episode)
    assert (row["outcome"], row["touched"], row["contact_speed_m_s"]) == (
        "collision",
        "wall",
        None,
    )
    assert episode.robots[0].positions[-1, 1] == pytest.approx(9.75 - 0.334, abs=0.03)
    for place, room in (((-9.0, 0.0), 0.75), ((0.0, 9.0), 0.75), ((0.0, -9.0), 0.75)):
        assert wall_distance(np.array(place), walls) == pytest.approx(room)


def test_the_licence_is_shipped_with_the_data() -> None:
    data = files("wideberth_arenas").joinpath("scenarios")
    text = data.joinpath("dynabarn_MIT.txt").read_text(encoding="utf-8")
    assert text.startswith("MIT License") and "Copyright (c) 2022 Zifan Xu" in text
    assert "Zifan Xu" in data.joinpath("dynabarn.json").read_text(encoding="utf-8")


def test_bad_input_gives_one_clear_error() -> None:
    for config, words in (
        ({"tier": "harder"}, "tier"),
        ({"world": 3}, "world"),
    ):
        with pytest.raises(WideberthError, match=words):
            build("scenarios", {"type": "dynabarn", **config})
    with pytest.raises(WideberthError, match="seed"):
        DynaBarn().cast(-1)
