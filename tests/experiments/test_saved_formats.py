"""What was saved opens: files of the first version of each format, and what they hold.

Nobody may change a format unnoticed: where a new version is written, its reader still reads these.
"""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth import build, load_plugin, open_result
from wideberth.controllers.diagnosis.solve_record import SolveRecord, read_solve, write_solve
from wideberth.draw.plans import kept_out
from wideberth.experiments.engine.result import Result
from wideberth.framework.plugins.config import describe, save_plugin
from wideberth.framework.values.plan import Rung, Status
from wideberth.simulation.log.episode_log import Episode
from wideberth.tests.helpers.saved import SAVED


@pytest.fixture(scope="module")
def result() -> Result:
    return open_result(SAVED / "result")


def test_a_result_opens_with_its_tables(result: Result) -> None:
    (row,) = result.rows
    assert (row["planner"], row["seed"], row["ended"]) == ("default", 0, "time limit")
    assert (row["duration"], row["plans"], row["coverage"]) == (3.0, 12, 1.0)
    assert row["clearance"] == 8.690819329819409 and row["success"] is False
    assert list(result.tables) == ["summary", "table", "times"] and len(result.times) == 2
    assert result.names() == ["run-default-0.npz"] and list(result.episodes) == ["run-default-0"]


def test_a_results_config_builds_its_study(result: Result) -> None:
    """Options that a later version adds have their defaults; those that are stored are kept."""
    stored = {key: value for key, value in result.config.items() if key != "plugins"}
    again = describe(build("experiments", stored))
    assert again["type"] == "encounter"
    assert holds(again, json.loads(json.dumps(stored)))


def holds(config: Any, stored: Any) -> bool:
    """Whether a config says everything that a stored one says."""
    if isinstance(stored, dict):
        return isinstance(config, dict) and all(holds(config.get(k), stored[k]) for k in stored)
    if isinstance(stored, list):
        return len(config) == len(stored) and all(map(holds, config, stored))
    return bool(config == stored)


def test_an_episode_opens_with_its_plans(result: Result) -> None:
    episode = result.episodes["run-default-0"]
    assert [log.name for log in episode.robots] == ["lower", "upper"]
    log = episode.robots[0]
    assert len(log.plans) == 6 and log.positions.shape[1] == 2
    plan = log.plans[-1]
    assert plan.status is Status.SOLVED and plan.rung is Rung.OPTIMAL
    assert plan.states.shape == (16, 5) and plan.ids == ("upper",) == plan.tracked
    assert plan.forecast is not None and plan.forecast.mean.shape == (1, 1, 15, 2)
    (rims,) = kept_out(plan, plan.situation, [0, 14]).values()
    assert rims.shape == (2, 64, 2) and np.isfinite(rims).all()


def test_an_episode_is_written_as_it_was() -> None:
    data = (SAVED / "result" / "files" / "run-default-0.npz").read_bytes()
    stored, written = (arrays(part) for part in (data, Episode.from_bytes(data).to_bytes()))
    assert stored.keys() == written.keys()
    for name, value in stored.items():
        np.testing.assert_array_equal(value, written[name], err_msg=name)


def arrays(data: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data)) as file:
        return {name: file[name] for name in file.files}


def test_a_solve_opens_and_is_written_as_it_was(tmp_path: Path) -> None:
    solve: SolveRecord = read_solve(SAVED / "solve.json")
    assert solve.planner["type"] == "mpc" and solve.names == ("walker",)
    assert len(solve.guesses) == len(solve.ends)
    write_solve(tmp_path / "solve.json", solve)
    same_text(SAVED / "solve.json", tmp_path / "solve.json")
    stored, written = (arrays((at / "solve.npz").read_bytes()) for at in (SAVED, tmp_path))
    assert stored.keys() == written.keys()
    assert all(np.array_equal(stored[name], written[name], equal_nan=True) for name in stored)


def test_a_fitted_predictor_opens_and_is_written_as_it_was(tmp_path: Path) -> None:
    predictor = load_plugin(SAVED / "predictor.json", "predictor")
    assert describe(predictor)["base"]["fitted"]["dt"] == 0.4
    save_plugin(tmp_path / "predictor.json", "predictor", predictor)
    same_text(SAVED / "predictor.json", tmp_path / "predictor.json")


def same_text(stored: Path, written: Path) -> None:
    assert json.loads(written.read_text()) == json.loads(stored.read_text())


@pytest.mark.parametrize("name", ["solve.json", "predictor.json", "result/provenance.json"])
def test_the_files_are_of_the_first_version(name: str) -> None:
    assert json.loads((SAVED / name).read_text())["version"] == 1
