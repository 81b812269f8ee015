"""DWB of Nav2: sampled twists, rolled out and judged by critics."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import hypot
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Twist

from ..parameters import at_default, check_parameters, check_work, made, made_critics
from .dwb_critics import CRITICS, DwbCritic, usual_critics
from .dwb_trajectories import DwbParameters, Sampling, Trajectories
from .local_controller import Answer, CompositeController, Tick

PATH_LENGTH_TOLERANCE = "FollowPathpath_length_tolerance"
"""Nav2's name of RotateToGoal's tolerance, which lacks a dot; the controller's name begins it."""
_SHARED = {
    "xy_goal_tolerance": "xy_goal_tolerance", "trans_stopped_velocity": "trans_stopped_velocity",
    PATH_LENGTH_TOLERANCE: "path_length_tolerance",
}  # fmt: skip
"""Parameters of the controller -> those of the critic RotateToGoal."""
_MOST = 2e7
"""Poses that a tick may roll out; Nav2's own robot had 2e5."""


@final
@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of K trajectories by the critics.

    Attributes
    ----------
    trajectories : those judged.
    names : (C,), of the critics, in their order.
    weights : (C,), float32, what scores are multiplied by.
    raw : (C, K), scores; NaN where a critic did not allow the trajectory or was not evaluated.
    evaluated : (K,), number of critics that scored a trajectory; the last of them may have
        forbidden it.
    totals : (K,), float32; -1 for a trajectory that is not allowed.
    best : index of the first trajectory of the lowest total; None where none is allowed.
    """

    trajectories: Trajectories
    names: tuple[str, ...]
    weights: NDArray[np.float32]
    raw: Array
    evaluated: NDArray[np.int64]
    totals: NDArray[np.float32]
    best: int | None


@final
@dataclass(eq=False)
class DWB(DwbParameters, CompositeController):
    """DWB: the twist whose trajectory has the lowest total of weighted scores.

    Twists on a grid within reach of the present speed are rolled out for ``sim_time``; each
    critic gives every trajectory a score or forbids it, see
    `wideberth_nav2.controllers.dwb_critics`. Twists, scores and choice equal those of the
    original, with its peculiarities: a standstill is no sample, and totals are float32.

    Parameters have the names, units and defaults of Nav2; the limits of speed and acceleration
    have to be set. They are those of `DwbParameters`, and

    Attributes
    ----------
    critics : in the order in which they are asked.
    short_circuit_trajectory_evaluation : ask no more critics about what is worse than the best.
    evaluation : of the last tick; None before.

    Raises
    ------
    WideberthError : a number of samples, a time or a granularity out of range, more poses in a
        tick than are of any use, no critics, an unknown generator.

    References
    ----------
    Nav2, nav2_dwb_controller (ros-navigation/navigation2, BSD-3-Clause), of which this is an own
    implementation; D. Fox, W. Burgard and S. Thrun, The dynamic window approach to collision
    avoidance, IEEE Robotics and Automation Magazine 4 (1997), for the method.
    """

    critics: tuple[DwbCritic, ...] = field(default_factory=usual_critics)
    short_circuit_trajectory_evaluation: bool = True

    evaluation: Evaluation | None = field(default=None, init=False, repr=False)
    _share: float = field(default=1.0, init=False, repr=False)

    def __post_init__(self) -> None:
        check_parameters(self, "dwb", ("critics",))
        names = "the numbers of samples, sim_time and the granularities"
        check_work("dwb", names, self._points(), _MOST)
        if not self.critics:
            raise WideberthError("dwb.critics is empty; wanted at least one critic")

    def _points(self) -> float:
        """Return how many poses a tick rolls out at most."""
        samples = 1.0
        for count in (self.vx_samples, self.vy_samples, self.vtheta_samples):
            samples *= max(count, 2) + 1
        if self.discretize_by_time:
            return samples * self.sim_time / self.time_granularity
        fastest = max(abs(self.min_vel_x), abs(self.max_vel_x))
        fastest = hypot(fastest, max(abs(self.min_vel_y), abs(self.max_vel_y)))
        steps = fastest / self.linear_granularity, self.max_vel_theta / self.angular_granularity
        return samples * max(1.0, self.sim_time * max(map(abs, steps)))

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "DWB":
        """Build it from parameters as they stand in Nav2's files.

        Parameters
        ----------
        parameters : name -> value; those of a critic as ``Critic.name``, and ``critics``, a list
            of names. `RotateToGoal` has ``xy_goal_tolerance`` and ``trans_stopped_velocity``
            from the controller's parameters, without a dot; its ``path_length_tolerance`` has in
            Nav2 the name `PATH_LENGTH_TOLERANCE` alone, for a controller ``FollowPath``: any
            other one is passed over, as there.

        Raises
        ------
        WideberthError : an unknown name.

        Examples
        --------
        >>> DWB.from_parameters({"critics": ["PathDist"], "PathDist.scale": 32.0}).critics
        (PathDist(scale=32.0, aggregation_type='last'),)
        """
        rest = at_default("dwb", parameters)
        names = tuple(rest.pop("critics", [type(critic).__name__ for critic in usual_critics()]))
        for name in ("path_length_tolerance", "RotateToGoal.path_length_tolerance"):
            rest.pop(name, None)
        for name, ours in _SHARED.items():
            if name in rest:
                rest[f"RotateToGoal.{ours}"] = rest.pop(name)
        critics, rest = made_critics(CRITICS, names, rest)
        return made(cls, "dwb", rest, critics=critics)

    def reset(self) -> None:
        """Forget what was chosen before."""
        self.evaluation = None
        for critic in self.critics:
            critic.reset()

    def new_path(self, path: Array) -> None:
        """Let the critics forget what was chosen before."""
        self.reset()

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Scale the largest velocities down; 0 sets no limit.

        Parameters
        ----------
        value : share of ``max_speed_xy`` in percent, or m/s.
        percentage : which of the two.
        """
        if value == 0.0:
            self._share = 1.0
        elif percentage:
            self._share = value / 100.0
        elif value < self.max_speed_xy:
            self._share = value / self.max_speed_xy

    def velocity(self, tick: Tick) -> Answer:
        """Return the best twist, or the exception NoValidControl."""
        found = self.evaluation = self.judged(tick)
        twists = found.trajectories.twists
        chosen = np.zeros(3) if found.best is None else twists[found.best]
        for critic in self.critics:
            critic.debrief(chosen)
        if found.best is None:
            reason = f"no trajectory of {len(twists)} is allowed{self._forbidden(found)}"
            none = (
                "no velocity can be reached: max_vel_x, max_vel_theta, acc_lim_x, acc_lim_theta?"
            )
            return Answer.refusal(reason if len(twists) else none)
        twist = Twist((float(chosen[0]), float(chosen[1])), float(chosen[2]))
        allowed = np.flatnonzero(found.totals >= 0.0)
        poses, counts = found.trajectories.poses, found.trajectories.counts
        sampled = tuple(poses[k, : counts[k]] for k in allowed)
        return Answer(twist, expected=poses[found.best, : counts[found.best]], sampled=sampled)

    def judged(self, tick: Tick) -> Evaluation:
        """Roll the samples of a tick out and let the critics judge them."""
        for critic in self.critics:
            critic.prepare(tick)
        sampling = self.sampling
        twists = sampling.twists(tick.speed)
        trajectories = sampling.trajectories(tick.pose, tick.speed, twists, tick.costmap)
        weights = [critic.weight(tick.costmap.resolution) for critic in self.critics]
        raw = np.full((len(self.critics), len(twists)), np.nan)
        allowed = np.ones(len(twists), dtype=np.bool_)
        for row, critic, weight in zip(raw, self.critics, weights, strict=True):
            some = weight != 0.0
            row[allowed] = critic.scores(trajectories.only(allowed)) if some else 0.0
            allowed &= ~np.isnan(row)
        names = tuple(type(critic).__name__ for critic in self.critics)
        scales = np.array(weights, np.float32)
        return Evaluation(trajectories, names, scales, raw, *self._totals(raw, scales))

    @property
    def sampling(self) -> Sampling:
        """How twists are sampled now, within the limit of speed."""
        return Sampling(self, self._share)

    def _totals(
        self, raw: Array, weights: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32], int | None]:
        """Add the scores up as the original does, in float32 after each critic, and choose."""
        sums, count = np.zeros(raw.shape, np.float32), raw.shape[1]
        before = np.zeros(count, np.float32)
        for row, scores, weight in zip(sums, raw, weights, strict=True):
            before = row[:] = (before + scores * np.float64(weight)).astype(np.float32)
        totals, evaluated = np.full(count, -1.0, np.float32), np.zeros(count, np.int64)
        best, least = None, np.inf
        columns: Any = sums.T.tolist()
        for k, column in enumerate(columns):
            total = 0.0
            for c, total in enumerate(column):
                evaluated[k] = c + 1
                if total != total:  # forbidden
                    break
                worse = best is not None and 0.0 < least < total
                if self.short_circuit_trajectory_evaluation and weights[c] and worse:
                    break
            totals[k] = -1.0 if total != total else total
            if total < least:
                best, least = k, total
        return evaluated, totals, best

    def _forbidden(self, found: Evaluation) -> str:
        """Say how many each critic forbade."""
        counts = np.bincount(found.evaluated, minlength=len(found.names) + 1)[1:]
        named = [f"{name} forbids {count}" for name, count in zip(found.names, counts, strict=True)
                 if count]  # fmt: skip
        return f": {', '.join(named)}" if named else ""
