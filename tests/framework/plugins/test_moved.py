"""Old names of modules: each still imports, says what it is called now, and is the same module."""

import sys
from importlib import import_module

import pytest

from wideberth.framework.plugins.moved import MOVED


@pytest.mark.parametrize("old", MOVED)
def test_an_old_name_is_the_new_module(old: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, old, raising=False)
    with pytest.warns(FutureWarning, match=f"{old} is now {MOVED[old]}"):
        found = import_module(old)
    assert found is import_module(MOVED[old]) and found.__name__ == MOVED[old]


def test_names_come_from_an_old_module() -> None:
    sys.modules.pop("wideberth.framework.forecast", None)
    with pytest.warns(FutureWarning, match="framework.values.forecast"):
        from wideberth.framework.forecast import Forecast  # type: ignore[import-not-found]
    from wideberth import Forecast as New

    assert Forecast is New


def test_what_never_was_there_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"framework\.forecasts"):
        import_module("wideberth.framework.forecasts")
