"""The contract of a Cost, checked with every registered robot."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ..mpc.assembly import assemble
from ..mpc.costs.base import CommandCost, Cost, ProgressCost
from ..mpc.levels.fixed import Fixed
from ..mpc.ocp.problem import Problem
from ..mpc.ocp.reference import Reference
from ..plugins.registry import load, names
from ..robot import Robot, start_state
from ..values.arrays import Array
from ..values.path import Path
from .laws import Contract, Law, law, stated

_STEPS, _DT, _SPEED = 6, 0.4, 0.6
_NUDGE = 1e-6


@Contract
def check_cost(cost: Cost) -> Iterator[Law]:
    """Check the laws of a cost.

    With each registered robot, on a straight path, a path with a corner and near the goal: the
    reference has positions, unit directions, speeds and ``curve_width`` numbers of the path, all
    finite and the same each time; the price of a stage is finite and not negative, and its
    gradient agrees with central differences; moving along a straight path at the reference
    speed is free.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.
    """

    @cache
    def places() -> list[_Place]:
        return [
            place for name in names("robots") for place in _places(cost, load("robots", name)())
        ]

    yield from stated(_Place, cost, places)
    yield from stated(_Priced, cost, lambda: [one for place in places() for one in place.prices()])


@dataclass(frozen=True)
class _Place:
    """A robot without obstacles at a place on a path."""

    cost: Cost
    problem: Problem
    robot: Robot
    path: Path
    arc: float

    def lay(self) -> Reference:
        return self.cost.lay(self.path, self.arc, _SPEED, _STEPS, _DT)

    @law("reference")
    def check_reference(self) -> None:
        found, size = self.lay(), self.path.points.shape[1]
        shapes = {
            "position": (_STEPS, size),
            "direction": (_STEPS, size),
            "speed": (_STEPS,),
            "curve": (_STEPS, self.cost.curve_width(size)),
        }
        for name, shape in shapes.items():
            values = vars(found)[name]
            assert values.shape == shape, f"{name} is {values.shape}; wanted {shape}"
            assert np.isfinite(values).all(), f"{name} must be finite"
        length = np.linalg.norm(found.direction, axis=1)
        assert np.allclose(length, 1.0), "directions are unit vectors"

    @law("same reference each time")
    def check_repeats(self) -> None:
        first, second = vars(self.lay()), vars(self.lay())
        for name in ("position", "direction", "speed", "curve"):
            same = np.array_equal(first[name], second[name])
            assert same, f"{name} must be the same each time"

    @law("free at the reference speed")
    def check_free(self) -> None:
        """Let a robot move along a straight path at the reference speed, at no price."""
        if len(self.path.points) > 2:
            return
        problem, robot, reference = self.problem, self.robot, self.lay()
        along, total = reference.direction[0].tolist(), 0.0
        for i, head in enumerate(_heads(reference)):
            theta = self.arc + np.array([i, i + 1]) * _SPEED * _DT
            places = self.path.at(theta).tolist()
            starts = [start_state(robot, place, along, _SPEED) for place in places]
            now, then = (np.array(state, dtype=np.float64) for state, _ in starts)
            control = np.array(robot.drive(tuple(now), starts[0][1], _DT), dtype=np.float64)
            if isinstance(self.cost, ProgressCost):
                now, then = np.append(now, theta[0]), np.append(then, theta[1])
                control = np.append(control, _SPEED)
            if isinstance(self.cost, CommandCost):
                now, then = np.append(now, control), np.append(then, control)
            total += float(problem.input_cost(now, control, head))
            total += float(problem.state_cost(then, head))
        assert abs(total) < 1e-6, f"a free ride costs {total:.3g} with {robot!r}"

    def prices(self) -> "Iterator[_Priced]":
        """Price random stages around the place."""
        rng = np.random.default_rng(0)
        problem, size, reference = self.problem, self.problem.states, self.lay()
        for head in _heads(reference):
            x, u = rng.uniform(-0.5, 0.5, size), rng.uniform(-0.5, 0.5, problem.inputs)
            x[: self.robot.dimension] += reference.position[0]
            if isinstance(self.cost, ProgressCost):
                x[-1] += self.arc + 0.5

            def by_input(z: Any, head: Array = head) -> Any:
                return problem.input_cost(z[:size], z[size:], head)

            def by_state(z: Any, head: Array = head) -> Any:
                return problem.state_cost(z, head)

            yield _Priced(by_input, np.append(x, u))
            yield _Priced(by_state, x)


@dataclass(frozen=True)
class _Priced:
    """A price as a function of one vector, and a point to ask it at."""

    price: Callable[[Any], Any]
    point: Array

    @law("price")
    def check_price(self) -> None:
        value = float(self.price(self.point))
        assert np.isfinite(value) and value >= 0.0, f"a stage's price is {value}"

    @law("gradient")
    def check_gradient(self) -> None:
        """CasADi's gradient against central differences."""
        from ..numerics.symbolic import ca

        price, point = self.price, self.point
        z = ca.SX.sym("z", len(point))
        slope = ca.Function("slope", [z], [ca.gradient(price(z), z)])
        exact = np.asarray(slope(point)).ravel()
        steps = _NUDGE * np.eye(len(point))
        rough = [float(price(point + e)) - float(price(point - e)) for e in steps]
        error = np.abs(exact - np.array(rough) / (2.0 * _NUDGE)).max()
        assert np.isfinite(exact).all(), "the gradient must be finite"
        scale = 1.0 + np.abs(exact).max() + float(price(point))
        assert error < 1e-5 * scale, f"the gradient is off by {error:.2g} of {scale:.2g}"


def _places(cost: Cost, robot: Robot) -> Iterator[_Place]:
    """Yield places on a straight path and on one with a corner, the last at its goal."""
    problem = assemble(robot, (), Fixed(), horizon=_STEPS, dt=_DT, rooms=(), cost=cost)
    size = robot.dimension
    straight = Path(100.0 * np.eye(3)[:2, :size] - 50.0)
    bent = Path(np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 3.0, 1.0]])[:, :size])
    for path, arc in ((straight, 30.0), (bent, 0.0), (bent, 1.5), (bent, bent.length)):
        yield _Place(cost, problem, robot, path, arc)


def _heads(reference: Reference) -> Array:
    """Return what each stage receives of the reference, (N, head_width)."""
    return np.column_stack(
        [reference.position, reference.direction, reference.speed, reference.curve]
    )
