"""What regulated and vector pursuit share: parameters, slowing, turning, and arcs that collide."""

from dataclasses import dataclass
from math import atan2, cos, hypot, inf, pi, sin

import numpy as np

from wideberth.framework.values.arrays import Array

from ..costs import FREE_SPACE, LETHAL, NO_INFORMATION
from ..parameters import Positive
from ..poses import length, normalized
from .local_controller import LocalController, Tick

_SLOW, _TURNING = 0.01, 0.01
"""m/s and rad/s: a robot slower than the one and quicker than the other turns on the spot."""
_TURN = 2.0 * pi
"""rad: after a whole turn the poses come again."""


@dataclass(eq=False)
class Pursuit(LocalController):
    """A controller that follows an arc to a point of the plan ahead.

    Parameters
    ----------
    lookahead_dist, min_lookahead_dist, max_lookahead_dist : m, to the point.
    lookahead_time : s.
    use_velocity_scaled_lookahead_dist : look ahead by speed times `lookahead_time`.
    use_rotate_to_heading : turn on the spot.
    rotate_to_heading_min_angle : rad, from which on it does.
    min_approach_linear_velocity : m/s, least speed near the goal.
    approach_velocity_scaling_dist : m, from which on it slows for the goal.
    use_cost_regulated_linear_velocity_scaling : slow near obstacles.
    cost_scaling_dist : m, from an obstacle, from which on it slows.
    cost_scaling_gain : of that.
    inflation_cost_scaling_factor : 1/m, of the costmap's inflation.
    use_collision_detection : test the arc.
    allow_reversing : drive backwards to a point behind.
    controller_frequency : Hz, of ticks.
    """

    lookahead_dist: Positive = 0.6
    min_lookahead_dist: float = 0.3
    max_lookahead_dist: float = 0.9
    lookahead_time: float = 1.5
    use_velocity_scaled_lookahead_dist: bool = False
    use_rotate_to_heading: bool = True
    rotate_to_heading_min_angle: float = 0.785
    min_approach_linear_velocity: float = 0.05
    approach_velocity_scaling_dist: Positive = 0.6
    use_cost_regulated_linear_velocity_scaling: bool = True
    cost_scaling_dist: Positive = 0.6
    cost_scaling_gain: float = 1.0
    inflation_cost_scaling_factor: Positive = 3.0
    use_collision_detection: bool = True
    allow_reversing: bool = False
    controller_frequency: Positive = 20.0

    def look_ahead_distance(self, speed: float) -> float:
        """Return how far ahead the point is that it follows at a speed, m."""
        if not self.use_velocity_scaled_lookahead_dist:
            return self.lookahead_dist
        wanted = abs(speed) * self.lookahead_time
        return min(max(wanted, self.min_lookahead_dist), self.max_lookahead_dist)

    def sign(self, target: Array) -> float:
        """Return 1 for driving ahead to a point in the robot's frame, -1 for backwards."""
        return -1.0 if self.allow_reversing and target[0] < 0.0 else 1.0

    def turn_towards(self, target: Array, sign: float) -> float | None:
        """Return the angle to turn by to face a point, rad; None where the robot drives."""
        angle = atan2(float(target[1]), float(target[0]))
        if sign < 0.0:
            angle = normalized(angle + pi)
        return angle if abs(angle) > self.rotate_to_heading_min_angle else None

    def cost_regulated(self, cost: int) -> bool:
        """Return whether the cost where the robot stands may slow it."""
        known = cost not in (FREE_SPACE, NO_INFORMATION)
        return self.use_cost_regulated_linear_velocity_scaling and known

    def share_near(self, apart: float) -> float:
        """Return the share of the speed that an obstacle so far away (m) leaves."""
        if apart >= self.cost_scaling_dist:
            return 1.0
        return self.cost_scaling_gain * apart / self.cost_scaling_dist

    def approaching(self, speed: float, fastest: float, plan: Array) -> float:
        """Return a speed (m/s) that is less near the end of a plan in the robot's frame.

        Parameters
        ----------
        fastest : m/s, of which the distance to the end leaves a share.
        """
        if length(plan) >= self.approach_velocity_scaling_dist:
            return speed
        apart = hypot(float(plan[-1, 0]), float(plan[-1, 1]))
        slow = fastest * apart / self.approach_velocity_scaling_dist
        return min(speed, max(slow, self.min_approach_linear_velocity))


def in_collision(tick: Tick, pose: Array) -> bool:
    """Return whether the robot's outline meets an obstacle at a pose (3,); never off the map.

    Unknown cells are obstacles unless the costmap tracks them.
    """
    if not tick.costmap.inside(pose[:2]):
        return False
    cost = tick.footprint.cost(tick.costmap, pose)
    if cost == NO_INFORMATION and tick.track_unknown:
        return False
    return cost >= LETHAL


def collision_arc(
    tick: Tick, speed: float, turning: float, time: float, reach: float
) -> tuple[Array, bool]:
    """Follow an arc at steps of about a cell until it hits something or ends.

    It ends after a whole turn, too: the original goes round until the time is over, at the same
    poses but for a part of a step.

    Parameters
    ----------
    tick : where the robot is, and its costmap.
    speed, turning : m/s and rad/s.
    time : s, after which it ends.
    reach : m, distance from the robot beyond which it ends.

    Returns
    -------
    poses : (T, 3), those that were tried; the first is the robot's own.
    hit : whether the last of them is in collision.
    """
    step = _step_time(tick, speed, turning)
    x, y, yaw = (float(value) for value in tick.pose)
    tried = [tick.pose]
    if in_collision(tick, tick.pose):
        return np.array(tried), True
    count = 1
    while count * step < time and (count - 1) * step * abs(turning) <= _TURN:
        count += 1
        x, y = x + step * (speed * cos(yaw)), y + step * (speed * sin(yaw))
        yaw += step * turning
        if hypot(x - tick.pose[0], y - tick.pose[1]) > reach:
            break
        tried.append(np.array([x, y, yaw]))
        if in_collision(tick, tried[-1]):
            return np.array(tried), True
    return np.array(tried), False


def _step_time(tick: Tick, speed: float, turning: float) -> float:
    """Time in which the robot moves by about a cell, s."""
    resolution = tick.costmap.resolution
    if abs(speed) < _SLOW and abs(turning) > _TURNING:
        half = 0.5 * resolution / tick.footprint.circumscribed
        return 2.0 * sin(half) / abs(turning)
    return resolution / abs(speed) if speed else inf
