"""The structured solver without its compiler, for tests of its parts."""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from types import ModuleType, SimpleNamespace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pytest

from wideberth.framework.values.arrays import Array
from wideberth.solvers.riccati import _core as core
from wideberth.solvers.riccati import compiled, solver
from wideberth.solvers.riccati.workspace import Workspace

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
    """What a CasADi function is compiled to by `kernel_source`."""

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
    kernels: dict[int, Kernel] = {}

    def ready(functions: Mapping[str, Any], handed: int) -> SimpleNamespace:
        places: dict[str, int] = {}
        for name, one in functions.items():
            places[name] = len(kernels)
            kernels[len(kernels)] = recursion(one, handed) if name == "sweep" else columns(one)
        return SimpleNamespace(place=places.__getitem__)

    def run(space: Workspace, entry: object, stop: Array | None = None) -> None:
        plain, head, start, *slots, found, end = space.groups
        flag = end.flag if stop is None else stop
        with np.errstate(all="ignore"):
            core.solve(*plain, head, start, tuple(slots), found, flag)

    interpret(monkeypatch, core)
    monkeypatch.setattr(core, "call", lambda kernel, *given: kernels[int(kernel)](*given))
    monkeypatch.setattr(compiled, "core", lambda kinds: None)
    monkeypatch.setattr(compiled, "_ready", ready)
    monkeypatch.setattr(compiled, "_PROBLEMS", OrderedDict())
    monkeypatch.setattr(compiled, "_KNOWN", WeakKeyDictionary())
    monkeypatch.setattr(Workspace, "run", run)
    monkeypatch.setattr(solver, "_compiled", solver._compiled.__wrapped__)
