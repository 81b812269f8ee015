"""The work that releases are compared by: one process of one checkout, which measures on request.

Started as ``python work.py CHECKOUT``, with the checkout importable as ``wideberth``. Each line
that it reads names a piece of work; it does it once, and answers with the processor time of one
piece, s, as JSON, or with the reason why it cannot. The work uses what users use, so that it runs
on checkouts of other releases.
"""

import gc
import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any, TypeAlias

import numpy as np

Prepared: TypeAlias = tuple[int, Callable[[], float]]
"""Pieces in one go, and what does them and returns how long it took, s."""

INSTANCES, PASSES = 10, 20
"""Recorded problems that are solved, and how often by what is quick."""
SPEED, PERIOD, WALKERS = 1.25, 0.2, 5
"""m/s, s and number of people, of decisions."""
WARM, DECISIONS = 20, 20
"""Observations before the first decision, and decisions."""
PEOPLE, SAMPLES, STEPS, FORECASTS = 20, 20, 15, (5, 150)
"""Of forecasts: people, samples of history, steps ahead, and how often, by what is quick."""
PAIRS = 5000
"""Collision probabilities in one go."""
DRIVE = 2.0
"""s of simulation in an episode."""


def own_time(work: Callable[[], Any]) -> float:
    """Return the processor time of this process while it does some work, s."""
    begin = process_time()
    work()
    return process_time() - begin


def of_children() -> float:
    """Return the processor time of the processes that were started and have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def unit() -> Prepared:
    """Do a fixed mix of Python and NumPy that no release changes: the unit of all other work."""
    matrix = np.random.default_rng(0).normal(size=(40, 40)) + 40.0 * np.eye(40)

    def work() -> None:
        sum(k * k % 7 for k in range(100_000))
        for _ in range(100):
            np.linalg.solve(matrix, matrix)

    return 1, partial(own_time, work)


def solves(label: str, passes: int) -> Prepared:
    """Solve recorded problems one after the other."""
    from set_ups import ELLIPSE, TOLERANCE, paper_problem, registered
    from solver_speed import SAMPLE, chosen

    instances = chosen(SAMPLE, INSTANCES)
    problems = [paper_problem(ELLIPSE, one.obstacles, len(one.guess.inputs)) for one in instances]
    solver: Any
    if label == "ipopt":
        from paper_program import PaperProgram

        solver = PaperProgram("sx", TOLERANCE)
    else:
        solver = registered()[label]

    def work() -> None:
        for _ in range(passes):
            for problem, one in zip(problems, instances, strict=True):
                solver.solve(problem, one.parameters, [one.guess], None)

    return passes * len(instances), partial(own_time, work)


def decisions() -> Prepared:
    """Decide with the recommended planner on a straight drive, the same whatever it decides."""
    from wideberth.framework import recommended
    from wideberth.framework.values.motion import Detection, Observation
    from wideberth.framework.values.path import Path as Way

    rng = np.random.default_rng(1)
    ticks = WARM + DECISIONS
    starts = rng.uniform([2.0, -4.0], [12.0, 4.0], (WALKERS, 2))
    walk = rng.normal(scale=0.6, size=(WALKERS, 2))
    noise = rng.normal(scale=0.02, size=(ticks, WALKERS, 2))

    def seen(tick: int) -> Any:
        time = PERIOD * tick
        places = starts + time * walk + noise[tick]
        people = tuple(
            Detection(str(k), place, 4e-4 * np.eye(2), 0.3) for k, place in enumerate(places)
        )
        return Observation(time, np.array([SPEED * time, 0.0, 0.0, SPEED, 0.0]), people)

    planner = recommended("unicycle", speed=SPEED, quiet=True)
    planner.set_path(Way(np.array([[0.0, 0.0], [40.0, 0.0]])))

    def decide() -> None:
        for tick in range(WARM, ticks):
            planner.command(seen(tick))

    def work() -> float:
        planner.reset()
        for tick in range(WARM):
            planner.remember(seen(tick))
        return own_time(decide)

    return DECISIONS, work


def forecasts(name: str, repeats: int) -> Prepared:
    """Forecast people with a predictor, which takes note of each instant first if it adapts."""
    from wideberth.framework import Tracks
    from wideberth.framework.plugins.config import build
    from wideberth.framework.predictor import Adaptive

    rng = np.random.default_rng(2)
    rows = SAMPLES + repeats
    walk = 0.4 * (rng.normal(size=(PEOPLE, 1, 2)) + rng.normal(scale=0.1, size=(PEOPLE, rows, 2)))
    places = rng.uniform(-8.0, 8.0, (PEOPLE, 1, 2)) + walk.cumsum(axis=1)
    names, radii = tuple(map(str, range(PEOPLE))), np.full(PEOPLE, 0.3)
    noise = np.tile(4e-4 * np.eye(2), (PEOPLE, 1, 1))
    windows = [
        Tracks(places[:, row : row + SAMPLES], 0.4, names, radii, noise, 0.4 * row)
        for row in range(repeats)
    ]

    def work() -> None:
        predictor: Any = build("predictors", name)
        for tracks in windows:
            if isinstance(predictor, Adaptive):
                predictor = predictor.update(tracks)
            predictor.predict(tracks, STEPS)

    return repeats, partial(own_time, work)


def risks() -> Prepared:
    """Compute collision probabilities."""
    from wideberth.framework.risk.collision_probability import collision_probability

    rng = np.random.default_rng(3)
    root = rng.normal(size=(PAIRS, 2, 2))
    covariance = root @ np.swapaxes(root, -1, -2) + 1e-3 * np.eye(2)
    offset, radius = rng.normal(scale=2.0, size=(PAIRS, 2)), np.full(PAIRS, 0.6)
    return 1, partial(own_time, partial(collision_probability, offset, covariance, radius))


def episode() -> Prepared:
    """Simulate the recommended planner that meets a person; a piece is a second of simulation."""
    from wideberth.framework import recommended
    from wideberth.framework.values.path import Path as Way
    from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
    from wideberth.simulation.engine.episode import run_episode
    from wideberth.simulation.engine.settings import Settings

    times = np.arange(-10.0, 10.0, 0.2)
    steps = np.stack([np.full(len(times), 3.0), 1.0 * (times - 2.0)], axis=1)

    planner = recommended("unicycle", speed=SPEED, quiet=True)
    way = Way(np.array([[0.0, 0.0], [10.0, 0.0]]))

    def work() -> None:
        run_episode(
            [RobotAgent("robot", planner.robot, planner, way, SPEED)],
            Settings(time_limit=DRIVE, history=2.0),
            others=[ReplayAgent("walker", times, steps, 0.3)],
        )

    return round(DRIVE), partial(own_time, work)


def start(code: str) -> Prepared:
    """Start another Python."""

    def work() -> float:
        before = of_children()
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
        return of_children() - before

    return 1, work


WORK: dict[str, Callable[[], Prepared]] = {
    "riccati": partial(solves, "riccati", PASSES),
    "decision": decisions,
    "forecast": partial(forecasts, "adaptive_conformal", FORECASTS[0]),
    "filter": partial(forecasts, "kalman", FORECASTS[1]),
    "risk": risks,
    "episode": episode,
    "import": partial(start, "import wideberth.framework.mpc.planner.planner"),
}
"""What a release can make slower."""
REFERENCES: dict[str, Callable[[], Prepared]] = {
    "ipopt": partial(solves, "ipopt", 1),
    "fatrop": partial(solves, "fatrop", 1),
    "unit": unit,
    "python": partial(start, "pass"),
}
"""What it is compared with in a row of the history."""


def use(checkout: Path) -> None:
    """Have `wideberth` be that of a checkout.

    Raises
    ------
    SystemExit : it is not.
    """
    import wideberth

    found = Path(wideberth.__file__).resolve().parent
    if found != checkout.resolve():
        raise SystemExit(f"this measures {found}; wanted {checkout}")


def main() -> None:
    """Answer each line with the time of one piece; the first call of a work is not timed."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what solvers print is no answer
    use(Path(sys.argv[1]))
    sys.path.insert(0, str(Path(sys.argv[1]) / "benchmarks"))
    ready: dict[str, Prepared] = {}
    for line in sys.stdin:
        name = line.strip()
        try:
            if name not in ready:
                ready[name] = (WORK | REFERENCES)[name]()
                ready[name][1]()
            pieces, work = ready[name]
            gc.collect()
            gc.disable()
            answer: object = work() / pieces
        except Exception as error:  # another release may lack it
            answer = f"{type(error).__name__}: {error}"
        finally:
            gc.enable()
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main()
