"""What GenSafeNav adds to CrowdNav++: draws of its conformal inference, and other people."""

from typing import Any, Literal, TypeAlias, final

import numpy as np
from numpy.typing import NDArray

from wideberth.framework.values.arrays import Array, BoolArray
from wideberth.framework.values.polygon import convex_hull, separation
from wideberth.people.models import circular_force, shortened
from wideberth.simulation.crowds.base import STEP

Shift: TypeAlias = Literal["none", "rushing", "social_force", "groups"]

HORIZONS = 5
"""Steps ahead of which each person's forecasts are followed, one inference for each."""
EXPERTS = 3
"""Learning rates among which an inference draws one."""
NOISE = 3
"""Normal draws, of deviation 0, for each person who is followed, in each step."""
HIDDEN = 15.0
"""m from the robot, in x and y, where a person whom it does not see is put."""
SAME_PLACE = 0.1
"""m between a forecast's beginning and a person up to which it counts as that person's."""

FORCE = 2.0
"""m/s^2, A of the circular force of people by social force."""
REACH = 1.0
"""m, its B; both from the original's configuration."""

RUSHING_SHARE = 0.2
"""Chance that a person rushes; our guess."""
RUSHING_SPEED = 2.0
"""m/s, of people who rush, as an account of the original's paper has it."""

LEAST, MOST = 2, 4
"""Sizes of a group; our guess."""
BESIDE = 1.0
"""m, standard deviation of a member's place around that of the leader, in x and in y."""
COHESION = 1.0
"""1/s: speed towards the group's centre for each metre that a member is too far from it."""


@final
class Inference:
    """The draws of GenSafeNav's adaptive conformal inference from the generator of a case.

    The original follows the forecasts of each person whom the robot sees and draws from the
    generator of the crowd for it. How often it draws hangs on who is seen, not on the forecasts,
    so that a robot that has none meets the same crowd.

    A person is followed where the forecast at his rank by distance begins at his place: not who
    has just come, and not where an unseen person is nearer than a seen one.

    Parameters
    ----------
    rng : generator of the case, a ``RandomState``.
    people : number of slots.
    """

    def __init__(self, rng: Any, people: int) -> None:
        self._rng = rng
        self._followed: BoolArray = np.zeros(people, dtype=bool)
        self._instants: NDArray[np.int64] = np.zeros(people, dtype=np.int64)

    def meet(self, slot: int) -> None:
        """Draw for a person who is new in a slot."""
        self._rng.randint(0, EXPERTS, HORIZONS)
        self._followed[slot], self._instants[slot] = False, 0

    def learn(self) -> None:
        """Draw for those whose forecasts are compared with where they are now."""
        self._instants += self._followed
        self._rng.random_sample(np.minimum(self._instants, HORIZONS)[self._followed].sum())

    def follow(self, looked: Array, seen: BoolArray, places: Array, robot: Array) -> None:
        """Find who is followed from now on, and draw for them.

        Parameters
        ----------
        looked : (N, 2), m, where people were when the robot looked.
        seen : (N,), whom it saw then.
        places : (N, 2), m, where the people in these slots are now.
        robot : (2,), m.
        """
        begins = np.where(seen[:, None], looked - robot, HIDDEN)
        begins = begins[np.argsort(np.hypot(*begins.T), kind="stable")] + robot
        ranks = np.argsort(np.hypot(*(places - robot).T), kind="stable")
        self._followed[ranks] = np.hypot(*(begins - places[ranks]).T) < SAME_PLACE
        self._rng.normal(size=NOISE * self._followed.sum())


def social_force(
    places: Array, velocities: Array, goals: Array, radii: Array, speeds: Array
) -> Array:
    """Return the next velocities of people who walk by the original's social force, (N, 2), m/s.

    ::

        v' = v + t (v* - v + sum_j A exp((r + r_j - d_j) / B) n_j),   |v'| <= |v*|

    v* points to the goal and has the preferred speed, also close to it.

    Parameters
    ----------
    places, velocities, goals : (N, 2), m and m/s.
    radii, speeds : (N,), m and m/s.
    """
    ways = goals - places
    wanted = ways * (speeds / np.hypot(*ways.T))[:, None]
    apart = places[:, None] - places
    push = circular_force(
        apart, radii[:, None] + radii, FORCE, REACH, ~np.eye(len(radii), dtype=bool)
    )
    return shortened(velocities + STEP * (wanted - velocities + push), speeds)


@final
class Groups:
    """Who walks with whom: groups of 2 to 4, each behind the slot that leads it, and no one alone.

    The law of how members keep together is that of Moussaïd et al., The walking behaviour of
    pedestrian social groups (2010), as a velocity: who is farther than (n - 1) / 2 m from the
    centre of a group of n is drawn to it.

    Parameters
    ----------
    rng : draws the sizes.
    people : number of slots.

    Attributes
    ----------
    leaders : (N,), slot of the leader of each slot's group, its own where it leads.
    led : who leads -> the slots of the others.
    """

    def __init__(self, rng: np.random.Generator, people: int) -> None:
        leaders: list[int] = []
        while len(leaders) < people:
            left = people - len(leaders)
            size = left if left <= MOST else int(rng.integers(LEAST, min(MOST, left - LEAST) + 1))
            leaders += [len(leaders)] * size
        self.leaders: NDArray[np.int64] = np.array(leaders)
        self.led: dict[int, list[int]] = {
            leader: [i for i in range(people) if self.leaders[i] == leader and i != leader]
            for leader in dict.fromkeys(leaders)
        }

    def pull(self, places: Array) -> Array:
        """Return the velocity towards each one's group, (N, 2), m/s."""
        count = np.bincount(self.leaders, minlength=len(places))[self.leaders]
        sums = np.zeros_like(places)
        np.add.at(sums, self.leaders, places)
        ways = sums[self.leaders] / count[:, None] - places
        length = np.hypot(*ways.T)
        beyond = np.maximum(length - (count - 1) / 2.0, 0.0)
        return np.asarray(COHESION * ways * (beyond / np.maximum(length, SAME_PLACE))[:, None])

    def entered(self, places: Array, robot: Array, radius: float) -> bool:
        """Return whether a robot of this radius, m, is in the hull of a group's centres."""
        members = (places[[leader, *led]] for leader, led in self.led.items())
        hulls = (convex_hull(one)[::-1] for one in members)
        return any(separation(robot[None], hull)[0] < radius for hull in hulls)
