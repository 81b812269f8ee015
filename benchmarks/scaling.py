"""How time grows with the number of obstacles and with the horizon, on instances made for it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import thread_time

import numpy as np
from instances import Made, Recipe
from judging import LOOSE
from measuring import Row, Tick, labels, repeats, rotated, slope, timed
from set_ups import ELLIPSE, OWN, registered, unicycle

from wideberth.framework import Detection, Observation, Path, recommended
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.mpc.planner.cycle import PlannerState, Services, remember, step
from wideberth.framework.mpc.planner.settings import changed
from wideberth.framework.mpc.planner.verify import violation
from wideberth.framework.mpc.slots.base import PlanningContext, SlotAssignment
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import Robot
from wideberth.framework.values.plan import Status

NEAR, WARM = 20, 20
"""People within reach; observations before the first decision."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of the problems.

    Attributes
    ----------
    obstacles : K, at the paper's N = 15.
    steps : N, at each K of ``among``.
    among : K.
    instances : of each size.
    seen : obstacles that a planner sees, `NEAR` of them or all within its reach.
    decisions : of the planner with each.
    """

    obstacles: tuple[int, ...] = (1, 5, 10, 20, 50, 100)
    steps: tuple[int, ...] = (15, 30, 60, 120)
    among: tuple[int, ...] = (1, 20)
    instances: int = 20
    seen: tuple[int, ...] = (20, 50, 100, 200)
    decisions: int = 30

    def all_of(self) -> list[tuple[str, int, int]]:
        """Return (axis, K, N) of every size."""
        found = [("K, N = 15", count, 15) for count in self.obstacles]
        for count in self.among:
            found += [(f"N, K = {count}", count, steps) for steps in self.steps]
        return found


def measure(sizes: Sizes, rounds: int, tick: Tick) -> list[Row]:
    """Solve every instance of every size with every solver: one row per solve."""
    solvers = registered()
    level = Relaxed(weight=1.0, minimum=0.0)
    rows = []
    for axis, obstacles, steps in sizes.all_of():
        recipe = Recipe(unicycle(), build("regions", ELLIPSE), level, obstacles, steps)
        made = recipe.make(range(sizes.instances))
        for name, solver in solvers.items():
            tick(f"compiling {name}, K = {obstacles}, N = {steps}")
            _solve(solver, made[0])
        for turn in range(rounds):
            tick(f"scaling, K = {obstacles}, N = {steps}, round {turn + 1}")
            for index, one in enumerate(made):
                for name in rotated(list(solvers), turn + index):
                    time, solution = timed(partial(_solve, solvers[name], one))
                    row = {"axis": axis, "obstacles": obstacles, "steps": steps, "set-up": name}
                    row |= {"instance": index, "round": turn, "ms": time}
                    rows.append(row | judged(one, solution))
    return rows


def judged(made: Made, solution: Solution) -> Row:
    """Return what a solver says of its plan, and its largest violation by the planner's check."""
    return {
        "iterations": solution.iterations,
        "solved": solution.status is Status.SOLVED,
        "cost": solution.cost,
        "violation": violation(made.problem, made.parameters, solution.point).worst,
    }


def ticks(sizes: Sizes, rounds: int) -> int:
    """Count the ticks of `measure` and `crowds`."""
    return len(sizes.all_of()) * (len(registered()) + rounds) + len(sizes.seen)


def crowds(sizes: Sizes, tick: Tick) -> list[Row]:
    """Time decisions among growing crowds of which `NEAR` people at most are within reach.

    Those stand around the robot, the others so far off that no plan meets them. Each crowd is seen
    by two planners in turn, after their first decision, in which they solve from all starts: one
    that leaves out what it cannot reach, and one made to assume that it reaches all, so that
    the nearest take all slots. ``slots`` are those in use; ``choosing_ms`` is the part of the
    decision that fills them. Medians of processor time.
    """
    rows = []
    for count in sizes.seen:
        tick(f"a crowd of {count}")
        crowd = Crowd(count)
        for screened in (True, False):
            crowd.decide(screened)  # compiles
        taken = [
            (screened, *crowd.decide(screened))
            for _ in range(sizes.decisions)
            for screened in (True, False)
        ]
        for screened in (True, False):
            own = np.array([one[1:] for one in taken if one[0] is screened])
            row = {"seen": count, "left out": "out of reach" if screened else "none"}
            names = ("decision_ms", "choosing_ms", "slots", "no_room")
            rows.append(row | dict(zip(names, np.median(own, axis=0).tolist(), strict=True)))
    return rows


class Crowd:
    """People around the recommended planner, which decides again and again from one place.

    Parameters
    ----------
    count : of them.
    """

    def __init__(self, count: int) -> None:
        rng = np.random.default_rng(count)
        near, angle = min(count, NEAR), rng.uniform(-np.pi, np.pi, count)
        away = np.where(np.arange(count) < near, rng.uniform(4.0, 7.0, count), 60.0 + 0.5 * angle)
        self._places = away[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        self._settings = changed(
            recommended("unicycle", speed=1.25, quiet=True), solver=build("solvers", OWN)
        )
        known = Services.of(self._settings)
        everywhere = replace(known, travel=replace(known.travel, speed=np.inf))
        self._services = {True: known, False: everywhere}
        path = Path(np.array([[0.0, 0.0], [40.0, 0.0]]))
        state = PlannerState.initial(self._settings, path)
        for tick in range(WARM):
            state = remember(self._settings, state, self._seen(tick))
        self._states = {}
        for screened, services in self._services.items():
            seen = self._seen(WARM)
            self._states[screened] = step(self._settings, state, seen, services)[0]

    def decide(self, screened: bool) -> tuple[float, float, int, int]:
        """Return ms of a decision and of its choice of obstacles, slots in use, and left out."""
        spent, choose = [0.0], GaussianDiscs.choose

        def timed_choice(
            kind: GaussianDiscs, robot: Robot, view: PlanningContext
        ) -> SlotAssignment:
            begin = thread_time()
            found = choose(kind, robot, view)
            spent[0] += 1e3 * (thread_time() - begin)
            return found

        GaussianDiscs.choose = timed_choice  # type: ignore[method-assign]
        begin = thread_time()
        given = self._settings, self._states[screened], self._seen(WARM + 1)
        _, made = step(*given, self._services[screened])
        taken = 1e3 * (thread_time() - begin)
        GaussianDiscs.choose = choose  # type: ignore[method-assign]
        assert made.solved is not None
        slots = made.solved.instance.parameters.slots
        used = int(sum(one.active.sum() for one in slots))
        return taken, spent[0], used, len(made.plan.left_out)

    def _seen(self, tick: int) -> Observation:
        noise = np.random.default_rng(tick).normal(scale=0.01, size=self._places.shape)
        spread = 1e-4 * np.eye(2)
        found = [
            Detection(f"{i:03}", place, spread, 0.3)
            for i, place in enumerate(self._places + noise)
        ]
        return Observation(self._settings.period * tick, np.zeros(5), tuple(found))


def table(solves: Sequence[Row]) -> list[Row]:
    """One row per size and solver: best repeats, iterations, success, and the cost by the best.

    ``near_best`` is the share of solves whose cost is within 0.1 % of the lowest feasible one.
    """
    rows = []
    for axis, obstacles, steps in dict.fromkeys(_size(row) for row in solves):
        here = [row for row in solves if _size(row) == (axis, obstacles, steps)]
        least = _least(here)
        for label in labels(here):
            own = [row for row in here if row["set-up"] == label]
            best = [min(found) for found in repeats(own, label).values()]
            kept = np.array([row["solved"] and row["violation"] <= LOOSE for row in own])
            near = [row["cost"] <= 1e-3 + 1.001 * least[row["instance"]] for row in own]
            row = {"axis": axis, "obstacles": obstacles, "steps": steps, "set-up": label}
            row |= {"best_median_ms": float(np.median(best)), "best_max_ms": float(np.max(best))}
            row["iterations"] = float(np.median([one["iterations"] for one in own]))
            row["iterations_max"] = max(one["iterations"] for one in own)
            row["solved"] = float(kept.mean())
            rows.append(row | {"near_best": float((kept & np.array(near)).mean())})
    return rows


def slopes(rows: Sequence[Row]) -> list[Row]:
    """One row per axis and solver: exponent b of time = a size^b over all sizes of `table`.

    ``per_iteration`` is that of the time over the number of iterations: how the work grows, where
    ``slope`` holds also that larger instances are harder.
    """
    found = []
    for axis in dict.fromkeys(row["axis"] for row in rows):
        for label in labels(rows):
            own = [row for row in rows if (row["axis"], row["set-up"]) == (axis, label)]
            sizes = [row["obstacles" if axis.startswith("K") else "steps"] for row in own]
            if len(set(sizes)) < 2:
                continue
            times = [row["best_median_ms"] for row in own]
            each = [row["best_median_ms"] / max(row["iterations"], 1) for row in own]
            row = {"axis": axis, "set-up": label, "from": min(sizes), "to": max(sizes)}
            found.append(row | {"slope": slope(sizes, times), "per_iteration": slope(sizes, each)})
    return found


def _solve(solver: Solver, made: Made) -> Solution:
    return solver.solve(made.problem, made.parameters, [made.guess])[0]


def _size(row: Row) -> tuple[str, int, int]:
    return row["axis"], row["obstacles"], row["steps"]


def _least(rows: Sequence[Row]) -> dict[int, float]:
    """Lowest cost of a feasible plan, by instance; infinite where there is none."""
    found: dict[int, float] = {}
    for row in rows:
        cost = row["cost"] if row["violation"] <= LOOSE else np.inf
        found[row["instance"]] = min(found.get(row["instance"], np.inf), cost)
    return found
