"""One call gives a planner that arrives, says what it chose, and names itself where keys lack."""

from dataclasses import fields
from importlib import import_module
from pathlib import Path as File
from typing import Any

import numpy as np
import pytest

from wideberth import Path, WideberthError, build, recommended
from wideberth.controllers.recommended import completed, slow_aside
from wideberth.experiments.cli.export import planners
from wideberth.experiments.engine.shipped_configs import read_experiment, shipped
from wideberth.framework.control.rate_limited_warnings import WARNINGS
from wideberth.framework.mpc.costs.base import Weights
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.planner.settings import PlannerSettings, doubts
from wideberth.framework.plugins.config import describe
from wideberth.framework.plugins.registry import load, names
from wideberth.framework.plugins.yamlfile import parse, shared_settings
from wideberth.robots.unicycle import Unicycle

OWN = {"type": "unicycle", "radius": 0.4, "max_speed": 0.8, "max_yaw_rate": 0.7}
"""A robot with limits of its own."""


def by_config(text: str) -> dict[str, Any]:
    """Return the resolved settings of a planner that a config states."""
    return describe(build("controllers", parse(text, "here")))


@pytest.mark.parametrize("speed", [None, 0.3, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("robot", names("robots"))
def test_a_config_and_the_function_make_the_same_planner(robot: str, speed: float | None) -> None:
    wanted = "" if speed is None else f", reference_speed: {speed}"
    found = by_config(f"{{<<: recommended, robot: {robot}{wanted}}}")
    assert found == describe(recommended(robot, speed, quiet=True))
    if speed is not None:
        k = max(speed / 0.5, 1.0)
        assert (found["dt"], found["horizon"]) == (0.5 / k, max(15, round(5.0 * k / 0.5)))
        assert found["cost"]["weights"]["acceleration"] == pytest.approx(1e4 / k**4)


def test_a_robot_with_limits_of_its_own_sets_the_speed() -> None:
    found = by_config(f"{{<<: recommended, robot: {OWN}}}")
    assert found == describe(recommended(OWN, quiet=True))
    assert found["robot"]["max_speed"] == 0.8 and found["reference_speed"] == 0.571  # 0.8 / 1.4
    assert found["dt"] == 0.5 / (0.571 / 0.5) and found["horizon"] == 15


def test_the_papers_robot_gets_the_papers_numbers() -> None:
    found = by_config("{<<: recommended, robot: unicycle}")
    paper = {field.name: field.default for field in fields(PlannerSettings)}
    for name in ("dt", "period", "track_dt", "horizon", "reference_speed"):
        assert found[name] == paper[name]
    assert found["cost"] == describe(Tracking())


def test_it_can_be_varied() -> None:
    found = by_config("{<<: recommended, robot: unicycle, predictor: imm, dt: 0.2}")
    assert found == describe(recommended("unicycle", quiet=True, predictor="imm", dt=0.2))
    assert (found["predictor"]["type"], found["horizon"]) == ("imm", 38)  # 7.5 s
    assert found["period"] == found["track_dt"] == 0.2
    assert found == by_config("{type: recommended, robot: unicycle, predictor: imm, dt: 0.2}")
    kept = by_config("{<<: recommended, robot: unicycle, dt: 0.2, horizon: 9, track_dt: 0.4}")
    assert (kept["horizon"], kept["period"], kept["track_dt"]) == (9, 0.2, 0.4)
    assert kept["predictor"]["type"] == "adaptive_conformal"  # the one of docs/choose.md


@pytest.mark.parametrize("cost", ["tracking", "contouring"])
def test_weights_that_are_not_stated_follow_the_speed(cost: str) -> None:
    for given in (cost, {"type": cost}, {"type": cost, "weights": {"position": 50.0}}):
        found = describe(recommended("unicycle", 1.0, quiet=True, cost=given))["cost"]
        position = 50.0 if "weights" in given else 100.0
        wanted = {"position": position, "speed": 2.5, "acceleration": 625.0}
        assert found["type"] == cost
        assert found["weights"] == {**wanted, "yaw_acceleration": 31.25}
    rates = [
        describe(recommended("unicycle", speed, quiet=True, cost="contouring"))["cost"]["rate"]
        for speed in (0.5, 1.0, 2.0)
    ]
    assert rates == [2000.0, 500.0, 125.0]  # s^2/m^2
    made = Tracking(Weights(position=7.0))
    assert recommended("unicycle", 1.0, quiet=True, cost=made).cost is made


def test_speed_and_reference_speed_together_are_refused() -> None:
    with pytest.raises(WideberthError, match=r"speed is 1.0 and reference_speed is 0.5"):
        recommended("unicycle", 1.0, quiet=True, reference_speed=0.5)


def test_a_step_in_milliseconds_is_doubted() -> None:
    (words,) = doubts(recommended("unicycle", 0.5, quiet=True, dt=250.0))
    assert words.startswith("dt is 250 s, 125 m a step") and words.endswith("250 ms are 0.25 s")
    assert not doubts(recommended("unicycle", 0.5, quiet=True))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            "robot: {type: unicycle}, reference_speed: 1.0",
            "reference_speed is 1 m/s.*at most 0.7",
        ),
        ("robot: unicycle, reference_speed: -1.0", "planner.reference_speed is -1"),
        (
            "robot: unicycle, reference_speed: 36",
            r"planner.reference_speed is 36 m/s; wanted at most 10 m/s.*36 km/h are 10 m/s",
        ),
        ("robot: unicycle, dt: 0.0", "planner.dt is 0"),
        ("robot: unicycel", "planner.robot.type: unknown robot 'unicycel': did you mean"),
        ("robot: unicycle, horzon: 3", "planner: unknown key 'horzon': did you mean"),
    ],
)
def test_what_does_not_fit_is_refused_where_it_stands(settings: str, message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        build("controllers", parse(f"{{<<: recommended, {settings}}}", "here"), "planner")


def test_a_setting_without_a_place_is_named_alone() -> None:
    for path, place in (("", ""), ("planner", r"planner\.")):
        with pytest.raises(WideberthError, match=rf"^{place}reference_speed is -1"):
            completed({"robot": "unicycle", "reference_speed": -1.0}, path)


def test_a_robot_that_moves_aside_slowly_is_named() -> None:
    """At a constant yaw acceleration it gets v times the integral of sin(alpha t^2 / 2) aside."""
    speed, alpha, distance = 0.5, 0.1, 0.4 + 0.3
    times = np.linspace(0.0, 10.0, 100_001)
    turned = 0.5 * alpha * np.minimum(times, 3.0) ** 2 + 0.3 * np.maximum(times - 3.0, 0.0)
    aside = np.cumsum(np.sin(turned)) * speed * 1e-4
    needed = times[int((aside >= distance).argmax())]
    found = slow_aside(Unicycle(radius=0.4), speed)
    assert f"takes {needed:.1f} s at 0.5 m/s to move aside by 0.7 m" in found
    assert slow_aside(Unicycle(radius=0.4, max_yaw_rate=0.7, max_yaw_acceleration=0.7), 0.57) == ""
    assert slow_aside(load("robots", "holonomic_velocity")(), 0.5) == ""  # 1.05 m at 0.7 m/s


def test_a_speed_in_kilometres_per_hour_is_no_speed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(WideberthError, match=r"^reference_speed is 36 m/s; wanted at most 10 m/s"):
        recommended(speed=36)
    recommended(speed=7.2)
    assert "beware    reference_speed is 7.2 m/s" in capsys.readouterr().out
    assert recommended(speed=10.0, quiet=True).horizon == 200


def test_a_level_that_is_a_content_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    mixed = r"tail is 1 - content: 0.95 holds 5 % .*0.05 holds 95 %"
    for level in ("relaxed", "discounted"):
        with pytest.raises(WideberthError, match=mixed):
            recommended(level={"type": level, "tail": 0.95})
    recommended(level={"type": "fixed", "tail": 0.95})
    assert "; level.tail is 1 - content: 0.95 holds 5 %" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, ""),
        ({"reference_speed": 1.4, "level": "{type: fixed, tail: 0.61}"}, "level.tail is 1 -"),
        ({"level": "{type: fixed, tail: 0.5}"}, ""),  # half of where it may be
        ({"level": "{type: fixed, tail: 0.999999}"}, ""),  # the mean alone
        ({"reference_speed": 36}, "reference_speed is 36 m/s, 18 m a step; 36 km/h are 10 m/s"),
        ({"reference_speed": 1.5}, "and the robot drives at most 0.7 m/s: the reference runs"),
    ],
)
def test_a_slip_is_a_warning_of_the_first_path(
    settings: dict[str, Any], words: str, caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr(WARNINGS, "_last", {})
    parts = {"region": "mahalanobis_ellipse", "predictor": "kalman", "solver": "riccati"}
    level = parse(f"level: {settings.get('level', 'fixed')}", "here")
    planner = build(
        "controllers", {"type": "mpc", "robot": "unicycle", **parts, **settings, **level}
    )
    for end in (5.0, 6.0):
        planner.set_path(Path(np.array([[0.0, 0.0], [end, 0.0]])))
    said = [record.message for record in caplog.records]
    assert len(said) == bool(words) and words in "".join(said)


@pytest.mark.parametrize("name", shipped())
def test_no_shipped_config_looks_like_a_slip(name: str) -> None:
    assert not [doubts(one) for one in planners(read_experiment(name, [])[0]).values()
                if doubts(one)]  # fmt: skip


def test_what_it_chose_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    fast = recommended(speed=1.0)
    said = capsys.readouterr().out
    assert 7 <= len(said.splitlines()) <= 10 and max(map(len, said.splitlines())) < 160
    for words in ("unicycle of radius 0.75 m", " 1 m/s", "max_speed 1.4", "adaptive_conformal",
                  "mahalanobis_ellipse", "relaxed", "acceleration 625", "20 steps of 0.25 s",
                  "riccati"):  # fmt: skip
        assert words in said
    assert fast.robot.max_speed == pytest.approx(1.4)
    own = Unicycle(max_speed=1.0)
    assert recommended(own, 1.0, quiet=True).robot is own and not capsys.readouterr().out
    assert recommended("holonomic_3d", 1.0, quiet=True).static_region is None


@pytest.mark.parametrize(
    ("robot", "speed", "message"),
    [
        ({"type": "unicycle"}, 1.0, r"speed is 1 m/s; Unicycle.* can drive at most 0.7 m/s"),
        ("unicycel", 1.0, r"did you mean 'unicycle'"),
        ("unicycle", -1.0, "speed"),
    ],
)
def test_a_robot_that_cannot_drive_so_fast_is_refused(robot, speed, message) -> None:
    with pytest.raises(WideberthError, match=message):
        recommended(robot, speed, quiet=True)


def test_a_missing_key_names_the_recommendation() -> None:
    settings = {"robot": "unicycle", **shared_settings("recommended"), "type": "mpc"}
    for key in ("robot", "region", "predictor", "level", "solver"):
        rest = {name: value for name, value in settings.items() if name != key}
        with pytest.raises(WideberthError, match=rf"'{key}' is missing.*<<: recommended.*recomm"):
            build("controllers", rest)


@pytest.mark.parametrize(("robot", "speed"), [("unicycle", 1.0), ("bicycle", 1.5)])
def test_it_passes_a_walker_and_arrives(
    robot: str, speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the paper's weights a robot of 1 m/s circles its goal instead."""
    monkeypatch.syspath_prepend(str(File(__file__).parents[2] / "benchmarks"))
    found = import_module("recommended").drive(recommended(robot, speed, quiet=True), True)
    assert found.time < 1.3 and found.way < 1.2 and found.clearance > 0.1
