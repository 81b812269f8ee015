"""The Detector interface: a scan in, discs and what stands still out."""

from abc import ABC, abstractmethod

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.sensing.perceived import Sightings


class Detector(ABC):
    """Finds obstacles in the scan of a LiDAR.

    A detector's settings are the fields of a dataclass; what it remembers (which places have long
    been occupied) is its state. Laws, checked by `wideberth_perception.check_detector`:

    - `detect` never raises because of what was measured: an empty scan, or one without a range
      that is of use, gives no sightings and a note;
    - turning and shifting the poses turns and shifts what it finds;
    - after `reset` it behaves as new.
    """

    @abstractmethod
    def reset(self) -> None:
        """Forget everything but the settings."""

    @abstractmethod
    def detect(self, scan: Scan, poses: Array) -> Sightings:
        """Find what stands or moves around the robot.

        Parameters
        ----------
        scan : B beams.
        poses : (B, 3), x, y in m and heading in rad of the robot at the instant of each beam: the
            motion within a scan is taken out by them.
        """
