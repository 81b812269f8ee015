"""The state that a controller is given of its own robot, from an estimate of the motion."""

import numpy as np

from wideberth.framework.numerics.integration import carried_covariance
from wideberth.framework.robot import Robot
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.motion import Pose, Twist
from wideberth.simulation.sensing.perceived import MotionEstimate


def own_state(
    robot: Robot, estimate: MotionEstimate, *, seen_from_here: bool
) -> tuple[Array, Array]:
    """Return state and covariance of a robot, as an `Observation` holds them.

    A planner adds the covariance of its own position to that of every obstacle. That is right for
    obstacles known in a frame of their own (the polygons of a map, positions by radio): their
    place relative to the robot is as uncertain as the robot's place in that frame. What the
    robot's own sensors see is known relative to the robot, whatever its pose: put into the frame
    by the same pose, it shares that error, and the difference is free of it. So there::

        C = C_e (with zero rows and columns for x, y, heading if seen from here)
        covariance = J C J^T,    J = d state / d (x, y, heading, vx, vy, yaw rate)

    where `Robot.state_at` says how the state depends on pose and twist. An error of the heading
    that only turns velocities (of a robot whose state holds them in the frame) is left out with
    the pose.

    Where a robot has both, a map and what it sees, an `Observation` holds both: the covariance
    from here for its detections, and ``map_covariance`` for its polygons.

    Parameters
    ----------
    robot : in the plane.
    estimate : of its motion, of the instant of the observation.
    seen_from_here : whether the obstacles of the observation are seen by the robot's own sensors
        and placed by this pose, rather than known in the frame of the estimate.

    Returns
    -------
    state : (n,), within the limits of the robot: an estimate may pass them by its noise.
    covariance : (n, n).

    Raises
    ------
    WideberthError : a robot that flies.
    """
    if robot.dimension != 2:
        raise WideberthError(
            f"an estimate in the plane is none of a robot in {robot.dimension} dimensions"
        )
    headed = robot.pose(tuple(0.0 for _ in robot.states)).heading is not None

    def state(motion: Array) -> Array:
        x, y, heading, forward, lateral, rate = motion.tolist()
        if headed:
            found = robot.state_at(Pose((x, y), heading), Twist((forward, lateral), rate))
        else:
            cosine, sine = np.cos(heading), np.sin(heading)
            world = cosine * forward - sine * lateral, sine * forward + cosine * lateral
            found = robot.state_at(Pose((x, y)), Twist(world))
        return np.array(found, dtype=np.float64)

    spread = np.array(estimate.covariance)
    if seen_from_here:
        spread[:3] = 0.0
        spread[:, :3] = 0.0
    limits = robot.state_bounds()
    found = np.clip(state(estimate.mean), limits.lower, limits.upper)
    return found, carried_covariance(state, estimate.mean, spread)
