"""Controls that MPPI samples, rolled out, and what critics see of a tick. Numbers are float32."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, BoolArray

from ..costs import INSCRIBED, LETHAL, NO_INFORMATION
from ..poses import length
from .dwb_trajectories import cells_of
from .local_controller import Tick

Single: TypeAlias = NDArray[np.float32]
PI, TURN = np.float32(np.pi), np.float32(2.0 * np.pi)


def wrapped(angle: Single) -> Single:
    """Bring angles to [-pi, pi), rad."""
    rest = np.fmod(angle + PI, TURN)
    return np.asarray(np.where(rest < 0.0, rest + PI, rest - PI), np.float32)


@final
@dataclass(frozen=True)
class ControlLimits:
    """Limits of speed and acceleration; the names are Nav2's, m and s and rad.

    Attributes
    ----------
    turning_radius : m, the tightest arc; 0 for a robot that turns on the spot.
    """

    vx_max: float
    vx_min: float
    wz_max: float
    ax_max: float
    ax_min: float
    az_max: float
    turning_radius: float

    def steps(self, dt: float) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the largest loss and gain in a step, for vx and for omega."""
        return (dt * self.ax_min, dt * self.ax_max), (-dt * self.az_max, dt * self.az_max)


@final
@dataclass(frozen=True, eq=False)
class Rollouts:
    """Velocities and poses along B trajectories of T steps, each (T, B).

    Column 0 of the original's matrices, the first step, is row 0 here.

    Attributes
    ----------
    vx, wz : m/s and rad/s.
    x, y, yaw : m and rad, after each step.
    """

    vx: Single
    wz: Single
    x: Single
    y: Single
    yaw: Single

    @cached_property
    def lengths(self) -> Single:
        """Lengths of the polylines through the positions, (B,), m."""
        steps = np.sqrt(np.diff(self.x, axis=0) ** 2 + np.diff(self.y, axis=0) ** 2)
        return np.asarray(steps.sum(axis=0))

    def poses(self, every: int = 1) -> Array:
        """Return the poses of every so many trajectories, (K, T, 3)."""
        axes = [axis.T[::every] for axis in (self.x, self.y, self.yaw)]
        return np.stack(axes, axis=-1).astype(np.float64)


def followed(
    wanted: Single, speed: float, step: tuple[float, float], clamped: bool
) -> tuple[Single, Single]:
    """Return the velocities, (T, B), of a robot that follows controls as fast as it can.

        v_0 = speed,    v_i = the nearest to c_{i-1} within the reach of v_{i-1}

    The reach is [v + loss, v + gain] while the robot moves ahead, and its mirror image otherwise.

    Parameters
    ----------
    wanted : (T, B), controls c.
    speed : of now.
    step : loss, below zero, and gain of a step.
    clamped : whether the controls become what is followed of them.

    Returns
    -------
    velocities, controls : (T, B).
    """
    loss, gain = (np.float32(value) for value in step)
    found = np.empty_like(wanted)
    found[0] = speed
    for i in range(1, len(wanted)):
        before = found[i - 1]
        ahead = before > 0.0
        low = before + np.where(ahead, loss, -gain)
        high = before + np.where(ahead, gain, -loss)
        np.minimum(np.maximum(wanted[i - 1], low), high, out=found[i])
    if clamped:
        wanted = np.concatenate([found[1:], wanted[-1:]])
    return found, wanted


def delayed(velocities: Single, sent: Single) -> Single:
    """Shift velocities (T, B) to later by the number of commands that are under way.

    Parameters
    ----------
    sent : commands not yet carried out, oldest first; one or none changes nothing.
    """
    off = len(sent)
    if off <= 1:
        return velocities
    found = velocities.copy()
    found[1:off] = sent[1:, None]
    found[off:] = velocities[1 : len(velocities) - off + 1]
    return found


def driven(vx: Single, wz: Single, pose: Array, dt: float) -> Rollouts:
    """Drive from a pose (3,) with velocities (T, B) for steps of dt s.

        yaw_i = yaw_{i-1} + omega_i dt,    x_i = x_{i-1} + v_i cos(yaw_{i-1}) dt

    and y likewise.
    """
    step, start = np.float32(dt), pose.astype(np.float32)
    yaw = added(start[2], wz * step)
    before = np.concatenate([np.full_like(yaw[:1], start[2]), yaw[:-1]])
    x = added(start[0], vx * np.cos(before) * step)
    y = added(start[1], vx * np.sin(before) * step)
    return Rollouts(vx, wz, x, y, yaw)


def added(start: np.float32, steps: Single) -> Single:
    """Add steps (T, B) up one after the other."""
    steps[0] += start
    return np.asarray(np.cumsum(steps, axis=0, out=steps))


@final
@dataclass(eq=False)
class MppiTick:
    """What the critics of MPPI see of a tick, beside the rollouts.

    Attributes
    ----------
    tick : inputs of the controller.
    limits : of the robot; a speed limit leaves them, as in the original.
    dt : s, a step.
    all_collide : whether the last critic asked found that every trajectory collides.
    """

    tick: Tick
    limits: ControlLimits
    dt: float
    all_collide: bool = False

    path: Single = field(init=False)
    """(3, N), x, y and yaw of the plan."""
    length: float = field(init=False)
    """m, of the plan."""
    _furthest: int | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.path = np.ascontiguousarray(self.tick.plan.T, dtype=np.float32)
        self.length = float(np.float32(length(self.tick.plan)))

    @cached_property
    def arc(self) -> Single:
        """Length of the path from its begin to each point, (N,), m."""
        steps = np.sqrt(np.diff(self.path[0]) ** 2 + np.diff(self.path[1]) ** 2)
        return np.concatenate([np.zeros(1, np.float32), np.cumsum(steps)])

    @cached_property
    def valid(self) -> BoolArray:
        """Return which points of the path but the last are free, (N - 1,).

        Unknown cells are where the costmap tracks them; places off the map are not.
        """
        costmap = self.tick.costmap
        cells = cells_of(costmap, self.path[:2, :-1].T.astype(np.float64))
        costs = costmap.cells.ravel()[cells]
        unknown = (costs == NO_INFORMATION) & (not self.tick.track_unknown)
        blocked = (costs == INSCRIBED) | (costs == LETHAL) | unknown
        return np.asarray((cells >= 0) & ~blocked)

    def furthest(self, rollouts: Rollouts) -> int:
        """Return the index of the furthest point of the path that a trajectory reaches.

        Of each trajectory it is the point nearest to its end, among those that are no further
        along the path than the trajectory is long. The first answer stands for the whole tick.
        """
        if self._furthest is None:
            most = np.minimum(np.searchsorted(self.arc, rollouts.lengths), len(self.arc) - 1)
            dx = self.path[0] - rollouts.x[-1][:, None]
            dy = self.path[1] - rollouts.y[-1][:, None]
            square = dx * dx + dy * dy
            square[np.arange(len(self.arc)) > most[:, None]] = np.inf
            self._furthest = int(square.argmin(axis=1).max())
        return self._furthest
