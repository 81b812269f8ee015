"""A drive in NumPy, and what wheels and an inertial unit measure of it."""

from dataclasses import dataclass

import numpy as np

from wideberth.framework.values.sensing import InertialSample, WheelSample

STEP = 0.01
REST = 2.0
RADIUS = 0.1


@dataclass(frozen=True, eq=False)
class Drive:
    """Samples in their order, true (T,) times and (T, 6) motion at each instant."""

    samples: list
    times: np.ndarray
    truth: np.ndarray

    @property
    def way(self) -> float:
        """Length of the path, m."""
        return float(np.abs(self.truth[:, 3]).sum() * STEP)


def driven(
    rng: np.random.Generator,
    seconds: float = 40.0,
    *,
    bias: float = 0.01,
    walk: float = 3e-5,
    gyro: float = 0.002,
    noisy: bool = True,
) -> Drive:
    """Drive at 0.2 to 0.6 m/s with a new speed and yaw rate every 4 s, after 2 s at rest.

    The pose wanders from its integral half as much as the small robot's setting allows (2e-5
    m^2/s, 1.5e-6 rad^2/s: the rest is for the filter's lag in turns), and the wheels are as far
    from the speed as it says; the unit reports 100 times a second, the
    wheels every 0.03 or 0.04 s, in ticks of 2 pi / 4096.
    """
    count = round((seconds + REST) / STEP)
    times = STEP * np.arange(1, count + 1)
    truth = np.zeros((count, 6))
    noise = float(noisy)
    pose, speed, rate, wanted = np.zeros(3), 0.0, 0.0, (0.0, 0.0)
    angle, drift, samples = 0.0, noise * bias * rng.standard_normal(), []
    for index, time in enumerate(times):
        moving = time > REST
        if moving and (index - round(REST / STEP)) % 400 == 0:
            wanted = rng.uniform(0.2, 0.6), rng.uniform(-0.3, 0.3)
        before = speed
        speed += np.clip(wanted[0] - speed, -0.5 * STEP, 0.5 * STEP)
        rate += np.clip(wanted[1] - rate, -0.2 * STEP, 0.2 * STEP)
        middle = pose[2] + 0.5 * STEP * rate
        pose = pose + STEP * np.array([speed * np.cos(middle), speed * np.sin(middle), rate])
        if moving:
            shaken = np.sqrt(STEP * np.array([2e-5, 2e-5, 1.5e-6])) * rng.standard_normal(3)
            pose = pose + noise * shaken
        truth[index] = (*pose, speed, 0.0, rate)
        drift += noise * walk * np.sqrt(STEP) * rng.standard_normal()
        jitter = noise * moving * 0.005 * np.sqrt(3.3) * rng.standard_normal()
        read = rate + drift + noise * gyro * rng.standard_normal() + jitter
        push = (speed - before) / STEP + noise * 0.05 * rng.standard_normal()
        samples.append(InertialSample("unit", float(time), read, np.array([push, speed * rate])))
        angle += speed * STEP / RADIUS
        if index % 10 in (2, 5, 9):
            slipped = noise * moving * 0.0065 * 0.033 / RADIUS * rng.standard_normal()
            tick = 2.0 * np.pi / 4096
            counted = np.round((angle + slipped / np.sqrt(2.0)) / tick) * tick
            samples.append(WheelSample("wheels", float(time), np.full(4, counted)))
    return Drive(samples, times, truth)
