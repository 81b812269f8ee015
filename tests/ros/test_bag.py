"""Recordings of ROS 2: what is in them, and what is wrong with them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.ros.bag import Bag, read_bag
from wideberth.ros.bag_tracks import read_bag_tracks
from wideberth.ros.messages import Messages, messages
from wideberth.tests.helpers.bags import (
    ARRAY,
    header,
    obstacles,
    odometry,
    quaternion,
    transform,
    vector,
    write_bag,
)

pytest.importorskip("rosbags", reason="pip install 'wideberth[bags]'")

START = 1_700_000_000.0
"""s, of the stamps."""
TIMES = 0.1 * np.arange(120)
STORAGES = ("MCAP", "SQLITE3")


def walk(time: float) -> list[tuple[float, float]]:
    """Return where two people are."""
    return [(0.5 * time, 1.0), (4.0 - 0.5 * time, -1.0)]


def drive(time: float) -> tuple[float, float, float]:
    """Return where the robot is in the frame odom."""
    return (0.3 * time, 0.1 * time, 0.05 * time)


MAP_TO_ODOM = (1.0, 2.0, 0.5)
MOUNT = (0.2, 0.0, 0.1)


def people(times: Any = TIMES, frame: str = "map", topic: str = "/obstacles") -> list[Any]:
    """Rows of obstacles, received 20 ms after they were measured."""
    return [(topic, START + t + 0.02, obstacles(START + t, walk(t), frame)) for t in times]


def scan(time: float) -> Any:
    return messages().make(
        "sensor_msgs/msg/LaserScan", header=header(time, "lidar"), angle_min=-1.0, angle_max=1.0,
        angle_increment=0.5, time_increment=0.001, range_min=0.1, range_max=10.0,
        ranges=np.array([0.05, 1.0, 2.0, 20.0, np.inf], np.float32),
    )  # fmt: skip


def everything() -> list[Any]:
    """Rows of every kind, of a robot that sees people in its LiDAR's frame."""
    known = messages()
    cells = np.array([0, 100, -1, 0, 0, 50], np.int8)
    info = known.make(
        "nav_msgs/msg/MapMetaData", resolution=np.float32(0.5), width=3, height=2,
        origin=known.make(
            "geometry_msgs/msg/Pose", position=vector("Point", -1.0, -2.0),
            orientation=quaternion(0.0),
        ),
    )  # fmt: skip
    grid = known.make("nav_msgs/msg/OccupancyGrid", header=header(START, "map"), info=info,
                      data=cells)  # fmt: skip
    poses = [
        known.make(
            "geometry_msgs/msg/PoseStamped", header=header(START, "map"),
            pose=known.make("geometry_msgs/msg/Pose", position=vector("Point", x, 2.0)),
        )
        for x in (0.0, 1.0, 1.0, 3.0)
    ]  # fmt: skip
    path = known.make("nav_msgs/msg/Path", header=header(START, "map"), poses=poses)
    text = known.make("std_msgs/msg/String", data="not for us")
    rows: list[Any] = [
        ("/map", START, grid), ("/plan", START, path), ("/chatter", START, text),
        ("/tf_static", START, transform(START, "map", "odom", MAP_TO_ODOM)),
        ("/tf_static", START, transform(START, "base", "lidar", MOUNT)),
    ]  # fmt: skip
    for t in TIMES:
        at = START + t
        rows += [
            ("/tf", at, transform(at, "odom", "base", drive(t))),
            ("/odom", at, odometry(at, drive(t), (0.3, 0.0, 0.05))),
            ("/scan", at + 0.01, scan(at)),
            ("/obstacles", at + 0.02, obstacles(at, walk(t), "lidar")),
        ]
    return rows


def matrix(pose: Any) -> np.ndarray:
    x, y, yaw = pose
    cosine, sine = np.cos(yaw), np.sin(yaw)
    return np.array([[cosine, -sine, x], [sine, cosine, y], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module", params=STORAGES)
def whole(request: Any, tmp_path_factory: Any) -> Bag:
    folder = tmp_path_factory.mktemp("bag") / "whole"
    return read_bag(write_bag(folder, everything(), request.param))


def test_a_bag_names_all_its_topics(whole: Bag) -> None:
    assert {one.name: one.count for one in whole.topics.values()} == {
        "/map": 1, "/plan": 1, "/chatter": 1, "/tf_static": 2, "/tf": 120, "/odom": 120,
        "/scan": 120, "/obstacles": 120,
    }  # fmt: skip
    assert whole.notes == () and whole.epoch == round(START * 1e9)
    assert "/chatter" not in whole.timed
    with pytest.raises(WideberthError, match=r"/chatter holds std_msgs/msg/String; not read"):
        whole.rows("/chatter")
    with pytest.raises(WideberthError, match=r"no topic '/scans': did you mean '/scan'"):
        whole.scans("/scans", "base")


def test_a_bag_gives_values_of_ours(whole: Bag) -> None:
    scans = whole.scans("/scan", "base")
    assert len(scans) == 120
    np.testing.assert_allclose(scans[3].times, 0.3 + 0.001 * np.arange(5), atol=1e-9)
    np.testing.assert_allclose(scans[3].bearings, [-1.0, -0.5, 0.0, 0.5, 1.0])
    np.testing.assert_array_equal(scans[3].ranges, [np.nan, 1.0, 2.0, np.inf, np.inf])
    np.testing.assert_allclose(scans[3].mount, MOUNT, atol=1e-12)
    times, poses, twists = whole.motions("/odom")
    np.testing.assert_allclose(times, TIMES, atol=1e-9)
    np.testing.assert_allclose(poses, [drive(t) for t in TIMES], atol=1e-12)
    np.testing.assert_array_equal(twists[5], [0.3, 0.0, 0.05])
    ((_, way),) = whole.routes("/plan")
    np.testing.assert_array_equal(way.points, [(0.0, 2.0), (1.0, 2.0), (3.0, 2.0)])
    (grid,) = whole.maps("/map")
    assert grid.cells.tolist() == [[0, 100, -1], [0, 0, 50]] and grid.origin == (-1.0, -2.0)


def test_tracks_go_through_all_frames(whole: Bag) -> None:
    found = read_bag_tracks(whole.path, 0.1)
    way = [matrix(MAP_TO_ODOM) @ matrix(drive(t)) @ matrix(MOUNT) for t in TIMES]
    wanted = [
        [(motion @ [*walk(t)[i], 1.0])[:2] for t, motion in zip(TIMES, way, strict=True)]
        for i in range(2)
    ]
    np.testing.assert_allclose(found.positions, wanted, atol=1e-9)
    assert found.notes[:2] == (
        "topics used: /obstacles, in the frame 'map'",
        "topics that could be used instead: /odom",
    )


def test_a_topic_and_a_frame_can_be_chosen(whole: Bag) -> None:
    found = read_bag_tracks(whole.path, 0.1, topic="/odom", frame="odom")
    np.testing.assert_allclose(found.positions[0], [drive(t)[:2] for t in TIMES], atol=1e-9)
    assert found.ids == ("/odom",)
    with pytest.raises(WideberthError, match=r"/scan holds sensor_msgs/msg/LaserScan; tracks"):
        read_bag_tracks(whole.path, 0.1, topic="/scan")
    with pytest.raises(WideberthError, match=r"no tracks in /obstacles.*'moon'"):
        read_bag_tracks(whole.path, 0.1, frame="moon")


def other_kinds() -> dict[str, Any]:
    """The same two people in messages of other packages, topic -> message at a time."""
    known = messages()

    def pose(x: float, y: float) -> Any:
        return known.make(
            "geometry_msgs/msg/Pose", position=vector("Point", x, y), orientation=quaternion(0.3)
        )

    def costmap(time: float) -> Any:
        square = ((-0.3, 0.0), (0.0, -0.3), (0.3, 0.0), (0.0, 0.3))
        found = []
        for i, (x, y) in enumerate(walk(time)):
            corners = [vector("Point32", x + a, y + b) for a, b in square]
            polygon = known.make("geometry_msgs/msg/Polygon", points=corners)
            kind = "costmap_converter_msgs/msg/ObstacleMsg"
            found.append(known.make(kind, polygon=polygon, id=i, radius=0.1))
        kind = "costmap_converter_msgs/msg/ObstacleArrayMsg"
        return known.make(kind, header=header(START + time, "map"), obstacles=found)

    def gaussians(time: float) -> Any:
        kind = "mpc_planner_msgs/msg/Obstacle"
        found = [
            known.make(f"{kind}GMM", id=i, pose=pose(*one)) for i, one in enumerate(walk(time))
        ]
        return known.make(f"{kind}Array", header=header(START + time, "map"), obstacles=found)

    def boxes(time: float) -> Any:
        found = []
        for i, one in enumerate(walk(time)):
            size = vector("Vector3", 0.6, 0.8)
            box = known.make("vision_msgs/msg/BoundingBox3D", center=pose(*one), size=size)
            found.append(known.make("vision_msgs/msg/Detection3D", id=f"{i}", bbox=box))
        kind = "vision_msgs/msg/Detection3DArray"
        return known.make(kind, header=header(START + time, "map"), detections=found)

    return {"/costmap": costmap, "/gaussians": gaussians, "/boxes": boxes}


@pytest.mark.parametrize(
    ("topic", "radius"), [("/costmap", 0.4), ("/gaussians", None), ("/boxes", 0.5)]
)
def test_obstacles_of_other_packages(topic: str, radius: float | None, tmp_path: Path) -> None:
    made = other_kinds()[topic]
    bag = write_bag(tmp_path / "bag", [(topic, START + t, made(t)) for t in TIMES])
    found = read_bag_tracks(bag, 0.1)
    assert found.ids == ("0", "1")
    wanted = np.array([walk(t) for t in TIMES]).swapaxes(0, 1)
    np.testing.assert_allclose(found.positions, wanted, atol=1e-6)  # polygons are float32
    (first, _) = read_bag(bag).rows(topic)[0].decoded.content.seen
    assert first.radius == (None if radius is None else pytest.approx(radius, abs=1e-6))


def note_of(bag: Path, count: int = 1) -> str:
    notes = read_bag(bag).notes
    assert len(notes) == count, notes
    return "\n".join(notes)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_gap_is_named_and_the_rest_kept(storage: str, tmp_path: Path) -> None:
    some = TIMES[(TIMES < 4.0) | (TIMES > 7.0)]
    bag = write_bag(tmp_path / "bag", people(some), storage)
    assert note_of(bag) == "/obstacles: nothing from 3.9 s to 7.1 s"
    found = read_bag_tracks(bag, 0.1)
    seen = np.isfinite(found.positions[0, :, 0])
    assert seen.sum() == len(some) and not seen[40:70].any()


def test_a_clock_that_is_set_is_named_and_nothing_lost(tmp_path: Path) -> None:
    rows = [
        ("/obstacles", START + t, obstacles(START + t - 60.0 * (t > 5.0), walk(t))) for t in TIMES
    ]
    bag = write_bag(tmp_path / "bag", rows)
    assert note_of(bag) == "/obstacles: its clock was set by -60 s at 5.1 s"
    found = read_bag_tracks(bag, 0.1)
    wanted = np.array([walk(t) for t in TIMES]).swapaxes(0, 1)
    np.testing.assert_allclose(found.positions, wanted, atol=1e-6)


def test_a_frame_that_is_missing_is_named_and_the_rest_kept(tmp_path: Path) -> None:
    rows = people(TIMES[::2]) + people(TIMES[1::2], "camera")
    bag = write_bag(tmp_path / "bag", sorted(rows, key=lambda row: row[1]))
    found = read_bag_tracks(bag, 0.2)
    assert len(found.times) == 60 and np.isfinite(found.positions).all()
    assert found.notes[-1] == ("left out: 60 messages: no frame connects 'camera' with 'map'")


def test_two_publishers_are_named_and_kept_apart(tmp_path: Path) -> None:
    second = [
        ("/obstacles#2", START + t + 0.03, obstacles(START + t, [(9.0, 9.0)])) for t in TIMES
    ]
    rows = sorted(people() + second, key=lambda row: row[1])
    bag = write_bag(tmp_path / "bag", rows)
    assert note_of(bag) == "/obstacles has 2 publishers"
    found = read_bag_tracks(bag, 0.1)
    ours = "01" * 16
    assert set(found.ids) == {ours, "02" * 16, f"{ours} (2)"}
    place = dict(zip(found.ids, found.positions, strict=True))
    np.testing.assert_allclose(place[f"{ours} (2)"], 9.0)
    np.testing.assert_allclose(place[ours], [walk(t)[0] for t in TIMES], atol=1e-6)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.999])
@pytest.mark.parametrize("folder", [True, False])
def test_a_truncated_file_is_read_up_to_its_end(
    share: float, folder: bool, tmp_path: Path
) -> None:
    bag = write_bag(tmp_path / "bag", people())
    file = bag / "bag.mcap"
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    if share < 0.1:
        with pytest.raises(WideberthError, match=r"cannot be read|neither obstacles nor"):
            read_bag_tracks(bag if folder else file, 0.1)
        return
    found = read_bag_tracks(bag if folder else file, 0.1)
    assert found.notes[-1].startswith("bag.mcap is damaged; the ")
    count = int(found.notes[-1].split()[4])
    assert count == len(found.times) and count >= (0.5 if share < 0.9 else 0.85) * share * 120


def test_a_damaged_place_in_the_middle_does_not_stop_the_reader(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", people())
    file = bag / "bag.mcap"
    data = bytearray(file.read_bytes())
    for place in range(200, len(data), 997):
        data[place] ^= 0xFF
    file.write_bytes(bytes(data))
    try:
        read_bag(bag)
    except WideberthError as error:
        assert "cannot be read" in str(error)


def test_a_damaged_database_is_refused(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", people(), "SQLITE3")
    file = bag / "bag.db3"
    file.write_bytes(b"SQLite format 3\0" + bytes(200))
    with pytest.raises(WideberthError, match="cannot be read as a recording of ROS 2"):
        read_bag(bag)


def test_another_definition_is_named_and_the_rest_kept(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    other = get_typestore(Stores.ROS2_JAZZY)
    kind, known = "vision_msgs/msg/Detection3DArray", messages()
    other.register(get_types_from_msg("std_msgs/Header header\nfloat32[] places", kind))
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        strange = bag.add_connection("/strange", kind, typestore=other)
        sound = bag.add_connection("/obstacles", ARRAY, typestore=known.store)
        for t in TIMES:
            at = round((START + t) * 1e9)
            message = other.types[kind](header=header(START + t, "map"), places=np.zeros(2, "f4"))
            bag.write(strange, at, other.serialize_cdr(message, kind))
            bag.write(sound, at, known.to_bytes(obstacles(START + t, walk(t))))
    note = note_of(tmp_path / "bag")
    assert note.startswith("/strange: 120 messages left out: it is of another definition")
    assert len(read_bag_tracks(tmp_path / "bag", 0.1).ids) == 2


def test_malformed_messages_are_counted_and_the_rest_kept(tmp_path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    known = messages()
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        place = bag.add_connection("/obstacles", ARRAY, typestore=known.store)
        for i, t in enumerate(TIMES):
            data = known.to_bytes(obstacles(START + t, walk(t)))
            data = data[:50] if i % 10 == 5 else data
            bag.write(place, round((START + t) * 1e9), data)
    assert note_of(tmp_path / "bag").startswith(
        "/obstacles: 12 messages left out: 50 bytes are no"
    )
    assert len(read_bag(tmp_path / "bag").rows("/obstacles")) == 108


@pytest.mark.parametrize("roll", [0.0, np.pi])
def test_scans_of_a_sensor_that_hangs_upside_down_are_mirrored(
    tmp_path: Path, roll: float
) -> None:
    rows = [("/tf_static", START, transform(START, "base", "lidar", MOUNT, roll))]
    rows.append(("/scan", START + 0.01, scan(START)))
    bag = read_bag(write_bag(tmp_path / "bag", rows))
    (found,) = bag.scans("/scan", "base")
    side = 1.0 if roll == 0.0 else -1.0
    np.testing.assert_allclose(found.bearings, side * np.array([-1.0, -0.5, 0.0, 0.5, 1.0]))
    np.testing.assert_allclose(found.mount, MOUNT, atol=1e-12)
    assert bag.notes == ()


def test_a_sensor_that_tilts_is_named_and_not_used(tmp_path: Path) -> None:
    rows = people(frame="lidar")
    rows.append(("/tf_static", START, transform(START, "map", "lidar", MOUNT, 0.5)))
    rows.append(("/scan", START + 0.01, scan(START)))
    bag = write_bag(tmp_path / "bag", rows)
    assert note_of(bag) == "frames: 'lidar' tilts by more than 0.1 rad against 'map' (1 times)"
    with pytest.raises(WideberthError, match="'lidar' tilts by"):
        read_bag(bag).scans("/scan", "map")


def test_obstacles_without_an_identity_of_their_own_are_named_by_place(tmp_path: Path) -> None:
    """All have the identity of zeros: of each message the last one was taken, or none."""
    rows = people()
    for _, _, message in rows:
        for one in message.obstacles:
            one.uuid.uuid[:] = 0
    found = read_bag_tracks(write_bag(tmp_path / "bag", rows), 0.1)
    assert sorted(found.ids) == ["unnamed 1", "unnamed 2"]
    places = found.positions[:, len(found.times) // 2]
    middle = float(found.times[len(found.times) // 2] - found.times[0])
    np.testing.assert_allclose(sorted(map(tuple, places)), sorted(walk(middle)), atol=0.02)
    count = 2 * len(TIMES)
    note = f"{count} obstacles without an identity of their own: named by place"
    assert note in found.notes


def test_simulated_time_counts_where_messages_have_no_stamp(tmp_path: Path) -> None:
    known = messages()
    rows: list[Any] = []
    for t in TIMES:  # the simulation runs at half the speed
        clock = known.make("rosgraph_msgs/msg/Clock", clock=header(t / 2 + 100.0, "").stamp)
        message = obstacles(0.0, walk(t))
        rows += [("/clock", START + t, clock), ("/obstacles", START + t, message)]
    found = read_bag_tracks(write_bag(tmp_path / "bag", rows), 0.05)
    assert found.times[-1] - found.times[0] == pytest.approx(TIMES[-1] / 2, abs=1e-6)


def test_a_bag_without_anybody_names_its_topics(tmp_path: Path) -> None:
    known = messages()
    text = known.make("std_msgs/msg/String", data="hello")
    bag = write_bag(tmp_path / "bag", [("/chatter", START, text)])
    with pytest.raises(WideberthError, match=r"its topics are /chatter \(std_msgs/msg/String\)"):
        read_bag_tracks(bag, 0.1)
    with pytest.raises(WideberthError, match=r"is no recording of ROS 2; wanted a folder"):
        read_bag(tmp_path / "nothing")
    with pytest.raises(WideberthError, match=r"dt"):
        read_bag_tracks(bag, 0.0)


def test_definitions_as_idl_are_read() -> None:
    rule = "=" * 80 + "\n"
    text = f"{rule}IDL: a/msg/B\nmodule a {{ module msg {{ struct B {{ double x; }}; }}; }};\n"
    known = Messages.of_text("a/msg/B", text)
    assert known.to_bytes(known.make("a/msg/B", x=1.5))[4:] == np.float64(1.5).tobytes()
    with pytest.raises(WideberthError, match="its definition of a/msg/B cannot be read"):
        Messages.of_text("a/msg/B", "what is this")


def gaussian(places: np.ndarray, axes: np.ndarray) -> Any:
    """Return a forecast of mpc_planner_msgs: (N, 3) places with headings, (N, 2) semi-axes."""
    known = messages()
    poses = [
        known.make(
            "geometry_msgs/msg/PoseStamped",
            pose=known.make(
                "geometry_msgs/msg/Pose",
                position=vector("Point", *place[:2]),
                orientation=quaternion(place[2]),
            ),
        )
        for place in places
    ]
    mean = known.make("nav_msgs/msg/Path", poses=poses)
    return known.make(
        "mpc_planner_msgs/msg/Gaussian", mean=mean,
        major_semiaxis=axes[:, 0].copy(), minor_semiaxis=axes[:, 1].copy(),
    )  # fmt: skip


def test_forecasts_in_a_recording_are_mixtures(tmp_path: Path) -> None:
    """Weights, means and covariances, turned into the fixed frame; a malformed one is left out."""
    rng = np.random.default_rng(7)
    known = messages()
    drawn = [[(rng.normal(size=(6, 3)), rng.uniform(0.1, 1.0, (6, 2))) for _ in range(modes)]
             for modes in (2, 1, 1)]  # fmt: skip
    told = [np.array([1.0, 3.0]), np.array([1.0]), np.array([0.4, 0.6])]  # the last: one too many
    found = [
        known.make(
            "mpc_planner_msgs/msg/ObstacleGMM",
            id=i,
            probabilities=weight,
            gaussians=[gaussian(*one) for one in modes],
        )
        for i, (modes, weight) in enumerate(zip(drawn, told, strict=True))
    ]
    kind = "mpc_planner_msgs/msg/ObstacleArray"
    message = known.make(kind, header=header(1.0, "base"), obstacles=found)
    pose = (2.0, -1.0, 0.7)
    rows = [("/tf", 1.0, transform(1.0, "map", "base", pose)), ("/gmm", 1.0, message)]
    bag = read_bag(write_bag(tmp_path / "bag", rows))
    (one,) = bag.forecasts("/gmm", 0.2)
    assert one.names == ("0", "1") and one.forecast.dt == 0.2
    np.testing.assert_allclose(one.forecast.weight, [[0.25, 0.75], [1.0, 0.0]])
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    for owner in range(2):
        for mode, (places, axes) in enumerate(drawn[owner]):
            wanted = places[:, :2] @ turn.T + pose[:2]
            np.testing.assert_allclose(one.forecast.mean[owner, mode], wanted, atol=1e-12)
            for step in range(6):
                yaw = places[step, 2] + 0.7
                along = np.array([np.cos(yaw), np.sin(yaw)])
                aside = np.array([-np.sin(yaw), np.cos(yaw)])
                long, wide = axes[step] ** 2
                spread = long * np.outer(along, along) + wide * np.outer(aside, aside)
                np.testing.assert_allclose(
                    one.forecast.covariance[owner, mode, step], spread, atol=1e-12
                )
    assert len(bag.timed["/gmm"][0].decoded.content.seen) == 3  # type: ignore[union-attr]
    with pytest.raises(WideberthError, match="dt"):
        bag.forecasts("/gmm", 0.0)


@pytest.mark.parametrize("folder", [True, False])
@pytest.mark.parametrize(
    "options",
    [
        {"repeat_channels": False},
        {"repeat_schemas": False},
        {"repeat_channels": False, "repeat_schemas": False},
        {"repeat_channels": False, "use_statistics": False},
        {"repeat_schemas": False, "use_chunking": False},
        {"index_types": 0},
        {"index_types": 0, "use_statistics": False, "repeat_channels": False},
        {"use_chunking": False},
        {"use_chunking": False, "repeat_channels": False, "repeat_schemas": False},
    ],
)
def test_a_summary_need_not_repeat_what_the_file_holds(
    tmp_path: Path, options: dict[str, Any], folder: bool
) -> None:
    """The format leaves it to the writer which channels, schemas and indexes it repeats."""
    pytest.importorskip("mcap", reason="pip install mcap")
    bag = write_bag(
        tmp_path / "bag",
        [*people(), ("/odom", START, odometry(START, (0.0, 0.0, 0.0), (0.3, 0.0, 0.0)))],
    )
    whole = read_bag(bag)
    rewrite(bag / "bag.mcap", options)
    found = read_bag(bag if folder else bag / "bag.mcap")
    assert {name: (one.kind, one.count) for name, one in found.topics.items()} == {
        "/obstacles": (ARRAY, 120),
        "/odom": ("nav_msgs/msg/Odometry", 1),
    }
    for name, rows in whole.timed.items():
        assert [row.time for row in found.rows(name)] == [row.time for row in rows]
    assert not any("damaged" in note for note in found.notes)


def test_a_chunk_whose_bytes_changed_is_damage(tmp_path: Path) -> None:
    """Its records are whole, and the file lacks its summary; the chunk's checksum does not fit."""
    pytest.importorskip("mcap", reason="pip install mcap")
    from mcap.writer import CompressionType

    bag = write_bag(tmp_path / "bag", people())
    file = bag / "bag.mcap"
    rewrite(file, {"repeat_channels": False, "compression": CompressionType.NONE})
    (note,) = read_bag(file).notes
    assert note == "bag.mcap has no complete summary; all 120 messages are read"
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 0xFF
    file.write_bytes(bytes(data))
    (note,) = read_bag(file).notes
    assert note.startswith("bag.mcap is damaged; the ")


def rewrite(file: Path, options: dict[str, Any]) -> None:
    """Write an MCAP file anew, with options of its writer."""
    from mcap.reader import make_reader
    from mcap.writer import IndexType, Writer

    if "index_types" in options:
        options = {**options, "index_types": IndexType(options["index_types"])}
    with file.open("rb") as stream:
        rows = list(make_reader(stream).iter_messages(log_time_order=False))
    with file.open("wb") as target:
        writer = Writer(target, **options)
        writer.start(profile="ros2", library="test")
        channels: dict[str, int] = {}
        for schema, channel, message in rows:
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.topic], message.log_time, message.data, message.publish_time
            )
        writer.finish()
