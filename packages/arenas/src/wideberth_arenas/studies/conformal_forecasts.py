"""Forecasts that were published as files, as a predictor."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import ClassVar, TypeAlias, final

from wideberth.framework.plugins.io import read_arrays, read_bytes
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.arrays import Array, checked
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Forecast, Scene
from wideberth.framework.values.tracks import Tracks

ByRow: TypeAlias = Mapping[int, Mapping[str, Array]]
"""Row of a recording -> identity -> positions at the next rows, (N, 2), m."""

LARGEST = 500 * 2**20
"""Bytes of a file."""


@lru_cache(maxsize=8)
def read_forecasts(file: str) -> ByRow:
    """Read forecasts of a recording.

    Parameters
    ----------
    file : ``.npz`` with ``row`` (K,), ``person`` (K,) and ``forecast`` (K, N, 2), m.

    Raises
    ------
    WideberthError : no such file, or something else in it.
    """
    arrays = read_arrays(read_bytes(Path(file), LARGEST), file)
    found: dict[int, dict[str, Array]] = {}
    try:
        columns = (arrays[name] for name in ("row", "person", "forecast"))
        for row, person, ahead in zip(*columns, strict=True):
            forecast = checked("forecast", ahead, (None, 2))
            found.setdefault(int(row), {})[str(person)] = forecast
    except (KeyError, TypeError, ValueError) as error:
        raise WideberthError(
            f"{file} holds no forecasts ({error}); wanted arrays row, person and forecast"
        ) from error
    return found


@final
@dataclass(frozen=True)
class PublishedForecasts(Predictor):
    """Takes forecasts from a file, and another predictor's where it has none.

    The row is that of the newest sample, counted from time 0 in steps of the tracks. The file
    states no spread: the covariances are the other predictor's.

    Parameters
    ----------
    file : see `read_forecasts`. otherwise : the other predictor.
    """

    reference: ClassVar[str] = ""

    file: str
    otherwise: Predictor

    def predict(self, tracks: Tracks, steps: int, scene: Scene | None = None) -> Forecast:
        """Forecast all obstacles; see `Predictor.predict`."""
        known = self.otherwise.predict(tracks, steps, scene)
        people = read_forecasts(self.file).get(round(tracks.stamp / tracks.dt), {})
        mean = known.mean.copy()
        for i, name in enumerate(tracks.ids):
            if len(ahead := people.get(name, ())) >= steps:
                mean[i] = ahead[:steps]
        return Forecast(mean, known.covariance, known.weight, known.dt, known.fallback)
