"""Episode logs, from which every metric is computed, and their files.

File format "wideberth/episode", version 1: a NumPy archive (npz, deflated) with two members.
``numbers`` is a float64 vector with all arrays one after the other; ``meta`` is JSON in UTF-8, in
which an array is written as {"at": offset, "shape": [...]}. One vector, since an archive member
for each of thousands of small arrays is slow and large. Neither holds a clock reading, so that the
same episode gives the same bytes.
"""

import io
import json
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...draw.style import picture, png
from ...framework.plugins.config import build, describe
from ...framework.plugins.io import parse_json, read_arrays, stamped, unstamped
from ...framework.plugins.registry import as_data, note_not_built
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.footprint import Discs, Footprint, Outline
from ...framework.values.forecast import Forecast
from ...framework.values.path import Path
from ...framework.values.plan import Breach, BreachKind, GivenWay, Plan, Rung, Situation, Status
from ...framework.values.polygon import Polygon
from ...metrics.gaps import Moving
from ..drawing.film import animation
from ..drawing.pictures import draw_episode
from .perception_file import packed, unpacked
from .perception_log import PerceptionLog

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class CommandLog:
    """Commands of one robot.

    Attributes
    ----------
    stamp : (C,), s, when each was asked for.
    effect : (C,), s, when it reached the plant: stamp + solve time.
    linear : (C, D), m/s.
    omega : (C,), rad/s.
    ramp : (C,), s.
    """

    stamp: Array
    effect: Array
    linear: Array
    omega: Array
    ramp: Array

    def __repr__(self) -> str:
        """Say how many there are."""
        return f"CommandLog({len(self)} commands)"

    def __len__(self) -> int:
        """Count the commands."""
        return len(self.stamp)


@dataclass(frozen=True, eq=False)
class AgentLog:
    """The log of one agent; arrays over the T instants of the episode.

    Attributes
    ----------
    name : identity.
    kind : "robot", "person" (decides as well, but is not examined), "replay" or "scripted".
    radius : m, of the enclosing disc.
    positions : (T, D), m, NaN where absent.
    headings : (T,), rad, NaN where there is none.
    speeds : (T,), m/s, length of the linear velocity; NaN for those who decide nothing.
    yaw_rates : (T,), rad/s; NaN for bystanders.
    paths : (time, path) of each reference path, in order; empty for bystanders.
    speed : m/s, reference speed; NaN for bystanders, and where it is unknown.
    period : s, of the controller; NaN for bystanders.
    reached : s, when it first was at its goal; NaN if never.
    skipped : ticks at which the controller was still busy with the one before.
    commands : what the controller decided.
    plans : the plan behind each command; shorter or empty where a controller has none.
        Measured seconds are taken out (0): they stand in `Episode.plan_seconds`. The
        forecast's covariance over the whole horizon (`joint`) is not kept.
    footprint : what it covers within the disc; None for all of it.
    """

    name: str
    kind: str
    radius: float
    positions: Array
    headings: Array
    speeds: Array
    yaw_rates: Array
    paths: tuple[tuple[float, Path], ...]
    speed: float
    period: float
    reached: float
    skipped: int
    commands: CommandLog
    plans: tuple[Plan, ...]
    footprint: Footprint | None = None

    def __repr__(self) -> str:
        """Say who it is, and how much was logged."""
        words = f"{self.name!r}, {self.kind}, {len(self.positions)} instants, "
        return f"AgentLog({words}{len(self.commands)} commands, {len(self.plans)} plans)"


@dataclass(frozen=True, eq=False)
class Episode:
    """The log of one episode.

    Attributes
    ----------
    times : (T,), s: every plant step and every instant at which something happened, so the
        spacing varies; between two of them everything moves in a straight line.
    agents : one log each, in the order they were given.
    ended : why it ended: "goals", "deadlock", "time limit" or "collision".
    goal_tolerance : m, how near its goal a robot has to come.
    seed : of the noise.
    plan_seconds : name -> (C,), s, measured wall time of each call of the controller.
        Kept apart, and not part of `to_bytes`: it is the one thing that a second run with
        the same seed does not repeat.
    polygons : what stood still.
    perception : name -> what that robot perceived, where robots have sensors.
    verdict : what a benchmark's own rules say of it; empty without any.
    """

    times: Array
    agents: tuple[AgentLog, ...]
    ended: str
    goal_tolerance: float
    seed: int
    plan_seconds: dict[str, Array] = field(default_factory=dict)
    polygons: tuple[Polygon, ...] = ()
    perception: dict[str, PerceptionLog] = field(default_factory=dict)
    verdict: dict[str, Any] = field(default_factory=dict)

    @property
    def robots(self) -> tuple[AgentLog, ...]:
        """The robots under test."""
        return tuple(agent for agent in self.agents if agent.kind == "robot")

    @property
    def duration(self) -> float:
        """Time of the last instant, s."""
        return float(self.times[-1])

    def agent(self, name: str) -> AgentLog:
        """Return the log of the agent with this name."""
        for agent in self.agents:
            if agent.name == name:
                return agent
        names = [agent.name for agent in self.agents]
        raise WideberthError(f"the episode has no agent {name!r}; it has {names}")

    def at(self, agent: Moving, times: Array) -> Array:
        """Positions of an agent at any times of the episode, (K,) -> (K, D), m.

        NaN outside the episode and where the agent was absent.
        """
        columns = [
            np.interp(times, self.times, column, left=np.nan, right=np.nan)
            for column in agent.positions.T
        ]
        return np.stack(columns, axis=-1)

    def __repr__(self) -> str:
        """Say who was there, how long it took and how it ended."""
        kinds = Counter(log.kind for log in self.agents)
        who = ", ".join(_counted(count, kind) for kind, count in kinds.items())
        lines = [f"Episode({who}; {self.duration:.4g} s, ended by {self.ended}, seed {self.seed})"]
        for log in self.robots[:8]:
            reached = f"at its goal at {log.reached:.4g} s" if log.reached >= 0 else "not arrived"
            lines.append(f"  {log.name}: {reached}, {len(log.plans)} plans")
        if len(self.robots) > 8:
            lines.append(f"  and {len(self.robots) - 8} more robots")
        return "\n".join(lines)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw where all agents drove, and the closest approach; return the axes.

        Robots have a colour, line and marker each, with a mark every 5 s; all others are grey and
        dotted. The closest approach is that of the pair with the smallest clearance of which at
        least one is a robot. In space the shadows of the ways lie on the floor.

        Parameters
        ----------
        ax : axes to draw into, in three dimensions with ``projection="3d"``; None for a figure.
        """
        return picture(self._draw, self.agents[0].positions.shape[1], ax)

    def _repr_png_(self) -> bytes:
        return png(self._draw, self.agents[0].positions.shape[1])

    def _draw(self, panel: Any) -> Array:
        return draw_episode(panel, self)

    def animate(
        self, *, live: bool = False, tail: float = 0.05, rate: float = 10.0, speed: float = 4.0
    ) -> "FuncAnimation":
        """Return the film of the episode; ``.save("film.gif")`` writes it, .mp4 with ffmpeg.

        Bodies, the ways driven so far, each robot's current plan and, in the same colour at every
        third step, what the plan keeps the centre out of; pale, the forecast's region of the
        content 1 - tail, before it is enlarged. Above, the time and the clearances.

        Parameters
        ----------
        live : show it in a window; needs an interactive backend of matplotlib. Keep what is
            returned; a script calls ``matplotlib.pyplot.show()`` after it, a notebook does not.
        tail : 1 - content of the pale regions.
        rate : frames per second.
        speed : seconds of the episode in one second of the film.

        Raises
        ------
        WideberthError : a rate or speed not above 0, or a window that cannot be opened.
        """
        return animation(self, live=live, tail=tail, rate=rate, speed=speed)

    def to_bytes(self) -> bytes:
        """Write everything but the measured times; the same episode gives the same bytes."""
        return write_episode(self)

    @classmethod
    def from_bytes(cls, data: bytes) -> "Episode":
        """Read the bytes of `to_bytes`.

        Raises
        ------
        WideberthError : not an episode, or of a version that this release does not know.
        """
        return read_episode(data)


VERSION = 1
_COMMANDS = ("stamp", "effect", "linear", "omega", "ramp")
_SERIES = ("positions", "headings", "speeds", "yaw_rates")
_PLAN_ARRAYS = (
    *("states", "inputs", "positions", "reference", "auxiliaries", "level", "target", "content"),
)
_FORECAST = ("mean", "covariance", "weight", "dt")
_PLAN_NUMBERS = ("stamp", "dt", "violation", "cost", "risk")
"""Numbers of a plan; the last one only where it is known, so that older files are read alike."""


class _Packer:
    """Collects arrays into one vector."""

    def __init__(self) -> None:
        self.parts: list[Array] = []
        self.length = 0

    def put(self, value: Any) -> dict[str, Any]:
        array = np.asarray(value, dtype=np.float64)
        place = {"at": self.length, "shape": list(array.shape)}
        self.parts.append(array.ravel())
        self.length += array.size
        return place

    def fields(self, value: object, names: Iterable[str]) -> dict[str, Any]:
        return {name: self.put(getattr(value, name)) for name in names}

    def numbers(self) -> Array:
        return np.concatenate(self.parts) if self.parts else np.zeros(0)


class _Unpacker:
    """Hands the arrays out again."""

    def __init__(self, numbers: Array) -> None:
        self.numbers = numbers

    def get(self, place: dict[str, Any]) -> Array:
        size = int(np.prod(place["shape"]))
        part = self.numbers[place["at"] : place["at"] + size]
        return np.asarray(part.reshape(place["shape"]))

    def fields(self, places: dict[str, Any]) -> dict[str, Array]:
        return {name: self.get(place) for name, place in places.items()}


def write_episode(episode: Episode) -> bytes:
    """Write everything but the measured times; the same episode gives the same bytes."""
    pack = _Packer()
    content = {
        "ended": episode.ended,
        "seed": episode.seed,
        "goal_tolerance": pack.put(episode.goal_tolerance),
        "times": pack.put(episode.times),
        "agents": [_pack_agent(pack, agent) for agent in episode.agents],
        "polygons": [[one.name, pack.put(one.vertices)] for one in episode.polygons],
        "perception": {
            name: packed(pack.put, log) for name, log in sorted(episode.perception.items())
        },
        "verdict": episode.verdict,
    }
    meta = json.dumps(stamped("episode", VERSION, content), sort_keys=True)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, meta=np.frombuffer(meta.encode("utf-8"), np.uint8), numbers=pack.numbers()
    )
    return buffer.getvalue()


@as_data()
def read_episode(data: bytes) -> Episode:
    """Read the bytes of `write_episode`.

    A region whose type is not registered, see `as_data`, is left out with a warning.

    Raises
    ------
    WideberthError : not an episode, or of a version that this release does not know.
    """
    cure = "give a file that Episode.to_bytes wrote"
    try:
        arrays = read_arrays(data, "it")
        meta = parse_json(arrays["meta"].tobytes().decode("utf-8"), "its description")
        unpack = _Unpacker(arrays["numbers"])
    except (KeyError, ValueError) as error:
        reason = f"it has no array {error}" if isinstance(error, KeyError) else error
        raise WideberthError(f"this is not a saved episode ({reason}); {cure}") from None
    content = unstamped(meta, "episode", VERSION, "the episode")
    try:
        return _unpack_episode(unpack, content)
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise WideberthError(
            f"the episode is damaged ({type(error).__name__}: {error}); {cure}"
        ) from None


def _unpack_episode(unpack: _Unpacker, content: dict[str, Any]) -> Episode:
    polygons = tuple(Polygon(_places(unpack, place), name) for name, place in content["polygons"])
    return Episode(
        times=unpack.get(content["times"]),
        agents=tuple(_unpack_agent(unpack, agent, polygons) for agent in content["agents"]),
        ended=content["ended"],
        goal_tolerance=float(unpack.get(content["goal_tolerance"])),
        seed=content["seed"],
        polygons=polygons,
        perception={
            name: unpacked(unpack.get, log) for name, log in content["perception"].items()
        },
        verdict=content["verdict"],
    )


def _pack_agent(pack: _Packer, agent: AgentLog) -> dict[str, Any]:
    return {
        "name": agent.name,
        "kind": agent.kind,
        "skipped": agent.skipped,
        "numbers": pack.put((agent.radius, agent.speed, agent.period, agent.reached)),
        "series": pack.fields(agent, _SERIES),
        "paths": [[pack.put(time), pack.put(path.points)] for time, path in agent.paths],
        "commands": pack.fields(agent.commands, _COMMANDS),
        "plans": [_pack_plan(pack, plan) for plan in agent.plans],
        "footprint": _pack_footprint(pack, agent.footprint),
        "region": _region_of(agent),
    }


def _region_of(agent: AgentLog) -> dict[str, Any] | None:
    """Config of the region that an agent's plans keep out of; None where there is none."""
    for plan in agent.plans:
        if plan.situation is not None and plan.situation.region is not None:
            config = describe(plan.situation.region)
            return config if "type" in config else None
    return None


def _built_region(config: dict[str, Any] | None) -> Any:
    """Build a region again; None, and a note, where its plug-in is not there."""
    try:
        return None if config is None else build("regions", config)
    except WideberthError as error:
        note_not_built(f"the region of the plans is not drawn: {error}")
        return None


def _unpack_agent(
    unpack: _Unpacker, stored: dict[str, Any], polygons: tuple[Polygon, ...]
) -> AgentLog:
    agent = _unpack_bare(unpack, stored)
    region = _built_region(stored["region"])
    plans = []
    for plan, one in zip(agent.plans, stored["plans"], strict=True):
        if (known := one["situation"]) is not None:
            room, heading, *radii = (float(v) for v in unpack.get(known))
            paths = [path for begin, path in agent.paths if begin <= plan.stamp + 1e-9]
            path = paths[-1] if paths else None
            body = agent.radius, heading, agent.footprint
            plan = replace(
                plan, situation=Situation(region, room, np.array(radii), *body, path, polygons)
            )
        plans.append(plan)
    return replace(agent, plans=tuple(plans))


def _unpack_bare(unpack: _Unpacker, stored: dict[str, Any]) -> AgentLog:
    """Read an agent; its plans know nothing of their situation yet."""
    radius, speed, period, reached = (float(v) for v in unpack.get(stored["numbers"]))
    return AgentLog(
        name=stored["name"],
        kind=stored["kind"],
        radius=radius,
        **unpack.fields(stored["series"]),
        paths=tuple(
            (float(unpack.get(time)), Path(unpack.get(points))) for time, points in stored["paths"]
        ),
        speed=speed,
        period=period,
        reached=reached,
        skipped=stored["skipped"],
        commands=CommandLog(**unpack.fields(stored["commands"])),
        plans=tuple(_unpack_plan(unpack, plan) for plan in stored["plans"]),
        footprint=_unpack_footprint(unpack, stored["footprint"]),
    )


def _places(unpack: _Unpacker, place: dict[str, Any]) -> tuple[tuple[float, float], ...]:
    return tuple((float(x), float(y)) for x, y in unpack.get(place))


def _pack_footprint(pack: _Packer, footprint: Footprint | None) -> dict[str, Any] | None:
    if footprint is None:
        return None
    if isinstance(footprint, Discs):
        return {"centres": pack.put(footprint.centres), "radius": pack.put(footprint.radius)}
    return {"vertices": pack.put(footprint.vertices)}


def _unpack_footprint(unpack: _Unpacker, stored: dict[str, Any] | None) -> Footprint | None:
    if stored is None:
        return None
    if "centres" in stored:
        return Discs(_places(unpack, stored["centres"]), float(unpack.get(stored["radius"])))
    return Outline(_places(unpack, stored["vertices"]))


def _pack_plan(pack: _Packer, plan: Plan) -> dict[str, Any]:
    forecast = plan.forecast
    return {
        "arrays": pack.fields(plan, _PLAN_ARRAYS),
        "numbers": pack.put([getattr(plan, name) for name in _known_numbers(plan)]),
        "ids": list(plan.ids),
        "left_out": list(plan.left_out),
        "tracked": list(plan.tracked),
        "status": str(plan.status),
        "rung": str(plan.rung),
        "reason": plan.reason,
        "iterations": plan.iterations,
        "breach": _pack_breach(pack, plan.breach),
        "given_way": _pack_given_way(pack, plan.given_way),
        "situation": _pack_situation(pack, plan.situation),
        "forecast": None if forecast is None else {
            **pack.fields(forecast, _FORECAST), "fallback": list(forecast.fallback),
        },
    }  # fmt: skip


def _known_numbers(plan: Plan) -> tuple[str, ...]:
    """Return the names of the numbers that are written."""
    return _PLAN_NUMBERS if np.isfinite(plan.risk) else _PLAN_NUMBERS[:-1]


def _counted(count: int, kind: str) -> str:
    """Return a number of agents in words."""
    several = {"robot": "robots", "person": "people", "replay": "replays"}
    return f"{count} {kind if count == 1 else several.get(kind, kind)}"


def _unpack_plan(unpack: _Unpacker, stored: dict[str, Any]) -> Plan:
    numbers = [float(number) for number in unpack.get(stored["numbers"])]
    values: dict[str, Any] = dict(zip(_PLAN_NUMBERS[: len(numbers)], numbers, strict=True))
    values |= unpack.fields(stored["arrays"])
    forecast = None
    if (known := stored["forecast"]) is not None:
        mean, covariance, weight, dt = (unpack.get(known[name]) for name in _FORECAST)
        forecast = Forecast(mean, covariance, weight, float(dt), tuple(known["fallback"]))
    return Plan(
        **values,
        ids=tuple(stored["ids"]),
        left_out=tuple(stored["left_out"]),
        tracked=tuple(stored["tracked"]),
        status=Status(stored["status"]),
        rung=next((one for one in Rung if one == stored["rung"]), stored["rung"]),
        reason=stored["reason"],
        iterations=stored["iterations"],
        forecast=forecast,
        breach=_unpack_breach(unpack, stored["breach"]),
        given_way=_unpack_given_way(unpack, stored["given_way"]),
    )


def _pack_situation(pack: _Packer, one: Situation | None) -> dict[str, Any] | None:
    """Write what is the plan's alone; body, path, region and polygons stand elsewhere."""
    return None if one is None else pack.put([one.room, one.heading, *one.radii])


def _pack_breach(pack: _Packer, one: Breach | None) -> list[Any] | None:
    return None if one is None else [str(one.kind), one.name, one.step, pack.put(one.amount)]


def _unpack_breach(unpack: _Unpacker, stored: list[Any] | None) -> Breach | None:
    if stored is None:
        return None
    kind, name, step, amount = stored
    return Breach(BreachKind(kind), name, step, float(unpack.get(amount)))


def _pack_given_way(pack: _Packer, one: GivenWay | None) -> list[Any] | None:
    if one is None:
        return None
    return [pack.put((one.asked, one.held)), one.promise, one.step, one.name]


def _unpack_given_way(unpack: _Unpacker, stored: list[Any] | None) -> GivenWay | None:
    if stored is None:
        return None
    asked, held = (float(tail) for tail in unpack.get(stored[0]))
    return GivenWay(asked, held, *stored[1:])
