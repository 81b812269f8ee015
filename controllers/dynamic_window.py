"""The dynamic window: the best of the velocities that can be had now and stopped from in time."""

from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from ..framework.control.command_limits import attained
from ..framework.numerics.geometry import wrapped
from ..framework.values.arrays import Array, BoolArray, whole
from ..framework.values.motion import Command, Observation, Twist
from .arcs import free_way
from .reactive import Reactive
from .steering import FAST, SLOWING, top_speed, yaw_acceleration


@dataclass(frozen=True, eq=False)
class Candidates:
    """Velocities in the window, and where each leads.

    Attributes
    ----------
    twists : (S, 3), as `attained` gives them.
    speed : (S,), m/s, at least 0.
    direction : (S, 2), in which each starts; (0, 0) where it stands.
    curvature : (S,), 1/m, positive to the left.
    free : (S,), m, to the first contact.
    """

    twists: Array
    speed: Array
    direction: Array
    curvature: Array
    free: Array


@final
@dataclass(eq=False)
class DynamicWindow(Reactive):
    """Fox's dynamic window: heading, clearance and velocity, among what is admissible.

    The window holds the velocities that the robot can have one period T from now. Each is a
    circular arc, on which d is free before the first contact with an obstacle or polygon. Those
    from which the robot can stop in time are admissible,

        v <= sqrt(2 a (d - T max(v, v_now))),

    and the one with the largest

        w_h (1 - |error| / pi) + w_c min(d, view) / view + w_v v / v_ref

    is commanded; without any, the robot brakes. The error is the angle from the heading to the
    point ahead on the path, where the robot would be after T and then braking as hard as it can.

    Obstacles are discs that stand still, as published: a robot that can brake along the arc it is
    on touches none of those that do; of those that move nothing is promised.

    Beside the publication: d is less by what is driven until the next decision; the limit on the
    yaw rate is left out (a disc touches nothing by turning), and so is the smoothing of the sum; d
    is exact, see `wideberth.controllers.arcs`. A robot without heading has the
    window (vx, vy), straight ways, and for the error the angle from its velocity. The weights are
    ours, about in the proportion of the publication's; its margin at the sides grows with the
    speed, ours is the same all round.

    Parameters
    ----------
    robot, period, reference_speed, look_ahead : as in `Reactive`.
    samples : velocities per axis of the window.
    heading, clearance, velocity : w_h, w_c, w_v.
    view : m, beyond which clearance is worth no more.
    margin : m, added to the radius of the robot.

    Raises
    ------
    WideberthError : a number out of range, or a robot that moves in space.

    References
    ----------
    D. Fox, W. Burgard and S. Thrun, The dynamic window approach to collision avoidance, IEEE
    Robotics and Automation Magazine 4 (1997).
    """

    zero_allowed: ClassVar[frozenset[str]] = frozenset(
        {"heading", "clearance", "velocity", "margin"}
    )
    reference: ClassVar[str] = "fox1997dynamic"

    samples: int = 15
    heading: float = 0.8
    clearance: float = 0.1
    velocity: float = 0.1
    view: float = 3.0
    margin: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        whole("DynamicWindow.samples", self.samples, least=2)

    def decide(self, observation: Observation, place: Array) -> Command:
        """Best admissible velocity, or zero."""
        found = self._guide.ahead(place, self.look_ahead)
        assert found is not None  # seen to by `command`
        carrot, way = found
        window = self.candidates(observation, place, carrot - place, way)
        braking = self.braking(observation.state)
        allowed = self.admissible(window, observation.state, braking)
        if not allowed.any():
            return Command((0.0, 0.0))
        value = self.objective(window, observation, place, carrot, braking)
        best = window.twists[int(np.where(allowed, value, -np.inf).argmax())]
        return Command((float(best[0]), float(best[1])), float(best[2]))

    def candidates(
        self, observation: Observation, place: Array, ahead: Array, way: float
    ) -> Candidates:
        """Sample the window; ``ahead`` (2,), m, leads to the point headed for.

        Velocities are kept below min(v_ref, way / `SLOWING`), or as near to it as can be.
        """
        state = observation.state
        fastest = min(self.reference_speed, way / SLOWING)
        heading = self.robot.pose(tuple(state)).heading
        if heading is None:
            twists = self._over_velocities(state, ahead, fastest)
            linear, turning = twists[:, :2], np.zeros(len(twists))
        else:
            twists = self._over_turns(state, fastest)
            linear = twists[:, :1] * np.array([np.cos(heading), np.sin(heading)])
            turning = twists[:, 2]
        speed = np.hypot(linear[:, 0], linear[:, 1])
        moves = speed > 1e-9
        some = np.where(moves, speed, 1.0)
        direction = np.where(moves[:, None], linear / some[:, None], 0.0)
        curvature = np.where(moves, turning / some, 0.0)
        free = np.full(len(speed), np.inf)
        _, others, _, radii = self._neighbours.now()
        free[moves] = free_way(
            place,
            direction[moves],
            curvature[moves],
            self.robot.radius + self.margin,
            (others, radii),
            observation.polygons,
        )
        return Candidates(twists, speed, direction, curvature, free)

    def braking(self, state: Array) -> float:
        """Deceleration a at which the robot stops, m/s^2.

        Asked of the robot, at its top speed, for one period: at least one period to stop.
        """
        top = top_speed(self.robot, state)
        heading = self.robot.pose(tuple(state)).heading
        pose, ahead = self.robot.pose(tuple(state)), Twist((top, 0.0))
        fast = np.array(self.robot.state_at(pose, ahead), dtype=np.float64)
        slower = attained(self.robot, fast, [Twist((0.0, 0.0))], self.period)[0]
        left = abs(slower[0]) if heading is not None else float(np.hypot(*slower[:2]))
        return (top - left) / self.period

    def admissible(self, window: Candidates, state: Array, braking: float) -> BoolArray:
        """Which of the window can be stopped from before anything is touched, (S,)."""
        now = self.robot.twist(tuple(state), tuple(np.zeros(len(self.robot.inputs))))
        before = np.maximum(window.speed, float(np.hypot(*now.linear)))
        room = np.maximum(window.free - self.period * before, 0.0)
        return np.asarray(window.speed**2 <= 2.0 * braking * room)

    def objective(
        self,
        window: Candidates,
        observation: Observation,
        place: Array,
        carrot: Array,
        braking: float,
    ) -> Array:
        """Value of each velocity, (S,); see the class."""
        error = self._error(window, observation.state, place, carrot, braking)
        near = np.minimum(window.free, self.view) / self.view
        return np.asarray(
            self.heading * (1.0 - error / np.pi)
            + self.clearance * near
            + self.velocity * window.speed / self.reference_speed
        )

    def _error(
        self, window: Candidates, state: Array, place: Array, carrot: Array, braking: float
    ) -> Array:
        """Angle to the carrot from where each velocity leads, (S,), rad, in [0, pi]."""
        way = window.speed * self.period + window.speed**2 / (2.0 * braking)
        bend = way * window.curvature / 2.0  # half the angle of the arc
        chord = way * np.sinc(bend / np.pi)
        cosine, sine = np.cos(bend), np.sin(bend)
        x, y = window.direction.T
        then = place + chord[:, None] * np.stack([cosine * x - sine * y, sine * x + cosine * y], 1)
        left = carrot - then
        heading = self.robot.pose(tuple(state)).heading
        if heading is None:
            facing = np.arctan2(y, x)
        else:
            rate, alpha = window.twists[:, 2], yaw_acceleration(self.robot, state)
            facing = heading + rate * self.period + rate * np.abs(rate) / (2.0 * alpha)
        error = np.abs(wrapped(np.arctan2(left[:, 1], left[:, 0]) - facing))
        if heading is None:  # who stands faces nowhere
            error = np.where(window.speed > 1e-9, error, np.pi / 2.0)
        return np.asarray(error)

    def _over_turns(self, state: Array, fastest: float) -> Array:
        """Twists (S, 3) of a robot with heading: a grid of forward speeds and yaw rates."""
        now = self.robot.twist(tuple(state), tuple(np.zeros(len(self.robot.inputs))))
        ends = [Twist((sign * FAST, 0.0), now.angular) for sign in (-1.0, 1.0)]
        low, high = attained(self.robot, state, ends, self.period)[:, 0]
        high = max(min(high, fastest), low)
        speeds = self._grid(max(low, min(0.0, high)), high)
        ends = [Twist((float(speeds[-1]), 0.0), sign * FAST) for sign in (-1.0, 1.0)]
        low, high = attained(self.robot, state, ends, self.period)[:, 2]
        rates = self._grid(low, high)
        wanted = [Twist((float(v), 0.0), float(omega)) for v in speeds for omega in rates]
        return attained(self.robot, state, wanted, self.period)

    def _over_velocities(self, state: Array, ahead: Array, fastest: float) -> Array:
        """Twists (S, 3) of a robot without heading: a grid of velocities, and straight ahead."""
        control = tuple(np.zeros(len(self.robot.inputs)))
        now = np.array(self.robot.twist(tuple(state), control).linear, dtype=np.float64)
        ends = now + FAST * np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, -1.0], [0.0, 1.0]])
        corners = attained(self.robot, state, [_moving(v) for v in ends], self.period)[:, :2]
        low, high = corners.min(axis=0), corners.max(axis=0)
        grid = np.meshgrid(self._grid(low[0], high[0]), self._grid(low[1], high[1]))
        straight = ahead * (fastest / max(float(np.hypot(*ahead)), 1e-9))
        wanted = np.concatenate([np.stack(grid, axis=-1).reshape(-1, 2), straight[None]])
        length = np.hypot(wanted[:, 0], wanted[:, 1])
        wanted *= np.minimum(1.0, fastest / np.maximum(length, 1e-9))[:, None]
        return attained(self.robot, state, [_moving(v) for v in wanted], self.period)

    def _grid(self, low: float, high: float) -> Array:
        """Even steps from low to high, and 0 where it lies between."""
        steps = np.linspace(low, high, self.samples)
        return np.unique(np.append(steps, np.clip(0.0, low, high)))


def _moving(velocity: Array) -> Twist:
    return Twist((float(velocity[0]), float(velocity[1])))
