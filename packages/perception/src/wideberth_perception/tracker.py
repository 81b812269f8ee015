"""The Tracker interface: sightings of one scan after another in, obstacles with identities out."""

from abc import ABC, abstractmethod

from wideberth.simulation.sensing.perceived import Sightings, TrackedObstacle


class Tracker(ABC):
    """Follows obstacles from scan to scan.

    A tracker's settings are the fields of a dataclass; its tracks are its state. Laws, checked by
    `wideberth_perception.check_tracker`:

    - `update` never raises because of what was measured; sightings that are a little older than
      the last ones are left out, and the return value says why; a clock that was set back ends
      all tracks, which it says too, and the sightings are used;
    - `at` changes nothing;
    - what it finds does not depend on the order of the sightings within a scan, and turns and
      shifts with them;
    - after `reset` it behaves as new.
    """

    @abstractmethod
    def reset(self) -> None:
        """Forget everything but the settings."""

    @abstractmethod
    def update(self, sightings: Sightings) -> str:
        """Use the sightings of a scan; return what was wrong with them, "" where nothing was."""

    @abstractmethod
    def at(self, time: float) -> tuple[TrackedObstacle, ...]:
        """Return the confirmed obstacles, carried on to a time, s, in the order of their birth."""
