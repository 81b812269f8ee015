"""What editors and type checkers know about names; `make lint` checks this file with pyright."""

# pyright: reportUnnecessaryTypeIgnoreComment=true

from typing import assert_type

from wideberth import Predictor, build, load, predictors, register
from wideberth.framework import Robot
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


def misspelt() -> None:
    """Every line is an error for a type checker, and would be one at run time."""
    predictors.Kalmann()  # pyright: ignore[reportAttributeAccessIssue]
    Kalman(sped=0.3)  # pyright: ignore[reportCallIssue]
    assert build("predictors", "kalman").sped  # pyright: ignore[reportAttributeAccessIssue]
