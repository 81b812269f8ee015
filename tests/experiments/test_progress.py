"""Nobody waits in silence: bars, spinners and lines within a second, with an honest estimate."""

import time

import numpy as np
import pytest

from wideberth.experiments.engine import progress as module
from wideberth.experiments.engine.progress import progress, time_left, working


def test_the_range_holds_what_then_comes() -> None:
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(400):
        pauses = rng.exponential(10.0, 40)
        text = time_left(list(pauses[:15]), 25)
        least, most = map(float, text.partition("(")[2].rstrip(")").split(" to "))
        unit = 60.0 if " min " in text else 1.0
        inside += least - 0.5 <= pauses[15:].sum() / unit <= most + 0.5
    assert 0.9 < inside / 400 < 0.99


def test_hours_are_written_as_such() -> None:
    assert time_left([3000.0] * 3, 4) == "about 3 h 20 min left (3 h 20 min to 3 h 20 min)"
    assert time_left([0.1], 9) == "" and time_left([0.1], 10) == "about 1 s left"


def test_a_log_gets_a_line_soon_and_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "_SOON", 0.02)
    monkeypatch.setattr(module, "_EVERY", 0.0)
    with progress(4, 1) as advance:
        time.sleep(0.2)
        assert capsys.readouterr().err == "1 of 4 tasks\n"
        advance()
        assert capsys.readouterr().err == "2 of 4 tasks\n"
    with working("drawing"):
        time.sleep(0.2)
    printed = capsys.readouterr()
    assert printed.err == "drawing ...\n" and printed.out == ""


def test_quick_work_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with progress(1) as advance, working("drawing"):
        advance()
    assert capsys.readouterr() == ("", "")
