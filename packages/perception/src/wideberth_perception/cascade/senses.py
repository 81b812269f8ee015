"""What one robot perceives and believes, from its samples to its observation."""

import re
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from copy import deepcopy
from typing import final

import numpy as np

from wideberth.framework.numerics.geometry import wrapped
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.polygon import Polygon
from wideberth.framework.values.sensing import PlacedScan, Scan
from wideberth.simulation.log.frames import RigidMotion
from wideberth.simulation.log.perception_log import Glance, PerceptionLog, TrueBody, TrueStage
from wideberth.simulation.sensing.perceived import (
    InertialSample,
    MotionEstimate,
    Sightings,
    TrackedObstacle,
    WheelSample,
)

from ..handover import Batch, Handover
from ..observed_state import own_state
from ..state_estimator import Sample, StateEstimator, poses_at
from ..walls import walls_behind
from .cascade import PATIENCE, SensingPipeline
from .naming import named

STILL = 2e-3
"""rad between two samples of a wheel that stands: a tick of its encoder."""
SAME = 1e-3
"""s by which an estimate may be of another time than was asked for."""
NUMBERS = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")
"""In a note; notes that differ by them alone are of one kind."""
AGAIN = "the gyroscope is calibrated anew"
REMEMBERED = 2.0
"""s for which true poses are remembered."""


@final
class TrueState(StateEstimator):
    """A robot that knows its own pose and velocity exactly, so that a study removes one error."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._means: list[Array] = []

    def reset(self, pose: Array, time: float) -> None:
        """Begin at a known pose, at rest."""
        self._times, self._means = [time], [np.concatenate([pose, np.zeros(3)])]

    def note(self, time: float, pose: Array, twist: Array) -> None:
        """Take the robot's true pose and twist at a time, s, later than the last one."""
        self._times.append(time)
        self._means.append(np.concatenate([pose, twist]))
        if self._times[0] < time - 2.0 * REMEMBERED:
            first = bisect_right(self._times, time - REMEMBERED)
            del self._times[:first], self._means[:first]

    def take(self, sample: Sample) -> str:
        """Need no sensor."""
        return ""

    def at(self, time: float) -> MotionEstimate:
        """Return the truth, in a straight line between two instants."""
        index = min(max(bisect_right(self._times, time), 1), len(self._times) - 1)
        if len(self._times) == 1:
            return MotionEstimate(self._times[0], self._means[0], np.zeros((6, 6)))
        first, last = self._times[index - 1], self._times[index]
        share = min(max((time - first) / (last - first), 0.0), 1.0) if last > first else 1.0
        change = self._means[index] - self._means[index - 1]
        change[2] = wrapped(change[2])
        mean = self._means[index - 1] + share * change
        return MotionEstimate(first + share * (last - first), mean, np.zeros((6, 6)))


@final
class Watchdog:
    """Says why a robot must stand still; changes with each sample. Times are those of its clock.

    Parameters
    ----------
    sensors : names of those that it needs.
    now : s, when all is well.
    """

    def __init__(self, sensors: Iterable[str], now: float) -> None:
        self._useful_at = dict.fromkeys(sensors, now)
        self._now = now

    def jumped(self, now: float, passed: float) -> float:
        """Take the clock's time; return by how much it was set, s, 0 where it was not.

        Parameters
        ----------
        now : s.
        passed : s since the last call, by another clock.
        """
        jump = now - self._now - passed
        self._now = now
        if abs(jump) <= PATIENCE:
            return 0.0
        self._useful_at = {name: time + jump for name, time in self._useful_at.items()}
        return jump

    def note(self, sample: Sample) -> None:
        """Note when a sample came, if it is of use."""
        if sample.sensor in self._useful_at and _useful(sample):
            self._useful_at[sample.sensor] = self._now

    def reason(self) -> str:
        """Return why the robot must stand still; "" if it need not."""
        for name, time in self._useful_at.items():
            if self._now - time > PATIENCE:
                return f"{name}: nothing of use for more than {PATIENCE:g} s"
        return ""


def _useful(sample: Sample) -> bool:
    if isinstance(sample, Scan):
        return bool(len(sample.ranges)) and not bool(np.isnan(sample.ranges).all())
    return not sample.flaw


@final
class Senses:
    """The chain of one robot; changes as the episode runs.

    It lives by the clock of its sensors, which is `clock` ahead of the episode's. A robot that no
    longer knows how it moves (its clock was set, or samples failed to come for long) is `stop`ped.
    Once its wheels have stood for a while it starts anew from where it took itself to be, with a
    gyroscope that is calibrated anew, and drives on.

    Parameters
    ----------
    robot : its model.
    cascade : the stages.
    name : of the robot.
    start : (3,), its pose when it is switched on, m and rad.
    phase : s, of its LiDAR.
    rng : noise of true positions, where there is no detector.

    Attributes
    ----------
    estimator : of its own motion.
    gyro_bias : rad/s, as calibrated at rest.
    glances : what it believed after each scan, by the clock of the episode.
    known : identity of an obstacle -> who it was taken for last.
    notes : why samples and scans gave less than they should -> how often.
    """

    def __init__(
        self,
        robot: Robot,
        cascade: SensingPipeline,
        name: str,
        start: Array,
        phase: float,
        rng: np.random.Generator,
    ) -> None:
        self._robot, self._cascade = robot, cascade
        self._rng, self._phase = rng, phase
        self._faults = cascade.faults.of(name)
        self._time = -cascade.rest
        now = self.clock(self._time)
        known = cascade.state is not None
        self.estimator: StateEstimator = deepcopy(cascade.state) or TrueState()
        self.estimator.reset(start, now)
        self._frame = self.estimator.at(now).frame
        self._detector, self._tracker = deepcopy(cascade.detector), deepcopy(cascade.tracker)
        for stage in (self._detector, self._tracker):
            if stage is not None:
                stage.reset()
        needed = [cascade.encoders.name, cascade.imu.name] if known else []
        needed += [cascade.lidar.name] if self.needs_scans else []
        self._watchdog = Watchdog(needed, now)
        self._handover = Handover("measured" if self._tracker is None else cascade.handover)
        self._coming: list[tuple[float, Sightings, Array]] = []
        self._seen: tuple[TrackedObstacle, ...] = ()
        self._walls: tuple[Polygon, ...] = ()
        self._scan: PlacedScan | None = None
        self._turns = self._turn_of(self._time)
        self._rest_ends, self._at_rest = now + cascade.rest, 0
        self._wheels: tuple[float, Array] = now, np.full(4, np.nan)
        self._lost = ""
        self.gyro_bias: float = 0.0
        self.glances: list[Glance] = []
        self.known: dict[str, str] = {}
        self.notes: dict[str, int] = {}

    @property
    def needs_scans(self) -> bool:
        """Whether it looks for others, or for its own place in a map, in scans."""
        return self._detector is not None or self._frame == "map"

    def clock(self, time: float) -> float:
        """Return the time of its sensors, s, at a time of the episode, s."""
        return time + self._cascade.rest + self._faults.clock(time)

    @property
    def stop(self) -> str:
        """Why it must stand still; "" if it need not."""
        return self._watchdog.reason() or self._lost

    def log(self) -> PerceptionLog:
        """Return what it has perceived."""
        return PerceptionLog(tuple(self.glances), dict(self.notes))

    def sense(self, truth: TrueStage, samples: Sequence[Sample]) -> bool:
        """Use what came since the last call; return whether obstacles were looked for anew.

        Parameters
        ----------
        truth : of now.
        samples : since the last call, in the order of their times; without a detector the true
            positions are seen whenever the LiDAR would have ended a scan.
        """
        now, passed = self.clock(truth.time), truth.time - self._time
        self._time = truth.time
        if jump := self._watchdog.jumped(now, passed):
            self._lost = f"the clock was set by {jump:.3g} s"
            self._rest_ends = -np.inf  # which was of the clock before
            self._wheels = self._wheels[0] + jump, self._wheels[1]
        if isinstance(self.estimator, TrueState):
            if self._lost:
                self.estimator.reset(truth.pose, now)
                self._lost = ""
            else:
                self.estimator.note(now, truth.pose, truth.twist)
        received = (self._faults.received(sample, truth.time) for sample in samples)
        scans = self._take([one for one in received if one is not None], now)
        self._regain(now)
        if self._detector is None:
            turns, self._turns = self._turns, self._turn_of(truth.time)
            if turns < self._turns:
                due = truth.time + self._cascade.latency
                self._coming.append((due, self._true_sightings(truth, now), np.zeros((0, 2))))
        for scan in scans if self._detector is not None else ():
            self._detect(scan, truth.time + self._cascade.latency)
        fresh = [one for one in self._coming if one[0] <= truth.time + 1e-9]
        for one in fresh:
            self._coming.remove(one)
            self._conclude(*one[1:], truth, now)
        return bool(fresh)

    def _take(self, samples: Sequence[Sample], now: float) -> list[Scan]:
        """Let the estimator use samples, and return the scans among them."""
        scans = []
        for sample in samples:
            if isinstance(sample, Scan):
                scans.append(sample)
                if self._detector is None:  # else it has yet to turn out to be of use
                    self._watchdog.note(sample)
                if self._frame != "map":
                    continue
            else:
                self._watchdog.note(sample)
            self._note(self.estimator.take(sample))
            if isinstance(sample, InertialSample) and now <= self._rest_ends:
                self._calibrate(sample)
            if isinstance(sample, WheelSample) and not sample.flaw:
                since, angles = self._wheels
                still = np.abs(sample.angles - angles).max() < STILL
                self._wheels = since if still else now, sample.angles
        return scans

    def _calibrate(self, sample: InertialSample) -> None:
        """Take the mean yaw rate of a robot at rest for the gyroscope's bias."""
        if not sample.flaw:
            self._at_rest += 1
            self.gyro_bias += (sample.yaw_rate - self.gyro_bias) / self._at_rest

    def _regain(self, now: float) -> None:
        """Begin anew once the wheels have stood, where it is not known how the robot moves."""
        if self._lost and self._lost == AGAIN and now >= self._rest_ends:
            self._lost = ""
        if not self._lost and abs(self.estimator.at(now).time - now) > PATIENCE:
            self._lost = "its own motion is not known"
        stood = now - self._wheels[0] > PATIENCE
        if self._lost not in ("", AGAIN) and stood and not self._watchdog.reason():
            self.estimator.reset(self.estimator.at(now).pose, now)
            self._scan = None
            self._rest_ends, self._at_rest, self.gyro_bias = now + self._cascade.rest, 0, 0.0
            self._lost = AGAIN

    def _detect(self, scan: Scan, due: float) -> None:
        """Find obstacles in a scan; a tracker receives them when they are due."""
        assert self._detector is not None, "scans are of use to a detector alone"
        known = not len(scan.times) or self._known_at(scan.stamp)
        if known or self._lost:  # where its own motion is lost that is reason enough to stand
            self._watchdog.note(scan)
        if not known:
            self._note("a scan is of a time at which the robot's own pose is not known")
            return
        poses = poses_at(self.estimator, scan.times)
        sightings = self._detector.detect(scan, poses)
        self._note(sightings.note)
        if len(poses):
            self._scan = PlacedScan(scan, self.estimator.at(scan.stamp).pose)
        beams = scan.beams(poses)
        self._coming.append((due, sightings, beams.ends[beams.met]))

    def _known_at(self, time: float) -> bool:
        """Whether the estimator can speak of a time, s."""
        return abs(self.estimator.at(time).time - time) <= SAME

    def reports(self) -> tuple[Batch, ...]:
        """Return what the last scan has added for a controller to remember, oldest first."""
        now = self.clock(self._time)
        self._handover, earlier, present = self._handover.detections(self._tracked(now), now)
        return (*earlier, present)

    def present(self) -> Batch:
        """Return one detection of each obstacle, the newest."""
        now = self.clock(self._time)
        return self._handover.detections(self._tracked(now), now)[2]

    def observation(self, detections: Batch, polygons: tuple[Polygon, ...]) -> Observation:
        """Return what the controller observes now, by the clock of the episode.

        Detections share the error of the own pose; polygons of a map do not, see `own_state`.

        Parameters
        ----------
        detections : of the tracked obstacles.
        polygons : what stands still, where that is known.
        """
        own = self.estimator.at(self.clock(self._time))
        state, covariance = own_state(self._robot, own, seen_from_here=True)
        on_map = None
        if self._cascade.walls == "seen":
            polygons = self._walls
        elif polygons:
            on_map = own_state(self._robot, own, seen_from_here=False)[1]
        return Observation(
            self._time, state, detections, covariance, polygons, map_covariance=on_map,
            scan=self._scan,
        )  # fmt: skip

    def _tracked(self, now: float) -> tuple[TrackedObstacle, ...]:
        """Return the obstacles as of now."""
        return self._seen if self._tracker is None else self._tracker.at(now)

    def _conclude(self, sightings: Sightings, points: Array, truth: TrueStage, now: float) -> None:
        """Track what a scan has shown, and note it beside the truth."""
        own = self.estimator.at(now)
        to_world = RigidMotion.between(own.pose, truth.pose)
        bodies = truth.bodies
        if self._cascade.walls == "seen":
            sensor = own.pose[:2] if sightings.origin is None else sightings.origin
            gap = 2.0 * self._cascade.mechanical_body.radius
            self._walls = walls_behind(sightings.segments, sensor, gap)
        if self._tracker is None:
            obstacles = self._seen = self._named(sightings, to_world, bodies)
        else:
            self._note(self._tracker.update(sightings))
            obstacles = (
                self._tracker.at(sightings.time) if sightings.time == sightings.time else ()
            )
        places = [to_world.points(one.state[:2]) for one in obstacles]
        names = named(places, [one.ident for one in obstacles], bodies)
        self.known |= {ident: name for ident, name in names.items() if name}
        glance = Glance(truth, own, sightings, obstacles, names, points)
        self.glances.append(glance.kept(truth.time - now))

    def _true_sightings(self, truth: TrueStage, now: float) -> Sightings:
        """Return true positions within the LiDAR's range, with noise, in the robot's frame."""
        reach = self._cascade.lidar.longest
        seen = [
            one
            for one in truth.bodies
            if np.linalg.norm(one.position - truth.pose[:2]) - one.radius <= reach
        ]
        to_own = RigidMotion.between(truth.pose, self.estimator.at(now).pose)
        places = to_own.points(np.array([one.position for one in seen]).reshape(-1, 2))
        noise = self._cascade.noise
        places = places + noise * self._rng.standard_normal(places.shape)
        spread = np.tile(max(noise, 1e-3) ** 2 * np.eye(2), (len(seen), 1, 1))
        return Sightings(now, places, spread, np.array([one.radius for one in seen]))

    def _named(
        self, sightings: Sightings, to_world: RigidMotion, bodies: Sequence[TrueBody]
    ) -> tuple[TrackedObstacle, ...]:
        """Give each sighting the name of its body; those that match no body are left out."""
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
            kind = NUMBERS.sub("...", reason)
            self.notes[kind] = self.notes.get(kind, 0) + 1
