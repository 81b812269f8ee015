"""The mutation study: does a test fail when the code is changed for the worse?

    python -m wideberth.tests.mutation.study --seed 1 --count 160

Draws changes (`sites`) of the modules in `AREAS`, the same number from every area or from those
that ``--areas`` names. For each it runs the tests that reach the changed function, until one
fails. Which tests do is measured first: every test is run once on the code as it is, and what it
calls of the modules is kept.

The working tree is never touched. Tests are collected once; a change is made in the memory of a
process forked from there, which gives the changed function its new code. What stands outside of
functions takes effect on import alone: there the package is imported anew.

Everything measured is kept under ``--out`` and taken up again: a killed change stays killed while
its module is the same; those that survived are tried again. `survivors.yaml` lists changes that
change nothing, with the reason; an entry that is no change any more, or is killed, is reported.
"""

import argparse
import gc
import json
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from wideberth.tests.mutation.areas import AREAS, ROOT, TESTS, Found, draw, paths, reaching
from wideberth.tests.mutation.forked import LONGEST, OPTIONS, Job, Watch, anew, given, in_processes
from wideberth.tests.mutation.sites import Site, changed, sites

ENOUGH = 8.0
"""CPU seconds of one test file, after which its other tests may take `SHORT` alone; after twice as
many they are left out."""
SHORT = 0.5
PATIENCE = (0.0, 5.0, 40.0)
"""CPU seconds of tests, as measured, that are run against one change: in a first round over all
changes, and in a second one over those that have survived."""

SURVIVED, KILLED, UNREACHED = 0, 1, 5


def main() -> int:
    """Collect the tests, and do everything else from within pytest's loop."""
    asked = _arguments()
    os.chdir(ROOT)
    os.nice(10)
    found = [str(one.relative_to(ROOT)) for folder in ("tests", "packages")
             for one in sorted((ROOT / folder).rglob("test_*.py"))]  # fmt: skip
    chosen = [one for one in found if any(f"test_{part}" in one for part in TESTS)]
    return int(pytest.main([*OPTIONS, *chosen], plugins=[_Study(asked)]))


class _Study:
    """Takes the place of pytest's own loop over the tests."""

    def __init__(self, asked: argparse.Namespace) -> None:
        self._asked, self._out = asked, Path(asked.out)
        self._out.mkdir(parents=True, exist_ok=True)
        self.watch: Watch | None = None

    def pytest_runtest_logreport(self, report: Any) -> None:
        if self.watch is not None:  # in a forked process
            self.watch.note(report)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Measure, draw, run, and write the table."""
        self._items: dict[str, list[pytest.Item]] = {}
        for item in session.items:
            self._items.setdefault(item.nodeid.split("::")[0], []).append(item)
        gc.freeze()
        areas = self._asked.areas
        modules = {path: (ROOT / path).read_text() for area in areas for path in paths(area)}
        reached = self._measured(modules)
        drawn = draw(modules, self._asked.seed, self._asked.count, areas)
        results = self._results(modules, drawn, reached)
        print(table(drawn, results))
        return True

    def _results(
        self, modules: dict[str, str], drawn: list[tuple[str, Site]], reached: dict[str, Found]
    ) -> dict[str, Found]:
        kept = self._out / f"mutants-{self._asked.seed}.json"
        results: dict[str, Found] = json.loads(kept.read_text()) if kept.exists() else {}

        def finished(site: Site, code: int, seconds: float, words: str) -> None:
            verdict = {SURVIVED: "survived", UNREACHED: "unreached"}.get(code, "killed")
            results[str(site)] = {
                "verdict": verdict, "line": site.line, "seconds": round(seconds, 1),
                "by": words, "source": _digest(modules[site.path]),
            }  # fmt: skip
            print(f"{verdict:9} {seconds:5.1f} s  {site.path}:{site.line} {site.text} [{words}]")
            sys.stdout.flush()
            kept.write_text(json.dumps(results, indent=1))

        for share in pairwise(PATIENCE):
            jobs = []
            for _, site in drawn:
                known = results.get(str(site), {})
                same = known.get("source") == _digest(modules[site.path])
                if known.get("verdict") != "killed" or not same:
                    jobs.append((site, self._killer(site, modules[site.path], reached, share)))
            in_processes(jobs, self._asked.workers, self._out, finished)
        kept.with_suffix(".md").write_text(table(drawn, results))  # seconds: every change there is
        return results

    def _measured(self, modules: dict[str, str]) -> dict[str, Found]:
        """CPU seconds and functions of every test; files are run if they or the areas are new."""
        file = self._out / "reached.json"
        known: dict[str, Found] = json.loads(file.read_text()) if file.exists() else {}
        digests = {name: _digest((ROOT / name).read_text(), *modules) for name in self._items}

        def finished(name: str, code: int, seconds: float, words: str) -> None:
            found = json.loads(words) if words.startswith("{") else {}
            known[name] = {"source": digests[name], "tests": found}
            print(f"measured {name}: {len(found)} tests, {seconds:.0f} s", flush=True)
            file.write_text(json.dumps(known))

        jobs = [
            (name, self._measurer(name, set(modules)))
            for name in self._items
            if known.get(name, {}).get("source") != digests[name]
        ]
        in_processes(jobs, self._asked.workers, self._out, finished)
        here = {item.nodeid for items in self._items.values() for item in items}
        return {
            test: found
            for name in self._items
            for test, found in known[name]["tests"].items()
            if test in here
        }

    def _measurer(self, name: str, modules: set[str]) -> Job:
        def run() -> tuple[int, str]:
            self.watch = watch = Watch(modules)

            def enough() -> bool:
                watch.longest = SHORT if watch.total > ENOUGH else LONGEST
                return watch.total > 2.0 * ENOUGH

            self._run(self._items[name], enough)
            return SURVIVED, json.dumps(watch.found)

        return run

    def _killer(
        self, site: Site, source: str, reached: dict[str, Found], share: tuple[float, float]
    ) -> Job:
        def run() -> tuple[int, str]:
            tests = reaching(site, source, reached)
            if not tests:
                return UNREACHED, "no test reaches it"
            begin = np.cumsum([0.0, *(reached[test]["seconds"] for test in tests)])
            first, last = np.searchsorted(begin, share)
            some, done = tests[first:last], min(last, len(tests))
            if not some:
                return SURVIVED, f"{done} of {len(tests)} tests"
            limit = int(30 + 5 * sum(reached[test]["seconds"] for test in some))
            resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
            signal.alarm(20 * limit)
            words = self._in_place(site, source, some)
            if words is None:
                words = anew(site, source, some)
            return (KILLED, words) if words else (SURVIVED, f"{done} of {len(tests)} tests")

        return run

    def _in_place(self, site: Site, source: str, tests: list[str]) -> str | None:
        """Give the function its new code; None where that is not possible."""
        if site.names or not given(site, compile(changed(source, site.number), "x", "exec")):
            return None
        self.watch = watch = Watch(set())
        items = {item.nodeid: item for found in self._items.values() for item in found}
        self._run([items[test] for test in tests], lambda: bool(watch.failed))
        return watch.failed

    def _run(self, items: list[pytest.Item], enough: Callable[[], bool]) -> None:
        """Run tests as pytest does, until it is enough."""
        for item, following in zip(items, [*items[1:], None], strict=True):
            if self.watch is not None:
                self.watch.begin()
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if enough():
                break


def table(drawn: list[tuple[str, Site]], results: dict[str, Found]) -> str:
    """Counts per area, and every change that survived, with the reason where one is known."""
    reasons, tried = (
        survivors(),
        [(area, str(site)) for area, site in drawn if str(site) in results],
    )
    rows = [
        ["area", "changes", "killed", "by an assertion", "survived", "equivalent"],
        ["---"] * 6,
    ]
    for area in [*AREAS, "all"]:
        mine = [results[name] | {"name": name} for own, name in tried if area in (own, "all")]
        killed = [one for one in mine if one["verdict"] == "killed"]
        asserted = [one for one in killed if one["by"].endswith("AssertionError")]
        alike = [one for one in mine if one not in killed and one["name"] in reasons]
        numbers = (len(mine), len(killed), len(asserted), len(mine) - len(killed), len(alike))
        rows.append([area, *map(str, numbers)])
    lines = [f"| {' | '.join(row)} |" for row in rows]
    share = len(killed) / max(len(mine), 1)
    differ = len(killed) / max(len(mine) - len(alike), 1)
    lines += ["", f"{len(mine)} of {len(drawn)} changes tried, {share:.1%} killed; of those that "
              f"change something {differ:.1%}.", ""]  # fmt: skip
    lines += [
        f"- {name} ({results[name]['by']}): {reasons.get(name, 'no reason known')}"
        for _, name in tried
        if results[name]["verdict"] != "killed"
    ]
    return "\n".join([*lines, *(f"- listed, but {one}" for one in stale(results)), ""])


def survivors() -> dict[str, str]:
    """Changes that change nothing, with the reason."""
    file = Path(__file__).with_name("survivors.yaml")
    return dict(yaml.safe_load(file.read_text()) or {}) if file.exists() else {}


def stale(results: dict[str, Found]) -> Iterator[str]:
    """Entries that are no change of the code as it is, or that a test kills."""
    named = {one.split(" ")[0] for one in survivors()}
    modules = named & {path for area in AREAS for path in paths(area)}
    every = {str(site) for path in modules for site in sites(path, (ROOT / path).read_text())}
    for one in survivors():
        if one not in every:
            yield f"no such change: {one}"
        elif results.get(one, {}).get("verdict") == "killed":
            yield f"killed by {results[one]['by']}: {one}"


def _digest(*texts: str) -> str:
    return sha256("\0".join(texts).encode()).hexdigest()[:16]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--count", type=int, default=160, help="changes, over all areas")
    parser.add_argument("--areas", nargs="+", choices=AREAS, default=[*AREAS], help="default: all")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", default="results/mutants", help="folder for what is measured")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
