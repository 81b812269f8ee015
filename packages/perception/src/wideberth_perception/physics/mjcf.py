"""The model of a scene that MuJoCo reads."""

from collections.abc import Sequence

import numpy as np

from wideberth.framework.values.arrays import Array
from wideberth.framework.values.polygon import edge_normals

from .body import HULL_BOTTOM, HULL_TOP
from .scene import PhysicalPerson, PhysicalRobot, PhysicalScene

SEEN, HULL, MECHANICS, GROUND = 0, 1, 2, 3
"""Groups of geoms: walls and people, hulls of robots, boxes and wheels, the floor."""
WALL_HEIGHT = 1.0
"""m; above any LiDAR."""
_RIGHT = 1e-9
"""Largest |cosine| between two sides that are taken for perpendicular."""

_LOOKS = """
<texture name="sky" type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0.8 0.88 0.95" width="64"
height="64"/>
<texture name="tiles" type="2d" builtin="checker" rgb1="0.93 0.93 0.93" rgb2="0.87 0.87 0.87"
width="128" height="128"/>
<material name="tiles" texture="tiles" texrepeat="1 1" texuniform="true"/>
"""


def mjcf(scene: PhysicalScene) -> str:
    """Return the scene as a model in MuJoCo's XML.

    Bodies are robot0, robot1, ..., person0, ... and wall0, ... in the order of the scene; the
    geoms of a wall are wall0.0, wall0.1, ... Robots touch robots, people and walls with their
    hulls, and the floor with box and wheels.
    """
    meshes, bodies = [], []
    for index, robot in enumerate(scene.robots):
        bodies.append(_robot(f"robot{index}", robot, scene.friction))
    for index, person in enumerate(scene.people):
        bodies.append(_person(f"person{index}", person))
    for index, wall in enumerate(scene.walls):
        for part, points in enumerate(wall.parts):
            mesh, geom = _prism(f"wall{index}.{part}", points)
            meshes.append(mesh)
            bodies.append(geom)
    actuators = (
        f'<velocity name="robot{index}.{wheel}" joint="robot{index}.{wheel}" '
        f'kv="{robot.body.servo_gain}" ctrllimited="false" forcelimited="true" '
        f'forcerange="{-robot.body.torque_limit} {robot.body.torque_limit}"/>'
        for index, robot in enumerate(scene.robots)
        for wheel in range(4)
    )
    return f"""<mujoco model="wideberth">
<compiler angle="radian"/>
<option timestep="{scene.time_step}" integrator="implicitfast" cone="{scene.cone}"><flag
autoreset="disable"/></option>
<visual><global offwidth="1920" offheight="1080"/><headlight ambient="0.4 0.4 0.4"/></visual>
<default>
<geom friction="{scene.friction} 0.005 0.0001"/>
<default class="seen"><geom group="{SEEN}" contype="0" conaffinity="2"/></default>
</default>
<asset>{_LOOKS}{"".join(meshes)}</asset>
<worldbody>
<geom name="floor" type="plane" size="0 0 1" group="{GROUND}" contype="0" conaffinity="1"
material="tiles"/>
<light directional="true" pos="0 0 10" dir="0.3 0.2 -1" diffuse="0.5 0.5 0.5"/>
{"".join(bodies)}</worldbody>
<actuator>{"".join(actuators)}</actuator>
</mujoco>"""


def _person(label: str, person: PhysicalPerson) -> str:
    x, y = person.start
    half = 0.5 * person.height
    return (
        f'<body name="{label}" mocap="true" pos="{x:.17g} {y:.17g} {half}">'
        f'<geom name="{label}" class="seen" type="cylinder" size="{person.radius} {half}" '
        'rgba="0.85 0.45 0.2 1"/></body>'
    )


def _robot(label: str, robot: PhysicalRobot, friction: float) -> str:
    body = robot.body
    x, y, heading = robot.start
    radius = body.wheel_radius
    size = f"{radius} {body.wheel_half_width} {radius}"
    wheels = (
        f'<body name="{label}.{index}" pos="{0.5 * ahead * body.wheel_base} '
        f'{0.5 * side * body.track} 0"><joint name="{label}.{index}" axis="0 1 0" '
        f'damping="0.01" armature="{body.armature}"/><geom type="ellipsoid" size="{size}" '
        f'mass="{0.0375 * body.mass}" group="{MECHANICS}" contype="1" conaffinity="0" '
        f'{_grip(friction, robot.grip[index])}rgba="0.15 0.15 0.15 1"/></body>'
        for index, (side, ahead) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1)))
    )
    tall, centre = 0.5 * (HULL_TOP - HULL_BOTTOM), 0.5 * (HULL_TOP + HULL_BOTTOM) - radius
    if body.hull == "box":
        hull = f'type="box" size="{body.half_length} {body.half_width} {tall}"'
    else:
        hull = f'type="cylinder" size="{body.radius} {tall}"'
    return (
        f'<body name="{label}" pos="{x:.17g} {y:.17g} {radius}" '
        f'euler="0 0 {heading:.17g}"><freejoint name="{label}"/>'
        f'<geom type="box" size="{body.half_length} {body.half_width} {0.6 * radius}" '
        f'pos="0 0 {0.3 * radius}" mass="{0.85 * body.mass}" group="{MECHANICS}" '
        'contype="1" conaffinity="0" rgba="0.3 0.3 0.35 1"/>'
        f'<geom name="{label}" {hull} pos="0 0 {centre}" mass="0.001" group="{HULL}" '
        'contype="2" conaffinity="2" rgba="0.25 0.5 0.8 1"/>'
        f"{''.join(wheels)}</body>"
    )


def _grip(friction: float, factor: float) -> str:
    """Return a wheel's own friction, which then counts instead of the floor's."""
    return "" if factor == 1.0 else f'priority="1" friction="{factor * friction} 0.005 0.0001" '


def _prism(label: str, points: Array) -> tuple[str, str]:
    """Return the mesh ("" for a box) and the geom of a convex polygon (V, 2), m."""
    named = f'<geom name="{label}" class="seen" rgba="0.55 0.55 0.58 1"'
    if len(points) == 4 and _rectangular(points):
        x, y = points.mean(axis=0)
        along, aside = points[1] - points[0], points[2] - points[1]
        size = f"{0.5 * np.hypot(*along)} {0.5 * np.hypot(*aside)} {0.5 * WALL_HEIGHT}"
        turn = np.arctan2(along[1], along[0])
        place = f'pos="{x:.17g} {y:.17g} {0.5 * WALL_HEIGHT}" euler="0 0 {turn:.17g}"'
        return "", f'{named} type="box" size="{size}" {place}/>'
    corners = " ".join(f"{x:.17g} {y:.17g} {z}" for z in (0.0, WALL_HEIGHT) for x, y in points)
    mesh = f'<mesh name="{label}" inertia="shell" vertex="{corners}"/>'
    return mesh, f'{named} type="mesh" mesh="{label}"/>'


def _rectangular(points: Sequence[Sequence[float]] | Array) -> bool:
    normals = edge_normals(np.asarray(points, dtype=np.float64))
    return bool(np.abs((normals * np.roll(normals, 1, axis=0)).sum(axis=1)).max() < _RIGHT)
