"""The cascade between the world and a controller: sensors, state, detections, tracks, wheels."""

from dataclasses import dataclass, field, replace
from typing import Literal, TypeAlias, final

from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.arrays import checked_choice, positive
from wideberth.framework.values.errors import WideberthError

from ..detector import Detector
from ..physics.body import LARGE, SkidSteerBody
from ..physics.mujoco_module import check_mujoco
from ..physics.sensors import InertialUnit, Lidar, WheelEncoders
from ..physics.slip import slip_of
from ..state_estimator import StateEstimator
from ..tracker import Tracker
from .faults import Faults

Mechanics: TypeAlias = Literal["physics", "slip", "kinematic"]
BODIES = {
    "small": SkidSteerBody(),
    "large": LARGE,
    "small_box": replace(SkidSteerBody(), hull="box"),
    "large_box": replace(LARGE, hull="box"),
}
"""Bodies by name. The large ones have the radius of the paper's robots, 0.75 m. A LiDAR sees
an upright cylinder around the body, or the body as the box that it is."""
PATIENCE = 0.5
"""s, for which a sensor may give nothing of use; then the robot stops."""


@final
@dataclass(frozen=True, eq=False)
class SensingPipeline:
    """How robots sense, what they conclude, and what moves them; a stage left out is the truth.

    A controller sees what comes out at the end: its own state, in the frame in which the robot
    was switched on, and tracked obstacles in the same frame. Robots do not send each other their
    positions.

    Parameters
    ----------
    body : of every robot, or its name in `BODIES`.
    mechanics : "physics", wheels on a floor, which slip when the robot turns; "slip", the model
        that was fitted to it, without the jitter of the contacts; or "kinematic", a body that
        moves exactly as its smoother says.
    lidar, encoders, imu : the sensors of every robot. The phase of each LiDAR is drawn.
    state : estimates the robot's own motion from encoders and IMU; None for the truth.
    detector : finds obstacles in scans; None for the true positions, with noise.
    tracker : gives them identities and velocities; None for the true identities.
    handover : how a controller is given the tracked obstacles, see `Handover`.
    walls : where a controller's polygons come from. "known": they are those of the episode, in the
        robot's own frame, as on a map; drift of the own pose shifts the robot among them, which
        `scan_matching` bounds, and the covariance of the own pose counts. "seen": they lie behind
        the segments of what its last scan met that stands still, see `walls_behind`.
    noise : m, standard deviation of each coordinate of a position where there is no detector.
    latency : s, from the end of a scan until what it shows has been found. The instants of what is
        found are those of its beams, so that a controller knows how old it is.
    rest : s, for which all stand before time 0, so that gyroscopes are calibrated.
    faults : what goes wrong.

    Raises
    ------
    WideberthError : a number out of range, wheels that slip on a body without wheels, a body
        whose slip was never fitted; MuJoCo is not installed.
    """

    body: str | SkidSteerBody = "large"
    mechanics: Mechanics = "physics"
    lidar: Lidar = field(default_factory=Lidar)
    encoders: WheelEncoders = field(default_factory=WheelEncoders)
    imu: InertialUnit = field(default_factory=InertialUnit)
    state: StateEstimator | None = None
    detector: Detector | None = None
    tracker: Tracker | None = None
    handover: Literal["measured", "filtered"] = "filtered"
    walls: Literal["known", "seen"] = "known"
    noise: float = 0.01
    latency: float = 0.0
    rest: float = 2.0
    faults: Faults = field(default_factory=Faults)

    def __post_init__(self) -> None:
        check_mujoco()
        if isinstance(self.body, str) and self.body not in BODIES:
            raise WideberthError(f"cascade.body: {unknown('body', self.body, BODIES)}")
        checked_choice("cascade.mechanics", self.mechanics, Mechanics)
        checked_choice("cascade.handover", self.handover, Literal["measured", "filtered"])
        checked_choice("cascade.walls", self.walls, Literal["known", "seen"])
        if self.walls == "seen" and self.detector is None:
            raise WideberthError("cascade.walls are seen in scans; give the cascade a detector")
        if self.mechanics == "slip":
            slip_of(self.mechanical_body)
        positive("cascade.noise", self.noise, zero=True)
        positive("cascade.latency", self.latency, zero=True)
        positive("cascade.rest", self.rest)
        for sensor in (self.lidar, self.encoders, self.imu):
            if PATIENCE * sensor.rate <= 2.0:
                raise WideberthError(
                    f"cascade.{sensor.name}.rate is {sensor.rate:g} Hz; wanted more than two "
                    f"samples in the {PATIENCE:g} s after which a silent sensor stops the robot"
                )
        names = [sensor.name for sensor in (self.lidar, self.encoders, self.imu)]
        if self.faults.silent and self.faults.silent[0] not in names:
            wrong = self.faults.silent[0]
            raise WideberthError(f"cascade.faults.silent: {unknown('sensor', wrong, names)}")
        if self.faults.mechanical and self.mechanics != "physics":
            raise WideberthError(
                f"cascade.faults push a robot or let its wheels slip, and cascade.mechanics is "
                f"{self.mechanics!r}; that needs physics"
            )

    @property
    def mechanical_body(self) -> SkidSteerBody:
        """The body itself."""
        return BODIES[self.body] if isinstance(self.body, str) else self.body
