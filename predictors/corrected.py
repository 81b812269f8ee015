"""A base predictor with its mean corrected by recorded errors of similar obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import numpy as np

from ..framework.predictor import Fittable, Predictor
from ..framework.values.arrays import Array, checked, positive, whole
from ..framework.values.beliefs import Beliefs
from ..framework.values.forecast import Forecast, Scene
from ..framework.values.tracks import Tracks
from .core.assembly import refuse_adaptive
from .core.calibration import replayed, same_step
from .core.history import Histories, IntArray, gather
from .core.wrapping import Wrapping
from .data.windows import Windows, windows_of
from .interacting_models import InteractingModels

BACK = 3
"""Steps before the newest one, whose mean velocity the newest is compared with."""
SHRINKAGE = 30.0
"""Windows of no correction that each class counts beside its own."""
USEFUL = 0.98
"""Share of the error on recordings left out below which corrections are kept."""
ROWS = 300
"""Rows of one recording whose windows are learnt from, evenly spaced."""
STILL = 1e-6
"""m/s; below it there is no heading and no correction."""


@dataclass(frozen=True)
class Corrections:
    """Median errors by class and step.

    Attributes
    ----------
    dt : s, between the steps.
    edges : of speed (m/s), acceleration and turn (m/s of change), between the classes.
    errors : m, [class][step] of (along the heading, to the side turned to).
    """

    dt: float
    edges: tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]
    errors: tuple[tuple[tuple[float, float], ...], ...]

    def __post_init__(self) -> None:
        positive("corrections.dt", self.dt)
        classes = int(np.prod([len(edge) + 1 for edge in self.edges]))
        checked("corrections.errors", self.errors, (classes, None, 2))

    def shifts(self, moves: "Moves", times: Array) -> Array:
        """Return how far the mean is moved at times ahead (O, N), s, (O, N, D), m."""
        shift = self.at(_kinds(moves.features, self.edges), times)
        return np.asarray(
            shift[..., :1] * moves.heading[:, None] + shift[..., 1:] * moves.side[:, None]
        )

    def at(self, kinds: IntArray, times: Array) -> Array:
        """Return the errors at times ahead (O, N), s, linear between steps, (O, N, 2), m."""
        table = np.pad(np.array(self.errors), ((0, 0), (1, 0), (0, 0)))
        place = np.minimum(times / self.dt, table.shape[1] - 1.0)
        below = np.minimum(np.floor(place).astype(np.int64), table.shape[1] - 2)
        share = (place - below)[..., None]
        row = kinds[:, None]
        return np.asarray((1 - share) * table[row, below] + share * table[row, below + 1])


@dataclass(frozen=True, eq=False)
class Moves:
    """How each obstacle moves: heading and side, (O, D), and speed, acceleration, turn, (O, 3).

    The velocity is that of the base's first step, so that it is as smooth as the base makes it.
    Acceleration is its change since the three steps before the newest along the heading; turn
    is the change across it, whose direction is the side.
    """

    heading: Array
    side: Array
    features: Array

    @classmethod
    def of(cls, past: Histories, first: Array, dt: float) -> "Moves":
        """Read it from histories and the base's mean at the first step, relative, (O, 2, D)."""
        velocity = (first[:, 1] - first[:, 0]) / dt
        speed = np.linalg.norm(velocity, axis=1)
        moves = speed >= STILL
        heading = velocity / np.where(moves, speed, 1.0)[:, None] * moves[:, None]
        steps = np.diff(past.positions, axis=1)[:, -1 - BACK : -1] / dt
        before = steps.mean(axis=1) if steps.shape[1] else velocity
        change = velocity - before
        along = np.sum(change * heading, axis=1)
        across = change - along[:, None] * heading
        turn = np.linalg.norm(across, axis=1)
        turns = turn >= STILL
        side = across / np.where(turns, turn, 1.0)[:, None] * (turns & moves)[:, None]
        return cls(heading, side, np.stack([speed, along, turn], axis=1))


@final
@dataclass(frozen=True)
class Corrected(Wrapping, Fittable):
    """Shifts the mean of a base predictor by its median error in recordings.

    mu_h -> mu_h + a_h u + b_h n

    with u the heading, n the side to which the obstacle has begun to turn, and (a_h, b_h) the
    median errors of a class of windows with like speed, acceleration and turn (`Moves`), drawn
    towards 0 where the class is small. Robots that turn go on turning for a second, and those
    that slow down stand; a model of constant velocity says neither. Covariances stay: the
    median moves the centre, not the spread.

    Corrections must prove themselves: learnt from all recordings but one, they have to lower the
    mean error of the one left out, on average by 2 %. Else, and from a single recording, none
    is kept. Corrections of robots of one kind pass; those of crowds that were measured with
    different noise do not.

    Unfitted, for an obstacle for which the base gives a reason, and for one with fewer than 5
    samples, the base's own mean stands.

    On another time grid corrections are linear in time; beyond the last step they stay.

    Parameters
    ----------
    base : gives mean and covariance; where it can be fitted it is, on the same tracks.
    observed : samples of the windows of `fit`.
    steps : ahead, learnt in `fit`.
    classes : of each of speed, acceleration and turn, of equal shares of the windows.
    fitted : what `fit` has learnt.

    Raises
    ------
    WideberthError : fewer than 5 samples observed, a number below 1, or a base that adapts.
    """

    base: Predictor = field(default_factory=InteractingModels)
    observed: int = 8
    steps: int = 12
    classes: int = 3
    fitted: Corrections | None = None

    reference: ClassVar[str] = "schoeller2020constant"

    def __post_init__(self) -> None:
        refuse_adaptive("corrected.base", self.base)
        whole("corrected.observed", self.observed, least=BACK + 2)
        for name in ("steps", "classes"):
            whole(f"corrected.{name}", getattr(self, name))

    def fit(self, dataset: Sequence[Tracks]) -> Self:
        """Learn the corrections from windows of at most 300 rows of each recording.

        Raises
        ------
        WideberthError : fewer than 10 windows per class, or scenes that differ in dt or
            dimension.
        """
        wanted = 10 * self.classes**3
        found = windows_of(dataset, self.observed, self.steps, wanted=wanted, who="corrected")
        same_step(dataset, "corrected")
        base = self.base.fit(dataset) if isinstance(self.base, Fittable) else self.base
        moves, errors = [], []
        for scene, windows in zip(dataset, found, strict=True):
            some = thinned(windows)
            if len(some):
                mean, _, weight = replayed(base, scene, some)
                centre = np.einsum("om,omnd->ond", weight, mean)
                past = gather(some.tracks)
                moves.append(Moves.of(past, _first(centre, past), scene.dt))
                errors.append(some.future - centre)
        learnt = None
        if _useful(moves, errors, self.classes):
            learnt = _learnt(moves, errors, self.classes, dataset[0].dt)
        return replace(self, base=base, fitted=learnt)

    def ahead(
        self, beliefs: Beliefs, tracks: Tracks, steps: int, scene: Scene | None = None
    ) -> Forecast:
        """Forecast all obstacles; see `Filtering.ahead`."""
        forecast = self.base.ahead(beliefs, tracks, steps, scene)
        if self.fitted is None:
            return forecast
        past = gather(tracks)
        centre = np.einsum("om,omnd->ond", forecast.weight, forecast.mean)
        moves = Moves.of(past, _first(centre, past), tracks.dt)
        own = np.array([reason is None for reason in forecast.fallback], dtype=np.bool_)
        own &= (past.length >= BACK + 2) & (past.late == 0)
        times = tracks.dt * np.arange(1.0, steps + 1) * np.ones((len(tracks), 1))
        moved = np.where(own[:, None, None], self.fitted.shifts(moves, times), 0.0)
        return replace(forecast, mean=forecast.mean + moved[:, None])


def thinned(windows: Windows) -> Windows:
    """Return the windows of at most `ROWS` evenly spaced rows, with all obstacles at each."""
    rows = np.unique(windows.row)
    kept = np.flatnonzero(np.isin(windows.row, rows[:: max(-(-len(rows) // ROWS), 1)]))
    return Windows(
        windows.tracks.select(kept.tolist()),
        windows.future[kept],
        windows.obstacle[kept],
        windows.row[kept],
    )


def _first(centre: Array, past: Histories) -> Array:
    """Mean at the first two steps; of a forecast of one step, newest position and that step."""
    if centre.shape[1] > 1:
        return centre[:, :2]
    return np.stack([past.origin, centre[:, 0]], axis=1)


def _kinds(features: Array, edges: Sequence[Sequence[float]]) -> IntArray:
    """Class of each obstacle, (O,), by speed, acceleration and turn."""
    kinds = np.zeros(len(features), dtype=np.int64)
    for column, edge in zip(features.T, edges, strict=True):
        kinds = kinds * (len(edge) + 1) + np.searchsorted(np.array(edge), column)
    return kinds


def _learnt(
    moves: Sequence[Moves], errors: Sequence[Array], classes: int, dt: float
) -> Corrections:
    """Median errors of each class, from how obstacles move and errors (W, N, D) by recording."""
    features = np.concatenate([one.features for one in moves])
    shares = np.arange(1, classes) / classes
    speeds, changes, turns = (tuple(np.quantile(column, shares).tolist()) for column in features.T)
    edges = (speeds, changes, turns)
    kinds = _kinds(features, edges)
    local = np.concatenate([
        np.stack([np.einsum("wnd,wd->wn", error, axis) for axis in (one.heading, one.side)], 2)
        for one, error in zip(moves, errors, strict=True)
    ])  # fmt: skip
    table = np.zeros((classes**3, *local.shape[1:]))
    for kind in range(len(table)):
        own = kinds == kind
        if own.any():
            table[kind] = np.median(local[own], axis=0) * own.sum() / (own.sum() + SHRINKAGE)
    learnt: Any = table.tolist()  # nested lists of floats
    rows = tuple(tuple((a, b) for a, b in row) for row in learnt)
    return Corrections(float(dt), edges, rows)


def _useful(moves: Sequence[Moves], errors: Sequence[Array], classes: int) -> bool:
    """Whether corrections learnt from the other recordings lower the errors of each on average."""
    before, after = [], []
    for place, error in enumerate(errors):
        rest = [other for other in range(len(errors)) if other != place]
        if not rest:
            return False
        learnt = _learnt([moves[i] for i in rest], [errors[i] for i in rest], classes, 1.0)
        times = np.arange(1.0, error.shape[1] + 1) * np.ones((len(error), 1))
        before.append(np.linalg.norm(error, axis=2).mean())
        shifted = error - learnt.shifts(moves[place], times)
        after.append(np.linalg.norm(shifted, axis=2).mean())
    return bool(np.mean(after) < USEFUL * np.mean(before))
