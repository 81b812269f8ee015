"""Costs as plug-ins: their laws, the paper's formula, and a user's own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
import pytest

from wideberth.controllers.costs.contouring import Contouring
from wideberth.framework import names
from wideberth.framework.mpc.costs.base import Cost, Moment, ProgressCost, Weights, effort
from wideberth.framework.mpc.costs.tracking import Tracking
from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.ocp.reference import Reference, lay_reference
from wideberth.framework.mpc.ocp.stage import ReferenceSymbols
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.plugins import config, registry
from wideberth.framework.plugins.registry import ROOMS, load, register
from wideberth.framework.testing.cost import check_cost
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.unicycle import Unicycle
from wideberth.tests.helpers.contracts import Contract
from wideberth.tests.helpers.problems import assemble

COSTS = [
    *(load("costs", name)() for name in names("costs")),
    Tracking(Weights(position=1.0, speed=0.0, acceleration=0.0, yaw_acceleration=3.0)),
    Contouring(knots=5, lag=10.0, rate=1.0),
    Contouring(knots=30),
]


CONTRACT = Contract.of(COSTS, check_cost.laws)


@pytest.mark.parametrize(("cost", "law"), CONTRACT.cases())
def test_costs_keep_their_laws(cost: str, law: str) -> None:
    CONTRACT.check(cost, law)


@final
@dataclass(frozen=True)
class Broken(Cost):
    """Breaks one law, by its name."""

    law: str = ""

    def lay(self, path: Path, arc: float, speed: float, steps: int, dt: float) -> Reference:
        found = lay_reference(path, arc, speed, steps, dt)
        change = {
            "width": {"curve": np.zeros((steps, 2))},
            "unit": {"direction": 2.0 * found.direction},
            "finite": {"speed": np.nan * found.speed},
            "shape": {"position": found.position[:-1]},
        }
        return replace(found, **change.get(self.law, {}))  # type: ignore[arg-type]

    def terms(self, moment: Moment, reference: ReferenceSymbols) -> Sequence[Any]:
        place = moment.pose.position[0] - reference.position[0]
        return {
            "negative": (-100.0 + 0.0 * place, effort(Weights(), moment.acceleration)),
            "gradient": (place**2 * (place > 0.0) + np.fabs(place),),
            "free": ((place - 1.0) ** 2,),
        }.get(self.law, (place**2,))


@pytest.mark.parametrize(
    ("law", "words"),
    [
        ("width", "curve is"),
        ("unit", "unit vectors"),
        ("finite", "speed must be finite"),
        ("shape", "position is"),
        ("negative", "price is -"),
        ("free", "free ride"),
    ],
)
def test_a_broken_law_is_named(law: str, words: str) -> None:
    with pytest.raises(AssertionError, match=words):
        check_cost(Broken(law))


def test_tracking_is_the_papers_formula() -> None:
    """Written out for the unicycle, whose state and input hold all that is priced."""
    weights = Weights(3.0, 5.0, 7.0, 11.0)
    problem = assemble(
        Unicycle(), MinkowskiSum(), Fixed(), horizon=3, dt=0.5, capacity=0, cost=Tracking(weights)
    )
    rng = np.random.default_rng(1)
    x, u, head = rng.normal(size=5), rng.normal(size=2), rng.normal(size=5)
    by_state = 3.0 * ((x[:2] - head[:2]) ** 2).sum() + 5.0 * (x[3] - head[4]) ** 2
    assert float(problem.state_cost(x, head)) == pytest.approx(by_state)
    assert float(problem.input_cost(x, u, head)) == pytest.approx(7 * u[0] ** 2 + 11 * u[1] ** 2)
    assert (problem.states, problem.inputs, problem.head_width) == (5, 2, 5)


def test_the_cost_is_set_by_config() -> None:
    mpc: dict[str, Any] = {
        "type": "mpc",
        "robot": "unicycle",
        "region": "minkowski_sum",
        "predictor": "static",
        "level": "fixed",
        "solver": "fatrop",
    }
    assert config.build("controllers", mpc).cost == Tracking()
    assert config.build("controllers", {**mpc, "cost": "contouring"}).cost == Contouring()
    chosen = {"type": "contouring", "rate": 3, "weights": {"position": 50.0}}
    made = config.build("controllers", {**mpc, "cost": chosen})
    assert made.cost == Contouring(weights=Weights(position=50.0), rate=3.0)
    assert config.build("costs", config.describe(made.cost)) == made.cost
    with pytest.raises(WideberthError, match=r"cost\.type.*did you mean 'contouring'"):
        config.build("controllers", {**mpc, "cost": "contoring"})
    with pytest.raises(WideberthError, match=r"cost: contouring.knots is 4"):
        config.build("controllers", {**mpc, "cost": {"type": "contouring", "knots": 4}})
    for name in ("lag", "rate"):
        with pytest.raises(WideberthError, match=f"contouring.{name} is 0"):
            replace(Contouring(), **{name: 0.0})  # type: ignore[arg-type]


def test_a_cost_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """It follows the path and is found by its name: theta is its own to spend."""
    monkeypatch.setattr(registry, "_registered", {room: {} for room in ROOMS})

    @register("costs", "half_way")
    @final
    @dataclass(frozen=True)
    class HalfWay(ProgressCost):
        """Stay beside the point theta of a straight path, at half the reference speed."""

        weight: float = 50.0

        def lay(self, path: Path, arc: float, speed: float, steps: int, dt: float) -> Reference:
            return lay_reference(path, arc, speed, steps, dt)

        def terms(self, moment: Moment, reference: ReferenceSymbols) -> Sequence[Any]:
            x, y = moment.pose.position
            return (
                self.weight * ((x - moment.progress) ** 2 + y**2),
                1e3 * (moment.rate - 0.5 * reference.speed) ** 2,
                effort(Weights(acceleration=1e3), moment.acceleration),
            )

    assert "half_way" in names("costs")
    settings = {
        "type": "mpc",
        "robot": "unicycle",
        "region": "minkowski_sum",
        "predictor": "static",
        "level": "fixed",
        "solver": "fatrop",
        "cost": {"type": "half_way", "weight": 60.0},
    }
    planner = config.build("controllers", settings)
    assert isinstance(planner, Planner)
    planner.set_path(Path(np.array([[0.0, 0.0], [30.0, 0.0]])))
    planner.command(Observation(0.0, np.array([2.0, 0.0, 0.0, 0.25, 0.0])))
    assert planner.plan is not None and planner.plan.rung is Rung.OPTIMAL
    assert planner.plan.states.shape == (16, 5) and planner.plan.inputs.shape == (15, 2)
    assert planner.plan.states[:, 3] == pytest.approx(np.full(16, 0.25), abs=1e-4)
