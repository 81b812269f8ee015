"""No plug-in accepts a number of its settings that is none, and the message names the setting."""

from dataclasses import MISSING, fields, replace
from typing import Any

import numpy as np
import pytest

from wideberth.framework.plugins import registry
from wideberth.framework.values.errors import WideberthError
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.robots.unicycle import Unicycle

ROOMS = sorted({*registry.ROOMS} - {"experiments", "controllers"})
NO_DEFAULT = {"scan_matching"}
KINDS = [
    (room, name)
    for room in ROOMS
    for name, target in sorted(registry.targets(room).items())
    if name not in NO_DEFAULT and target.startswith("wideberth.") and "examples" not in target
]
BAD: dict[type, tuple[Any, ...]] = {int: (-3, 1.5), float: (np.nan,)}


def made(room: str, name: str) -> Any:
    """With its defaults; what needs a robot or a region has one."""
    kind = registry.load(room, name)
    names = {one.name for one in fields(kind) if one.default is one.default_factory is MISSING}
    parts = {"robot": Unicycle(), "region": MinkowskiSum()}
    return kind(**{name: part for name, part in parts.items() if name in names})


@pytest.mark.parametrize(("room", "name"), KINDS)
def test_what_is_no_number_is_refused_by_name(room: str, name: str) -> None:
    one = made(room, name)
    for field in fields(one):
        for bad in BAD.get(type(getattr(one, field.name)), ()) if field.init else ():
            with pytest.raises(WideberthError, match=field.name.replace("_", ".")):
                replace(one, **{field.name: bad})
