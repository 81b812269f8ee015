"""Whether this checkout is slower than another commit: ``python benchmarks/history/compare.py``.

The other commit, by default that of the last row of ``releases.csv``, is checked out into a
temporary worktree. Both run in the environment of this Python. A pair is a fresh process of each
(`work.py`); both do the same work in turns, A B B A, and the fastest turn of each counts, in
processor time. Over the pairs the median of log(this / other) has the interval of the sign test,
such that all measures together raise a false alarm in at most `FALSE_ALARM` of the runs. A measure
whose interval lies above 0 is slower if the median is above `LEAST` as well, since where a process
happens to lie in memory changes times by as much. Nothing is compared with a number of seconds.

Exit status: 0 nothing is slower, 1 something is, 2 the input is of no use.
"""

import argparse
import csv
import io
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from measuring import Row, rotated  # noqa: E402
from work import REFERENCES, WORK  # noqa: E402

from wideberth.experiments.engine.provenance import processor  # noqa: E402
from wideberth.framework import WideberthError  # noqa: E402
from wideberth.framework.plugins.io import write_text  # noqa: E402

ROOT = HERE.parents[1]
TABLE = HERE / "releases.csv"
FALSE_ALARM = 0.05
"""Most share of runs on equal commits in which any measure at all is called slower or faster."""
LEAST = 0.02
"""Smallest change that counts, as a share."""
FEWEST = 9
"""Pairs, of all measures: with fewer no result is beyond what `FALSE_ALARM` allows to chance."""
TURNS, LONG = ("this", "other", "other", "this"), 0.6
"""Turns in a pair, and s for which they go on with work that is short."""
RATIOS: dict[str, tuple[str, str, str]] = {
    "ipopt": ("ipopt", "riccati", "a solve: IPOPT over riccati"),
    "fatrop": ("fatrop", "riccati", "a solve: fatrop over riccati"),
    "riccati": ("riccati", "unit", "a solve of riccati"),
    "decision": ("decision", "unit", "a decision of the recommended planner"),
    "forecast": ("forecast", "unit", "a recommended forecast of 20 people"),
    "filter": ("filter", "unit", "a Kalman forecast of 20 people"),
    "risk": ("risk", "unit", "5000 collision probabilities"),
    "episode": ("episode", "unit", "a second of simulation"),
    "import": ("import", "python", "import of the planner, over Python's"),
}
"""Column -> work, work that it is divided by, and what that is."""
Times: TypeAlias = dict[str, dict[str, list[float]]]
"""Side -> work -> s of each pair."""


@dataclass(frozen=True)
class Verdict:
    """What the pairs say of one measure: the median of log(this / other) and its interval."""

    name: str
    pairs: int
    median: float
    low: float
    high: float

    @property
    def word(self) -> str:
        """What is said of the measure."""
        if self.low > 0.0 and self.median > math.log1p(LEAST):
            return "slower"
        if self.high < 0.0 and self.median < -math.log1p(LEAST):
            return "faster"
        return f"no difference that {self.pairs} pairs can see"

    @property
    def line(self) -> str:
        """One line for reading."""
        share, low, high = (100 * math.expm1(x) for x in (self.median, self.low, self.high))
        return f"{self.name:10} {share:+6.1f} % ({low:+.1f} to {high:+.1f})  {self.word}"


def order(pairs: int, allowed: float) -> int:
    """Return the k for which the k-th smallest and largest of ``pairs`` bound the median.

    They miss it with probability 2 P(Bin(pairs, 1/2) < k), which is at most ``allowed``; k is
    the largest such number, 0 where there is none.

    Examples
    --------
    >>> order(9, 0.05 / 7), order(30, 0.05 / 7), order(5, 0.05)
    (1, 8, 0)
    """
    missed, k = 0.0, 0
    while True:
        missed += 2.0 * math.comb(pairs, k) * 0.5**pairs
        if missed > allowed:
            return k
        k += 1


def interval(values: Sequence[float], allowed: float) -> tuple[float, float, float]:
    """Return the median of some values and the bounds of the sign test."""
    ordered, k = sorted(values), order(len(values), allowed)
    if not k:
        raise WideberthError(
            f"{len(values)} pairs bound no median within {allowed:.2g} of the runs; wanted more "
            f"(all measures: {FEWEST})"
        )
    return float(np.median(ordered)), ordered[k - 1], ordered[-k]


def verdicts(times: Times, names: Sequence[str]) -> list[Verdict]:
    """Compare both sides in each measure that both could do."""
    found = []
    for name in names:
        logs = np.log(np.array(times["this"][name]) / np.array(times["other"][name]))
        median, low, high = interval(logs.tolist(), FALSE_ALARM / len(names))
        found.append(Verdict(name, len(logs), median, low, high))
    return found


class Side:
    """A process that measures one checkout."""

    def __init__(self, checkout: Path) -> None:
        environment = {**os.environ, "PYTHONPATH": str(checkout.parent)}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        self._process = subprocess.Popen(
            [sys.executable, str(HERE / "work.py"), str(checkout)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            text=True,
        )

    def ask(self, name: str) -> None:
        """Have a piece of work done."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{name}\n")
        self._process.stdin.flush()

    def answer(self) -> float | str:
        """Return what it took, s, or why it could not be done."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        return json.loads(line) if line else "its process ended"

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()


def measured(
    checkouts: Mapping[str, Path], names: Sequence[str], pairs: int
) -> tuple[Times, dict[str, str]]:
    """Do all work in pairs of fresh processes, after a pair that only compiles.

    Returns
    -------
    The times, and why work is missing, by its name.
    """
    times: Times = {side: {name: [] for name in names} for side in checkouts}
    missing: dict[str, str] = {}
    for turn in range(pairs + 1):
        with ExitStack() as stack:
            sides = {side: Side(place) for side, place in checkouts.items()}
            for one in sides.values():
                stack.callback(one.close)
            for name in rotated([one for one in names if one not in missing], turn):
                found = _taken(sides, name, turn)
                for side, taken in found.items():
                    if isinstance(taken, str):
                        missing[name] = f"{side}: {taken}"
                    elif turn and name not in missing:
                        times[side][name].append(taken)
        print(f"\r{turn} of {pairs} pairs", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return times, missing


def _taken(sides: Mapping[str, Side], name: str, turn: int) -> dict[str, float | str]:
    """Return the faster time of each side; both prepare at once, then they take turns."""
    for one in sides.values():
        one.ask(name)
    ready = {side: one.answer() for side, one in sides.items()}
    if any(isinstance(one, str) for one in ready.values()):
        return ready
    taken: dict[str, list[float]] = {side: [] for side in sides}
    begin = perf_counter()
    while not taken["this"] or perf_counter() - begin < LONG:
        for side in TURNS if turn % 2 else reversed(TURNS):
            sides[side].ask(name)
            answer = sides[side].answer()
            if isinstance(answer, str):
                return {**ready, side: answer}
            taken[side].append(answer)
    return {side: min(some) for side, some in taken.items()}


@contextmanager
def checkouts(commit: str) -> Iterator[dict[str, Path]]:
    """Give this checkout and a worktree of the commit, both as a folder named ``wideberth``."""
    with tempfile.TemporaryDirectory() as folder:
        places = {side: Path(folder) / side[:4] / "wideberth" for side in ("this", "other")}
        for place in places.values():
            place.parent.mkdir()
        places["this"].symlink_to(ROOT)
        git("worktree", "add", "--detach", str(places["other"]), commit)
        try:
            yield places
        finally:
            git("worktree", "remove", "--force", str(places["other"]))


def git(*words: str) -> str:
    """Return what git says.

    Raises
    ------
    WideberthError : git fails.
    """
    done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True)
    if done.returncode:
        raise WideberthError(f"git {words[0]}: {done.stderr.strip()}")
    return done.stdout.strip()


def read_rows() -> list[dict[str, str]]:
    """Return the rows of the history, as text."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def row(release: str, commit: str, times: Mapping[str, Sequence[float]], load: float) -> Row:
    """Return a row of the history: each ratio with the interval of 95 % of its median."""
    counts = [len(some) for some in times.values()]
    found: Row = {
        "release": release,
        "commit": git("rev-parse", "--short=10", commit),
        "date": git("show", "-s", "--format=%cs", commit),
        "machine": f"{processor()}, {os.cpu_count()} cores, load {load:.0f}",
        "pairs": max(counts),
    }
    for name, (above, below, _) in RATIOS.items():
        parts: tuple[Any, ...] = ("", "", "")
        if times[above] and times[below]:
            ratios = np.array(times[above]) / np.array(times[below])
            parts = tuple(f"{value:.4g}" for value in interval(ratios.tolist(), 0.05))
        found |= dict(zip((name, f"{name}_low", f"{name}_high"), parts, strict=True))
    return found


def record(rows: Sequence[Row]) -> None:
    """Append rows to the history; a release that is there already is replaced."""
    new = {one["release"] for one in rows}
    kept = [one for one in read_rows() if one["release"] not in new] if TABLE.exists() else []
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows([*kept, *rows])
    write_text(TABLE, text.getvalue())


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare, print a line for each measure, and record rows where that is asked for."""
    options = _options(arguments)
    try:
        commit = options.commit or read_rows()[-1]["commit"]
        interval([0.0] * options.pairs, FALSE_ALARM / len(options.only))  # before any work
        load = os.getloadavg()[0]
        names = list(options.only)
        recorded = options.record or options.record_other
        with checkouts(commit) as places:
            times, missing = measured(
                places, [*names, *(REFERENCES if recorded else ())], options.pairs
            )
        if options.record_other:
            record([row(options.record_other, commit, times["other"], load)])
        if options.record:
            record([row(options.record, "HEAD", times["this"], load)])
    except (WideberthError, OSError, IndexError) as error:
        print(f"compare: {error or 'releases.csv has no row; name a commit'}", file=sys.stderr)
        return 2
    found = verdicts(times, [name for name in names if name not in missing])
    print(f"this checkout over {commit}, processor time, {options.pairs} pairs:")
    lost = [f"{name:10} not measured in {reason}" for name, reason in missing.items()]
    print(*(one.line for one in found), *lost, sep="\n")
    return int(any(one.word == "slower" for one in found))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Is this checkout slower than another commit?")
    parser.add_argument("commit", nargs="?", help="default: of the last row of releases.csv")
    parser.add_argument(
        "--pairs", type=int, default=FEWEST, help=f"of processes (default {FEWEST}; thorough: 30)"
    )
    parser.add_argument("--only", nargs="+", choices=WORK, default=list(WORK), help="measures")
    parser.add_argument("--record", metavar="RELEASE", help="write a row of this checkout")
    parser.add_argument("--record-other", metavar="RELEASE", help="write one of the commit")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
