"""The recommended planner stands in one file, which configs and the game predictor read."""

import pytest

from wideberth.experiments.engine.shipped_configs import CONFIGS, read_experiment, shipped
from wideberth.experiments.studies.encounter import Encounter
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.yamlfile import parse, shared_settings
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.game import Game


def test_configs_and_the_game_take_the_same_planner() -> None:
    among_robots = {"predictor": {"type": "kalman", "acceleration_density": 0.01}}
    settings = {**shared_settings("recommended"), "robot": "unicycle", **among_robots}
    recommended = build("controllers", settings)
    assert describe(Game().planner) == describe(recommended)
    crossing, _ = read_experiment("crossing", [])
    assert isinstance(crossing, Encounter)
    assert describe(crossing.planners["default"]) == describe(recommended)
    texts = [(CONFIGS / f"{name}.yaml").read_text() for name in shipped()]
    assert sum("<<: recommended" in text for text in texts) >= 13


def test_what_stands_beside_it_wins() -> None:
    found = parse("{<<: recommended, margin: 0.3, level: fixed}", "here")
    assert found == {**shared_settings("recommended"), "margin": 0.3, "level": "fixed"}
    nested = parse("a: &a {<<: recommended, margin: 0.3}\nb: {<<: *a, margin: 0.4}", "here")
    assert (nested["a"]["margin"], nested["b"]["margin"]) == (0.3, 0.4)
    assert nested["b"]["solver"] == found["solver"]


@pytest.mark.parametrize("name", ["recomended", "3", "../recommended", "''"])
def test_an_unknown_name_is_refused(name: str) -> None:
    with pytest.raises(WideberthError, match=r"line 1.*unknown shared settings.*recommended"):
        parse(f"planner: {{<<: {name}}}", "here")
