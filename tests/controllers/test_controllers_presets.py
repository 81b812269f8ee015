"""Presets: the planners that they say, and what these keep."""

from functools import partial

import numpy as np
import pytest

from wideberth.framework.plugins.config import build, describe
from wideberth.framework.testing.controller import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle
from wideberth.framework.values.path import Path
from wideberth.framework.values.polygon import Polygon
from wideberth.robots.unicycle import Unicycle
from wideberth.simulation.engine.agents import RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings
from wideberth.tests.helpers.contracts import Contract

PARTS = {
    "linearized_chance": ("kalman", "half_plane", 0.03, "tracking"),
    "lmpcc": ("constant_velocity", "repaired_margin", 0.05, "contouring"),
    "mpc_constant_velocity": ("constant_velocity", "half_plane", 0.5, "tracking"),
}
SHORT = {"horizon": 6, "dt": 0.8, "margin": 0.1}
"""A short plan that still sees 4.8 s ahead: quick."""


@pytest.mark.parametrize("name", PARTS)
def test_parts_are_the_stated_ones(name):
    predictor, region, tail, cost = PARTS[name]
    made = build("controllers", {"type": name, "robot": "unicycle", **SHORT})
    config = describe(made)
    kinds = tuple(config[part]["type"] for part in ("predictor", "region", "cost"))
    assert kinds == (predictor, region, cost)
    assert config["level"]["type"] == "fixed" and config["level"]["tail"] == tail
    assert (config["horizon"], config["dt"], config["margin"]) == (6, 0.8, 0.1)
    assert config["static_region"]["type"] == "separating_line" and made.last_plan is None


def test_without_covariance_the_region_is_the_disc():
    """Whatever the covariance: in at 1.5 m less a little, out at 1.5 m and a little."""
    made = build("controllers", {"type": "mpc_constant_velocity", "robot": "unicycle"})
    level = made.level.levels(made.region, 1, 1, 2)[0, 0]
    angle = np.linspace(0.0, 6.0, 25)
    around = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for spread in (np.eye(2), np.array([[4.0, 1.9], [1.9, 1.0]])):
        obstacle = GaussianObstacle(np.zeros(2), spread)
        numbers = made.region.parameters(obstacle, np.array(1.5))
        assert made.region.contains(1.4999 * around, numbers, level).all()
        assert not made.region.contains(1.5001 * around, numbers, level).any()


CONTRACT = Contract(
    {
        name: partial(build, "controllers", {"type": name, "robot": "unicycle", **SHORT})
        for name in PARTS
    },
    partial(check_controller.laws, cycles=2),
)


@pytest.mark.parametrize(("name", "law"), CONTRACT.cases())
def test_contract(name, law):
    CONTRACT.check(name, law)


@pytest.mark.parametrize("name", PARTS)
def test_what_is_stated_wins(name):
    level = {"type": "fixed", "tail": 0.2}
    stated = {"predictor": "imm", "level": level, "starts": ["along"], "static_region": None}
    made = build("controllers", {"type": name, "robot": "unicycle", **stated})
    found = describe(made)
    assert (found["type"], found["predictor"]["type"]) == ("mpc", "imm")
    assert found["level"]["tail"] == 0.2 and found["static_region"] is None


@pytest.mark.parametrize("name", PARTS)
def test_two_who_meet_do_not_touch(name):
    robot = Unicycle(radius=0.4)
    ways = np.array([[[0.0, 0.0], [7.0, 0.0]], [[7.0, 0.3], [0.0, 0.3]]])
    agents = [
        RobotAgent(key, robot, build("controllers", {"type": name, "robot": robot, **SHORT}),
                   Path(way), 0.5)
        for key, way in zip("ab", ways, strict=True)
    ]  # fmt: skip
    logs = run_episode(agents, Settings(time_limit=40.0, history=4.0)).agents
    apart = np.linalg.norm(logs[0].positions - logs[1].positions, axis=1)
    assert apart.min() > 0.8
    assert all(np.isfinite(log.reached) for log in logs)


def test_settings_out_of_range_are_refused():
    with pytest.raises(WideberthError, match=r"tail is 2; a probability must lie strictly"):
        level = {"type": "fixed", "tail": 2.0}
        build("controllers", {"type": "lmpcc", "robot": "unicycle", "level": level})
    with pytest.raises(WideberthError, match=r"horizon is 0; wanted a whole number"):
        build("controllers", {"type": "mpc_constant_velocity", "robot": "unicycle", "horizon": 0})


@pytest.mark.parametrize("name", [*PARTS, "mpc", "constant_velocity"])
def test_who_lacks_a_static_region_is_refused_among_polygons(name):
    """Presets have theirs; who has no such setting reads polygons as they are, or not at all."""
    wall = Polygon(((2.0, 2.0), (3.0, 2.0), (3.0, 3.0)), "wall")
    config = {"type": name, "robot": "unicycle"}
    if name == "mpc":
        config |= {
            "region": "half_plane",
            "predictor": "kalman",
            "level": "fixed",
            "solver": "fatrop",
        }
    made = build("controllers", config)
    agent = RobotAgent("one", made.robot, made, Path(np.array([[0.0, 0.0], [7.0, 0.0]])))
    settings = Settings(time_limit=0.1, history=0.0)
    if name == "mpc":
        with pytest.raises(WideberthError, match=r"\['one'\] has no static_region"):
            run_episode([agent], settings, polygons=(wall,))
    else:
        assert run_episode([agent], settings, polygons=(wall,)).polygons == (wall,)
