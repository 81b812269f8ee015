"""What the last plan's multipliers save: each solve cold and warm, from the same guess.

    python benchmarks/warm_start.py --recorded FILE
    python benchmarks/warm_start.py --loop --hertz 20 2 --seeds 5 6 --seconds 20

On recorded instances (see `wideberth.tests.oracles.recorded_instances`) every solve begins from
the plan before it, a whole step earlier. In closed loop the planner drives among the walkers of
`walker_field.Field`, at a period that is a share of its step, and commands what the warm solve
found.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
from measuring import Row, markdown
from set_ups import ELLIPSE, paper_problem, suited, unicycle
from walker_field import Field

from wideberth.framework import Detection, Observation
from wideberth.framework import Path as Route
from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.rollout import follow, shift
from wideberth.framework.mpc.planner.starts import KeptMultipliers
from wideberth.framework.mpc.slots.base import SlotAssignment
from wideberth.framework.mpc.solver import Solution, Solver
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import step
from wideberth.framework.values.plan import Status
from wideberth.solvers.riccati.solver import Riccati
from wideberth.tests.oracles.recorded_instances import Instance, read_instances

REPEATS = 3
NEAREST = 0.5
"""m. A recorded obstacle is the one before whose mean is nearest, at most so far away."""
NOISE = 0.02
"""m, of what the robot sees of the walkers."""
ENTERING = 12.0
"""s, until most walkers have come in, before the robot starts."""


@dataclass(eq=False)
class Both(Solver):
    """Solves from multipliers, and once more without; keeps both in ``pairs``.

    With ``aimed`` the latter starts at the level aimed at, as the planner's does.
    """

    inner: Riccati = field(default_factory=Riccati)
    pairs: list[Row] = field(default_factory=list)
    label: str = ""
    aimed: bool = False

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess."""
        return [self._one(problem, parameters, guess) for guess in guesses]

    def _one(self, problem: Problem, parameters: Parameters, guess: Guess) -> Solution:
        if guess.multipliers is None:
            return self.inner.solve(problem, parameters, [guess])[0]
        level = parameters.target if self.aimed and problem.shared else guess.level
        ways = {"cold": replace(guess, multipliers=None, level=level), "warm": guess}
        row: Row = {"label": self.label}
        for turn in range(REPEATS):
            for way in list(ways)[:: 1 if turn % 2 else -1]:
                begin = thread_time()
                (found,) = self.inner.solve(problem, parameters, [ways[way]])
                spent = 1e6 * (thread_time() - begin)
                row[f"{way}_us"] = min(spent, row.get(f"{way}_us", np.inf))
                row |= {f"{way}_iterations": found.iterations, f"{way}_cost": found.cost}
                row[f"{way}_solved"] = found.status is Status.SOLVED
                if way == "warm":
                    solution = found
        self.pairs.append(row)
        return solution


def recorded(file: Path, region: str) -> list[Row]:
    """Solve recorded instances in turn, each from the plan before it."""
    instances = [suited(one, region) for one in read_instances(file, build("regions", region))]
    solver = Both()
    for kind, sequence in sequences(instances):
        before: tuple[Instance, Solution] | None = None
        for one in sequence:
            solver.label = kind
            problem = paper_problem(region, one.obstacles)
            guess = one.guess if before is None else _continued(one, *before, region)
            (solution,) = solver.solve(problem, one.parameters, [guess])
            before = (one, solution) if solution.status is Status.SOLVED else None
    return solver.pairs


def sequences(instances: Sequence[Instance]) -> Iterator[tuple[str, list[Instance]]]:
    """Yield what one robot met in turn.

    Two robots took turns in an encounter; one alone crossed a field twice.
    """
    for kind in dict.fromkeys(one.kind for one in instances):
        own = [one for one in instances if one.kind == kind]
        half = len(own) // 2
        alone = kind.startswith("field")
        for part in (own[:half], own[half:]) if alone else (own[::2], own[1::2]):
            yield kind, part


def _continued(one: Instance, last: Instance, plan: Solution, region: str) -> Guess:
    """Shift the plan before by a step, with its multipliers."""
    inputs = shift(plan.point.inputs, 1.0)
    states = follow(unicycle(), one.parameters.initial, inputs, 0.5)
    guess = replace(one.guess, states=states, inputs=inputs, level=plan.point.level)
    guess = suited(replace(one, guess=guess), region).guess
    means, before = one.ellipses[0][:, 0], last.ellipses[0][:, 1]
    apart = np.linalg.norm(means[:, None] - before[None], axis=-1)
    own = [str(row.argmin()) if row.min() < NEAREST else f"new {k}" for k, row in enumerate(apart)]
    kept = KeptMultipliers.of(plan.point, (_named([str(k) for k in range(len(before))]),))
    if kept is None:
        return guess
    return replace(guess, multipliers=kept.at(1.0, one.parameters, (_named(own),)))


def _named(names: Sequence[str]) -> Any:
    """Stand for the things of one kind, of which their names alone count."""
    return replace(_NOTHING, names=tuple(names))


_NOTHING = SlotAssignment((), (), (), None, None)  # type: ignore[arg-type]


def closed_loop(hertz: float, seed: int, seconds: float, region: str = ELLIPSE) -> list[Row]:
    """Drive among ten walkers; every solve from multipliers is done cold as well."""
    solver = Both(label=f"{hertz:g} Hz", aimed=True)
    planner = Planner(
        unicycle(), build("regions", region), build("predictors", "kalman"),
        build("levels", "relaxed"), solver, period=1.0 / hertz, penalty=1e5,
    )  # fmt: skip
    for _ in crossing(planner, seed, hertz, seconds):
        pass
    return solver.pairs


def crossing(
    planner: Planner, seed: int, hertz: float, seconds: float, far: float = np.inf
) -> Iterator[tuple[float, float]]:
    """Drive straight through a field of ten walkers, which the robot sees with noise.

    Parameters
    ----------
    planner : decides; the robot drives the first input of its plan exactly.
    seed : of the walkers and the noise.
    hertz : decisions in a second.
    seconds : s, the longest drive.
    far : m, where the drive ends.

    Yields
    ------
    Distance to the nearest walker's surface and the place along the path, m, after each decision.
    """
    robot, period = planner.robot, 1.0 / hertz
    rng = np.random.default_rng(seed)
    walkers = Field(rng)
    planner.set_path(Route(np.array([[-8.0, 0.0], [30.0, 0.0]])))
    state = np.array([-7.0, 0.0, 0.0, 0.0, 0.0])
    for tick in range(round((seconds + ENTERING) * hertz)):
        walkers.advance(period)
        seen = tuple(
            Detection(name, place + NOISE * rng.standard_normal(2), NOISE**2 * np.eye(2), radius)
            for name, place, radius in walkers.present()
        )
        observation = Observation(tick * period, state, seen)
        if tick < ENTERING * hertz:
            planner.remember(observation)
            continue
        planner.command(observation)
        plan = planner.plan
        assert plan is not None
        yield float(walkers.gaps(state[:2], robot.radius).min()), float(state[0])
        if state[0] >= far:
            return
        state = np.array(step(robot, tuple(state), tuple(plan.inputs[0]), period))


def summary(rows: Sequence[Row]) -> list[Row]:
    """One row per label, and one of all."""
    found = []
    for label in [*dict.fromkeys(row["label"] for row in rows), "all"]:
        own = [row for row in rows if label in ("all", row["label"])]
        one: Row = {"of": label, "solves": len(own)}
        for way in ("cold", "warm"):
            iterations = [row[f"{way}_iterations"] for row in own]
            times = np.array([row[f"{way}_us"] for row in own])
            one[f"{way}_iterations"] = float(np.mean(iterations))
            one[f"{way}_p99"] = float(np.percentile(iterations, 99))
            one[f"{way}_us"], one[f"{way}_us_p99"] = np.percentile(times, [50, 99]).tolist()
            one[f"{way}_solved"] = float(np.mean([row[f"{way}_solved"] for row in own]))
        one["sums"] = sum(row["cold_us"] for row in own) / sum(row["warm_us"] for row in own)
        cold, warm = (np.array([row[f"{way}_cost"] for row in own]) for way in ("cold", "warm"))
        gap = (warm - cold) / (1.0 + np.abs(cold))
        one |= {"dearer": float(np.mean(gap > 1e-3)), "cheaper": float(np.mean(gap < -1e-3))}
        found.append(one)
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recorded", type=Path)
    parser.add_argument("--region", default=ELLIPSE)
    parser.add_argument("--loop", action="store_true")
    parser.add_argument("--hertz", type=float, nargs="+", default=[20.0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    asked = parser.parse_args()
    if asked.recorded is not None:
        print(markdown("Recorded", summary(recorded(asked.recorded, asked.region))))
    if asked.loop:
        rows = [
            row for hertz in asked.hertz for seed in asked.seeds
            for row in closed_loop(hertz, seed, asked.seconds, asked.region)
        ]  # fmt: skip
        print(markdown("Closed loop", summary(rows)))


if __name__ == "__main__":
    main()
