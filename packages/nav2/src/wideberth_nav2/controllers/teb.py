"""Nav2's TEB: a timed elastic band, kept short, smooth, fast and away from obstacles."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, fields
from math import atan2, ceil, cos, hypot, sin, sqrt
from typing import final

import numpy as np

from wideberth.controllers.reactive import Neighbours
from wideberth.framework.tracking.stand_ins import sound
from wideberth.framework.values.arrays import Array, whole
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.motion import Twist

from ..costs import LETHAL
from ._teb_kernel import wrapped
from .local_controller import INVALID_PATH, Answer, LocalController, Tick
from .teb_band import Band, TebParameters
from .teb_classes import BandCandidate, BandCandidates
from .teb_edges import STANDING, Pull, TebObstacles, optimised

_SHARE, _AVERAGED, _SLOWEST, _FORGET = 0.85, 3, 0.01, 1.0
"""Of half the map that a band may cover; steps of the plan that the heading at the local goal is
averaged over; m/s, a lower limit of speed leaves nothing to optimise; s, after which an obstacle
that is not reported any more is forgotten."""
NOTHING_MOVES = np.zeros((0, 5))


@final
@dataclass(eq=False)
class TEB(TebParameters, LocalController):
    """Optimises poses and intervals of a short trajectory and commands its first velocity.

    The band minimises the weighted squares of what breaks a limit, of nearness to obstacles and
    of time, by Levenberg and Marquardt's method; it goes on from the band of the last tick. Bands
    that pass the obstacles at other sides compete. Where the outline of the robot cannot stand on
    the band's first poses, the bands are dropped and the answer is a refusal.

    Parameters are those of `TebParameters`, and

    Attributes
    ----------
    seed : of the graph whose paths begin new bands.
    use_dynamic_obstacles : the observation's moving obstacles are used, as the original uses its
        topic of obstacles; False for costmaps alone.

    Notes
    -----
    Lethal cells within a moving obstacle of the observation are left out: its motion is forecast,
    so that it is no obstacle where it stands now.

    The plan is Nav2's pruned one; at its end, unless that is the goal, the band faces along
    the last step. Nav2 has no port of TEB to its newest interface; there the exception that it
    throws would end the journey at once. Here it is `NO_VALID_CONTROL`, which is forgiven for a
    while as for the other controllers.

    References
    ----------
    C. Rösmann, F. Hoffmann, T. Bertram, Integrated online trajectory planning and optimization in
    distinctive topologies, Robotics and Autonomous Systems 88 (2017). teb_local_planner
    (rst-tu-dortmund, BSD-3-Clause), of which this is an own implementation.
    """

    seed: int = 0
    use_dynamic_obstacles: bool = True

    def __post_init__(self) -> None:
        TebParameters.__post_init__(self)
        whole("teb.seed", self.seed, least=0)
        self._now: TebParameters = self
        self.reset()

    def reset(self) -> None:
        """Forget the bands and the oscillation."""
        self._rng = np.random.default_rng(self.seed)
        self._oscillation = _OscillationDetector(self)
        self._neighbours = Neighbours(_FORGET)
        self._drop()

    def new_path(self, path: Array) -> None:
        """Keep the bands: whether one leads to the new goal is asked at each tick."""

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Limit the speed ahead, as the original does; the others stay."""
        share = 1.0
        fastest = max(self.max_vel_x, self.max_vel_x_backwards)
        if value > 0.0 and percentage:
            share = value / 100.0
        elif 0.0 < value < fastest:
            share = value / fastest
        settings = {one.name: getattr(self, one.name) for one in fields(TebParameters)}
        self._now = TebParameters(**{**settings, "max_vel_x": self.max_vel_x * share})

    def velocity(self, tick: Tick) -> Answer:
        """Return the velocity at the start of the best band, within the limits."""
        settings = self._now
        plan = local_plan(tick, settings)
        turn = self._oscillation.turn(tick.time, float(tick.speed[2]))
        if not len(plan):
            return self._refused("the plan is empty", INVALID_PATH)
        if settings.max_vel_x < _SLOWEST:
            return self._refused(f"max_vel_x is {settings.max_vel_x:g} m/s, too slow for a band")
        if tick.footprint.cost(tick.costmap, tick.pose) >= LETHAL:  # every band begins here
            return self._refused("the robot cannot stand where it is")
        start = float(tick.speed[0]), float(tick.speed[2])
        discs = self._moving(tick) if self.use_dynamic_obstacles else NOTHING_MOVES
        pull = Pull(obstacles_of(tick, discs, settings), start, turn)
        found = self._planned(plan, pull, tick)
        if isinstance(found, str):
            return self._refused(found)
        velocity = found.velocity(settings)
        if velocity is None:
            return self._refused("the band's first interval is not positive")
        v, w = saturated(velocity, settings)
        self._oscillation.commanded(v, w)
        others = tuple(one.band.poses for one in self._candidates.bands)
        return Answer(Twist((v, 0.0), w), expected=found.poses, sampled=others)

    def _moving(self, tick: Tick) -> Array:
        """Return the obstacles that move, (K, 5): x, y, radius (m) and vx, vy (m/s), for now.

        A velocity is the tracker's, or else the difference of the last two positions; who is
        slower than 1 mm/s is left to the costmap.
        """
        if tick.observation is None:
            return NOTHING_MOVES
        self._neighbours.take(tick.observation, tick.pose[:2])
        names, places, velocities, radii = self._neighbours.now()
        tracked = {one.ident: one.velocity for one in sound(tick.observation, 2).detections}
        for i, name in enumerate(names):
            velocity = tracked.get(name)
            velocities[i] = velocities[i] if velocity is None else velocity
        discs = np.column_stack([places, radii, velocities])
        return discs[np.hypot(velocities[:, 0], velocities[:, 1]) >= STANDING]

    def _planned(self, plan: Array, pull: Pull, tick: Tick) -> Band | str:
        """Return the band to drive, or why there is none."""
        settings, all_of_them = self._now, self._candidates
        if settings.enable_homotopy_class_planning:
            reached = tick.checker.xy_goal_tolerance
            all_of_them.update(plan, pull, settings, reached, self._rng)
        else:
            band = all_of_them.bands[0].band if all_of_them.bands else None
            if band is None or not band.fits(plan[-1], settings):
                band = Band.from_plan(plan, settings)
            else:
                band = band.moved(plan[0], plan[-1], settings)
            optimum = optimised(band, pull, settings)
            kept = [] if optimum is None else [BandCandidate(optimum.band, np.zeros(0), optimum)]
            all_of_them.bands = kept
            all_of_them.best = kept[0] if kept else None
        if all_of_them.best is None:
            return "no band could be optimised"
        while all_of_them.best is not None:
            if feasible(all_of_them.best.band, tick, settings):
                return all_of_them.best.band
            all_of_them.reject_best(settings)
        return "the robot cannot stand on the first poses of the band"

    def _drop(self) -> None:
        self._candidates = BandCandidates()

    def _refused(self, reason: str, error: str = "") -> Answer:
        """Drop the bands and refuse; the command counts as zero."""
        self._drop()
        self._oscillation.commanded(0.0, 0.0)
        return Answer.refusal(reason, error) if error else Answer.refusal(reason)


def local_plan(tick: Tick, settings: TebParameters) -> Array:
    """Return the plan (N, 3) that a band follows: from the robot's pose, as long as is looked at.

    It ends at the first pose beyond `max_global_plan_lookahead_dist` or beyond 0.85 of half the
    map. Its last heading is the mean direction of the next three steps of the plan.
    """
    plan, costmap = tick.plan, tick.costmap
    if not len(plan):
        return plan
    farthest = _SHARE * 0.5 * costmap.resolution * max(costmap.width, costmap.height)
    most, count, length, away = settings.max_global_plan_lookahead_dist, 0, 0.0, 0.0
    while count < len(plan) and away <= farthest and (most == 0.0 or length <= most):
        if count:
            length += hypot(*(plan[count] - plan[count - 1])[:2])
        away = hypot(*(plan[count] - tick.pose)[:2])
        count += 1
    cut = plan[:count].copy()
    if settings.global_plan_overwrite_orientation:
        cut[-1, 2] = _heading_at(plan, count - 1, tick.goal)
    if count == 1:
        cut = np.concatenate([cut, cut])
    cut[0] = tick.pose
    return cut


def _heading_at(plan: Array, last: int, goal: Array) -> float:
    """Return the heading at a pose of the plan: the mean direction of the steps that follow."""
    ahead = plan[last : last + _AVERAGED + 1, :2]
    at_goal = hypot(*(plan[-1] - goal)[:2]) == 0.0
    if at_goal and last > len(plan) - _AVERAGED - 2:
        return float(plan[-1, 2])
    if len(ahead) < 2:
        ahead = plan[max(last - 1, 0) :, :2]
    step = np.diff(ahead, axis=0)
    if not np.any(step):
        return float(plan[last, 2])
    angles = np.arctan2(step[:, 1], step[:, 0])
    return atan2(float(np.sin(angles).sum()), float(np.cos(angles).sum()))


def obstacles_of(tick: Tick, discs: Array, settings: TebParameters) -> TebObstacles:
    """Return lethal cells as points, column by column, and the moving discs (K, 5).

    Cells behind the robot are left out beyond `costmap_obstacles_behind_robot_dist`; so are the
    last row and the last column of the map, as in the original, and cells of the discs.
    """
    points = np.zeros((0, 2))
    if settings.include_costmap_obstacles:
        points = lethal_points(tick.costmap)
        step = points - tick.pose[:2]
        behind = step[:, 0] * cos(tick.pose[2]) + step[:, 1] * sin(tick.pose[2]) < 0.0
        far = np.hypot(step[:, 0], step[:, 1]) > settings.costmap_obstacles_behind_robot_dist
        kept = ~(behind & far)
        for x, y, radius, _, _ in discs:
            reach = radius + sqrt(2.0) * tick.costmap.resolution
            kept &= np.hypot(points[:, 0] - x, points[:, 1] - y) > reach
        points = points[kept]
    return TebObstacles(
        np.concatenate([points, discs[:, :2]]),
        np.concatenate([np.zeros(len(points)), discs[:, 2]]),
        np.concatenate([np.zeros_like(points), discs[:, 3:]]),
    )


def lethal_points(costmap: Costmap) -> Array:
    """Return the centres (M, 2) of the lethal cells, m; not of the last row and column."""
    mx, my = np.nonzero(costmap.cells[:-1, :-1].T == LETHAL)
    centres = np.column_stack([mx, my]) + 0.5
    return np.array(costmap.origin, dtype=np.float64) + centres * costmap.resolution


def saturated(velocity: tuple[float, float], settings: TebParameters) -> tuple[float, float]:
    """Return a speed and yaw rate within the limits, each cut alone or both in proportion."""
    v, w = velocity
    forward = turning = 1.0
    if v > settings.max_vel_x:
        forward = settings.max_vel_x / v
    elif v < -settings.max_vel_x_backwards and settings.max_vel_x_backwards > 0.0:
        forward = -settings.max_vel_x_backwards / v
    if abs(w) > settings.max_vel_theta:
        turning = abs(settings.max_vel_theta / w)
    if settings.use_proportional_saturation:
        forward = turning = min(forward, turning)
    return v * forward, w * turning


def feasible(band: Band, tick: Tick, settings: TebParameters) -> bool:
    """Return whether the robot's outline is free on a band's first poses, and between them.

    Two poses that are farther apart than the inscribed radius, or turned by more than
    `min_resolution_collision_check_angular`, are asked about between, too.
    """
    last = settings.feasibility_check_no_poses
    if not 0 <= last < len(band.poses):
        last = len(band.poses) - 1
    return all(
        tick.footprint.cost(tick.costmap, pose) < LETHAL
        for pose in _checked(band.poses[: last + 1], tick.footprint.inscribed, settings)
    )


def _checked(poses: Array, inside: float, settings: TebParameters) -> Iterator[Array]:
    """Give one pose after the other: a band may be far longer than the map, where one ends."""
    finest = settings.min_resolution_collision_check_angular
    for i, pose in enumerate(poses):
        yield pose
        if i + 1 == len(poses):
            return
        step = poses[i + 1] - pose
        step[2] = wrapped(float(step[2]))
        parts = max(ceil(abs(step[2]) / finest), ceil(hypot(step[0], step[1]) / inside))
        for k in range(1, parts):
            yield pose + step * (k / parts)


class _OscillationDetector:
    """Finds out that a robot turns to and fro and gets nowhere, and then keeps one sense.

    It sways where over the last commands, in units of the limits, neither the mean speed nor
    the mean yaw rate amounts to anything, and the yaw rate changes its sign more than once.
    """

    def __init__(self, settings: TebParameters) -> None:
        self._settings = settings
        count = round(settings.oscillation_filter_duration * settings.controller_frequency)
        self._seen: deque[tuple[float, float]] = deque(maxlen=count)
        self._last = 0.0, 0.0
        self._noticed: float | None = None
        self._sense = 0

    def commanded(self, v: float, w: float) -> None:
        """Take note of a command, m/s and rad/s."""
        self._last = v, w

    def turn(self, time: float, rate: float) -> int:
        """Return the sense to prefer now: 1 is left, -1 right, 0 neither.

        Parameters
        ----------
        time : s.
        rate : measured yaw rate, rad/s, which decides the sense.
        """
        settings = self._settings
        if not settings.oscillation_recovery:
            return 0
        v, w = self._last
        fastest = settings.max_vel_x if v > 0.0 else settings.max_vel_x_backwards
        self._seen.append((v / fastest if fastest > 0.0 else v, w / settings.max_vel_theta))
        recent = self._noticed is not None and (
            time - self._noticed < settings.oscillation_recovery_min_duration
        )
        if self._oscillates():
            if not recent:
                self._sense = 1 if rate > 0.0 else -1
            self._noticed = time
        elif not recent:
            self._sense = 0
        return self._sense

    def _oscillates(self) -> bool:
        if not self._seen:  # the filter is shorter than a tick
            return False
        if len(self._seen) < (self._seen.maxlen or 0) // 2:
            return False
        v, w = np.array(self._seen).T
        changes = int(np.count_nonzero(np.diff(np.sign(w))))
        settings = self._settings
        return bool(
            abs(v.mean()) < settings.oscillation_v_eps
            and abs(w.mean()) < settings.oscillation_omega_eps
            and changes > 1
        )
