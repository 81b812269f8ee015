"""Compiling and waiting is announced where it is worth it, with what it usually takes."""

import time
from contextlib import nullcontext
from pathlib import Path
from threading import Thread

import pytest

from wideberth.framework.jit import cache, load, store
from wideberth.framework.jit.store import progress_notice

DOUBLE = """define double @double(double %x) {
  %y = fmul double 2.0, %x
  ret double %y
}
"""


def test_it_speaks_at_once_now_and_then_and_at_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "_EVERY", 0.02)
    monkeypatch.setattr(store, "_LONG", 0.01)
    said: list[str] = []
    with progress_notice(said.append, "compiling it", 60.0):
        assert said == ["compiling it, usually about 60 s ..."]
        while len(said) < 3:
            time.sleep(0.01)
    assert said[1] == "compiling it: 0 s so far, usually about 60 s"
    assert said[-1] == "compiling it: 0 s, done"


@pytest.mark.parametrize("usual", [0.0, 0.4, 0.99, None])
def test_what_takes_no_time_is_worth_no_line(usual: float | None) -> None:
    said: list[str] = []
    with progress_notice(said.append, "compiling it", usual):
        pass
    assert said == []
    with progress_notice(said.append, "compiling it", usual, at_once=True):
        assert said == ["compiling it ..."]
    with progress_notice(said.append, "compiling it", 1.0):
        assert said[-1] == "compiling it, usually about 1 s ..."


@pytest.mark.parametrize("usual", [0.01, None])
def test_what_takes_longer_than_usual_is_announced_then(
    usual: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "WORTH", 0.02)
    said: list[str] = []
    with progress_notice(said.append, "compiling it", usual):
        begin = time.monotonic()
        while not said:
            time.sleep(0.002)
        assert time.monotonic() - begin > 0.01
    assert said == ["compiling it ..."]


def test_code_that_is_compiled_in_no_time_says_nothing(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "WORTH", 60.0, raising=False)  # a machine may be busy
    said: list[str] = []
    for source in (DOUBLE, DOUBLE + "\n"):
        load("tested", source, ["double"], said.append)
    assert said == []


def test_waiting_for_another_process_is_announced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "WORTH", 0.0)
    said: list[str] = []

    def waits() -> None:
        with cache.alone(
            tmp_path / "wideberth_it_0.o",
            progress_notice(said.append, "waiting for another", None),
        ):
            said.append("mine")

    with cache.alone(tmp_path / "wideberth_it_0.o", nullcontext()):
        thread = Thread(target=waits)
        thread.start()
        while not said:
            time.sleep(0.01)
        assert said == ["waiting for another ..."]
    thread.join()
    assert said == ["waiting for another ...", "mine"]
