"""The laws of `Predictor`, as a check that any predictor can be put through."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from ..plugins.config import rebuilt
from ..predictor import Adaptive, Fittable, Predictor
from ..values.arrays import Array
from ..values.errors import WideberthError
from ..values.forecast import Forecast, Scene
from ..values.tracks import Tracks
from .laws import Law, each, require
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
    AssertionError : names every law that does not hold, and where.

    Examples
    --------
    >>> from wideberth.predictors.static import Static
    >>> check_predictor(Static())
    """
    require(laws(predictor, dimensions=dimensions, rng=rng, dataset=dataset))


def laws(
    predictor: Predictor,
    *,
    dimensions: Iterable[int] = (2, 3),
    rng: np.random.Generator | None = None,
    dataset: Sequence[Tracks] | None = None,
) -> tuple[Law, ...]:
    """Return the laws of a predictor; the arguments are those of `check_predictor`."""
    generator = np.random.default_rng(0) if rng is None else rng
    sizes = tuple(dimensions)
    found = _plain_laws(lambda: predictor, isinstance(predictor, Adaptive), sizes, generator)
    if isinstance(predictor, Fittable):
        found += _fit_laws(predictor, dataset, sizes, generator)
    return found


def _plain_laws(
    made: Callable[[], Predictor],
    adapts: bool,
    sizes: tuple[int, ...],
    rng: np.random.Generator,
    label: str = "",
) -> tuple[Law, ...]:
    """Return the laws that a predictor keeps, fitted or not."""
    drawn, *seeds = rng.spawn(4)
    turning, ordering, absurd = seeds

    @cache
    def worlds() -> list[_World]:
        return [world for size in sizes for world in _worlds(made(), size, drawn)]

    def law(name: str, check: Callable[[_World], None], exception: str = "") -> Law:
        return Law(f"{label}{name}", each(check, worlds), exception)

    def bare() -> list[_World]:
        return [world for world in worlds() if world.scene is None]

    @cache
    def giants() -> list[_World]:
        return [_World(one.predictor, world, None, f"{name}, {one.where}") for one in bare()
                for name, world in absurd_worlds(one.tracks, absurd).items()]  # fmt: skip

    steady = "" if adapts else "it does not adapt"
    return (
        law("shapes, finite, symmetric, PSD", _check_world),
        law("pure", _check_pure),
        law("translation equivariant", _check_translation),
        law("rotation equivariant", partial(_check_rotation, rng=turning)),
        law("order independent", partial(_check_order, rng=ordering)),
        Law(f"{label}odd histories", each(_check_odd, bare)),
        Law(f"{label}numbers of any magnitude", each(_check_magnitude, giants)),
        Law(f"{label}an absurd obstacle changes no other", each(_check_apart, giants)),
        Law(f"{label}keeps its laws while it adapts", each(_check_updates, bare), steady),
    )


def _fit_laws(
    predictor: Fittable,
    dataset: Sequence[Tracks] | None,
    sizes: tuple[int, ...],
    rng: np.random.Generator,
) -> tuple[Law, ...]:
    """Return the laws of a predictor that learns, and those of what it returns."""
    left = "no recordings to fit to are given" if dataset is not None and not dataset else ""
    drawn, seed = rng.spawn(2)
    fits = _Fits(predictor, dataset, 2 if 2 in sizes else sizes[0], drawn)
    inner = _plain_laws(
        lambda: fits.fitted, isinstance(predictor, Adaptive), sizes, seed, label="fitted, "
    )
    return (
        Law("fit leaves the predictor as it was", fits.check_left_alone, left),
        Law("fit is pure", fits.check_pure, left),
        Law("what fit returns can be saved", fits.check_saved, left),
        *(replace(law, exception=left or law.exception) for law in inner),
    )


@dataclass(frozen=True, eq=False)
class _World:
    """A predictor with tracks of one dimension, with or without a scene."""

    predictor: Predictor
    tracks: Tracks
    scene: Scene | None
    where: str

    @cached_property
    def forecast(self) -> Forecast:
        return _predict(self.predictor, self.tracks, self.scene, self.where)


def _worlds(predictor: Predictor, size: int, rng: np.random.Generator) -> Iterator[_World]:
    tracks = draw_tracks(size, rng)
    scene = draw_scene(tracks, rng)
    yield _World(predictor, tracks, None, f"D = {size}, without scene")
    yield _World(predictor, tracks, scene, f"D = {size}, with scene")


def _check_world(world: _World) -> None:
    _check_values(world.forecast, world.tracks, world.where)


def _check_pure(world: _World) -> None:
    _check_purity(world.predictor, world.tracks, world.scene, world.forecast, world.where)


def _predict(predictor: Predictor, tracks: Tracks, scene: Scene | None, where: str) -> Forecast:
    """Predict, turning an exception or a warning of NumPy into a broken law."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            forecast = predictor.predict(tracks, STEPS, scene)
    except Exception as error:
        raise AssertionError(
            f"never raises: {type(error).__name__}: {error} "
            f"({where}; {_culprit(predictor, tracks)})"
        ) from error
    assert isinstance(forecast, Forecast), f"returns a Forecast: got {type(forecast)} ({where})"
    return forecast


def _culprit(predictor: Predictor, tracks: Tracks) -> str:
    """Name the first track that cannot be forecast alone; all where each can."""
    for index, ident in enumerate(tracks.ids):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", RuntimeWarning)
                predictor.predict(tracks.select([index]), STEPS)
        except Exception:
            return f"track {ident!r}, alone too"
    return f"tracks: {', '.join(tracks.ids)}"


def _step(wrong: Array) -> str:
    """Name the first step at which something is wrong, of flags (M, N)."""
    return f"step {int(np.argmax(wrong.any(axis=0))) + 1}"


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
        bad = ~np.isfinite(forecast.mean[index]).all(axis=-1)
        assert not bad.any(), f"finite mean: {_step(bad)} of {place}"
        bad = ~np.isfinite(spread).all(axis=(-1, -2))
        assert not bad.any(), f"finite covariance: {_step(bad)} of {place}"
        limit = 1e-9 * spread.max(initial=0.0)
        uneven = np.abs(spread - np.swapaxes(spread, -1, -2)).max(axis=(-1, -2))
        bad = ~(uneven <= limit)
        assert not bad.any(), f"symmetric covariance: {_step(bad)} of {place}"
        lowest = np.linalg.eigvalsh(spread).min(axis=-1)
        bad = ~(lowest >= -limit)
        assert not bad.any(), (
            f"PSD covariance: {_step(bad)} of {place}: the least eigenvalue is {lowest.min():.3g}"
        )
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
    gap = np.abs(blocks - forecast.covariance).max(axis=(3, 4), initial=0.0)
    limit = TOLERANCE * forecast.covariance.max(axis=inner, initial=0.0)
    for ident, apart, allowed in zip(tracks.ids, gap, limit, strict=True):
        place = f"track {ident!r}, {where}"
        worst = apart.max(initial=0.0)
        assert worst <= allowed, (
            f"joint covariance: {_step(apart > allowed)} of {place} differs by {worst:.3g} m^2"
        )


def _check_purity(
    predictor: Predictor, tracks: Tracks, scene: Scene | None, first: Forecast, where: str
) -> None:
    """Check that the same input gives the same forecast, and nothing given is changed."""
    before = tracks.positions.copy()
    again = _predict(predictor, tracks, scene, where)
    shapes = first.mean.shape, again.mean.shape
    assert len(set(shapes)) == 1, f"a second call gives another shape, {shapes} ({where})"
    for index, ident in enumerate(tracks.ids):
        bad = (first.mean[index] != again.mean[index]).any(axis=-1)
        bad |= (first.covariance[index] != again.covariance[index]).any(axis=(-1, -2))
        assert not bad.any(), (
            f"a second call gives another forecast: {_step(bad)} of track {ident!r}, {where}"
        )
    assert np.array_equal(before, tracks.positions, equal_nan=True), f"tracks changed ({where})"


def _check_translation(world: _World) -> None:
    size = world.tracks.dimension
    shift = np.random.default_rng(size).normal(scale=50.0, size=size)
    _check_motion(world, np.eye(size), shift)


def _check_rotation(world: _World, rng: np.random.Generator) -> None:
    size = world.tracks.dimension
    _check_motion(world, draw_rotation(size, rng), np.zeros(size))


def _check_motion(world: _World, turn: Array, shift: Array) -> None:
    """Check that turning or shifting the world turns or shifts the forecast."""
    still, tracks, where = world.forecast, world.tracks, world.where
    other = None if world.scene is None else move_scene(world.scene, turn, shift)
    moved = _predict(world.predictor, move_tracks(tracks, turn, shift), other, where)
    mean = still.mean @ turn.T + shift
    spread = turn @ still.covariance @ turn.T
    for index, ident in enumerate(tracks.ids):
        if ident == NEVER:
            continue
        place = f"track {ident!r}, {where}"
        # Coordinates of 1e6 m have lost six digits before they get here.
        scale = 1.0 + np.abs(mean[index]).max() + np.sqrt(spread[index].max())
        gap = np.abs(mean[index] - moved.mean[index]).max(axis=-1)
        bad = ~(gap <= TOLERANCE * scale)
        assert not bad.any(), f"{_step(bad)} of {place}: mean differs by {gap.max():.3g} m"
        gap = np.abs(spread[index] - moved.covariance[index]).max(axis=(-1, -2))
        bad = ~(gap <= TOLERANCE * (1.0 + spread[index].max()))
        assert not bad.any(), f"{_step(bad)} of {place}: covariance differs by {gap.max():.3g} m^2"


def _check_order(world: _World, rng: np.random.Generator) -> None:
    """Check that the forecast of an obstacle does not depend on its place in the list."""
    tracks, first, scene, where = world.tracks, world.forecast, world.scene, world.where
    order = [int(i) for i in rng.permutation(len(tracks))]
    if scene is not None and scene.goals is not None:
        scene = replace(scene, goals=scene.goals[order])
    other = _predict(world.predictor, tracks.select(order), scene, where)
    for place, index in enumerate(order):
        gap = np.abs(other.mean[place] - first.mean[index]).max(axis=-1)
        bad = ~(gap <= TOLERANCE * (1.0 + np.abs(first.mean[index]).max()))
        name = tracks.ids[index]
        assert not bad.any(), (
            f"{_step(bad)} of track {name!r}: mean differs by {gap.max():.3g} m ({where})"
        )
        assert other.fallback[place] == first.fallback[index], (
            f"track {name!r} has another reason ({where})"
        )


def _check_odd(one: _World) -> None:
    """Check zero obstacles, histories of 0 to 3 rows, no noise, and odd time steps."""
    empty = _predict(one.predictor, one.tracks.select([]), None, f"no obstacles, {one.where}")
    assert len(empty.mean) == 0 and empty.steps == STEPS, f"zero obstacles ({one.where})"
    for name, world in odd_worlds(one.tracks).items():
        note = f"{name}, {one.where}"
        _check_values(_predict(one.predictor, world, None, note), world, note)


def _check_magnitude(one: _World) -> None:
    """Check that the predictor serves numbers of any magnitude."""
    _check_values(one.forecast, one.tracks, one.where)
    if isinstance(one.predictor, Adaptive):
        updated, note = _updated(one.predictor, one.tracks, one.where), f"updated, {one.where}"
        _check_values(_predict(updated, one.tracks, None, note), one.tracks, note)


def _check_apart(one: _World) -> None:
    """Check that an obstacle of absurd numbers leaves the other forecasts as they were."""
    world, forecast, note = one.tracks, one.forecast, one.where
    if ABSURD not in world.ids or world.radius[-1] > 1.0:  # a giant is in everybody's way
        return
    rest = world.select(list(range(len(world) - 1)))
    alone = _predict(one.predictor, rest, None, note)
    for index, ident in enumerate(rest.ids):
        place = f"track {ident!r}, {note}"
        assert forecast.fallback[index] == alone.fallback[index], f"another reason of {place}"
        middles = (np.einsum("m,mnd->nd", said.weight[index], said.mean[index])
                   for said in (forecast, alone))  # fmt: skip
        gap = np.abs(np.subtract(*middles)).max(axis=-1)[None]
        bad = ~(gap <= TOLERANCE * (1.0 + np.abs(alone.mean[index]).max()))
        assert not bad.any(), f"another mean at {_step(bad)} of {place}"


def _check_updates(world: _World) -> None:
    """Check that updating keeps the laws, serves any tracks and changes no earlier copy."""
    predictor, tracks, where = world.predictor, world.tracks, world.where
    assert isinstance(predictor, Adaptive)
    before = _predict(predictor, tracks, None, where)
    current = predictor
    for seen in draw_run(tracks):
        current = _updated(current, seen, where)
    for name, odd in {"zero obstacles": tracks.select([]), **odd_worlds(tracks)}.items():
        _updated(current, odd, f"{name}, {where}")
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


@dataclass(frozen=True, eq=False)
class _Fits:
    """A predictor that learns, recordings, and tracks to compare its copies on."""

    predictor: Fittable
    given: Sequence[Tracks] | None
    size: int
    rng: np.random.Generator

    @cached_property
    def dataset(self) -> Sequence[Tracks]:
        return draw_recordings(self.size, self.rng) if self.given is None else self.given

    @cached_property
    def tracks(self) -> Tracks:
        return draw_tracks(self.dataset[0].dimension, self.rng)

    @cached_property
    def fits(self) -> tuple[str, Forecast, Fittable]:
        """The predictor's repr and forecast before its fit, and the fitted copy."""
        before = (
            repr(self.predictor),
            _predict(self.predictor, self.tracks, None, "before the fit"),
        )
        return *before, _fitted(self.predictor, self.dataset)

    @property
    def fitted(self) -> Fittable:
        return self.fits[2]

    def check_left_alone(self) -> None:
        written, before, _ = self.fits
        changed = repr(self.predictor) != written
        assert not changed, "its repr has changed"
        _check_purity(self.predictor, self.tracks, None, before, "after the fit of a copy")

    def check_pure(self) -> None:
        again = repr(_fitted(self.predictor, self.dataset))
        assert again == repr(self.fitted), "a second one learns something else"

    def check_saved(self) -> None:
        try:
            copy = rebuilt("predictors", self.fitted)
        except WideberthError as error:
            raise AssertionError(str(error)) from error
        said = _predict(self.fitted, self.tracks, None, "fitted")
        _check_purity(copy, self.tracks, None, said, "fitted, as saved and built again")


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
