"""What is right in contact: to stop, or to leave what is touched, and never faster than now.

A robot is in contact where its bodies touch or overlap an obstacle where that is expected now;
neither its region nor the planner's margin counts. Until they are apart a plan

1. is no faster than the robot is now, or than `LEAVING`;
2. moves only away from everyone in contact: at most a quarter of an obstacle's width lies ahead
   of the robot's middle, or less than half of it where the robot is no faster than `LEAVING`. It
   moves neither towards them nor along their side, and nowhere from one that is exactly centred;
3. presses no body deeper into where they are, by turning say.

Braking straight on as hard as the limits allow is always right, and so is every plan that moves,
and presses, no more than that at each step.

What was seen without a place may be in contact on any side: no motion leads away, and only
braking is left.

The last plan is not driven on in contact: one that stands would stay. Of what keeps the rule,
`LadderInput.gentlest` takes what leaves most.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from ...robot import Robot
from ...values.arrays import Array
from ...values.forecast import Forecast
from ...values.tracks import Tracks
from ..ocp.bodies import apart, bodies
from .rollout import brake

LEAVING = 0.25
"""m/s, at which a slower robot may leave: the reduced speed of ISO 10218-1."""
AHEAD, SLOWLY = 0.25, 0.5
"""Largest share of an obstacle's width that may lie ahead of the middle of a robot that leaves,
and the share below which it stays at no more than `LEAVING`."""
TOUCHING = 1e-6
"""m; bodies that are no farther apart touch."""
ROUNDING = 1e-4
"""m and m/s, by which plans differ from braking because solvers have tolerances."""


@final
@dataclass(frozen=True, eq=False)
class InContact:
    """Who is in contact as a plan begins, and how the robot would brake there.

    Attributes
    ----------
    names, places, radii : of those in contact, (C,), (C, D) in m and (C,) in m.
    placeless : names of those who were seen without a place.
    fastest : m/s, at which plans may leave.
    braking : how hard braking moves.
    dt : s per step.
    """

    names: tuple[str, ...]
    places: Array
    radii: Array
    placeless: tuple[str, ...]
    fastest: float
    braking: "_Moved"
    dt: float

    @classmethod
    def of(
        cls,
        robot: Robot,
        start: Array,
        others: tuple[tuple[str, ...], Array, Array],
        placeless: tuple[str, ...],
        steps: int,
        dt: float,
    ) -> "InContact | None":
        """Return who is in contact with a robot at ``start``, (n,); None for none.

        Parameters
        ----------
        others : names, places (O, D), m, and radii (O,), m, of all obstacles, see `expected_now`.
        placeless : names of those who were seen without a place.
        steps, dt : of plans, N and s.
        """
        names, places, radii = others
        if not names and not placeless:
            return None
        near = _depths(robot, start[None], places, radii)[0] >= -TOUCHING
        if not near.any() and not placeless:
            return None
        touching = np.flatnonzero(near)
        kept = places[touching], radii[touching]
        braking = _Moved.along(robot, *brake(robot, start, steps, dt), *kept)
        fastest = max(float(braking.begin), LEAVING)
        some = tuple(names[i] for i in touching)
        return cls(some, *kept, placeless, fastest, braking, dt)

    def pressed(self, robot: Robot, states: Array, inputs: Array) -> Array:
        """How far a plan breaks the rule of contact at steps 1..N, (N,); 0 where it keeps it.

        It is m/s too fast, or m too far or too deep in a step; rad/s where one has no place.

        Parameters
        ----------
        states, inputs : (N + 1, n) and (N, m), finite.
        """
        found = _Moved.along(robot, states, inputs, self.places, self.radii)
        fast = found.speed - np.maximum(self.fastest, self.braking.speed)
        extra = found.length - self.braking.length
        slow = found.length <= (LEAVING + ROUNDING) * self.dt
        share = np.where(slow, SLOWLY, AHEAD)
        beyond = (1.0 - 2.0 * share)[:, None] * self.radii + TOUCHING
        ahead = beyond * found.length[:, None] + found.towards
        onward = (ahead > 0.0).any(axis=1) | bool(self.placeless)
        deeper = found.depth[1:] - np.maximum(found.depth[:-1], self.braking.depth[1:])
        broken = np.maximum(fast, np.where(onward, extra, 0.0))
        broken = np.maximum(broken, deeper.max(axis=1, initial=0.0))
        if self.placeless:
            broken = np.maximum(broken, found.turn - self.braking.turn)
        touching = (found.depth[:-1] >= -TOUCHING).any(axis=1) | bool(self.placeless)
        held = np.logical_and.accumulate(touching)
        return np.where(held & (broken > ROUNDING), broken, 0.0)

    def __str__(self) -> str:
        """Say it in a clause."""
        words = []
        if self.placeless:
            words.append(f"{_some(self.placeless)} seen without a place: the robot stops")
        if self.names:
            words.append(f"in contact with {_some(self.names)}: the robot stops or leaves")
        return "; ".join(words)

    @property
    def name(self) -> str:
        """One of them, for a breach."""
        return (*self.names, *self.placeless)[0]


@dataclass(frozen=True, eq=False)
class _Moved:
    """How a robot moves past some places.

    Attributes
    ----------
    begin : m/s, its speed at first.
    speed, turn, length : (N,), m/s and rad/s after each step, and m moved in it.
    towards : (N, C), m^2, product of that motion with the way to each place.
    depth : (N + 1, C), m, of the bodies in the obstacles; negative where they are apart.
    """

    begin: float
    speed: Array
    turn: Array
    length: Array
    towards: Array
    depth: Array

    @classmethod
    def along(
        cls, robot: Robot, states: Array, inputs: Array, places: Array, radii: Array
    ) -> "_Moved":
        """Look at states (N + 1, n) and inputs (N, m)."""
        begin, _ = _twists(robot, states[:1], np.zeros_like(inputs[:1]))
        speed, turn = _twists(robot, states[1:], inputs)
        at = robot.pose(tuple(states.T)).points()
        moved = np.diff(at, axis=0)
        towards = (moved[:, None] * (places - at[:-1, None])).sum(axis=2)
        depth = _depths(robot, states, places, radii)
        length = np.linalg.norm(moved, axis=1)
        return cls(float(begin[0]), speed, turn, length, towards, depth)


def _twists(robot: Robot, states: Array, inputs: Array) -> tuple[Array, Array]:
    """Speed, m/s, and turn rate, rad/s, at K states after as many inputs."""
    twist = robot.twist(tuple(states.T), tuple(inputs.T))
    speed = np.zeros(len(states))
    for component in twist.linear:
        speed = np.hypot(speed, component)
    return speed, np.abs(np.zeros(len(states)) + twist.angular)


def _depths(robot: Robot, states: Array, places: Array, radii: Array) -> Array:
    """How deep the bodies are in discs at K states, (K, C), m; negative where they are apart."""
    pose = robot.pose(tuple(states.T))
    if not len(places):
        return np.zeros((len(states), 0))
    each = [body.radius + radii - apart(body, pose, places[None]) for body in bodies(robot)]
    return each[0] if len(each) == 1 else np.maximum.reduce(each)


def expected_now(
    tracks: Tracks | None, forecast: Forecast | None, lag: float, size: int
) -> tuple[tuple[str, ...], Array, Array]:
    """Names, places (O, D), m, and radii (O,), m, of all obstacles as a plan begins.

    The place lies between the newest measurement and the likeliest forecast of the plan's first
    step; one that was not measured at the newest instant is where its forecast comes from.

    Parameters
    ----------
    lag : s from the newest measurement to the plan's first state.
    size : D.
    """
    if tracks is None or forecast is None:
        return (), np.zeros((0, size)), np.zeros(0)
    mean = forecast.mean[:, 0]
    if forecast.weight.shape[1] > 1:
        mean = forecast.mean[np.arange(len(tracks)), forecast.weight.argmax(axis=1)]
    share = min(max(lag / (lag + forecast.dt), 0.0), 1.0)
    newest = tracks.positions[:, -1]
    between = (1.0 - share) * newest + share * mean[:, 0]
    if (lost := np.isnan(newest)).any():
        back = 2.0 * mean[:, 0] - mean[:, min(1, forecast.steps - 1)]
        between = np.where(lost, back, between)
    return tracks.ids, between, tracks.radius


def _some(names: Sequence[str]) -> str:
    """Name some of them."""
    return ", ".join(map(repr, names[:3])) + ", ..." * (len(names) > 3)
