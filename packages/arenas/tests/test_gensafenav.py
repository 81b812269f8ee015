"""GenSafeNav's crowd: every outcome of its own logs, and people of other kinds."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.packages.arenas.tests.oracles.crowd_robots import plus_played
from wideberth_arenas.crowds.crowdnav_plus import CrowdNavPlusCrowd
from wideberth_arenas.crowds.gensafenav import RUSHING_SHARE, RUSHING_SPEED, Groups, Shift
from wideberth_arenas.scenarios.crowdnav_plus import CASES, CrowdNavPlus

pytest.importorskip("pyrvo")
ROBOTS = {"orca": "orca", "social_force": "social_force", "sf": "social_force"}
"""Row of a log -> robot of ours; the others of a log are learned."""
LOGGED = CrowdNavPlus(variant="gensafenav", seed=425)
"""The cases of the rows that are reproduced; the learned GenSafeNav has those of seed 42."""


def logged(folder: Path) -> dict[str, dict[str, Any]]:
    found = json.loads((folder / "gensafenav_logs.json").read_text(encoding="utf-8"))
    return {name: found[name] for name in ROBOTS if name in found}


def played(log: dict[str, Any], robot: str, evaluations: range) -> list[CrowdNavPlusCrowd]:
    """Play these evaluations, with outcomes that are those of the log."""
    crowds = [plus_played(LOGGED, k, ROBOTS[robot]) for k in evaluations]
    for k, crowd in zip(evaluations, crowds, strict=True):
        assert (crowd.verdict.outcome == "collision") == (k in log["collision_cases"]), k
        assert (crowd.verdict.outcome == "timeout") == (k in log["timeout_cases"]), k
    return crowds


def test_first_cases_end_as_in_the_logs(others_folder: Path) -> None:
    assert logged(others_folder)
    for robot, log in logged(others_folder).items():
        played(log, robot, range(12))


@pytest.mark.slow
def test_the_published_rows_to_the_printed_digit(others_folder: Path) -> None:
    """All 250 cases; the printed way goes on from the last state to the next case's start."""
    for robot, log in logged(others_folder).items():
        crowds = played(log, robot, range(250))
        ways = [way_as_printed(k, crowd) for k, crowd in enumerate(crowds)]
        rows = [crowd.verdict_row() for crowd in crowds]
        near = [row["intrusion_distance_m"] or 0.0 for row in rows]
        steps = [row["danger_steps"] for row in rows]
        found = {
            "nav_time_s": np.mean([row["time_s"] for row in rows if row["outcome"] == "success"]),
            "path_length_m": np.mean(ways),
            "intrusion_percent": np.mean([row["intrusion_percent"] for row in rows]),
            "min_distance_during_intrusions_m": np.average(near, weights=steps),
        }
        for name in ("success", "collision", "timeout"):
            found[name] = np.mean([row["outcome"] == name for row in rows])
        for name, value in found.items():
            assert round(float(value), 4) == log[name], (robot, name)


def way_as_printed(evaluation: int, crowd: CrowdNavPlusCrowd) -> float:
    following = CrowdNavPlus(variant="gensafenav", seed=425, cases="all")
    (placement,) = following.cast((LOGGED.case(evaluation) + 1) % CASES).placements
    return float(crowd.verdict.way + np.hypot(*(placement.path.points[0] - crowd.robot)))


def test_cases_end_as_in_runs_of_the_original(others_folder: Path) -> None:
    """Also where people walk by social force, which no log has."""
    path = others_folder / "gensafenav_runs.json"
    if not path.exists():
        pytest.skip("the folder has no runs")
    for run in json.loads(path.read_text(encoding="utf-8"))["runs"]:
        shift: Shift = "none" if run["people"] == "orca" else "social_force"
        scenario = CrowdNavPlus("gensafenav", run["seed"], cases="all", shift=shift)
        for known in run["rows"]:
            crowd = plus_played(scenario, known["case"], run["robot"])
            row = crowd.verdict_row()
            for name in ("outcome", "time_s", "steps", "danger_steps"):
                assert row[name] == known[name], (run["people"], known["case"], name)
            if row["danger_steps"]:
                near = pytest.approx(known["intrusion_distance_m"], abs=1e-5)
                assert row["intrusion_distance_m"] == near
            if "people_at_the_end" in known:
                np.testing.assert_allclose(
                    crowd.positions, known["people_at_the_end"], rtol=0.0, atol=1e-3
                )


def standing(shift: Shift, case: int = 0) -> CrowdNavPlusCrowd:
    """Return a case of validation whose robot has not moved."""
    return CrowdNavPlusCrowd(case, "gensafenav", 42, "validation", shift)


@pytest.mark.parametrize("shift", ["rushing", "social_force"])
def test_a_case_begins_as_without_a_shift(shift: Shift) -> None:
    np.testing.assert_array_equal(standing(shift).positions, standing("none").positions)


def test_some_rush_and_the_others_keep_to_their_speeds() -> None:
    crowds = [standing("rushing", case) for case in range(40)]
    rushing = np.concatenate([crowd.paces == RUSHING_SPEED for crowd in crowds])
    spread = np.sqrt(RUSHING_SHARE * (1.0 - RUSHING_SHARE) / len(rushing))
    assert abs(rushing.mean() - RUSHING_SHARE) < 3.0 * spread
    fastest = np.zeros(20)
    for crowd in crowds[:4]:
        for _ in range(8):
            crowd.step(crowd.robot)
            speed = np.hypot(*crowd.velocities.T)
            assert (speed < crowd.speeds + 1e-6).all()
            fastest = np.maximum(fastest, np.where(crowd.paces > 1.0, speed, 0.0))
    assert 1.95 < fastest.max() <= RUSHING_SPEED + 1e-6


def test_people_by_social_force_follow_its_equation() -> None:
    """Person by person, force by force."""
    crowd = standing("social_force")
    for _ in range(12):
        crowd.step(crowd.robot)
    for i in range(20):
        way = crowd.goals[i] - crowd.positions[i]
        force = way / np.hypot(*way) * crowd.speeds[i] - crowd.velocities[i]
        for j in set(range(20)) - {i}:
            apart = crowd.positions[i] - crowd.positions[j]
            distance = np.hypot(*apart)
            reach = crowd.radii[i] + crowd.radii[j] - distance
            force = force + 2.0 * np.exp(reach / 1.0) * apart / distance
        wanted = crowd.velocities[i] + 0.25 * force
        wanted *= min(1.0, crowd.speeds[i] / np.hypot(*wanted))
        np.testing.assert_allclose(
            crowd.ahead[i], crowd.positions[i] + 0.25 * wanted, rtol=0.0, atol=1e-12
        )


def test_groups_walk_turn_and_leave_together() -> None:
    apart, alone, left = [], 0, 0
    for case in range(4):
        crowd = standing("groups", case)
        led = Groups(np.random.default_rng(42 + case), 20).led
        assert sorted([*led, *(i for group in led.values() for i in group)]) == [*range(20)]
        assert all(len(group) < 4 for group in led.values())
        while crowd.time < 20.0:
            between, arrivals = crowd.goals.copy(), crowd.arrivals.copy()
            crowd.step(np.array([30.0, 30.0]))
            for leader, others in led.items():
                alone += not others
                for i in others:
                    assert crowd.arrivals[i] == crowd.arrivals[leader]
                    assert crowd.speeds[i] == crowd.speeds[leader]
                    if crowd.arrivals[i] == arrivals[i]:
                        now = crowd.goals[i] - crowd.goals[leader]
                        before = between[i] - between[leader]
                        np.testing.assert_allclose(now, before, rtol=0.0, atol=1e-12)
                    apart.append(np.hypot(*(crowd.positions[i] - crowd.positions[leader])))
        left += int(crowd.arrivals.sum())
    assert left and not alone
    assert np.median(apart) < 2.0 and np.quantile(apart, 0.95) < 5.0


def test_a_group_draws_in_who_is_too_far() -> None:
    """Of four people 2 m from their centre each is 0.5 m too far; of three at 1 m none is."""
    groups = Groups(np.random.default_rng(0), 7)
    groups.leaders[:] = [0, 0, 0, 0, 4, 4, 4]
    square = np.array([[2.0, 0.0], [0.0, 2.0], [-2.0, 0.0], [0.0, -2.0]])
    angles = 2.0 * np.pi * np.arange(3) / 3.0
    places = np.vstack([square, 9.0 + np.column_stack([np.cos(angles), np.sin(angles)])])
    pull = groups.pull(places)
    np.testing.assert_allclose(pull[:4], -0.25 * square, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(pull[4:], 0.0, rtol=0.0, atol=1e-12)


def test_the_share_between_members_of_a_group() -> None:
    """Inside means near a mean of its members with some weights; dense draws of them say so."""
    rng = np.random.default_rng(3)
    places = rng.uniform(-4.0, 4.0, (20, 2))
    groups = Groups(rng, 20)
    robots = rng.uniform(-4.0, 4.0, (60, 2))
    found = [groups.entered(places, robot, 0.3) for robot in robots]
    means = np.vstack(
        [
            rng.dirichlet(np.full(1 + len(led), 0.4), 4000) @ places[[leader, *led]]
            for leader, led in groups.led.items()
        ]
    )
    least = np.array([np.hypot(*(means - robot).T).min() for robot in robots])
    assert all(inside for inside, near in zip(found, least, strict=True) if near < 0.3)
    assert not any(inside for inside, near in zip(found, least, strict=True) if near > 0.35)
    assert 0 < sum(found) < 60
    crowd = standing("groups")
    crowd.step(crowd.positions[0])
    assert 0.0 < crowd.verdict_row()["group_percent"] <= 100.0
    assert "group_percent" not in standing("none").verdict_row()
