"""A loop that must not wait: fatrop answers while riccati is compiled, and each plan says so."""

import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest

from wideberth import Observation, build
from wideberth import Path as Route
from wideberth.framework.values.errors import WideberthError
from wideberth.solvers.fatrop import Fatrop
from wideberth.solvers.riccati import compiled, emit, objects
from wideberth.solvers.riccati import solver as riccati
from wideberth.solvers.riccati.live import RiccatiLive
from wideberth.tests.solvers.test_riccati_trouble import (
    digest,
    problem_for,
    recorded_instances,
    solved,
)

WHY = "fatrop, since riccati is still compiled in the background"


@pytest.fixture
def compiler(place: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    """A machine on which no object fits; its compiler takes until ``ready`` is set."""
    code = objects.shipped(objects.KINDS)
    one = SimpleNamespace(ready=Event(), calls=0, fails=False)

    def compile_slowly(kinds: int) -> bytes:
        one.calls += 1
        assert one.ready.wait(60.0)
        if one.fails:
            raise WideberthError("the solver is not compiled: no space")
        return code

    def refuse(kinds: int) -> dict[str, int]:
        raise WideberthError("no shipped object code is for this processor")

    monkeypatch.setattr(emit, "compile_in_subprocess", compile_slowly)
    monkeypatch.setattr(objects, "library", refuse)
    monkeypatch.setattr(compiled, "_COMING", {})
    monkeypatch.setattr(compiled, "_core", cache(compiled._core.__wrapped__))
    riccati._compiled.cache_clear()
    yield one
    one.ready.set()
    for thread in compiled._COMING.values():
        thread.join()
    riccati._compiled.cache_clear()


def finished() -> None:
    (thread,) = compiled._COMING.values()
    thread.join()


def test_fatrop_answers_until_the_core_is_compiled(compiler: SimpleNamespace) -> None:
    instance = recorded_instances()[0]
    given = problem_for(instance), instance.parameters, [instance.guess]
    (plain,) = Fatrop().solve(*given)
    compiled._KNOWN.pop(given[0], None)
    for _ in range(2):
        (early,) = RiccatiLive().solve(*given)
        assert early.stand_in == WHY and digest(early) == digest(plain)
        assert given[0] in compiled._KNOWN  # so that nothing is left to compile when it takes over
    compiler.ready.set()
    finished()
    (late,) = RiccatiLive().solve(*given)
    assert not late.stand_in and compiler.calls == 1
    assert digest(late) == digest(solved(instance)) != digest(plain)


def test_a_compiler_that_fails_is_named_and_asked_once(compiler: SimpleNamespace) -> None:
    instance = recorded_instances()[0]
    given = problem_for(instance), instance.parameters, [instance.guess]
    compiler.fails = True
    compiler.ready.set()
    RiccatiLive().solve(*given)
    finished()
    for _ in range(2):
        (found,) = RiccatiLive().solve(*given)
        assert found.stand_in == "fatrop, since the solver is not compiled: no space"
    assert compiler.calls == 1


def test_riccati_itself_waits(compiler: SimpleNamespace) -> None:
    """So that what an experiment finds does not depend on the time that compiling takes."""
    instance = recorded_instances()[0]
    compiler.ready.set()
    found = solved(instance)
    assert not found.stand_in and compiler.calls == 1


def test_other_code_does_not_wait_for_the_core(compiler: SimpleNamespace) -> None:
    assert compiled.core_is_coming(objects.KINDS)
    compiled._PROBLEMS.clear()
    compiled.compiled_problem(problem_for(recorded_instances()[0]))
    assert compiled.core_is_coming(objects.KINDS)


def test_a_plan_says_who_solved_it(compiler: SimpleNamespace) -> None:
    planner = build("controllers", {
        "type": "mpc", "robot": "unicycle", "predictor": "static", "horizon": 5,
        "region": "mahalanobis_ellipse", "level": "fixed", "solver": "riccati_live"})  # fmt: skip
    planner.set_path(Route(np.array([[0.0, 0.0], [8.0, 0.0]])))
    reasons = []
    for k in range(4):
        planner.command(Observation(0.5 * k, np.array([0.25 * k, 0.2, 0.0, 0.5, 0.0])))
        reasons.append(planner.plan.reason)
        if k == 1:
            compiler.ready.set()
            finished()
    assert reasons == [f"solved by {WHY}", f"solved by {WHY}", "", ""]


@pytest.mark.parametrize(
    ("executable", "why"),
    [("/nowhere/python", "no process can be started"), ("/bin/false", "ended with code 1")],
)
def test_a_process_that_compiles_nothing(
    executable: str, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "executable", executable)
    with pytest.raises(WideberthError, match=why):
        emit.compile_in_subprocess(objects.KINDS)


def test_what_went_wrong_in_the_other_process_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emit, "compiler", lambda: "")
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    with pytest.raises(WideberthError, match=r"not compiled.*NUMBA_DISABLE_JIT is set"):
        emit.compile_in_subprocess(objects.KINDS)


ENDS = """
import atexit, subprocess, sys
from threading import Event, Thread
from wideberth.solvers.riccati import emit
popen, register, begun = subprocess.Popen, atexit.register, Event()
def started(*given, **more):
    made = popen([sys.executable, "-c", "import time; time.sleep(600)"], **more)
    print(made.pid, flush=True)
    return made
def registered(call):
    register(call)
    begun.set()
emit.compiler, subprocess.Popen, atexit.register = str, started, registered
Thread(target=emit.compile_in_subprocess, args=(2,), daemon=True).start()
begun.wait()
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_the_other_process_ends_with_this_one() -> None:
    ran = subprocess.run([sys.executable, "-c", ENDS], capture_output=True, text=True, check=True)
    state = Path("/proc", ran.stdout.strip(), "stat")
    assert not state.exists() or state.read_text().rpartition(")")[2].split()[0] in "ZX"
