"""Crowds: kinds of controllers, and the share of people with each."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any, Protocol, cast, final, runtime_checkable

import numpy as np

from ...framework.controller import Controller
from ...framework.plugins.config import build
from ...framework.robot import Robot
from ...framework.values.arrays import positive
from ...framework.values.errors import WideberthError
from ...framework.values.path import Path
from ..engine.agents import RobotAgent


@final
@dataclass(frozen=True, eq=False)
class CrowdMix:
    """Kinds of people by name, one of which is drawn for each person.

    A kind is a controller with the settings that all people of this kind share: ORCA, a social
    force, constant velocity, or another planner of ours. It is copied for each person, with the
    person's own radius and speed: the field ``robot`` of the copy is the kind's own robot with
    that ``radius`` and with ``max_speed`` = speed times the controller's ``haste`` (1 where it
    has none), and ``reference_speed`` is the speed.

    Parameters
    ----------
    kinds : name -> controller.
    shares : name -> weight above 0 of the draw; equal weights where it is empty.

    Raises
    ------
    WideberthError : no kinds, a share for a kind that there is not or none for one that there
        is, a controller without the fields that a person needs.
    """

    kinds: dict[str, Controller]
    shares: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.kinds:
            raise WideberthError("crowd.kinds is empty; name at least one controller")
        if self.shares and set(self.shares) != set(self.kinds):
            raise WideberthError(
                f"crowd.shares names {sorted(self.shares)}, and crowd.kinds {sorted(self.kinds)}; "
                "give each kind one share, or leave the shares out"
            )
        for name, share in self.shares.items():
            positive(f"crowd.shares.{name}", share)
        for name, kind in self.kinds.items():
            _check_kind(name, kind)

    def person(
        self, rng: np.random.Generator, name: str, path: Path, speed: float, radius: float
    ) -> RobotAgent:
        """Draw the kind of one person (one draw, whatever the kinds), and make the person.

        Parameters
        ----------
        name : identity.
        path : where the person goes.
        speed : m/s, liked; the person has it at time 0.
        radius : m.
        """
        names = list(self.kinds)
        weights = np.array([self.shares.get(one, 1.0) for one in names])
        drawn = np.searchsorted(np.cumsum(weights) / weights.sum(), rng.random(), side="right")
        kind = self.kinds[names[min(int(drawn), len(names) - 1)]]
        controller = individual(kind, speed, radius)
        body: Robot = cast(Any, controller).robot
        return RobotAgent(name, body, controller, path, speed, person=True)


@runtime_checkable
class Hurrying(Protocol):
    """A controller that may drive faster than its reference speed."""

    @property
    @abstractmethod
    def haste(self) -> float:
        """Highest speed over the reference speed."""


def individual(kind: Controller, speed: float, radius: float) -> Controller:
    """Return a copy of a controller for a body of this radius that likes this speed."""
    body: Any = cast(Any, kind).robot
    fastest = speed * (kind.haste if isinstance(kind, Hurrying) else 1.0)
    settings = {f.name: getattr(kind, f.name) for f in fields(cast(Any, kind)) if f.init}
    settings["robot"] = replace(body, radius=radius, max_speed=fastest)
    settings["reference_speed"] = speed
    return type(kind)(**settings)


def mix_of(kinds: Mapping[str, Mapping[str, Any]]) -> CrowdMix:
    """Build equal shares of registered controllers, each a holonomic disc without inertia.

    Parameters
    ----------
    kinds : name of a controller in the registry -> settings beside ``robot``.
    """
    body = {"type": "holonomic_velocity", "radius": 0.3}
    return CrowdMix(
        {
            name: build("controllers", {"type": name, "robot": body, **settings}, f"crowd.{name}")
            for name, settings in kinds.items()
        }
    )


def _check_kind(name: str, kind: Controller) -> None:
    """Refuse a controller that cannot be made into a person."""
    has: set[str] = {f.name for f in fields(kind)} if is_dataclass(kind) else set()
    missing = sorted({"robot", "reference_speed"} - has)
    if missing:
        raise WideberthError(
            f"crowd.kinds.{name}: {type(kind).__name__} has no field {' and '.join(missing)}; a "
            "person is a controller whose robot and reference speed can be set"
        )
    body = cast(Any, kind).robot
    if "max_speed" not in {f.name for f in fields(body)}:
        raise WideberthError(
            f"crowd.kinds.{name}: its robot {type(body).__name__} has no field max_speed, by "
            "which a person's own speed is set; take holonomic_velocity, say"
        )
