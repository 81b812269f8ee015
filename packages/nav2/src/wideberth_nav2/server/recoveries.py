"""What Nav2's default behaviour tree does when a robot cannot follow its path."""

from dataclasses import dataclass
from enum import StrEnum
from math import sqrt
from typing import final

import numpy as np

from wideberth.framework.values.motion import Twist

from ..costs import LETHAL
from ..parameters import Natural, NonNegative, Positive, check_parameters, check_work
from ..poses import distance, normalized
from .server import ServerView


class Recovery(StrEnum):
    """One recovery of the round robin."""

    CLEAR = "clear costmaps"
    SPIN = "spin"
    WAIT = "wait"
    BACK_UP = "back up"


ORDER = tuple(Recovery)


class RecoveryOutcome(StrEnum):
    """How a recovery stands."""

    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"


@final
@dataclass(eq=False)
class Recoveries:
    """The round robin of recoveries: clear both costmaps, spin, wait, back up.

    `begin` starts the next one; where it fails, the one after it follows at once. The turn that
    the robin has come to is kept between failures, as in Nav2. A spin or a back-up fails where
    the robot's outline would hit something within `simulate_ahead_time`.

    Parameters
    ----------
    number_of_retries : recoveries until the navigation has failed.
    spin_dist : rad.
    wait_duration : s.
    backup_dist : m.
    backup_speed : m/s.
    max_rotational_vel, min_rotational_vel : rad/s, of a spin.
    rotational_acc_lim : rad/s^2, by which it slows at its end.
    simulate_ahead_time : s.
    time_allowance : s, after which a spin or a back-up has failed.
    cycle_frequency : Hz, of the tests ahead.

    Raises
    ------
    WideberthError : a number that must be above zero and is not.
    """

    number_of_retries: Natural = 6
    spin_dist: Positive = 1.57
    wait_duration: NonNegative = 5.0
    backup_dist: Positive = 0.30
    backup_speed: Positive = 0.15
    max_rotational_vel: Positive = 1.0
    min_rotational_vel: Positive = 0.4
    rotational_acc_lim: Positive = 3.2
    simulate_ahead_time: NonNegative = 2.0
    time_allowance: Positive = 10.0
    cycle_frequency: Positive = 10.0

    def __post_init__(self) -> None:
        check_parameters(self, "recoveries")
        steps = self.simulate_ahead_time * self.cycle_frequency
        check_work("recoveries", "simulate_ahead_time and cycle_frequency", steps, 10_000)
        self._turn = 0
        self.reset()

    def reset(self) -> None:
        """Begin a new navigation: no recovery has been tried; the robin starts at its first."""
        self._turn = self._tried = 0
        self._left = 0
        self._now: Recovery | None = None

    @property
    def now(self) -> Recovery | None:
        """The recovery that runs; None where none does."""
        return self._now

    @property
    def tried(self) -> int:
        """Recoveries of this navigation so far."""
        return self._tried

    def begin(self, seen: ServerView) -> Recovery | None:
        """Start the next recovery; None where all retries are used up."""
        if self._tried >= self.number_of_retries:
            return None
        self._tried += 1
        self._left = len(ORDER)
        return self._start(seen)

    def _start(self, seen: ServerView) -> Recovery:
        self._now = ORDER[self._turn % len(ORDER)]
        self._turn += 1
        self._left -= 1
        self._began, self._from = seen.time, seen.pose
        self._turned, self._last_yaw = 0.0, float(seen.pose[2])
        return self._now

    def velocity(self, seen: ServerView) -> tuple[Twist, RecoveryOutcome]:
        """Return the velocity for now, and how the recovery stands."""
        still = Twist((0.0, 0.0))
        if self._now is Recovery.SPIN:
            twist, outcome = self._spin(seen)
        elif self._now is Recovery.BACK_UP:
            twist, outcome = self._back_up(seen)
        elif self._now is Recovery.WAIT and seen.time - self._began < self.wait_duration:
            twist, outcome = still, RecoveryOutcome.RUNNING
        else:
            twist, outcome = still, RecoveryOutcome.SUCCEEDED
        if outcome is RecoveryOutcome.FAILED and self._left:
            self._start(seen)
            outcome = RecoveryOutcome.RUNNING
        if outcome is not RecoveryOutcome.RUNNING:
            self._now = None
        return twist, outcome

    def _spin(self, seen: ServerView) -> tuple[Twist, RecoveryOutcome]:
        """Turn on the spot by `spin_dist`."""
        yaw = float(seen.pose[2])
        self._turned += normalized(yaw - self._last_yaw)
        self._last_yaw = yaw
        rest = self.spin_dist - abs(self._turned)
        if rest < 1e-6:
            return Twist((0.0, 0.0)), RecoveryOutcome.SUCCEEDED
        slowing = sqrt(2.0 * self.rotational_acc_lim * rest)
        rate = min(max(slowing, self.min_rotational_vel), self.max_rotational_vel)
        return self._tested(seen, Twist((0.0, 0.0), rate), rest)

    def _back_up(self, seen: ServerView) -> tuple[Twist, RecoveryOutcome]:
        """Drive back by `backup_dist`."""
        rest = self.backup_dist - distance(seen.pose, self._from)
        if rest <= 0.0:
            return Twist((0.0, 0.0)), RecoveryOutcome.SUCCEEDED
        return self._tested(seen, Twist((-self.backup_speed, 0.0)), rest)

    def _tested(
        self, seen: ServerView, twist: Twist, rest: float
    ) -> tuple[Twist, RecoveryOutcome]:
        """Return a velocity unless it takes too long or hits something on what is left."""
        late = seen.time - self._began > self.time_allowance
        if late or self._hits(seen, float(twist.linear[0]), float(twist.angular), rest):
            return Twist((0.0, 0.0)), RecoveryOutcome.FAILED
        return twist, RecoveryOutcome.RUNNING

    def _hits(self, seen: ServerView, speed: float, turning: float, rest: float) -> bool:
        """Return whether the outline meets an obstacle or an unknown cell ahead."""
        x, y, yaw = (float(value) for value in seen.pose)
        for count in range(int(self.simulate_ahead_time * self.cycle_frequency)):
            time = count / self.cycle_frequency
            if abs(speed + turning) * time > rest:
                break
            travelled = speed * time
            pose = np.array(
                [x + travelled * np.cos(yaw), y + travelled * np.sin(yaw), yaw + turning * time]
            )
            if seen.footprint.cost(seen.costmap, pose) >= LETHAL:
                return True
        return False
