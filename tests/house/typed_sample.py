"""What editors and type checkers know about names; `make lint` checks this file with pyright."""

# pyright: strict, reportUnnecessaryTypeIgnoreComment=true

from typing import assert_type

import numpy as np

import wideberth
from wideberth import (
    Detection,
    Forecast,
    Observation,
    OccupancyGrid,
    Path,
    Plan,
    Polygon,
    Predictor,
    Tracks,
    build,
    load,
    predictors,
    register,
)
from wideberth.framework import Robot
from wideberth.framework.values.arrays import Array
from wideberth.predictors import Kalman
from wideberth.regions import MahalanobisEllipse, Park
from wideberth.robots import Unicycle


def sample() -> None:
    """Use names in the ways that a script does; it is not run."""

    @register("regions", "sample")
    class Sample:
        size = 1.0

    kalman = build("predictors", "kalman")
    assert_type(kalman, Kalman)
    assert_type(kalman.speed, float)
    assert_type(build("region", "park"), Park)
    assert_type(build("predictors", {"type": "kalman"}), Predictor)
    assert_type(build("robots", "my_lab.robots:Box" if kalman.speed < 0 else "unicycle"), Robot)
    assert_type(load("robots", "unicycle"), type[Unicycle])
    assert_type(predictors.Kalman(speed=0.3), Kalman)
    assert_type(Sample().size, float)
    assert MahalanobisEllipse().relation


def lists() -> None:
    """Constructors take lists, and their fields are arrays."""
    assert_type(Path([(0, 0), (12, 0)]).points, Array)
    person = Detection("person", [6.0, 0.5], [[1e-4, 0], [0, 1e-4]], 0.3, velocity=(0, 0.8))
    assert_type(person.position, Array)
    assert_type(person.velocity, Array | None)
    wall = Polygon([(0, 0), (1, 0), (1, 1)], "wall")
    observation = Observation(0.0, [0, 0, 0, 1.0, 0], [person], polygons=[wall])
    assert_type(observation.state, Array)
    assert_type(observation.detections, tuple[Detection, ...])
    tracks = Tracks([[[0, 0], [1, 0]]], 0.5, ["person"], [0.3], 1e-4 * np.eye(2)[None])
    assert_type(tracks.radius, Array)
    assert_type(tracks.ids, tuple[str, ...])
    forecast = Forecast([[[[1, 0]]]], [[[[[1, 0], [0, 1]]]]], [[1]], 0.5, [None])
    assert_type(forecast.mean, Array)
    assert_type(OccupancyGrid([[0, 100]], 0.5, [0, 0]).origin, tuple[float, float])
    planner = wideberth.recommended("unicycle")
    planner.command(observation)
    assert_type(planner.plan, Plan)


def misspelt() -> None:
    """Every line is an error for a type checker, and would be one at run time."""
    Path(12.0, 0.0)  # pyright: ignore[reportCallIssue]
    Path({"x": 0.0})  # pyright: ignore[reportArgumentType]
    Detection("person", (6, 0.5), None, "wide")  # pyright: ignore[reportArgumentType]
    Observation(0.0, None)  # pyright: ignore[reportArgumentType]
    plan = wideberth.recommended().plan
    assert plan.rungs  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
    assert wideberth.recommended().last_plan.rung  # pyright: ignore[reportOptionalMemberAccess]
    predictors.Kalmann()  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
    Kalman(sped=0.3)  # pyright: ignore[reportCallIssue]
    kalman = build("predictors", "kalman")
    assert kalman.sped  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
