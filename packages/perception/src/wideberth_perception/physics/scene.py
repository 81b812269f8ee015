"""What stands and moves in a physical world."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias, final

from numpy.typing import ArrayLike

from wideberth.framework.values.arrays import Array, checked, checked_choice, positive
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.polygon import Polygon

from .body import SkidSteerBody
from .sensors import Sensor

Cone: TypeAlias = Literal["pyramidal", "elliptic"]
_SMALL = SkidSteerBody()


@final
@dataclass(frozen=True, eq=False)
class PhysicalRobot:
    """A skid-steered robot in the world.

    Parameters
    ----------
    name : unique among robots, people and walls.
    body : its mechanics.
    start : (3,), x and y of its middle in m, heading in rad.
    sensors : what it carries, each with a name of its own.
    grip : (4,) of its wheels, in the order of `TrueMotion`, factors of the scene's friction.

    Raises
    ------
    WideberthError : a start that is no finite (3,), two sensors with the same name, a grip that
        is not above 0.
    """

    name: str
    body: SkidSteerBody
    start: Array
    sensors: tuple[Sensor, ...]
    grip: tuple[float, float, float, float]

    def __init__(
        self,
        name: str,
        body: SkidSteerBody = _SMALL,
        start: ArrayLike = (0.0, 0.0, 0.0),
        sensors: Iterable[Sensor] = (),
        grip: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0),
    ) -> None:
        vars(self).update(name=name, body=body, start=checked(f"{name}.start", start, (3,)))
        vars(self).update(sensors=tuple(sensors), grip=grip)
        for factor in checked(f"{name}.grip", grip, (4,)):
            positive(f"{name}.grip", float(factor))
        _refuse_twins(f"the sensors of {name}", (sensor.name for sensor in self.sensors))


@final
@dataclass(frozen=True, eq=False)
class PhysicalPerson:
    """An upright cylinder that goes where it is put; nothing pushes it away.

    Parameters
    ----------
    name : unique among robots, people and walls.
    start : (2,), m.
    radius, height : m.
    """

    name: str
    start: Array
    radius: float
    height: float

    def __init__(
        self, name: str, start: ArrayLike, radius: float = 0.3, height: float = 1.7
    ) -> None:
        vars(self).update(name=name, start=checked(f"{name}.start", start, (2,)))
        vars(self).update(radius=radius, height=height)
        positive(f"{name}.radius", radius)
        positive(f"{name}.height", height)


@final
@dataclass(frozen=True, eq=False)
class PhysicalScene:
    """Everything in a world at its beginning, on a flat floor.

    Parameters
    ----------
    robots, people : who moves.
    walls : walls, crates, anything that stands still, 1 m high; each convex part of a polygon
        becomes a box, or a prism where it is no rectangle. One without a name is called "wall
        0", "wall 1" and so on by its place.
    friction : coefficient of the wheels on the floor.
    cone : shape of the friction. That of a real floor is "elliptic", the same in all directions.
        "pyramidal" is MuJoCo's own, with which the bodies here were chosen: along the axes of the
        world it holds a wheel better than between them.
    time_step : s.

    Raises
    ------
    WideberthError : two things with the same name, an unknown cone, a sensor that samples more
        often than the world steps.
    """

    robots: tuple[PhysicalRobot, ...]
    people: tuple[PhysicalPerson, ...] = ()
    walls: tuple[Polygon, ...] = ()
    friction: float = 1.0
    cone: Cone = "pyramidal"
    time_step: float = 0.004

    def __post_init__(self) -> None:
        for name in ("robots", "people", "walls"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        positive("physical_scene.friction", self.friction)
        positive("physical_scene.time_step", self.time_step)
        checked_choice("physical_scene.cone", self.cone, Cone)
        _refuse_twins("the scene", self.names)
        for robot in self.robots:
            for sensor in robot.sensors:
                if sensor.rate * self.time_step > 1.0 + 1e-9:
                    raise WideberthError(
                        f"sensor {sensor.name!r} of {robot.name} has rate {sensor.rate:g} Hz; the "
                        f"world steps at {1.0 / self.time_step:g} Hz: lower the rate or "
                        "the scene's time_step"
                    )

    @property
    def names(self) -> list[str]:
        """What the robots, the people and the walls are called, in this order."""
        movers = [robot.name for robot in self.robots] + [person.name for person in self.people]
        return movers + [wall.name or f"wall {index}" for index, wall in enumerate(self.walls)]


def _refuse_twins(where: str, names: Iterable[str]) -> None:
    """Refuse two equal names.

    Raises
    ------
    WideberthError : it names the first one that comes twice.
    """
    known: set[str] = set()
    for name in names:
        if name in known:
            raise WideberthError(f"two of {where} are called {name!r}; give each its own name")
        known.add(name)
