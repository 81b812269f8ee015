"""The Tracker interface: sightings of one scan after another in, obstacles with identities out."""

from abc import ABC, abstractmethod

from .values.sensing import Sightings, TrackedObstacle


class Tracker(ABC):
    """Follows obstacles from scan to scan.

    A tracker's settings are the fields of a dataclass; its tracks are its state. Laws:

    - `update` never raises because of what was measured; sightings that are older than the last
      ones are left out, and the return value says why;
    - `at` changes nothing;
    - what it finds does not depend on the order of the sightings within a scan;
    - after `reset` it behaves as new.
    """

    @abstractmethod
    def reset(self) -> None:
        """Forget everything but the settings."""

    @abstractmethod
    def update(self, sightings: Sightings) -> str:
        """Use the sightings of a scan; return why they were left out, "" where they were used."""

    @abstractmethod
    def at(self, time: float) -> tuple[TrackedObstacle, ...]:
        """Return the confirmed obstacles, carried on to a time, s, in the order of their birth."""
