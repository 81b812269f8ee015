"""Plans when all goes well: what they report, and where they lead."""

import subprocess
import sys

import numpy as np
import pytest

from wideberth.framework.mpc.levels.fixed import Fixed
from wideberth.framework.mpc.levels.relaxed import Relaxed
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Observation
from wideberth.framework.values.plan import Rung, Status
from wideberth.regions.minkowski_sum import MinkowskiSum
from wideberth.regions.static.dual import Dual
from wideberth.robots.holonomic import Holonomic
from wideberth.robots.holonomic_3d import Holonomic3D
from wideberth.robots.holonomic_velocity import HolonomicVelocity
from wideberth.tests.helpers.planning import approach, at, planner


def test_a_plan_reports_all_that_it_should() -> None:
    plan = approach(planner())
    assert plan.rung is Rung.OPTIMAL
    assert plan.status is Status.SOLVED
    assert plan.reason == str(plan.given_way)  # it gave way, and nothing else happened
    assert plan.violation < 1e-4
    assert plan.iterations > 0
    assert plan.ids == ("other",)
    assert plan.states.shape == (16, 5)
    assert plan.inputs.shape == (15, 2)
    assert plan.level.shape == plan.content.shape == (15, 1)
    assert plan.content[0, 0] == pytest.approx(1 - np.exp(-0.5 * plan.level[0, 0] ** 2))
    assert plan.forecast is not None
    assert plan.forecast.mean.shape == (1, 1, 15, 2)
    assert plan.fallbacks == (None,)
    assert np.isfinite(plan.cost)
    clearance = np.linalg.norm(plan.positions[1:] - plan.forecast.mean[0, 0], axis=1)
    assert clearance.min() > 1.5 - 1e-3


def test_the_command_aims_at_the_next_step() -> None:
    made = planner()
    command = made.command(at(0.0, 0.0, y=0.5, v=0.3))
    assert made.plan is not None
    assert command.linear[0] == pytest.approx(made.plan.states[1, 3])
    assert command.omega == pytest.approx(made.plan.states[1, 4])
    assert command.ramp == 0.5
    direct = planner(robot=HolonomicVelocity())
    velocity = direct.command(Observation(0.0, np.zeros(2)))
    assert direct.plan is not None
    assert velocity.linear == pytest.approx(tuple(direct.plan.inputs[0]))
    assert velocity.ramp == 0.0


def test_the_same_observations_give_the_same_plan() -> None:
    first, second = approach(planner()), approach(planner())
    again = planner()
    approach(again)
    again.reset()
    third = approach(again)
    for other in (second, third):
        assert np.array_equal(first.states, other.states)
        assert np.array_equal(first.inputs, other.inputs)


def test_nothing_seen_is_the_plain_tracking_problem() -> None:
    made = planner()
    made.command(at(0.0, 0.0, y=1.0))
    plan = made.plan
    assert plan is not None
    assert plan.rung is Rung.OPTIMAL
    assert plan.ids == ()
    assert np.isnan(plan.lowest_content)
    assert abs(plan.positions[-1, 1]) < 0.3


def test_more_starts_never_cost_more() -> None:
    for gap in (5.0, 6.0, 7.0):
        single, several = planner(), planner(starts=("left", "right", "wait"))
        for made in (single, several):
            made.command(at(0.0, 0.0, ("other", gap, 0.0)))
        assert single.plan is not None
        assert several.plan is not None
        assert several.plan.cost <= single.plan.cost * (1 + 1e-6)
    flying = planner(robot=Holonomic(), starts=("left", "right", "coast"))
    flying.command(
        Observation(0.0, np.array([0.0, 0.0, 0.4, 0.0]), at(0, 0, ("a", 4, 0)).detections)
    )
    assert flying.plan is not None
    assert flying.plan.rung is Rung.OPTIMAL


def test_heading_beyond_pi_is_no_different() -> None:
    plain, wrapped = planner(), planner()
    for made, turns in ((plain, 0), (wrapped, 3)):
        for k in range(4):
            heading = 2 * np.pi * turns * (k % 2)
            state = np.array([0.25 * k, 0.0, heading, 0.5, 0.0])
            seen = at(0.5 * k, 0.0, ("other", 6.0 - 0.25 * k, 0.3)).detections
            made.command(Observation(0.5 * k, state, seen))
    assert plain.plan is not None
    assert wrapped.plan is not None
    assert wrapped.plan.positions == pytest.approx(plain.plan.positions, abs=1e-4)


def test_a_push_beyond_the_limits_is_no_reason_to_stop() -> None:
    made = planner()
    made.command(Observation(0.0, np.array([0.0, 0.0, 0.0, 0.75, 0.36])))
    assert made.plan is not None
    assert made.plan.rung is Rung.OPTIMAL
    assert made.plan.states[0, 4] == 0.3


def test_an_exact_region_and_a_fixed_level_work_in_the_loop() -> None:
    plan = approach(planner(region=MinkowskiSum(), level=Fixed(0.2)), gap=14.0)
    assert plan.rung is Rung.OPTIMAL
    assert plan.auxiliaries.shape == (15, 1, 1)
    assert plan.content == pytest.approx(np.full((15, 1), 0.8))


def test_a_plan_tells_when_it_is_below_its_reference() -> None:
    free = approach(planner(level=Relaxed(weight=1.0, minimum=0.0)), gap=7.0)
    assert free.below_reference is True
    far = planner()
    far.command(at(0.0, 0.0, ("other", 50.0, 30.0)))
    assert far.plan is not None
    assert far.plan.below_reference is False
    far.command(at(9.0, 0.0))
    assert far.plan.below_reference is None
    with pytest.raises(WideberthError, match=r"wanted at most 2\.448"):
        planner(level=Relaxed(minimum=3.0, weight=1.0))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"horizon": 0}, "planner.horizon is 0"),
        ({"horizon": 1001}, "planner.horizon"),
        ({"track_dt": 1e-3}, r"steps of the forecast, \(2 \* 3 s \+ latency.* is 13500"),
        ({"robot": Holonomic3D(), "static_region": Dual()}, "polygons lie in the plane"),
        ({"dt": -0.5}, "planner.dt is -0.5"),
        ({"latency": -0.1}, "planner.latency"),
        ({"deadline": 0.0}, "planner.deadline"),
        ({"starts": ("up",)}, "wanted some of"),
        ({"most_obstacles": -1}, "most_obstacles"),
        ({"most_obstacles": 101}, "at most 100"),
        ({"margin": -0.1}, "planner.margin"),
        ({"reference_speed": float("nan")}, "reference_speed"),
    ],
)
def test_settings_that_make_no_planner_are_refused(change: dict[str, float], words: str) -> None:
    with pytest.raises(WideberthError, match=words):
        planner(**change)


def test_everything_is_loaded_before_the_first_decision() -> None:
    """A subprocess, since here statsmodels has long been imported."""
    script = """
import sys
from wideberth import Path, build
planner = build("controllers", {"type": "mpc", "robot": "unicycle",
    "predictor": {"type": "var", "backend": "statsmodels"},
    "region": "mahalanobis_ellipse", "level": "relaxed", "solver": "fatrop"})
assert "statsmodels.tsa.vector_ar.var_model" in sys.modules
planner.set_path(Path([(0, 0), (9, 0)]))
assert planner.last_plan is None
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
