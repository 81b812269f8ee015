"""The scripts in examples/ run, say so, and draw a picture."""

import runpy
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from wideberth.controllers.policy import Policy
from wideberth.framework.plugins import registry
from wideberth.framework.plugins.config import build

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture
def alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty working folder, and a process that forgets what a script registers or draws."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    from matplotlib import pyplot

    monkeypatch.setattr(registry, "_registered", {room: {} for room in registry.ROOMS})
    monkeypatch.syspath_prepend(str(EXAMPLES))
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    pyplot.close("all")


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
def test_an_example_runs_and_draws(
    name: str, picture: str, words: str, alone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert words in capsys.readouterr().out
    assert is_picture(alone / picture)


def test_the_learning_example_learns_to_give_way(
    alone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("gymnasium")
    example = import_module("learn_policy")
    scenario = {"type": "crossing_field", "walkers": 4, "reach": 4.0}
    world = example.gymnasium.make(example.WORLD, robot=example.ROBOT, scenario=scenario)
    straight, learnt = (
        example.mean_reward(weights, world, [0]) for weights in (example.STRAIGHT, example.LEARNT)
    )
    assert learnt > straight - 0.01
    example.learn(tries=1, learning=[0], testing=[3])
    assert "learnt: Weights(pull=" in capsys.readouterr().out
    assert is_picture(alone / "learn_policy.png")
    robot = build("robots", example.ROBOT)
    assert Policy(robot, "learn_policy:policy").policy == "learn_policy:policy"


def is_picture(file: Path) -> bool:
    return file.read_bytes().startswith(b"\x89PNG") and file.stat().st_size > 10_000
