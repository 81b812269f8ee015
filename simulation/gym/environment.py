"""A Gymnasium environment around the simulation, for policies that are learnt.

Needs the extra ``learning``. The package registers the environment, and Gymnasium imports it if
the name says so; it has no entry points for this::

    import gymnasium
    environment = gymnasium.make("wideberth.simulation.gym:wideberth/Navigation-v0")
"""

from collections.abc import Mapping
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from ...controllers.policy_observer import ObservationSpec, PolicyObserver
from ...framework.controller import Controller, fresh
from ...framework.plugins.config import build
from ...framework.robot import Robot
from ...framework.values.arrays import Array, positive
from ...framework.values.errors import WideberthError, missing
from ...framework.values.motion import Command, Observation
from ...framework.values.path import Path
from ...framework.values.plan import Plan
from ...metrics.gaps import BodyMotion, gaps, wall_gaps
from ..engine.agents import RobotAgent
from ..engine.driver import Driver
from ..engine.episode import Run
from ..engine.settings import Settings
from ..log.episode_log import Episode
from ..scenarios.base import Cast, Scenario
from . import ID as ID
from .reward import CrowdNavReward, Reward, Transition
from .window import GymWindow

SIDE = 480
"""Pixels."""
ROOM = 2.0
"""m around paths and robots."""


def picture(run: Run, name: str) -> NDArray[np.uint8]:
    """Draw the present scene from above, (480, 480, 3).

    The robot ``name`` is filled and its way dashed; other robots and people are rings with
    their edge in blue, bystanders grey, polygons dark.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Circle

    now = np.array([run.clock[-1]])
    figure = Figure(figsize=(SIDE / 100, SIDE / 100), dpi=100)
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    for polygon in run.polygons:
        axes.fill(*polygon.points.T, color="0.3")
    for other in run.others:
        place = other.at(now)[0]
        if np.isfinite(place).all():
            axes.add_patch(Circle((place[0], place[1]), other.radius, color="0.7"))
    for driver in run.drivers:
        x, y = driver.positions[-1][:2]
        acts = driver.name == name
        axes.add_patch(
            Circle((x, y), driver.radius, facecolor="C1" if acts else "none", edgecolor="C0")
        )
        heading = driver.agent.robot.pose(driver.states[-1]).heading
        if heading is not None:
            tip = driver.radius * np.array([np.cos(heading), np.sin(heading)])
            axes.plot([x, x + tip[0]], [y, y + tip[1]], color="black")
        if acts:
            axes.plot(*driver.paths[-1][1].points.T[:2], "--", color="C1")
            axes.plot(*driver.paths[-1][1].goal[:2], "*", color="C1", markersize=12)
    _frame(axes, run)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba(), dtype=np.uint8)[..., :3].copy()


def _frame(axes: Any, run: Run) -> None:
    """Show the same square throughout an episode: all paths, with room around."""
    points = np.concatenate([driver.paths[0][1].points[:, :2] for driver in run.drivers])
    middle = 0.5 * (points.max(axis=0) + points.min(axis=0))
    half = 0.5 * float(np.ptp(points, axis=0).max()) + ROOM
    axes.set(xlim=middle[0] + half * np.array([-1, 1]), ylim=middle[1] + half * np.array([-1, 1]))
    axes.set_aspect("equal")
    axes.axis("off")


try:
    import gymnasium
    from gymnasium.spaces import Box, Dict
except ImportError as _error:
    raise missing("learning", "the environment needs Gymnasium", _error) from _error

Config: TypeAlias = str | Mapping[str, Any]
"""Name of a plug-in, or a mapping with ``type`` and its settings."""


@final
class NavigationEnv(gymnasium.Env[dict[str, Any], Array]):
    """A Gymnasium environment: one robot of a scenario, driven through `step`.

    An action is a velocity of the robot, in the units of `VelocityBox`, held until the next
    decision; an observation is what `ObservationSpec` describes, in single precision. The
    simulation beneath is that of `run_episode`: the same commands give the same numbers.
    ``reset(seed=n)`` plays the situation that the scenario draws from n, as any experiment does
    with seed n; without a seed the situation is drawn.

    The episode is terminated at the goal, or when the robot touches anybody or anything, found
    between the instants too; it is truncated at the time limit or a deadlock. ``info`` holds
    ``seed``, ``time`` (s), ``clearance`` (m, of the last transition) and ``outcome``: empty,
    "goal", "collision", "time limit" or "deadlock".

    Parameters
    ----------
    scenario : who is there.
    robot : who acts; other robots that the scenario places are of the same kind.
    period : s between two decisions.
    settings : how episodes are run.
    sight : how much the robot sees.
    reward : of each transition.
    name : which of the scenario's robots acts; the first one by default.
    companion : controller of the scenario's other robots; needed where there are any.
    render_mode : None, "rgb_array" for pictures, or "human" for a window, in which each
        decision is shown for the time that it takes.

    Raises
    ------
    WideberthError : a plug-in that cannot be built, an unknown render mode; on `reset`, no
        robot of that name, or other robots without a companion.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["human", "rgb_array"],
        "render_fps": 4,
    }

    def __init__(
        self,
        scenario: Scenario | Config = "crossing_field",
        robot: Robot | Config = "unicycle",
        period: float = 0.25,
        settings: Settings | None = None,
        sight: ObservationSpec | None = None,
        reward: Reward | None = None,
        name: str = "",
        companion: Controller | Config | None = None,
        render_mode: str | None = None,
    ) -> None:
        self._scenario: Scenario = build("scenarios", scenario)
        self._robot: Robot = build("robots", robot)
        self._companion: Controller | None = None
        if companion is not None:
            self._companion = build("controllers", companion)
        positive("period", period)
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise WideberthError(
                f"render_mode is {render_mode!r}; wanted None, 'human' or 'rgb_array'"
            )
        self._period, self._name = period, name
        self._settings = settings or Settings()
        self._sight = sight or ObservationSpec()
        self._reward: Reward = reward or CrowdNavReward()
        self.render_mode = render_mode
        self._actor = _ExternalCommand(PolicyObserver(self._robot, period, self._sight), period)
        box = self._actor.view.box
        self.action_space: gymnasium.Space[Array] = Box(box.low, box.high, dtype=np.float64)
        self.observation_space: gymnasium.Space[dict[str, Any]] = Dict(
            {
                key: Box(low.astype(np.float32), high.astype(np.float32))
                for key, (low, high) in self._actor.view.bounds().items()
            }
        )
        self._window = GymWindow(ID)
        self._run: Run | None = None
        self._finished = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode and return the observation of the first decision."""
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31)) if seed is None else seed
        cast = self._scenario.cast(drawn)
        self._run = cast.begin(self._agents(cast), self._settings, drawn)
        self._finished = False
        seen = self._run.advance(self._acting)
        self._watch()
        return self._shown(seen), self._info(float("inf"), "")

    def step(self, action: Array) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Command the velocity ``action`` until the next decision."""
        run = self._running()
        command = self._actor.view.box.command(action)
        self._actor.aim(command)
        before, driver = len(run.clock), self._driver
        begin, away = run.clock[-1], self._away()
        seen = run.advance(driver.name)
        clearance, wall = self._clearances(len(run.clock) - before)
        transition = Transition(
            duration=run.clock[-1] - begin,
            clearance=clearance,
            wall_clearance=wall,
            advance=away - self._away(),
            reached=driver.reached == driver.reached,
            collided=min(clearance, wall) < 0.0,
        )
        terminated = transition.collided or transition.reached
        truncated = bool(run.ended) and not terminated
        outcome = run.ended if truncated else ""
        if terminated:
            outcome = "collision" if transition.collided else "goal"
        self._finished = terminated or truncated
        info = self._info(clearance, outcome)
        self._watch()
        return self._shown(seen), float(self._reward(transition)), terminated, truncated, info

    def render(self) -> Any:
        """Draw the present instant, (height, width, 3), bytes; None but for "rgb_array".

        The window of "human" is drawn by `reset` and `step`.
        """
        if self.render_mode != "rgb_array":
            return None
        return picture(self._present(), self._acting)

    def close(self) -> None:
        """Close the window."""
        self._window.close()

    def _watch(self) -> None:
        if self.render_mode == "human":
            self._window.show(picture(self._present(), self._acting), self._period)

    @property
    def episode(self) -> Episode:
        """The log up to now, as `run_episode` would return it.

        Raises
        ------
        WideberthError : none has begun.
        """
        return self._present().episode()

    def _agents(self, cast: Cast) -> list[RobotAgent]:
        """Return the robots of a cast; the acting one is driven by the actions."""
        names = [one.name for one in cast.placements]
        self._acting = self._name or names[0]
        if self._acting not in names:
            raise WideberthError(f"no robot is called {self._name!r}; the scenario has {names}")
        agents = []
        for one in cast.placements:
            acts = one.name == self._acting
            controller = self._actor if acts else self._company(names)
            truth = not acts or self._sight.predictor is not None
            agents.append(one.agent(self._robot, controller, truth))
        return agents

    def _company(self, names: list[str]) -> Controller:
        """Return a controller for another robot."""
        if self._companion is None:
            raise WideberthError(
                f"the scenario places {names}; give a companion, the controller of all but "
                f"{self._acting!r}"
            )
        return fresh(self._companion)

    def _present(self) -> Run:
        if self._run is None:
            raise WideberthError("no episode has begun; call reset first")
        return self._run

    def _running(self) -> Run:
        if self._finished:
            raise WideberthError("no episode is going on; call reset before step")
        return self._present()

    @property
    def _driver(self) -> Driver:
        """The acting robot."""
        return next(one for one in self._present().drivers if one.name == self._acting)

    def _shown(self, seen: Observation | None) -> dict[str, Any]:
        """Return what is seen, also at the end of an episode, where no decision is due."""
        observation = self._present().look(self._acting) if seen is None else seen
        self._actor.remember(observation)
        shown = self._actor.view.show(observation)
        return {name: value.astype(np.float32) for name, value in shown.items()}

    def _info(self, clearance: float, outcome: str) -> dict[str, Any]:
        run = self._present()
        return {
            "seed": run.seed,
            "time": run.clock[-1],
            "clearance": clearance,
            "outcome": outcome,
        }

    def _away(self) -> float:
        """Straight distance to the goal, m."""
        driver = self._driver
        return float(np.linalg.norm(driver.paths[-1][1].goal - np.array(driver.positions[-1])))

    def _clearances(self, steps: int) -> tuple[float, float]:
        """Smallest clearance from those who move, and from what stands, in the last steps, m."""
        run, own = self._present(), self._driver.latest(steps)
        times = np.array(run.clock[-1 - steps :])
        nowhere = np.full(len(times), np.nan)
        others = [one.latest(steps) for one in run.drivers if one.name != self._acting]
        others += [BodyMotion(one.radius, one.at(times), nowhere) for one in run.others]
        moving = [float(np.nanmin(gap)) for other in others if _known(gap := gaps(own, other))]
        standing = [float(wall_gaps(own, polygon).min()) for polygon in run.polygons]
        return min(moving, default=float("inf")), min(standing, default=float("inf"))


def _known(gap: Array) -> bool:
    """Whether the two were there together."""
    return bool(np.isfinite(gap).any())


@final
class _ExternalCommand(Controller):
    """Returns the command set from outside, and keeps the robot's observer up to date."""

    def __init__(self, view: PolicyObserver, period: float) -> None:
        self.view, self.period = view, period

    def reset(self) -> None:
        """Forget all observations."""
        self.view.reset()

    def set_path(self, path: Path) -> None:
        """Take its end as the goal."""
        self.view.follow(path)

    def remember(self, observation: Observation) -> None:
        """Record the detections."""
        self.view.take(observation)

    def aim(self, command: Command) -> None:
        """Set the command of the next decision."""
        self._next = command
        self.view.commanded(command)

    def command(self, observation: Observation) -> Command:
        """Return the command that was set."""
        return self._next

    @property
    def last_plan(self) -> Plan | None:
        """None: the commands come from outside."""
        return None
