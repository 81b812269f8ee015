"""How much of the world a figure shows."""

import numpy as np
import pytest

from wideberth.controllers.constant_velocity import ConstantVelocityController
from wideberth.framework.values.path import Path
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.simulation.drawing.artists import extent
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import run_episode
from wideberth.simulation.engine.settings import Settings


@pytest.mark.parametrize(("aside", "share"), [(0.0, 0.4), (4.0, 8.0 / 11.8), (50.0, 0.8)])
def test_others_make_a_figure_as_high_as_they_are_aside(aside: float, share: float) -> None:
    """Its height is 0.4 to 0.8 of its width, and those between are just inside."""
    body = HolonomicVelocity(0.3, 1.0)
    robot = RobotAgent(
        "robot", body, ConstantVelocityController(body), Path([[0.0, 0.0], [10.0, 0.0]])
    )
    places = np.array([[2.0, aside], [np.nan, np.nan], [3.0, -aside], [2.0, -aside]])
    other = ReplayAgent("other", np.arange(4.0), places, 0.3)
    settings = Settings(time_limit=2.5, plant_step=0.5, history=0.0)
    low, high = extent(run_episode([robot], settings, others=[other]))
    width, height = high - low
    assert (low[0], high[0]) == (pytest.approx(-0.9), pytest.approx(10.9))
    assert height == pytest.approx(share * width)
