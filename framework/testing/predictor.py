"""The laws of `Predictor`, as a check that any predictor can be put through."""

import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from ..plugins.config import rebuilt
from ..predictor import Adaptive, AdaptiveFiltering, Filtering, Fittable, Predictor
from ..values.arrays import Array, BoolArray
from ..values.beliefs import Beliefs
from ..values.errors import WideberthError
from ..values.forecast import Forecast, Scene
from ..values.measurements import Measurements
from ..values.tracks import Tracks
from .laws import Contract, Law, check_coverage, law, serving, stated
from .predictor_cases import (
    ABSURD,
    DT,
    NEVER,
    SAMPLES,
    STEPS,
    absurd_clocks,
    absurd_worlds,
    draw_recordings,
    draw_rotation,
    draw_run,
    draw_scene,
    draw_sighted,
    draw_tracks,
    move_scene,
    move_tracks,
    odd_worlds,
    seen_until,
    with_sightings,
)

TOLERANCE = 1e-6
EXACT = 1e-9
"""Share by which forecasts that are the same may differ by rounding."""
NEAR, VAGUE = 20.0, 1e4
"""m and m^2: how far from a brief sighting, and how uncertain, its forecast may be."""
LONG = 250
"""Rows of recordings for a predictor that refuses the usual ones: 20 horizons of 12 steps."""


@Contract
def check_predictor(
    predictor: Predictor,
    *,
    dimensions: Iterable[int] = (2, 3),
    rng: np.random.Generator | None = None,
    dataset: Sequence[Tracks] | None = None,
) -> Iterator[Law]:
    """Hold a predictor to its laws, on ordinary and on degenerate tracks.

    The laws: the right shapes; finite; covariances symmetric and PSD, and the diagonal blocks
    of the joint covariance where there is one; pure; no exception and no warning of NumPy
    for any history, step or noise; a reason for an obstacle never observed; equivariant to
    turning and shifting tracks and scene together (not for an obstacle never observed:
    nothing of it could turn); independent of the order of the obstacles; zero obstacles are
    served; so are positions, noise and radii of any magnitude that a float holds, and but for
    the radius they change nothing for the other obstacles. Its coverage is stated, or None. One
    that filters (`Filtering`) serves measurements at any times; its forecast is the same whatever
    was filtered before, of this log or another one; sightings on the grid are the grid; a
    sighting between two instants has a forecast near it; and what is given to it stays. One
    that adapts keeps its laws while it is updated, and no copy changes another. One that learns
    is fitted: `fit` leaves it as it was, returns its own kind, the same when called again; the
    fitted copy keeps the same laws and survives `save_plugin`.

    Parameters
    ----------
    predictor : to be checked.
    dimensions : D to try.
    rng : for the random tracks; seeded with 0 by default.
    dataset : recordings that a predictor which learns is fitted to, twice. By default two in
        the plane with twelve people each, 60 rows of 0.4 s, or 250 rows where `fit` refuses
        these. ``()`` leaves `fit` out, where a training is long.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.

    Examples
    --------
    >>> from wideberth.predictors.static import Static
    >>> check_predictor(Static())
    """
    generator = np.random.default_rng(0) if rng is None else rng
    sizes = tuple(dimensions)
    yield from _plain_laws(predictor, lambda: predictor, sizes, generator)
    if isinstance(predictor, Fittable):
        left = "no recordings to fit to are given" if dataset is not None and not dataset else ""
        drawn, seed = generator.spawn(2)
        fits = _Fits(predictor, dataset, 2 if 2 in sizes else sizes[0], drawn)
        for rule in stated(_Fits, predictor, lambda: [fits]):
            yield replace(rule, exception=left)
        for rule in _plain_laws(predictor, lambda: fits.fitted, sizes, seed):
            yield replace(rule, name=f"fitted, {rule.name}", exception=left or rule.exception)


def _plain_laws(
    predictor: Predictor,
    made: Callable[[], Predictor],
    sizes: tuple[int, ...],
    rng: np.random.Generator,
) -> Iterator[Law]:
    """Yield the laws that a predictor keeps, fitted or not."""
    (drawn,) = rng.spawn(1)

    @cache
    def worlds() -> list[_World]:
        return [world for size in sizes for world in _worlds(made(), size, drawn)]

    yield from stated(_World, predictor, worlds, rng)
    (absurd,) = rng.spawn(1)

    def bare() -> list[_Bare]:
        return [world for world in worlds() if isinstance(world, _Bare)]

    @cache
    def giants() -> list[_Giant]:
        return [
            _Giant(world.predictor, tracks, None, f"{name}, {world.where}")
            for world in bare()
            for name, tracks in absurd_worlds(world.tracks, absurd).items()
        ]

    yield from stated(_Bare, predictor, bare)
    yield from stated(_Giant, predictor, giants)
    sighted = rng.spawn(1)[0]

    @cache
    def runs() -> list[_Sighted]:
        return [
            _Sighted(made(), draw_sighted(size, sighted), None, f"D = {size}, sighted")
            for size in sizes
        ]

    yield from stated(_Sighted, predictor, runs, rng)


def _worlds(predictor: Predictor, size: int, rng: np.random.Generator) -> "Iterator[_World]":
    tracks = draw_tracks(size, rng)
    scene = draw_scene(tracks, rng)
    yield _Bare(predictor, tracks, None, f"D = {size}, without scene")
    yield _World(predictor, tracks, scene, f"D = {size}, with scene")


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

    @law("shapes, finite, symmetric, PSD")
    def check_values(self) -> None:
        _check_values(self.forecast, self.tracks, self.where)

    @law("pure")
    def check_pure(self) -> None:
        _check_purity(self.predictor, self.tracks, self.scene, self.forecast, self.where)

    @law("translation equivariant")
    def check_translation(self) -> None:
        size = self.tracks.dimension
        shift = np.random.default_rng(size).normal(scale=50.0, size=size)
        self._check_motion(np.eye(size), shift)

    @law("rotation equivariant")
    def check_rotation(self, rng: np.random.Generator) -> None:
        size = self.tracks.dimension
        self._check_motion(draw_rotation(size, rng), np.zeros(size))

    def _check_motion(self, turn: Array, shift: Array) -> None:
        """Check that turning or shifting the world turns or shifts the forecast."""
        tracks, still = self.tracks, self.forecast
        other = None if self.scene is None else move_scene(self.scene, turn, shift)
        moved = _predict(self.predictor, move_tracks(tracks, turn, shift), other, self.where)
        mean = still.mean @ turn.T + shift
        spread = turn @ still.covariance @ turn.T
        for index, ident in enumerate(tracks.ids):
            if ident == NEVER:
                continue
            place = f"track {ident!r}, {self.where}"
            # Coordinates of 1e6 m have lost six digits before they get here.
            scale = 1.0 + np.abs(mean[index]).max() + np.sqrt(spread[index].max())
            gap = np.abs(mean[index] - moved.mean[index]).max(axis=-1)
            _demand_near(gap, TOLERANCE * scale, f"{place}: mean")
            gap = np.abs(spread[index] - moved.covariance[index]).max(axis=(-1, -2))
            _demand_near(gap, TOLERANCE * (1.0 + spread[index].max()), f"{place}: covariance")

    @law("order independent")
    def check_order(self, rng: np.random.Generator) -> None:
        """Check that the forecast of an obstacle does not depend on its place in the list."""
        tracks, first, scene = self.tracks, self.forecast, self.scene
        order = [int(i) for i in rng.permutation(len(tracks))]
        if scene is not None and scene.goals is not None:
            scene = replace(scene, goals=scene.goals[order])
        other = _predict(self.predictor, tracks.select(order), scene, self.where)
        for place, index in enumerate(order):
            track = f"track {tracks.ids[index]!r}, {self.where}"
            gap = np.abs(other.mean[place] - first.mean[index]).max(axis=-1)
            limit = TOLERANCE * (1.0 + np.abs(first.mean[index]).max())
            _demand_near(gap, limit, f"{track}: mean")
            same = other.fallback[place] == first.fallback[index]
            assert same, f"{track} has another reason"


@dataclass(frozen=True, eq=False)
class _Bare(_World):
    """A world without a scene."""

    @law("what it promises is stated")
    def check_coverage(self) -> None:
        """Check that its coverage is one, or None."""
        check_coverage(self.predictor.coverage)

    @law("odd histories")
    def check_odd(self) -> None:
        """Check zero obstacles, histories of 0 to 3 rows, no noise, and odd time steps."""
        nothing = self.tracks.select([])
        empty = _predict(self.predictor, nothing, None, f"no obstacles, {self.where}")
        assert len(empty.mean) == 0 and empty.steps == STEPS, f"zero obstacles ({self.where})"
        for name, tracks in odd_worlds(self.tracks).items():
            note = f"{name}, {self.where}"
            _check_values(_predict(self.predictor, tracks, None, note), tracks, note)

    @law("keeps its laws while it adapts", Adaptive, "it does not adapt")
    def check_updates(self) -> None:
        """Check that updating keeps the laws, serves any tracks and changes no earlier copy."""
        predictor, tracks, note = self.predictor, self.tracks, f"updated, {self.where}"
        assert isinstance(predictor, Adaptive)
        before = _predict(predictor, tracks, None, self.where)
        current = predictor
        for seen in draw_run(tracks):
            current = _updated(current, seen, self.where)
        for name, odd in {"zero obstacles": tracks.select([]), **odd_worlds(tracks)}.items():
            _updated(current, odd, f"{name}, {self.where}")
        after = _predict(current, tracks, None, note)
        _check_values(after, tracks, note)
        _check_purity(current, tracks, None, after, note)
        _check_purity(predictor, tracks, None, before, f"after updates of copies, {self.where}")


@dataclass(frozen=True, eq=False)
class _Giant(_World):
    """A world in which a number is of an absurd magnitude."""

    @law("numbers of any magnitude")
    def check_magnitude(self) -> None:
        """Check that the predictor serves them."""
        _check_values(self.forecast, self.tracks, self.where)
        if isinstance(self.predictor, Adaptive):
            updated, note = (
                _updated(self.predictor, self.tracks, self.where),
                f"updated, {self.where}",
            )
            _check_values(_predict(updated, self.tracks, None, note), self.tracks, note)

    @law("an absurd obstacle changes no other")
    def check_apart(self) -> None:
        """Check that an obstacle of absurd numbers leaves the other forecasts as they were."""
        tracks, forecast = self.tracks, self.forecast
        if ABSURD not in tracks.ids or tracks.radius[-1] > 1.0:  # a giant is in the way of all
            return
        rest = tracks.select(list(range(len(tracks) - 1)))
        alone = _predict(self.predictor, rest, None, self.where)
        for index, ident in enumerate(rest.ids):
            place = f"track {ident!r}, {self.where}"
            assert forecast.fallback[index] == alone.fallback[index], f"another reason of {place}"
            with_it, without = (
                np.einsum("m,mnd->nd", made.weight[index], made.mean[index])
                for made in (forecast, alone)
            )
            limit = TOLERANCE * (1.0 + np.abs(alone.mean[index]).max())
            _demand_near(np.abs(with_it - without).max(axis=-1)[None], limit, f"{place}: mean")


@dataclass(frozen=True, eq=False)
class _Sighted(_World):
    """A predictor that filters, and obstacles measured at times of their own."""

    @property
    def filtering(self) -> Filtering:
        """The predictor."""
        assert isinstance(self.predictor, Filtering)
        return self.predictor

    @law("measurements at any times", Filtering, "it does not filter")
    def check_times(self, rng: np.random.Generator) -> None:
        """Check values, purity, motions and order on them, as on a grid."""
        self.check_values()
        self.check_pure()
        self.check_translation()
        self.check_rotation(rng)
        self.check_order(rng)

    @law("goes on as from the first measurement", Filtering, "it does not filter")
    def check_cadence(self, rng: np.random.Generator) -> None:
        """Check that it does not matter when it filtered before, and in which order."""
        every = np.unique(np.concatenate(self.tracks.measured.times))
        for name, times in {
            "each measurement": every,
            "some at once": every[3::7],
            "most missed": every[[len(every) // 3]],
        }.items():
            beliefs: Beliefs | None = None
            for place, time in enumerate([*times, self.tracks.stamp]):
                seen = seen_until(self.tracks, time)
                if name == "some at once":
                    seen = seen.select([int(i) for i in rng.permutation(len(seen))])
                beliefs = self._filtered(seen, beliefs)
                if place % 10 == 0 or time == self.tracks.stamp:
                    self._compare(seen, beliefs, f"{name}, at {time:.3g} s")

    @law("another log never leaks", Filtering, "it does not filter")
    def check_logs(self) -> None:
        """Check that what was filtered of other measurements of the same names is not used."""
        tracks, sightings = self.tracks, self.tracks.measured
        beliefs = self._filtered(tracks, None)
        places = [7.0 - 2.0 * place for place in sightings.positions]
        noise, log = sightings.noise, sightings.log
        sooner = [times - 0.013 for times in sightings.times]
        others = {
            "the same times": Measurements(sightings.times, places, noise, [k + 100 for k in log]),
            "other times of its log": Measurements(sooner, places, noise, log),
            "no log": Measurements(sightings.times, places, noise),
        }
        unnumbered = replace(
            tracks, sightings=Measurements(sightings.times, sightings.positions, noise)
        ).select([0])
        moved = replace(unnumbered, sightings=others["no log"].select([0]))
        self._compare(moved, self._filtered(unnumbered, None), "no log before")
        for name, other in others.items():
            self._compare(replace(tracks, sightings=other), beliefs, name)
        early = seen_until(tracks, tracks.stamp - 3.0 * DT)
        self._compare(early, beliefs, "a clock that went back")
        both = np.flatnonzero(sightings.count > 1).tolist()
        newest = tracks.select(both)
        less = newest.measured.part([slice(-1)] * len(both))
        self._compare(replace(newest, sightings=less), beliefs, "the newest measurement is gone")
        self._compare(
            early, self._filtered(tracks.select([]), beliefs), "after a gap without obstacles"
        )

    @law("sightings on the grid are the grid", Filtering, "it does not filter")
    def check_grid(self) -> None:
        """Check that samples and the same measurements at their times are forecast alike."""
        tracks = draw_tracks(self.tracks.dimension, np.random.default_rng(SAMPLES))
        samples = _predict(self.predictor, tracks, None, self.where)
        measured = _predict(self.predictor, with_sightings(tracks), None, self.where)
        _check_alike(samples, measured, tracks, self.where)

    @law("a brief sighting counts", Filtering, "it does not filter")
    def check_brief(self) -> None:
        """Check the forecast of who was measured between two instants of the grid alone."""
        names = ["newest", "seen once", "seen twice"]
        tracks = self.tracks.select([self.tracks.ids.index(name) for name in names])
        positions = tracks.positions.copy()
        positions[1:] = np.nan
        tracks = replace(tracks, positions=positions)
        forecast = _predict(self.predictor, tracks, None, self.where)
        _check_values(forecast, tracks, self.where)
        if not len(self._filtered(tracks, None)):  # a wrapper of one that looks at the grid
            return
        for row in (1, 2):
            place = f"track {tracks.ids[row]!r}, {self.where}"
            gap = forecast.mean[row] - tracks.measured.positions[row][-1]
            _demand_near(np.abs(gap).max(axis=-1), NEAR, f"{place}: mean")
            spread = np.trace(forecast.covariance[row], axis1=-2, axis2=-1)
            _demand_near(spread, VAGUE, f"{place}: variance")

    @law("filtering changes nothing it is given", Filtering, "it does not filter")
    def check_untouched(self) -> None:
        """Check that neither earlier beliefs nor measurements are changed."""
        early = seen_until(self.tracks, self.tracks.stamp - 2.0 * DT)
        before = self._filtered(early, None)
        forecast = self.filtering.ahead(before, early, STEPS)
        parts = (before.newest, before.count, *before.values)
        parts = (*parts, *self.tracks.measured.times, *self.tracks.measured.values)
        copies = [part.copy() for part in parts]
        same = self.tracks.select([self.tracks.ids.index(name) for name in early.ids])
        for tracks in (same, self.tracks):
            self.filtering.ahead(self._filtered(tracks, before), tracks, STEPS)
        for part, copy in zip(parts, copies, strict=True):
            assert np.array_equal(part, copy), f"an array is changed ({self.where})"
        again = self.filtering.ahead(before, early, STEPS)
        assert np.array_equal(forecast.mean, again.mean), f"another forecast ({self.where})"

    @law("absurd numbers in sightings", Filtering, "it does not filter")
    def check_absurd(self, rng: np.random.Generator) -> None:
        """Check measurements, noise and clocks of any magnitude; others are left as they were."""
        ordinary = draw_tracks(self.tracks.dimension, rng)
        for name, samples in absurd_worlds(ordinary, rng).items():
            tracks = with_sightings(samples)
            giant = _Giant(self.predictor, tracks, None, f"{name}, {self.where}")
            giant.check_magnitude()
            giant.check_apart()
            half = tracks.measured.part([slice(len(one) // 2) for one in tracks.measured.times])
            self._compare(tracks, self._filtered(replace(tracks, sightings=half), None), name)
        for name, tracks in absurd_clocks(self.tracks).items():
            _Giant(self.predictor, tracks, None, f"{name}, {self.where}").check_magnitude()

    @law(
        "adapts with what is filtered as without",
        AdaptiveFiltering,
        "it does not filter and adapt",
    )
    def check_adapted(self) -> None:
        """Check that an update learns the same from beliefs that it is given."""
        given = alone = self.predictor
        beliefs: Beliefs | None = None
        for time in self.tracks.stamp - DT * np.arange(8.0, -0.1, -0.7):
            seen, note = seen_until(self.tracks, time), f"updated, {self.where}"
            assert isinstance(given, AdaptiveFiltering) and isinstance(alone, AdaptiveFiltering)
            beliefs = self._filtered(seen, beliefs)
            with _strict("update", f" ({note})"):
                given, alone = given.update(seen, None, beliefs), alone.update(seen)
            first, second = (_predict(each, seen, None, note) for each in (given, alone))
            _check_values(first, seen, note)
            _check_alike(first, second, seen, note)

    def _filtered(self, tracks: Tracks, before: Beliefs | None) -> Beliefs:
        with _strict("filtered", f" ({self.where})"):
            beliefs = self.filtering.filtered(tracks, before)
        assert isinstance(beliefs, Beliefs), f"filtered returns Beliefs ({self.where})"
        return beliefs

    def _compare(self, tracks: Tracks, before: Beliefs, name: str) -> None:
        """Check that a forecast with earlier beliefs is the one without."""
        note = f"{name}, {self.where}"
        with _strict("ahead", f" ({note})"):
            beliefs = self.filtering.filtered(tracks, before)
            forecast = self.filtering.ahead(beliefs, tracks, STEPS)
        _check_alike(_predict(self.predictor, tracks, None, note), forecast, tracks, note)


@contextmanager
def _strict(what: str, remark: str) -> Iterator[None]:
    """Turn an exception or a warning of NumPy into a broken law."""
    with serving(what, remark), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def _predict(predictor: Predictor, tracks: Tracks, scene: Scene | None, where: str) -> Forecast:
    try:
        with _strict("predict", f" ({where})"):
            forecast = predictor.predict(tracks, STEPS, scene)
    except AssertionError as error:
        raise AssertionError(f"{error}; {_culprit(predictor, tracks)}") from error
    assert isinstance(forecast, Forecast), f"returns a Forecast: got {type(forecast)} ({where})"
    return forecast


def _culprit(predictor: Predictor, tracks: Tracks) -> str:
    """Name the first track that cannot be forecast alone; all where each can."""
    for index, ident in enumerate(tracks.ids):
        try:
            with _strict("", ""):
                predictor.predict(tracks.select([index]), STEPS)
        except AssertionError:
            return f"track {ident!r}, alone too"
    return f"tracks: {', '.join(tracks.ids)}"


def _updated(predictor: Adaptive, tracks: Tracks, where: str) -> Adaptive:
    with _strict("update", f" ({where})"):
        updated = predictor.update(tracks)
    assert type(updated) is type(predictor), f"update returns its own kind ({where})"
    return updated


def _demand(fine: BoolArray, what: str, place: str) -> None:
    """Name the first step at which something is wrong, of flags (M, N)."""
    assert fine.all(), f"{what}: step {int(np.argmin(fine.all(axis=0))) + 1} of {place}"


def _demand_near(gap: Array, limit: Array | float, what: str) -> None:
    """Name the first step at which a gap, (M, N), is beyond a limit."""
    fine = np.asarray(gap <= limit)
    assert fine.all(), (
        f"step {int(np.argmin(fine.all(axis=0))) + 1} of {what} differs by {gap.max():.3g}"
    )


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
        _demand(np.isfinite(forecast.mean[index]).all(axis=-1), "finite mean", place)
        _demand(np.isfinite(spread).all(axis=(-1, -2)), "finite covariance", place)
        limit = 1e-9 * spread.max(initial=0.0)
        uneven = np.abs(spread - np.swapaxes(spread, -1, -2)).max(axis=(-1, -2))
        _demand(uneven <= limit, "symmetric covariance", place)
        lowest = np.linalg.eigvalsh(spread).min(axis=-1)
        least = f"{place}: the least eigenvalue is {lowest.min():.3g}"
        _demand(lowest >= -limit, "PSD covariance", least)
        share = forecast.weight[index].sum()
        assert abs(share - 1) < 1e-9, f"weights sum to 1: {place}: {share}"
        unseen = tracks.measured.count[index] == 0
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
    gap = np.abs(blocks - forecast.covariance).max(axis=(3, 4), initial=0.0)
    limit = TOLERANCE * forecast.covariance.max(axis=(1, 2, 3, 4), initial=0.0)
    for ident, apart, allowed in zip(tracks.ids, gap, limit, strict=True):
        _demand_near(apart, allowed, f"track {ident!r}, {where}: joint covariance")


def _check_purity(
    predictor: Predictor, tracks: Tracks, scene: Scene | None, first: Forecast, where: str
) -> None:
    """Check that the same input gives the same forecast, and nothing given is changed."""
    before = tracks.positions.copy()
    again = _predict(predictor, tracks, scene, where)
    shapes = first.mean.shape, again.mean.shape
    assert len(set(shapes)) == 1, f"a second call gives another shape, {shapes} ({where})"
    for index, ident in enumerate(tracks.ids):
        same = (first.mean[index] == again.mean[index]).all(axis=-1)
        same &= (first.covariance[index] == again.covariance[index]).all(axis=(-1, -2))
        _demand(same, "a second call gives another forecast", f"track {ident!r}, {where}")
    assert np.array_equal(before, tracks.positions, equal_nan=True), f"tracks changed ({where})"


def _check_alike(first: Forecast, second: Forecast, tracks: Tracks, where: str) -> None:
    """Check that two forecasts of the same tracks differ by rounding at most."""
    shapes = first.mean.shape, second.mean.shape
    assert len(set(shapes)) == 1, f"shapes {shapes} differ ({where})"
    for index, ident in enumerate(tracks.ids):
        place = f"track {ident!r}, {where}"
        both = first.fallback[index], second.fallback[index]
        assert len(set(both)) == 1, f"reasons {both} differ: {place}"
        gap = np.abs(first.weight[index] - second.weight[index]).max()
        assert gap <= EXACT, f"weights differ by {gap:.3g}: {place}"
        for name in ("mean", "covariance"):
            one, other = (getattr(made, name)[index] for made in (first, second))
            modes, steps = one.shape[:2]
            gap = np.abs(one - other).reshape(modes, steps, -1).max(axis=2)
            _demand_near(gap, EXACT * (1.0 + np.abs(one).max()), f"{place}: {name}")


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
    def longer(self) -> Sequence[Tracks]:
        return draw_recordings(self.size, self.rng, LONG)

    @cached_property
    def tracks(self) -> Tracks:
        return draw_tracks(self.dataset[0].dimension, self.rng)

    @cached_property
    def fits(self) -> tuple[str, Forecast, Fittable]:
        """The predictor's repr and forecast before its fit, and the fitted copy."""
        before = _predict(self.predictor, self.tracks, None, "before the fit")
        return repr(self.predictor), before, self._fit()

    @property
    def fitted(self) -> Fittable:
        return self.fits[2]

    def _fit(self) -> Fittable:
        hint = " (if it needs more or other recordings, give check_predictor a dataset)"
        with serving("fit", hint):
            try:
                fitted = self.predictor.fit(self.dataset)
            except WideberthError:
                if self.given is not None:
                    raise
                fitted = self.predictor.fit(self.longer)
        kind = type(self.predictor)
        same = type(fitted) is kind
        assert same, f"fit returns its own kind: {kind.__name__}, not {fitted!r:.60}"
        return fitted

    @law("fit leaves the predictor as it was")
    def check_left_alone(self) -> None:
        written, before, _ = self.fits
        assert repr(self.predictor) == written, "its repr has changed"
        _check_purity(self.predictor, self.tracks, None, before, "after the fit of a copy")

    @law("fit is pure")
    def check_pure(self) -> None:
        again = repr(self._fit())
        assert again == repr(self.fitted), "a second one learns something else"

    @law("what fit returns can be saved")
    def check_saved(self) -> None:
        try:
            copy = rebuilt("predictors", self.fitted)
        except WideberthError as error:
            raise AssertionError(str(error)) from error
        before = _predict(self.fitted, self.tracks, None, "fitted")
        _check_purity(copy, self.tracks, None, before, "fitted, as saved and built again")
