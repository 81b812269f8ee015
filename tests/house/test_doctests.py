"""Every example in a docstring runs.

``pytest --doctest-modules`` would import the modules a second time under other names.
"""

import doctest
import importlib
import pkgutil

import numpy as np
import pytest

import wideberth
from wideberth.tests.house.test_imports import ROOMS


@pytest.mark.parametrize("room", ROOMS)
def test_examples(room: str) -> None:
    folder = f"{wideberth.__path__[0]}/{room}"
    failed = {}
    for info in pkgutil.walk_packages([folder], f"wideberth.{room}."):
        module = importlib.import_module(info.name)
        with np.printoptions(legacy=False):
            count, _ = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
        if count:
            failed[info.name] = count
    assert not failed
