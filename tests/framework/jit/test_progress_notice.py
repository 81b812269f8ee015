"""Whoever compiles or waits says so where that is worth it, with what it usually takes."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from threading import Thread

import pytest

from wideberth.framework.jit import folder, load, patience
from wideberth.framework.jit.patience import announced, note_seconds, usual_seconds

DOUBLE = """define double @double(double %x) {
  %y = fmul double 2.0, %x
  ret double %y
}
"""


def test_it_speaks_at_once_now_and_then_and_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "_EVERY", 0.02)
    monkeypatch.setattr(patience, "_LONG", 0.01)
    said: list[str] = []
    with announced(said.append, "compiling it", 60.0):
        assert said == ["compiling it, usually about 60 s ..."]
        while len(said) < 3:
            time.sleep(0.01)
    assert said[1] == "compiling it: 0 s so far, usually about 60 s"
    assert said[-1] == "compiling it: 0 s, done"


@pytest.mark.parametrize("usual", [0.0, 0.4, 0.99, None])
def test_what_takes_no_time_is_worth_no_line(usual: float | None) -> None:
    said: list[str] = []
    with announced(said.append, "compiling it", usual):
        pass
    assert said == []
    with announced(said.append, "compiling it", usual, at_once=True):
        assert said == ["compiling it ..."]
    with announced(said.append, "compiling it", 1.0):
        assert said[-1] == "compiling it, usually about 1 s ..."


@pytest.mark.parametrize("usual", [0.01, None])
def test_what_takes_longer_than_usual_is_announced_then(
    usual: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patience, "WORTH", 0.02)
    said: list[str] = []
    with announced(said.append, "compiling it", usual):
        begin = time.monotonic()
        while not said:
            time.sleep(0.002)
        assert time.monotonic() - begin > 0.01
    assert said == ["compiling it ..."]


def test_code_that_is_compiled_in_no_time_says_nothing(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first time, and when it is known here that it takes no time."""
    monkeypatch.setattr(patience, "WORTH", 60.0, raising=False)  # a machine may be busy
    said: list[str] = []
    for source in (DOUBLE, DOUBLE + "\n"):
        load("tested", source, ["double"], said.append)
    assert said == [] and usual_seconds(place, "tested", None) is not None


def test_a_machine_tells_what_it_took_there(
    again: Callable[[str], list[str]], place: Path
) -> None:
    (line,) = again(DOUBLE)
    assert line.startswith("compiling tested (once)")
    assert usual_seconds(place, "tested", None) is not None
    note_seconds(place, "tested", 41.6)
    assert again(DOUBLE + "\n") == ["compiling tested (once), usually about 42 s ..."]
    for damaged in ("[1]", "{", '{"tested": "1"}', '{"tested": -1}', f'"{"x" * 20_000}"'):
        (place / ".times.json").write_text(damaged)
        assert usual_seconds(place, "tested", 7.0) == 7.0
    note_seconds(place / "missing", "tested", 1.0)  # nothing can be kept: nothing happens


def test_who_waits_for_another_process_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patience, "WORTH", 0.0)
    said: list[str] = []

    def waits() -> None:
        with folder.alone(tmp_path, "it", announced(said.append, "waiting for another", None)):
            said.append("mine")

    with folder.alone(tmp_path, "it", nullcontext()):
        thread = Thread(target=waits)
        thread.start()
        while not said:
            time.sleep(0.01)
        assert said == ["waiting for another ..."]
    thread.join()
    assert said == ["waiting for another ...", "mine"]
