"""NavFn and the inflation equal vectors recorded from Nav2."""

import base64
import hashlib
import zlib

import numpy as np
import pytest

from wideberth.framework.values.costmap import Costmap
from wideberth.packages.nav2.tests.golden import Case, Checks, costmap_of
from wideberth.routes.inflation import Inflation
from wideberth.routes.navfn import NavFn, Wave, nearest_cell


def planner_of(case: Case) -> NavFn:
    """The one adapter from the parameters of a case: headings are no part of our paths."""
    settings = {**case["params"]}
    settings.pop("use_final_approach_orientation", None)
    return NavFn(**settings)


def wave_of(case: Case) -> tuple[Costmap, Wave]:
    costmap = costmap_of(case["costmap"])
    return costmap, planner_of(case).wave(costmap, case["start"][:2], case["goal"][:2])


def digest(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


def potentials_are_equal_bit_by_bit(navfn: Case) -> None:
    expect = navfn["expect"]
    _, wave = wave_of(navfn)
    assert wave.potential.dtype == np.float32
    for index, value in expect["potential_samples"]:
        assert wave.potential.ravel()[index] == np.float32(value), index
    assert digest(wave.costs) == expect["navfn_cost_sha256"]
    assert digest(wave.potential.astype("<f4")) == expect["potential_sha256"]
    if packed := expect.get("potential_f32_zlib_base64"):
        stored = np.frombuffer(zlib.decompress(base64.b64decode(packed)), "<f4")
        assert np.array_equal(wave.potential.ravel(), stored)


def paths_are_equal(navfn: Case) -> None:
    costmap = costmap_of(navfn["costmap"])
    route = planner_of(navfn).plan(costmap, navfn["start"][:2], navfn["goal"][:2])
    if "exception" in navfn["expect"]:
        assert route.path is None and route.reason
        return
    path = np.array(navfn["expect"]["path"])[:, :2]
    path = path[np.r_[True, (np.diff(path, axis=0) != 0.0).any(axis=1)]]
    assert route.path is not None and route.path.points.shape == path.shape
    assert np.abs(route.path.points - path).max() < 1e-9


def cells_of_the_way_are_equal_bit_by_bit(navfn: Case) -> None:
    costmap, wave = wave_of(navfn)
    planner = planner_of(navfn)
    cells = np.array(navfn["expect"].get("path_cells_goal_to_start_f32", []), np.float32)
    if not len(cells):
        pytest.skip("the case has no way")
    begin = (int(cells[0, 0]), int(cells[0, 1]))  # the goal's cell, or the one found in its stead
    longest = planner.max_cycles_factor * max(costmap.width, costmap.height)
    way, _ = wave.way_down(begin, longest)
    assert np.array_equal(way, cells)
    target = nearest_cell(costmap, np.array(navfn["goal"][:2]))
    assert target is not None and (begin == target) == wave.reached(target)


def inflation_is_equal_in_every_cell(inflation: Case) -> None:
    settings, expect = inflation["params"], inflation["expect"]
    layer = Inflation(
        settings["inscribed_radius"], settings["inflation_radius"],
        settings["cost_scaling_factor"], settings["inflate_unknown"],
        settings["inflate_around_unknown"],
    )  # fmt: skip
    before = costmap_of(inflation["costmap_before"])
    x0, y0, x1, y1 = inflation["window"]
    found = layer.inflated(before, (x0, y0, x1, y1))
    assert np.array_equal(found.cells, costmap_of(expect["costmap_after"]).cells)
    quarters = expect["compute_cost_every_quarter_cell"]
    costs = [layer.cost_at(0.25 * i, before.resolution) for i in range(len(quarters))]
    assert costs == quarters


CHECKS: dict[str, Checks] = {
    "navfn": (
        potentials_are_equal_bit_by_bit,
        paths_are_equal,
        cells_of_the_way_are_equal_bit_by_bit,
    ),
    "inflation": (inflation_is_equal_in_every_cell,),
}
