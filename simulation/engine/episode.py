"""The event loop: robots that decide at their own rates, and everything that moves between."""

import heapq
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import count
from math import ceil
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np

from ...framework.controller import Controller, avoids_polygons
from ...framework.values.arrays import Array, whole
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Command, Observation, Truth
from ...framework.values.polygon import Polygon
from ...metrics.gaps import BodyMotion, gaps, wall_gaps
from ..log.episode_log import AgentLog, CommandLog, Episode
from .agents import Bystander, CrowdMember, PathChange, ReplayAgent, RobotAgent, ScriptedAgent
from .driver import Driver
from .exchanged_positions import ExchangedPositions
from .foresight import Foresight, Planned
from .settings import STILL, Settings
from .world import Around, World

ROBOT_ROOM = 5.0
"""m between the centres of a robot and of a person who appears; pedestrian_simulator's."""

_SAME = 1e-9
"""s; instants closer together than this are one."""


class Respawning:
    """Brings people back to where they started, one instant after they arrived.

    The one who appears is another person: another name, a log of its own, nothing remembered. So
    no one sees a person jump: for the others one person is no longer detected and another one
    comes into sight, and in the log each is absent (NaN) while it is not there. "person 3" is
    followed by "person 3 (2)", on the same path and with the same body, speed and controller; a
    number that makes the name of another one is left out.

    Where the start is taken (a robot within `ROBOT_ROOM`, or a body that would be touched) they
    stand at the goal until it is free. So there are always as many people as at first.

    Parameters
    ----------
    drivers : who decides; those who come anew have to be added to it.
    others : who else moves.
    polygons : what stands there.
    world : gives them their bodies.
    """

    def __init__(
        self,
        drivers: Sequence[Driver],
        others: Sequence[Bystander],
        polygons: Sequence[Polygon],
        world: World,
    ) -> None:
        self._drivers, self._others, self._polygons = drivers, others, polygons
        self._world = world
        self._names = {one.name: (one.name, 1) for one in drivers if one.agent.respawn}

    def clone(self, drivers: Sequence[Driver], world: World) -> "Respawning":
        """Return another one, in the same state, for copies of the drivers in another world."""
        twin = Respawning(drivers, self._others, self._polygons, world)
        twin._names = dict(self._names)
        return twin

    def newcomers(self, now: float) -> list[tuple[Driver, int]]:
        """Replace people who arrived before ``now``, s, where there is room; return the new ones.

        Returns
        -------
        newcomers : who appears at this instant, each with the number of its first tick.
        """
        found: list[tuple[Driver, int]] = []
        arrived = [
            one
            for one in self._drivers
            if one.agent.respawn and one.present and one.reached < now - _SAME
        ]
        for one in arrived:
            if not self._free(one, now, [driver for driver, _ in found]):
                continue
            agent = replace(one.agent, name=self._next(one.name, [d.name for d, _ in found]))
            one.leave()
            driver = Driver(agent, self._world.newcomer(agent), now, len(one.states) - 1)
            period = agent.controller.period
            found.append((driver, ceil((now - agent.phase) / period - _SAME)))
        return found

    def _next(self, name: str, coming: Sequence[str]) -> str:
        """Return a name for the successor of a person, which no agent has or had."""
        first, last = self._names[name]
        taken = {one.name for one in (*self._drivers, *self._others, *self._polygons)} | {*coming}
        number = next(n for n in count(last + 1) if f"{first} ({n})" not in taken)
        found = f"{first} ({number})"
        self._names[found] = first, number
        return found

    def _free(self, one: Driver, now: float, coming: Sequence[Driver]) -> bool:
        """Whether a person can appear where this one started."""
        start = one.agent.path.points[0]
        for other in (*self._drivers, *coming):
            room = one.radius + other.radius if other.agent.person else ROBOT_ROOM
            # An agent that has left is at NaN, and so in no one's way.
            if other is not one and _distance(start, other.positions[-1]) < room:
                return False
        asked = np.array([now])
        return not any(
            _distance(start, other.at(asked)[0]) < one.radius + other.radius
            for other in self._others
        )


def _distance(first: Array, second: Sequence[float] | Array) -> float:
    return float(np.linalg.norm(np.asarray(first) - np.asarray(second)))


_CHANGE, _EFFECT, _TICK = 0, 1, 2
"""Order of events at one instant: new paths, then commands that arrive, then decisions."""


_WATCHER: ContextVar["Callable[[Run], None] | None"] = ContextVar("watcher", default=None)


@contextmanager
def watched(watcher: "Callable[[Run], None]") -> Iterator[None]:
    """Call a function after every step of the episodes that run in this block.

    Parameters
    ----------
    watcher : sees a run that it must not change, such as
        `wideberth.simulation.drawing.watch.WatchWindow`.
    """
    before = _WATCHER.set(watcher)
    try:
        yield
    finally:
        _WATCHER.reset(before)


Casting: TypeAlias = Callable[["Run", Sequence[RobotAgent]], Sequence[RobotAgent]]
"""Takes a run that is about to begin, and those who decide in it; returns who decides instead."""
_CASTING: ContextVar[Casting | None] = ContextVar("casting", default=None)


@contextmanager
def recast(casting: Casting) -> Iterator[None]:
    """Let a function replace those who decide in the episodes that begin in this block.

    Parameters
    ----------
    casting : is called before each episode begins; of the run it may read the settings and seed,
        and keep it. Names and places of the agents stay.
    """
    before = _CASTING.set(casting)
    try:
        yield
    finally:
        _CASTING.reset(before)


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
        world: World | None = None,
    ) -> None:
        self.settings = settings
        self.seed: int = whole("seed", seed, least=0)
        if (casting := _CASTING.get()) is not None:
            robots = casting(self, robots)
        check_cast(robots, others, changes, polygons)
        self.polygons: tuple[Polygon, ...] = tuple(
            one if one.name else replace(one, name=f"polygon {i}")
            for i, one in enumerate(polygons, start=1)
        )
        self.clock: list[float] = [0.0]
        self.world: World = ExchangedPositions(settings) if world is None else world
        self.others: list[Bystander] = [*others, *self.world.others()]
        plants = self.world.plants(robots, self.others, self.polygons, self.seed)
        self.drivers: list[Driver] = [
            Driver(agent, plant) for agent, plant in zip(robots, plants, strict=True)
        ]
        self.around: Around = Around(
            self.drivers, self.others, self.polygons, self.clock, self.seed
        )
        self.stood: float = 0.0
        self.ended: str = ""
        self.waiting: list[tuple[Driver, int, Observation]] = []
        self.pending: list[tuple[Driver, int, Observation]] = []
        self.queue: list[tuple[float, int, int, Any]] = []
        self.order: Iterator[int] = count()
        self.respawning: Respawning = Respawning(
            self.drivers, self.others, self.polygons, self.world
        )
        by_name = {driver.name: driver for driver in self.drivers}
        for change in changes:
            self._push(change.time, _CHANGE, (by_name[change.agent], change.path))
        for driver in self.drivers:
            self._push(driver.agent.phase, _TICK, (driver, 0))
        self._remember()

    def advance(self, name: str = "") -> Observation | None:
        """Run until the robot ``name`` has to decide, and return its observation; None at the end.

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
            if (watcher := _WATCHER.get()) is not None:
                watcher(self)
        return None

    def advance_to(self, time: float) -> None:
        """Run until an instant, s, or to the end; what is decided at it is still to come."""
        for decision in self.waiting:
            self._decide(*decision)
        self.waiting = []
        while not self.ended and self.clock[-1] < time - _SAME:
            self._handle_events("")
            self.ended = self._step() or self._verdict()

    def clone(self, controllers: Mapping[str, Controller] | None = None) -> "Run":
        """Return another run in the same state; neither of the two changes the other.

        It goes on as this one does: controllers are copied with all that they remember, and the
        noise hangs on the seed, on names and ticks.

        Parameters
        ----------
        controllers : name -> who decides there from now on, instead of a copy.

        Raises
        ------
        WideberthError : a decision is waiting, or a controller or the world cannot be copied.
        """
        if self.waiting:
            raise WideberthError("a decision is waiting; advance the run before cloning it")
        given = controllers or {}
        twin, world = copy(self), self.world.clone()
        own = {id(one): one.clone(given.get(one.name)) for one in self.drivers}
        twin.world, twin.drivers, twin.clock = world, list(own.values()), [*self.clock]
        twin.others = [*self.others]
        twin.around = Around(twin.drivers, twin.others, self.polygons, twin.clock, self.seed)
        twin.respawning = self.respawning.clone(twin.drivers, world)
        twin.waiting, following = [], next(self.order)
        twin.pending = [(own[id(one)], tick, seen) for one, tick, seen in self.pending]
        twin.order = count(following)
        twin.queue = [
            (time, kind, place, (own[id(payload[0])], payload[1]))
            for time, kind, place, payload in self.queue
        ]
        return twin

    def look(self, name: str) -> Observation:
        """Return a robot's observation at the present instant, also between its decisions."""
        driver = next(driver for driver in self.drivers if driver.name == name)
        return self._observe(driver, self.clock[-1], len(driver.commands) + driver.skipped)

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
            perception=self.world.perception(),
            verdict=self.world.verdict(),
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
                seen = self.world.observe(
                    driver, time, tick, driver.state_before(time), self.around
                )
                driver.agent.controller.remember(seen)

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
        self.pending = [(driver, tick, self._observe(driver, now, tick)) for driver, tick in ticks]
        while self.pending:
            decision = self.pending.pop(0)
            if decision[0].name == name:
                self.waiting.append(decision)
            else:
                self._decide(*decision)

    def _decide(self, driver: Driver, tick: int, observation: Observation) -> None:
        last = driver.agent.controller.last_plan
        observation = self._settled(driver, observation)
        begin = perf_counter()
        command = driver.decide(observation)
        seconds = perf_counter() - begin
        now = observation.stamp
        effect = now + self.settings.latency(seconds)
        plan = driver.agent.controller.last_plan
        seen = None if plan is None else self.world.in_world(driver, plan)
        driver.note(now, effect, command, seconds, seen)
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

    def _observe(self, driver: Driver, time: float, tick: int) -> Observation:
        state = np.array(driver.plant.state)
        seen = self.world.observe(driver, time, tick, state, self.around)
        return seen if seen.truth is None else self._with_foresight(driver, seen)

    def _with_foresight(self, follows: Driver, seen: Observation) -> Observation:
        """Replace the future of people by what they will do if robots keep to their plans.

        Parameters
        ----------
        follows : driver of the robot that receives the truth, which is taken to keep to its plan.
        """
        assert seen.truth is not None
        times, known = seen.truth.times, dict(seen.truth.positions)
        people = frozenset(one.name for one in self.drivers if one.agent.person and one.present)
        simulate = partial(self._foreseen, follows, seen.stamp, times, known)
        return replace(seen, truth=Truth(times, Foresight(known, people, simulate)))

    def _foreseen(
        self, follows: Driver, now: float, times: Array, known: Mapping[str, Array]
    ) -> dict[str, Array]:
        """Simulate people in a copy of the run, with the same noise, among planned robots.

        Parameters
        ----------
        follows : see `_with_foresight`.
        now : s, of the observation.
        times : (T,), s.
        known : identity -> (T, D), m, of all agents without a simulation, past included.

        Returns
        -------
        positions : of people, identity -> (T, D), m; none where the run cannot be copied.

        Raises
        ------
        WideberthError : the run has gone on since.
        """
        if self.clock[-1] > now + _SAME:
            raise WideberthError(
                f"the truth of {now:g} s is asked for at {self.clock[-1]:g} s; people's future is "
                "simulated when it is read, and can be read only at its own instant"
            )
        try:
            twin = self._of_plans(follows, now)
        except WideberthError:
            return {}
        twin.settings = replace(self.settings, time_limit=float(times[-1]) + 1.0)
        for decision in twin.pending:
            twin._decide(*decision)
        while twin.clock[-1] < times[-1] - _SAME:
            twin._handle_events("")
            twin._step()
        ahead, found = times >= now, {}
        for one in twin.drivers:
            if one.agent.person and one.name in known:
                found[one.name] = np.array(known[one.name])
                found[one.name][ahead] = [
                    one.position_at(float(time), twin.clock) for time in times[ahead]
                ]
        return found

    def _of_plans(self, follows: Driver, now: float) -> "Run":
        """Return a copy in which people decide and robots are where their plans say."""
        robots = {one.name: one for one in self.drivers if not one.agent.person}
        twin = self.clone({name: one.agent.controller for name, one in robots.items()})
        robots[follows.name] = follows
        for one in twin.drivers:
            if one.name in robots:
                one.plant = Planned(robots[one.name], now)
        twin.pending = [entry for entry in twin.pending if entry[0].agent.person]
        twin.queue = [entry for entry in twin.queue if entry[3][0].agent.person]
        heapq.heapify(twin.queue)
        return twin

    def _settled(self, driver: Driver, seen: Observation) -> Observation:
        """Return what a robot with the truth observes once people answer its trial plans."""
        for _ in range(self.settings.truth_passes - 1):
            foresight = None if seen.truth is None else seen.truth.positions
            if not isinstance(foresight, Foresight):
                break
            try:
                trial = driver.clone()
            except WideberthError:  # its controller cannot be copied: one pass is all there is
                break
            trial.decide(seen)
            if not foresight.asked:
                break
            seen = self._with_foresight(trial, seen)
        return seen

    def _step(self) -> str:
        """Move on to the next plant step or event, whichever comes first."""
        now, settings = self.clock[-1], self.settings
        if now >= settings.time_limit - _SAME:
            return "time limit"
        grid = (int(now / settings.plant_step + 1e-6) + 1) * settings.plant_step
        target = min(grid, settings.time_limit)
        if self.queue and self.queue[0][0] < target - _SAME:
            target = self.queue[0][0]
        target = self.world.next_instant(now, target)
        self.world.move(now, target - now, self.around)
        for driver in self.drivers:
            driver.advance(now, target - now, settings.goal_tolerance)
        self.clock.append(target)
        for driver, tick in self.respawning.newcomers(target):
            self.drivers.append(driver)
            self._push(driver.tick_time(tick), _TICK, (driver, tick))
        return ""

    def _verdict(self) -> str:
        """Why the episode is over; empty while it is not."""
        settled = self.world.settle(self.around)
        if settled is not None:
            return settled
        now = self.clock[-1]
        if self.settings.stop_on_collision and self._collided():
            return "collision"
        going = [d for d in self.drivers if not d.agent.person and d.reached != d.reached]
        pending = any(kind == _CHANGE for _, kind, _, _ in self.queue)
        if not going and not pending:
            return "goals"
        if pending or any(d.plant.speed >= STILL for d in going):
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
        ways = [(other.radius, other.at(times)) for other in self.others]
        bodies += [BodyMotion(size, way, nowhere) for size, way in ways if np.isfinite(way).any()]
        for i in range(count):
            apart = [gaps(bodies[i], other) for other in bodies[i + 1 :]]
            apart += [wall_gaps(bodies[i], polygon) for polygon in self.polygons]
            if any((gap < 0.0).any() for gap in apart):
                return True
        return False


_KINDS = {ReplayAgent: "replay", ScriptedAgent: "scripted", CrowdMember: "person"}


def _bystander_log(other: Bystander, times: Array) -> AgentLog:
    empty = np.zeros(0)
    positions = other.at(times)
    unknown = np.full(len(times), np.nan)
    return AgentLog(
        name=other.name,
        kind=_KINDS[type(other)],
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


def check_cast(
    robots: Sequence[RobotAgent],
    others: Sequence[Bystander],
    changes: Sequence[PathChange],
    polygons: Sequence[Polygon],
) -> None:
    """Refuse agents that do not fit together.

    Raises
    ------
    WideberthError : as `run_episode`.
    """
    if all(one.person for one in robots):
        raise WideberthError("the episode has no robot; give at least one RobotAgent")
    names = [one.name for one in (*robots, *others, *polygons) if one.name]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise WideberthError(f"agents share the name(s) {repeated}; every agent needs its own")
    sizes = {agent.robot.dimension for agent in robots}
    sizes |= {o.positions.shape[1] for o in others if isinstance(o, ReplayAgent)}
    sizes |= {o.path.points.shape[1] for o in others if isinstance(o, ScriptedAgent)}
    if len(sizes) > 1:
        raise WideberthError(
            f"agents move in {sorted(sizes)} dimensions; one episode has one number of them"
        )
    blind = [one.name for one in robots if polygons and not avoids_polygons(one.controller)]
    if blind:
        raise WideberthError(
            f"there are polygons, and the planner of {blind} has no static_region; set it, for "
            "example to separating_line"
        )
    if polygons and sizes != {2}:
        raise WideberthError(f"polygons lie in the plane; the agents move in {sizes} dimensions")
    known = [agent.name for agent in robots]
    for change in changes:
        if change.agent not in known:
            raise WideberthError(f"a path change names {change.agent!r}; the robots are {known}")
    if len({id(agent.controller) for agent in robots}) < len(robots):
        raise WideberthError("two robots share one controller; each needs one of its own")
