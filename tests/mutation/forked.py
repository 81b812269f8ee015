"""Tests run in forked processes, with a function's code exchanged or a module imported anew."""

import gc
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import cache
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType, FrameType, FunctionType, ModuleType
from typing import Any

import pytest

from wideberth.tests.mutation.areas import ROOT, Found
from wideberth.tests.mutation.sites import Site, changed

LONGEST = 5.0
"""CPU seconds; tests that take longer, traced, are left out."""
OPTIONS = ["-s", "-p", "no:terminal", "-p", "no:cacheprovider", "-p", "no:faulthandler"]
"""Of pytest, where it must say and keep nothing."""
Job = Callable[[], tuple[int, str]]
"""What a process does: its exit code, and words for the parent."""


class Watch:
    """Notes for every test that passes its CPU seconds and the functions that it calls."""

    def __init__(self, modules: set[str]) -> None:
        self._modules, self._called = {str(ROOT / one): one for one in modules}, set[CodeType]()
        self.found: dict[str, Found] = {}
        self.total, self.failed, self.longest = 0.0, "", LONGEST
        if modules:
            signal.signal(signal.SIGPROF, _too_long)

    def begin(self) -> None:
        """Before a test."""
        self._called, self._begin = set(), time.process_time()
        if self._modules:
            signal.setitimer(signal.ITIMER_PROF, self.longest)  # ends the test as a failed one
            sys.settrace(self._note)

    def note(self, report: Any) -> None:
        """After the phases of a test."""
        if report.failed and not self.failed:
            self.failed = f"{report.nodeid}: {_kind(report)}"
        if report.when == "call" and report.passed:
            self.found[report.nodeid] = {}
        if report.when == "teardown" and self._modules:
            sys.settrace(None)
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            seconds = time.process_time() - self._begin
            self.total += seconds
            if seconds > self.longest:  # compiled code cannot be interrupted
                self.found.pop(report.nodeid, None)
            if report.nodeid in self.found:
                names = {self._name(code) for code in self._called} - {""}
                self.found[report.nodeid] = {
                    "seconds": round(seconds, 3), "functions": sorted(names),
                }  # fmt: skip

    def _note(self, frame: FrameType, event: str, given: Any) -> None:
        self._called.add(frame.f_code)

    def _name(self, code: CodeType) -> str:
        path = self._modules.get(_real(code.co_filename))
        return f"{path} {code.co_qualname.split('.<locals>')[0]}" if path else ""


class _TooLong(BaseException):
    """Ends a test; no `Exception`, which what is tested may catch."""


def _too_long(number: int, frame: FrameType | None) -> None:
    raise _TooLong("a test took too long")


def _kind(report: Any) -> str:
    crash = getattr(report.longrepr, "reprcrash", None)
    words = str(crash.message if crash else report.longrepr).splitlines()
    first = words[0].split(":")[0] if words else ""
    return "AssertionError" if first.startswith(("assert", "Failed")) else first[:60]


def given(site: Site, module: CodeType) -> bool:
    """Give every function of that name its new code; whether there was one.

    A change outside of the code, such as that of a default argument, is left to `anew`.
    """
    new = _code_of(module, site.owner.split("."))
    path, done = str(ROOT / site.path), False
    if new is None:
        return False
    gc.unfreeze()
    for one in gc.get_objects():
        # Not isinstance: it asks a weak reference's proxy for its class, which may be gone.
        if type(one) is FunctionType and _real(one.__code__.co_filename) == path:
            old = one.__code__
            if old.co_qualname == new.co_qualname and old.co_freevars == new.co_freevars:
                # A property's getter and setter share the name, not the line.
                if old.co_firstlineno == new.co_firstlineno and old != new:
                    one.__code__, done = new, True
    return done


@cache
def _real(filename: str) -> str:
    """Return the path of a file; an editable installation imports it through a link."""
    return os.path.realpath(filename)


def _code_of(code: CodeType, names: list[str]) -> CodeType | None:
    for name in names:
        inside = [one for one in code.co_consts if isinstance(one, CodeType)]
        found = [one for one in inside if one.co_name == name]
        if len(found) != 1:
            return None
        (code,) = found
    return code


def anew(site: Site, source: str, tests: list[str]) -> str:
    """Import package and tests anew with the change made; what failed."""
    for name in [one for one in sys.modules if one.startswith(("wideberth", "tests."))]:
        del sys.modules[name]
    sys.meta_path.insert(0, _Changed(site, source))
    failure = _Failure()
    code = int(pytest.main(["-x", *OPTIONS, *tests], plugins=[failure]))
    return failure.words or (f"pytest ended with {code}" if code else "")


class _Failure:
    """Keeps what failed first, and of which kind."""

    words = ""

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed and not self.words:
            self.words = f"{report.nodeid}: {_kind(report)}"

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed and not self.words:
            self.words = f"{report.nodeid}: ImportError"


class _Changed(SourceFileLoader, MetaPathFinder):
    """Imports one module with a change made."""

    def __init__(self, site: Site, source: str) -> None:
        name = "wideberth." + site.path.removesuffix(".py").replace("/", ".")
        super().__init__(name, str(ROOT / site.path))
        self._tree = changed(source, site.number)

    def find_spec(  # type: ignore[override]
        self, fullname: str, path: Any = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self.name:
            return None
        return spec_from_file_location(fullname, self.path, loader=self)

    def get_code(self, fullname: str) -> CodeType:
        return compile(self._tree, self.path, "exec")


def in_processes(
    jobs: list[tuple[Any, Job]],
    workers: int,
    folder: Path,
    finished: Callable[[Any, int, float, str], None],
) -> None:
    """Run each job in a process of its own, several at a time."""
    waiting = list(reversed(jobs))
    running: dict[int, tuple[Any, Path, float]] = {}
    while waiting or running:
        while waiting and len(running) < workers:
            key, job = waiting.pop()
            words = folder / f".{os.getpid()}-{len(waiting)}.txt"
            if not (pid := os.fork()):
                _child(job, words)
            running[pid] = key, words, time.monotonic()
        pid, status = os.waitpid(-1, 0)
        key, file, begin = running.pop(pid)
        code = os.waitstatus_to_exitcode(status)
        said = file.read_text() if file.exists() else f"took too long (signal {-code})"
        file.unlink(missing_ok=True)
        finished(key, code, time.monotonic() - begin, said)


def _child(job: Job, words: Path) -> None:
    """Run a job quietly and leave, with nothing cleaned up that the parent cleans up."""
    quiet = os.open(os.devnull, os.O_RDWR)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    try:
        code, said = job()
    except BaseException as error:  # a change may do anything
        code, said = 3, f"{type(error).__name__}: {error}"[:200]
    words.write_text(said)
    os._exit(code)
