"""A drive in NumPy, and what wheels and an inertial unit measure of it."""

from dataclasses import dataclass

import numpy as np

from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample, WheelSample

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
    wander: float = 0.5,
    noisy: bool = True,
) -> Drive:
    """Drive at 0.2 to 0.6 m/s with a new speed and yaw rate every 4 s, after 2 s at rest.

    The pose wanders from its integral by the share ``wander`` of the variance that the small
    robot's setting allows (the rest is for the filter's lag in turns), and the wheels are as far
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
            shaken = np.sqrt(STEP * (wander * np.array([4e-5, 4e-5, 3e-6]))) * rng.standard_normal(
                3
            )
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


def block(x0, y0, x1, y1):
    """Return a rectangle as a wall."""
    return Polygon(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def room(half: float = 13.0, thick: float = 0.3):
    """Return the walls of a square room about the origin, with two pillars."""
    far = half + thick
    return (
        *(block(-far, half, far, far), block(-far, -far, far, -half)),
        *(block(half, -half, far, half), block(-far, -half, -half, half)),
        *(block(8.0, 8.0, 9.0, 9.5), block(-10.0, -9.0, -9.0, -8.0)),
    )


def cast(walls, origin, bearings, longest: float = 15.0):
    """Return the range of beams to the nearest edge, (B,), m; infinite beyond the longest."""
    starts = np.concatenate([wall.points for wall in walls])
    along = np.concatenate([np.roll(wall.points, -1, axis=0) for wall in walls]) - starts
    beams = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
    off = starts - np.asarray(origin).reshape(-1, 1, 2)
    cross = beams[:, :1] * along[:, 1] - beams[:, 1:] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        far = (off[..., 0] * along[:, 1] - off[..., 1] * along[:, 0]) / cross
        part = (off[..., 0] * beams[:, 1:] - off[..., 1] * beams[:, :1]) / cross
    hit = (far > 0.0) & (part >= 0.0) & (part <= 1.0)
    ranges = np.where(hit, far, np.inf).min(axis=1)
    return np.where(ranges <= longest, ranges, np.inf)


def scans(drive: Drive, walls, rng: np.random.Generator, people=(), beams: int = 180) -> list:
    """Return scans of 0.1 s each, smeared by the motion, with ranges of 1 cm noise.

    The LiDAR is 0.2 m ahead of the middle. People stand where they are; the map has them not.
    """
    mount = np.array([0.2, 0.0, 0.1])
    bearings = -np.pi + 2.0 * np.pi * np.arange(beams) / beams
    found = []
    for last in np.arange(0.11, drive.times[-1], 0.1):
        times = last - 0.1 + 0.1 * (np.arange(beams) + 1.0) / beams
        x, y, heading = (np.interp(times, drive.times, drive.truth[:, i]) for i in range(3))
        origins = np.stack(
            [x + mount[0] * np.cos(heading), y + mount[0] * np.sin(heading)], axis=1
        )
        ranges = cast((*walls, *people), origins, bearings + heading + mount[2])
        ranges = ranges + 0.01 * rng.standard_normal(beams)
        found.append(Scan("lidar", times, bearings, ranges, 0.01, 15.0, mount))
    return found


def instant(sample) -> float:
    """Return the time of a sample, s; of a scan, that of its last beam."""
    return sample.stamp if isinstance(sample, Scan) else sample.time


def in_order(*lists) -> list:
    """Return samples of several lists in the order of their times."""
    return sorted((sample for one in lists for sample in one), key=instant)
