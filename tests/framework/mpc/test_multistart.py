"""Which starts a situation asks for."""

from types import SimpleNamespace

import numpy as np
import pytest

from wideberth.framework.mpc.planner import multistart
from wideberth.framework.mpc.planner.multistart import OTHERS, Budget, MultiStart
from wideberth.robots.holonomic_velocity import HolonomicVelocity

TEN_METRES = np.stack([np.zeros(20), np.linspace(0.5, 10.0, 20)], axis=1)


def asked(gone, *, inputs=True, there=True, obstacle_in_way=True, optimal=True, starts="auto"):
    """Names of the starts, for a plan whose last state is ``gone`` m ahead of its first."""
    states = np.stack([np.zeros(21), np.linspace(0.0, gone, 21)], axis=1)
    first = SimpleNamespace(optimal=optimal, point=SimpleNamespace(states=states))
    check = SimpleNamespace(
        robot=HolonomicVelocity(),
        last_inputs=np.zeros((20, 2)) if inputs else None,
        parameters=SimpleNamespace(reference=TEN_METRES),
    )
    attempts = MultiStart(None, starts, Budget(None, 0.0))
    return attempts._names(check, first, there, obstacle_in_way)


@pytest.mark.parametrize(
    ("expected", "settings"),
    [
        ((), {"there": False}),
        (OTHERS, {"obstacle_in_way": False}),
        (OTHERS, {"inputs": False}),
        (OTHERS, {"optimal": False, "there": False}),
        (("along",), {}),
        (("wait",), {"starts": ("wait",)}),
    ],
)
def test_what_auto_tries(expected, settings):
    assert asked(8.0, **settings) == expected


def test_a_plan_that_waits_for_ever_is_not_the_only_one_looked_at():
    assert asked(1.04) == ("along",)
    assert asked(0.9) == OTHERS
    assert asked(0.0) == OTHERS
    assert asked(-2.0) == ("along",)  # backs off: it is on its way


def test_a_tenth_of_the_deadline_is_kept_and_half_of_it_waited(monkeypatch):
    clock = iter([100.0, 102.0, 102.0, 102.0])
    monkeypatch.setattr(multistart, "perf_counter", lambda: next(clock))
    budget = Budget.start(4.0)
    assert budget.spent() == 2.0
    assert budget.left() == pytest.approx(0.9 * 4.0 - 2.0)
    assert budget.wait() == pytest.approx(0.95 * 4.0 - 2.0)
    free = Budget(None, 0.0)
    assert free.left() == free.wait() == np.inf
