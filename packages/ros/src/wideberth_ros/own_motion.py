"""Where a robot is and was, by its odometry and tf, on the clock of its stamps."""

from collections import deque
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from wideberth.framework.numerics.geometry import wrapped
from wideberth.framework.values.arrays import FARTHEST, Array
from wideberth.framework.values.errors import WideberthError

from .decoding import DecodedMessage, OdometryMessage, Transforms
from .frames import FrameTree, composed

OLDEST = 1.0
"""s; a message whose stamp is farther from that of the newest odometry is not used."""
KEPT = 500
"""Poses that are kept: 5 s of odometry at 100 Hz."""
AHEAD = 0.2
"""s, for which the robot is taken to go on as it did in the newest odometry."""
STANDING = np.array([0.05, 0.05, 0.1])
"""m/s and rad/s: a robot whose velocities are smaller stands."""
HOLE = 0.5
"""s; between two messages of odometry that lie farther apart no pose is interpolated."""


@final
@dataclass(frozen=True, eq=False)
class ReceivedMessage:
    """A message of a topic, and when it came, s on the node's clock."""

    decoded: DecodedMessage
    time: float


@final
class OwnMotion:
    """Poses of a robot in the frame of its odometry, and of its sensors on it.

    Its clock is that of the odometry's stamps, in s since the first one; of odometry without
    stamps it is the node's clock. Where the clock jumps, the poses of before are forgotten.
    Odometry with the stamp of the one before is no news: it counts as when that one came.

    Parameters
    ----------
    base_frame : of the robot.
    """

    def __init__(self, base_frame: str) -> None:
        self.newest: ReceivedMessage | None = None
        self.unplaced: str = ""
        """Why the last odometry does not say where the base is; "" where it does."""
        self._base = base_frame
        self._frames = FrameTree()
        self._epoch: int | None = None
        self._rows: deque[Array] = deque(maxlen=KEPT)
        """(time, x, y, heading, forward, lateral, yaw rate) each."""

    def take_frames(self, content: Transforms) -> None:
        """Take motions between frames; the newest of each counts at all times."""
        for parent, child, _, pose, tilt in content.rows:
            self._frames.add(parent, child, 0.0, pose, True, tilt)

    def take(self, decoded: DecodedMessage, came: float) -> None:
        """Take odometry that came at a time, s on the node's clock.

        Of numbers beyond `FARTHEST` no pose is taken.

        Raises
        ------
        WideberthError : numbers that are not finite, or of a frame that tf does not connect with
            the robot's.
        """
        motion = decoded.content
        assert isinstance(motion, OdometryMessage)
        numbers = np.concatenate([motion.pose, motion.twist])
        if not np.isfinite(numbers).all():
            raise WideberthError("odometry is not finite")
        motion = self._of_base(motion)
        numbers = np.concatenate([motion.pose, motion.twist])
        decoded = replace(decoded, content=motion)
        if (
            decoded.stamp
            and self.newest is not None
            and self.newest.decoded.stamp == decoded.stamp
        ):
            came = self.newest.time
        self.newest = ReceivedMessage(decoded, came)
        if self._epoch is None:
            self._epoch = decoded.stamp
        if np.abs(numbers).max() > FARTHEST:
            return
        row = np.array([self.now, *numbers])
        if self._rows and not 0.0 <= row[0] - self._rows[-1][0] <= OLDEST:
            self._rows.clear()
        if self._rows and row[0] == self._rows[-1][0]:
            self._rows.pop()
        self._rows.append(row)

    def _of_base(self, motion: OdometryMessage) -> OdometryMessage:
        """Return the motion of the robot's base; `unplaced` says why there is none."""
        base = self.motion(motion.child, self._base) if motion.child else np.zeros(3)
        self.unplaced = ""
        if base is None:
            words = f"no motion connects the odometry's child frame {motion.child!r} with"
            self.unplaced = self.flaw(motion.child) or f"{words} {self._base!r}"
            raise WideberthError(self.unplaced)
        return _carried(motion, base) if base.any() else motion

    @property
    def stands(self) -> bool:
        """Whether the robot stands, by the newest odometry."""
        if self.newest is None:
            return False
        motion = self.newest.decoded.content
        return isinstance(motion, OdometryMessage) and bool(
            (np.abs(motion.twist) < STANDING).all()
        )

    @property
    def now(self) -> float:
        """Instant of the newest odometry, s; NaN before the first."""
        if self.newest is None or self._epoch is None:
            return float("nan")
        stamp = self.newest.decoded.stamp
        return (stamp - self._epoch) / 1e9 if stamp else self.newest.time

    def instant(
        self, received: ReceivedMessage, own_clock: bool = False, length: float = 0.0
    ) -> float:
        """Return the instant to which the content of a message belongs, s.

        By its stamp. Where it or the odometry has none, by when both came.

        Parameters
        ----------
        received : the message.
        own_clock : whether its stamp is of a clock of its sender's own, and says nothing here.
        length : s, from its stamp until it could be sent.
        """
        stamp = 0 if own_clock else received.decoded.stamp
        return self.instant_of(stamp, received.time - length)

    def instant_of(self, stamp: int, time: float) -> float:
        """Return the same of a stamp, ns, and of a time on the node's clock, s."""
        if self.newest is None:
            return float("nan")
        own = self.newest.decoded.stamp
        apart = 1e-9 * (stamp - own) if own and stamp else time - self.newest.time
        return self.now + apart

    def untimely(self, instant: float) -> str:
        """Say why what was measured at an instant, s, is of no use now; "" where it is of use."""
        age = self.now - instant
        if abs(age) <= OLDEST or np.isnan(age):
            return ""
        side = "older" if age > 0.0 else "newer"
        return (
            f"a message is {abs(age):.3g} s {side} than the odometry by their stamps; wanted at "
            f"most {OLDEST:g} s: synchronise the clocks, or set own_clock if the sender's differs"
        )

    def poses(self, times: Array) -> Array:
        """Return the robot's poses at some instants, (B,) s -> (B, 3), m and rad.

        Between two messages of odometry they are interpolated, up to `AHEAD` s after the last one
        the robot goes on as it did::

            x(t) = x + (Rot(psi + w t / 2) v) t     psi(t) = psi + w t

        NaN where nothing is known.
        """
        if not self._rows:
            return np.full((len(times), 3), np.nan)
        table = np.array(self._rows)
        table[:, 3] = np.unwrap(table[:, 3])
        clock = table[:, 0]
        found = np.stack([np.interp(times, clock, column) for column in table.T[1:4]], axis=-1)
        later = np.asarray(times) - clock[-1]
        twist = table[-1, 4:]
        half = np.stack([0.0 * later, 0.0 * later, 0.5 * twist[2] * later], axis=-1)
        step = np.stack([twist[0] * later, twist[1] * later, 0.5 * twist[2] * later], axis=-1)
        ahead = composed(composed(table[-1, 1:4], half), step)
        found = np.where((later > 0.0)[:, None], ahead, found)
        right = np.clip(np.searchsorted(clock, times), 1, max(len(clock) - 1, 1))
        hole = np.diff(clock)[right - 1] > HOLE if len(clock) > 1 else np.zeros(len(times), bool)
        lost = (times < clock[0]) | (later > AHEAD) | (hole & (later < 0.0))
        found[lost] = np.nan
        return np.asarray(found)

    @property
    def pose(self) -> Array:
        """The pose of the newest odometry, (3,)."""
        assert self.newest is not None
        assert isinstance(self.newest.decoded.content, OdometryMessage)
        return self.newest.decoded.content.pose

    @property
    def frame(self) -> str:
        """The frame of the odometry; "" before the first."""
        return self.newest.decoded.frame if self.newest is not None else ""

    def motion(self, target: str, source: str) -> Array | None:
        """Return the pose of a frame in another, (3,), by the newest reports; None if unknown."""
        if source in ("", target):
            return np.zeros(3)
        try:
            found = self._frames.motion(target, source, [0.0])[0]
        except WideberthError:
            return None
        return found if np.isfinite(found).all() else None

    def mount(self, frame: str) -> Array | None:
        """Return the pose of a frame on the robot, (3,); None if unknown."""
        return self.motion(self._base, frame)

    def sensor(self, frame: str) -> tuple[Array, bool] | None:
        """Return the pose of a frame on the robot, and whether it is upside down; None if unknown.

        That is for sensors that scan a plane: for a message in such a frame see `motion`.
        """
        try:
            found, mirrored = self._frames.placement(self._base, frame or self._base, [0.0])
        except WideberthError:
            return None
        return (found[0], mirrored) if np.isfinite(found).all() else None

    def flaw(self, frame: str) -> str:
        """Say how a frame that tf connects with the robot tilts; "" where it does not."""
        try:
            self._frames.motion(self._base, frame, [0.0])
        except WideberthError as error:
            connected = self._frames.root(frame) == self._frames.root(self._base)
            return str(error) if connected else ""
        return ""

    def carries(self, frame: str) -> bool:
        """Whether the robot carries a frame with it, by the newest reports."""
        return self.frame in self._frames.above(frame)

    def off(self, frame: str, heading: float) -> float:
        """Return by how much the robot has to turn to a heading of a frame, within pi, rad.

        NaN where that is not known.
        """
        motion = self.motion(self.frame, frame)
        if self.newest is None or motion is None:
            return float("nan")
        return wrapped(float(motion[2]) + heading - float(self.pose[2]))

    def placed(self, frame: str) -> Array | None:
        """Return the pose of a frame in that of the odometry, (3,), now; None if unknown.

        Where tf does not connect the two, the odometry itself says where the robot is.
        """
        found = self.motion(self.frame, frame)
        mount = self.mount(frame)
        if found is not None or mount is None or self.newest is None:
            return found
        return composed(self.pose, mount)


def _carried(motion: OdometryMessage, base: Array) -> OdometryMessage:
    """Return the motion of a base with a pose (3,) in the frame whose motion is stated.

    With r the base's place in that frame and psi its heading there::

        v' = Rot(-psi) (v + w (-r_y, r_x))     C' = J C J^T     J = [I, Rot(heading) (-r_y, r_x)]
    """
    arm, (forward, aside, rate) = np.array([-base[1], base[0]]), motion.twist.tolist()
    pose = composed(motion.pose, base)
    x, y = (np.array([forward, aside]) + rate * arm).tolist()
    cosine, sine = np.cos(base[2]), np.sin(base[2])
    twist = np.array([cosine * x + sine * y, cosine * y - sine * x, rate])
    covariance = motion.covariance
    if covariance is not None:
        cosine, sine = np.cos(motion.pose[2]), np.sin(motion.pose[2])
        moved = np.eye(3)
        moved[:2, 2] = np.array([[cosine, -sine], [sine, cosine]]) @ arm
        covariance = np.asarray(moved @ covariance @ moved.T)
    return replace(motion, pose=pose, twist=twist, covariance=covariance)
