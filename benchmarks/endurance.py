"""A robot that drives for long at 20 Hz among ten walkers: does it last, and does it keep time.

It goes from one goal to the next on a round field. The walkers cross the field, make no way, leave
it and come back after a while as another person. Nothing of what has been is kept but numbers in
arrays made beforehand, so that memory which grows is the planner's.
"""

import gc
import os
import re
import sys
from argparse import Namespace
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import pi
from pathlib import Path as File
from time import perf_counter, process_time, thread_time
from typing import Any, final

import numpy as np
from measuring import Row, Tables, spread

from wideberth.framework.mpc.ocp.problem import Parameters, Problem
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.mpc.planner.starts import OTHERS
from wideberth.framework.mpc.solver import (
    CheapestSolver,
    SizelessSolver,
    Solution,
    Solver,
    solve_cheapest,
)
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import start_state
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Rung
from wideberth.simulation.engine.plant import KinematicPlant
from wideberth.simulation.sensing.channel import Channel, noise_of
from wideberth.simulation.sensing.localisation import Localisation

PERIOD = 0.05
"""s between two decisions, and the time that one may take."""
PARTS = 2
"""Plant steps in each of them."""
STEP = 0.5
"""s, of the MPC."""
SETTLED = 1.0 / 12.0
"""Share of a run after which memory may no longer grow: five minutes of an hour."""
SEED = 5
INNER = 6.0
"""m from the middle, within which goals lie: walkers come in three metres farther out."""
ROUND = 20.0
"""s between two looks at memory."""
OUT_OF_ORDER = re.compile(r"\b(\w*(?:Error|Exception|Warning)): ")
"""How a reason names what a plug-in threw."""


@dataclass
class Field:
    """Walkers on a disc, each with a velocity that sways about its mean as in `CrossingField`.

    dv = -(v - mean) / tau dt + sqrt(q) dW per axis. One that leaves the disc is away for up to
    ``pause`` s and then comes in elsewhere under a new name, aimed at a place nearer the middle.
    """

    rng: np.random.Generator
    walkers: int = 10
    reach: float = 9.0
    radius: float = 0.4
    pace: tuple[float, float] = (0.3, 0.7)
    density: float = 0.01
    tau: float = 5.0
    pause: float = 10.0
    place: Array = field(init=False)
    mean: Array = field(init=False)
    sway: Array = field(init=False)
    away: Array = field(init=False)
    number: Array = field(init=False)

    def __post_init__(self) -> None:
        size = (self.walkers, 2)
        self.place, self.mean, self.sway = np.zeros(size), np.zeros(size), np.zeros(size)
        self.away = self.rng.uniform(0.0, self.pause, self.walkers)
        self.number = np.arange(self.walkers, dtype=np.float64)

    def advance(self, dt: float) -> None:
        """Walk for ``dt`` s."""
        keep = float(np.exp(-dt / self.tau))
        deviation = np.sqrt(0.5 * self.density * self.tau * (1.0 - keep**2))
        self.sway = keep * self.sway + deviation * self.rng.standard_normal(self.sway.shape)
        velocity = self.mean + self.sway
        self.place = self.place + dt * velocity
        was = self.away > 0.0
        self.away = np.maximum(self.away - dt, 0.0)
        for k in np.flatnonzero(was & (self.away == 0.0)):
            self._enter(int(k))
        outwards = (self.place * velocity).sum(axis=1) > 0.0
        gone = (np.linalg.norm(self.place, axis=1) > self.reach) & outwards & (self.away == 0.0)
        self.away[gone] = self.rng.uniform(0.0, self.pause, int(gone.sum()))

    def present(self) -> list[tuple[str, Array, float]]:
        """Name, place (2,) in m and radius of all that are there."""
        return [
            (f"walker {self.number[k]:.0f}", self.place[k], self.radius)
            for k in np.flatnonzero(self.away == 0.0)
        ]

    def gaps(self, place: Array, radius: float) -> Array:
        """Distances between their surfaces and that of a disc, m; infinite for those away."""
        apart = np.linalg.norm(self.place - place, axis=1) - self.radius - radius
        return np.where(self.away == 0.0, apart, np.inf)

    def _enter(self, k: int) -> None:
        angle = self.rng.uniform(-pi, pi)
        rim = self.reach * np.array([np.cos(angle), np.sin(angle)])
        aim = self.rng.uniform(-0.5, 0.5, 2) * self.reach
        ahead = (aim - rim) / np.linalg.norm(aim - rim)
        self.place[k], self.sway[k] = rim, 0.0
        self.mean[k] = self.rng.uniform(*self.pace) * ahead
        self.number[k] = self.number.max() + 1


class Solves:
    """Time and end of every solve; room for all that a run can ask for is made beforehand."""

    def __init__(self, most: int) -> None:
        self._times = np.full((2, most), np.nan)
        self._count = 0
        self.ends: Counter[tuple[str, str]] = Counter()

    def add(self, milliseconds: float, cpu: float, solution: Solution) -> None:
        """Note one."""
        self._times[:, self._count] = milliseconds, cpu
        self._count += 1
        self.ends[str(solution.status), shape(solution.message)] += 1

    def forget(self) -> None:
        """Begin anew."""
        self._count = 0
        self.ends.clear()

    @property
    def times(self) -> Array:
        """Milliseconds by the clock and of this thread's work, (2, S)."""
        return self._times[:, : self._count]


@final
@dataclass(frozen=True, eq=False)
class Watched(SizelessSolver, CheapestSolver):
    """Solves from one guess after the other with another solver, and notes each."""

    solver: Solver
    noted: Solves

    def solve(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        deadline: float | None = None,
    ) -> list[Solution]:
        """Solve from each guess."""
        given = problem, parameters
        return [self._noted(self.solver.solve, *given, [one], deadline) for one in guesses]

    def solve_cheapest(
        self,
        problem: Problem,
        parameters: Parameters,
        guesses: Sequence[Guess],
        known: Sequence[Solution],
        within: float,
        deadline: float | None = None,
    ) -> list[Solution]:
        """Do the same, but for what leads to no cheaper plan."""
        given, found = (self.solver, problem, parameters), list(known)
        for one in guesses:
            found.append(self._noted(solve_cheapest, *given, [one], found, within, deadline))
        return found[len(known) :]

    def _noted(self, solve: Callable[..., list[Solution]], *given: Any) -> Solution:
        begin, worked = perf_counter(), thread_time()
        (found,) = solve(*given)
        taken = 1e3 * (perf_counter() - begin), 1e3 * (thread_time() - worked)
        self.noted.add(*taken, found)
        return found


class Run:
    """One set-up's robot on the field, and what is noted of it."""

    def __init__(self, solver: str, steps: int, seed: int, deadline: float | None = None) -> None:
        self.solves = Solves((1 + len(OTHERS)) * (steps + 20))  # some of them warm it up
        planner = set_up(Watched(build("solvers", solver), self.solves), deadline)
        self.planner, self.robot, self.seed = planner, planner.robot, seed
        self.rng = np.random.default_rng(seed)
        self.field = Field(np.random.default_rng([seed, 1]))
        here = Path(np.array([[-INNER, 0.0], [0.0, 0.0]]))
        state, twist = start_state(self.robot, here.points[0], here.direction(np.zeros(1))[0], 0.0)
        self.plant, self.path = KinematicPlant(self.robot, state, twist), here
        planner.set_path(here)
        self.solves.forget()  # what warmed it up
        self.channel = Channel(noise=0.02, dropout=0.02)
        self.localisation = Localisation(position=0.03, heading=0.01, speed=0.02)
        # Filled, not zero: the system hands out zeros when they are first written to.
        self.milliseconds, self.cpu = np.full((2, steps), np.nan)
        self.gap = np.full(steps, np.inf)
        self.memory = np.full(int(steps * PERIOD / ROUND) + 2, np.nan)
        self.memory[0] = resident()
        self.ends: Counter[tuple[str, str, str]] = Counter()
        self.goals = 0
        # What is there by now stays: later collections need not look at it again and again.
        gc.collect()
        gc.freeze()

    def step(self, k: int) -> None:
        """See, decide, and move on until the next decision."""
        now = k * PERIOD
        self._goal()
        seen = self._observe(k, now)
        begin, worked = perf_counter(), process_time()
        command = self.planner.command(seen)  # with the garbage collector's pauses, unlike `timed`
        self.milliseconds[k] = 1e3 * (perf_counter() - begin)
        self.cpu[k] = 1e3 * (process_time() - worked)
        self.plant.command(command, now)
        for part in range(PARTS):
            self.plant.advance(now + part * PERIOD / PARTS, PERIOD / PARTS)
            self.field.advance(PERIOD / PARTS)
            gaps = self.field.gaps(np.array(self.plant.position), self.robot.radius)
            self.gap[k] = min(self.gap[k], gaps.min())
        plan = self.planner.plan
        self.ends[str(plan.rung), str(plan.status), shape(plan.reason)] += 1
        if (k + 1) % round(ROUND / PERIOD) == 0:
            self.memory[(k + 1) // round(ROUND / PERIOD)] = resident()

    def _goal(self) -> None:
        """Take a new goal, some way off, where the last one is reached."""
        place = np.array(self.plant.position)
        if np.linalg.norm(self.path.goal - place) > 0.5:
            return
        goal = place
        while np.linalg.norm(goal - place) < 4.0 or np.linalg.norm(goal) > INNER:
            goal = self.rng.uniform(-INNER, INNER, 2)
        self.path, self.goals = Path(np.stack([place, goal])), self.goals + 1
        self.planner.set_path(self.path)

    def _observe(self, k: int, now: float) -> Observation:
        seen = self.channel.detections(self.seed, "robot", k, self.field.present())
        rng = noise_of(self.seed, "robot", "robot", k)
        known = self.localisation.measure(self.robot, self.plant.state, self.plant.control, rng)
        return Observation(now, known[0], seen, known[1])


def set_up(solver: Solver, deadline: float | None) -> Planner:
    """Return the planner of the run, as recommended for walkers, with a solver."""
    return Planner(
        build("robots", "unicycle"),
        build("regions", "minimum_trace"),
        build("predictors", {"type": "kalman", "acceleration_density": 0.01}),
        build("levels", {"type": "discounted", "tail": 0.05, "final_tail": 0.5}),
        solver,
        dt=STEP,
        period=PERIOD,
        penalty=1e5,
        margin=0.1,
        own_uncertainty="feedback",
        deadline=deadline,
    )


def tables(options: Namespace) -> Tables:
    """Drive with each solver: for long, or, asked for decisions, with a deadline by the clock.

    Two runs without a deadline decide the same. Rows of solves have no rung; their reason is the
    solver's own word.
    """
    lasts, deadline = {"riccati": 3600.0, "fatrop": 300.0}, None
    if options.question == "decisions":
        lasts, deadline = dict.fromkeys(lasts, 20_000 * PERIOD), PERIOD
    rows, ends = [], []
    for solver, duration in lasts.items():
        print(f"driving with {solver}", file=sys.stderr)
        steps = round((3.0 if options.quick else duration) / PERIOD)
        run = Run(solver, steps, SEED, deadline)
        for k in range(steps):
            run.step(k)
        rows.append(
            {"solver": solver, "seed": SEED, "deadline": deadline or np.inf, **summary(run)}
        )
        found = [(end, count) for end, count in run.ends.most_common()]
        found += [(("", *end), count) for end, count in run.solves.ends.most_common()]
        ends += [
            {"solver": solver, "rung": rung, "status": status, "reason": reason, "count": count}
            for (rung, status, reason), count in found
        ]
    return {
        options.question: ("A robot among ten walkers at 20 Hz", rows),
        f"{options.question}_ends": ("How its plans came about", ends),
    }


def summary(run: Run) -> Row:
    """Boil a run down to one row.

    ``over`` is the share of calls, and of single solves, that took more than the period; ``cpu``
    is their time without what this machine gave to others meanwhile; ``touched`` the share of
    steps in contact with a walker, ``touches`` how often that began; ``growth`` that of memory
    from `SETTLED` to the end, nan for shorter runs.
    """
    steps = len(run.milliseconds)
    touched = run.gap < 0.0
    known = run.memory[np.isfinite(run.memory)]
    first = int(np.ceil(SETTLED * steps * PERIOD / ROUND))
    settled = known[first] if 0 < first < len(known) - 1 else float("nan")
    share = Counter[str]()
    for (rung, _, _), count in run.ends.items():
        share[rung] += count
    thrown = sum(count for (*_, reason), count in run.ends.items() if OUT_OF_ORDER.search(reason))
    return {
        "simulated_s": steps * PERIOD,
        "calls": steps,
        **_times("", run.milliseconds),
        **_times("cpu_", run.cpu),
        "solves": run.solves.times.shape[1],
        **_times("solve_", run.solves.times[0]),
        **_times("solve_cpu_", run.solves.times[1]),
        "exceptions": thrown,
        **{str(rung): share[rung] / steps for rung in Rung},
        "goals": run.goals,
        "touches": int((np.diff(touched.astype(int), prepend=0) > 0).sum()),
        "touched": float(touched.mean()),
        "least_gap_m": float(run.gap.min()),
        "memory_settled_MiB": float(settled),
        "memory_end_MiB": float(known[-1]),
        "growth": float(known[-1] / settled - 1.0),
    }


def _times(prefix: str, milliseconds: Array) -> Row:
    found: Row = spread(milliseconds.tolist())
    found["over"] = float((milliseconds > 1e3 * PERIOD).mean())
    return {f"{prefix}{name}": value for name, value in found.items()}


def shape(reason: str) -> str:
    """Return a reason without its numbers and names, so that alike ones can be counted."""
    unnamed = re.sub(r"'[^']*'", "'...'", reason)
    return re.sub(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", "#", unnamed)


def resident() -> float:
    """Memory of this process, MiB; its peak where the system reports no more, nan without that."""
    try:
        pages = int(File("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 2**20
    except OSError:
        pass
    try:
        import resource
    except ImportError:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak / (2**20 if sys.platform == "darwin" else 2**10))
