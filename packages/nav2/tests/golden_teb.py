"""TEB equals vectors recorded from the original."""

from typing import Any

import numpy as np
import pytest

from wideberth.packages.nav2.tests.golden import Case, Checks
from wideberth_nav2.controllers import _teb_kernel as kernel
from wideberth_nav2.controllers.local_controllers import built
from wideberth_nav2.controllers.teb import TEB
from wideberth_nav2.controllers.teb_band import Band, TebParameters
from wideberth_nav2.controllers.teb_edges import (
    Pull,
    TebObstacles,
    cost_of,
    edges_of,
    minimised,
    optimised,
)

NAMES = (
    "obstacle", "inflated_obstacle", "dynamic_obstacle", "velocity", "acceleration_start",
    "acceleration", "acceleration_goal", "time_optimal", "shortest_path",
    "kinematics_diff_drive", "prefer_rotdir",
)  # fmt: skip
"""Of the kinds of edges, as in the original."""
EXACT, OPTIMUM, CLOSE = 1e-9, 0.02, 1e-3
"""The tolerance of what precedes an optimisation, the one of its cost, and what else is near."""


class Adapter:
    """The one adapter from a case: its settings, plan and obstacles."""

    def __init__(self, case: Case) -> None:
        made = built("teb", case["params"])
        assert isinstance(made, TEB)
        self.settings: TebParameters = made
        self.plan = np.array(case["plan"])
        self.start = case["start_v"], case["start_w"]
        discs = case["obstacles"]
        moving = [disc["dynamic"] for disc in discs]
        self.obstacles = TebObstacles(
            np.array([[disc["x"], disc["y"]] for disc in discs]).reshape(-1, 2),
            np.array([disc["radius"] for disc in discs]),
            np.array([[disc["vx"], disc["vy"]] for disc in discs]).reshape(-1, 2),
        )
        assert self.obstacles.moving.tolist() == moving
        self.expect = case["expect"]

    def pull(self, outer: int = 0) -> Pull:
        return Pull(self.obstacles, self.start, multiplier=2.0**outer)


def assert_band(found: Band, stored: dict[str, Any], tolerance: float) -> None:
    poses = np.array(stored["poses"])
    assert found.poses.shape == poses.shape
    apart = np.abs(found.poses - poses)
    apart[:, 2] = np.abs((apart[:, 2] + np.pi) % (2.0 * np.pi) - np.pi)
    assert apart.max() < tolerance
    assert np.abs(found.intervals - np.array(stored["dt"])).max() < tolerance


def the_first_band_and_its_resizing_are_equal(teb: Case) -> None:
    case = Adapter(teb)
    band = Band.from_plan(case.plan, case.settings)
    assert_band(band, case.expect["band_after_init"], EXACT)
    first = case.expect["outer_iterations"][0]["band_after_autoresize"]
    assert_band(band.resized(case.settings), first, EXACT)


def edges_are_equal_in_their_order(teb: Case) -> None:
    case = Adapter(teb)
    stored = case.expect["outer_iterations"][0]
    band = Band.from_plan(case.plan, case.settings).resized(case.settings)
    edges = edges_of(band, case.pull(), case.settings)
    errors, cost = cost_of(edges, band, case.settings)
    assert len(edges.kind) == len(stored["edges"])
    for i, edge in enumerate(stored["edges"]):
        kind = int(edges.kind[i])
        assert NAMES[kind] == edge["type"]
        assert 2 * (edges.begin[i] // 4) + edges.begin[i] % 4 // 3 == min(edge["vertices"])
        assert np.abs(errors[i, : kernel.ROWS[kind]] - edge["error"]).max() < EXACT
        assert edges.weight[i, : kernel.ROWS[kind]].tolist() == pytest.approx(edge["weight"])
    assert cost == pytest.approx(stored["chi2_before"], abs=EXACT, rel=EXACT)


def every_optimisation_ends_where_the_original_does(teb: Case) -> None:
    case = Adapter(teb)
    for outer, stored in enumerate(case.expect["outer_iterations"]):
        band = Band(
            np.array(stored["band_after_autoresize"]["poses"]),
            np.array(stored["band_after_autoresize"]["dt"]),
        )
        edges = edges_of(band, case.pull(outer), case.settings)
        band, cost, iterations = minimised(edges, band, case.settings)
        assert iterations == stored["iterations"]
        assert cost == pytest.approx(stored["chi2_after"], rel=OPTIMUM)


def the_command_of_the_first_tick(teb: Case) -> None:
    case = Adapter(teb)
    optimum = optimised(Band.from_plan(case.plan, case.settings), case.pull(), case.settings)
    assert optimum is not None
    last = case.expect["outer_iterations"][-1]
    assert optimum.cost == pytest.approx(last["cost"], rel=OPTIMUM)
    velocity = optimum.band.velocity(case.settings)
    assert velocity == pytest.approx((case.expect["v"], case.expect["w"]), abs=CLOSE)


def warm_starts_go_on_from_the_last_band(teb: Case) -> None:
    case = Adapter(teb)
    ticks = case.expect.get("warm_start_ticks", [])
    if not ticks:
        pytest.skip("the case has one tick alone")
    stored = case.expect["outer_iterations"][-1]["band_after_optimize"]
    for tick in ticks:
        last = Band(np.array(stored["poses"]), np.array(stored["dt"]))
        start, goal = np.array(tick["start"]), case.plan[-1]
        assert last.fits(goal, case.settings)
        pull = Pull(case.obstacles, (tick["start_v"], tick["start_w"]))
        optimum = optimised(last.moved(start, goal, case.settings), pull, case.settings)
        assert optimum is not None
        stored = tick["band"]
        assert_band(optimum.band, stored, CLOSE)
        velocity = optimum.band.velocity(case.settings)
        assert velocity == pytest.approx((tick["v"], tick["w"]), abs=CLOSE)


CHECKS: dict[str, Checks] = {
    "teb": (
        the_first_band_and_its_resizing_are_equal,
        edges_are_equal_in_their_order,
        every_optimisation_ends_where_the_original_does,
        the_command_of_the_first_tick,
        warm_starts_go_on_from_the_last_band,
    ),
}
