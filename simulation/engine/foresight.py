"""What people will do if robots keep to their plans: the future that an oracle is given."""

from collections.abc import Callable, Iterator, Mapping
from typing import final

import numpy as np

from ...framework.robot import Robot
from ...framework.values.arrays import Array
from .driver import Driver
from .plant import Plant


@final
class Foresight(Mapping[str, Array]):
    """Future positions by identity; those of people are simulated when they are first asked for.

    Most controllers ask for nothing, and to simulate costs more than to decide.

    Parameters
    ----------
    known : identity -> (T, D), m, of all agents, as far as no simulation is needed.
    people : whose future is simulated.
    simulate : returns it, identity -> (T, D), m; called once at most.
    """

    def __init__(
        self,
        known: Mapping[str, Array],
        people: frozenset[str],
        simulate: Callable[[], Mapping[str, Array]],
    ) -> None:
        self._known, self._people, self._simulate = known, people, simulate
        self._found: Mapping[str, Array] | None = None

    @property
    def asked(self) -> bool:
        """Whether the simulation was asked for."""
        return self._found is not None

    def __getitem__(self, name: str) -> Array:
        """Return the positions of one, (T, D), m."""
        if name not in self._people:
            return self._known[name]
        if self._found is None:
            self._found = {**self._known, **self._simulate()}
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        """Name all agents."""
        return iter(self._known)

    def __len__(self) -> int:
        """Count them."""
        return len(self._known)


@final
class Planned(Plant):
    """A robot that is where its plan says, whatever it is commanded.

    Parameters
    ----------
    driver : of the robot, as it is now.
    now : s.
    """

    def __init__(self, driver: Driver, now: float) -> None:
        self.robot: Robot = driver.agent.robot
        self.state: tuple[float, ...] = driver.plant.state
        self.control: tuple[float, ...] = driver.plant.control
        self._driver, self._now = driver, now
        self._place = driver.plant.position

    def command(self, command: object, time: float) -> None:
        """Do nothing."""

    def advance(self, time: float, duration: float) -> None:
        """Move on along the plan, by ``duration`` s."""
        there = self._driver.future(np.array([time + duration]), self._now)[0]
        self._place = tuple(float(value) for value in there)

    @property
    def position(self) -> tuple[float, ...]:
        """Where the plan has it, (D,), m."""
        return self._place
