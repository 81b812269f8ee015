"""Fit predictors to recordings, and say what they were fitted to."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from ...framework import Fittable, Predictor, Tracks, WideberthError
from ...framework.plugins.extras import check_extra

AS_GIVEN, NOTHING, FITTED, UNFITTED = "as given", "nothing to fit", "fitted to", "not fitted"
"""Texts of the tables' column ``fitted``, or how they begin."""


def fitted(
    predictor: Predictor, training: Sequence[Tracks], lacking: str = ""
) -> tuple[Predictor, str]:
    """Return a predictor that has learnt from recordings, and what it was fitted to.

    One that cannot be fitted to them stays as it is, and the text says why.

    Parameters
    ----------
    predictor : to be fitted.
    training : recordings, none of which it is scored on.
    lacking : what was left out of them, in words.
    """
    if not isinstance(predictor, Fittable):
        return predictor, NOTHING
    if not training:
        return predictor, f"{UNFITTED}: no other scene{lacking}"
    try:
        after = predictor.fit(training)
    except WideberthError as error:
        return predictor, f"{UNFITTED}: {error}{lacking}"
    plural = "s" if len(training) > 1 else ""
    return after, NOTHING if after == predictor else (
        f"{FITTED} {len(training)} recording{plural}{lacking}"
    )


def check_fit(predictor: Predictor, otherwise: str = "") -> None:
    """Refuse a predictor whose fit, or that of one within it, lacks a library; before any work.

    Raises
    ------
    WideberthError : names the extra; it ends with ``otherwise``, what can be done without.
    """
    if isinstance(predictor, Fittable) and predictor.fit_needs is not None:
        check_extra(*predictor.fit_needs, otherwise)
    for field in fields(predictor):  # type: ignore[arg-type]
        value = getattr(predictor, field.name)
        for one, _ in inside(value, value):
            check_fit(one, otherwise)


def inside(before: Any, after: Any) -> Iterator[tuple[Predictor, Predictor]]:
    """Yield pairs of the predictors that a setting holds before and after."""
    if isinstance(before, Predictor):
        yield before, after
    elif isinstance(before, Mapping):
        for key, entry in before.items():
            yield from inside(entry, after[key])
    elif isinstance(before, list | tuple):
        for old, new in zip(before, after, strict=True):
            yield from inside(old, new)
    elif is_dataclass(before) and not isinstance(before, type) and after is not None:
        for field in fields(before):
            yield from inside(getattr(before, field.name), getattr(after, field.name))
