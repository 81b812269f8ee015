"""A physical world: robots are commanded, people are moved, sensors report."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, isfinite
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, checked, positive
from wideberth.framework.values.errors import WideberthError, nearest
from wideberth.framework.values.motion import Command, Twist
from wideberth.simulation.sensing.perceived import InertialSample

from ..state_estimator import Sample
from .body import SkidSteerBody
from .mjcf import HULL, SEEN, mjcf
from .mujoco_module import collected_warnings, mujoco
from .scene import PhysicalRobot, PhysicalScene
from .sensors import BodyState, Sampler
from .slip import slip_of

PROPORTIONAL, INTEGRAL, MOST = 0.5, 1.0, 0.3
"""Gains of the yaw-rate loop, 1 and 1/s, and the largest |integral|, rad/s."""


@final
class WheelDrive:
    """Turns a wanted velocity into wheel speeds, with a loop on the yaw rate.

    With e = omega - (gyroscope - its bias) the wheels are driven as for the yaw rate

        omega_c = omega + 0.5 e + I,   dI/dt = e,   |I| <= 0.3 rad/s.

    The loop takes away what the constant ``body.yaw_gain`` leaves. It needs a gyroscope and rests
    without one. For the velocity 0 the wheels stand and the integral starts anew.

    Parameters
    ----------
    body : of the robot.
    """

    def __init__(self, body: SkidSteerBody) -> None:
        self._body = body
        self._integral = 0.0
        self.wanted: tuple[float, float] = (0.0, 0.0)
        """Forward speed, m/s, and yaw rate, rad/s, of the last command."""
        self._bias = 0.0
        self.flaw: str = ""
        """Why the last command cannot be driven; "" for one that can."""

    def command(self, twist: Twist, gyro_bias: float) -> None:
        """Take a velocity; one that is not finite stops the robot and sets `flaw`."""
        wanted = float(twist.linear[0]), float(twist.angular)
        good = isfinite(wanted[0]) and isfinite(wanted[1]) and isfinite(gyro_bias)
        self.flaw = "" if good else f"the command {wanted}, gyro bias {gyro_bias}, is not finite"
        self.wanted = wanted if good else (0.0, 0.0)
        self._bias = gyro_bias if good else 0.0

    def wheel_speeds(self, gyro: float | None, duration: float) -> tuple[float, float]:
        """Return the speeds of the left and right wheels, rad/s.

        Parameters
        ----------
        gyro : newest reading, rad/s; None without a gyroscope.
        duration : s, since the last call.
        """
        forward, turn = self.wanted
        if forward == 0.0 and turn == 0.0:
            self._integral = 0.0
            return 0.0, 0.0
        if gyro is not None:
            error = turn - (gyro - self._bias)
            self._integral += INTEGRAL * error * duration
            self._integral = min(max(self._integral, -MOST), MOST)
            turn += PROPORTIONAL * error + self._integral
        left, right = self._body.rim_speeds(forward, turn)
        return left / self._body.wheel_radius, right / self._body.wheel_radius


TIPPED = np.radians(45.0)
"""rad from upright, beyond which a robot counts as pushed over."""
_UPRIGHT = cos(TIPPED)
_WILDEST = 1e6
"""m, rad, m/s and rad/s, beyond which the physics has failed."""


@final
@dataclass(frozen=True, eq=False)
class TrueMotion:
    """How a robot really stands and moves.

    Attributes
    ----------
    time : s.
    pose : (3,), x, y in m and heading in rad.
    twist : (3,), forward and lateral speed in m/s in the body's frame, yaw rate in rad/s.
    wheels : (4,), rad, angles of the wheels: left front, left rear, right front, right rear.
    wheel_speeds : (4,), m/s at their rims.
    """

    time: float
    pose: Array
    twist: Array
    wheels: Array
    wheel_speeds: Array


class PhysicsWorld:
    """Robots, people and walls in MuJoCo, advanced step by step.

    In one tick a caller advances the world, hands the samples that became due to the robots'
    programs, and their commands to the wheels::

        world.advance(0.02)
        for name, samples in world.samples_due().items():
            ...
            world.command(name, Twist((0.5, 0.0), 0.1))

    Every sensor draws from a generator of its own, made of a number from ``rng`` and the names
    of robot and sensor: another sensor more or less does not change its noise.

    Parameters
    ----------
    scene : what there is at time 0.
    rng : one number of it is used.

    Raises
    ------
    WideberthError : MuJoCo is not installed, or refuses the scene; two bodies overlap.
    """

    def __init__(self, scene: PhysicalScene, rng: np.random.Generator) -> None:
        library = mujoco()
        self.scene = scene
        try:
            self._model = library.MjModel.from_xml_string(mjcf(scene))
        except ValueError as error:
            raise WideberthError(f"MuJoCo refuses the scene: {error}") from error
        self._data = library.MjData(self._model)
        self._step, self._place = library.mj_step, library.mj_kinematics
        self._cast_rays = library.mj_multiRay
        self._steps = 0
        self._asked = 0.0  # s, sum of what was advanced by
        self._broken = ""
        key = int(rng.integers(2**63))
        self._robots = {
            robot.name: _RobotInWorld(self._model, self._data, index, robot, key)
            for index, robot in enumerate(scene.robots)
        }
        self._people = {person.name: index for index, person in enumerate(scene.people)}
        self._names = scene.names
        self._owners = self._owner_of_geoms()
        self._touching: set[tuple[str, str]] = set()
        self._groups = np.zeros(6, dtype=np.uint8)
        self._groups[[SEEN, HULL]] = 1
        library.mj_forward(self._model, self._data)
        self._refuse_overlaps()
        for robot in self._robots.values():
            robot.sense(0.0, self._cast)

    @property
    def time(self) -> float:
        """Time of the world, s: that of its last step."""
        return self._steps * self.scene.time_step

    @property
    def contacts(self) -> list[tuple[str, str]]:
        """Pairs of names that touched in the last `advance`, each and all in alphabetic order."""
        return sorted(self._touching)

    def advance(self, duration: float) -> None:
        """Let time pass, in whole steps; what is left of a step counts to the next call.

        Parameters
        ----------
        duration : s.

        Raises
        ------
        WideberthError : a duration that is not above 0.
        """
        self._asked += positive("duration", duration)
        self._touching.clear()
        step = self.scene.time_step
        with collected_warnings() as warned:
            while self._asked - self._steps * step > 0.5 * step:
                self._steps += 1
                if not self._broken:
                    self._advance_one(step)
        if self._broken and warned:
            self._broken += f" ({warned[0]})"

    def _advance_one(self, step: float) -> None:
        model, data = self._model, self._data
        before = data.qpos.copy()
        self._move(step)
        if not (_tame(data.qpos) and _tame(data.qvel)):
            data.qpos[:], data.qvel[:] = before, 0.0  # all stand where they were last
            self._broken = f"the physics has no finite solution after {self.time:.3f} s"
            return
        self._place(model, data)  # a step leaves the places of its beginning behind
        if data.ncon:
            self._note_contacts()
        for robot in self._robots.values():
            robot.sense(self.time, self._cast)

    def _move(self, duration: float) -> None:
        """Bring all bodies on by a step."""
        for robot in self._robots.values():
            robot.drive(duration)
        self._step(self._model, self._data)

    def _note_contacts(self) -> None:
        owners = self._owners[self._data.contact.geom]
        for first, second in owners[(owners >= 0).all(axis=1)]:
            one, other = sorted((self._names[first], self._names[second]))
            self._touching.add((one, other))

    def samples_due(self) -> dict[str, list[Sample]]:
        """Return what the sensors of each robot reported since the last call, in time order."""
        return {name: robot.collected() for name, robot in self._robots.items()}

    def command(self, name: str, velocity: Twist | Command, *, gyro_bias: float = 0.0) -> None:
        """Give a robot a velocity, which it holds until the next one.

        One that is not finite stops it, see `status`.

        Parameters
        ----------
        name : of the robot.
        velocity : forward speed and yaw rate; a skid-steered robot has no lateral speed to
            command. The ``ramp`` of a command belongs to the velocity smoother, not here.
        gyro_bias : rad/s, taken off the gyroscope in the yaw-rate loop.
        """
        twist = velocity.twist if isinstance(velocity, Command) else velocity
        self._robot(name).wheels.command(twist, gyro_bias)

    def status(self, name: str) -> str:
        """Return why a robot stands still against its command; "" if it does not.

        It was pushed over, its command is not finite, or the physics has failed.
        """
        return self._broken or self._robot(name).status

    def truth(self, name: str) -> TrueMotion:
        """Return how a robot really stands and moves."""
        return self._robot(name).motion(self.time)

    def move_person(self, name: str, position: Sequence[float] | Array) -> None:
        """Put a person somewhere, from the next step on.

        Parameters
        ----------
        name : of the person.
        position : (2,), m.
        """
        if name not in self._people:
            raise WideberthError(_unknown("person", name, self._people))
        self._data.mocap_pos[self._people[name], :2] = checked("position", position, (2,))

    def push(self, name: str, rate: float) -> None:
        """Push a robot sideways at once.

        Parameters
        ----------
        name : of the robot.
        rate : rad/s, that it gets about its forward axis.
        """
        self._robot(name).roll(rate)

    def _cast(self, excluded: int, origin: Array, directions: Array, longest: float) -> Array:
        count = len(directions)
        geoms, found = np.empty(count, dtype=np.int32), np.empty(count)
        self._cast_rays(
            self._model, self._data, origin, np.ascontiguousarray(directions).ravel(),
            self._groups, True, excluded, geoms, found, None, count, longest,
        )  # fmt: skip
        return found

    def _robot(self, name: str) -> "_RobotInWorld":
        if name not in self._robots:
            raise WideberthError(_unknown("robot", name, self._robots))
        return self._robots[name]

    def _owner_of_geoms(self) -> NDArray[np.intp]:
        """Return for each geom the place of its owner among the names, -1 for the floor."""
        scene = self.scene
        counts = ("robot", scene.robots), ("person", scene.people), ("wall", scene.walls)
        labels = [f"{kind}{index}" for kind, some in counts for index in range(len(some))]
        place = {label: index for index, label in enumerate(labels)}
        geoms = (self._model.geom(index).name for index in range(self._model.ngeom))
        return np.array([place.get(name.partition(".")[0], -1) for name in geoms])

    def _refuse_overlaps(self) -> None:
        """Refuse robots that touch something at the start.

        Raises
        ------
        WideberthError : it names both.
        """
        self._note_contacts()
        for one, other in sorted(self._touching):
            raise WideberthError(f"{one} and {other} overlap at the start; move one of them")


def _tame(numbers: Array) -> bool:
    """Whether numbers are finite, and none that a world of robots has is as large."""
    return bool((np.abs(numbers) < _WILDEST).all())


def _unknown(kind: str, name: str, known: Any) -> str:
    listed = ", ".join(sorted(known)) or "none"
    return f"there is no {kind} {name!r}{nearest(name, known)}; the world has {listed}"


@final
class _RobotInWorld:
    """A robot's places in the arrays of MuJoCo, its wheel controller and sensors."""

    def __init__(self, model: Any, data: Any, index: int, robot: PhysicalRobot, key: int) -> None:
        label = f"robot{index}"
        free, wheels = model.joint(label), [model.joint(f"{label}.{wheel}") for wheel in range(4)]
        self._body: SkidSteerBody = robot.body
        self._ident = int(model.body(label).id)
        start, speed = int(free.qposadr[0]), int(free.dofadr[0])
        self._pose = data.qpos[start : start + 7]
        self._velocity = data.qvel[speed : speed + 6]
        first, rate = int(wheels[0].qposadr[0]), int(wheels[0].dofadr[0])
        self._angles = data.qpos[first : first + 4]
        self._rates = data.qvel[rate : rate + 4]
        self._control = data.ctrl[4 * index : 4 * index + 4]
        self._attitude = data.xmat[self._ident]
        self._position = data.xpos[self._ident]
        self.wheels = WheelDrive(robot.body)
        self._gyro: float | None = None
        self._samplers: list[Sampler] = [
            sensor.sampler(_generator(key, robot.name, sensor.name), robot.body.wheel_radius)
            for sensor in robot.sensors
        ]
        self._fresh: list[Sample] = []

    @property
    def status(self) -> str:
        """Why the robot stands still against its command; "" if it does not."""
        upright = self._upright()
        if upright < _UPRIGHT:
            lean = np.degrees(np.arccos(np.clip(upright, -1.0, 1.0)))
            return f"pushed over: {lean:.0f} degrees from upright"
        return self.wheels.flaw

    def _upright(self) -> float:
        """Return the cosine of the angle between the body's upward axis and that of the world."""
        _, x, y, _ = self._pose[3:].tolist()
        return float(1.0 - 2.0 * (x * x + y * y))

    def drive(self, duration: float) -> None:
        """Set the speeds of the wheels for the next step."""
        left, right = self.wheels.wheel_speeds(self._gyro, duration)
        if self._upright() < _UPRIGHT:
            left = right = 0.0
        self._control[:2] = left
        self._control[2:] = right

    def carry(self, duration: float) -> None:
        """Move exactly as commanded, on an arc; the wheels turn as if they did not slip."""
        forward, turn = self.wheels.wanted
        x, y, begin = self.motion(0.0).pose.tolist()
        heading = begin + turn * duration
        middle = 0.5 * (begin + heading)
        chord = forward * duration * np.sinc(0.5 * turn * duration / np.pi)
        aside = 0.5 * self._body.track * turn
        self._put(
            (x + chord * np.cos(middle), y + chord * np.sin(middle), heading),
            (forward, 0.0, turn), (forward - aside, forward + aside), duration,
        )  # fmt: skip

    def slide(self, duration: float) -> None:
        """Move as the body's slip model says, with the wheels that the yaw-rate loop wants."""
        left, right = self.wheels.wheel_speeds(self._gyro, duration)
        rims = left * self._body.wheel_radius, right * self._body.wheel_radius
        now = self.motion(0.0)
        pose, twist = slip_of(self._body).moved(now.pose, now.twist, *rims, duration)
        self._put(pose, twist, rims, duration)

    def _put(
        self,
        pose: Sequence[float] | Array,
        twist: Sequence[float] | Array,
        rims: tuple[float, float],
        duration: float,
    ) -> None:
        """Be somewhere upright at a velocity, with wheels that turned for a while."""
        x, y, heading = pose
        ahead, aside, turn = twist
        cosine, sine = np.cos(heading), np.sin(heading)
        self._pose[:2] = x, y
        self._pose[3:] = np.cos(0.5 * heading), 0.0, 0.0, np.sin(0.5 * heading)
        self._velocity[:] = (
            ahead * cosine - aside * sine, ahead * sine + aside * cosine, 0.0, 0.0, 0.0, turn,
        )  # fmt: skip
        self._rates[:] = np.repeat(rims, 2) / self._body.wheel_radius
        self._angles += self._rates * duration

    def roll(self, rate: float) -> None:
        """Add a rate, rad/s, about the forward axis."""
        self._velocity[3] += rate

    def sense(self, time: float, cast: Any) -> None:
        """Show the robot to its sensors after a step."""
        if not self._samplers:
            return
        attitude = self._attitude.reshape(3, 3)
        state = BodyState(
            time, self._position, attitude, self._velocity[:3].copy(), self._velocity[3:],
            self._angles,
        )  # fmt: skip

        def beams(origin: Array, directions: Array, longest: float) -> Array:
            found: Array = cast(self._ident, origin, directions, longest)
            return found

        for sampler in self._samplers:
            for sample in sampler.sample(state, beams):
                if isinstance(sample, InertialSample):
                    self._gyro = sample.yaw_rate
                self._fresh.append(sample)

    def collected(self) -> list[Sample]:
        """Return the samples since the last call."""
        found, self._fresh = self._fresh, []
        return found

    def motion(self, time: float) -> TrueMotion:
        """Return pose and velocity in the plane."""
        w, x, y, z = self._pose[3:].tolist()
        heading = atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        forward, lateral = np.cos(heading), np.sin(heading)
        vx, vy = self._velocity[:2].tolist()
        twist = np.array(
            [forward * vx + lateral * vy, forward * vy - lateral * vx, self._velocity[5]]
        )
        pose = np.array([self._pose[0], self._pose[1], heading])
        rims = self._rates * self._body.wheel_radius
        return TrueMotion(time, pose, twist, self._angles.copy(), rims)


def _generator(key: int, robot: str, sensor: str) -> np.random.Generator:
    """Return the generator of one sensor: the same for the same key and names."""
    words = [key, *f"{robot}/{sensor}".encode()]
    return np.random.default_rng(np.random.SeedSequence(words))


@final
class KinematicWorld(PhysicsWorld):
    """The same bodies and sensors, without wheels that slip.

    Each robot moves with the forward speed and the yaw rate of its command, at once and
    exactly; its wheels turn as if they did not slip. Nothing stops it at a wall, and contacts are
    not noted.
    """

    def _move(self, duration: float) -> None:
        for robot in self._robots.values():
            robot.carry(duration)


@final
class SlippingWorld(PhysicsWorld):
    """The same bodies, sensors and yaw-rate loop, on wheels that slip as `SlipModel` says.

    That is the physics without the jitter of the contacts. Nothing stops a robot at a wall, and
    contacts are not noted. A body without a fitted model is refused by the first `advance`.
    """

    def _move(self, duration: float) -> None:
        for robot in self._robots.values():
            robot.slide(duration)
