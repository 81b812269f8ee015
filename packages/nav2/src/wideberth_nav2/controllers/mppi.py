"""MPPI of Nav2: controls with sampled noise, rolled out and averaged by their costs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, final

import numpy as np
from annotated_types import Ge

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Twist

from ..costs import INSCRIBED, LETHAL
from ..parameters import (
    NAMES,
    Count,
    Limited,
    Named,
    Natural,
    NonNegative,
    Positive,
    at_default,
    check_parameters,
    check_work,
    made,
    made_critics,
)
from .dwb_trajectories import cells_of
from .expected_people import ExpectedPeopleCritic
from .local_controller import Answer, CompositeController, Tick
from .mppi_critics import NAV2, USUAL, MppiCritic
from .mppi_rollouts import ControlLimits, MppiTick, Rollouts, Single, delayed, driven, followed

CRITICS: dict[str, type[MppiCritic]] = {**NAV2, "ExpectedPeopleCritic": ExpectedPeopleCritic}
"""Name in a parameter file -> class: Nav2's, and one of ours."""
_SIDEWAYS = "mppi::OmniMotionModel"
"""A motion model of Nav2 that is not offered here."""
SMOOTHED = 20
"""Fewer controls than this and one are not smoothed."""
_MOST = 1e8
"""Steps of trajectories that a tick may roll out; Nav2's own robot has 4.5e5 at most."""
SHOWN = 50
"""Sampled trajectories that an answer holds, for a picture."""
_FILTERS = {
    1: np.full(9, 1.0 / 9.0),
    2: np.array([-21.0, 14.0, 39.0, 54.0, 59.0, 54.0, 39.0, 14.0, -21.0]) / 231.0,
}
"""Savitzky-Golay weights over nine points, by order."""


@final
@dataclass(eq=False)
class Memory:
    """What MPPI keeps from tick to tick; vx (m/s) comes before omega (rad/s) on the first axis.

    Attributes
    ----------
    controls : (2, T), float32, the sequence that noise is added to.
    history : (2, 4), the last commands after the filter and before the limits, oldest first.
    last : (2,), the last command.
    noise : (2, T, B), float32.
    sent : for each of both the last commands, as many as are under way, oldest first.
    """

    controls: Single
    history: Array
    last: Array
    noise: Single
    sent: tuple[Single, Single]


@final
@dataclass(eq=False)
class MPPI(CompositeController):
    """Model predictive path integral control: the mean of noisy controls, weighted by their costs.

    Noise is added to the controls U of the last tick, c = U + noise; what the robot follows of
    them is rolled out, critics add up a cost S for each of the B trajectories, and

        U <- sum_b w_b c_b,    w_b ~ exp(-S_b / temperature)

    where S also holds gamma / sigma^2 sum_t (c - U) U. U is smoothed, brought within the limits,
    and its second element is the command. Where every trajectory collides, or the trajectory of U
    does, all is forgotten and tried again, ``retry_attempt_limit`` times. Costs, controls and
    commands equal those of the original, with its peculiarities: U starts with the last command,
    within what the measured speed allows, and what critics found out in a failed try holds
    for the next one.

    Parameters have the names, units and defaults of Nav2.

    Attributes
    ----------
    critics : in the order in which they are asked.
    batch_size, time_steps, model_dt : B, T and the step, s.
    iteration_count : how often U is improved in a tick.
    vx_std, wz_std : sigma, m/s and rad/s.
    vx_max, vx_min, wz_max : m/s and rad/s.
    ax_max, ax_min, az_max : m/s^2 and rad/s^2; ax_min is below zero.
    open_loop : trust the last command instead of the measured speed.
    sgf_order : of the filter, 1 or 2.
    clamp_raw_controls : average what the robot follows instead of c.
    model_delay_vx, model_delay_wz : s, from a command to the motion.
    regenerate_noises : draw new noise for each iteration.
    motion_model : ``diff_drive``, or ``ackermann`` with ``min_turning_r``, m.
    collision_lookahead_time : s, for which the trajectory of U must not collide.
    controller_frequency : 1/s; with a period below ``model_dt`` U is not shifted from tick to
        tick, and its first element is sent.
    seed : of the noise.

    Raises
    ------
    WideberthError : a number out of range, a period longer than ``model_dt``, a delay as long as
        the horizon, an order of the filter or a motion model that is not known, no critics.

    References
    ----------
    Nav2, nav2_mppi_controller (ros-navigation/navigation2, MIT), of which this is an own
    implementation; G. Williams, P. Drews, B. Goldfain, J. M. Rehg and E. A. Theodorou, Aggressive
    driving with model predictive path integral control, ICRA 2016, for the method.
    """

    critics: tuple[MppiCritic, ...] = USUAL
    batch_size: Count = 1000
    time_steps: Annotated[int, Ge(2)] = 56
    model_dt: Positive = 0.05
    iteration_count: Count = 1
    temperature: Positive = 0.3
    gamma: NonNegative = 0.015
    vx_std: Positive = 0.2
    wz_std: NonNegative = 0.4
    vx_max: Annotated[float, Limited("speed")] = 0.5
    vx_min: Annotated[float, Limited("backwards", 0)] = -0.35
    wz_max: Annotated[float, Limited("yaw_rate")] = 1.9
    ax_max: Annotated[float, Limited("acceleration")] = 3.0
    ax_min: Annotated[float, Limited("acceleration", -1)] = -3.0
    az_max: Annotated[float, Limited("yaw_acceleration")] = 3.5
    retry_attempt_limit: Natural = 1
    open_loop: bool = False
    sgf_order: Literal[1, 2] = 2
    clamp_raw_controls: bool = False
    model_delay_vx: NonNegative = 0.0
    model_delay_wz: NonNegative = 0.0
    regenerate_noises: bool = False
    motion_model: Literal["diff_drive", "ackermann"] = "diff_drive"
    min_turning_r: Annotated[Positive, Named("AckermannConstraints.min_turning_r")] = 0.2
    collision_lookahead_time: Annotated[
        NonNegative, Named("TrajectoryValidator.collision_lookahead_time")
    ] = 2.0
    controller_frequency: Positive = 20.0
    seed: Natural = 0

    memory: Memory = field(init=False, repr=False)
    rollouts: Rollouts | None = field(default=None, init=False, repr=False)
    """Of the last tick."""
    costs: Single = field(init=False, repr=False)
    """(B,), of the last tick."""
    _share: float = field(default=1.0, init=False, repr=False)
    _rng: np.random.Generator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        check_parameters(self, "mppi", ("critics",))
        tries = self.iteration_count * (self.retry_attempt_limit + 1)
        names = "batch_size, time_steps, iteration_count and retry_attempt_limit"
        check_work("mppi", names, self.batch_size * self.time_steps * tries, _MOST)
        for name in ("model_delay_vx", "model_delay_wz"):
            self._check_delay(name, getattr(self, name))
        period = 1.0 / self.controller_frequency
        if period > self.model_dt + 1e-9:
            raise WideberthError(
                f"mppi.model_dt is {self.model_dt:g} s, less than the controller's period of "
                f"{period:g} s; wanted at least as much"
            )
        if not self.critics:
            raise WideberthError("mppi.critics is empty; wanted at least one critic")
        self._rng = np.random.default_rng(self.seed)
        self.reset()

    def _check_delay(self, name: str, delay: float) -> None:
        """Refuse a delay that leaves no sampled control any effect within the horizon."""
        horizon = self.time_steps * self.model_dt
        if delay >= horizon - 0.5 * self.model_dt:
            raise WideberthError(
                f"mppi.{name} is {delay:g} s, as long as the horizon of {horizon:g} s, so that no "
                "control would have any effect within it; raise time_steps"
            )

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "MPPI":
        """Build it from parameters as they stand in Nav2's files.

        Parameters
        ----------
        parameters : name -> value; those of a critic as ``Critic.name``, and ``critics``, a list
            of names. The motion model may be named as in any version of Nav2: freely, with
            ``NAME.plugin`` saying what it is, or by what it is. Parameters of other models, of
            motion sideways and of drawing are passed over.

        Raises
        ------
        WideberthError : an unknown name, or a part of the original that is not offered here.

        Examples
        --------
        >>> wanted = {"critics": ["GoalCritic"], "GoalCritic.cost_weight": 7.0}
        >>> MPPI.from_parameters(wanted).critics[0].cost_weight
        7.0
        """
        rest = _without_others(at_default("mppi", parameters))
        names = tuple(rest.pop("critics", [type(critic).__name__ for critic in cls.critics]))
        critics, rest = made_critics(CRITICS, names, rest)
        model = rest.get("motion_model", "diff_drive")
        plugin = rest.pop(f"{model}.plugin", model)
        rest["motion_model"] = NAMES["motion_models"].get(plugin, plugin)
        if f"{model}.min_turning_r" in rest:
            rest["min_turning_r"] = rest.pop(f"{model}.min_turning_r")
        return made(cls, "mppi", rest, critics=critics)

    def reset(self) -> None:
        """Forget what earlier ticks left, and draw new noise."""
        self.rollouts, self.costs = None, np.zeros(self.batch_size, np.float32)
        self._forget()

    def _forget(self) -> None:
        """Start with no controls and new noise."""
        delays = (self.model_delay_vx, self.model_delay_wz)
        off = [int(np.floor(delay / self.model_dt + 0.5)) for delay in delays]
        self.memory = Memory(
            controls=np.zeros((2, self.time_steps), np.float32),
            history=np.zeros((2, 4)),
            last=np.zeros(2),
            noise=self._drawn(),
            sent=(np.zeros(off[0], np.float32), np.zeros(off[1], np.float32)),
        )

    def _drawn(self) -> Single:
        """Draw noise, (2, T, B)."""
        shape = (2, self.time_steps, self.batch_size)
        noise = self._rng.standard_normal(shape, dtype=np.float32)
        noise *= np.array([self.vx_std, self.wz_std], np.float32)[:, None, None]
        return noise

    def new_path(self, path: Array) -> None:
        """Go on; the path is part of each tick."""

    def limit_speed(self, value: float, percentage: bool) -> None:
        """Scale the limits of the velocities; 0 lifts the limit.

        Parameters
        ----------
        value : share of ``vx_max`` in percent, or m/s.
        percentage : which of the two.
        """
        if value == 0.0:
            self._share = 1.0
        else:
            self._share = value / (100.0 if percentage else self.vx_max)

    @property
    def limits(self) -> ControlLimits:
        """Limits of now, with that of the speed."""
        return self.limits_at(self._share)

    def limits_at(self, share: float) -> ControlLimits:
        """Return the limits with velocities scaled by so much."""
        speeds = self.vx_max * share, self.vx_min * share, self.wz_max * share
        radius = self.min_turning_r if self.motion_model == "ackermann" else 0.0
        return ControlLimits(*speeds, self.ax_max, self.ax_min, self.az_max, radius)

    @property
    def shifting(self) -> bool:
        """Whether a period is as long as a step, so that U moves on by one in each tick."""
        return abs(1.0 / self.controller_frequency - self.model_dt) < 1e-6

    def velocity(self, tick: Tick) -> Answer:
        """Improve U and return the command of now, or the exception NoValidControl."""
        situation = MppiTick(tick, self.limits_at(1.0), self.model_dt)
        speed = self.speed(tick)
        for _ in range(self.retry_attempt_limit + 1):
            self.costs = np.zeros(self.batch_size, np.float32)
            for _ in range(self.iteration_count):
                self.improve(situation, speed)
            ahead = self.ahead(tick)
            if not situation.all_collide and self.free(ahead, tick):
                return self._sent(ahead)
            self._forget()
        tries = self.retry_attempt_limit + 1
        what = "every trajectory" if situation.all_collide else "the mean of the trajectories"
        return Answer.refusal(f"{what} collides, in {tries} {'try' if tries == 1 else 'tries'}")

    def speed(self, tick: Tick) -> Array:
        """Return vx and omega of now, (2,): the last command, within reach of the measurement."""
        last = self.memory.last
        if self.open_loop:
            return last
        loss, gain = np.array(self.limits.steps(self.model_dt)).T
        measured = np.array([tick.speed[0], tick.speed[2]])
        return np.clip(last, measured + loss, measured + gain)

    def sampled(self, situation: MppiTick, speed: Array) -> tuple[Single, Rollouts]:
        """Add the noise to U and roll it out.

        Returns
        -------
        controls : (2, T, B), c.
        rollouts : of what the robot follows of c.
        """
        memory, steps = self.memory, self.limits.steps(self.model_dt)
        if self.shifting:
            memory.controls[:, 0] = speed
        noisy = memory.controls[..., None] + memory.noise
        velocities = []
        for axis in range(2):
            now = float(np.float32(speed[axis]))
            found, noisy[axis] = followed(noisy[axis], now, steps[axis], self.clamp_raw_controls)
            velocities.append(delayed(found, memory.sent[axis]))
        return noisy, driven(velocities[0], velocities[1], situation.tick.pose, self.model_dt)

    def improve(self, situation: MppiTick, speed: Array) -> None:
        """Replace U by the weighted mean of sampled controls.

        Parameters
        ----------
        situation : what critics see.
        speed : (2,), vx and omega of now.
        """
        noisy, self.rollouts = self.sampled(situation, speed)
        for critic in self.critics:
            if situation.all_collide:
                break
            cost = critic.cost(self.rollouts, situation)
            if cost is not None:
                self.costs += cost
        self.average(noisy, speed)
        if self.regenerate_noises:
            self.memory.noise = self._drawn()

    def average(self, noisy: Single, speed: Array) -> None:
        """Replace U by the mean of controls (2, T, B), weighted by their costs."""
        controls = self.memory.controls
        for axis, deviation in enumerate((self.vx_std, self.wz_std)):
            if deviation == 0.0:  # nothing is drawn along this axis, as in Nav2
                continue
            gain = np.float32(self.gamma / deviation**2)
            change = noisy[axis] - controls[axis][:, None]
            self.costs += gain * (change * controls[axis][:, None]).sum(axis=0)
        weights = np.exp((self.costs.min() - self.costs) / np.float32(self.temperature))
        weights /= weights.sum()
        self.memory.controls = (noisy * weights).sum(axis=2)
        self._smooth()
        self._limit(speed)

    def _smooth(self) -> None:
        """Filter U, with the last commands before it and its last element after it."""
        memory, last = self.memory, self.time_steps - 1
        if last < SMOOTHED:
            return
        behind = np.repeat(memory.controls[:, -1:], 4, axis=1)
        padded = np.concatenate([memory.history, memory.controls, behind], axis=1)
        for axis in range(2):
            smooth = np.convolve(padded[axis], _FILTERS[self.sgf_order], mode="valid")
            memory.controls[axis, :last] = smooth[:last]
        now = memory.controls[:, int(self.shifting), None]
        memory.history = np.concatenate([memory.history[:, 1:], now.astype(np.float64)], axis=1)

    def _limit(self, speed: Array) -> None:
        """Bring U within the limits of velocity and acceleration."""
        limits, controls = self.limits, self.memory.controls
        bounds = ((limits.vx_min, limits.vx_max), (-limits.wz_max, limits.wz_max))
        self._turn_widely()
        if self.shifting:
            controls[:, 0] = speed
        for axis, (loss, gain) in enumerate(limits.steps(self.model_dt)):
            low, high = bounds[axis]
            before, found = float(speed[axis]), []
            for value in controls[axis].tolist():
                value = min(max(value, low), high)
                down, up = (loss, gain) if before >= 0.0 else (-gain, -loss)
                before = min(max(value, before + down), before + up)
                found.append(before)
            controls[axis] = found
        self._turn_widely()

    def _turn_widely(self) -> None:
        """Bring omega within what the smallest turning radius allows."""
        radius, controls = self.limits.turning_radius, self.memory.controls
        if radius:
            most = np.abs(controls[0]) / np.float32(radius)
            controls[1] = np.clip(controls[1], -most, most)

    def ahead(self, tick: Tick) -> Array:
        """Return the poses that U leads to, (T, 3)."""
        vx, wz = (axis[:, None].copy() for axis in self.memory.controls)
        found = driven(vx, wz, tick.pose, self.model_dt).poses()
        return np.asarray(found[0])

    def free(self, poses: Array, tick: Tick) -> bool:
        """Return whether the robot's centre keeps clear of obstacles for a while.

        Off the map it does.

        Parameters
        ----------
        poses : (T, 3), of a trajectory.
        """
        count = int(self.collision_lookahead_time / self.model_dt + 1e-6)
        cells = cells_of(tick.costmap, poses[:count, :2])
        costs = tick.costmap.cells.ravel()[cells[cells >= 0]]
        return not ((costs == INSCRIBED) | (costs == LETHAL)).any()

    def _sent(self, ahead: Array) -> Answer:
        """Return the command of U, and move U on."""
        memory = self.memory
        command = memory.controls[:, int(self.shifting)].copy()
        memory.last = command.astype(np.float64)
        if self.shifting:
            memory.controls[:, :-1] = memory.controls[:, 1:]
        memory.sent = (later(memory.sent[0], command[0]), later(memory.sent[1], command[1]))
        assert self.rollouts is not None  # `improve` came first
        every = max(1, self.batch_size // SHOWN)
        sampled = tuple(self.rollouts.poses(every))
        twist = Twist((float(command[0]), 0.0), float(command[1]))
        return Answer(twist, expected=ahead, sampled=sampled)


def _without_others(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters without those of motion models that are not chosen, or of no effect."""
    chosen = parameters.get("motion_model")
    plugins = [*NAMES["motion_plugins"].values(), _SIDEWAYS]
    models = [name.rpartition(".")[0] for name, value in parameters.items() if value in plugins]
    others = (f"{model}." for model in models if model != chosen)
    passed = (*NAMES["mppi_without_effect"], *others)
    return {name: value for name, value in parameters.items() if not name.startswith(passed)}


def later(sent: Single, command: np.float32) -> Single:
    """Append a command to those under way, and drop the oldest."""
    return np.append(sent, command)[1:] if len(sent) else sent
