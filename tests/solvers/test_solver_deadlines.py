"""A deadline is by the clock for every solver, and IPOPT's programs do not depend on it."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.benchmarks.recorded_instances import Instance, read_instances
from wideberth.experiments.engine.shipped_configs import config_path
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.ocp.problem import Problem
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.solver import Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.yamlfile import read_config
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.plan import Status
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.robots.unicycle import Unicycle
from wideberth.solvers import casadi_program as base
from wideberth.solvers import fatrop, ipopt
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.ipopt import Ipopt
from wideberth.solvers.riccati import solver as riccati
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.helpers.problems import assemble

SAMPLE = Path(__file__).parents[1] / "data" / "mpc_instances.npz"
SOLVERS = [Ipopt(), Ipopt(graph="mx"), Fatrop(), Riccati()]


@pytest.fixture(scope="module")
def instance() -> Instance:
    return next(read_instances(SAMPLE, MahalanobisEllipse()))


def problem_for(instance: Instance) -> Problem:
    level = Relaxed(tail=float(np.exp(-5.991 / 2)), weight=1.0, minimum=0.0)
    return assemble(
        Unicycle(), MahalanobisEllipse(), level, horizon=15, dt=0.5, capacity=instance.obstacles
    )


class Clock:
    """Moves by so many seconds whenever somebody looks at it."""

    def __init__(self, seconds: float) -> None:
        self.now, self.seconds = 0.0, seconds

    def __call__(self) -> float:
        self.now += self.seconds
        return self.now


def slowed(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    clock = Clock(seconds)
    for module in (base, fatrop, ipopt, riccati):
        monkeypatch.setattr(module, "perf_counter", clock)


@pytest.mark.parametrize("solver", SOLVERS, ids=repr)
def test_a_solve_that_ends_after_its_deadline_is_late(
    solver: Solver, instance: Instance, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many seconds by the clock, and next to no processor time."""
    given = problem_for(instance), instance.parameters, [instance.guess] * 2
    solver.solve(*given[:2], [])
    slowed(monkeypatch, 3600.0)
    found = solver.solve(*given, deadline=1800.0)
    assert [one.status for one in found] == [Status.DEADLINE] * 2
    assert all("deadline" in one.message for one in found)
    assert all(np.isfinite(one.point.states).all() for one in found)


@pytest.mark.parametrize("solver", SOLVERS, ids=repr)
def test_a_deadline_that_is_not_reached_changes_nothing(
    solver: Solver, instance: Instance
) -> None:
    given = problem_for(instance), instance.parameters, [instance.guess]
    (free,), (capped,) = solver.solve(*given), solver.solve(*given, deadline=3600.0)
    assert free.status is capped.status is Status.SOLVED
    assert free.iterations == capped.iterations
    assert free.point.states.tobytes() == capped.point.states.tobytes()
    assert free.cost == capped.cost


@pytest.mark.parametrize("graph", ["sx", "mx"])
def test_ipopt_is_stopped_between_two_iterations(
    graph: str, instance: Instance, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = problem_for(instance), instance.parameters, [instance.guess]
    (free,) = Ipopt(graph=graph).solve(*given)
    slowed(monkeypatch, 1.0)
    (stopped,) = Ipopt(graph=graph).solve(*given, deadline=4.5)
    assert stopped.status is Status.DEADLINE
    assert 1 <= stopped.iterations < free.iterations
    (again,) = Ipopt(graph=graph).solve(*given, deadline=1e9)
    assert again.status is Status.SOLVED
    assert again.point.states.tobytes() == free.point.states.tobytes()


def test_a_changing_deadline_compiles_one_program(
    instance: Instance, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    given = problem_for(instance), instance.parameters, [instance.guess]
    monkeypatch.setattr(base, "_CACHE", type(base._CACHE)())
    build = base.ca.nlpsol

    def counted(*arguments: Any) -> Any:
        made.append(arguments[1])
        return build(*arguments)

    monkeypatch.setattr(base.ca, "nlpsol", counted)
    for left in (100.0, 99.5, 99.0, 98.5):
        Ipopt().solve(*given, deadline=left)
    assert made == ["ipopt"]
    assert len(base._CACHE) == 1


def test_the_papers_limit_is_ipopts_own_clock(instance: Instance) -> None:
    """As little as a limit can be: IPOPT looks at its clock once an iteration."""
    given = problem_for(instance), instance.parameters, [instance.guess]
    (found,) = Ipopt(graph="mx", max_cpu_time=1e-9).solve(*given)
    assert (found.status, found.message) == (Status.DEADLINE, "Maximum_CpuTime_Exceeded")
    with pytest.raises(WideberthError, match="max_cpu_time"):
        Ipopt(max_cpu_time=0.0)


@pytest.mark.parametrize("name", ["chicken_game", "crossing"])
def test_the_paper_config_has_the_papers_limit(name: str) -> None:
    settings = read_config(config_path(name))["planners"]["paper"]
    planner = build("controllers", settings)
    assert isinstance(planner, Planner)
    assert planner.solver == Ipopt(graph="mx", max_cpu_time=0.45)
    assert planner.deadline is None
