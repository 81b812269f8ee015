"""What robots perceived and believed in an episode, beside the truth."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, final

import numpy as np

from ...framework.values.arrays import Array
from ..sensing.perceived import MotionEstimate, Sightings, TrackedObstacle
from .frames import RigidMotion

GRAIN = 1e-3
"""m, to which the points of scans are rounded in a log."""


class TrueBody(NamedTuple):
    """A body that can be seen.

    Attributes
    ----------
    name : identity.
    position, velocity : (2,), m and m/s, in the world.
    radius : m.
    """

    name: str
    position: Array
    velocity: Array
    radius: float


class TrueStage(NamedTuple):
    """What really is, for one robot.

    Attributes
    ----------
    time : s.
    pose : (3,), x, y in m and heading in rad.
    twist : (3,), forward and lateral speed in m/s, yaw rate in rad/s.
    bodies : who else is there.
    """

    time: float
    pose: Array
    twist: Array
    bodies: tuple[TrueBody, ...]


@final
@dataclass(frozen=True, eq=False)
class Glance:
    """What a robot believed after one scan, beside the truth.

    Beliefs are in the robot's own frame, which is the world's when it is switched on.

    Attributes
    ----------
    truth : of the same instant.
    own : what it believed of itself.
    sightings : what was found in the scan.
    obstacles : what was tracked.
    names : identity of each obstacle -> name of its body; "" for none.
    points : (P, 2), m, where the scan hit something.
    """

    truth: TrueStage
    own: MotionEstimate
    sightings: Sightings
    obstacles: tuple[TrackedObstacle, ...]
    names: dict[str, str]
    points: Array

    @property
    def to_world(self) -> RigidMotion:
        """The motion from the robot's own frame to the world's."""
        return RigidMotion.between(self.own.pose, self.truth.pose)

    def kept(self, shift: float) -> "Glance":
        """Return it as it is logged.

        Points are rounded to a `GRAIN`, and the measurements behind a track are left out.

        Parameters
        ----------
        shift : s, by which the instants of beliefs become later: they are those of another clock.
        """
        seen = self.sightings
        return replace(
            self,
            own=replace(self.own, time=self.own.time + shift),
            sightings=replace(
                seen,
                time=seen.time + shift,
                times=seen.times + shift,
                static=_rounded(seen.static),
            ),
            obstacles=tuple(
                TrackedObstacle(
                    one.ident,
                    one.time + shift,
                    one.state,
                    one.covariance,
                    one.radius,
                    one.seen + shift,
                )
                for one in self.obstacles
            ),
            points=_rounded(self.points),
        )


class PipelineStop(NamedTuple):
    """A time in which a robot stood, or braked, whatever its controller said.

    Attributes
    ----------
    begin, end : s.
    reason : why.
    """

    begin: float
    end: float
    reason: str


@final
@dataclass(frozen=True, eq=False)
class PerceptionLog:
    """What one robot perceived; times are those of the episode.

    Attributes
    ----------
    glances : one per scan, in order; the first ones lie before time 0, while it stood.
    notes : why samples and scans gave less than they should, "..." for numbers -> how often.
    stops : when it was stopped for its own safety, and why.
    """

    glances: tuple[Glance, ...] = ()
    notes: dict[str, int] = field(default_factory=dict)
    stops: tuple[PipelineStop, ...] = ()

    def at(self, time: float) -> Glance | None:
        """Return the newest glance at a time, s; None before the first."""
        known = [one for one in self.glances if one.truth.time <= time + 1e-9]
        return known[-1] if known else None


def _rounded(points: Array) -> Array:
    return np.asarray(np.rint(points / GRAIN) * GRAIN)
