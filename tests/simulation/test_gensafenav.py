"""GenSafeNav's crowd: every outcome of its own logs, and people of other kinds."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.simulation.crowds.crowdnav_plus import CrowdNavPlusCrowd
from wideberth.simulation.scenarios.crowdnav_plus import CASES, CrowdNavPlus
from wideberth.tests.oracles.crowd_robots import plus_played

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
        shift = "none" if run["people"] == "orca" else run["people"]
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
