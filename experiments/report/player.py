"""`wideberth play`: an episode as a page in which one steps through it."""

import base64
import hashlib
import json
import sys
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import numpy as np

from ...draw.style import number
from ...framework.mpc.planner.planner import Planner, planner_behind
from ...framework.plugins.io import check_target, write_text
from ...framework.plugins.registry import as_data
from ...framework.plugins.yamlfile import read_config
from ...framework.values.arrays import Array, probability
from ...framework.values.errors import WideberthError, nearest
from ...framework.values.footprint import Discs, Outline
from ...framework.values.plan import Plan, Rung
from ...metrics.episode import content_bound
from ...simulation.drawing import artists
from ...simulation.log.episode_log import AgentLog, Episode
from ..drawing.kept_out import kept_out_of, region_name
from ..drawing.plotting import COLOURS
from ..engine.base import Task
from ..engine.closed_loop import KEPT_BY, controllers_of, log_name
from ..engine.errors import as_user_error
from ..engine.inside import files_inside, inside
from ..engine.result import read_episode as read_episode
from ..engine.runner import reopened

TEMPLATES = Path(__file__).parent / "templates"
PLAYER = ("player.js", "player_view.js", "player_page.js")
"""Scripts of the player, in the order in which they need each other."""
MARK = '<meta name="generator" content="wideberth">'
"""Stands near the beginning of every page: one that holds it may be replaced by another."""
TAIL = 0.05
"""1 - content of drawn regions by default."""
ROOM = 12_000_000
"""Characters of all packed episodes of a page."""


@as_data()
def play(path: Path, out: Path, tail: float | None = None) -> Path:
    """Write the page of an episode, or of all episodes of a result with a choice between them.

    Parameters
    ----------
    path : a file of `Episode.to_bytes`, or the folder of a result. Of one in the folder of its
        result the planner is known, and its regions are drawn.
    out : HTML file.
    tail : 1 - content of the drawn regions; by default that of the result, else 0.05.

    Raises
    ------
    WideberthError : no episode there; one without a robot; a tail outside (0, 1); a file that
        cannot be written, or an existing one that is no page of this package.
    """
    check_target(out, MARK)
    paths = find_episodes(path)
    chosen = result_tail(paths[0].parent.parent) if tail is None else tail
    found, left_out = recordings(paths, chosen, ROOM if len(paths) > 1 else sys.maxsize)
    if left_out and not found:
        raise WideberthError(
            f"each episode of {path} is too large for a page of several; name one, as in "
            f"`wideberth play {left_out[0]}`"
        )
    if not found:
        packed(read_episode(paths[0]), chosen)  # refuses, and says why
    many = f"{path.resolve().name}: {len(found)} runs" if len(found) > 1 else found[0].title
    return write_text(out, page(many, found, left_out))


def page(title: str, episodes: "Sequence[Recorded]", left_out: Sequence[Path] = ()) -> str:
    """Return a whole HTML page in one file: no network, the same bytes for the same content.

    A content security policy forbids all connections and every script but the page's own, which
    it knows by their hash: text that got in unescaped could do nothing.

    Parameters
    ----------
    title : plain text.
    episodes : the first is shown; of several the reader chooses by what differs between them.
    left_out : files of episodes that are too large for the page.
    """
    import jinja2

    code = "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in PLAYER)
    digest = base64.b64encode(hashlib.sha256(code.encode("utf-8")).digest()).decode("ascii")
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES), undefined=jinja2.StrictUndefined,
        autoescape=True, trim_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    labels = list(episodes[0].labels) if episodes else []
    differing = [name for name in labels if len({one.labels.get(name) for one in episodes}) > 1]
    return templates.get_template("page.html").render(
        mark=MARK, title=title, digest=digest, code=code, differing=differing,
        episodes=episodes, left_out=left_out,
    )  # fmt: skip


@final
@dataclass(frozen=True)
class Recorded:
    """An episode as a page holds it.

    Attributes
    ----------
    name : of its file, without the ending.
    labels : what it shows: scenario, planner or controller, ..., seed.
    note : how it ended.
    text : of `packed`.
    """

    name: str
    labels: dict[str, str]
    note: str
    text: str

    @property
    def title(self) -> str:
        """Scenario, planner and seed in one line; the file's name where they are not known."""
        scenario, *rest = (
            value if name in ("scenario", "settings") else f"{name} {value}"
            for name, value in self.labels.items()
        )
        return f"{scenario}: {', '.join(rest)}".replace("_", " ")

    def label(self, differing: Sequence[str]) -> str:
        """Name it by some of its labels, or as its file where there are none."""
        words = ", ".join(
            f"seed {self.labels['seed']}" if name == "seed" else self.labels.get(name, "")
            for name in differing
        )
        return words.replace("_", " ") or self.name


def recordings(paths: Sequence[Path], tail: float, room: int) -> tuple[list[Recorded], list[Path]]:
    """Pack episodes for a page; return those that fit, and the files of those that do not.

    Parameters
    ----------
    paths : of kept episodes; one without a robot is passed over.
    tail : 1 - content of the drawn regions.
    room : characters that all together may take.
    """
    found, left_out = [], []
    origins = {path: _origin(path) for path in paths}
    for path in sorted(paths, key=lambda path: origins[path].place):  # as the study has them
        episode = read_episode(path)
        if not episode.robots:
            continue
        origin = origins[path]
        text = packed(episode, tail, origin.planner)
        if len(text) > room:
            left_out.append(path)
            continue
        room -= len(text)
        labels = {**_labels(path, origin.task), "seed": str(episode.seed)}
        found.append(Recorded(path.stem, labels, _ending(episode), text))
    return found, left_out


def _ending(episode: Episode) -> str:
    """Say how an episode ended, and how near it came to a contact."""
    clearance = artists.clearance_over_time(episode)
    known = clearance[np.isfinite(clearance)]
    near = f", least clearance {number(known.min(), '.2f')} m" if known.size else ""
    contact = ": contact" if known.size and known.min() < 0.0 else ""
    return f"ended by {episode.ended} after {episode.duration:.1f} s{near}{contact}"


def _labels(path: Path, task: Task | None) -> dict[str, str]:
    """Return the scenario of an episode and what else its result compares."""
    if task is None:
        return {"scenario": path.stem}
    folder = path.resolve().parents[1]
    stated = read_config(inside(folder, "config.yaml")).get("scenario")
    known = {name: str(task.settings[name]) for name in KEPT_BY if name in task.settings}
    alone = stated.get("type") if isinstance(stated, dict) else None  # of one, tasks name none
    scenario = str(alone or known.get("scenario") or folder.name)
    order = ("planner", "controller", "robot", "settings")
    return {"scenario": scenario, **{name: known[name] for name in order if name in known}}


def find_episodes(path: Path) -> list[Path]:
    """Return the files of the episodes that a path or the folder of a result means.

    Raises
    ------
    WideberthError : nothing there, or a result that keeps no episode.
    """
    if path.is_file():
        folder = path.absolute().parent.parent
        if (folder / "config.yaml").is_file():  # of a result
            inside(folder, path.absolute().relative_to(folder))
        return [path]
    if not path.is_dir():
        beside = [one.name for one in path.absolute().parent.glob("*")]
        raise WideberthError(
            f"{path} does not exist{nearest(path.name, beside) or ';'} wanted an episode "
            "(files/*.npz of a result) or the folder of a result"
        )
    kept = kept_episodes(path)
    if not kept:
        raise WideberthError(f"{path} keeps no episode; wanted a file files/*.npz in it")
    return kept


def kept_episodes(folder: Path) -> list[Path]:
    """Return the files of a result that hold episodes, sorted."""
    found = []
    for path in files_inside(folder, "files"):
        if path.suffix != ".npz":
            continue
        try:
            read_episode(path)
        except WideberthError:
            continue  # what else an experiment left
        found.append(path)
    return found


def result_tail(folder: Path) -> float:
    """Return the tail that a result's own figures are drawn with, else 0.05."""
    file = inside(folder, "config.yaml")
    stated = read_config(file).get("tail") if file.is_file() else None
    return float(stated) if isinstance(stated, int | float) and 0 < stated < 1 else TAIL


LENGTH = 1e-3
"""Unit of lengths, m, of speeds, m/s, and of angles, rad."""
TIME = 1e-6
"""Unit of times, s."""
_FRAME = 0.05  # s between frames; decisions are frames too
_ENTRIES = 120_000  # regions in a page: about 1 MB of it
_EVERY = (1, 2, 3, 5, 8)  # steps from one kept region to the next


@final
@dataclass(frozen=True, eq=False)
class Shown:
    """Choice of forecast regions that a page shows.

    Attributes
    ----------
    tail : 1 - content of the ellipses.
    every : steps from one kept one to the next.
    planner : whose regions are outlined; None where it is not known.
    apart : kept steps from one outline to the next.
    """

    tail: float
    every: int
    planner: Planner | None
    apart: int


def packed(episode: Episode, tail: float, planner: Planner | None = None) -> str:
    """Return the text that `data/player.js` unpacks; the same episode gives the same text.

    Parameters
    ----------
    episode : with at least one robot.
    tail : 1 - content of the forecast regions.
    planner : of all its robots, whose regions are drawn; None where it is not known.

    Raises
    ------
    WideberthError : an episode without a robot, a tail outside (0, 1).
    """
    text = json.dumps(content(episode, tail, planner), separators=(",", ":"), allow_nan=False)
    return base64.b64encode(zlib.compress(text.encode("utf-8"), 9)).decode("ascii")


def content(episode: Episode, tail: float, planner: Planner | None = None) -> dict[str, Any]:
    """Return what is packed: numbers, lists, mappings and text."""
    probability("tail", tail)
    if not episode.robots:
        names = [log.name for log in episode.agents]
        raise WideberthError(
            f"the episode has no robot, only {names}; the player follows a robot's decisions"
        )
    times = frames(episode)
    every = _thinned(episode)
    shown = Shown(tail, every, planner, spacing(episode, every))
    return {
        "ended": episode.ended,
        "seed": episode.seed,
        "content": 1.0 - tail,
        "every": every,
        "apart": shown.apart,
        "region": None if planner is None else region_name(planner.region),
        "axes": _axes(episode),
        "extent": [_extent(episode, axes) for axes in _axes(episode)],
        "frames": series(times, TIME),
        "polygons": [
            {"name": one.name, "points": _columns(one.points)} for one in episode.polygons
        ],
        "agents": [_agent(episode, log, times, shown) for log in episode.agents],
    }


def series(values: Array, unit: float = LENGTH) -> list[int | None]:
    """Round to whole multiples of a unit: the first, then differences; None for NaN and inf.

    The value at a place is the sum of all numbers up to it, times the unit.

    Examples
    --------
    >>> series(np.array([1.0, 1.5, np.nan, 1.25]), 0.25)
    [4, 2, None, -1]
    """
    values = np.asarray(values, dtype=np.float64)
    known = np.isfinite(values)
    whole = np.rint(values[known] / unit).astype(np.int64)
    steps = iter(np.diff(whole, prepend=0).tolist())
    return [next(steps) if there else None for there in known]


def frames(episode: Episode) -> Array:
    """Moments that the player shows, s: every 0.05 s, every decision, and the end."""
    stamps = [log.commands.stamp for log in episode.robots]
    even = np.arange(0.0, episode.duration, _FRAME)
    times = np.concatenate([even, *stamps, [episode.duration]])
    return np.unique(np.rint(times / TIME)) * TIME


def _columns(points: Array) -> list[list[int | None]]:
    return [series(column) for column in np.asarray(points).T]


def _axes(episode: Episode) -> list[list[int]]:
    """Coordinates of each view: from above, and in space from the side too."""
    return [[0, 1], [0, 2]] if episode.robots[0].positions.shape[1] == 3 else [[0, 1]]


def _extent(episode: Episode, axes: list[int]) -> list[float]:
    """Corners of a view, m: least of both coordinates, largest of both."""
    low, high = artists.extent(episode)
    if axes == [0, 1]:
        return [float(x) for x in (*low, *high)]
    heights = np.concatenate([log.positions[:, 2] for log in episode.robots])
    beside = max(log.radius for log in episode.agents) + 0.6
    bottom, top = float(np.nanmin(heights)) - beside, float(np.nanmax(heights)) + beside
    return [float(low[0]), bottom, float(high[0]), top]


def _unwrapped(headings: Array) -> Array:
    """Headings without jumps of a full turn; NaN while the agent is absent."""
    known, found = np.isfinite(headings), headings.copy()
    found[known] = np.unwrap(headings[known])
    return found


def _agent(episode: Episode, log: AgentLog, times: Array, shown: Shown) -> dict[str, Any]:
    """Return one agent's frames and, for a robot, its decisions and plans."""
    index = np.maximum(np.searchsorted(episode.times, times + 1e-9) - 1, 0)
    known: dict[str, Any] = {
        "name": log.name,
        "kind": log.kind,
        "radius": log.radius,
        "parts": _parts(log),
        "positions": _columns(episode.at(log, np.minimum(times, episode.duration))),
        "headings": series(_unwrapped(log.headings[index])),
    }
    if log.kind != "robot":
        return known
    # The clearance of this robot alone: all others are bystanders.
    agents = [one if one is log else replace(one, kind="scripted") for one in episode.agents]
    clear = artists.clearance_over_time(replace(episode, agents=tuple(agents)))
    return known | {
        "color": COLOURS.index(artists.looks(episode)[log.name].color),
        "reference_speed": _number(log.speed),
        "reached": None if np.isnan(log.reached) else log.reached,
        "room": _room(log),
        "speeds": series(log.speeds[index]),
        "clearance": series(clear[index]),
        "least": series(np.fmin.accumulate(clear)[index]),
        "decisions": series(log.commands.stamp, TIME),
        "paths": [{"begin": begin, "points": _columns(path.points)} for begin, path in log.paths],
        "plans": [_plan(episode, log, plan, shown) for plan in log.plans],
    }


def _room(log: AgentLog) -> float | None:
    """Radius of the discs that keep out of regions, m; None for a body with corners."""
    if isinstance(log.footprint, Outline):
        return None
    return log.footprint.radius if isinstance(log.footprint, Discs) else log.radius


def _parts(log: AgentLog) -> list[dict[str, Any]]:
    """Return what an agent covers, in its own frame, m."""
    if isinstance(log.footprint, Outline):
        return [{"corners": [list(place) for place in log.footprint.vertices]}]
    if isinstance(log.footprint, Discs):
        radius = log.footprint.radius
        return [{"at": list(place), "radius": radius} for place in log.footprint.centres]
    return [{"at": [0.0, 0.0], "radius": log.radius}]


def _thinned(episode: Episode) -> int:
    """How many steps lie between kept regions, for a page that can be sent."""
    forecasts = [p.forecast for log in episode.robots for p in log.plans if p.forecast is not None]
    entries = sum(f.mean.shape[0] * f.mean.shape[1] * f.steps for f in forecasts)
    return next((every for every in _EVERY if entries <= every * _ENTRIES), _EVERY[-1])


def _plan(episode: Episode, log: AgentLog, plan: Plan, shown: Shown) -> dict[str, Any]:
    """Return one plan: how it came about, where it leads, what it expects."""
    held = plan.content.size > 0
    return {
        "stamp": round(plan.stamp / TIME),
        "status": str(plan.status),
        "rung": str(plan.rung),
        "reason": plan.reason,
        "gave_way": "" if plan.given_way is None else str(plan.given_way),
        "best": plan.rung == Rung.OPTIMAL,
        "breach": "" if plan.breach is None else str(plan.breach),
        "iterations": plan.iterations,
        "violation": plan.violation if np.isfinite(plan.violation) else None,
        "level": [_number(plan.level.min()), _number(plan.level.max())] if held else None,
        "content": _number(plan.lowest_content) if held else None,
        "left_out": list(plan.left_out),
        "fallbacks": [
            f"{name}: {reason}"
            for name, reason in zip(plan.tracked, plan.fallbacks, strict=True)
            if reason
        ],
        "positions": _columns(plan.positions),
        "reference": _columns(plan.reference),
        "forecast": _forecasts(episode, log, plan, shown),
    }


def _number(value: Any) -> float | None:
    """Return four digits of a number; None for NaN and inf."""
    return float(f"{value:.4g}") if np.isfinite(value) else None


def _forecasts(episode: Episode, log: AgentLog, plan: Plan, shown: Shown) -> list[dict[str, Any]]:
    """Return one entry per obstacle and mode: means and content ellipses in every view.

    The steps kept are the last one and those in whole multiples of ``every`` before it. An
    ellipse is given by both semi-axes (m) and the angle of the longer one (rad); beside them
    are the sets kept out of, at the last kept step and whole multiples of ``apart`` before it.
    """
    forecast = plan.forecast
    if forecast is None:
        return []
    steps = list(range((forecast.steps - 1) % shown.every, forecast.steps, shown.every))
    size = forecast.mean.shape[-1]
    owners, modes = np.nonzero(forecast.weight > 0)
    mean = forecast.mean[owners, modes][:, steps]
    spread = forecast.covariance[owners, modes][:, steps]
    bound = content_bound(size, shown.tail)
    entries = []
    sets = outlined(episode, log, plan, shown, steps)
    shapes = [ellipses(spread[..., axes, :][..., axes], bound) for axes in _axes(episode)]
    for i, (owner, mode) in enumerate(zip(owners, modes, strict=True)):
        name = plan.tracked[owner]
        entries.append(
            {
                "name": name,
                "weight": _number(forecast.weight[owner, mode]),
                "radius": _radius(episode, plan, int(owner)),
                "mean": _columns(mean[i]),
                "ellipses": [_columns(shape[i]) for shape in shapes],
                "held": series(_held(plan, name, size, bound)[steps]),
                "sets": [
                    None if rim is None else _columns(rim)
                    for rim in sets.get((int(owner), int(mode)), [])
                ],
            }
        )
    return entries


def _radius(episode: Episode, plan: Plan, owner: int) -> float:
    """Radius of a tracked obstacle, m; of a false track what the robot took it for."""
    names = [log.name for log in episode.agents]
    if plan.situation is not None and plan.tracked[owner] not in names:
        return float(plan.situation.radii[owner])
    return episode.agent(plan.tracked[owner]).radius


def ellipses(spread: Array, bound: float) -> Array:
    """Semi-axes and angle of the longer one: (..., N, 2, 2) m^2 -> (..., N, 3), m, m and rad.

    The ellipse is (x - mu)^T Sigma^-1 (x - mu) <= bound.
    """
    values, vectors = np.linalg.eigh(spread)
    axes = np.sqrt(bound * np.clip(values, 0.0, None))
    angle = np.unwrap(np.arctan2(vectors[..., 1, 1], vectors[..., 0, 1]), period=np.pi)
    return np.stack([axes[..., 1], axes[..., 0], angle], axis=-1)


def _held(plan: Plan, name: str, size: int, bound: float) -> Array:
    """Return by what the plan's own content scales the ellipse's axes at each step, (N,).

    It is the square root of the quotient of both quantiles; NaN where the obstacle is in no
    constraint, or the content is 1.
    """
    if name not in plan.ids:
        return np.full(len(plan.inputs), np.nan)
    contents = plan.content[:, plan.ids.index(name)].tolist()
    scales = {one: _scale(one, size, bound) for one in set(contents)}  # mostly one for all steps
    return np.array([scales[one] for one in contents])


def _scale(content: float, size: int, bound: float) -> float:
    if content <= 0.0:
        return 0.0
    return float(np.sqrt(content_bound(size, 1.0 - content) / bound)) if content < 1 else np.nan


_OUTLINES = 4_000  # in a page: some seconds of work and 0.3 MB
_APART = (1, 2, 3, 5, 8, 12)  # kept steps from one outline to the next


def episode_planner(path: Path) -> Planner | None:
    """Return the planner behind a kept episode, read from the result that keeps it.

    None where the file lies elsewhere, its result cannot be opened, or its robots had another
    controller.
    """
    return _origin(path).planner


@final
@dataclass(frozen=True, eq=False)
class _Origin:
    """The task that a kept episode is of, its place among all tasks, and the planner behind."""

    task: Task | None = None
    place: int = 0
    planner: Planner | None = None


@as_data()
def _origin(path: Path) -> _Origin:
    """Read the result that keeps an episode; nothing is known of a file that lies elsewhere."""
    try:
        with as_user_error():
            experiment, _ = reopened(path.resolve().parent.parent)
            if experiment is None:
                return _Origin()
            named = enumerate(experiment.tasks())
            place, task = next((i, one) for i, one in named if log_name(one) == path.name)
    except (WideberthError, StopIteration):
        return _Origin()
    names = [task.settings.get(label) for label in ("controller", "planner")]
    known = controllers_of(experiment)
    found = (planner_behind(known[name]) for name in names if name in known)
    return _Origin(task, place, next(filter(None, found), None))


def spacing(episode: Episode, every: int) -> int:
    """How many kept steps lie between kept outlines, where one step in ``every`` is kept."""
    plans = [plan for log in episode.robots for plan in log.plans if plan.forecast is not None]
    entries = sum(plan.level.size for plan in plans) / every
    return next((apart for apart in _APART if entries <= apart * _OUTLINES), _APART[-1])


def outlined(
    episode: Episode, log: AgentLog, plan: Plan, shown: Shown, steps: list[int]
) -> dict[tuple[int, int], list[Array | None]]:
    """Return `kept_out_of` at the last step and every ``apart``-th before; None elsewhere."""
    if shown.planner is None:
        return {}
    chosen = range((len(steps) - 1) % shown.apart, len(steps), shown.apart)
    found = kept_out_of(episode, log, plan, shown.planner, [steps[i] for i in chosen])
    kept: dict[tuple[int, int], list[Array | None]] = {}
    for key, rims in found.items():
        kept[key] = [None] * len(steps)
        for i, rim in zip(chosen, rims, strict=True):
            kept[key][i] = rim
    return kept
