"""Recordings in the published formats of other people's datasets, written here and read back."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth.experiments.studies.crowd import TrackFile, guess_kind
from wideberth.experiments.studies.jrdb import RATE, read_jrdb
from wideberth.experiments.studies.prediction_data import PredictionData
from wideberth.experiments.studies.thor_magni import read_thor_magni
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.data.recordings import Recording

DT = 0.4


def walks(seed: int, count: int, rows: int, period: float, size: int = 2) -> Array:
    """People who walk at about 1 m/s through a hall of 16 m, (count, rows, size)."""
    rng = np.random.default_rng(seed)
    steps = period * (
        rng.normal(0.8, 0.3, (count, 1, size)) + rng.normal(0, 0.2, (count, rows, size))
    )
    return np.asarray(rng.uniform(-8.0, 0.0, (count, 1, size)) + steps.cumsum(axis=1))


def cell(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))


def write_thor(path: Path, columns: dict[str, Array], **changes: Any) -> Path:
    """Write a file of THÖR-MAGNI: 16 lines of header, names, a row of 0.01 s per frame.

    ``columns`` are name of the point -> (T, 3) in mm; those that end in ``_`` are centroids.
    """
    bodies = dict.fromkeys(name.split(" ")[0] for name in columns)
    rows = len(next(iter(columns.values())))
    frames = changes.get("frames", np.arange(1, rows + 1))
    times = changes.get("times", 0.01 * np.arange(rows))
    header: dict[str, list[Any]] = {
        "FILE_ID": ["THOR-Magni_120522_SC1A_R1"],
        "N_FRAMES_QTM": [rows],
        "N_BODIES": [len(bodies)],
        "N_MARKERS": [len(columns)],
        "CONTIGUOUS_ROTATION_MATRIX": ["True"],
        "MODALITIES_WITH_UNITS": ["TRAJECTORIES"],
        "MODALITIES_UNITS_SPECIFIED": ["mm"],
        "BODY_NAMES": list(bodies),
        "BODY_ROLES": ["Visitors-Alone"] * len(bodies),
        "BODY_NR_MARKERS": [1] * len(bodies),
        "MARKER_NAMES": list(columns),
        "EYETRACKING_DEVICES": ["TB2", ""],
        "EYETRACKING_FREQUENCY_IR": [100],
        "EYETRACKING_FREQUENCY_SCENE_CAMERA": [25],
        "EYETRACKING_DATA_INCLUDED": ["TB2_Gaze"],
        "EYETRACKING_DATA_N_FRAMES": [0],
    }
    header.update(changes.get("header", {}))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerows([key, *values] for key, values in header.items() if values)
        axes = [f"{n}{a}" if n.endswith("_") else f"{n} {a}" for n in columns for a in "XYZ"]
        writer.writerow(["Frame", "Time", *axes])
        for k in range(rows):
            numbers = [cell(value) for track in columns.values() for value in track[k]]
            writer.writerow([cell(frames[k]), cell(times[k]), *numbers])
        writer.writerows(changes.get("tail", []))
    return path


def millimetres(tracks: Array) -> Array:
    return np.asarray(1000.0 * np.concatenate([tracks, np.full((*tracks.shape[:2], 1), 1.7)], 2))


@pytest.fixture
def thor(tmp_path: Path) -> tuple[Path, Array]:
    """A file of two helmets and the robot, and where the helmets were, (2, 1201, 2) m."""
    tracks = walks(0, 3, 1201, 0.01)
    marks = millimetres(tracks)
    columns = {"Helmet_1 - 1": marks[0], "Helmet_2 - 1": marks[1], "DARKO_Robot - 1": marks[2]}
    return write_thor(tmp_path / "r.csv", columns), tracks[:2]


def test_thor_magni_is_read_as_it_was_written(thor: tuple[Path, Array]) -> None:
    path, tracks = thor
    fine = read_thor_magni(path, 0.01)
    assert fine.ids == fine.usable == ("Helmet_1", "Helmet_2")
    np.testing.assert_allclose(fine.positions, tracks, rtol=0, atol=1e-9)  # m; mm on the way
    coarse = read_thor_magni(path, DT)
    assert coarse.dt == DT and len(coarse.times) == 31
    np.testing.assert_allclose(coarse.positions, tracks[:, ::40], rtol=0, atol=1e-9)
    assert coarse.notes == ("left out: DARKO_Robot",)


def test_the_marker_that_is_seen_most_often_counts_and_a_centroid_before_it(
    tmp_path: Path,
) -> None:
    marks = millimetres(walks(1, 3, 401, 0.01))
    marks[0, 100:200] = np.nan  # 1 s
    columns = {"Helmet_1 - 1": marks[0], "Helmet_1 - 2": marks[1]}
    found = read_thor_magni(write_thor(tmp_path / "a.csv", columns), 0.1)
    np.testing.assert_allclose(found.positions[0], marks[1, ::10, :2] / 1000, atol=1e-9)
    centroid = {**columns, "Helmet_1 Centroid_": marks[2]}
    found = read_thor_magni(write_thor(tmp_path / "b.csv", centroid), 0.1)
    np.testing.assert_allclose(found.positions[0], marks[2, ::10, :2] / 1000, atol=1e-9)


def test_gaps_of_a_helmet_stay_gaps_beyond_the_bridge(tmp_path: Path) -> None:
    marks = millimetres(walks(2, 2, 401, 0.01))
    marks[0, 101:130] = np.nan  # from 1.00 to 1.30 s: bridged
    marks[0, 201:240] = np.nan  # from 2.00 to 2.40 s: not
    columns = {
        "Helmet_1 - 1": marks[0],
        "Helmet_2 - 1": marks[1],
        "Helmet_3 - 1": marks[1] * np.nan,
    }
    found = read_thor_magni(write_thor(tmp_path / "a.csv", columns), 0.1)
    unseen = np.flatnonzero(np.isnan(found.positions[0, :, 0]))
    assert unseen.tolist() == [21, 22, 23]
    inside = (marks[0, 100, :2] + (marks[0, 130, :2] - marks[0, 100, :2]) / 3) / 1000
    np.testing.assert_allclose(found.positions[0, 11], inside, atol=1e-9)
    assert found.ids == ("Helmet_1", "Helmet_2") and "never seen: Helmet_3" in found.notes


def test_repeated_frames_and_rows_of_other_sensors_are_left_out(tmp_path: Path) -> None:
    marks = millimetres(walks(3, 1, 101, 0.01))[0]
    frames = np.arange(1.0, 102.0)
    frames[50] = frames[49]
    columns = {"Helmet_1 - 1": marks}
    times = 0.01 * (frames - 1)
    path = write_thor(tmp_path / "a.csv", columns, frames=frames, times=times, tail=[["", ""]])
    found = read_thor_magni(path, 0.1)
    assert found.notes == ("left out: 1 rows that repeat a frame",)
    np.testing.assert_allclose(found.positions[0, 1], marks[10, :2] / 1000, atol=1e-9)


MARKS = millimetres(walks(4, 1, 60, 0.01))[0]
HELMET = {"Helmet_1 - 1": MARKS}


@pytest.mark.parametrize(
    ("columns", "changes", "words"),
    [
        (
            HELMET,
            {"header": {"BODY_NAMES": []}},
            r"lines is `BODY_NAMES,\.\.\.`; wanted a file of",
        ),
        (
            {"DARKO_Robot - 1": MARKS},
            {},
            r"no columns of people: its bodies are DARKO_Robot; want",
        ),
        ({"Helmet_1 - 1": MARKS / 1000}, {}, r"origin; wanted millimetres.*are these metres\?"),
        (HELMET, {"times": 10.0 * np.arange(60)}, r"10 apart in `Time`; wanted 0\.01 s.*in s"),
        (HELMET, {"times": 0.01 * np.arange(60)[::-1]}, r"wanted times that increase"),
        (HELMET, {"times": np.full(60, np.nan)}, r"line 18: a position without frame or time"),
        (
            HELMET,
            {"tail": [["61", "0.6", "left"]]},
            r"line 78: Helmet_1 - 1 X is 'left'; wanted a",
        ),
        ({"Helmet_1 - 1": MARKS * np.nan}, {}, r"none of Helmet_1 is ever seen"),
        ({"Helmet_1 - 1": MARKS[:0]}, {}, r"holds no rows; wanted one for each frame"),
    ],
)
def test_what_is_no_recording_of_thor_magni(
    columns: dict[str, Array], changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    path = write_thor(tmp_path / "r.csv", columns, **changes)
    with pytest.raises(WideberthError, match=words) as caught:
        read_thor_magni(path, DT)
    assert str(path) in str(caught.value)


def turned(quaternion: Array, place: Array) -> Array:
    """Rotate a place by the matrix of a quaternion x, y, z, w: the textbook's second formula."""
    x, y, z, w = quaternion
    matrix = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    return np.asarray(matrix @ place)


def frame_name(frame: int) -> str:
    return f"{frame:06d}.pcd"


def label(ident: str, place: Array) -> dict[str, Any]:
    box = dict(zip(("cx", "cy", "cz"), place.tolist(), strict=True))
    return {"label_id": ident, "box": {**box, "l": 0.5, "w": 0.5, "h": 1.7, "rot_z": 0.1}}


def write_jrdb(folder: Path, tracks: Array, poses: list[tuple[Array, Array]] | None) -> Path:
    """Write labels_3d and the odometry of a sequence: ``tracks`` (O, T, 3) m, of the world."""
    labels: dict[str, Any] = {}
    odometry: dict[str, Any] = {}
    for k in range(tracks.shape[1]):
        position, quaternion = poses[k] if poses else (np.zeros(3), np.array([0, 0, 0, 1.0]))
        back = quaternion * [-1, -1, -1, 1]
        labels[frame_name(k)] = [
            label(f"pedestrian:{i}", turned(back, track[k] - position))
            for i, track in enumerate(tracks)
            if np.isfinite(track[k]).all()
        ] + [label("car:7", np.ones(3))]
        odometry[frame_name(k)] = {
            "position": dict(zip("xyz", position.tolist(), strict=True)),
            "orientation": dict(zip("xyzw", quaternion.tolist(), strict=True)),
        }
    (folder / "odometry").mkdir(exist_ok=True)
    (folder / "odometry" / "cafe_0.json").write_text(json.dumps({"odometry": odometry}))
    path = folder / "cafe_0.json"
    path.write_text(json.dumps({"labels": labels}))
    return path


def drive(rows: int) -> list[tuple[Array, Array]]:
    """A robot that drives, turns and tilts a little: positions, and unit quaternions x y z w."""
    rng = np.random.default_rng(5)
    turns = rng.normal(size=(rows, 4)) * [0.05, 0.05, 1.0, 1.0]
    quaternions = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    return list(zip(rng.normal(0, 3, (rows, 3)), quaternions, strict=True))


def test_jrdb_is_read_as_it_was_written(tmp_path: Path) -> None:
    tracks = walks(6, 3, 91, 1 / RATE, 3)
    tracks[1, 30:60] = np.nan
    path = write_jrdb(tmp_path, tracks, drive(91))
    for odometry in (tmp_path / "odometry", tmp_path / "odometry" / "cafe_0.json"):
        found = read_jrdb(path, 1 / RATE, odometry=odometry)
        assert found.ids == ("0", "1", "2") and not found.notes
        np.testing.assert_allclose(found.positions, tracks[..., :2], rtol=0, atol=1e-9)
    coarse = read_jrdb(path, DT, odometry=tmp_path / "odometry")
    np.testing.assert_allclose(coarse.positions, tracks[:, ::6, :2], rtol=0, atol=1e-9)


def test_jrdb_without_odometry_stays_in_the_frame_of_the_robot(tmp_path: Path) -> None:
    tracks = walks(7, 2, 60, 1 / RATE, 3)
    found = read_jrdb(write_jrdb(tmp_path, tracks, None), 1 / RATE)
    np.testing.assert_allclose(found.positions, tracks[..., :2], rtol=0, atol=1e-9)
    assert found.notes == ("positions in the frame of the robot: no odometry was given",)
    text = PredictionData(noise=0.01).noise_text([found])
    assert text == f"measurement noise stated as 0.01 m; {found.notes[0]}"


def test_jrdb_leaves_out_frames_without_a_pose(tmp_path: Path) -> None:
    tracks = walks(8, 1, 60, 1 / RATE, 3)
    path = write_jrdb(tmp_path, tracks, drive(60))
    file = tmp_path / "odometry" / "cafe_0.json"
    poses = json.loads(file.read_text())["odometry"]
    file.write_text(json.dumps({"odometry": {k: poses[k] for k in list(poses)[:50]}}))
    found = read_jrdb(path, 1 / RATE, odometry=file)
    assert len(found.times) == 50 and found.notes == (
        "left out: 10 frames without a pose of the robot",
    )


def pedestrian(**box: Any) -> dict[str, Any]:
    return {"label_id": "pedestrian:1", "box": {"cx": 0.0, "cy": 0.0, "cz": 0.0, **box}}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], r"has no 'labels' by frame; wanted the labels of a sequence \(folder labels_3d\)"),
        ({"labels": {"first.pcd": []}}, r"named 'first\.pcd'; wanted a number, as 000123\.pcd"),
        ({"labels": {"000000.pcd": []}}, r"labels no `pedestrian:N`; wanted people"),
        ({"labels": {"0.pcd": {}}}, r"frame 0: \{\} stands where a list of labels was wanted"),
        ({"labels": {"0.pcd": [{"label_id": 3}]}}, r"frame 0: 3 stands where a `label_id` was"),
        (
            {"labels": {"0.jpg": [{"label_id": "pedestrian:1", "box": [1, 2, 3, 4]}]}},
            r"\[1, 2, 3, 4\], in pixels; give the file of labels_3d",
        ),
        ({"labels": {"0.pcd": [pedestrian(), pedestrian()]}}, r"'pedestrian:1' is there twice"),
        ({"labels": {"07.pcd": [], "7.pcd": []}}, r"frame 7 is there twice; remove one of them"),
        ({"labels": {"\u0667.pcd": []}}, r"named '.*\.pcd'; wanted a number"),
        ({"labels": {"0.pcd": [pedestrian(cx="a")]}}, r"'a' stands where a number cx was wanted"),
        (
            {"labels": {"0.pcd": [pedestrian(cx=1e300)]}},
            r"wanted finite numbers of at most 1e\+08",
        ),
    ],
)
def test_what_is_no_sequence_of_jrdb(content: object, words: str, tmp_path: Path) -> None:
    path = tmp_path / "cafe_0.json"
    path.write_text(json.dumps(content))
    with pytest.raises(WideberthError, match=words) as caught:
        read_jrdb(path, DT)
    assert str(path) in str(caught.value)


def test_a_pose_that_turns_nothing_is_refused(tmp_path: Path) -> None:
    poses = [(np.zeros(3), np.zeros(4))] * 3
    path = write_jrdb(tmp_path, walks(9, 1, 3, 1 / RATE, 3), None)
    write_jrdb(tmp_path, walks(9, 1, 3, 1 / RATE, 3), poses)
    with pytest.raises(WideberthError, match=r"frame 0: the orientation has length 0; wanted 1"):
        read_jrdb(path, DT, odometry=tmp_path / "odometry")
    with pytest.raises(WideberthError, match=r"none\.json cannot be read"):
        read_jrdb(path, DT, odometry=tmp_path / "none.json")


def test_configs_and_commands_know_both_by_their_files(
    thor: tuple[Path, Array], tmp_path: Path
) -> None:
    path, tracks = thor
    assert guess_kind(path) == "thor-magni"
    found = TrackFile(str(path), DT).read()
    np.testing.assert_allclose(found.positions, tracks[:, ::40], atol=1e-9)
    world = walks(10, 2, 91, 1 / RATE, 3)
    labels = write_jrdb(tmp_path, world, drive(91))
    assert guess_kind(labels) == "jrdb"
    odometry = str(tmp_path / "odometry")
    file = TrackFile(str(labels), DT, odometry=odometry)
    assert file.files() == [labels, tmp_path / "odometry" / "cafe_0.json"]
    np.testing.assert_allclose(file.read().positions, world[:, ::6, :2], atol=1e-9)
    for pattern, wanted in (("*.csv", tracks[:, ::40]), ("*.json", world[:, ::6, :2])):
        data = PredictionData(str(tmp_path), pattern=pattern, odometry=odometry)
        (scene,) = data.found().values()
        (recording,) = data.read(scene)
        np.testing.assert_allclose(recording.positions, wanted, atol=1e-9)


@pytest.mark.parametrize(
    "read_file", [lambda p: read_thor_magni(p, DT), lambda p: read_jrdb(p, DT)]
)
def test_absent_and_foreign_files(read_file: Callable[[Path], Recording], tmp_path: Path) -> None:
    with pytest.raises(WideberthError, match=r"none\.csv cannot be read"):
        read_file(tmp_path / "none.csv")
    path = tmp_path / "image.csv"
    path.write_bytes(b"\xff\xd8\xff\xe0\x00")
    with pytest.raises(WideberthError, match=r"is not text; wanted a"):
        read_file(path)
