"""Fit of a predictor's parameters to recordings by the likelihood of its forecasts."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias, TypeVar

import numpy as np

from ...framework.plugins.registry import name_of
from ...framework.predictor import Predictor
from ...framework.values.arrays import Array
from ...framework.values.tracks import Tracks
from ...metrics.scoring import negative_log_likelihood
from ..data.windows import Windows, windows_of

OBSERVED, PREDICTED = 8, 12
"""Samples of the windows that are fitted to."""
WANTED, ENOUGH = 20, 400
"""Fewest windows to fit to, and about how many to use of one recording."""
FLOOR = 0.01
"""m, added to all deviations, so that standing people do not outweigh all others."""
FACTORS = (4.0, 2.0, 1.4, 1.2)
"""Steps of the search, large ones first."""
GAIN = 1e-4
"""nat; a smaller gain ends the search with one factor."""

Powers: TypeAlias = Mapping[str, float]
"""From names of fields to the powers of a factor by which they are multiplied."""

Fitted = TypeVar("Fitted", bound=Predictor)


def fit_numbers(
    predictor: Fitted, directions: Sequence[Powers], dataset: Sequence[Tracks]
) -> Fitted:
    """Return a copy with the parameters of largest likelihood on the given windows.

    Minimised is the mean over recordings of the mean over windows and steps of
    -log p(x_h), with 8 samples observed and 12 predicted. (The likelihood of the next sample
    alone, usual for filters, is not what a planner needs.) From the numbers the predictor
    has, each round tries factor^(+-power) along every direction and goes on from the best;
    when none gains, the factor shrinks.

    Parameters
    ----------
    predictor : a frozen dataclass with positive numbers.
    directions : which of them to multiply together. Few: what is fitted to one place may not
        hold at the next.
    dataset : recordings, see `Fittable.fit`.

    Raises
    ------
    WideberthError : fewer than 20 windows, or recordings of different dimensions.
    """
    who = name_of("predictors", type(predictor))
    found = windows_of(dataset, OBSERVED, PREDICTED, wanted=WANTED, who=who)
    windows = [_thinned(part) for part in found if len(part)]
    best, loss = predictor, _loss(predictor, windows)
    for factor in FACTORS:
        while True:
            nearby = [
                _multiplied(best, powers, step)
                for powers in directions
                for step in (factor, 1.0 / factor)
            ]
            losses = [_loss(other, windows) for other in nearby]
            place = int(np.argmin(losses))
            if not losses[place] < loss - GAIN:
                break
            best, loss = nearby[place], losses[place]
    return best


def _multiplied(predictor: Fitted, powers: Powers, factor: float) -> Fitted:
    """Return a copy with the named fields multiplied by powers of a factor."""
    plain: Any = predictor
    changed = {name: getattr(plain, name) * factor**power for name, power in powers.items()}
    copy: Fitted = replace(plain, **changed)
    return copy


def _loss(predictor: Predictor, windows: list[tuple[Tracks, Array]]) -> float:
    """Negative log likelihood of the futures, nat per step, mean of the recordings' means."""
    losses = []
    for tracks, future in windows:
        said = predictor.predict(tracks, PREDICTED)
        given = said.mean, said.covariance, said.weight
        losses.append(negative_log_likelihood(*given, future, FLOOR).mean())
    return float(np.mean(losses))


def _thinned(windows: Windows) -> tuple[Tracks, Array]:
    """Tracks and futures of evenly spaced windows, not many more than `ENOUGH`."""
    kept = list(range(0, len(windows), max(len(windows) // ENOUGH, 1)))
    return windows.tracks.select(kept), windows.future[kept]
