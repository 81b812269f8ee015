"""`check_predictor` fits what learns: a broken fit, and one that cannot be saved, are named."""

from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np
import pytest

from wideberth.framework.predictor import Fittable
from wideberth.framework.testing.predictor import check_predictor
from wideberth.framework.testing.predictor_cases import draw_recordings
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.predictors.data.windows import windows_of
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.static import Static

NUMBERS = count()


class Still(Fittable):
    """Predicts as `Static` does, so that its fit alone is at fault."""

    def predict(self, tracks: Any, steps: int, scene: Scene | None = None) -> Forecast:
        return Static().predict(tracks, steps, scene)


@dataclass(frozen=True)
class Same(Still):
    """Keeps the laws, and finds what it was told."""

    def fit(self, dataset: Any) -> Any:
        return self


@dataclass(frozen=True)
class Absent(Still):
    """Looks for what is not there."""

    def fit(self, dataset: Any) -> Any:
        raise KeyError("rows")


@dataclass(frozen=True)
class Hungry(Still):
    """Wants longer windows than the usual recordings of the check have."""

    observed: int = 100

    def fit(self, dataset: Any) -> Any:
        windows_of(dataset, self.observed, 12, wanted=10, who="hungry")
        return replace(self)


@dataclass(frozen=True)
class Silent(Still):
    """Forgets its return."""

    def fit(self, dataset: Any) -> Any:
        replace(self)


@dataclass(frozen=True)
class Other(Still):
    """Returns another kind."""

    def fit(self, dataset: Any) -> Any:
        return Kalman()


@dataclass(frozen=True)
class Inward(Still):
    """Changes itself."""

    people: tuple[int, ...] = ()

    def fit(self, dataset: Any) -> Any:
        object.__setattr__(self, "people", (len(dataset),))
        return replace(self)


@dataclass(frozen=True)
class Restless(Still):
    """Learns something else each time."""

    drawn: int = 0

    def fit(self, dataset: Any) -> Any:
        return replace(self, drawn=next(NUMBERS))


@dataclass(frozen=True)
class Arrayed(Still):
    """Holds an array where a config could not set one."""

    mean: Array | None = None

    def fit(self, dataset: Any) -> Any:
        return replace(self, mean=np.ones(2))


@dataclass(frozen=True)
class Loose(Still):
    """Holds an array of which the file keeps a list, with which it cannot predict."""

    step: Any = None

    def fit(self, dataset: Any) -> Any:
        return replace(self, step=np.array([0.5, 0.5]))

    def predict(self, tracks: Any, steps: int, scene: Scene | None = None) -> Forecast:
        forecast = Static().predict(tracks, steps, scene)
        wide = 1.0 if self.step is None else (self.step * 2.0).max()
        return replace(forecast, covariance=wide * forecast.covariance, joint_source=None)


@dataclass(frozen=True)
class Hidden(Still):
    """Keeps what it has learnt beside its fields, where no file sees it."""

    def fit(self, dataset: Any) -> Any:
        copy = replace(self)
        object.__setattr__(copy, "spread", 4.0)
        return copy

    def predict(self, tracks: Any, steps: int, scene: Scene | None = None) -> Forecast:
        forecast = Static().predict(tracks, steps, scene)
        wide = getattr(self, "spread", 1.0)
        return replace(forecast, covariance=wide * forecast.covariance, joint_source=None)


@dataclass(frozen=True)
class Ruined(Still):
    """Predicts well until it is fitted."""

    fitted: bool = False

    def fit(self, dataset: Any) -> Any:
        return replace(self, fitted=True)

    def predict(self, tracks: Any, steps: int, scene: Scene | None = None) -> Forecast:
        if self.fitted:
            raise ValueError("no numbers")
        return Static().predict(tracks, steps, scene)


@pytest.mark.parametrize(
    ("predictor", "law"),
    [
        (Absent(), "fit raised KeyError: 'rows'"),
        (Hungry(300), "hold 0 windows .* give check_predictor a dataset"),
        (Silent(), "fit returns its own kind: Silent, not None"),
        (Other(), "fit returns its own kind: Other, not Kalman"),
        (Inward(), "fit leaves the predictor as it was"),
        (Restless(), "fit is pure"),
        (Arrayed(), "can be saved: .*mean.*arrays are kept as tuples"),
        (Loose(), "predict raised TypeError.*as saved and built again"),
        (Hidden(), "another forecast: step 1 of .*, fitted, as saved and built again"),
        (Ruined(), "predict raised ValueError: no numbers"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_the_check_names_what_is_wrong_with_a_fit(predictor: Still, law: str) -> None:
    with pytest.raises(AssertionError, match=law):
        check_predictor(predictor, dimensions=(2,))
    check_predictor(predictor, dimensions=(2,), dataset=())  # without its fit it keeps the laws


@pytest.mark.parametrize("size", [2, 3])
def test_a_fit_that_finds_what_it_was_told_breaks_no_law(size: int) -> None:
    check_predictor(Same(), dimensions=(size,))


def test_a_fit_that_refuses_short_recordings_is_given_longer_ones_unless_they_are_given() -> None:
    check_predictor(Hungry(), dimensions=(2,))
    with pytest.raises(AssertionError, match="hold 0 windows"):
        check_predictor(
            Hungry(), dimensions=(2,), dataset=draw_recordings(2, np.random.default_rng(0))
        )


@pytest.mark.parametrize("size", [2, 3])
def test_the_recordings_of_the_check_are_proper(size: int) -> None:
    drawn = draw_recordings(size, np.random.default_rng(0))
    assert all(scene.dimension == size for scene in drawn)
    found = windows_of(drawn, 8, 12, wanted=100, who="test")  # what the built-in ones want
    assert sum(map(len, found)) > 500
    assert any(np.isnan(scene.positions).any() for scene in drawn)
    speeds = np.concatenate([np.diff(scene.positions, axis=1) for scene in drawn]) / 0.4
    assert 0.3 < np.nanmedian(np.linalg.norm(speeds, axis=2)) < 2.0
