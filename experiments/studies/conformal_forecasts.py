"""Forecasts that were published as files, as a predictor."""

import io
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar, TypeAlias, final

import numpy as np

from ...framework.plugins.io import read_bytes
from ...framework.predictor import Predictor
from ...framework.values.arrays import Array, checked
from ...framework.values.errors import WideberthError
from ...framework.values.forecast import Forecast, Scene
from ...framework.values.tracks import Tracks

ByRow: TypeAlias = Mapping[int, Mapping[str, Array]]
"""Row of a recording -> identity -> positions at the next rows, (N, 2), m."""

LARGEST = 500 * 2**20
"""Bytes of a file."""
_ADMITTED = {
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    *((f"numpy.{core}.multiarray", name) for core in ("core", "_core")
      for name in ("_reconstruct", "scalar")),
}  # fmt: skip


class _Arrays(pickle.Unpickler):
    """Reads arrays and plain containers, and refuses to run anything else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return what rebuilds an array.

        Raises
        ------
        pickle.UnpicklingError : anything else.
        """
        if (module, name) not in _ADMITTED:
            raise pickle.UnpicklingError(f"it would run {module}.{name}")
        return super().find_class(module, name)


@lru_cache(maxsize=8)
def read_forecasts(file: str) -> ByRow:
    """Read forecasts of a recording.

    Parameters
    ----------
    file : ``.npz`` with ``row`` (K,), ``person`` (K,) and ``forecast`` (K, N, 2), m; or ``.pkl``
        with a mapping "prediction": row -> person -> (N, 2), m, of arrays and plain containers
        alone.

    Raises
    ------
    WideberthError : no such file, or something else in it.
    """
    raw = read_bytes(Path(file), LARGEST)
    wanted = "wanted an .npz of row, person and forecast, or a .pkl of arrays by row and person"
    try:
        if file.endswith(".npz"):
            with np.load(io.BytesIO(raw), allow_pickle=False) as arrays:
                found: dict[int, dict[Any, Any]] = {}
                for row, person, ahead in zip(
                    *(arrays[name] for name in ("row", "person", "forecast")), strict=True
                ):
                    found.setdefault(int(row), {})[person] = ahead
        else:
            found = _Arrays(io.BytesIO(raw)).load()["prediction"]
        return {
            int(row): {
                str(person): checked("forecast", np.asarray(ahead), (None, 2))
                for person, ahead in people.items()
            }
            for row, people in found.items()
        }
    except Exception as error:  # a file may hold anything
        raise WideberthError(f"{file} holds no forecasts ({error}); {wanted}") from error


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
