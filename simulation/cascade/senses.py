"""What one robot perceives and believes, from its samples to its observation."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, cast, final

import numpy as np

from ...framework.control.own_state import own_state
from ...framework.robot import Robot
from ...framework.state_estimator import StateEstimator, poses_at
from ...framework.tracking.handover import Batch, Handover
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError
from ...framework.values.motion import Observation
from ...framework.values.polygon import Polygon
from ...framework.values.sensing import (
    InertialSample,
    Sample,
    Scan,
    Sightings,
    TrackedObstacle,
)
from ..log.frames import RigidMotion
from ..log.perception_log import Body, Glance, PerceptionLog, Truth, named
from .cascade import Cascade
from .oracles import TrueState

P = TypeVar("P")


@final
class Senses:
    """The chain of one robot; changes as the episode runs. All times are those of its sensors.

    Parameters
    ----------
    robot : its model.
    cascade : the stages.
    start : (3,), its pose when it is switched on, m and rad.
    phase : s, of its LiDAR.
    rng : noise of true positions, where there is no detector.

    Attributes
    ----------
    estimator : of its own motion.
    gyro_bias : rad/s, as calibrated at rest.
    glances : what it believed after each scan.
    known : identity of an obstacle -> who it was taken for last.
    notes : why samples and scans gave less than they should -> how often.
    """

    def __init__(
        self,
        robot: Robot,
        cascade: Cascade,
        start: Array,
        phase: float,
        rng: np.random.Generator,
    ) -> None:
        self._robot, self._cascade = robot, cascade
        self._rng, self._phase = rng, phase
        self.estimator: StateEstimator = (
            TrueState() if cascade.state is None else anew(cascade.state)
        )
        self.estimator.reset(start, 0.0)
        self._detector = None if cascade.detector is None else anew(cascade.detector)
        self._tracker = None if cascade.tracker is None else anew(cascade.tracker)
        for stage in (self._detector, self._tracker):
            if stage is not None:
                stage.reset()
        self._handover = Handover("measured" if self._tracker is None else cascade.handover)
        self._turns = self._turn_of(0.0)
        self._at_rest = 0
        self.gyro_bias: float = 0.0
        self.glances: list[Glance] = []
        self.known: dict[str, str] = {}
        self.notes: dict[str, int] = {}

    def log(self) -> PerceptionLog:
        """Return what it has perceived; time 0 is that of the episode, when the rest is over."""
        glances = tuple(one.later(-self._cascade.rest) for one in self.glances)
        return PerceptionLog(glances, dict(self.notes))

    def take(self, samples: Sequence[Sample]) -> list[Scan]:
        """Use samples in the order of their times, and return the scans among them."""
        scans = []
        for sample in samples:
            if isinstance(sample, Scan):
                scans.append(sample)
                continue
            self._note(self.estimator.take(sample))
            if isinstance(sample, InertialSample) and sample.time <= self._cascade.rest:
                self._calibrate(sample)
        return scans

    def _calibrate(self, sample: InertialSample) -> None:
        """Take the mean yaw rate of a robot at rest for the gyroscope's bias."""
        self._at_rest += 1
        self.gyro_bias += (sample.yaw_rate - self.gyro_bias) / self._at_rest

    def look(self, truth: Truth, scans: Sequence[Scan]) -> bool:
        """Detect and track what scans that have ended now show; return whether there was one.

        Parameters
        ----------
        truth : of now.
        scans : that the LiDAR has ended since the last call; without a detector the true positions
            are seen whenever one would have ended.
        """
        if isinstance(self.estimator, TrueState):
            self.estimator.note(truth.time, truth.pose, truth.twist)
        if self._detector is not None:
            for scan in scans:
                poses = poses_at(self.estimator, scan.times)
                sightings = self._detector.detect(scan, poses)
                self._note(sightings.note)
                self._conclude(sightings, _points(scan, poses), truth)
            return bool(scans)
        turns, self._turns = self._turns, self._turn_of(truth.time)
        if turns < self._turns:
            self._conclude(self._true_sightings(truth), np.zeros((0, 2)), truth)
        return turns < self._turns

    def reports(self, clock: float) -> tuple[Batch, ...]:
        """Return what the last scan has added for a controller to remember, oldest first.

        Parameters
        ----------
        clock : s, now.
        """
        self._handover, earlier, present = self._handover.detections(self._tracked(clock), clock)
        return (*earlier, present)

    def observation(
        self, stamp: float, clock: float, detections: Batch, polygons: tuple[Polygon, ...]
    ) -> Observation:
        """Return what the controller is told.

        Parameters
        ----------
        stamp, clock : s, the same instant for the episode and for the sensors.
        detections : that it is told.
        polygons : what stands still.
        """
        state, covariance = own_state(self._robot, self.estimator.at(clock), seen_from_here=True)
        return Observation(stamp, state, detections, covariance, polygons)

    def present(self, clock: float) -> Batch:
        """Return one detection of each obstacle, the newest."""
        return self._handover.detections(self._tracked(clock), clock)[2]

    def _tracked(self, clock: float) -> tuple[TrackedObstacle, ...]:
        """Return the obstacles as of now."""
        if self._tracker is not None:
            return self._tracker.at(clock)
        return self.glances[-1].obstacles if self.glances else ()

    def _conclude(self, sightings: Sightings, points: Array, truth: Truth) -> None:
        """Track what a scan has shown, and note it beside the truth."""
        own = self.estimator.at(truth.time)
        to_world = RigidMotion.between(own.pose, truth.pose)
        bodies = truth.bodies
        if self._tracker is None:
            obstacles = self._named(sightings, to_world, bodies)
        else:
            self._note(self._tracker.update(sightings))
            obstacles = self._tracker.at(sightings.time)
        places = [to_world.points(one.state[:2]) for one in obstacles]
        names = named(places, [one.ident for one in obstacles], bodies)
        self.known |= {ident: name for ident, name in names.items() if name}
        self.glances.append(Glance(truth, own, sightings, obstacles, names, points))

    def _true_sightings(self, truth: Truth) -> Sightings:
        """Return true positions within the LiDAR's range, with noise, in the robot's frame."""
        reach = self._cascade.lidar.longest
        seen = [
            one
            for one in truth.bodies
            if np.linalg.norm(one.position - truth.pose[:2]) - one.radius <= reach
        ]
        to_own = RigidMotion.between(truth.pose, self.estimator.at(truth.time).pose)
        places = to_own.points(np.array([one.position for one in seen]).reshape(-1, 2))
        noise = self._cascade.noise
        places = places + noise * self._rng.standard_normal(places.shape)
        spread = np.tile(max(noise, 1e-3) ** 2 * np.eye(2), (len(seen), 1, 1))
        return Sightings(truth.time, places, spread, np.array([one.radius for one in seen]))

    def _named(
        self, sightings: Sightings, to_world: RigidMotion, bodies: Sequence[Body]
    ) -> tuple[TrackedObstacle, ...]:
        """Give sightings the names of who they are; who is nobody is left out."""
        places = list(to_world.points(sightings.positions))
        found = named(places, [str(i) for i in range(len(places))], bodies)
        known = []
        for i, place in enumerate(sightings.positions):
            if who := found[str(i)]:
                noise, time = sightings.covariance[i], float(sightings.times[i])
                joint = np.zeros((4, 4))
                joint[:2, :2] = noise
                known.append(
                    TrackedObstacle(
                        *(who, time, np.array([*place, 0.0, 0.0]), joint),
                        *(float(sightings.radius[i]), time),
                        *(np.array([time]), place[None], noise[None]),
                    )
                )
        return tuple(known)

    def _turn_of(self, time: float) -> int:
        return int(np.floor((time - self._phase) * self._cascade.lidar.rate + 1e-9))

    def _note(self, reason: str) -> None:
        if reason:
            kind = reason.split(":")[0]
            self.notes[kind] = self.notes.get(kind, 0) + 1


def _points(scan: Scan, poses: Array) -> Array:
    """Where the beams hit something, in the frame of the poses, (P, 2), m."""
    met = scan.met
    x, y, turn = scan.mount
    heading = poses[met, 2]
    cosine, sine = np.cos(heading), np.sin(heading)
    bearing = heading + turn + scan.bearings[met]
    ranges = scan.ranges[met]
    return np.stack(
        [
            poses[met, 0] + cosine * x - sine * y + ranges * np.cos(bearing),
            poses[met, 1] + sine * x + cosine * y + ranges * np.sin(bearing),
        ],
        axis=1,
    )


def anew(stage: P) -> P:
    """Return another one with the same settings: every robot needs one of its own."""
    if not is_dataclass(stage):
        raise WideberthError(
            f"{type(stage).__name__} is no dataclass; the settings of a stage are its fields, so "
            "that it can be built again for every robot"
        )
    settings = {one.name: getattr(stage, one.name) for one in fields(stage) if one.init}
    kind: Any = type(stage)
    return cast(P, kind(**settings))
