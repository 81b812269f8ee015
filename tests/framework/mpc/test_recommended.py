"""One call gives a planner that arrives, says what it chose, and names itself where keys lack."""

from importlib import import_module
from pathlib import Path

import pytest

from wideberth import WideberthError, build, recommended
from wideberth.framework.plugins.config import describe
from wideberth.framework.plugins.yamlfile import shared_settings
from wideberth.robots.unicycle import Unicycle


def test_at_the_papers_speed_it_is_the_recommended_setting() -> None:
    shipped = build("controllers", {**shared_settings("recommended"), "robot": "unicycle"})
    found = describe(recommended("unicycle", 0.5, quiet=True))
    assert found.pop("static_region")["type"] == "separating_line"
    assert found == {key: value for key, value in describe(shipped).items() if key in found}


def test_what_it_chose_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    fast = recommended(speed=1.0)
    said = capsys.readouterr().out
    assert 7 <= len(said.splitlines()) <= 10 and max(map(len, said.splitlines())) < 140
    for words in ("unicycle of radius 0.75 m", " 1 m/s", "max_speed 1.4", "kalman",
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
    settings = {"type": "mpc", "robot": "unicycle", **shared_settings("recommended")}
    for key in ("robot", "region", "predictor", "level", "solver"):
        rest = {name: value for name, value in settings.items() if name != key}
        with pytest.raises(WideberthError, match=rf"'{key}' is missing.*<<: recommended.*recomm"):
            build("controllers", rest)


@pytest.mark.parametrize(("robot", "speed"), [("unicycle", 1.0), ("bicycle", 1.5)])
def test_it_passes_a_walker_and_arrives(
    robot: str, speed: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the paper's weights a robot of 1 m/s circles its goal instead."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "benchmarks"))
    found = import_module("recommended_arrives").drive(recommended(robot, speed, quiet=True), True)
    assert found.time < 1.3 and found.way < 1.2 and found.clearance > 0.1
