"""What goes wrong with the robots of a cascade."""

from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import final

import numpy as np

from wideberth.framework.values.arrays import number, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import InertialSample

from ..state_estimator import Sample

Span = tuple[float, float]
"""From when until when, s of the episode."""


@final
@dataclass(frozen=True)
class Faults:
    """What goes wrong; nothing by default. All times are those of the episode, s.

    Lost beams are a setting of the LiDAR, late detections one of the cascade, and pillars and
    people in the line of sight parts of a scenario.

    Parameters
    ----------
    robots : names of those that it happens to; () for all.
    grip : of the wheels (left front, left rear, right front, right rear), factors of their
        friction.
    push : when, s, and how hard, rad/s: rate about the forward axis that a push gives the robot.
        20 rad/s tip it over.
    gyro_step : when, s, and by how much, rad/s, the gyroscope's bias changes.
    blind : while every range of the LiDAR is NaN.
    silent : name of a sensor, and while it reports nothing.
    jump : when, s, and by how much, s, the clock of the sensors is set.
    late_stamps : s, by which the LiDAR's stamps are later than its beams.

    Raises
    ------
    WideberthError : a number that is not finite, a span that does not end after it begins, a grip
        that is not above 0.
    """

    robots: tuple[str, ...] = ()
    grip: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    push: tuple[float, float] | None = None
    gyro_step: tuple[float, float] | None = None
    blind: Span | None = None
    silent: tuple[str, float, float] | None = None
    jump: tuple[float, float] | None = None
    late_stamps: float = 0.0

    def __post_init__(self) -> None:
        if len(self.grip) != 4:
            raise WideberthError(f"faults.grip is {self.grip!r}; wanted a factor of each wheel")
        for factor in self.grip:
            positive("faults.grip", factor)
        for name in ("push", "gyro_step", "jump"):
            for value in getattr(self, name) or ():
                if not isfinite(number(f"faults.{name}", value)):
                    raise WideberthError(f"faults.{name} holds {value}; wanted finite numbers")
        for name, span in (("blind", self.blind), ("silent", (self.silent or ())[1:])):
            if span and not number(f"faults.{name}", span[0]) < number(name, span[1]):
                raise WideberthError(
                    f"faults.{name} lasts from {span[0]} to {span[1]} s; wanted a later end"
                )
        if not isfinite(number("faults.late_stamps", self.late_stamps)):
            raise WideberthError(f"faults.late_stamps is {self.late_stamps}; wanted seconds")

    @property
    def mechanical(self) -> bool:
        """Whether wheels or body are concerned."""
        return self.push is not None or self.grip != (1.0, 1.0, 1.0, 1.0)

    def of(self, robot: str) -> "Faults":
        """Return what happens to a robot."""
        return self if not self.robots or robot in self.robots else Faults()

    def clock(self, time: float) -> float:
        """Return by how much the clock of the sensors has been set at a time, s."""
        return 0.0 if self.jump is None or time < self.jump[0] else self.jump[1]

    def gyro_error(self, time: float) -> float:
        """Return by how much the gyroscope's bias has changed at a time, s, in rad/s."""
        return 0.0 if self.gyro_step is None or time < self.gyro_step[0] else self.gyro_step[1]

    def received(self, sample: Sample, now: float) -> Sample | None:
        """Return a sample as the robot receives it; None where it receives none.

        Parameters
        ----------
        sample : as it was measured.
        now : s of the episode, when.
        """
        name, *span = self.silent or ("", now, now)
        if sample.sensor == name and span[0] <= now < span[1]:
            return None
        shift = self.clock(now)
        if isinstance(sample, Scan):
            ranges = sample.ranges
            if self.blind is not None and self.blind[0] <= now < self.blind[1]:
                ranges = np.full(len(ranges), nan)
            shift += self.late_stamps
            if shift or ranges is not sample.ranges:
                sample = replace(sample, times=sample.times + shift, ranges=ranges)
            return sample
        step = self.gyro_error(now)
        if isinstance(sample, InertialSample) and step:
            sample = replace(sample, yaw_rate=sample.yaw_rate + step)
        return replace(sample, time=sample.time + shift) if shift else sample
