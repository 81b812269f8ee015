"""Whether the first contact of an episode could have been avoided shortly before."""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product
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

LEADS = (2.0, 1.0)
"""s before the contact, at which other commands take over."""
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
    """Say whether the first contact could have been avoided 2 s and 1 s before; two columns each.

    ``avoidable_2s``: from the robot's first decision in the last 2 s before the contact on, one of
    many control sequences keeps it clear of all others and of every wall until 2 s after the
    contact, while all others move as they did. ``avoidable_2s_reacting``: one of the `BEST`
    sequences with the most room does so while the others decide for themselves, as they would have
    done. Others move on after the contact, also where it ended the episode.

    A sequence is one twist, or two with an instant in between, sent at the robot's own decisions
    and driven by its plant. All combinations of the ends of the twist's components and 0 are tried
    for the whole time, and `DRAWN` sequences from a generator that hangs on the episode's seed.
    So "avoidable" is proven by an example; that nothing helps is not: more sequences might.

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
        also where the contact came before the robot's first decision, and, of those who react,
        where a person's controller cannot be copied. Where two robots touched it is enough that
        one of them could avoid it.
    """
    names = [(f"avoidable_{lead:g}s", lead) for lead in LEADS]
    found: dict[str, bool | float] = {
        f"{name}{kind}": np.nan for name, _ in names for kind in ("", "_reacting")
    }
    met = first_contact(episode)
    if met is None:
        return found
    time, touched = met
    again = _repeated(episode, agents, settings, others, changes, polygons, time + AFTER)
    takeovers = _takeovers(again, [_decision(episode.agent(name), time, lead)
                                   for name in touched for lead in LEADS])  # fmt: skip
    again.advance_to(np.inf)
    record = again.episode()
    if not _same(episode, record, time):
        return found
    rng = np.random.default_rng([episode.seed, _STREAM])
    for column, lead in names:
        for robot in touched:
            start = _decision(episode.agent(robot), time, lead)
            if start is None:
                continue
            alone, reacting = takeovers[start].outcome(robot, record, rng)
            for name, avoids in ((column, alone), (f"{column}_reacting", reacting)):
                if avoids is not None:
                    found[name] = avoids or found[name] is True
    return found


def first_contact(episode: Episode) -> tuple[float, tuple[str, ...]] | None:
    """When a robot first touches an agent or a wall, s, and which robots do; None if none does."""
    bodies = {log.name: log for log in episode.robots}
    pairs = [
        (gaps(one, two), {one.name, two.name} & bodies.keys())
        for one, two in combinations(episode.agents, 2)
        if {one.name, two.name} & bodies.keys()
    ]
    pairs += [(wall_gaps(log, wall), {log.name}) for log in episode.robots
              for wall in episode.polygons]  # fmt: skip
    first = [(int(np.argmax(gap < 0.0)), names) for gap, names in pairs if (gap < 0.0).any()]
    if not first:
        return None
    begins = min(index for index, _ in first)
    names = {name for index, some in first if index == begins for name in some}
    return float(episode.times[begins]), tuple(name for name in bodies if name in names)


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
    def plan(self) -> Plan | None:
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


def _takeovers(run: Run, starts: Sequence[float | None]) -> dict[float, "_Takeover"]:
    """Advance a run through these instants, and keep it at each."""
    kept: dict[float, _Takeover] = {}
    for start in sorted({start for start in starts if start is not None}):
        run.advance_to(start)
        plants = {one.name: copy(one.plant) for one in run.drivers if not one.agent.person}
        repeating = {one.name: one.agent.controller for one in run.drivers if one.name in plants}
        try:
            people = run.clone(repeating)
        except WideberthError:
            people = None
        kept[start] = _Takeover(len(run.clock) - 1, plants, people)
    return kept


def _decision(log: AgentLog, contact: float, lead: float) -> float | None:
    """Time of the first decision in the last ``lead`` s before the contact, s; None without."""
    stamps = log.commands.stamp
    known = stamps[(stamps >= contact - lead - _SAME) & (stamps < contact)]
    return float(known[0]) if known.size else None


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

    def outcome(
        self, name: str, record: Episode, rng: np.random.Generator
    ) -> tuple[bool, bool | None]:
        """Whether a sequence avoids all others, as they moved and as they would react."""
        tried = [
            (self._room(name, one, record), place, one)
            for place, one in enumerate(self._sequences(name, record, rng))
        ]
        tried.sort(key=lambda entry: (-entry[0], entry[1]))
        if self.people is None:
            return tried[0][0] >= 0.0, None
        best = (self._among_people(self.people, name, one) for _, _, one in tried[:BEST])
        return tried[0][0] >= 0.0, any(best)

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

    def _room(self, name: str, controller: Repeating, record: Episode) -> float:
        """Least clearance of a robot while all others move as they did, m."""
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
        body = BodyMotion(log.radius, pose.points(), np.asarray(headings), log.footprint)
        return _least(body, name, record, self.first)

    def _among_people(self, people: Run, name: str, controller: Repeating) -> bool:
        """Whether a robot avoids people who decide anew, and all others."""
        robots = {
            one.name: one.agent.controller for one in people.drivers if one.name in self.plants
        }
        run = people.clone({**robots, name: controller})
        run.advance_to(np.inf)
        record = run.episode()
        return _least(_part(record.agent(name), self.first), name, record, self.first) >= 0.0


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
