"""Fit predictors to recordings, and say what they were fitted to."""

from collections.abc import Sequence

from ...framework import Fittable, Predictor, Tracks, WideberthError

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
