"""A hall with a door and two who walk across, for robots that see by scans."""

from itertools import pairwise

import numpy as np

START, GOAL = (1.0, 1.0), (11.0, 1.0)
"""m, in the frame of the map."""
HALL = ((0.0, 0.0), (12.0, 0.0), (12.0, 5.0), (0.0, 5.0), (0.0, 0.0))
WALL = ((5.0, 0.0), (5.0, 2.6))
"""m, corners of the hall, and the wall in it, which leaves a door of 2.4 m."""
MOUNT, BEAMS, LONGEST = 0.2, 360, 12.0
"""m, of the LiDAR before the robot's centre; beams of a turn; m."""
WIDE = 0.3
"""m, radius of the robot and of everybody."""


def walls() -> np.ndarray:
    """Ends of all walls, (W, 2, 2), m."""
    return np.array([*pairwise(HALL), WALL], float)


def walkers(now: float) -> np.ndarray:
    """Two who walk to and fro across the hall at 0.3 m/s, (2, 2), m."""
    column, begin = np.array([3.0, 8.5]), np.array([1.5, 5.0])
    along = (0.3 * now + begin) % 7.0
    return np.stack([column, 1.0 + np.minimum(along, 7.0 - along)], axis=-1)
