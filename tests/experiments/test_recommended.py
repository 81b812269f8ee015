"""The recommended planner stands in one file, which configs and the game predictor read."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from wideberth import recommended
from wideberth.controllers import Withdrawing
from wideberth.experiments.engine.provenance import keys
from wideberth.experiments.engine.shipped_configs import config_path, read_experiment, shipped
from wideberth.experiments.studies.encounter import Encounter
from wideberth.experiments.studies.tuning import Tuning
from wideberth.framework.controller import WrapsController
from wideberth.framework.mpc.planner.planner import planner_behind
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.yamlfile import dump, parse, shared_settings
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.game import Game


def test_configs_and_the_game_take_the_same_planner() -> None:
    among_robots = {"predictor": {"type": "kalman", "acceleration_density": 0.01}}
    settings = {**shared_settings("recommended"), "robot": "unicycle", **among_robots}
    built = build("controllers", settings)
    assert describe(Game().planner) == describe(built)
    crossing, _ = read_experiment("crossing", [])
    assert isinstance(crossing, Encounter)
    assert describe(crossing.planners["default"]) == describe(built)
    texts = [config_path(name).read_text() for name in shipped()]
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


ROBOTS = (
    "unicycle", "bicycle", "holonomic_velocity", "holonomic_3d",
    {"type": "unicycle", "radius": 0.3, "max_speed": 2.0, "max_yaw_rate": 1.0},
)  # fmt: skip
VARIATIONS: tuple[dict[str, Any], ...] = (
    {},
    {"predictor": {"type": "kalman", "acceleration_density": 0.01}},
    {"solver": {"type": "fatrop", "iterations": 50}, "starts": "auto"},
    {"horizon": 12, "dt": 0.2},
    {"region": "minkowski_sum", "level": {"type": "relaxed", "tail": 0.1}, "margin": 0.2},
    {"cost": {"weights": {"position": 50.0}}},
    {"cost": {"type": "contouring"}},
)
"""Settings beside robot and speed: one part, and several at once."""


@pytest.mark.parametrize("robot", ROBOTS, ids=str)
@pytest.mark.parametrize("speed", [None, 0.3, 1.2])
def test_yaml_and_python_make_the_same_planner(robot: Any, speed: float | None) -> None:
    stated = {} if speed is None else {"reference_speed": speed}
    for settings in VARIATIONS:
        if robot == "holonomic_3d" and "solver" in settings:
            continue
        text = dump({"<<": "recommended", "robot": robot, **stated, **settings})
        text = text.replace("'<<'", "<<")
        read = build("controllers", parse(text, "here"))
        called = recommended(robot, speed, quiet=True, **settings)
        assert describe(read) == describe(called), settings


def test_a_weight_of_the_cost_leaves_the_others_as_they_follow_from_the_speed() -> None:
    weights = recommended(speed=1.0, quiet=True).cost.weights  # type: ignore[attr-defined]
    heavy = {"weights": {"position": 50.0}}
    for cost in (heavy, {"type": "tracking", **heavy}):
        changed = recommended(speed=1.0, quiet=True, cost=cost)
        assert changed.cost.weights == replace(weights, position=50.0)  # type: ignore[attr-defined]


STUDY = """
type: tuning
scenario: {type: crossing_field, walkers: 1}
robot: unicycle
planner: PLANNER
factors:
  KEYreference_speed: [0.3, 0.6]
  KEYdt: [0.25]
  KEYpredictor: [kalman]
  KEYcost.weights.position: [50.0]
  KEYhorizon: [20]
"""


@pytest.mark.parametrize("wrapper", ["", "withdrawing", "around_crowds"])
def test_a_study_varies_what_recommended_returns(wrapper: str, tmp_path: Path) -> None:
    planner = "{<<: recommended, robot: unicycle}"
    if wrapper:
        planner = f"{{type: {wrapper}, controller: {planner}}}"
    text = STUDY.replace("PLANNER", planner).replace("KEY", "controller." if wrapper else "")
    file = tmp_path / "mine.yaml"
    file.write_text(text)
    study, _ = read_experiment(str(file), [])
    assert isinstance(study, Tuning)
    begin = "controller." if wrapper else ""
    wanted = {
        (f"{begin}reference_speed", "0.3"): {"speed": 0.3},
        (f"{begin}reference_speed", "0.6"): {"speed": 0.6},
        (f"{begin}dt", "0.25"): {"dt": 0.25},
        (f"{begin}predictor", "kalman"): {"predictor": "kalman"},
        (f"{begin}cost.weights.position", "50"): {"cost": {"weights": {"position": 50.0}}},
        (f"{begin}horizon", "20"): {"horizon": 20},
    }
    found = study.variants()
    assert list(found) == [("base", ""), *wanted]
    for key, settings in wanted.items():
        called = recommended(build("robots", "unicycle"), quiet=True, **settings)
        for made in (found[key], study.variant(*key)):
            inner = planner_behind(made)
            assert inner is not None and describe(inner) == describe(called), key
            assert isinstance(made, WrapsController) == bool(wrapper)
    assert describe(build("experiments", describe(study))) == describe(study)
    assert {*keys(study.base)} <= {*keys(study)}  # what the config alone names is cited too


@pytest.mark.parametrize("name", ["dynamic_matters", "conservativeness", "crowdnav_parts"])
def test_parts_of_a_wrapped_planner_are_exchanged(name: str) -> None:
    study: Any = read_experiment(name, [])[0]
    bare = study.controllers()
    wrapped = replace(study, planner=Withdrawing(study.planner)).controllers()
    assert [*bare] == [*wrapped]
    for key, made in wrapped.items():
        assert isinstance(made, Withdrawing)
        assert describe(made.controller) == describe(bare[key])
