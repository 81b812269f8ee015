"""The contract of a Cost, checked with every registered robot."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..mpc.assembly import assemble
from ..mpc.costs.base import Cost, ProgressCost
from ..mpc.levels.fixed import Fixed
from ..mpc.ocp.problem import Problem
from ..mpc.ocp.reference import Reference
from ..plugins.registry import load, names
from ..robot import Robot, start_state
from ..values.arrays import Array
from ..values.path import Path
from .laws import Law, each, require

_STEPS, _DT, _SPEED = 6, 0.4, 0.6
_NUDGE = 1e-6


def check_cost(cost: Cost) -> None:
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
    require(laws(cost))


def laws(cost: Cost) -> tuple[Law, ...]:
    """Return the laws of a cost."""
    rides = _Rides(cost)
    return (
        Law("reference", each(_check_reference, lambda: rides.places)),
        Law("same reference each time", each(_check_repeats, lambda: rides.places)),
        Law("price", each(_check_price, lambda: rides.priced)),
        Law("gradient", each(_check_gradient, lambda: rides.priced)),
        Law("free at the reference speed", each(_check_free, lambda: rides.problems)),
    )


@dataclass(frozen=True)
class _Place:
    """A robot at a place on a path."""

    cost: Cost
    problem: Problem
    robot: Robot
    path: Path
    arc: float

    def lay(self) -> Reference:
        return self.cost.lay(self.path, self.arc, _SPEED, _STEPS, _DT)


@dataclass(frozen=True)
class _Priced:
    """A price as a function of one vector, and a point to ask it at."""

    cost: Cost
    price: Callable[[Any], Any]
    point: Array


@dataclass(frozen=True, eq=False)
class _Rides:
    """Problems of all registered robots without obstacles, and places on paths."""

    cost: Cost

    @cached_property
    def problems(self) -> list[tuple[Problem, Robot, Cost]]:
        robots: list[Robot] = [load("robots", name)() for name in names("robots")]
        return [(_problem(self.cost, robot), robot, self.cost) for robot in robots]

    @cached_property
    def places(self) -> list[_Place]:
        found = []
        for problem, robot, _ in self.problems:
            size = robot.dimension
            corner = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 3.0, 1.0]])[:, :size]
            bent, straight = Path(corner), _straight(size)
            for path, arc in ((straight, 20.0), (bent, 0.0), (bent, 1.5), (bent, bent.length)):
                found.append(_Place(self.cost, problem, robot, path, arc))
        return found

    @cached_property
    def priced(self) -> list[_Priced]:
        return [one for place in self.places for one in _prices(place)]


def _problem(cost: Cost, robot: Robot) -> Problem:
    """Make the problem of a robot without obstacles."""
    return assemble(robot, (), Fixed(), horizon=_STEPS, dt=_DT, rooms=(), cost=cost)


def _straight(size: int) -> Path:
    return Path(100.0 * np.eye(3)[:2, :size] - 50.0)


def _check_reference(place: _Place) -> None:
    cost, size, found = place.cost, place.path.points.shape[1], place.lay()
    shapes = {
        "position": (_STEPS, size),
        "direction": (_STEPS, size),
        "speed": (_STEPS,),
        "curve": (_STEPS, cost.curve_width(size)),
    }
    for name, shape in shapes.items():
        values = getattr(found, name)
        _demand(values.shape == shape, f"{name} is {values.shape}; wanted {shape}")
        _demand(bool(np.isfinite(values).all()), f"{name} must be finite")
    length = np.linalg.norm(found.direction, axis=1)
    _demand(bool(np.allclose(length, 1.0)), "directions are unit vectors")


def _check_repeats(place: _Place) -> None:
    first, second = place.lay(), place.lay()
    for name in ("position", "direction", "speed", "curve"):
        same = np.array_equal(getattr(first, name), getattr(second, name))
        _demand(same, f"{name} must be the same each time")


def _prices(place: _Place) -> Iterator[_Priced]:
    """Price random stages around a place on the path."""
    rng = np.random.default_rng(0)
    problem, size, reference = place.problem, place.problem.states, place.lay()
    for head in _heads(reference):
        x, u = rng.uniform(-0.5, 0.5, size), rng.uniform(-0.5, 0.5, problem.inputs)
        x[: place.robot.dimension] += reference.position[0]
        if isinstance(place.cost, ProgressCost):
            x[-1] += place.arc + 0.5

        def by_input(z: Any, head: Array = head) -> Any:
            return problem.input_cost(z[:size], z[size:], head)

        def by_state(z: Any, head: Array = head) -> Any:
            return problem.state_cost(z, head)

        yield _Priced(place.cost, by_input, np.append(x, u))
        yield _Priced(place.cost, by_state, x)


def _check_price(one: _Priced) -> None:
    value = float(one.price(one.point))
    holds = bool(np.isfinite(value)) and value >= 0.0
    _demand(holds, f"a stage's price is {value}")


def _check_gradient(one: _Priced) -> None:
    """CasADi's gradient against central differences."""
    from ..numerics.symbolic import ca

    price, point = one.price, one.point
    z = ca.SX.sym("z", len(point))
    slope = ca.Function("slope", [z], [ca.gradient(price(z), z)])
    exact = np.asarray(slope(point)).ravel()
    steps = _NUDGE * np.eye(len(point))
    rough = [float(price(point + e)) - float(price(point - e)) for e in steps]
    error = np.abs(exact - np.array(rough) / (2.0 * _NUDGE)).max()
    _demand(bool(np.isfinite(exact).all()), "the gradient must be finite")
    scale = 1.0 + np.abs(exact).max() + float(price(point))
    _demand(error < 1e-5 * scale, f"the gradient is off by {error:.2g} of {scale:.2g}")


def _check_free(ride: tuple[Problem, Robot, Cost]) -> None:
    """Let a robot move along a straight path at the reference speed, at no price."""
    problem, robot, cost = ride
    path, arc = _straight(robot.dimension), 30.0
    reference = cost.lay(path, arc, _SPEED, _STEPS, _DT)
    total = 0.0
    for i, head in enumerate(_heads(reference)):
        theta = np.array([arc + i * _SPEED * _DT, arc + (i + 1) * _SPEED * _DT])
        along = reference.direction[0].tolist()
        starts = [start_state(robot, place.tolist(), along, _SPEED) for place in path.at(theta)]
        now, then = (np.array(state, dtype=np.float64) for state, _ in starts)
        twist = starts[0][1]
        control = np.array(robot.drive(tuple(now), twist, _DT), dtype=np.float64)
        if isinstance(cost, ProgressCost):
            now, then = np.append(now, theta[0]), np.append(then, theta[1])
            control = np.append(control, _SPEED)
        total += float(problem.input_cost(now, control, head))
        total += float(problem.state_cost(then, head))
    _demand(abs(total) < 1e-6, f"a free ride costs {total:.3g} with {robot!r}")


def _heads(reference: Reference) -> Array:
    """Return what each stage receives of the reference, (N, head_width)."""
    return np.column_stack(
        [reference.position, reference.direction, reference.speed, reference.curve]
    )


def _demand(holds: bool, law: str) -> None:
    if not holds:
        raise AssertionError(law)
