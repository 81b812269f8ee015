"""The frame in which a robot believes, and the world's."""

from dataclasses import dataclass, replace
from math import cos, sin
from typing import TypeVar, final

import numpy as np

from ...framework.robot import Robot
from ...framework.values.arrays import Array
from ...framework.values.forecast import Forecast
from ...framework.values.motion import Pose
from ...framework.values.path import Path
from ...framework.values.plan import Breach, GivenWay, Plan

T = TypeVar("T", Breach, GivenWay)


@final
@dataclass(frozen=True, eq=False)
class RigidMotion:
    """A turn about the origin and a shift after it: p -> R(angle) p + shift.

    Attributes
    ----------
    angle : rad.
    shift : (2,), m.
    """

    angle: float
    shift: Array

    @classmethod
    def between(cls, pose: Array, other: Array) -> "RigidMotion":
        """Return the motion that brings one pose (3,), m and rad, to another."""
        angle = float(other[2] - pose[2])
        return cls(angle, other[:2] - _turn(angle) @ pose[:2])

    def points(self, places: Array) -> Array:
        """Move points, (..., 2), m."""
        return np.asarray(places @ _turn(self.angle).T + self.shift)

    def covariances(self, matrices: Array) -> Array:
        """Turn covariances of positions, (..., 2, 2), m^2."""
        turn = _turn(self.angle)
        return np.asarray(turn @ matrices @ turn.T)

    def forecast(self, forecast: Forecast) -> Forecast:
        """Move a forecast; its joint covariance over the horizon is left out."""
        return replace(
            forecast,
            mean=self.points(forecast.mean),
            covariance=self.covariances(forecast.covariance),
            joint_source=None,
        )

    def plan(self, plan: Plan, robot: Robot, names: dict[str, str]) -> Plan:
        """Move a plan, and call its obstacles by other names.

        Parameters
        ----------
        plan : of a robot in the plane.
        robot : whose states it holds.
        names : identity -> what it is called; one that is missing keeps its own.
        """
        columns = tuple(plan.states.T)
        pose = robot.pose(columns)
        twist = robot.twist(columns, (0.0,) * len(robot.inputs))
        moved = Pose(tuple(self.points(pose.points()).T), np.asarray(pose.heading) + self.angle)
        states = np.stack(
            [np.broadcast_to(v, len(plan.states)) for v in robot.state_at(moved, twist)]
        )
        situation = plan.situation
        if situation is not None:
            path = situation.path
            situation = replace(
                situation,
                heading=situation.heading + self.angle,
                path=None if path is None else Path(self.points(path.points)),
            )
        return replace(
            plan,
            states=np.asarray(states.T, dtype=np.float64),
            positions=self.points(plan.positions),
            reference=self.points(plan.reference),
            forecast=None if plan.forecast is None else self.forecast(plan.forecast),
            ids=_called(plan.ids, names),
            tracked=_called(plan.tracked, names),
            left_out=_called(plan.left_out, names),
            given_way=_renamed(plan.given_way, names),
            breach=_renamed(plan.breach, names),
            situation=situation,
        )


def _turn(angle: float) -> Array:
    return np.array([[cos(angle), -sin(angle)], [sin(angle), cos(angle)]])


def _called(idents: tuple[str, ...], names: dict[str, str]) -> tuple[str, ...]:
    return tuple(names.get(ident, ident) for ident in idents)


def _renamed(named: T | None, names: dict[str, str]) -> T | None:
    return None if named is None else replace(named, name=names.get(named.name, named.name))
