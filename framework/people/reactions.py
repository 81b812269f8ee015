"""What people do while a robot comes: each way of the robot with a world of its own."""

from dataclasses import replace

import numpy as np

from ..values.arrays import Array
from .models import Company, PersonModel, Walkers
from .walls import WallField


def reactions(
    model: PersonModel, people: Walkers, ways: Array, radius: float, walls: WallField, dt: float
) -> Array:
    """Roll people out beside each of K ways of a robot.

    Every ``dt`` everybody decides anew by the model, seeing all others, the walls and the robot of
    their own world; between decisions all move in straight lines.

    Parameters
    ----------
    model : the rule of all of them.
    people : N, as they are now.
    ways : (K, T + 1, 2), m, places of the robot every ``dt``, the first one now.
    radius : m, of the robot.
    walls : where nobody walks.
    dt : s.

    Returns
    -------
    Places of the people, (K, N, T + 1, 2), m.
    """
    worlds, steps, count = len(ways), ways.shape[1] - 1, len(people.radius)
    sides = len(walls.polygons)
    now = Walkers(
        np.tile(people.place, (worlds, 1, 1)),
        np.tile(people.velocity, (worlds, 1, 1)),
        np.tile(people.wanted, (worlds, 1, 1)),
        np.tile(people.radius, (worlds, 1)),
    )
    seen = np.tile(~np.eye(count, count + 1, dtype=np.bool_), (worlds, 1, 1))
    bodies = np.concatenate([now.radius, np.full((worlds, 1), radius)], axis=1)
    found = np.empty((worlds, count, steps + 1, 2))
    found[:, :, 0] = now.place
    for row in range(steps):
        pace = (ways[:, row + 1] - ways[:, row]) / dt
        company = Company(
            np.concatenate([now.place, ways[:, row, None]], axis=1),
            np.concatenate([now.velocity, pace[:, None]], axis=1),
            bodies,
            seen,
            walls.beside(now.place.reshape(-1, 2)).reshape(worlds, count, sides, 3),
        )
        velocity = model.next_velocity(now, company, dt)
        now = replace(now, place=now.place + dt * velocity, velocity=velocity)
        found[:, :, row + 1] = now.place
    return found
