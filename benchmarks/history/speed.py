"""Work that asv times in each commit, in processor time; `asv.conf.json` says how.

The suite comes from this checkout and the package from the commit, so that it uses what users use.
"""

from pathlib import Path
from time import process_time
from typing import Any, ClassVar

import numpy as np

import wideberth

wideberth.__path__.append(str(Path(__file__).resolve().parents[2]))  # a wheel has no benchmarks

from wideberth.benchmarks.recorded_instances import (  # noqa: E402
    ELLIPSE,
    SAMPLE,
    paper_problem,
    read_instances,
)
from wideberth.framework import recommended  # noqa: E402
from wideberth.framework.mpc.solver import solve_many  # noqa: E402
from wideberth.framework.plugins.config import build  # noqa: E402
from wideberth.framework.predictor import Adaptive  # noqa: E402
from wideberth.framework.risk.collision_probability import collision_probability  # noqa: E402
from wideberth.framework.values.motion import Detection, Observation  # noqa: E402
from wideberth.framework.values.path import Path as Course  # noqa: E402
from wideberth.framework.values.tracks import Tracks  # noqa: E402
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent  # noqa: E402
from wideberth.simulation.engine.episode import run_episode  # noqa: E402
from wideberth.simulation.engine.settings import Settings  # noqa: E402

SPEED, PERIOD = 1.25, 0.2
"""m/s and s, of decisions."""
WARM, DECISIONS = 20, 20
"""Observations before the first decision, and decisions."""
SAMPLES, STEPS = 20, 15
"""Samples of history and steps ahead, of forecasts."""
PAIRS = 5000
"""Collision probabilities in one call."""
DRIVE = 2.0
"""s of simulation in an episode."""


class Timed:
    """What all measures share: processor time of the process."""

    timer = staticmethod(process_time)
    timeout = 300.0
    rounds, repeat, warmup_time = 3, (3, 5, 5.0), 0.0  # set up by a first call


class Solves(Timed):
    """Recorded problems with ten obstacles."""

    params: ClassVar = ["riccati", "fatrop", "ipopt"]
    param_names: ClassVar = ["solver"]

    def setup(self, name: str) -> None:
        """Read and compile."""
        found = read_instances(SAMPLE, build("regions", ELLIPSE))
        self.instances = [one for one in found if one.obstacles == 10]
        self.problem, self.solver = paper_problem(ELLIPSE, 10), build("solvers", name)
        self.time_one_by_one(name)

    def time_one_by_one(self, _: str) -> None:
        """Solve one after the other."""
        for one in self.instances:
            self.solver.solve(self.problem, one.parameters, [one.guess])

    def time_together(self, _: str) -> None:
        """Solve a hundred in one call, by one thread."""
        many = (self.instances * 100)[:100]
        parameters, guesses = [one.parameters for one in many], [one.guess for one in many]
        solve_many(self.solver, self.problem, parameters, guesses, 1)


class Decisions(Timed):
    """Twenty decisions of the recommended planner on a straight drive among people."""

    params: ClassVar = [["adaptive_conformal", "kalman"], [5, 40]]
    param_names: ClassVar = ["predictor", "people"]
    number = 1

    def setup(self, predictor: str, people: int) -> None:
        """Let the planner see what comes before."""
        rng = np.random.default_rng(1)
        ticks = WARM + DECISIONS
        self.starts = rng.uniform([2.0, -4.0], [12.0, 4.0], (people, 2))
        self.walk = rng.normal(scale=0.6, size=(people, 2))
        self.noise = rng.normal(scale=0.02, size=(ticks, people, 2))
        self.planner = recommended("unicycle", SPEED, predictor=predictor, quiet=True)
        self.planner.set_path(Course(np.array([[0.0, 0.0], [40.0, 0.0]])))
        for tick in range(WARM):
            self.planner.remember(self.seen(tick))
        self.planner.command(self.seen(WARM))

    def seen(self, tick: int) -> Observation:
        """Return what is seen at an instant, the same whatever was decided."""
        time = PERIOD * tick
        places = self.starts + time * self.walk + self.noise[tick]
        people = [Detection(str(k), at, 4e-4 * np.eye(2), 0.3) for k, at in enumerate(places)]
        return Observation(time, np.array([SPEED * time, 0.0, 0.0, SPEED, 0.0]), tuple(people))

    def time_decide(self, *_: Any) -> None:
        """Build each observation and decide."""
        for tick in range(WARM + 1, WARM + DECISIONS):
            self.planner.command(self.seen(tick))


class Forecasts(Timed):
    """Forecasts of people by a predictor, which learns from each instant first if it adapts."""

    params: ClassVar = [
        ["constant_velocity", "kalman", "imm", "var", "adaptive_conformal"], [20, 200]
    ]  # fmt: skip
    param_names: ClassVar = ["predictor", "people"]

    def setup(self, name: str, people: int) -> None:
        """Draw walks."""
        rng = np.random.default_rng(2)
        size = (people, SAMPLES + 5, 2)
        walk = rng.normal(size=(people, 1, 2)) + rng.normal(scale=0.1, size=size)
        places = rng.uniform(-8.0, 8.0, (people, 1, 2)) + 0.4 * walk.cumsum(axis=1)
        names, radii = tuple(map(str, range(people))), np.full(people, 0.3)
        noise = np.tile(4e-4 * np.eye(2), (people, 1, 1))
        self.windows = [
            Tracks(places[:, row : row + SAMPLES], 0.4, names, radii, noise, 0.4 * row)
            for row in range(5)
        ]
        self.predictor: Any = build("predictors", name)
        self.time_forecast()

    def time_forecast(self, *_: Any) -> None:
        """Forecast at five instants."""
        predictor = self.predictor
        for tracks in self.windows:
            if isinstance(predictor, Adaptive):
                predictor = predictor.update(tracks)
            predictor.predict(tracks, STEPS)


class Risks(Timed):
    """Collision probabilities."""

    def setup(self) -> None:
        """Draw pairs."""
        rng = np.random.default_rng(3)
        root = rng.normal(size=(PAIRS, 2, 2))
        self.covariance = root @ np.swapaxes(root, -1, -2) + 1e-3 * np.eye(2)
        self.offset, self.radius = rng.normal(scale=2.0, size=(PAIRS, 2)), np.full(PAIRS, 0.6)
        self.time_pairs()

    def time_pairs(self) -> None:
        """Compute all in one call."""
        collision_probability(self.offset, self.covariance, self.radius)


class Episode(Timed):
    """Two seconds of simulation of the recommended planner that meets a person."""

    def setup(self) -> None:
        """Make the planner, and drive once."""
        times = np.arange(-10.0, 10.0, 0.2)
        steps = np.stack([np.full(len(times), 3.0), times - 2.0], axis=1)
        self.walker = ReplayAgent("walker", times, steps, 0.3)
        planner = recommended("unicycle", speed=SPEED, quiet=True)
        way = Course(np.array([[0.0, 0.0], [10.0, 0.0]]))
        self.robot = RobotAgent("robot", planner.robot, planner, way, SPEED)
        self.time_drive()

    def time_drive(self) -> None:
        """Drive."""
        run_episode([self.robot], Settings(time_limit=DRIVE, history=2.0), others=[self.walker])


class Start:
    """Starts of Python, in a process each."""

    rounds, repeat = 3, (3, 5, 10.0)

    def timeraw_import_package(self) -> str:
        """Import the package."""
        return "import wideberth"

    def timeraw_import_planner(self) -> str:
        """Import the planner."""
        return "import wideberth.framework.mpc.planner.planner"

    def timeraw_help(self) -> str:
        """Print the help of the command line."""
        return "from wideberth.experiments.cli.app import main; main(['--help'])"
