"""A robot drives only as fast as it can stop within what it saw last."""

from math import sqrt
from typing import final

import numpy as np

from wideberth.framework.control.command_limits import FAST, attained, deceleration
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import FARTHEST, Array, positive
from wideberth.framework.values.footprint import Discs, Outline
from wideberth.framework.values.motion import Pose, Twist

STEPS = 24
"""Instants at which a motion is looked at, until the robot would stand."""
REACTION = 0.2
"""s, until a command has an effect: its period, and the lag of a base."""
DISTANCE, CLOSING = 0.02, 0.3
"""m that is kept from all points, and m/s at which they may come nearer."""


@final
class RoomToStop:
    """Slows a twist until the robot can stop on its arc before it touches anything.

    With t_c the time until it touches the first point at that twist, T = `REACTION`, t_b the time
    to brake, v the speed of what moves fastest of it and c = `CLOSING`, the largest share s of the
    twist is left for which

        s T + s^2 t_b / 2 <= t_c / (1 + c / v)

    so that the curve stays, and the robot stands before who comes nearer meanwhile. Points of age
    A touch it at `DISTANCE` + A c, and from an age on it stands. Where a point is nearer already,
    the robot may do what brings none nearer than that.

    Parameters
    ----------
    robot : in the plane; its limits and its footprint count.
    oldest : s; of points that are older nothing is known.

    Raises
    ------
    WideberthError : an age that is not above zero.
    """

    def __init__(self, robot: Robot, oldest: float = 0.5) -> None:
        positive("room_to_stop.oldest", oldest)
        self._robot, self._oldest = robot, oldest
        still, soon = np.zeros(len(robot.states)), 1e-3
        turning = float(attained(robot, still, [Twist((0.0, 0.0), FAST)], soon)[0, 2]) / soon
        self._braking = np.array([deceleration(robot), deceleration(robot), turning or np.inf])

    def allowed(self, twist: Twist, pose: Pose, points: Array, age: float) -> Twist:
        """Return the share of a twist that is left; the twist itself where that is all of it.

        Parameters
        ----------
        twist : in the robot's frame. pose : of the robot.
        points : (N, 2), m, of what was seen, in the frame of the pose.
        age : s, since they were seen.
        """
        share = self._share(np.array([*twist.linear, twist.angular]), pose, points, age)
        if share >= 1.0:
            return twist
        return Twist(tuple(share * one for one in twist.linear), share * twist.angular)

    def _share(self, twist: Array, pose: Pose, points: Array, age: float) -> float:
        if not age <= self._oldest or not (np.abs(pose.position) <= FARTHEST).all():
            return 0.0
        speed = float(np.hypot(twist[0], twist[1]) + self._robot.radius * abs(twist[2]))
        if not speed:
            return 1.0
        braking, nearing = float((np.abs(twist) / self._braking).max()), 1.0 + CLOSING / speed
        times = np.linspace(0.0, nearing * (REACTION + 0.5 * braking), STEPS + 1)
        keep = DISTANCE + CLOSING * max(age, 0.0)
        seen = _seen_from(pose, points)
        reach = self._robot.radius + keep + speed * float(times[-1])
        seen = seen[(np.abs(seen) <= reach).all(axis=1)]
        if not len(seen):
            return 1.0
        nearest = self._gaps(twist, times, seen).min(axis=1)
        touched = nearest < min(keep, nearest[0] - 1e-6)
        if not touched.any():
            return 1.0
        free = float(times[int(touched.argmax()) - 1]) / nearing
        return (sqrt(REACTION**2 + 2.0 * braking * free) - REACTION) / braking

    def _gaps(self, twist: Array, times: Array, points: Array) -> Array:
        """Return how far points (N, 2) of the robot's frame are from it at some times, (K, N)."""
        half = 0.5 * twist[2] * times
        chord = times * np.sinc(half / np.pi)
        cosine, sine = np.cos(half), np.sin(half)
        shift = chord * np.array(
            [cosine * twist[0] - sine * twist[1], sine * twist[0] + cosine * twist[1]]
        )
        apart = points - shift.T[:, None]
        cosine, sine = np.cos(2.0 * half)[:, None], np.sin(2.0 * half)[:, None]
        ahead = cosine * apart[..., 0] + sine * apart[..., 1]
        aside = cosine * apart[..., 1] - sine * apart[..., 0]
        return _gap(self._robot, ahead, aside)


def _seen_from(pose: Pose, points: Array) -> Array:
    """Return points (N, 2) in the frame of a pose."""
    apart = points - np.array(pose.position, dtype=np.float64)
    heading = 0.0 if pose.heading is None else float(pose.heading)
    cosine, sine = np.cos(heading), np.sin(heading)
    return np.stack(
        [cosine * apart[:, 0] + sine * apart[:, 1], cosine * apart[:, 1] - sine * apart[:, 0]],
        axis=-1,
    )


def _gap(robot: Robot, x: Array, y: Array) -> Array:
    """Return how far places of a robot's frame are from its body, m; less than 0 within it."""
    body = robot.footprint
    if isinstance(body, Outline):
        corners = np.array(body.vertices)
        edges = np.roll(corners, -1, axis=0) - corners
        sides = [
            ((x - ax) * ey - (y - ay) * ex) / np.hypot(ex, ey)
            for (ax, ay), (ex, ey) in zip(corners, edges, strict=True)
        ]
        return np.asarray(np.max(sides, axis=0))
    discs = body if isinstance(body, Discs) else Discs(((0.0, 0.0),), robot.radius)
    away = [np.hypot(x - ax, y - ay) for ax, ay in discs.centres]
    return np.asarray(np.min(away, axis=0)) - discs.radius
