"""Whether the first contact of an episode could have been avoided shortly before."""

from collections.abc import Iterator, Sequence, Set
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import final

import numpy as np

from ...framework.control.command_limits import attained, within_reach
from ...framework.controller import Controller
from ...framework.robot import Robot
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Command, Observation, Twist
from ...framework.values.path import Path
from ...framework.values.plan import Plan
from ...framework.values.polygon import Polygon
from ...metrics.gaps import BodyMotion, gaps, wall_gaps
from ..engine.agents import Bystander, PathChange, RobotAgent
from ..engine.episode import Run
from ..engine.plant import Plant
from ..engine.settings import Settings
from ..log.episode_log import AgentLog, CommandLog, Episode
from .first_contact import (
    LEADS,
    FirstContact,
    decision,
    first_contact,
    lead_column,
    plan_at,
)
from .kept_clear import HeededRegions

AFTER = 2.0
"""s after the contact, up to which nothing may touch either."""
DRAWN = 240
"""Control sequences that are drawn beside the constant ones."""
BEST = 6
"""Sequences, those with the most room, that are tried among people who react."""
_STREAM = 10
"""Of the generator that draws them, beside those of `Scenario.cast`."""
_BEYOND = 1e3
"""m/s and rad/s, asked of a robot for its limits."""
_SAME = 1e-9
"""s; instants closer together are one. The repeated episode must be as exact, in m."""
_EXTREME = 0.5
"""Chance that a drawn component is an end of its range or 0."""


def avoidable(
    episode: Episode,
    agents: Sequence[RobotAgent],
    settings: Settings,
    others: Sequence[Bystander] = (),
    changes: Sequence[PathChange] = (),
    polygons: Sequence[Polygon] = (),
) -> dict[str, bool | float]:
    """Say whether the first contact could have been avoided, so many s before as in `LEADS`.

    ``avoidable_2s``: from the robot's first decision in the last 2 s before the contact on, one of
    many control sequences keeps it clear of all others and of every wall until 2 s after the
    contact, while all others move as they did. ``avoidable_2s_reacting``: one of the `BEST`
    sequences with the most room does so while the others decide for themselves, as they would have
    done. Others move on after the contact, also where it ended the episode. What avoids it later
    avoids it earlier too, after the commands in between.

    A sequence is one twist, or two with an instant in between, sent at the robot's own decisions
    and driven by its plant. All combinations of the ends of the twist's components and 0 are tried
    for the whole time, and `DRAWN` sequences from a generator that hangs on the episode's seed.
    So "avoidable" is proven by an example; that nothing helps is not: more sequences might.

    ``level_held_2s``: the plan of that decision, or one of these sequences, keeps out of every
    region of the plan at the level aimed at.

    The episode is played once more with the commands that it holds, from the same agents.

    Parameters
    ----------
    episode : that was played.
    agents, settings, others, changes, polygons : of that episode; the robots' controllers are
        not asked, people's are.

    Returns
    -------
    columns : NaN in all where nothing touched, and where the episode cannot be repeated: its
        delays were measured, or its world is another one than that of exchanged positions. NaN
        also where the contact came before the robot's first decision; of those who react, where a
        person's controller cannot be copied; of the level, where the plan has no regions. Where
        two robots touched it is enough that one of them could avoid it.
    """
    found: dict[str, bool | float] = {
        lead_column(name, lead, ending): np.nan
        for lead in LEADS
        for name, ending in (("avoidable", ""), ("avoidable", "_reacting"), ("level_held", ""))
    }
    met = first_contact(episode)
    if met is None:
        return found
    again = _repeated(episode, agents, settings, others, changes, polygons, met.time + AFTER)
    starts = {
        (name, lead): start
        for name, lead in product(met.robots, LEADS)
        if (start := decision(episode.agent(name), met.time, lead)) is not None
    }
    takeovers = _takeovers(again, set(starts.values()))
    again.advance_to(np.inf)
    record = again.episode()
    if not _same(episode, record, met.time):
        return found
    for name in met.robots:
        own = {lead: takeovers[start] for (one, lead), start in starts.items() if one == name}
        for column, value in _outcomes(name, own, episode, record, met).items():
            found[column] = value or found[column] is True
    return found


def _outcomes(
    name: str,
    takeovers: dict[float, "_Takeover"],
    episode: Episode,
    record: Episode,
    met: FirstContact,
) -> dict[str, bool]:
    """Return what is known of one robot, by the column's name; the last instant comes first."""
    found, alone = dict[str, bool](), False
    reacting: bool | None = False
    for lead in sorted(takeovers):
        takeover, plan = takeovers[lead], plan_at(episode.agent(name), met.time, lead)
        gave_way = None if plan is None else plan.below_reference
        held = None if gave_way is None else not gave_way
        if not (alone and reacting) or gave_way:
            tried = takeover.tried(name, record, episode.seed)
            alone = alone or tried[0].room >= 0.0
            reacting = reacting or takeover.reacting(name, tried)
            held = _held(plan, tried, record, takeover.first) if plan and gave_way else held
        known = {
            lead_column("avoidable", lead): alone,
            lead_column("avoidable", lead, "_reacting"): reacting,
            lead_column("level_held", lead): held,
        }
        found |= {column: value for column, value in known.items() if value is not None}
    return found


@final
class Repeating(Controller):
    """Gives the commands of a list again, each from its stamp on; the last one for ever.

    Parameters
    ----------
    robot : whom they are for; it stands before the first stamp.
    period : s.
    stamps : (C,), s, increasing.
    commands : C of them.
    """

    def __init__(
        self, robot: Robot, period: float, stamps: Array, commands: Sequence[Command]
    ) -> None:
        self.robot: Robot = robot
        self.period: float = period
        self.stamps: Array = stamps
        self.commands: Sequence[Command] = commands

    @classmethod
    def of(cls, robot: Robot, log: AgentLog) -> "Repeating":
        """Return the one that repeats a robot's log."""
        return cls(robot, log.period, log.commands.stamp, _commands(log.commands))

    def reset(self) -> None:
        """Do nothing: there is nothing to forget."""

    def set_path(self, path: Path) -> None:
        """Do nothing: no path is needed."""

    def remember(self, observation: Observation) -> None:
        """Do nothing: nothing is looked at."""

    def command(self, observation: Observation) -> Command:
        """Return the command of this instant."""
        return self.at(observation.stamp)

    def at(self, time: float) -> Command:
        """Return the command of a time, s."""
        index = int(np.searchsorted(self.stamps, time + _SAME, side="right")) - 1
        return Command((0.0,) * self.robot.dimension) if index < 0 else self.commands[index]

    @property
    def last_plan(self) -> Plan | None:
        """None: there is no horizon."""
        return None


def _commands(log: CommandLog) -> list[Command]:
    return [
        Command(tuple(map(float, linear)), float(omega), float(ramp))
        for linear, omega, ramp in zip(log.linear, log.omega, log.ramp, strict=True)
    ]


def _repeated(
    episode: Episode,
    agents: Sequence[RobotAgent],
    settings: Settings,
    others: Sequence[Bystander],
    changes: Sequence[PathChange],
    polygons: Sequence[Polygon],
    until: float,
) -> Run:
    """Return the same episode at its start, with robots that repeat their commands."""
    again = [one if one.person else _repeating(one, episode.agent(one.name)) for one in agents]
    endless = replace(
        settings, stop_on_collision=False, deadlock_after=until + 1.0, time_limit=until
    )
    return Run(again, endless, episode.seed, others, changes, polygons)


def _repeating(agent: RobotAgent, log: AgentLog) -> RobotAgent:
    """Return a robot that repeats its commands, which another controller may have given."""
    first = log.commands.stamp[:1].tolist()
    phase = first[0] if first else agent.phase
    repeats = Repeating.of(agent.robot, log)
    return replace(agent, controller=repeats, phase=phase, truth=False)


def _takeovers(run: Run, starts: Set[float]) -> dict[float, "_Takeover"]:
    """Advance a run through these instants, and keep it at each."""
    kept: dict[float, _Takeover] = {}
    for start in sorted(starts):
        run.advance_to(start)
        plants = {one.name: copy(one.plant) for one in run.drivers if not one.agent.person}
        repeating = {one.name: one.agent.controller for one in run.drivers if one.name in plants}
        try:
            people = run.clone(repeating)
        except WideberthError:
            people = None
        kept[start] = _Takeover(len(run.clock) - 1, plants, people)
    return kept


def _same(episode: Episode, again: Episode, until: float) -> bool:
    """Whether the repeated episode is the one that was played, up to a time, s."""
    size = int(np.searchsorted(episode.times, until, side="right"))
    names = [log.name for log in episode.agents]
    if len(again.times) < size or [log.name for log in again.agents][: len(names)] != names:
        return False
    pairs = [(episode.times, again.times)]
    pairs += [(log.positions, again.agent(log.name).positions) for log in episode.agents]
    return all(
        np.allclose(one[:size], two[:size], rtol=0.0, atol=_SAME, equal_nan=True)
        for one, two in pairs
    )


@final
@dataclass(frozen=True, eq=False)
class _Tried:
    """A control sequence from an instant on.

    Attributes
    ----------
    sequence : of commands. body : the robot's motion under them.
    room : m, least clearance while all others move as they did.
    """

    sequence: Repeating
    body: BodyMotion
    room: float


@final
@dataclass(frozen=True, eq=False)
class _Takeover:
    """An instant at which other commands can take over a robot.

    Attributes
    ----------
    first : number of the instant.
    plants : of the robots, by name, as they are then.
    people : the run as it is then; None where it cannot be copied.
    """

    first: int
    plants: dict[str, Plant]
    people: Run | None

    def tried(self, name: str, record: Episode, seed: int) -> list["_Tried"]:
        """Drive all sequences among the others as they moved; the one with the most room first."""
        rng = np.random.default_rng([seed, _STREAM, self.first])
        found = []
        for sequence in self._sequences(name, record, rng):
            body = self._driven(name, sequence, record)
            found.append(_Tried(sequence, body, _least(body, name, record, self.first)))
        return sorted(found, key=lambda one: -one.room)

    def reacting(self, name: str, tried: Sequence["_Tried"]) -> bool | None:
        """Whether one of the best sequences avoids all others as they react; None if unknown."""
        if self.people is None:
            return None
        best = (self._among_people(self.people, name, one.sequence) for one in tried[:BEST])
        return any(best)

    def _sequences(
        self, name: str, record: Episode, rng: np.random.Generator
    ) -> Iterator[Repeating]:
        """Yield constant twists, then drawn pairs of them, after the commands so far."""
        log, plant = record.agent(name), self.plants[name]
        now, end = record.times[self.first], record.times[-1]
        earlier = log.commands.stamp < now - _SAME
        past = [one for one, known in zip(_commands(log.commands), earlier, strict=True) if known]
        ends = _ends(plant.robot, np.array(plant.state))
        pairs = [(twist, twist, now) for twist in product(*ends)]
        for _ in range(DRAWN):
            pairs.append((_drawn(rng, ends), _drawn(rng, ends), now + rng.random() * (end - now)))
        for first, second, switch in pairs:
            made = [within_reach(plant.robot, Command(one[:-1], one[-1]))
                    for one in (first, second)]  # fmt: skip
            stamps = np.array([*log.commands.stamp[earlier], now, switch])
            yield Repeating(plant.robot, log.period, stamps, [*past, *made])

    def _driven(self, name: str, controller: Repeating, record: Episode) -> BodyMotion:
        """Return the motion of a robot under these commands."""
        log, plant, clock = record.agent(name), copy(self.plants[name]), record.times[self.first :]
        due = [
            (float(effect), controller.at(float(stamp)))
            for stamp, effect in zip(log.commands.stamp, log.commands.effect, strict=True)
            if effect >= clock[0] - _SAME
        ]
        states = [plant.state]
        for now, later in pairwise(clock.tolist()):
            while due and due[0][0] <= now + _SAME:
                plant.command(due.pop(0)[1], now)
            plant.advance(now, later - now)
            states.append(plant.state)
        pose = plant.robot.pose(tuple(np.array(states).T))
        headings = np.full(len(states), np.nan) if pose.heading is None else pose.heading
        return BodyMotion(log.radius, pose.points(), np.asarray(headings), log.footprint)

    def _among_people(self, people: Run, name: str, controller: Repeating) -> bool:
        """Whether a robot avoids people who decide anew, and all others."""
        robots = {
            one.name: one.agent.controller for one in people.drivers if one.name in self.plants
        }
        run = people.clone({**robots, name: controller})
        run.advance_to(np.inf)
        record = run.episode()
        return _least(_part(record.agent(name), self.first), name, record, self.first) >= 0.0


def _held(plan: Plan, tried: Sequence[_Tried], record: Episode, first: int) -> bool | None:
    """Whether a sequence keeps out of a plan's regions at the level aimed at; None without any.

    Asked at those steps of the plan that the sequences reach.
    """
    clock = record.times[first:]
    times = plan.stamp + plan.dt * np.arange(1, len(plan.positions), dtype=np.float64)
    times = times[times <= clock[-1] + _SAME]
    regions = HeededRegions.aimed(plan, len(times))
    if regions is None:
        return None
    places = [
        [np.interp(times, clock, column) for column in one.body.positions.T] for one in tried
    ]
    entered = regions.contain(np.moveaxis(np.array(places), 1, -1))
    return not bool(entered.any(axis=(1, 2)).all())


def _least(body: BodyMotion, name: str, record: Episode, first: int) -> float:
    """Least clearance of a body from all but the one with this name, from an instant on, m."""
    apart = [gaps(body, _part(one, first)) for one in record.agents if one.name != name]
    apart += [wall_gaps(body, wall) for wall in record.polygons]
    return float(min((np.nanmin(gap, initial=np.inf) for gap in apart), default=np.inf))


def _part(log: AgentLog, first: int) -> BodyMotion:
    return BodyMotion(log.radius, log.positions[first:], log.headings[first:], log.footprint)


def _ends(robot: Robot, state: Array) -> list[list[float]]:
    """Least value, 0 and greatest of each component of the twists that a robot can have."""
    size = robot.dimension + 1
    alone = [sign * np.eye(size)[axis] for axis in range(size) for sign in (-1.0, 1.0)]
    turning = [np.array([one, *np.zeros(size - 2), two])  # who turns only as it drives
               for one, two in product((-1.0, 1.0), repeat=2)]  # fmt: skip
    asked = [Twist(tuple(_BEYOND * one[:-1]), _BEYOND * one[-1]) for one in (*alone, *turning)]
    found = attained(robot, state, asked)
    return [sorted({float(low), 0.0, float(high)})
            for low, high in zip(found.min(axis=0), found.max(axis=0), strict=True)]  # fmt: skip


def _drawn(rng: np.random.Generator, ends: Sequence[Sequence[float]]) -> tuple[float, ...]:
    """Draw a twist; each component is an end, or 0, or uniform between the ends."""
    extreme = rng.random(len(ends)) < _EXTREME
    choice, share = rng.random(len(ends)), rng.random(len(ends))
    return tuple(
        one[int(pick * len(one))] if at_end else one[0] + part * (one[-1] - one[0])
        for one, at_end, pick, part in zip(ends, extreme, choice, share, strict=True)
    )
