"""The event loop: robots that decide at their own rates, and everything that moves between."""

import heapq
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from math import ceil
from time import perf_counter
from typing import Any

import numpy as np

from ...framework.values.arrays import Array, whole
from ...framework.values.motion import Command, Observation, Truth
from ...framework.values.polygon import Polygon
from ..log.episode_log import AgentLog, CommandLog, Episode
from ..measures.gaps import Course, gaps, wall_gaps
from ..sensing.channel import noise_of
from .agents import Bystander, PathChange, ReplayAgent, RobotAgent
from .cast import check_cast
from .detecting import Detecting
from .driver import Driver
from .respawning import Respawning
from .settings import Settings

_CHANGE, _EFFECT, _TICK = 0, 1, 2
"""Order of events at one instant: new paths, then commands that arrive, then decisions."""

_SAME = 1e-9
"""s; instants closer together than this are one."""


def run_episode(
    robots: Sequence[RobotAgent],
    settings: Settings | None = None,
    *,
    seed: int = 0,
    others: Sequence[Bystander] = (),
    changes: Sequence[PathChange] = (),
    polygons: Sequence[Polygon] = (),
) -> Episode:
    """Run one episode and return its log.

    Events (decisions, commands taking effect, new paths) happen in order of time; between
    them everything moves on by plant steps. Those who decide at the same instant all see
    the world as it was before any of them decided. The episode ends when every robot (people
    do not count) has been at its goal, at a deadlock, or at the time limit; collisions are
    found from the log afterwards unless they shall end it.

    Parameters
    ----------
    robots : those who decide, people as well, at least one robot among them; their
        controllers are reset and get their paths.
    settings : how it is run.
    seed : of the position noise. The same seed, robots and settings give the same episode,
        unless solve times are measured.
    others : recorded and scripted agents.
    changes : paths replaced on the way.
    polygons : what stands still; every robot knows all of them.

    Raises
    ------
    WideberthError : no robots, repeated names, mixed dimensions, a change for no robot.
    """
    run = Run(robots, settings or Settings(), seed, others, changes, polygons)
    run.advance()
    return run.episode()


class Run:
    """One running episode; arguments as of `run_episode`, which goes through it in one go.

    Attributes
    ----------
    ended : why it is over; empty while it is not.
    """

    def __init__(
        self,
        robots: Sequence[RobotAgent],
        settings: Settings,
        seed: int,
        others: Sequence[Bystander],
        changes: Sequence[PathChange],
        polygons: Sequence[Polygon],
    ) -> None:
        check_cast(robots, others, changes, polygons)
        self.polygons = tuple(
            one if one.name else replace(one, name=f"polygon {i}")
            for i, one in enumerate(polygons, start=1)
        )
        self.settings = settings
        self.seed = whole("seed", seed, least=0)
        self.others = tuple(others)
        self.drivers = [Driver(agent) for agent in robots]
        self.clock = [0.0]
        self.stood = 0.0
        self.ended = ""
        self.waiting: list[tuple[Driver, int, Observation]] = []
        self.queue: list[tuple[float, int, int, Any]] = []
        self.order = count()
        self.detecting = Detecting(settings.channel, self.seed, self.drivers, self.others)
        self.respawning = Respawning(self.drivers, self.others, self.polygons)
        by_name = {driver.name: driver for driver in self.drivers}
        for change in changes:
            self._push(change.time, _CHANGE, (by_name[change.agent], change.path))
        for driver in self.drivers:
            self._push(driver.agent.phase, _TICK, (driver, 0))
        self._remember()

    def advance(self, name: str = "") -> Observation | None:
        """Go on until the robot ``name`` has to decide, and return what it sees; None at the end.

        The next call begins with its decision. Without a name all decide as they come, and
        the call returns at the end.
        """
        for decision in self.waiting:
            self._decide(*decision)
        self.waiting = []
        while not self.ended:
            self._handle_events(name)
            if self.waiting:
                return self.waiting[0][2]
            self.ended = self._step() or self._verdict()
        return None

    def look(self, name: str) -> Observation:
        """Return what a robot sees at the present instant, whether it has to decide or not."""
        driver = next(driver for driver in self.drivers if driver.name == name)
        state, tick = np.array(driver.plant.state), len(driver.commands) + driver.skipped
        return self._observe(driver, self.clock[-1], tick, state)

    def episode(self) -> Episode:
        """Return the log up to now."""
        logs = [driver.log() for driver in self.drivers]
        times = np.array(self.clock)
        return Episode(
            times=times,
            agents=(*logs, *(_bystander_log(other, times) for other in self.others)),
            ended=self.ended,
            goal_tolerance=self.settings.goal_tolerance,
            seed=self.seed,
            plan_seconds={driver.name: np.array(driver.seconds) for driver in self.drivers},
            polygons=self.polygons,
        )

    def _push(self, time: float, kind: int, payload: Any) -> None:
        heapq.heappush(self.queue, (time, kind, next(self.order), payload))

    def _remember(self) -> None:
        """Let every controller see the history, tick by tick, up to time 0."""
        for driver in self.drivers:
            period, phase = driver.agent.controller.period, driver.agent.phase
            first = -int((self.settings.history + phase) / period + _SAME)
            for tick in range(first, 0):
                time = phase + tick * period
                state = driver.state_before(time)
                driver.agent.controller.remember(self._observe(driver, time, tick, state))

    def _handle_events(self, name: str) -> None:
        """Do what is due; the decision of the robot ``name`` is left waiting."""
        now = self.clock[-1]
        ticks: list[tuple[Driver, int]] = []
        while self.queue and self.queue[0][0] <= now + _SAME:
            _, kind, _, payload = heapq.heappop(self.queue)
            if kind == _CHANGE and payload[0].present:
                payload[0].take(now, payload[1])
            elif kind == _EFFECT:
                payload[0].plant.command(payload[1], now)
            elif payload[0].present:
                ticks.append(payload)
        seen = [
            (driver, tick, self._observe(driver, now, tick, np.array(driver.plant.state)))
            for driver, tick in ticks
        ]
        for decision in seen:
            if decision[0].name == name:
                self.waiting.append(decision)
            else:
                self._decide(*decision)

    def _decide(self, driver: Driver, tick: int, observation: Observation) -> None:
        last = driver.agent.controller.plan
        begin = perf_counter()
        command = driver.decide(observation)
        seconds = perf_counter() - begin
        now = observation.stamp
        effect = now + self.settings.latency(seconds)
        driver.note(now, effect, command, seconds)
        self._deliver(driver, command, now, effect)
        agent, following = driver.agent, tick + 1
        while agent.phase + following * agent.controller.period < effect - _SAME:
            due = agent.phase + following * agent.controller.period
            instead = driver.meanwhile(due, last)
            if instead is not None:
                self._push(due, _EFFECT, (driver, instead))
            following += 1
            driver.skipped += 1
        self._push(agent.phase + following * agent.controller.period, _TICK, (driver, following))

    def _deliver(self, driver: Driver, command: Command, now: float, effect: float) -> None:
        if effect <= now + _SAME:
            driver.plant.command(command, now)
        else:
            self._push(effect, _EFFECT, (driver, command))

    def _observe(self, driver: Driver, time: float, tick: int, state: Array) -> Observation:
        settings = self.settings
        seen = self.detecting.of(driver, time, tick, self.clock)
        truth = self._truth(driver, time) if driver.agent.truth and time >= 0 else None
        if settings.localisation.exact:
            return Observation(time, state, seen, None, self.polygons, truth)
        rng = noise_of(self.seed, driver.name, driver.name, tick)
        robot, control = driver.agent.robot, driver.plant.control
        estimate, covariance = settings.localisation.measure(robot, state, control, rng)
        return Observation(time, estimate, seen, covariance, self.polygons, truth)

    def _truth(self, driver: Driver, now: float) -> Truth:
        """Past and future of the others on a grid of 0.1 s, from the delay before now on."""
        past = ceil(10 * self.settings.channel.delay) + 10
        ahead = ceil(10 * self.settings.truth_span) + 1
        times = now + 0.1 * np.arange(-past, ahead + 1, dtype=np.float64)
        before = times < now
        positions: dict[str, Array] = {other.name: other.at(times) for other in self.others}
        for other in self.drivers:
            if other is not driver:
                seen = [other.position_at(float(time), self.clock) for time in times[before]]
                future = other.future(times[~before], now)
                positions[other.name] = np.concatenate([np.array(seen), future])
        return Truth(times, positions)

    def _step(self) -> str:
        """Move on to the next plant step or event, whichever comes first."""
        now, settings = self.clock[-1], self.settings
        if now >= settings.time_limit - _SAME:
            return "time limit"
        grid = (int(now / settings.plant_step + 1e-6) + 1) * settings.plant_step
        target = min(grid, settings.time_limit)
        if self.queue and self.queue[0][0] < target - _SAME:
            target = self.queue[0][0]
        for driver in self.drivers:
            driver.advance(now, target - now, settings.goal_tolerance)
        self.clock.append(target)
        for driver, tick in self.respawning.newcomers(target):
            self.drivers.append(driver)
            self._push(driver.tick_time(tick), _TICK, (driver, tick))
        return ""

    def _verdict(self) -> str:
        """Why the episode is over; empty while it is not."""
        now = self.clock[-1]
        if self.settings.stop_on_collision and self._collided():
            return "collision"
        going = [d for d in self.drivers if not d.agent.person and d.reached != d.reached]
        pending = any(kind == _CHANGE for _, kind, _, _ in self.queue)
        if not going and not pending:
            return "goals"
        if pending or any(d.plant.speed >= self.settings.still for d in going):
            self.stood = now
        return "deadlock" if now - self.stood > self.settings.deadlock_after else ""

    def _collided(self) -> bool:
        """Whether a robot touched something within the last step."""
        times = np.array(self.clock[-2:])
        robots = [driver for driver in self.drivers if not driver.agent.person]
        people = [driver for driver in self.drivers if driver.agent.person]
        bodies = [driver.latest() for driver in (*robots, *people)]
        count = len(robots)
        nowhere = np.full(len(times), np.nan)
        bodies += [Course(other.radius, other.at(times), nowhere) for other in self.others]
        for i in range(count):
            apart = [gaps(bodies[i], other) for other in bodies[i + 1 :]]
            apart += [wall_gaps(bodies[i], polygon) for polygon in self.polygons]
            if any((gap < 0.0).any() for gap in apart):
                return True
        return False


def _bystander_log(other: Bystander, times: Array) -> AgentLog:
    empty = np.zeros(0)
    positions = other.at(times)
    unknown = np.full(len(times), np.nan)
    return AgentLog(
        name=other.name,
        kind="replay" if isinstance(other, ReplayAgent) else "scripted",
        radius=other.radius,
        positions=positions,
        headings=unknown,
        speeds=unknown,
        yaw_rates=unknown,
        paths=(),
        speed=np.nan,
        period=np.nan,
        reached=np.nan,
        skipped=0,
        commands=CommandLog(empty, empty, np.zeros((0, positions.shape[1])), empty, empty),
        plans=(),
    )
