"""The laws of `Predictor`, as a check that any predictor can be put through."""

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ..plugins.config import rebuilt
from ..predictor import Adaptive, Fittable, Predictor
from ..values.errors import WideberthError
from ..values.forecast import Forecast, Scene
from ..values.tracks import Tracks
from .predictor_cases import (
    ABSURD,
    NEVER,
    STEPS,
    absurd_worlds,
    draw_recordings,
    draw_rotation,
    draw_run,
    draw_scene,
    draw_tracks,
    move_scene,
    move_tracks,
    odd_worlds,
)

TOLERANCE = 1e-6


def check_predictor(
    predictor: Predictor,
    *,
    dimensions: Iterable[int] = (2, 3),
    rng: np.random.Generator | None = None,
    dataset: Sequence[Tracks] | None = None,
) -> None:
    """Hold a predictor to its laws, on ordinary and on degenerate tracks.

    The laws: the right shapes; finite; covariances symmetric and PSD, and the diagonal blocks
    of the joint covariance where there is one; pure; no exception and no warning of NumPy
    for any history, step or noise; a reason for an obstacle never observed; equivariant to
    turning and shifting tracks and scene together (not for an obstacle never observed:
    nothing of it could turn); independent of the order of the obstacles; zero obstacles are
    served; so are positions, noise and radii of any magnitude that a float holds, and but for
    the radius they change nothing for the other obstacles. One that adapts keeps its laws
    while it is updated, and no copy changes another. One that learns is fitted: `fit` leaves it
    as it was, returns its own kind, the same when called again; the fitted copy keeps the same
    laws and survives `save_plugin`.

    Parameters
    ----------
    predictor : to be checked.
    dimensions : D to try.
    rng : for the random tracks; seeded with 0 by default.
    dataset : recordings that a predictor which learns is fitted to, twice. By default two in
        the plane with twelve people each, 60 rows of 0.4 s. ``()`` leaves `fit` out, where a
        training is long.

    Raises
    ------
    AssertionError : names the law that is broken, and where.

    Examples
    --------
    >>> from wideberth.predictors.static import Static
    >>> check_predictor(Static())
    """
    generator = np.random.default_rng(0) if rng is None else rng
    sizes = tuple(dimensions)
    for size in sizes:
        tracks = draw_tracks(size, generator)
        scene = draw_scene(tracks, generator)
        for given in (None, scene):
            where = f"D = {size}, {'without' if given is None else 'with'} scene"
            forecast = _predict(predictor, tracks, given, where)
            _check_values(forecast, tracks, where)
            _check_purity(predictor, tracks, given, forecast, where)
            _check_motion(predictor, tracks, given, forecast, generator, where)
            _check_order(predictor, tracks, given, forecast, generator, where)
        _check_odd(predictor, tracks, f"D = {size}")
        _check_magnitudes(predictor, tracks, generator, f"D = {size}")
        if isinstance(predictor, Adaptive):
            _check_updates(predictor, tracks, f"D = {size}")
    if isinstance(predictor, Fittable):
        if dataset is None:
            dataset = draw_recordings(2 if 2 in sizes else sizes[0], generator)
        if dataset:
            _check_fit(predictor, dataset, sizes, generator)


def _predict(predictor: Predictor, tracks: Tracks, scene: Scene | None, where: str) -> Forecast:
    """Predict, turning an exception or a warning of NumPy into a broken law."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            forecast = predictor.predict(tracks, STEPS, scene)
    except Exception as error:
        names = ", ".join(tracks.ids)
        raise AssertionError(
            f"never raises: {type(error).__name__}: {error} ({where}; tracks: {names})"
        ) from error
    assert isinstance(forecast, Forecast), f"returns a Forecast: got {type(forecast)} ({where})"
    return forecast


def _check_values(forecast: Forecast, tracks: Tracks, where: str) -> None:
    """Check shapes, finite, symmetric, PSD."""
    count, size = len(tracks), tracks.dimension
    shape = forecast.mean.shape
    wanted = (count, shape[1], STEPS, size)
    assert shape == wanted, f"shape of mean: {shape}, wanted {wanted} ({where})"
    assert forecast.covariance.shape == (*wanted, size), f"shape of covariance ({where})"
    assert forecast.dt == tracks.dt, f"dt is that of the tracks: {forecast.dt} ({where})"
    assert len(forecast.fallback) == count, f"one fallback entry per obstacle ({where})"
    for index, ident in enumerate(tracks.ids):
        spread = forecast.covariance[index]
        place = f"track {ident!r}, {where}"
        assert np.isfinite(forecast.mean[index]).all(), f"finite mean: {place}"
        assert np.isfinite(spread).all(), f"finite covariance: {place}"
        uneven = np.abs(spread - np.swapaxes(spread, -1, -2)).max(initial=0.0)
        assert uneven <= 1e-9 * spread.max(initial=0.0), f"symmetric covariance: {place}"
        lowest = np.linalg.eigvalsh(spread).min(initial=0.0)
        assert lowest >= -1e-9 * spread.max(initial=0.0), f"PSD covariance: {place}: {lowest}"
        share = forecast.weight[index].sum()
        assert abs(share - 1) < 1e-9, f"weights sum to 1: {place}: {share}"
        unseen = not np.isfinite(tracks.positions[index]).all(axis=1).any()
        reason = forecast.fallback[index]
        assert reason or not unseen, f"a reason for an obstacle never observed: {place}"
    _check_joint(forecast, tracks, where)


def _check_joint(forecast: Forecast, tracks: Tracks, where: str) -> None:
    """Check that the joint covariance says of each step what the covariance says."""
    if forecast.joint is None:
        return
    count, modes, steps, size = forecast.mean.shape
    each = np.arange(steps)
    blocks = forecast.joint.reshape(count, modes, steps, size, steps, size)
    blocks = blocks[:, :, each, :, each].transpose(1, 2, 0, 3, 4)
    inner = (1, 2, 3, 4)
    gap = np.abs(blocks - forecast.covariance).max(axis=inner, initial=0.0)
    limit = TOLERANCE * forecast.covariance.max(axis=inner, initial=0.0)
    for ident, apart, allowed in zip(tracks.ids, gap, limit, strict=True):
        place = f"track {ident!r}, {where}"
        assert apart <= allowed, f"joint covariance: a step differs by {apart:.3g} m^2: {place}"


def _check_purity(
    predictor: Predictor, tracks: Tracks, scene: Scene | None, first: Forecast, where: str
) -> None:
    """Check that the same input gives the same forecast, and nothing given is changed."""
    before = tracks.positions.copy()
    again = _predict(predictor, tracks, scene, where)
    same = np.array_equal(first.mean, again.mean)
    same = same and np.array_equal(first.covariance, again.covariance)
    assert same, f"pure: a second call gives another forecast ({where})"
    assert np.array_equal(before, tracks.positions, equal_nan=True), f"tracks changed ({where})"


def _check_motion(
    predictor: Predictor,
    tracks: Tracks,
    scene: Scene | None,
    still: Forecast,
    rng: np.random.Generator,
    where: str,
) -> None:
    """Check that turning or shifting the world turns or shifts the forecast."""
    size = tracks.dimension
    turns = {"translation": np.eye(size), "rotation": draw_rotation(size, rng)}
    for law, turn in turns.items():
        shift = rng.normal(scale=50.0, size=size) * (law == "translation")
        other = None if scene is None else move_scene(scene, turn, shift)
        moved = _predict(predictor, move_tracks(tracks, turn, shift), other, where)
        mean = still.mean @ turn.T + shift
        spread = turn @ still.covariance @ turn.T
        for index, ident in enumerate(tracks.ids):
            if ident == NEVER:
                continue
            place = f"{law} equivariant: track {ident!r}, {where}"
            # Coordinates of 1e6 m have lost six digits before they get here.
            scale = 1.0 + np.abs(mean[index]).max() + np.sqrt(spread[index].max())
            gap = np.abs(mean[index] - moved.mean[index]).max()
            assert gap <= TOLERANCE * scale, f"{place}: mean differs by {gap:.3g} m"
            gap = np.abs(spread[index] - moved.covariance[index]).max()
            limit = TOLERANCE * (1.0 + spread[index].max())
            assert gap <= limit, f"{place}: covariance differs by {gap:.3g} m^2"


def _check_order(
    predictor: Predictor,
    tracks: Tracks,
    scene: Scene | None,
    first: Forecast,
    rng: np.random.Generator,
    where: str,
) -> None:
    """Check that what is said of an obstacle does not depend on its place in the list."""
    order = [int(i) for i in rng.permutation(len(tracks))]
    if scene is not None and scene.goals is not None:
        scene = replace(scene, goals=scene.goals[order])
    other = _predict(predictor, tracks.select(order), scene, where)
    for place, index in enumerate(order):
        gap = np.abs(other.mean[place] - first.mean[index]).max()
        scale = 1.0 + np.abs(first.mean[index]).max()
        name = tracks.ids[index]
        assert gap <= TOLERANCE * scale, f"order independent: track {name!r} ({where})"
        assert other.fallback[place] == first.fallback[index], (
            f"order independent: reason of track {name!r} ({where})"
        )


def _check_odd(predictor: Predictor, tracks: Tracks, where: str) -> None:
    """Check zero obstacles, histories of 0 to 3 rows, no noise, and odd time steps."""
    empty = _predict(predictor, tracks.select([]), None, f"no obstacles, {where}")
    assert len(empty.mean) == 0 and empty.steps == STEPS, f"zero obstacles ({where})"
    for name, world in odd_worlds(tracks).items():
        note = f"{name}, {where}"
        _check_values(_predict(predictor, world, None, note), world, note)


def _check_magnitudes(
    predictor: Predictor, tracks: Tracks, rng: np.random.Generator, where: str
) -> None:
    """Check that numbers of any magnitude are served, and that no one else suffers from them."""
    for name, world in absurd_worlds(tracks, rng).items():
        note = f"{name}, {where}"
        forecast = _predict(predictor, world, None, note)
        _check_values(forecast, world, note)
        if isinstance(predictor, Adaptive):
            updated = _updated(predictor, world, note)
            _check_values(_predict(updated, world, None, note), world, f"updated, {note}")
        if ABSURD not in world.ids or world.radius[-1] > 1.0:  # a giant is in everybody's way
            continue
        rest = world.select(list(range(len(world) - 1)))
        alone = _predict(predictor, rest, None, note)
        for index, ident in enumerate(rest.ids):
            place = f"an absurd obstacle is its own affair: track {ident!r}, {note}"
            assert forecast.fallback[index] == alone.fallback[index], place
            middles = (np.einsum("m,mnd->nd", said.weight[index], said.mean[index])
                       for said in (forecast, alone))  # fmt: skip
            gap = np.abs(np.subtract(*middles)).max()
            assert gap <= TOLERANCE * (1.0 + np.abs(alone.mean[index]).max()), place


def _check_updates(predictor: Adaptive, tracks: Tracks, where: str) -> None:
    """Check that updating keeps the laws, serves any tracks and changes no earlier copy."""
    before = _predict(predictor, tracks, None, where)
    current = predictor
    for seen in draw_run(tracks):
        current = _updated(current, seen, where)
    for name, world in {"zero obstacles": tracks.select([]), **odd_worlds(tracks)}.items():
        _updated(current, world, f"{name}, {where}")
    after = _predict(current, tracks, None, f"updated, {where}")
    _check_values(after, tracks, f"updated, {where}")
    _check_purity(current, tracks, None, after, f"updated, {where}")
    _check_purity(predictor, tracks, None, before, f"after updates of copies, {where}")


def _updated(predictor: Adaptive, tracks: Tracks, where: str) -> Adaptive:
    """Update, turning an exception or a warning of NumPy into a broken law."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            updated = predictor.update(tracks)
    except Exception as error:
        raise AssertionError(
            f"update never raises: {type(error).__name__}: {error} ({where})"
        ) from error
    assert type(updated) is type(predictor), f"update returns its own kind ({where})"
    return updated


def _check_fit(
    predictor: Fittable,
    dataset: Sequence[Tracks],
    sizes: tuple[int, ...],
    rng: np.random.Generator,
) -> None:
    """Check that a fitted copy keeps the laws and the predictor stays as it was."""
    tracks = draw_tracks(dataset[0].dimension, rng)
    told, before = repr(predictor), _predict(predictor, tracks, None, "before the fit")
    fitted = _fitted(predictor, dataset)
    assert repr(predictor) == told, "fit leaves the predictor as it was: its repr has changed"
    again = repr(_fitted(predictor, dataset))
    assert again == repr(fitted), "fit is pure: a second one learns something else"
    _check_purity(predictor, tracks, None, before, "after the fit of a copy")
    try:
        copy = rebuilt("predictors", fitted)
    except WideberthError as error:
        raise AssertionError(f"what fit returns can be saved: {error}") from error
    check_predictor(fitted, dimensions=sizes, rng=rng, dataset=())
    said = _predict(fitted, tracks, None, "fitted")
    _check_purity(copy, tracks, None, said, "fitted, as saved and built again")


def _fitted(predictor: Fittable, dataset: Sequence[Tracks]) -> Fittable:
    """Fit, turning an exception or something else than a fitted copy into a broken law."""
    try:
        fitted = predictor.fit(dataset)
    except Exception as error:
        raise AssertionError(
            f"fit never raises on a proper dataset: {type(error).__name__}: {error} (if it needs "
            "more or other recordings, give check_predictor a dataset)"
        ) from error
    same = type(fitted) is type(predictor)
    assert same, f"fit returns its own kind: {type(predictor).__name__}, not {fitted!r:.60}"
    return fitted
