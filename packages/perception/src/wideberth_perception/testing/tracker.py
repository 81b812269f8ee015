"""The laws of `Tracker`, as a check that any tracker can be put through."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wideberth.framework.numerics.geometry import plane_turn
from wideberth.framework.testing.laws import Contract, Law, law, stated
from wideberth.simulation.sensing.perceived import Sightings, TrackedObstacle

from ..tracker import Tracker

SCANS, STEP, WALKERS = 40, 0.1, 3
"""Scans that a tracker is shown, s between them, and how many walk."""
NEAR = 1e-6
"""m and m/s. States are the same to this."""


@Contract
def check_tracker(tracker: Tracker, *, rng: np.random.Generator | None = None) -> Iterator[Law]:
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
    >>> from wideberth_perception.tracking import Nearest
    >>> check_tracker(Nearest())
    """
    generator = np.random.default_rng(0) if rng is None else rng
    walk = _Walk(tracker, _sightings(generator))
    return stated(_Walk, tracker, lambda: [walk], generator)


@dataclass(frozen=True, eq=False)
class _Walk:
    """A tracker, and sightings of walkers."""

    tracker: Tracker
    run: list[Sightings]

    @property
    def end(self) -> float:
        """Time of the last scan, s."""
        return self.run[-1].time

    def shown(self, run: Sequence[Sightings]) -> tuple[TrackedObstacle, ...]:
        """Return the tracks after a reset and a run."""
        self.tracker.reset()
        for seen in run:
            self.tracker.update(seen)
        return self.tracker.at(run[-1].time)

    @law("walkers are followed")
    def check_followed(self) -> None:
        self.tracker.reset()
        for seen in self.run:
            note = self.tracker.update(seen)
            assert not note, f"a sound scan gave the note {note!r}"
        now = self.end + 0.05
        found = self.tracker.at(now)
        names = [track.ident for track in found]
        assert len(set(names)) == len(names) == WALKERS, (
            f"{WALKERS} walkers are tracked as {names}"
        )
        for track in found:
            assert track.time == now, f"the state is of {track.time} s; asked for {now} s"
            assert 0.0 < now - track.seen < 0.5, f"seen is {track.seen} s at {now} s"
            increasing = (np.diff(track.times) > 0.0).all()
            assert increasing, "the instants of the measurements do not increase"

    @law("asking changes nothing")
    def check_asking(self) -> None:
        self.tracker.reset()
        before = self.tracker.at(self.run[0].time)
        assert not before, "at knew obstacles before anything was seen"
        once = self.shown(self.run)
        for time in (self.end + 100.0, self.run[0].time, self.end):
            again = self.tracker.at(time)
        assert _same(once, again), "at changed the tracks"

    @law("late sightings")
    def check_late(self) -> None:
        once, last = self.shown(self.run), self.run[-1]
        cases = {
            "late": replace(last, time=self.end - 0.5 * STEP, times=last.times - 0.5 * STEP),
            "the last, again": last,
            "without instant": _nothing(np.nan),
            "of 1e300 s": replace(last, time=1e300, times=np.full(len(last.times), 1e300)),
        }
        for name, seen in cases.items():
            note = self.tracker.update(seen)
            assert note, f"sightings that are {name} were used without a word"
        assert _same(once, self.tracker.at(self.end)), "late sightings changed the tracks"

    @law("clock")
    def check_clock(self) -> None:
        self.shown([replace(seen, time=seen.time + 1e4, times=seen.times + 1e4)
                    for seen in self.run])  # fmt: skip
        first, *later = [self.tracker.update(seen) for seen in self.run]
        noted = first and not any(later)
        assert noted, f"a clock set back by 10000 s gave the notes {[first, *later[:2]]}"
        followed = len(self.tracker.at(self.end)) == WALKERS
        assert followed, "after the clock was set back obstacles are no longer followed"

    @law("end")
    def check_end(self) -> None:
        self.shown(self.run)
        for number in range(100):
            self.tracker.update(_nothing(self.end + STEP * (number + 1)))
        left = len(self.tracker.at(self.end + 10.0))
        assert not left, f"{left} tracks are left after 10 s in which nothing was seen"

    @law("order within a scan")
    def check_order(self, rng: np.random.Generator) -> None:
        mixed = []
        for seen in self.run:
            rows = rng.permutation(len(seen.positions))
            names = ("positions", "covariance", "radius", "times")
            mixed.append(replace(seen, **{name: vars(seen)[name][rows] for name in names}))
        same = _same(self.shown(self.run), self.shown(mixed))
        assert same, "the order of the sightings within a scan changed the tracks"

    @law("turning and shifting")
    def check_moved(self, rng: np.random.Generator) -> None:
        angle, shift = rng.uniform(-3.0, 3.0), rng.uniform(-50.0, 50.0, 2)
        turn = plane_turn(angle)
        moved = [
            replace(
                seen,
                positions=seen.positions @ turn.T + shift,
                covariance=turn @ seen.covariance @ turn.T,
            )
            for seen in self.run
        ]
        both = np.kron(np.eye(2), turn)
        wanted = [both @ track.state for track in self.shown(self.run)]
        for track in self.shown(moved):
            state = track.state - np.concatenate([shift, np.zeros(2)])
            off = min((float(np.abs(other - state).max()) for other in wanted), default=np.inf)
            assert off <= NEAR, (
                f"turned by {angle:.3g} rad and shifted, a track is off by {off:.3g}"
            )

    @law("reset")
    def check_reset(self) -> None:
        same = _same(self.shown(self.run), self.shown(self.run))
        assert same, "after reset the same scans gave something else"


def _sightings(rng: np.random.Generator) -> list[Sightings]:
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


def _nothing(time: float) -> Sightings:
    """Return a scan in which nothing was seen."""
    return Sightings(time, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0))


def _same(first: Sequence[TrackedObstacle], second: Sequence[TrackedObstacle]) -> bool:
    """Whether two answers are the same, to the bit."""
    return len(first) == len(second) and all(
        (a.ident, a.radius) == (b.ident, b.radius)
        and np.array_equal(a.state, b.state)
        and np.array_equal(a.covariance, b.covariance)
        and np.array_equal(a.measured, b.measured)
        for a, b in zip(first, second, strict=True)
    )
