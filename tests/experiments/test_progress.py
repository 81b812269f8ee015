"""Nobody waits in silence: bars, spinners and lines within a second."""

import time

import pytest

from wideberth.experiments.engine import progress as module
from wideberth.experiments.engine.progress import progress, working


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
