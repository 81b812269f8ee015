"""The contract check of controllers, on the stub that other tests drive with."""

import numpy as np
import pytest

from wideberth.framework.control.command_limits import within_reach
from wideberth.framework.controller import checked_ready, checked_use
from wideberth.framework.testing import check_controller
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Command
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.pursuit import Pursuit


class Careful(Pursuit):
    """The stub with what the contract asks beyond it."""

    def command(self, observation):
        checked_ready(self.path)
        checked_use(self.robot, observation)
        if observation.flaw:
            return Command((0.0, 0.0))
        with np.errstate(all="ignore"):  # positions of 1e200 m
            return within_reach(self.robot, super().command(observation))


def test_stub_keeps_the_controller_contract():
    check_controller(Careful(Unicycle(), planning=False), cycles=3)
    with pytest.raises(WideberthError, match=r"robot that Pursuit drives: give .* `robot`"):
        check_controller(Pursuit(None))


def test_check_controller_finds_what_is_broken(monkeypatch):
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((np.nan, 0.0)))
    with pytest.raises(AssertionError, match="finite"):
        check_controller(Pursuit(Unicycle()))
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: 1 / 0)
    with pytest.raises(AssertionError, match="ZeroDivisionError"):
        check_controller(Pursuit(Unicycle()))
    drawn = iter(np.linspace(0.0, 0.1, 1000))

    class Drifting(Careful):
        def command(self, observation):
            checked_ready(self.path)
            checked_use(self.robot, observation)
            return Command((float(next(drawn)), 0.0))

    with pytest.raises(AssertionError, match="after reset"):
        check_controller(Drifting(Unicycle(), planning=False))
