"""A store of compiled code that tests fill."""

import ctypes
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of compiled code, and a process that has loaded none."""
    from wideberth.framework.jit import store

    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(store, "_LOADED", {})
    return tmp_path / "cache" / "jit"


@pytest.fixture
def again(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[str]]:
    """Load a source of `double` as a new process would, and return what was announced.

    Every compilation is announced, however short: it is what tests look at.
    """
    from wideberth.framework.jit import load, store

    monkeypatch.setattr(store, "WORTH", 0.0)

    def loaded(source: str) -> list[str]:
        monkeypatch.setattr(store, "_LOADED", {})
        said: list[str] = []
        place = load("tested", source, ["double"], said.append)["double"]
        assert ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(place)(4.0) == 8.0
        return said

    return loaded
