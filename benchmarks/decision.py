"""Where the time of a whole decision goes, from the building of the observation to the command.

A robot drives along a straight path through walkers and decides again at every step of its plan,
with the recommended planner as it is, and with its predictor replaced by `kalman`.
Times are processor time of the process: the planner calls its solver in another thread, and
nothing else runs. Each drive is done twice: as it is, for the time of whole decisions, and with a
timer around the functions of `STAGES`, for the shares. The timers stand here alone, and what they
cost themselves stays in the second drive.
"""

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import wraps
from importlib import import_module
from itertools import product
from time import process_time
from types import ModuleType
from typing import Any, TypeAlias

import numpy as np
from measuring import Row, Tick, spread

from wideberth.framework import recommended
from wideberth.framework.control.rate_limited_warnings import quiet
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.plugins.config import build
from wideberth.framework.robot import start_state
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Command, Detection, Observation
from wideberth.framework.values.path import Path
from wideberth.framework.values.plan import Plan
from wideberth.simulation.engine.plant import KinematicPlant

SPEED, PERIOD = 1.25, 0.2
"""m/s and s: the speed for which `recommended` takes 25 steps of 0.2 s, and its period."""
SEEN, USED = (1, 3, 10, 40), 10
"""Walkers that are seen, and most that have a slot in the problem."""
REACH, PACE, NOISE = 14.0, 0.6, 0.02
"""m, m/s and m: the square on which walkers are, their speed per axis, the sensor's deviation."""
PREDICTORS: dict[str, dict[str, Any]] = {"recommended": {}, "kalman": {"predictor": "kalman"}}
"""Settings of the planner beside the recommended ones, by what its forecasts are called here."""
WARM, SETTLED = 90, 15
"""Observations before the first decision, more than are kept of a walker; and decisions before the
first that counts: from then on forecasts of every age wait to be compared with what happened."""
SEED = 1

REST, CALIBRATION = "all else", "calibration"
STAGES: dict[str, tuple[str, ...]] = {
    "observation": (
        "framework.values.motion:Detection.__init__",
        "framework.values.motion:Observation.__init__",
    ),
    "detections taken in": (
        "framework.tracking.perception:Perception.take",
        "framework.tracking.history:History.add",
    ),
    "history onto the grid": ("framework.tracking.history:History.tracks",),
    "filter": ("predictors.core.kalman_filter:filtered",),
    "forecast": (
        "predictors.core.kalman_filter:started",
        "predictors.core.kalman_filter:forecast",
    ),
    CALIBRATION: (
        "predictors.adaptive_conformal:AdaptiveConformal.update",
        "predictors.adaptive_conformal:AdaptiveConformal.ahead",
    ),
    "resampling": ("framework.tracking.perception:_on_times",),
    "obstacles chosen, regions": (
        "framework.mpc.slots.gaussian_discs:GaussianDiscs.choose",
        "framework.mpc.slots.static_polygons:StaticPolygons.choose",
    ),
    "roll-out of the last plan": ("framework.mpc.planner.starts:first_trajectory",),
    "starts": (
        "framework.mpc.planner.starts:ReferenceGuess.along",
        "framework.mpc.planner.multistart:_in_the_way",
        "framework.mpc.planner.starts:other_starts",
    ),
    "auxiliaries": ("framework.mpc.planner.starts:suited_each",),
    "solver, in Python": (
        "framework.mpc.planner.watchdog:watched",
        "solvers.riccati.solver:Riccati.solve",
    ),
    "parameters filled in": ("solvers.riccati.workspace:Workspace.fill",),
    "solver, compiled": ("solvers.riccati.workspace:Workspace.run",),
    "re-check": (
        "framework.mpc.planner.verify:violations",
        "framework.mpc.planner.verify:assess_each",
    ),
    "rung chosen": ("framework.mpc.planner.rungs:choose",),
    REST: (),
}
"""Stages, and the functions that they are; a function's own time is without those within it."""

Outcome: TypeAlias = tuple[Command, Plan]


class Drive:
    """A robot, its planner and the walkers; one run of a seed.

    Parameters
    ----------
    predictor : of `PREDICTORS`.
    seen : walkers.
    seed : of their places, velocities and the sensor's noise.
    """

    def __init__(self, predictor: str, seen: int, seed: int) -> None:
        chosen = recommended("unicycle", speed=SPEED, quiet=True, **PREDICTORS[predictor])
        self.planner: Planner = replace(
            chosen, solver=build("solvers", "riccati"), most_obstacles=USED
        )
        self._rng = np.random.default_rng([SEED, seed, seen])
        self._places = self._rng.uniform(-REACH, REACH, (seen, 2))
        self._velocities = PACE * self._rng.standard_normal((seen, 2))
        path = Path(np.array([[-REACH, 0.0], [3.0 * REACH, 0.0]]))
        self._plant = KinematicPlant(
            self.planner.robot, *start_state(self.planner.robot, path.points[0], (1.0, 0.0), 0.0)
        )
        self.planner.set_path(path)
        self._tick = 0
        for _ in range(WARM):
            self.planner.remember(self._observation(*self._measured()))
            self._walk()
        for _ in range(SETTLED):
            self.decide()

    def decide(self, shares: "Shares | None" = None) -> tuple[float, Outcome]:
        """See, decide and move on: s from the numbers measured to the command, and the outcome."""
        measured = self._measured()
        gc.disable()
        begin = process_time()
        if shares is not None:
            shares.begin()
        seen = self._observation(*measured)
        command = self.planner.command(seen)
        if shares is not None:
            shares.end()
        taken = process_time() - begin
        gc.enable()
        self._plant.command(command, self._now)
        self._plant.advance(self._now, PERIOD)
        self._walk()
        return taken, (command, self.planner.plan)

    @property
    def _now(self) -> float:
        return PERIOD * self._tick

    def _walk(self) -> None:
        """Walk on; who leaves the square comes in on the other side, as another person."""
        self._tick += 1
        self._places = self._places + PERIOD * self._velocities

    def _measured(self) -> tuple[Array, Array, list[str]]:
        """Return the robot's state, measured places (O, 2), m, and who is there."""
        span = 2.0 * REACH
        turns = np.floor((self._places + REACH) / span)
        names = [f"{k}, {x:.0f}, {y:.0f}" for k, (x, y) in enumerate(turns)]
        places = self._places - span * turns
        places = places + NOISE * self._rng.standard_normal(self._places.shape)
        return np.array(self._plant.state), places, names

    def _observation(self, state: Array, places: Array, names: list[str]) -> Observation:
        noise = NOISE**2 * np.eye(2)
        detections = tuple(
            Detection(name, place, noise, 0.3) for name, place in zip(names, places, strict=True)
        )
        return Observation(self._now, state, detections)


class Shares:
    """Own time of each stage: the stage that runs is the one whose clock runs.

    The planner waits while its solver's thread works, so that one pile serves both.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        self.calls: dict[str, int] = dict.fromkeys(STAGES, 0)
        self._pile: list[str] = [REST]
        self._since: float = process_time()

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function with the clock of a stage around it."""

        @wraps(function)
        def timed(*given: Any, **named: Any) -> Any:
            self._switch()
            self._pile.append(stage)
            self.calls[stage] += 1
            try:
                return function(*given, **named)
            finally:
                self._switch()
                self._pile.pop()

        return timed

    def _switch(self) -> None:
        now = process_time()
        self.seconds[self._pile[-1]] += now - self._since
        self._since = now

    def begin(self) -> None:
        """Forget what went before: what comes now counts for nothing but `REST`."""
        self._since = process_time()

    def end(self) -> None:
        """Count what came since the last stage ended."""
        self._switch()


@contextmanager
def timers(shares: Shares) -> Iterator[None]:
    """Put the clocks around the functions of all stages, wherever they are known by name."""
    changed: list[tuple[Any, str, Any]] = []
    for stage, names in STAGES.items():
        for name in names:
            owner, attribute, function = stage_function(name)
            plain = function.__func__ if isinstance(function, classmethod) else function
            timed: Any = shares.timed(stage, plain)
            timed = classmethod(timed) if isinstance(function, classmethod) else timed
            holders = [owner]
            if isinstance(owner, ModuleType):
                holders = [one for key, one in sys.modules.items() if key.startswith("wideberth")]
            for holder in holders:
                if vars(holder).get(attribute) is function:
                    changed.append((holder, attribute, function))
                    setattr(holder, attribute, timed)
    try:
        yield
    finally:
        for holder, attribute, function in changed:
            setattr(holder, attribute, function)


def stage_function(name: str) -> tuple[Any, str, Any]:
    """Return a function of `STAGES`, after the module or class that defines it and its name there.

    Raises
    ------
    ModuleNotFoundError, AttributeError, KeyError : it is not there.
    """
    module, _, place = name.partition(":")
    owner: Any = import_module(f"wideberth.{module}")
    *classes, attribute = place.split(".")
    for one in classes:
        owner = getattr(owner, one)
    return owner, attribute, vars(owner)[attribute]


def ticks(drives: int) -> int:
    """Count the ticks of `measure`."""
    return len(PREDICTORS) * len(SEEN) * drives


def measure(drives: int, decisions: int, tick: Tick) -> tuple[list[Row], list[Row]]:
    """Time whole decisions and their stages.

    Returns
    -------
    A row for each predictor and number of walkers, the time of whole decisions without timers; and
    a row for each stage with each of them: ``ms`` is the mean over all decisions of its own time,
    ``share`` its part of all stages, ``calls`` how often its functions are called in a decision.
    """
    rows: list[Row] = []
    stages: list[Row] = []
    with quiet():
        for predictor in PREDICTORS:  # imports and compiles
            Drive(predictor, SEEN[0], 0)
        for predictor, seen in product(PREDICTORS, SEEN):
            shares, taken = Shares(), []
            for seed in range(drives):
                tick(f"{predictor} with {seen} seen, drive {seed + 1}")
                plain = Drive(predictor, seen, seed)
                taken += [1e3 * plain.decide()[0] for _ in range(decisions)]
                watched = Drive(predictor, seen, seed)
                with timers(shares):
                    for _ in range(decisions):
                        watched.decide(shares)
            case = {"predictor": predictor, "seen": seen}
            rows.append({**case, "used": min(seen, USED), **spread(taken)})
            stages += [{**case, **row} for row in _rows(shares, drives * decisions)]
    return rows, stages


def _rows(shares: Shares, decisions: int) -> list[Row]:
    total = sum(shares.seconds.values())
    return [
        {
            "stage": stage,
            "ms": 1e3 * spent / decisions,
            "share": spent / total,
            "calls": shares.calls[stage] / decisions,
        }
        for stage, spent in shares.seconds.items()
    ]
