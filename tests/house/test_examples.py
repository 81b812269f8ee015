"""The scripts in examples/ run as a user runs them, say so, and draw a picture."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from wideberth.controllers.policy import Policy
from wideberth.framework.plugins.config import build

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize(
    ("name", "picture", "words"),
    [
        ("my_predictor", "my_predictor.png", "Braking keeps the laws of a predictor"),
        ("my_region", "my_region.png", "Disc keeps every law of a region"),
        ("my_slot_kind", "my_slot_kind.png", "Carts keeps every law of a kind"),
        ("my_robot", "my_robot.png", "The plan is optimal"),
        ("my_rung", "my_rung.png", "The plan is on the rung slow down: solver: RuntimeError"),
        ("static_polygons", "gap.png", "The plan is optimal"),
    ],
)
def test_an_example_runs_and_draws(name: str, picture: str, words: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", str(EXAMPLES / f"{name}.py")],
        cwd=tmp_path, text=True, capture_output=True, timeout=240,
        env={**os.environ, "MPLBACKEND": "Agg"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert words in done.stdout
    assert is_picture(tmp_path / picture)


def test_the_learning_example_learns_to_give_way(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("gymnasium")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    example = import_module("learn_policy")
    scenario = {"type": "crossing_field", "walkers": 4, "reach": 4.0}
    world = example.gymnasium.make(example.navigation.ID, robot=example.ROBOT, scenario=scenario)
    straight, learnt = (
        example.mean_reward(weights, world, [0]) for weights in (example.STRAIGHT, example.LEARNT)
    )
    assert learnt > straight - 0.01
    example.learn(tries=1, learning=[0], testing=[3])
    assert "learnt: Weights(pull=" in capsys.readouterr().out
    assert is_picture(tmp_path / "learn_policy.png")
    robot = build("robots", example.ROBOT)
    assert Policy(robot, "learn_policy:policy").policy == "learn_policy:policy"


def is_picture(file: Path) -> bool:
    return file.read_bytes().startswith(b"\x89PNG") and file.stat().st_size > 10_000
