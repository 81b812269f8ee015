"""The contract check of controllers, on the stub that other tests drive with."""

import numpy as np
import pytest

from wideberth.framework.errors import WideberthError
from wideberth.framework.motion import Command
from wideberth.framework.testing import check_controller
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.pursuit import Pursuit


def test_stub_keeps_the_controller_contract():
    check_controller(Pursuit(Unicycle()), cycles=3)
    with pytest.raises(WideberthError, match="needs the robot"):
        check_controller(Pursuit(None))


def test_check_controller_finds_what_is_broken(monkeypatch):
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((np.nan, 0.0)))
    with pytest.raises(AssertionError, match="finite"):
        check_controller(Pursuit(Unicycle()))
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: 1 / 0)
    with pytest.raises(AssertionError, match="ZeroDivisionError"):
        check_controller(Pursuit(Unicycle()))
    drawn = iter(range(1000))
    monkeypatch.setattr(Pursuit, "command", lambda self, seen: Command((next(drawn), 0.0)))
    with pytest.raises(AssertionError, match="after reset"):
        check_controller(Pursuit(Unicycle()))
