"""Absurd input for everything that is called in a control loop, and for configs.

    python tests/fuzz/fuzz.py                          # make fuzz
    python tests/fuzz/fuzz.py --only planner.12.3      # one case again, call by call
    python tests/fuzz/fuzz.py --quick --out DIR

See benchmarks/README.md for what is counted.
"""

import argparse
import logging
import multiprocessing as mp
import os
import resource
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

import fuzz_cases  # noqa: E402
import fuzz_scans  # noqa: E402
from fuzz_cases import BATCH, CONTROLLERS, TICKS, Call, optional, rivals, setups  # noqa: E402

from wideberth.experiments.engine.csv_tables import write_table  # noqa: E402
from wideberth.framework.plugins.registry import names  # noqa: E402

HANGS = 120.0
"""s by the clock after which a call counts as hanging and its process is killed."""
COMPILES = 1200.0
"""s by the clock for building a controller, compiling included."""
MEMORY = 12 * 2**30
"""bytes of address space per process: what asks for more gets a MemoryError."""

Case = tuple[str, int, int]
"""Kind, index of what is under test, seed."""
QUICK = ("dynamic_window", "nav2", "orca", "social_force")
"""Rivals of the dry run; none of them compiles anything for long."""
QUICK_PREDICTORS = ("adaptive_conformal", "game", "imm")


@dataclass
class Tally:
    """Counts of one part under test."""

    calls: int = 0
    faults: Counter[str] = field(default_factory=Counter)
    clock: float = 0.0
    processor: float = 0.0
    over: int = 0

    def add(self, call: Call) -> None:
        """Count one call."""
        self.calls += 1
        if call.fault:
            self.faults[call.fault] += 1
        if call.limit:
            self.clock = max(self.clock, call.clock / call.limit)
            self.processor = max(self.processor, min(call.clock, call.processor) / call.limit)
            self.over += call.clock > 2 * call.limit


AMOUNTS = {
    "node": (4_000, TICKS), "detector": (5_000, BATCH), "optional": (4_000, TICKS),
    "planner": (10_000, TICKS), "rival": (2_000, TICKS), "predictor": (100_000, BATCH),
    "config": (500, 1),
}  # fmt: skip
"""Calls of each kind that are made by default, and how many a case makes."""


def cases(kind: str, index: int, seed: int) -> Iterator[Call]:
    """Return the calls of one case."""
    return (fuzz_scans if kind in ("node", "detector") else fuzz_cases).cases(kind, index, seed)


def things(kind: str) -> int:
    """Count what is under test."""
    return {
        "node": lambda: len(fuzz_scans.nodes()),
        "detector": lambda: len(fuzz_scans.sensing()),
        "optional": lambda: len(optional()),
        "planner": lambda: len(setups()),
        "rival": lambda: len(rivals()),
        "predictor": lambda: len(names("predictors")),
        "config": lambda: 1,
    }[kind]()


def chunks(amounts: dict[str, int]) -> list[list[Case]]:
    """Return the cases of each kind, those of one thing under test together."""
    made = []
    for kind, (_, size) in AMOUNTS.items():
        if not amounts.get(kind):
            continue
        count = things(kind)
        each = -(-amounts[kind] // (count * size))
        for index in range(count):
            whole = [(kind, index, seed) for seed in range(each)]
            step = 50 if kind == "config" else max(len(whole), 1)
            made += [whole[k : k + step] for k in range(0, len(whole), step)]
    return made


def quick() -> list[Case]:
    """Return the cases of the dry run."""
    kinds, predictors = [one["type"] for one in rivals()], names("predictors")
    return [
        *(("rival", kinds.index(name), 0) for name in QUICK),
        *(("predictor", predictors.index(name), 0) for name in QUICK_PREDICTORS),
        ("detector", 2, 0),
        ("node", 3, 0),
        *(("config", 0, seed) for seed in range(5)),
    ]


def work(chunk: list[Case], pipe: Connection) -> None:
    """Do the cases of a chunk; before each call say which one it is."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    logging.getLogger("wideberth").setLevel(logging.CRITICAL)  # the same as the reasons
    for case in chunk:
        pipe.send(("begin", case))
        if case[0] in CONTROLLERS:
            fuzz_cases.controller(*case[:2])
        elif case[0] == "node":
            fuzz_scans.node_controller(case[1])
        pipe.send(("ready", case))
        for call in cases(*case):
            pipe.send(("call", case, call))
    pipe.send(("end",))


@dataclass
class Running:
    """A process at work, and since when it has said nothing."""

    process: "mp.process.BaseProcess"
    pipe: Connection
    left: list[Case]
    since: float
    building: bool = True


class Pool:
    """Processes that may hang or die without taking the run with them."""

    def __init__(
        self,
        todo: list[list[Case]],
        workers: int,
        until: float,
        task: Callable[[list[Case], Connection], None] = work,
    ) -> None:
        self.todo, self.workers, self.until, self.task = todo, workers, until, task
        self.context = mp.get_context("spawn")
        self.running: list[Running] = []
        self.tallies: dict[str, Tally] = defaultdict(Tally)
        self.faults: list[dict[str, str]] = []
        self.unfinished = 0

    def run(self) -> None:
        """Work until nothing is left or time is up."""
        while self.todo or self.running:
            if time.monotonic() > self.until:
                self._give_up()
                return
            while self.todo and len(self.running) < self.workers:
                self._begin(self.todo.pop(0))
            for pipe in wait([one.pipe for one in self.running], timeout=1.0):
                self._listen(next(one for one in self.running if one.pipe is pipe))
            for one in list(self.running):
                silent = time.monotonic() - one.since
                if silent > (COMPILES if one.building else HANGS):
                    self._end(one, f"hangs for {silent:.0f} s")

    def _begin(self, chunk: list[Case]) -> None:
        ours, theirs = self.context.Pipe()
        process = self.context.Process(target=self.task, args=(chunk, theirs), daemon=True)
        process.start()
        theirs.close()
        self.running.append(Running(process, ours, list(chunk), time.monotonic()))

    def _listen(self, one: Running) -> None:
        """Take what a process has said."""
        try:
            said = one.pipe.recv()
        except (EOFError, ConnectionResetError):
            one.process.join(5.0)
            self._end(one, f"died with {one.process.exitcode}")
            return
        one.since = time.monotonic()
        if said[0] == "end":
            one.process.join()
            self.running.remove(one)
        elif said[0] == "begin":
            one.building = True
            del one.left[: one.left.index(said[1])]
        elif said[0] == "ready":
            one.building = False
        else:
            self.note(said[1], said[2])

    def note(self, case: Case, call: Call) -> None:
        """Count a call, and keep it where something was wrong."""
        self.tallies[call.what].add(call)
        if call.fault:
            self._fault(case, call.what, call.fault, call.detail)

    def _fault(self, case: Case, what: str, fault: str, detail: str) -> None:
        only = ".".join(map(str, case))
        self.faults.append({"only": only, "what": what, "fault": fault, "detail": detail})
        print(f"  {fault}: {what}, --only {only}: {detail}", flush=True)

    def _end(self, one: Running, why: str) -> None:
        """Kill a process, blame the case that it was at, and go on after it."""
        case = one.left[0]
        self.tallies[case[0]].faults["hangs"] += 1
        self._fault(case, case[0], "hangs", why)
        one.process.kill()
        one.process.join()
        self.running.remove(one)
        rest = [] if one.building else one.left[1:]  # what cannot be built is not tried again
        if rest:
            self.todo.insert(0, rest)

    def _give_up(self) -> None:
        self.unfinished = sum(map(len, self.todo)) + sum(len(one.left) for one in self.running)
        for one in self.running:
            one.process.kill()
            one.process.join()


FAULTS = ("raised", "caught", "contract", "nan", "late", "config", "hangs")


def table(pool: Pool) -> list[dict[str, object]]:
    """Return a row for each part under test."""
    rows: list[dict[str, object]] = []
    for what in sorted(pool.tallies):
        one = pool.tallies[what]
        row: dict[str, object] = {"what": what, "calls": one.calls}
        row |= {fault: one.faults[fault] for fault in FAULTS}
        row["over_twice_by_the_clock"] = one.over
        row["worst_clock_over_limit"] = round(one.clock, 3)
        row["worst_processor_over_limit"] = round(one.processor, 3)
        rows.append(row)
    return rows


def again(only: str, pool: Pool) -> None:
    """Repeat one case here, and print every call."""
    kind, index, seed = only.split(".")
    for number, call in enumerate(cases(kind, int(index), int(seed))):
        mark = call.fault or "well"
        print(f"{number}: {mark} {call.clock:.3f} s, {call.processor:.3f} s cpu {call.detail}")
        pool.note((kind, int(index), int(seed)), call)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz; the exit code is 1 where anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    for kind, (count, _) in AMOUNTS.items():
        parser.add_argument(f"--{kind}", type=int, default=count, help=f"calls of a {kind}")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=60.0, help="after which it gives up")
    parser.add_argument("--only", help="one case, as KIND.INDEX.SEED")
    parser.add_argument("--quick", action="store_true", help="a few cases of each kind, here")
    parser.add_argument("--out", type=Path, default=Path("results/fuzz"))
    given = parser.parse_args(arguments)
    todo = chunks({kind: getattr(given, kind) for kind in AMOUNTS})
    pool = Pool(todo, given.workers, time.monotonic() + 60.0 * given.minutes)
    if given.only:
        again(given.only, pool)
    elif given.quick:
        for case in quick():
            for call in cases(*case):
                pool.note(case, call)
    else:
        pool.run()
    rows = table(pool)
    given.out.mkdir(parents=True, exist_ok=True)
    write_table(given.out / "fuzz.csv", rows)
    if pool.faults:
        write_table(given.out / "faults.csv", pool.faults)
    for row in rows:
        print("  ".join(f"{key} {value}" for key, value in row.items() if value != 0))
    total = Counter(one["fault"] for one in pool.faults)
    print(
        f"{sum(one.calls for one in pool.tallies.values())} calls; faults: {dict(total) or 'none'}"
    )
    if pool.unfinished:
        print(f"time was up: {pool.unfinished} cases were not done")
    return 1 if pool.faults or pool.unfinished else 0


if __name__ == "__main__":
    sys.exit(main())
