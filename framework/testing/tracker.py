"""The laws of `Tracker`, as a check that any tracker can be put through."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..tracker import Tracker
from ..values.arrays import Array
from ..values.sensing import Sightings, TrackedObstacle
from .laws import Law, require

SCANS, STEP, WALKERS = 40, 0.1, 3
"""Scans that a tracker is shown, s between them, and how many walk."""
IntArray: TypeAlias = NDArray[np.int64]
NEAR = 1e-6
"""m and m/s. States are the same to this."""


def check_tracker(tracker: Tracker, *, rng: np.random.Generator | None = None) -> None:
    """Hold a tracker to its laws, on walkers that are now and then not seen.

    The laws: every walker is followed, under identities that differ, with finite states and
    covariances of the time asked for; `at` changes nothing; sightings that come late are left out
    with a reason, and change nothing; so are scans without an instant; a clock that is set back
    raises nothing, and later sightings are used again; scans without sightings let tracks end;
    the order of the sightings in a scan does not matter; turning and shifting the sightings turns
    and shifts the tracks; after `reset` the same scans give the same.

    Parameters
    ----------
    tracker : to be checked; it is reset.
    rng : of the walkers and the noise; seeded with 0 by default.

    Raises
    ------
    AssertionError : names every law that does not hold, and where.

    Examples
    --------
    >>> from wideberth.perception.tracking import Nearest
    >>> check_tracker(Nearest())
    """
    require(laws(tracker, rng=rng))


def laws(tracker: Tracker, *, rng: np.random.Generator | None = None) -> tuple[Law, ...]:
    """Return the laws of a tracker; the arguments are those of `check_tracker`."""
    generator = np.random.default_rng(0) if rng is None else rng
    run = _walk(generator)
    order = [generator.permutation(len(one.positions)) for one in run]
    angle, shift = generator.uniform(-3.0, 3.0), generator.uniform(-50.0, 50.0, 2)
    checks: dict[str, Callable[[Tracker], None]] = {
        "walkers are followed": partial(_check_followed, run=run),
        "asking changes nothing": partial(_check_asking, run=run),
        "late sightings": partial(_check_late, run=run),
        "clock": partial(_check_clock, run=run),
        "end": partial(_check_end, run=run),
        "order within a scan": partial(_check_order, run=run, order=order),
        "turning and shifting": partial(_check_moved, run=run, angle=angle, shift=shift),
        "reset": partial(_check_reset, run=run),
    }
    return tuple(Law(name, partial(check, tracker)) for name, check in checks.items())


def _walk(rng: np.random.Generator) -> list[Sightings]:
    """Return sightings of walkers that stay apart; a tenth are missing after the first ten."""
    start = 6.0 * np.arange(WALKERS)[:, None] * [1.0, 0.3] + rng.uniform(-0.5, 0.5, (WALKERS, 2))
    turn = rng.uniform(-np.pi, np.pi, WALKERS)
    speed = 0.8 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    run = []
    for number in range(SCANS):
        seen = rng.random(WALKERS) > (0.1 if number > 10 else 0.0)
        time = STEP * (number + 1)
        times = time - rng.uniform(0.0, STEP, WALKERS)
        places = start + times[:, None] * speed + 0.01 * rng.standard_normal((WALKERS, 2))
        count = int(seen.sum())
        spread = np.tile(1e-4 * np.eye(2), (count, 1, 1))
        run.append(Sightings(time, places[seen], spread, np.full(count, 0.3), times=times[seen]))
    return run


def _shown(tracker: Tracker, run: Sequence[Sightings]) -> tuple[TrackedObstacle, ...]:
    """Return the tracks after a run."""
    tracker.reset()
    for one in run:
        tracker.update(one)
    return tracker.at(run[-1].time)


def _same(one: Sequence[TrackedObstacle], other: Sequence[TrackedObstacle]) -> bool:
    """Tell whether two answers are the same, to the bit."""
    return len(one) == len(other) and all(
        a.ident == b.ident
        and a.radius == b.radius
        and np.array_equal(a.state, b.state)
        and np.array_equal(a.covariance, b.covariance)
        and np.array_equal(a.measured, b.measured)
        for a, b in zip(one, other, strict=True)
    )


def _check_followed(tracker: Tracker, run: Sequence[Sightings]) -> None:
    tracker.reset()
    for one in run:
        if note := tracker.update(one):
            raise AssertionError(f"a sound scan gave the note {note!r}")
    now = run[-1].time + 0.05
    found = tracker.at(now)
    if len({one.ident for one in found}) != WALKERS or len(found) != WALKERS:
        names = [one.ident for one in found]
        raise AssertionError(f"{WALKERS} walkers are tracked as {names}")
    for track in found:
        if track.time != now:
            raise AssertionError(f"the state is of {track.time} s; asked for {now} s")
        if not 0.0 < now - track.seen < 0.5:
            raise AssertionError(f"seen is {track.seen} s at {now} s")
        if (np.diff(track.times) <= 0.0).any():
            raise AssertionError("the instants of the measurements do not increase")


def _check_asking(tracker: Tracker, run: Sequence[Sightings]) -> None:
    tracker.reset()
    if tracker.at(run[0].time):
        raise AssertionError("at knew obstacles before anything was seen")
    once = _shown(tracker, run)
    for time in (run[-1].time + 100.0, run[0].time, run[-1].time):
        again = tracker.at(time)
    if not _same(once, again):
        raise AssertionError("at changed the tracks")


def _check_late(tracker: Tracker, run: Sequence[Sightings]) -> None:
    once = _shown(tracker, run)
    late = replace(run[-1], time=run[-1].time - 0.5 * STEP, times=run[-1].times - 0.5 * STEP)
    absurd = replace(run[-1], time=1e300, times=np.full(len(run[-1].times), 1e300))
    empty = Sightings(np.nan, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    for name, one in (("late", late), ("the last, again", run[-1]), ("without instant", empty),
                      ("of 1e300 s", absurd)):  # fmt: skip
        if not tracker.update(one):
            raise AssertionError(f"sightings that are {name} were used without a word")
    if not _same(once, tracker.at(run[-1].time)):
        raise AssertionError("sightings that came late changed the tracks")


def _check_clock(tracker: Tracker, run: Sequence[Sightings]) -> None:
    later = [replace(one, time=one.time + 1e4, times=one.times + 1e4) for one in run]
    _shown(tracker, later)
    notes = [tracker.update(one) for one in run]
    if not notes[0] or any(notes[1:]):
        raise AssertionError(f"a clock set back by 10000 s gave the notes {notes[:3]}")
    if len(tracker.at(run[-1].time)) != WALKERS:
        raise AssertionError("after the clock was set back obstacles are no longer followed")


def _check_end(tracker: Tracker, run: Sequence[Sightings]) -> None:
    _shown(tracker, run)
    nothing = Sightings(0.0, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))
    now = run[-1].time
    for number in range(100):
        tracker.update(replace(nothing, time=now + STEP * (number + 1)))
    if left := tracker.at(now + 10.0):
        raise AssertionError(f"{len(left)} tracks are left after 10 s in which nothing was seen")


def _check_order(tracker: Tracker, run: Sequence[Sightings], order: Sequence[IntArray]) -> None:
    mixed = [
        replace(
            one,
            positions=one.positions[rows],
            covariance=one.covariance[rows],
            radius=one.radius[rows],
            times=one.times[rows],
        )
        for one, rows in zip(run, order, strict=True)
    ]
    if not _same(_shown(tracker, run), _shown(tracker, mixed)):
        raise AssertionError("the order of the sightings within a scan changed the tracks")


def _check_moved(tracker: Tracker, run: Sequence[Sightings], angle: float, shift: Array) -> None:
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    moved = [
        replace(
            one,
            positions=one.positions @ turn.T + shift,
            covariance=turn @ one.covariance @ turn.T,
        )
        for one in run
    ]
    both = np.kron(np.eye(2), turn)
    wanted = [both @ one.state for one in _shown(tracker, run)]
    for one in _shown(tracker, moved):
        state = one.state - np.concatenate([shift, np.zeros(2)])
        off = min((float(np.abs(other - state).max()) for other in wanted), default=np.inf)
        if off > NEAR:
            raise AssertionError(
                f"turned by {angle:.3g} rad and shifted, a track is off by {off:.3g}"
            )


def _check_reset(tracker: Tracker, run: Sequence[Sightings]) -> None:
    if not _same(_shown(tracker, run), _shown(tracker, run)):
        raise AssertionError("after reset the same scans gave something else")
