"""Former names work for one minor version, with a warning that names the new one."""

import warnings
from dataclasses import dataclass
from typing import final

import pytest

import wideberth
from wideberth import WideberthError, build
from wideberth.framework.plugins.config import construct
from wideberth.framework.plugins.deprecated import FORMER, Former, current
from wideberth.framework.plugins.registry import class_path, load
from wideberth.predictors import Kalman


@final
@dataclass(frozen=True)
class Gate:
    """What a config sets."""

    width: float = 1.0


@pytest.fixture(autouse=True)
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    former = Former("width", "9.2")
    monkeypatch.setitem(FORMER, class_path(Gate), {"opening": former})
    monkeypatch.setitem(FORMER, "wideberth", {"Trail": Former("Path", "9.2")})
    monkeypatch.setitem(FORMER, "predictors", {"calman": Former("kalman", "9.2")})


SAYS = r"is '{}' now; the former name goes in wideberth 9\.2"


def test_a_name_of_a_package_is_found_under_its_former_name() -> None:
    with pytest.warns(DeprecationWarning, match="'Trail' of wideberth " + SAYS.format("Path")):
        assert wideberth.Trail is wideberth.Path  # type: ignore[attr-defined]
    assert "Trail" not in dir(wideberth)


def test_a_plug_in_is_found_under_its_former_name() -> None:
    with pytest.warns(DeprecationWarning, match="of predictors " + SAYS.format("kalman")):
        assert load("predictor", "calman") is Kalman
    with pytest.warns(DeprecationWarning, match=SAYS.format("kalman")):
        assert isinstance(build("predictors", {"type": "calman", "speed": 0.3}), Kalman)


def test_a_key_is_read_under_its_former_name() -> None:
    with pytest.warns(DeprecationWarning, match="'opening' of .*:Gate " + SAYS.format("width")):
        assert construct(Gate, {"opening": 2.0}, "gate") == Gate(2.0)


def test_a_key_under_both_names_is_refused() -> None:
    with (
        pytest.warns(DeprecationWarning),
        pytest.raises(WideberthError, match=r"gate\.opening: 'opening' is 'width' now; give one"),
    ):
        construct(Gate, {"width": 1.0, "opening": 2.0}, "gate")


def test_present_names_warn_of_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert construct(Gate, {"width": 2.0}, "gate") == Gate(2.0)
        assert current("wideberth", "Path") == "Path" == current("elsewhere", "Path")


@pytest.mark.parametrize(
    "use", ["from wideberth import Trail", "import wideberth\nwideberth.Trail"]
)
def test_the_warning_names_the_line_of_the_script(use: str) -> None:
    code = compile(f"\n\n{use}\n", "script.py", "exec")
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        exec(code, {"__name__": "script"})
    assert {(one.filename, one.lineno) for one in found} == {("script.py", 3 + use.count("\n"))}


def test_no_former_name_outlives_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the version that a warning names, the entry goes."""
    monkeypatch.undo()  # the made-up ones
    present = numbers(wideberth.__version__)
    late = [name for names in FORMER.values() for name, one in names.items()
            if numbers(one.until) <= present]  # fmt: skip
    assert late == []


def numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in version.split("rc")[0].split("."))
