"""What the planner in C has, and the refusal by name of what it lacks."""

from collections.abc import Callable
from typing import Any

from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.plugins.config import describe
from wideberth.framework.robot import SymbolicDrive
from wideberth.framework.values.errors import WideberthError
from wideberth.solvers.export.constants import planner_constants

CORNERS = int(planner_constants()["CORNERS"])
"""Vertices of a polygon, at most."""
RUNG_NAMES = {
    "optimal": "OPTIMAL", "feasible iterate": "FEASIBLE", "shifted last plan": "SHIFTED",
    "least violation": "LEAST", "brake": "BRAKE",
}  # fmt: skip
"""Rung of the ladder that is in C -> its name there."""
SUPPORTED = {
    "robot": "unicycle without a footprint, or another SymbolicDrive with a heading in the plane",
    "predictor": "kalman",
    "region": "mahalanobis_ellipse",
    "static_region": "separating_line, or none",
    "level": "fixed, discounted, relaxed, paper",
    "cost": "tracking",
    "solver": "riccati",
    "deadline": "none",
    "latency": "0",
    "further_kinds": "none",
    "fallback.rungs": "the built-in ones",
    "fallback.stop_at_end": "false",
}  # fmt: skip
"""Setting of the planner -> what of it is in C; every other setting may have any value."""
_LEVELS = ("fixed", "discounted", "relaxed", "paper")


def refuse(planner: Planner, corners: int, path: str) -> SymbolicDrive:
    """Refuse a planner of which the C library lacks something; return its robot.

    Parameters
    ----------
    planner, corners : what is exported, and vertices of its polygons.
    path : dotted path of the planner in its config, for messages.

    Raises
    ------
    WideberthError : another predictor than `kalman`, with the setting to write instead; otherwise
        names every setting that the library lacks, and lists what it has.
    """
    predictor = _type(planner.predictor)
    if predictor != "kalman":
        raise WideberthError(
            f"{path}.predictor is {predictor}; the exported planner forecasts with kalman: write "
            f"`predictor: kalman` there, or give --set {path}.predictor=kalman"
        )
    lacks = [
        f"{name} is {shown(planner)}"
        for name, (here, shown) in _RULES.items()
        if not here(planner)
    ]
    if planner.static_region is not None and corners != CORNERS:
        lacks.append(f"corners is {corners}, and in C polygons have up to {CORNERS}")
    robot = planner.robot
    if lacks or not isinstance(robot, SymbolicDrive):
        known = "; ".join(f"{name}: {words}" for name, words in SUPPORTED.items())
        raise WideberthError(
            f"the planner in C lacks what this one needs: {'; '.join(lacks)}. It has {known}"
        )
    return robot


def _type(plugin: Any) -> str:
    return "" if plugin is None else str(describe(plugin).get("type", type(plugin).__name__))


def _robot_fits(planner: Planner) -> bool:
    robot = planner.robot
    fits = isinstance(robot, SymbolicDrive) and robot.dimension == 2 and robot.footprint is None
    return fits and robot.pose((0.0,) * len(robot.states)).heading is not None


def _of(name: str, *known: str) -> "_Rule":
    """Return the rule that a plug-in is one of some by name, "" for none at all."""
    return (
        lambda planner: _type(getattr(planner, name)) in known,
        lambda planner: _type(getattr(planner, name)),
    )


def _equal(name: str, value: Any) -> "_Rule":
    return (
        lambda planner: getattr(planner, name) == value,
        lambda planner: repr(getattr(planner, name)),
    )


_Rule = tuple[Callable[[Planner], bool], Callable[[Planner], str]]
_RULES: dict[str, _Rule] = {
    "robot": (_robot_fits, lambda planner: str(describe(planner.robot))),
    "region": _of("region", "mahalanobis_ellipse"),
    "static_region": _of("static_region", "", "separating_line"),
    "level": _of("level", *_LEVELS),
    "cost": _of("cost", "tracking"),
    "solver": _of("solver", "riccati"),
    "deadline": _equal("deadline", None),
    "latency": _equal("latency", 0.0),
    "further_kinds": _equal("further_kinds", ()),
    "expected_contact": _equal("expected_contact", None),
    "fallback.rungs": (
        lambda planner: set(planner.fallback.rungs) <= set(RUNG_NAMES),
        lambda planner: str(planner.fallback.rungs),
    ),
    "fallback.stop_at_end": (
        lambda planner: not planner.fallback.stop_at_end,
        lambda planner: str(planner.fallback.stop_at_end),
    ),
}
"""Whether the library has what a planner needs, and what that is."""
