"""A plug-in that raises while robots drive: the run says so, once, with the line of the file."""

import re
from pathlib import Path

import pytest

import wideberth
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.failures import caught, in_words, reporting

PREDICTOR = """\
from dataclasses import dataclass
from pathlib import Path

from wideberth.framework.predictor import Predictor


@dataclass(frozen=True)
class Odd(Predictor):
    def predict(self, tracks, steps, scene=None):
        raise RuntimeError(f"my bug at {tracks.stamp}")
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_a_run_says_once_where_a_predictor_raises(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    workers: int,
) -> None:
    module = tmp_path / f"odd_by_{workers}.py"
    module.write_text(PREDICTOR)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    odd = {"type": f"{module.stem}:Odd"}
    changes = {"settings.time_limit": 2.0, "planners.default.predictor": odd}
    result = wideberth.run("crossing", changes, seeds=2, folder=tmp_path / "o", workers=workers)
    error = capsys.readouterr().err
    place = rf"RuntimeError: my bug at [0-9.]+ \({re.escape(str(module))}, line 10\)"
    assert len(re.findall(place, error)) == 1 and "`wideberth check`" in error, error
    own = [row["errors"] for row in result.rows if row["planner"] == "default"]
    assert len(own) == 2 and all(re.search(place, words) for words in own)


def test_only_what_is_not_ours_has_a_place_and_is_reported() -> None:
    found: dict[str, str] = {}
    with reporting(found.setdefault):
        assert caught(WideberthError("no room")) == "WideberthError: no room"
        assert not found
        try:
            exec(compile("\n\n1 / 0", "/home/me/mine.py", "exec"), {"__name__": "mine"})
        except ZeroDivisionError as error:
            words = caught(error)
    assert words == "ZeroDivisionError: division by zero (/home/me/mine.py, line 3)"
    assert found == {"ZeroDivisionError (/home/me/mine.py, line 3)": words}
    assert in_words(KeyError()) == "KeyError"
