"""Every example in a docstring runs.

``pytest --doctest-modules`` would import the modules a second time under other names.
"""

import doctest
import importlib
import pkgutil

import numpy as np
import pytest

from wideberth.tests.house.test_imports import PACKAGES, ROOMS, folder_of


@pytest.mark.parametrize("room", ROOMS)
def test_examples(room: str) -> None:
    package = room if room in PACKAGES else f"wideberth.{room}"
    failed = {}
    for info in pkgutil.walk_packages([str(folder_of(room))], f"{package}."):
        module = importlib.import_module(info.name)
        with np.printoptions(legacy=False):
            count, _ = doctest.testmod(module, optionflags=doctest.ELLIPSIS)
        if count:
            failed[info.name] = count
    assert not failed
