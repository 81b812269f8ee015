"""Cases recorded from Nav2: what the tests of its controllers share."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.controllers.nav2.footprint import RobotFootprint
from wideberth.controllers.nav2.local_controller import Answer
from wideberth.framework.values.costmap import Costmap

Case = dict[str, Any]


def parametrize(metafunc: pytest.Metafunc, *names: str) -> None:
    """One test per case of the file that the argument names."""
    folder = Path(str(metafunc.config.getoption("--golden-nav2")))
    for name in {*names} & {*metafunc.fixturenames}:
        path = folder / f"{name}.json"
        if path.is_file():
            cases = json.loads(path.read_text(encoding="utf-8"))["cases"]
            ids = [f"{name}{case.get('id', i)}" for i, case in enumerate(cases)]
            metafunc.parametrize(name, cases, ids=ids)
        else:
            reason = f"{path} is missing; --golden-nav2 names a folder that has it"
            missing = pytest.param(None, marks=pytest.mark.skip(reason=reason))
            metafunc.parametrize(name, [missing])


def costmap_of(stored: Case) -> Costmap:
    """The costmap of a case; one that has a geometry alone is free."""
    shape = (stored["height"], stored["width"])
    values, counts = zip(*stored.get("data_rle", [[0, shape[0] * shape[1]]]), strict=True)
    cells = np.repeat(values, counts).reshape(shape).astype(np.uint8)
    return Costmap(cells, stored["resolution"], (stored["origin_x"], stored["origin_y"]))


def footprint_of(robot: Case) -> RobotFootprint:
    """The robot of a case, whose radii have to be those that Nav2 computed."""
    if robot["use_radius"]:
        made = RobotFootprint.round_of(robot["robot_radius"])
    else:
        made = RobotFootprint.of(robot["footprint"])
    assert abs(made.inscribed - robot["inscribed_radius"]) < 1e-12
    assert abs(made.circumscribed - robot["circumscribed_radius"]) < 1e-12
    return made


def assert_equal_answer(answer: Answer, expect: Case, tolerance: float) -> None:
    """The exception by its name, or the velocity within the tolerance."""
    if "exception" in expect:
        assert answer.twist is None and answer.reason
        assert answer.error == expect["exception"]
        return
    assert answer.twist is not None, answer.reason
    assert abs(answer.twist.linear[0] - expect["v"]) <= tolerance
    assert abs(answer.twist.angular - expect["w"]) <= tolerance
