"""A layer of a costmap that shows where people may be within a horizon."""

from dataclasses import dataclass, field
from typing import final

from wideberth.framework.predictor import Predictor
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.costmap import Costmap
from wideberth.framework.values.forecast import Forecast
from wideberth.predictors.core.forecaster import Forecaster

from ..forecast_cells import ForecastCells


@final
@dataclass(frozen=True, eq=False)
class ForecastLayer:
    """Forecasts of people as a layer of Nav2's costmaps, beside what rays show of them now.

    It is the static layer over the grid that ``wideberth forecast`` publishes, with
    ``trinary_costmap: false``, ``use_maximum: true`` and ``footprint_clearing_enabled: true``.

    Parameters
    ----------
    predictor : of the people.
    cells : that a forecast covers.
    """

    predictor: Predictor
    cells: ForecastCells = field(default_factory=ForecastCells)

    def begun(self, period: float) -> Forecaster:
        """Return what remembers people who are seen each period, s."""
        return Forecaster(self.predictor, period)

    def shown(self, people: Forecaster, now: float) -> "ShownForecast | None":
        """Return what the layer shows at a time, s; None where no one is known."""
        found = people.at(now, self.cells.times)
        if found is None:
            return None
        tracks, forecast = found
        return ShownForecast(self.cells, forecast, tracks.radius)


@final
@dataclass(frozen=True, eq=False)
class ShownForecast:
    """A forecast that costmaps show.

    Attributes
    ----------
    cells : that it covers. forecast : of O people. radii : (O,), m.
    """

    cells: ForecastCells
    forecast: Forecast
    radii: Array

    def costs(self, grid: Costmap) -> Costmap:
        """Return the costs on the cells of a costmap, which is not inflated."""
        shown = self.cells.on(grid, self.forecast, self.radii)
        return Costmap.from_grid(shown, lethal_threshold=100, trinary=False)
