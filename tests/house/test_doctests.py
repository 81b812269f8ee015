"""Every example in a docstring runs.

``pytest --doctest-modules`` would import the modules a second time under other names.
"""

import doctest
import importlib
import pkgutil

import numpy as np
import pytest

import wideberth

MODULES = sorted(
    info.name
    for room in ("framework", "people", "metrics", "predictors", "regions", "robots", "routes",
    "perception", "solvers", "controllers", "nav2", "simulation", "ros", "experiments")
    for info in pkgutil.walk_packages([f"{wideberth.__path__[0]}/{room}"], f"wideberth.{room}.")
)  # fmt: skip


@pytest.mark.parametrize("name", MODULES)
def test_examples(name: str) -> None:
    module = importlib.import_module(name)
    with np.printoptions(legacy=False):
        failed, _ = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
    assert not failed
