"""How much the motion model and the sensors are wrong: a value with three named settings."""

from dataclasses import dataclass, fields
from typing import final

from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.arrays import positive
from wideberth.framework.values.errors import WideberthError


@final
@dataclass(frozen=True)
class MotionNoise:
    """Variances of the motion model, and deviations of what is measured.

    The defaults are those of the small robot (17 kg, wheels of 0.1 m) in physics.

    Parameters
    ----------
    position : m^2/s, by which the variance of x and of y grows.
    heading : rad^2/s, likewise.
    speed, lateral_speed : m^2/s^3, of the forward and the lateral speed.
    yaw_rate : rad^2/s^3.
    acceleration : m^2/s^5, of both accelerations.
    bias_walk : rad/s/sqrt(s), of the gyro's bias.
    wheels : m/s, deviation of the mean wheel speed from the forward speed: ticks, slip, jitter.
    slip : m/s, deviation of the lateral speed from 0.
    gyro : rad/s, noise of one sample.
    jitter : rad/s, by which the yaw rate differs from its mean since the last update.
    accelerometer : m/s^2, noise of one sample.
    accelerometer_bias : m/s^2, its unknown constant error.
    gyro_bias : rad/s, deviation of the bias where the gyro was not calibrated at rest.
    start : variance of x, y and heading in the beginning, m^2 and rad^2.
    start_speed, start_acceleration : variances of speeds and accelerations in the beginning.

    Raises
    ------
    WideberthError : a number that is negative; a measurement without noise.
    """

    position: float = 4.5e-5
    heading: float = 3.5e-6
    speed: float = 0.05
    lateral_speed: float = 2e-4
    yaw_rate: float = 0.02
    acceleration: float = 0.05
    bias_walk: float = 3e-5
    wheels: float = 0.0065
    slip: float = 0.01
    gyro: float = 0.002
    jitter: float = 0.005
    accelerometer: float = 0.05
    accelerometer_bias: float = 0.05
    gyro_bias: float = 0.01
    start: float = 1e-8
    start_speed: float = 1e-4
    start_acceleration: float = 1e-2

    def __post_init__(self) -> None:
        needed = {"wheels", "slip", "start", "start_speed", "start_acceleration", "gyro_bias"}
        for entry in fields(self):
            value = getattr(self, entry.name)
            positive(f"motion_noise.{entry.name}", value, zero=entry.name not in needed)
        for name, other in (("gyro", "jitter"), ("accelerometer", "accelerometer_bias")):
            if not getattr(self, name) and not getattr(self, other):
                raise WideberthError(
                    f"motion_noise.{name} and motion_noise.{other} are both 0; a measurement "
                    "without noise leaves a filter without a covariance"
                )


SETTINGS: dict[str, MotionNoise] = {
    "small": MotionNoise(),
    "large": MotionNoise(position=6e-5, heading=6e-6, wheels=0.009, jitter=0.012),
    "robot_localization": MotionNoise(
        position=0.05, heading=0.06, speed=0.025, lateral_speed=0.025, yaw_rate=0.02,
        acceleration=0.01, bias_walk=0.0, start=1e-9, start_speed=1e-9, start_acceleration=1e-9,
    ),
}  # fmt: skip
"""Honest noise of the small and of the large robot (80 kg, wheels of 0.165 m); and the process
noise that the ROS package robot_localization takes where none is configured, which is no model of
anything: the same mean, a position deviation of metres within a minute."""


def noise_of(setting: str | MotionNoise) -> MotionNoise:
    """Return the noise that a name in `SETTINGS` stands for.

    Raises
    ------
    WideberthError : no such name.
    """
    if isinstance(setting, MotionNoise):
        return setting
    if setting not in SETTINGS:
        raise WideberthError(unknown("noise", setting, SETTINGS))
    return SETTINGS[setting]
