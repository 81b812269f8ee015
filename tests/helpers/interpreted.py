"""The structured solver without its compiler, for tests of its parts."""

from collections import OrderedDict
from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pytest

from wideberth.framework.mpc.solvers.riccati import compiled, core, solver
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


def columns(function: Any) -> Kernel:
    """What a CasADi function is compiled to by `numba_source`."""

    def kernel(offset: int, count: int, v: Array, p: Array, out: Array) -> None:
        for c in range(count):
            found = function(v[: function.numel_in(0), offset + c], p[: function.numel_in(1), c])
            out[: function.numel_out(0), c] = np.asarray(found).ravel()

    return kernel


def recursion(function: Any, handed: int) -> Kernel:
    """What a CasADi function is compiled to by `recursion_source`."""

    def kernel(offset: int, count: int, v: Array, p: Array, out: Array) -> None:
        for c in range(count - 1, -1, -1):
            given = np.concatenate([out[:handed, c + 1], v[:, offset + c]])
            found = function(given[: function.numel_in(0)], p[: function.numel_in(1), c])
            out[: function.numel_out(0), c] = np.asarray(found).ravel()

    return kernel


def interpret_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the solver ``riccati`` compile nothing: CasADi evaluates its kernels."""
    kernels: dict[str, Kernel] = {}

    def load(stem: str, source: str, announce: Any) -> Any:
        if stem == "kernels":
            return SimpleNamespace(**kernels)
        names: dict[str, Any] = {"njit": lambda *given, **options: lambda function: function}
        exec(source.replace("from numba import njit", ""), names)
        return SimpleNamespace(solve=np.errstate(all="ignore")(names["solve"]))

    def noted(name: str, kernel: Kernel) -> str:
        kernels[name] = kernel
        return ""

    interpret(monkeypatch, core)
    monkeypatch.setattr(compiled, "numba_source", lambda one, name: noted(name, columns(one)))
    monkeypatch.setattr(
        compiled, "recursion_source", lambda one, name, handed: noted(name, recursion(one, handed))
    )
    monkeypatch.setattr(compiled, "address", lambda kernel: kernel)
    monkeypatch.setattr(compiled, "load", load)
    monkeypatch.setattr(compiled, "_PROBLEMS", OrderedDict())
    monkeypatch.setattr(compiled, "_KNOWN", WeakKeyDictionary())
    monkeypatch.setattr(compiled, "_core", compiled._core.__wrapped__)
    monkeypatch.setattr(solver, "_compiled", solver._compiled.__wrapped__)
