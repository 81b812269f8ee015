"""The laws of `Predictor`, as a check that any predictor can be put through."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..forecast import Forecast, Scene
from ..motion import Truth
from ..predictor import Predictor
from ..tracks import Tracks

STEPS = 6
SAMPLES = 30
DT = 0.5
TOLERANCE = 1e-6


def check_predictor(
    predictor: Predictor,
    *,
    dimensions: Iterable[int] = (2, 3),
    rng: np.random.Generator | None = None,
) -> None:
    """Hold a predictor to its laws, on ordinary and on degenerate tracks.

    The laws: the right shapes; finite; covariances symmetric and PSD; pure; no exception
    for any history; equivariant to turning and shifting tracks and scene together (not for
    an obstacle never observed: nothing of it could turn); independent of the order of the
    obstacles; zero obstacles are served.

    Parameters
    ----------
    predictor : to be checked.
    dimensions : D to try.
    rng : for the random tracks; seeded with 0 by default.

    Raises
    ------
    AssertionError : names the law that is broken, and where.

    Examples
    --------
    >>> from wideberth.predictors.static import Static
    >>> check_predictor(Static())
    """
    generator = np.random.default_rng(0) if rng is None else rng
    for size in dimensions:
        tracks = _tracks(size, generator)
        scene = _scene(tracks, generator)
        for given in (None, scene):
            where = f"D = {size}, {'without' if given is None else 'with'} scene"
            forecast = _predict(predictor, tracks, given, where)
            _check_values(forecast, tracks, where)
            _check_purity(predictor, tracks, given, forecast, where)
            _check_motion(predictor, tracks, given, forecast, generator, where)
            _check_order(predictor, tracks, given, forecast, generator, where)
        _check_small(predictor, tracks, f"D = {size}")


def _predict(predictor: Predictor, tracks: Tracks, scene: Scene | None, where: str) -> Forecast:
    """Predict, turning an exception into a broken law."""
    try:
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
    turns = {"translation": np.eye(size), "rotation": _rotation(size, rng)}
    for law, turn in turns.items():
        shift = rng.normal(scale=50.0, size=size) * (law == "translation")
        moved_scene = None if scene is None else _moved_scene(scene, turn, shift)
        moved = _predict(predictor, _moved(tracks, turn, shift), moved_scene, where)
        mean = still.mean @ turn.T + shift
        spread = turn @ still.covariance @ turn.T
        for index, ident in enumerate(tracks.ids):
            if ident == "never observed":
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


def _check_small(predictor: Predictor, tracks: Tracks, where: str) -> None:
    """Check zero obstacles, and histories of 0 to 3 rows."""
    empty = _predict(predictor, tracks.select([]), None, f"no obstacles, {where}")
    assert len(empty.mean) == 0 and empty.steps == STEPS, f"zero obstacles ({where})"
    for rows in range(4):
        short = replace(tracks, positions=tracks.positions[:, SAMPLES - rows :])
        note = f"{rows} rows, {where}"
        _check_values(_predict(predictor, short, None, note), short, note)


def _tracks(size: int, rng: np.random.Generator) -> Tracks:
    """Return ordinary tracks and every degenerate one, named by what is odd about it."""
    time = DT * np.arange(SAMPLES)[:, None]
    along = np.linspace(1.0, 0.3, size)
    walk = np.cumsum(along * DT + 0.05 * rng.standard_normal((SAMPLES, size)), axis=0)
    hollow, ended, single, pair, triple = (walk.copy() for _ in range(5))
    hollow[[5, 6, 11, 20]] = np.nan
    hollow[15, 0] = np.nan
    ended[-4:] = np.nan
    single[:-1], pair[:-2], triple[:-3] = np.nan, np.nan, np.nan
    long_gap = walk.copy()
    long_gap[8:22] = np.nan
    paths = {
        "ordinary": walk,
        "gaps": hollow,
        "long gap": long_gap,
        "not seen lately": ended,
        "one sample": single,
        "two samples": pair,
        "three samples": triple,
        "never observed": np.full((SAMPLES, size), np.nan),
        "standing still": np.tile(along, (SAMPLES, 1)),
        "straight line": time * along,
        "along one axis": time * np.eye(size)[0],
        "far away": walk + 1e6,
        "jumping": 20.0 * rng.standard_normal((SAMPLES, size)),
    }
    count = len(paths)
    root = 0.02 * (np.eye(size) + 0.3 * rng.standard_normal((count, size, size)))
    return Tracks(
        np.stack(list(paths.values())),
        DT,
        tuple(paths),
        np.full(count, 0.3),
        root @ np.swapaxes(root, 1, 2),
        stamp=12.0,
    )


def _scene(tracks: Tracks, rng: np.random.Generator) -> Scene:
    """Return a scene that tells all it can, with truth for some obstacles."""
    size = tracks.dimension
    times = np.asarray(tracks.stamp + DT * np.arange(-2, 2 * STEPS), dtype=np.float64)
    future = {
        ident: rng.standard_normal((len(times), size)).cumsum(axis=0) for ident in tracks.ids[::2]
    }
    goals = 10.0 * rng.standard_normal((len(tracks), size))
    plan = rng.standard_normal((STEPS, size)).cumsum(axis=0)
    return Scene(plan=plan, goals=goals, truth=Truth(times, future))


def _rotation(size: int, rng: np.random.Generator) -> Array:
    """Return a random rotation matrix, (D, D)."""
    basis, _ = np.linalg.qr(rng.standard_normal((size, size)))
    basis[:, 0] *= np.sign(np.linalg.det(basis))
    return np.asarray(basis)


def _moved(tracks: Tracks, turn: Array, shift: Array) -> Tracks:
    """Turn and shift tracks."""
    noise = turn @ tracks.noise @ turn.T
    return replace(
        tracks,
        positions=tracks.positions @ turn.T + shift,
        noise=0.5 * (noise + np.swapaxes(noise, 1, 2)),
    )


def _moved_scene(scene: Scene, turn: Array, shift: Array) -> Scene:
    """Turn and shift what the scene tells; the ego state's layout is the robot's own."""
    truth, plan, goals = scene.truth, scene.plan, scene.goals
    if truth is not None:
        paths = {key: path @ turn.T + shift for key, path in truth.positions.items()}
        truth = Truth(truth.times, paths)
    return replace(
        scene,
        truth=truth,
        plan=None if plan is None else plan @ turn.T + shift,
        goals=None if goals is None else goals @ turn.T + shift,
    )
