"""The film of an episode in space, drawn by MuJoCo without a screen."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import pairwise
from typing import TYPE_CHECKING, Any, final
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.simulation.drawing import artists
from wideberth.simulation.drawing.film import canvas_of
from wideberth.simulation.drawing.saving import film_of
from wideberth.simulation.log.episode_log import AgentLog, Episode

from .body import LARGE, SkidSteerBody
from .mjcf import mjcf
from .mujoco_module import mujoco
from .scene import PhysicalPerson, PhysicalRobot, PhysicalScene

if TYPE_CHECKING:
    from matplotlib.animation import FuncAnimation

PLATFORMS = ("egl", "osmesa")
"""What can draw without a screen, in the order in which it is tried."""
_AWAY = 1e3
"""m below the floor, where those are who are not there."""
_MOST = 5000
"""Shapes in a picture."""
_DPI = 100.0
_PERSON = np.array([0.80, 0.76, 0.62])
_DOT, _TRAIL = 0.05, 0.02
"""m, radius of a planned position and of the line of the way so far."""


def film(
    episode: Episode,
    *,
    rate: float = 10.0,
    speed: float = 4.0,
    size: tuple[int, int] = (800, 500),
    elevation: float = 45.0,
) -> "FuncAnimation":
    """Return the film of an episode in space; ``.save("film.gif")`` writes it, .mp4 with ffmpeg.

    Every robot is shown as a body on four wheels of its own radius, in a clear cylinder if it
    has no footprint, people as upright cylinders, and what stands still 1 m high. The line is
    the way so far, and the dots are the current plan. What was recorded is shown: nothing is
    simulated again, and whatever moved the robots will do.

    Parameters
    ----------
    episode : in the plane, with a robot.
    rate : frames per second.
    speed : seconds of the episode in one second of the film.
    size : width and height, pixels, at most 1920 and 1080.
    elevation : degrees above the floor from which all is seen.

    Raises
    ------
    WideberthError : MuJoCo is missing, or nothing on this machine can draw without a screen;
        an episode in space or without a robot; a number out of range.
    """
    from matplotlib.figure import Figure

    positive("rate", rate)
    positive("speed", speed)
    stage = _Stage(episode, size, elevation)
    times = np.append(np.arange(0.0, episode.duration, speed / rate), episode.duration)
    figure = Figure(figsize=(size[0] / _DPI, size[1] / _DPI), dpi=_DPI)
    canvas_of(figure)
    panel = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    panel.set_axis_off()
    shown = panel.imshow(stage.picture(0.0), aspect="auto")
    words = panel.text(0.012, 0.975, "", transform=panel.transAxes, va="top", fontsize=9)

    def show(time: float) -> list[Any]:
        shown.set_data(stage.picture(time))
        words.set_text(f"t = {time:.1f} s, {speed:g} times real time")
        return [shown, words]

    return film_of(figure, show, list(times), 1000.0 / rate)


def _close(screen: Any, context: Any) -> None:
    """Free what a stage draws with; on another screen it would free what that one draws with."""
    screen.make_current()
    context.free()
    screen.free()


def _screen(size: tuple[int, int]) -> Any:
    """Return a context in which MuJoCo draws without a screen, by the first platform that works.

    Raises
    ------
    WideberthError : none does, each with its reason.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower()
    reasons = []
    for name in [asked] if asked in PLATFORMS else PLATFORMS:
        before = os.environ.get("PYOPENGL_PLATFORM")
        try:
            context = import_module(f"mujoco.{name}").GLContext(*size)
            context.make_current()
        except Exception as error:  # the drivers raise whatever they like
            reasons.append(f"{name}: {type(error).__name__}: {error}")
            os.environ.pop("PYOPENGL_PLATFORM", None)
            if before is not None:
                os.environ["PYOPENGL_PLATFORM"] = before
        else:
            return context
    raise WideberthError(
        "this machine cannot draw without a screen; install EGL (libegl1 with a driver, as "
        "libegl-mesa0) or OSMesa (libosmesa6), or watch the episode from above with "
        f"episode.animate(). {'; '.join(reasons)}"
    )


@final
@dataclass(frozen=True, eq=False)
class _Shown:
    """An agent of an episode, and where it stands in the arrays of MuJoCo."""

    log: AgentLog
    color: Array  # (3,)
    place: slice  # of qpos, or of mocap_pos
    wheel: float  # m, radius; 0 for a person


@final
class _Stage:
    """The bodies of an episode, put where they were at a time, and a picture of them."""

    def __init__(self, episode: Episode, size: tuple[int, int], elevation: float) -> None:
        _check(episode, size, elevation)
        library = mujoco()
        self._episode, self._size = episode, size
        scene = _scene(episode)
        self._model = library.MjModel.from_xml_string(mjcf(scene))
        self._data = library.MjData(self._model)
        self._shown = list(self._cast(scene))
        low, high = artists.extent(episode)
        self._camera = library.MjvCamera()
        self._camera.lookat[:] = *(0.5 * (low + high)), 0.0
        self._camera.azimuth, self._camera.elevation = 90.0, -elevation
        self._camera.distance = _distance(self._model, high - low, size, elevation)
        self._model.vis.quality.shadowsize = 0  # shadows double the time and are hardly seen
        self._screen = _screen(size)
        self._context = library.MjrContext(self._model, library.mjtFontScale.mjFONTSCALE_100)
        finalize(self, _close, self._screen, self._context)
        self._scene = library.MjvScene(self._model, _MOST)
        self._option = library.MjvOption()
        self._option.geomgroup[:] = 1

    def picture(self, time: float) -> NDArray[np.uint8]:
        """Return what is seen at a time, s, (height, width, 3)."""
        library, model, data = mujoco(), self._model, self._data
        for one in self._shown:
            self._put(one, time)
        library.mj_kinematics(model, data)
        library.mj_comPos(model, data)
        self._screen.make_current()
        library.mjr_setBuffer(library.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        library.mjv_updateScene(
            model, data, self._option, None, self._camera, library.mjtCatBit.mjCAT_ALL, self._scene
        )
        for one in self._shown:
            self._mark(one, time)
        width, height = self._size
        found = np.empty((height, width, 3), dtype=np.uint8)
        area = library.MjrRect(0, 0, width, height)
        library.mjr_render(area, self._scene, self._context)
        library.mjr_readPixels(found, None, area, self._context)
        return found[::-1]

    def _cast(self, scene: PhysicalScene) -> Iterator[_Shown]:
        """Find the bodies of all agents, and give them their colours."""
        from matplotlib.colors import to_rgb

        looks = artists.looks(self._episode)
        robots = [log for log in self._episode.agents if log.kind == "robot"]
        people = [log for log in self._episode.agents if log.kind != "robot"]
        for index, (log, robot) in enumerate(zip(robots, scene.robots, strict=True)):
            color = np.array(to_rgb(looks[log.name].color))
            start = int(self._model.joint(f"robot{index}").qposadr[0])
            clear = 0.25 if robot.body.hull == "cylinder" else 0.6
            self._model.geom(f"robot{index}").rgba[:] = *color, clear
            yield _Shown(log, color, slice(start, start + 11), robot.body.wheel_radius)
        for index, log in enumerate(people):
            self._model.geom(f"person{index}").rgba[:3] = _PERSON
            yield _Shown(log, _PERSON, slice(index, index + 1), 0.0)

    def _put(self, one: _Shown, time: float) -> None:
        """Put a body where its agent was; one that was not there below the floor."""
        x, y = self._episode.at(one.log, np.array([time]))[0, :2]
        there = bool(np.isfinite([x, y]).all())
        if not one.wheel:
            self._data.mocap_pos[one.place, :2] = (x, y) if there else 0.0
            height = float(self._model.geom_size[self._geom(one), 1])
            self._data.mocap_pos[one.place, 2] = height if there else -_AWAY
            return
        heading = artists.heading_at(self._episode, one.log, time)
        half = 0.5 * (heading if np.isfinite(heading) else 0.0)
        turned = (np.cos(half), 0.0, 0.0, np.sin(half))
        place = (x, y, one.wheel) if there else (0.0, 0.0, -_AWAY)
        rolled = _way(self._episode, one.log, time) / one.wheel
        self._data.qpos[one.place] = *place, *turned, *(4 * (rolled,))

    def _geom(self, one: _Shown) -> int:
        return int(self._model.geom(f"person{one.place.start}").id)

    def _mark(self, one: _Shown, time: float) -> None:
        """Draw the way of a robot so far, and its plan."""
        if not one.wheel:
            return
        before = self._episode.times <= time
        way = one.log.positions[before, :2]
        way = way[np.isfinite(way).all(axis=1)]
        way = way[:: max(len(way) // 200, 1)]
        for begin, end in pairwise(way):
            self._shape(one.color, begin, end)
        plan = artists.plan_at(one.log, time)
        if plan is not None:
            for place in plan.positions[1:, :2]:
                self._shape(one.color, place)

    def _shape(self, color: Array, begin: Array, end: Array | None = None) -> None:
        """Draw a dot, or a line to an end; nothing once the picture is full."""
        library, scene = mujoco(), self._scene
        if scene.ngeom >= scene.maxgeom:
            return
        kind = library.mjtGeom.mjGEOM_SPHERE if end is None else library.mjtGeom.mjGEOM_CAPSULE
        geom, rgba = scene.geoms[scene.ngeom], np.array([*color, 1.0], dtype=np.float32)
        place = np.array([*begin, _DOT])
        library.mjv_initGeom(geom, kind, np.full(3, _DOT), place, np.eye(3).ravel(), rgba)
        if end is not None:
            library.mjv_connector(geom, kind, _TRAIL, place, np.array([*end, _DOT]))
        scene.ngeom += 1


def _check(episode: Episode, size: tuple[int, int], elevation: float) -> None:
    """Refuse what cannot be filmed.

    Raises
    ------
    WideberthError : what `film` raises, but for what is missing on the machine.
    """
    if not episode.robots or episode.robots[0].positions.shape[1] != 2:
        raise WideberthError(
            "a film in space is of robots on the floor; this episode has none, or they fly: "
            "watch it with episode.animate()"
        )
    width, height = size
    if not (16 <= width <= 1920 and 16 <= height <= 1080):
        raise WideberthError(f"size is {size}; wanted 16 x 16 to 1920 x 1080 pixels")
    if not 0.0 < elevation <= 90.0:
        raise WideberthError(f"elevation is {elevation:g}; wanted degrees above 0, at most 90")


def _scene(episode: Episode) -> PhysicalScene:
    """Return bodies for all agents: robots of their radius, and cylinders for all others."""
    robots = tuple(
        PhysicalRobot(f"r{index}", _body(log))
        for index, log in enumerate(one for one in episode.agents if one.kind == "robot")
    )
    people = tuple(
        PhysicalPerson(f"p{index}", np.zeros(2), log.radius)
        for index, log in enumerate(one for one in episode.agents if one.kind != "robot")
    )
    walls = tuple(replace(wall, name=f"w{index}") for index, wall in enumerate(episode.polygons))
    return PhysicalScene(robots, people, walls)


def _body(log: AgentLog) -> SkidSteerBody:
    """Return the large body at the scale of a robot, as a box if it has a footprint."""
    scale = log.radius / LARGE.radius
    lengths = (
        *("wheel_radius", "wheel_half_width", "track", "wheel_base"),
        *("half_length", "half_width"),
    )
    scaled = {name: scale * getattr(LARGE, name) for name in lengths}
    return replace(LARGE, hull="cylinder" if log.footprint is None else "box", **scaled)


def _distance(model: Any, span: Array, size: tuple[int, int], elevation: float) -> float:
    """Return how far the camera is from the middle, m, so that it sees all of a rectangle."""
    slope = float(np.tan(0.5 * np.radians(model.vis.global_.fovy)))
    wide, deep = 0.5 * span
    near = deep * float(np.cos(np.radians(elevation)))  # by which the front edge is nearer
    across = wide / (slope * size[0] / size[1]) + near
    upright = deep * float(np.sin(np.radians(elevation))) / slope + near
    return float(max(across, upright))


def _way(episode: Episode, log: AgentLog, time: float) -> float:
    """Return the length of an agent's way until a time, m."""
    way = log.positions[episode.times <= time, :2]
    steps = np.hypot(*np.diff(way, axis=0).T)
    return float(np.nansum(steps))
