"""Every option is set by something that the package ships, or has a reason to be there."""

from collections.abc import Iterator

from wideberth.framework.values.footprint import Discs
from wideberth.predictors.kalman import Kalman
from wideberth.tests.house.options import options, owner, set_somewhere

REASONS = {
    "size, limit, error or name of a robot, a sensor or a person": """
        Bicycle: max_steering wheelbase;
        InertialUnit: acceleration_bias acceleration_deviation acceleration_walk;
        InertialUnit: rate_bias rate_deviation rate_walk;
        MotionNoise: accelerometer accelerometer_bias gyro; SensingPipeline: encoders imu
        """,
    "kind of obstacles, or irregularity of stamps, other than that of our studies": """
        PlannerSettings: obstacle_speed; Reactive: obstacle_speed
        """,
    "numerical tolerance, or limit of iterations or samples": """
        BilevelOrca: most_iterations most_people
        """,
    "how a fit cuts recordings, long or short, many or few, into windows and classes": """
        Corrected: classes; Empirical: jitters
        """,
    "parameter of the published method that `reference` of the plug-in names": """
        BayesianVectorAutoregression: order; Bhattacharyya: robot_deviation;
        BilevelOrca: people_speed; Chords: collinear fewest gap proportion separation split;
        CircularForce: stiffness; ConstantAcceleration: time_constant; Contouring: knots;
        CoordinatedTurn: turn_time; CrowdNav: random_attributes; Force: anticipation;
        InteractingModels: braking dwell stopping; KfHungarian: slowest; Rectangle: correction;
        MoussaidForce: haste range_factor relaxation slowing velocity_weight;
        ObstacleTracker: fade rate_variance variance; Orca: neighbour_distance;
        PooledVectorAutoregression: order; Reciprocal: neighbour_distance;
        SocialForce: direction_spread relaxation speed_spread; SocialForceController: stiffness;
        VectorAutoregression: order
        """,
    "parameter of Nav2 of that name": """
        CostmapView: footprint_padding inflate_around_unknown inflate_unknown;
        CostmapView: raytrace_max_range track_unknown_space; NavFn: allow_unknown max_cycles_factor
        """,
}
"""Reason -> class: options, of those whose name nothing sets."""


def listed() -> Iterator[str]:
    """Yield ``Class.option`` of every entry of `REASONS`."""
    for line in ";".join(REASONS.values()).split(";"):
        kind, _, fields = line.strip().partition(": ")
        yield from (f"{kind}.{name}" for name in fields.split())


def test_an_option_that_nothing_sets_has_a_reason() -> None:
    found = set_somewhere()
    unset = {f"{kind.__name__}.{name}" for kind, name in options() if name not in found}
    without, more = unset - {*listed()}, {*listed()} - unset
    assert not without, f"set it in a config or on a page, or make it a constant: {without}"
    assert not more, f"these are set by something, or are gone: {more}"
    assert found >= {"speed", "seeds", "region"} and "wheelbase" not in found


def test_an_inherited_field_is_one_option() -> None:
    assert owner(Kalman, "speed") is Kalman
    assert (Kalman, "speed") in options() and all(kind is not Discs for kind, _ in options())
    counted = [kind.__name__ for kind, name in options() if name == "reference_speed"]
    assert "Reactive" in counted and "Orca" not in counted
