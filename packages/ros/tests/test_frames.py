"""Motions between frames: against 4 x 4 matrices, and what is wrong with reports."""

from itertools import permutations, product
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wideberth import WideberthError
from wideberth_ros.frames import FrameTree, composed, inverted, quaternion_of, tilt_of, yaw_of

NAMES = ("map", "odom", "base", "lidar")


def poses(count: int, seed: int) -> np.ndarray:
    """Draw x, y in m and yaw in rad."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3)) * [9.0, 9.0, 3.0]


def matrix(pose: np.ndarray) -> np.ndarray:
    x, y, yaw = pose
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array([[cosine, -sine, x], [sine, cosine, y], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("seed", range(30))
def test_motions_are_those_of_matrices(seed: int) -> None:
    a, b = poses(2, seed)
    np.testing.assert_allclose(matrix(composed(a, b)), matrix(a) @ matrix(b), atol=1e-12)
    np.testing.assert_allclose(matrix(inverted(a)), np.linalg.inv(matrix(a)), atol=1e-12)


def test_quaternions_are_scipys() -> None:
    turns = Rotation.random(200, random_state=np.random.RandomState(4))
    for turn in turns:
        found = quaternion_of(turn.as_matrix())
        wanted = turn.as_quat()
        np.testing.assert_allclose(found, wanted * np.sign(found @ wanted), atol=1e-15)


@pytest.mark.parametrize("yaw", [-3.1, -1.0, 0.0, 0.4, 2.0, 3.1])
@pytest.mark.parametrize("roll", [-1.4, -0.2, 0.0, 0.05, 1.4])
def test_yaw_and_tilt_of_a_quaternion(yaw: float, roll: float) -> None:
    turn = Rotation.from_euler("ZYX", [yaw, 0.0, roll])
    x, y, z, w = turn.as_quat()
    assert yaw_of(x, y, z, w) == pytest.approx(yaw, abs=1e-9)
    assert tilt_of(x, y) == pytest.approx(abs(roll), abs=1e-7)
    upright = turn.apply([0.0, 0.0, 1.0])
    assert np.cos(tilt_of(x, y)) == pytest.approx(upright[2], abs=1e-12)


@pytest.mark.parametrize(("target", "source"), list(permutations(NAMES, 2)))
def test_a_motion_goes_through_the_tree(target: str, source: str) -> None:
    a, b, c = poses(3, NAMES.index(target))
    tree = FrameTree()
    tree.add("map", "odom", 0.0, a, static=True)
    tree.add("odom", "base", 0.0, b)
    tree.add("base", "lidar", 0.0, c, static=True)
    world = {"map": np.eye(3)}
    for parent, child, pose in (("map", "odom", a), ("odom", "base", b), ("base", "lidar", c)):
        world[child] = world[parent] @ matrix(np.array(pose))
    wanted = np.linalg.inv(world[target]) @ world[source]
    np.testing.assert_allclose(matrix(tree.motion(target, source, [0.1])[0]), wanted, atol=1e-9)


def spatial(pose: np.ndarray, over: bool) -> np.ndarray:
    """A motion of the plane in space, (4, 4), of a frame that is upside down where ``over``."""
    found = np.eye(4)
    found[:3, :3] = Rotation.from_euler("ZYX", [pose[2], 0.0, np.pi * over]).as_matrix()
    found[:2, 3] = pose[:2]
    return found


@pytest.mark.parametrize("over", list(product([False, True], repeat=3)))
@pytest.mark.parametrize(("target", "source"), list(permutations(NAMES, 2)))
def test_frames_upside_down_are_those_of_space(target: str, source: str, over: Any) -> None:
    rows = poses(3, 7)
    tree, world = FrameTree(), {"map": np.eye(4)}
    for parent, child, pose, down in zip(NAMES[:3], NAMES[1:], rows, over, strict=True):
        tree.add(parent, child, 0.0, pose, static=True, tilt=np.pi * down)
        world[child] = world[parent] @ spatial(pose, down)
    wanted = np.linalg.inv(world[target]) @ world[source]
    found, mirrored = tree.placement(target, source, [0.0])
    np.testing.assert_allclose(spatial(found[0], mirrored), wanted, atol=1e-9)
    if mirrored:
        with pytest.raises(WideberthError, match=f"{source!r} is upside down against {target!r}"):
            tree.motion(target, source, [0.0])


@pytest.mark.parametrize(("tilt", "refused"), [(0.09, False), (0.11, True), (1.6, True),
                                               (3.0, True), (3.1, False)])  # fmt: skip
def test_a_frame_that_tilts_has_no_pose(tilt: float, refused: bool) -> None:
    tree = FrameTree()
    tree.add("base", "lidar", 0.0, (0.1, 0.0, 0.0), static=True, tilt=tilt)
    if not refused:
        np.testing.assert_allclose(tree.placement("base", "lidar", [0.0])[0], [[0.1, 0.0, 0.0]])
        return
    with pytest.raises(WideberthError, match="'lidar' tilts by"):
        tree.placement("base", "lidar", [0.0])


def test_a_frame_that_tilts_for_a_moment_has_no_pose_then() -> None:
    tree = FrameTree()
    for time, tilt in ((0.0, 0.0), (1.0, 0.3), (2.0, 0.0), (3.0, 0.0)):
        tree.add("odom", "base", time, (time, 0.0, 0.0), tilt=tilt)
    found = tree.motion("odom", "base", [0.0, 1.0, 1.5, 2.0, 2.5])[:, 0]
    np.testing.assert_allclose(found, [0.0, np.nan, np.nan, 2.0, 2.5])


def test_poses_are_interpolated_the_shorter_way_round() -> None:
    tree = FrameTree()
    tree.add("odom", "base", 1.0, (0.0, 0.0, 3.0))
    tree.add("odom", "base", 2.0, (1.0, 2.0, -3.0))
    x, y, yaw = tree.motion("odom", "base", [1.5])[0]
    assert (x, y) == (0.5, 1.0)
    assert np.cos(yaw) == pytest.approx(-1.0)  # 3.0 and -3.0 are 0.28 rad apart, around pi
    np.testing.assert_array_equal(
        np.isnan(tree.motion("odom", "base", [0.4, 0.6, 2.4, 2.6])[:, 0]), [1, 0, 0, 1]
    )


def test_what_is_wrong_with_reports_is_counted() -> None:
    tree = FrameTree()
    tree.add("map", "base", 0.0, (0.0, 0.0, 0.0))
    tree.add("base", "map", 0.0, (0.0, 0.0, 0.0))
    tree.add("base", "base", 0.0, (0.0, 0.0, 0.0))
    tree.add("map", "base", 1.0, (np.nan, 0.0, 0.0))
    tree.add("map", "base", 1.0, (0.0, -1e300, 0.0))
    tree.add("odom", "base", 0.0, (1.0, 0.0, 0.0))
    assert [text.partition(",")[0] for text in tree.notes] == [
        "'map' in 'base' closes a circle of frames", "'base' in 'base' closes a circle of frames",
        "a pose of 'base' is not finite", "a pose of 'base' is beyond 1e+09",
        "'base' has two parents",
    ]  # fmt: skip
    assert tree.motion("odom", "base", [0.0])[0, 0] == 1.0
    with pytest.raises(WideberthError, match=r"no frame connects 'bas' with 'odom': did you mean"):
        tree.motion("odom", "bas", [0.0])
