"""The structured solver without its compiler, for tests of its parts."""

from collections.abc import Callable
from types import ModuleType

import pytest

from wideberth.framework.values.arrays import Array

Kernel = Callable[[int, int, Array, Array, Array], None]
"""What a CasADi function is compiled to: offset, count, variables, parameters, results."""


def interpret(monkeypatch: pytest.MonkeyPatch, *modules: ModuleType) -> None:
    """Let every compiled function of these modules be the Python function it was made from."""
    for module in modules:
        for name, value in list(vars(module).items()):
            if hasattr(value, "py_func"):
                monkeypatch.setattr(module, name, value.py_func)
        if hasattr(module, "call"):
            monkeypatch.setattr(module, "call", lambda kernel, *given: kernel(*given))
