"""The benchmark's judge, references and tables, against oracles of their own."""

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wideberth.benchmarks.recorded_instances import SAMPLE, Instance, paper_problem
from wideberth.framework.values.plan import Status
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.solvers.ipopt import Ipopt

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stand where the scripts stand: they import each other by their plain names."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    modules = ("paper_program", "set_ups", "solver_speed")
    return SimpleNamespace(**{name: import_module(name) for name in modules})


@pytest.fixture
def instances(bench: SimpleNamespace) -> list[Instance]:
    found: list[Instance] = bench.solver_speed.chosen(SAMPLE, 6)
    return found


@pytest.mark.parametrize("graph", ["sx", "mx"])
def test_paper_s_program_is_the_assembled_problem(
    graph: str, bench: SimpleNamespace, instances: list[Instance]
) -> None:
    """Two programs, written apart, have the same optimum."""
    for instance in instances[:: 2 if graph == "mx" else 1]:
        problem = paper_problem("mahalanobis_ellipse", instance.obstacles)
        given = problem, instance.parameters, [instance.guess]
        (own,) = bench.paper_program.PaperProgram(graph, 1e-9).solve(*given)
        (other,) = Ipopt(tolerance=1e-9).solve(*given)
        assert own.status is other.status is Status.SOLVED
        assert own.cost == pytest.approx(other.cost, rel=1e-6)
        assert bench.solver_speed.judged(instance, "mahalanobis_ellipse", own)["violation"] < 1e-7


PEERS = ("do-mpc", "acados", "sqpmethod, piqp", "sqpmethod, qpoases", "sqpmethod, osqp")


@pytest.mark.parametrize("name", PEERS)
def test_peers_find_the_optimum(
    name: str, bench: SimpleNamespace, instances: list[Instance]
) -> None:
    """Their plans on an easy instance keep the constraints and cost what IPOPT's costs."""
    if name in bench.set_ups.missing():
        pytest.skip(f"{name}: {bench.set_ups.missing()[name]}")
    peer = bench.set_ups.peers(1e-6)[name]
    problem = paper_problem("mahalanobis_ellipse", instances[0].obstacles)
    given = problem, instances[0].parameters, [instances[0].guess]
    (own,) = peer.solve(*given)
    (other,) = Ipopt(tolerance=1e-9).solve(*given)
    assert own.status is other.status is Status.SOLVED
    assert bench.solver_speed.judged(instances[0], "mahalanobis_ellipse", own)["violation"] < 1e-6
    assert own.cost == pytest.approx(other.cost, rel=1e-4)


def test_every_peer_has_a_row_or_a_reason(bench: SimpleNamespace) -> None:
    taking, missing = bench.set_ups.peers(1e-6), bench.set_ups.missing()
    assert {*taking, *missing} == set(PEERS) and not set(taking) & set(missing)
    assert set(taking) < set(bench.set_ups.set_ups())


def test_gauge_of_the_sum_is_one_on_its_boundary(
    bench: SimpleNamespace, instances: list[Instance]
) -> None:
    """The judge's search agrees with the region's signed distance about which side a point is."""
    region = MinkowskiSum()
    for instance in instances:
        states = instance.guess.states
        point = replace(instance.guess, level=1.7)
        gauge = bench.solver_speed.sum_gauge(instance, point)
        level = np.full(instance.parameters.slots[0].active.shape, 1.7)
        place = states[1:, None, :2]
        apart = region.signed_distance(place, instance.parameters.slots[0].parameters, level).T
        clear = np.abs(apart) > 1e-6
        assert ((gauge > 1.0) == (apart > 0.0))[clear].all()
        exact = region.gauge(place, instance.parameters.slots[0].parameters, level).T
        np.testing.assert_allclose(gauge, exact, rtol=1e-6)


def test_every_solve_is_judged(bench: SimpleNamespace) -> None:
    candidates = bench.set_ups.set_ups()
    candidates = {
        label: candidates[label] for label in ("paper_mx", "ipopt_sx", "fatrop", "ipopt")
    }
    instances = {"mahalanobis_ellipse": bench.solver_speed.chosen(SAMPLE, 2)}
    solves = bench.solver_speed.measure(candidates, instances, 2)
    assert len(solves) == 2 * 2 * len(candidates)
    for row in bench.solver_speed.quality(solves):
        assert row["converged"] == row["both_1e-6"] == row["gap_below_1e-3"] == 1.0
    for row in bench.solver_speed.times(solves):
        assert row["median_ms"] <= row["p95_ms"] <= row["p99_ms"] <= row["max_ms"]
    paper, honest = bench.solver_speed.speedups(solves)[:2]
    assert paper["paper_mx_of_medians"] == paper["paper_mx_each"] == 1.0
    assert honest["ipopt_sx_each_p5"] == honest["ipopt_sx_each_p95"] == 1.0
    inside = bench.solver_speed.quality([{**row, "violation": 1e-5} for row in solves])
    assert all(row["both_1e-6"] == 0.0 and row["both_1e-4"] == 1.0 for row in inside)


def solve(label: str, instance: int, **changes: Any) -> dict[str, Any]:
    row = {"set-up": label, "region": "minkowski_sum", "instance": instance, "kind": "jump"}
    row |= {
        "ms": 10.0,
        "again_ms": 9.0,
        "solved": True,
        "cost": 1.0,
        "violation": 0.0,
        "best_known": np.nan,
    }
    row |= {"iterations": 3}
    return row | changes


def test_best_cost_is_that_of_a_feasible_plan(bench: SimpleNamespace) -> None:
    solves = [
        solve("a", 0, cost=5.0),
        solve("b", 0, cost=3.0, violation=1e-5),  # cheaper, and through the region
        solve("c", 0, cost=4.0),
    ]
    best = bench.solver_speed.best_costs(solves)
    assert best == {("minkowski_sum", 0): 4.0}
    rows = {row["set-up"]: row for row in bench.solver_speed.quality(solves)}
    assert rows["a"]["gap_max"] == pytest.approx(0.2) and rows["a"]["gap_below_1e-3"] == 0.0
    recorded = [{**row, "region": "mahalanobis_ellipse", "best_known": 2.0} for row in solves]
    assert bench.solver_speed.best_costs(recorded) == {("mahalanobis_ellipse", 0): 2.0}
