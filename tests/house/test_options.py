"""Every option is set by something that the package ships, or has a reason to be there."""

import ast
from collections.abc import Iterator

import pytest

from wideberth.framework.plugins.yamlfile import parse
from wideberth.framework.values.footprint import Discs
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.var import VectorAutoregression
from wideberth.tests.house.options import (
    Option,
    kinds,
    options,
    owner,
    set_by_path,
    set_in_config,
    set_in_python,
    set_on_page,
    set_somewhere,
)

REASONS: dict[str, str] = {
    "size, limit, error or name of a robot, a sensor or a person": """
        Bicycle: max_acceleration max_reverse_speed max_steering max_steering_rate wheelbase
        DifferentialDrive: max_reverse_speed
        DoubleIntegrator: max_acceleration
        InertialUnit: acceleration_bias acceleration_deviation acceleration_walk
        InertialUnit: rate_bias rate_deviation rate_walk
        Lidar: deviation field height longest mount
        MotionNoise: accelerometer accelerometer_bias gyro gyro_bias slip
        SensingPipeline: encoders imu
        UnicycleVelocity: max_reverse_speed
        VectorAutoregression: max_speed
        Walker: radius
        WheelEncoders: ticks
        """,
    "frame, message, rate or time of a robot's ROS system": """
        GoalTopic: yaw_tolerance
        NodeSettings: base_frame patience rate
        ObstacleTopic: deviation kind own_clock radius
        PathTopic: tolerance yaw_tolerance
        ScanTopic: deviation handover own_clock
        """,
    "kind of obstacles, or irregularity of stamps, other than that of our studies": """
        Channel: jitter
        PlannerSettings: obstacle_speed
        Reactive: obstacle_speed
        """,
    "which seeds a study plays, and how it reads a user's recordings": """
        ClosedLoopRisk: first_seed
        FirstSight: first_seed
        Guarantees: first_seed
        ReactingCalibration: first_seed
        SceneFiles: dt
        """,
    "what a learnt policy was trained to see": """
        ObservationSpec: reach walls
        """,
    "numerical tolerance, or limit of iterations or samples": """
        BilevelOrca: most_iterations most_people
        ConvexCertificates: directions points
        Fatrop: iterations tolerance
        Ipopt: iterations tolerance
        PlannerSettings: deadline
        Protocol: draws
        Riccati: iterations tolerance
        DynamicWindow: samples
        Game: agents iterations
        MixtureDensity: rounds
        ReactingPeople: most
        """,
    "how a fit cuts recordings, long or short, many or few, into windows and classes": """
        AdaptiveConformal: observed speeds
        Conformal: observed
        Corrected: classes observed
        Empirical: jitters observed speeds
        FunctionalConstant: observed
        MixtureDensity: observed
        """,
    "a number that `fit` or `update` writes": """
        BayesianVectorAutoregression: samples
        ConstantAcceleration: acceleration noise_floor
        InteractingModels: manoeuvring noise_floor standing steady
        Online: stated waiting
        """,
    "parameter of the published method that `reference` of the plug-in names": """
        AdaptiveConformal: rate
        BayesianVectorAutoregression: deviation order
        Bhattacharyya: robot_deviation
        BilevelOrca: dt horizon obstacle_horizon people_speed time_horizon
        Chords: collinear deviation enlargement fewest gap largest proportion separation split
        CircularForce: stiffness wall_reach wall_strength
        ConstantAcceleration: time_constant
        Contouring: knots lag
        CoordinatedTurn: acceleration_density turn_time yaw_rate
        CrowdNav: phase random_attributes
        CrowdNavPlus: phase
        CrowdSimPlus: attributes
        DynamicWindow: clearance heading velocity view
        Force: anticipation reach strength
        InteractingModels: braking dwell stopping
        KfHungarian: acceleration fastest gate noise slowest speed
        Rectangle: correction
        MoussaidForce: haste range_factor relaxation slowing strength turning velocity_weight
        MoussaidForce: wall_strength
        ObstacleTracker: fade gate noise rate rate_variance variance
        Orca: neighbour_distance
        PooledVectorAutoregression: acceleration_density order
        Reciprocal: most_neighbours neighbour_distance obstacle_horizon safety_space time_horizon
        RiskAllocation: growth
        SocialForce: direction_spread force relaxation speed_spread
        SocialForceController: reach stiffness strength
        VectorAutoregression: order
        """,
    "parameter of Nav2 of that name": """
        CostmapView: cost_scaling_factor footprint_padding inf_is_valid inflate_around_unknown
        CostmapView: inflate_unknown obstacle_layer obstacle_max_range raytrace_max_range
        CostmapView: resolution static_layer track_unknown_space
        NavFn: allow_unknown max_cycles_factor
        """,
}
"""Reason -> class: options, of those that nothing sets."""


def listed() -> Iterator[str]:
    """Yield ``Class.option`` of every entry of `REASONS`."""
    for text in REASONS.values():
        for line in text.strip().splitlines():
            kind, _, fields = line.strip().partition(": ")
            yield from (f"{kind}.{name}" for name in fields.split())


@pytest.fixture(scope="module")
def unset() -> dict[str, str]:
    """Return ``Class.option`` -> room of each option that nothing sets."""
    left = options() - set_somewhere()
    return {f"{kind.__name__}.{name}": kind.__module__.split(".")[1] for kind, name in left}


def test_an_option_that_nothing_sets_has_a_reason(unset: dict[str, str]) -> None:
    without = sorted(set(unset) - set(listed()))
    assert not without, f"set it in a config or on a page, or make it a constant: {without}"


def test_the_list_of_reasons_holds_no_more_than_that(unset: dict[str, str]) -> None:
    names = list(listed())
    assert len(names) == len(set(names))
    more = sorted(set(names) - set(unset))
    assert not more, f"these are set by something, or are gone: {more}"


def named(found: Iterator[Option]) -> set[str]:
    return {f"{kind.__name__}.{name}" for kind, name in found}


def in_yaml(text: str) -> set[str]:
    return named(set_in_config(parse(text, "text"), kinds()))


def in_python(text: str) -> set[str]:
    return named(set_in_python(ast.parse(text)))


def test_the_type_decides_whose_option_a_key_is() -> None:
    text = "planner: {type: mpc, horizon: 3, predictor: {type: kalman, noise_floor: 0.1}}"
    assert in_yaml(text) >= {"PlannerSettings.horizon", "Kalman.noise_floor"}
    assert not in_yaml(text) & {"VectorAutoregression.noise_floor", "BilevelOrca.horizon"}
    assert "Weights.speed" in in_yaml("{type: tracking, weights: {speed: 2.0}}")
    assert in_yaml("{mine: {orca: {safety_space: 0.1}}}") == {"Orca.safety_space"}


def test_python_sets_by_name_and_by_place() -> None:
    assert in_python("Kalman(0.1, noise_floor=0.2)") == {
        "Kalman.acceleration_density",
        "Kalman.noise_floor",
    }
    assert in_python('build("predictors", {"type": "kalman", "speed": 1.0})') == {"Kalman.speed"}
    assert in_python("class Kalman:\n  def f(self): return replace(self, speed=2.0)") == {
        "Kalman.speed"
    }
    known = "from people import Reciprocal\nreplace(other, safety_space=0.1)"
    assert in_python(known) == {"Reciprocal.safety_space"}
    assert not in_python("replace(other, safety_space=0.1)")
    assert "Kalman.speed" in in_python('run(["planner.predictor.speed=2.0"])')
    assert not in_python("sorted(speed=3.0)")


def test_pages_set_in_blocks_commands_and_words() -> None:
    def page(text: str) -> set[str]:
        return named(set_on_page(text))

    assert page("```yaml\nmine: {type: bicycle, wheelbase: 0.4}\n```\n") == {"Bicycle.wheelbase"}
    assert page("```python\nBicycle(wheelbase=0.4)\n```\n") == {"Bicycle.wheelbase"}
    assert page("Use `{type: bicycle, wheelbase: 0.4}`.") == {"Bicycle.wheelbase"}
    assert page("wideberth run flight --set scenario.passers=8") == {"Crossing3D.passers"}
    assert page("`var` with `order: 3`") == {"VectorAutoregression.order"}
    assert page("`order: 3`, whose ever") == set()
    assert page("Only one has `wheelbase: 0.4`") == {"Bicycle.wheelbase"}


def test_a_path_leads_through_the_fields() -> None:
    assert named(set_by_path("planners.ours.cost.weights.position")) == {"Weights.position"}
    assert "Kalman.speed" not in named(set_by_path("robot.speed"))


def test_an_inherited_field_is_one_option() -> None:
    assert {owner(kind, "order") for kind in (VectorAutoregression,)} == {VectorAutoregression}
    assert (Kalman, "speed") in options() and all(kind is not Discs for kind, _ in options())
    counted = [kind.__name__ for kind, name in options() if name == "reference_speed"]
    assert "Reactive" in counted and "Orca" not in counted
