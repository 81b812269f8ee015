"""Readers of recorded tracks and robot logs."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import Scene
from wideberth.predictors.data.recordings import Recording, read_robot_log, read_tracks
from wideberth.predictors.kalman import Kalman
from wideberth.predictors.oracle import Oracle

DATA = Path(__file__).parents[2] / "experiments" / "data"


def write(folder, text, name="tracks.txt"):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.fixture
def generate():
    spec = importlib.util.spec_from_file_location("generate", DATA / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_packaged_files_are_what_their_script_makes(generate):
    for name, seed in (("crowd", generate.CROWD_SEED), ("robot", generate.ROBOT_SEED)):
        text = getattr(generate, name)(np.random.default_rng(seed))
        assert (DATA / f"{name}.txt").read_text() == text


def test_packaged_crowd_is_usable():
    crowd = read_tracks(DATA / "crowd.txt", dt=0.4)
    assert len(crowd.ids) == 12 and crowd.usable == crowd.ids
    assert crowd.positions.shape == (12, 60, 2)
    assert crowd.report().startswith("12 of 12 tracks usable, 60 rows of 0.4 s")
    speed = np.linalg.norm(np.diff(crowd.positions, axis=1), axis=2) / 0.4
    assert 0.0 < np.nanmedian(speed) < 1.6


def test_packaged_robot_log_is_resampled():
    log = read_robot_log(DATA / "robot.txt", 0.5)
    assert log.ids == ("robot",) and log.usable == ("robot",)
    assert log.times[0] == 1000.0 and len(log.times) == 120
    table = np.loadtxt(DATA / "robot.txt")
    np.testing.assert_allclose(log.positions[0], table[::5, 1:3], atol=1e-9)


@pytest.mark.parametrize("mark", ["\t", " ", ",", ", ", "   "])
def test_separators_comments_and_order_do_not_matter(tmp_path, mark):
    rows = [
        (0, 1, 0.0, 1.0),
        (10, 1, 0.5, 1.0),
        (30, 1, 1.5, 1.0),
        (10, "b", 5, 6),
        (20, "b", 6, 6),
    ]
    text = "# frame id x y\n\n" + "".join(
        mark.join(str(value) for value in row) + "  # seen\r\n" for row in rows
    )
    got = read_tracks(write(tmp_path, "\ufeff" + text), dt=0.4, minimum_samples=2)
    assert got.ids == ("1", "b") and got.usable == got.ids
    np.testing.assert_allclose(got.times, 0.4 * np.arange(4))
    nan = np.nan
    np.testing.assert_array_equal(got.positions[0], [[0, 1], [0.5, 1], [nan, nan], [1.5, 1]])
    np.testing.assert_array_equal(got.positions[1], [[nan, nan], [5, 6], [6, 6], [nan, nan]])


def test_sorting_by_frame_or_by_identity_gives_the_same(tmp_path):
    lines = (DATA / "crowd.txt").read_text().splitlines()[1:]
    ordered = sorted(lines, key=lambda line: (int(line.split()[1]), int(line.split()[0])))
    first = read_tracks(write(tmp_path, "\n".join(lines)), dt=0.4)
    second = read_tracks(write(tmp_path, "\n".join(ordered), "other.txt"), dt=0.4)
    for ident in first.ids:
        np.testing.assert_array_equal(
            first.positions[first.ids.index(ident)], second.positions[second.ids.index(ident)]
        )


def test_frame_step_is_that_within_a_track_and_others_are_shifted(tmp_path):
    # Frames 3 and 9 lie half a step beside 0, 6, 12, as after a cut in a video.
    text = "".join(f"{6 * k} 1 {k} 0\n" for k in range(4))
    text += "".join(f"{6 * k + 21} 2 {k} 1\n" for k in range(4))
    text += "40 3 0 0\n46 3 1 1\n49 3 9 9\n52 3 2 2\n"
    got = read_tracks(write(tmp_path, text), dt=0.4, minimum_samples=3, frames_per_row=6)
    assert got.notes[0] == "frames per row: 6"
    assert got.notes[1] == "2 tracks shifted in time to the grid, by up to 0.2 s"
    assert got.notes[2].startswith("1 samples left out") and got.notes[2].endswith(": 3 at 49")
    for track in range(3):
        seen = got.positions[track][np.isfinite(got.positions[track, :, 0])]
        np.testing.assert_allclose(np.diff(seen[:, 0]), 1.0)
    inferred = read_tracks(write(tmp_path, text), dt=0.4, minimum_samples=3)
    assert inferred.notes == got.notes  # 3 frames apart are two samples alone


def test_unusable_tracks_stay_and_say_why(tmp_path):
    text = "".join(f"{k} 1 {k} 0\n" for k in range(10))
    text += "0 2 0 0\n1 2 1 1\n"
    text += "".join(f"{k} 3 {k} 0\n" for k in (0, 1, 2, 3, 7, 8, 9, 10))
    got = read_tracks(write(tmp_path, text), dt=0.4, longest_gap=1.0)
    assert got.usable == ("1",)
    assert got.unusable[1] == "fewer than 8 samples"
    assert got.unusable[2] == "gaps longer than 1 s leave no stretch of 8 samples"
    assert np.isfinite(got.positions[1, :2]).all()
    report = got.report().splitlines()
    assert report[0] == "1 of 3 tracks usable, 11 rows of 0.4 s"
    assert report[1] == "  1 unusable: fewer than 8 samples"
    assert read_tracks(write(tmp_path, text), dt=0.4, longest_gap=1.6).usable == ("1", "3")


def test_columns_in_another_order(tmp_path):
    """What the numbers allow to say of the columns is said."""
    rows = [(ident, 0.4 * k, k) for ident in (1, 2) for k in range(10)]
    for order in (rows, sorted(rows, key=lambda row: row[1])):
        text = "".join(f"{ident} {time:.1f} {x} 0\n" for ident, time, x in order)
        with pytest.raises(
            WideberthError, match=r"columns seem to be `id time x y`, .*: above rows w"
        ):
            read_tracks(write(tmp_path, text), dt=0.4)
    few = "".join(f"{ident} {frame} {x} 0\n" for ident in (1, 2) for frame, x in ((0, 1), (1, 2)))
    report = read_tracks(write(tmp_path, few), dt=0.4).report()  # whole numbers say nothing
    assert "are the columns `frame id x y`, in this order?" in report
    swapped = "".join(f"{0.4 * k:.1f} {ident} {k} 0\n" for ident in (1, 2) for k in range(10))
    with pytest.raises(WideberthError, match=r"frame is 0\.4; .* names, such as `id,time,x,y`"):
        read_tracks(write(tmp_path, swapped), dt=0.4)
    text = "".join(f"{k} 1 {k} 0\n" for k in range(10))
    assert "columns" not in read_tracks(write(tmp_path, text), dt=0.4).report()


def test_times_of_several_people_are_no_robot_log(tmp_path):
    text = "".join(f"{0.4 * k:.1f} {ident} {k} 0.5\n" for k in range(10) for ident in (1, 2))
    said = (
        r"seem to be `time id x y`, since .* from 0 \(line 1\) to 0 \(line 2\) .*such as `id,time,"
    )
    with pytest.raises(WideberthError, match=said):
        read_robot_log(write(tmp_path, text), 0.4)
    one = "".join(f"{0.4 * k:.1f} 7 {k} 0.5\n" for k in range(10))
    (note,) = read_robot_log(write(tmp_path, one), 0.4).notes
    assert note == "x is 7 in every row: are the columns `time x y theta`, in this order?"


@pytest.mark.parametrize(
    ("heading", "asked"),
    [(np.pi / 2, 0), (-np.pi / 2, 0), (0.5, 1), (12.0, 1), (np.pi / 2 + 0.4, 0)],
)
def test_a_robot_log_along_y_is_asked_for_its_order_if_the_heading_denies_it(
    tmp_path, heading, asked
):
    """At x = 0 a body that drives along y points along y, forwards or backwards."""
    text = "".join(f"{0.1 * k:.1f} 0 {0.05 * k} {heading}\n" for k in range(20))
    assert len(read_robot_log(write(tmp_path, text), 0.1).notes) == asked


def test_a_robot_that_turns_on_the_spot_is_not_asked_for_its_order(tmp_path):
    text = "".join(f"{0.1 * k:.1f} 0 3 {0.1 * k}\n" for k in range(20))
    assert read_robot_log(write(tmp_path, text), 0.1).notes == ()


@pytest.mark.parametrize(
    ("head", "message"),
    [
        (
            "# made by hand\n# ID frame X Y",
            r"line 2 names the columns `id frame x y`; .* this order",
        ),
        ("# time x y yaw", r"names the columns `time x y theta`; wanted `frame id x y`"),
        ("# 'frame', 'x', 'y', 'id' (as it was seen", r"names the columns `frame x y id`"),
    ],
)
def test_a_header_that_names_other_columns_is_read(tmp_path, head, message):
    rows = "\n".join(f"{ident} {k} {k} 0" for ident in (1, 2) for k in range(10))
    with pytest.raises(WideberthError, match=message):
        read_tracks(write(tmp_path, f"{head}\n{rows}\n"), dt=0.4)


UNKNOWN = "line 1: header not understood: names '{}'; wanted `frame id x y` in metres"
SMALL = "line 1: positions are in {}: divide by {}"


@pytest.mark.parametrize("mark", ["", "# "])
@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("frame,person,x,y", UNKNOWN.format("frame person x y")),
        ("who frame east north  # by hand", UNKNOWN.format("who frame east north")),
        ("frame id x_km y_km", UNKNOWN.format("frame id x_km y_km")),
        ("person_id,frame,pos_x_mm,pos_y_mm", SMALL.format("millimetres", 1000)),
        ("frame,id,x_mm,y_mm", SMALL.format("millimetres", 1000)),
        ("Frame, ID, X [mm], Y [mm]", SMALL.format("millimetres", 1000)),
        ("number who x_mm y_mm", SMALL.format("millimetres", 1000)),
        ("frame id x (cm) y (cm)", SMALL.format("centimetres", 100)),
    ],
)
def test_a_header_that_is_not_understood_is_no_comment(
    tmp_path: Path, mark: str, head: str, said: str
) -> None:
    path = write(tmp_path, f"{mark}{head}\n0 1 2 3\n")
    with pytest.raises(WideberthError) as caught:
        read_tracks(path, dt=0.4)
    assert said in str(caught.value) and "#" not in str(caught.value)


def test_a_header_of_a_robot_log_is_not_understood(tmp_path: Path) -> None:
    path = write(tmp_path, "# time_s x_m y_m theta_deg\n0 1 2 3\n")
    with pytest.raises(WideberthError, match="wanted `time x y theta` in metres"):
        read_robot_log(path, 0.4)


def test_a_report_asks_for_the_unit_where_people_fly(tmp_path: Path) -> None:
    walk, fly = (
        read_tracks(write(tmp_path, "".join(f"{k} 1 {size * k} 0\n" for k in range(9))), dt=0.4)
        for size in (0.5, 500)
    )
    assert "metres" not in walk.report() and walk.speed == pytest.approx(1.25)
    asked = "1.25e+03 m/s of those who move: is dt right, are positions in metres?"
    assert fly.report().splitlines()[-1] == f"  warning: median speed {asked}"


@pytest.mark.parametrize("head", ["frame,id,x,y", "Frame ped_id x_m y_m",
                                  "# frame id x y", "# Frame, ped_id, x_m, y_m (m)", "# x y",
                                  "# frame (1), id (1), x (m), y (m)", "# (id) [time] (x) y",
                                  '"frame","id","x","y"',
                                  "# recorded at noon by camera 2", "# made by a student",
                                  "# frame rate: 25 Hz", "frame id x y  # by hand",
                                  "# id time x and y come later"])  # fmt: skip
def test_other_comments_are_left_alone(tmp_path, head):
    text = f"{head}\n0 1 2 3\n# id time x y\n1 1 2 3\n"
    assert read_tracks(write(tmp_path, text), dt=0.4).ids == ("1",)


def test_robot_log_keeps_its_clock_and_marks_long_gaps(tmp_path):
    clock = np.concatenate([np.arange(0, 2.05, 0.1), np.arange(2.3, 3.05, 0.1), [4.0, 4.1]])
    start = 1248444175.2
    rows = [f"{start + t:.1f} {t:.2f} {2 * t:.2f} 0.1" for t in clock]
    path = write(tmp_path, "# time_s x_m y_m theta_rad\n" + "\n".join(rows), "r1.txt")
    got = read_robot_log(path, 0.25)
    assert got.ids == ("r1",) and got.times[0] == start and len(got.times) == 17
    grid = got.times - start
    lost = np.isnan(got.positions[0, :, 0])
    np.testing.assert_array_equal(lost, (grid > 3.01) & (grid < 3.99))
    wanted = np.stack([grid, 2 * grid], axis=1)
    np.testing.assert_allclose(got.positions[0][~lost], wanted[~lost], atol=1e-6)
    assert got.notes == ("3 rows unobserved: in gaps longer than 0.3 s",)
    assert read_robot_log(path, 0.25, bridge=1.0, ident="x").ids == ("x",)


def test_a_single_row_is_a_recording(tmp_path):
    assert read_tracks(write(tmp_path, "5 1 2 3"), dt=0.4).positions.shape == (1, 1, 2)
    assert read_robot_log(write(tmp_path, "5 1 2 3"), 0.1).positions.shape == (1, 1, 2)


def test_windows_hold_what_was_seen_and_no_future():
    crowd = read_tracks(DATA / "crowd.txt", dt=0.4)
    window = crowd.tracks(20, 30, radius=0.25, noise=0.02)
    assert window.positions.shape[1] == 30 and window.stamp == crowd.times[20]
    assert np.isfinite(window.positions[:, -1]).all()
    assert np.isnan(window.positions[:, :9]).all()
    rows = [crowd.ids.index(ident) for ident in window.ids]
    np.testing.assert_array_equal(window.positions[:, 9:], crowd.positions[rows, :21])
    np.testing.assert_allclose(window.noise[0], 4e-4 * np.eye(2))
    with pytest.raises(WideberthError, match="end_index is 60; the recording has rows 0 to 59"):
        crowd.tracks(60, 5)


def test_truth_serves_the_oracle():
    crowd = read_tracks(DATA / "crowd.txt", dt=0.4)
    window = crowd.tracks(20, 20)
    forecast = Oracle().predict(window, 5, Scene(truth=crowd.truth()))
    known = [i for i, reason in enumerate(forecast.fallback) if reason is None]
    assert known
    rows = [crowd.ids.index(window.ids[i]) for i in known]
    np.testing.assert_allclose(forecast.mean[known, 0], crowd.positions[rows, 21:26], atol=1e-9)


BAD_TRACKS = {
    "": "holds no rows; wanted `frame id x y`",
    "# nothing\n\n": "holds no rows",
    "a\0b": "is not a text file",
    "0 1 2": "line 1: 3 columns; wanted 4: `frame id x y`",
    "0 1 2 3\n1 1 2 3 4": "line 2: 5 columns",
    "a,b,c,d\n0,1,2,3": "line 1: header not understood: names 'a b c d'; wanted `frame id x y`",
    "0 1 2 nan": "line 1: y is nan; leave a row out",
    "0 1 inf 3": "line 1: x is inf",
    "0 nan 2 3": "line 1: id is nan",
    "nan 1 2 3": "line 1: frame is nan",
    "0.5 1 2 3": "line 1: frame is 0.5; wanted a whole number: .* read_robot_log",
    "0 1 2 3\n0 2 2 3\n0 1.0 2 3": "line 3 repeats frame 0 of id 1 .line 1.; remove",
    "9 1 2 3\n5 1 2 3": "line 2: frame 5 of id 1 comes after frame 9 .line 1.; sort",
    "0 1 0 0\n1 1 0 0\n1000000000 1 2 3": "1000000001 rows .* state frames_per_row",
}


@pytest.mark.parametrize("text", BAD_TRACKS)
def test_bad_tracks_name_place_and_cure(tmp_path, text):
    path = write(tmp_path, text)
    with pytest.raises(WideberthError, match=BAD_TRACKS[text]) as caught:
        read_tracks(path, dt=0.4)
    assert str(path) in str(caught.value)


BAD_LOGS = {
    "": "holds no rows; wanted `time x y theta`",
    "0 1 2": "line 1: 3 columns; wanted 4: `time x y theta`",
    "0 1 2 3\n0 1 2 3": "line 2: time 0 does not come after 0 .line 1.; sort",
    "0 1 2 x": "line 1: theta is 'x'",
    "0 1 2 nan": "line 1: theta is nan",
    "0 0 0 0\n1e12 0 0 0": "in steps of 0.1 s are 1e\\+13 rows",
}


@pytest.mark.parametrize("text", BAD_LOGS)
def test_bad_logs_name_place_and_cure(tmp_path, text):
    path = write(tmp_path, text)
    with pytest.raises(WideberthError, match=BAD_LOGS[text]) as caught:
        read_robot_log(path, 0.1)
    assert str(path) in str(caught.value)


def test_files_that_are_none(tmp_path):
    with pytest.raises(WideberthError, match="cannot be read: No such file or directory; check"):
        read_tracks(tmp_path / "missing.txt", dt=0.4)
    with pytest.raises(WideberthError, match="cannot be read: Is a directory"):
        read_robot_log(tmp_path, 0.1)
    with pytest.raises(WideberthError, match="is not a text file"):
        read_tracks(write(tmp_path, b"\xff\xfe\x81\x00"), dt=0.4)


@pytest.mark.parametrize("dt", [0.0, -1.0, np.nan, "fast"])
def test_dt_must_be_positive(tmp_path, dt):
    path = write(tmp_path, "0 1 2 3")
    for read in (lambda: read_tracks(path, dt=dt), lambda: read_robot_log(path, dt)):
        with pytest.raises(WideberthError, match="dt is"):
            read()


def test_other_settings_are_checked(tmp_path):
    path = write(tmp_path, "0 1 2 3")
    with pytest.raises(WideberthError, match="frames_per_row is 0"):
        read_tracks(path, dt=0.4, frames_per_row=0)
    with pytest.raises(WideberthError, match="minimum_samples is 0"):
        read_tracks(path, dt=0.4, minimum_samples=0)
    with pytest.raises(WideberthError, match="bridge is -1"):
        read_robot_log(path, 0.1, bridge=-1.0)
    with pytest.raises(WideberthError, match=r"recording\.unusable has 0 entries; wanted 1"):
        Recording(0.4, np.zeros(1), ("a",), np.zeros((1, 1, 2)), ())


def test_predictors_run_over_the_whole_crowd():
    crowd = read_tracks(DATA / "crowd.txt", dt=0.4)
    for row in range(0, len(crowd.times), 10):
        forecast = Kalman().predict(crowd.tracks(row, 20), 8)
        assert np.isfinite(forecast.mean).all()


@pytest.mark.parametrize("ident", ["0", "person"])
def test_an_identity_of_several_tracks_in_a_frame_names_none(tmp_path: Path, ident: str) -> None:
    """Four walkers under one identity and one with a name: five tracks, as they walked."""
    rng = np.random.default_rng(2)
    start, velocity = rng.uniform(-5.0, 5.0, (5, 2)), rng.normal(0.0, 0.7, (5, 2))
    lines = [
        f"{10 * frame} {ident if k < 4 else 'guide'} {x:.6f} {y:.6f}"
        for frame in range(20)
        for k in rng.permutation(5)
        for x, y in [start[k] + 0.4 * frame * velocity[k]]
    ]
    recording = read_tracks(write(tmp_path, "\n".join(lines)), dt=0.4)
    assert set(recording.ids) == {"#1", "#2", "#3", "#4", "guide"}
    truth = start[:, None] + 0.4 * np.arange(20)[:, None] * velocity[:, None]
    off = np.abs(recording.positions[:, None] - truth).max(axis=(2, 3))
    assert sorted(off.argmin(axis=1)) == [0, 1, 2, 3, 4] and off.min(axis=1).max() < 1e-6
    (note,) = [text for text in recording.notes if "identities" in text]
    assert f"({ident})" in note and "80 rows are assigned to 4 tracks" in note


@pytest.mark.parametrize(
    "ids",
    [
        ("1_23", "12_3"),
        ("1e3", "1000"),
        ("007", "7"),
        ("9007199254740993", "9007199254740992"),
        ("\u0663", "3"),
        ("+1", "1"),
    ],
)
def test_identities_are_text(tmp_path: Path, ids: tuple[str, str]) -> None:
    text = "".join(f"{k} {name} {k} {n}\n" for n, name in enumerate(ids) for k in range(10))
    recording = read_tracks(write(tmp_path, text), dt=0.4)
    assert recording.ids == ids and recording.positions[:, 0, 1].tolist() == [0.0, 1.0]


def test_frames_keep_their_last_digit(tmp_path: Path) -> None:
    """Stamps in ns need more digits than a float has."""
    first = 1_700_000_000_000_000_001
    for step in (400_000_000, 3):
        text = "".join(f"{first + step * k} a {k} 0\n" for k in range(12))
        recording = read_tracks(write(tmp_path, text), dt=0.4)
        assert recording.positions.shape == (1, 12, 2) and recording.usable == ("a",)
    assert read_tracks(write(tmp_path, "7.8e+02 1.0 2 3"), dt=0.4).ids == ("1",)


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("0 a 1_5 3", "line 1: x is '1_5'; wanted a number"),
        ("0 a 2 \u0663", "line 1: y is '\u0663'; wanted a number"),
        ("0 a 2 0x1", "line 1: y is '0x1'; wanted a number"),
        ("1_0 a 2 3", "line 1: frame is '1_0'; wanted a number"),
        ("1000000000000000000.5 a 2 3", "line 1: frame is .*; wanted a whole number"),
    ],
)
def test_numbers_have_the_plain_grammar(tmp_path: Path, row: str, said: str) -> None:
    with pytest.raises(WideberthError, match=said):
        read_tracks(write(tmp_path, row), dt=0.4)


@pytest.mark.parametrize("row", ["0 1_5 2 3", "0 \u0663 2 3", "1_0 1 2 3"])
def test_robot_logs_have_the_plain_grammar(tmp_path: Path, row: str) -> None:
    with pytest.raises(WideberthError, match=r"line 1: (x|time) is .*; wanted a number"):
        read_robot_log(write(tmp_path, row), 0.1)


@pytest.mark.parametrize("stray", [305, 303, -5])
def test_a_stray_row_does_not_change_the_step_of_all(tmp_path: Path, stray: int) -> None:
    """Between two others, or in front of them: others are not counted from it."""
    rows = [(10 * k, ident, 0.5 * k) for k in range(60) for ident in range(4)]
    plain = "".join(f"{frame} {ident} {x} {ident}\n" for frame, ident, x in sorted(rows))
    rows.append((stray, 2, 0.05 * stray))
    text = "".join(f"{frame} {ident} {x} {ident}\n" for frame, ident, x in sorted(rows))
    wanted = read_tracks(write(tmp_path, plain), dt=0.4)
    recording = read_tracks(write(tmp_path, text, "stray.txt"), dt=0.4)
    for ident in wanted.ids:
        np.testing.assert_array_equal(
            recording.positions[recording.ids.index(ident)],
            wanted.positions[wanted.ids.index(ident)],
        )
    assert recording.notes == (
        "frames per row: 10",
        "1 samples left out: not a whole number of steps from the others of their track: "
        f"2 at {stray}",
    )


def test_gaps_and_shared_rates_keep_the_smallest_common_step(tmp_path: Path) -> None:
    """Of as many steps of 6 as of 12, which gaps make, the smaller one is that of the rows."""
    frames = (0, 6, 18, 24, 36)
    text = "".join(f"{frame} 1 {frame} 0\n" for frame in frames)
    recording = read_tracks(write(tmp_path, text), dt=0.4)
    assert recording.notes[0] == "frames per row: 6" and recording.positions.shape == (1, 7, 2)


@pytest.mark.parametrize("mark", [",", " "])
@pytest.mark.parametrize(
    ("head", "order"),
    [
        ("id,time,x,y", (0, 1, 2, 3)),
        ("# time (s), id, x (m), y (m)", (1, 0, 2, 3)),
        ('"id","time","x","y"', (0, 1, 2, 3)),
        ("x [m] y [m] person_id t", (2, 3, 0, 1)),
    ],
)
@pytest.mark.parametrize("period", [0.1, 0.04, 0.4, 1.0])
def test_rows_with_times_are_resampled(
    tmp_path: Path, head: str, order: tuple[int, ...], period: float, mark: str
) -> None:
    """Two who walk straight on, one of them 0.13 s after the other, at any rate."""
    start, count = 1_700_000_000.0, int(12.0 / period) + 1
    rows = [
        (name, start + lag + period * k, round(1.25 * (lag + period * k), 6), side)
        for name, lag, side in (("1_2", 0.0, 0.0), ("12", 0.13, 1.0))
        for k in range(count)
    ]
    lines = [mark.join(str(row[place]) for place in order) for row in rows]
    path = write(tmp_path, "\n".join([head, *lines]), "walk.csv")
    recording = read_tracks(path, dt=0.4)
    assert recording.ids == recording.usable == ("1_2", "12")
    assert recording.times[0] == start and recording.dt == 0.4
    walked = 1.25 * (recording.times - start)
    for track, lag, side in zip(recording.positions, (0.0, 0.13), (0.0, 1.0), strict=True):
        inside = (recording.times >= start + lag) & (recording.times <= start + lag + 12.0)
        np.testing.assert_allclose(track[inside, 0], walked[inside], atol=1e-5)
        np.testing.assert_array_equal(track[inside, 1], side)
        assert np.isnan(track[~inside]).all()
    assert recording.notes[0].startswith(f"resampled from {period:.3g} s to 0.4 s")


def test_gaps_of_rows_with_times_stay_gaps(tmp_path: Path) -> None:
    times = [0.1 * k for k in range(100) if not 40 <= k < 60]
    text = "id,time,x,y\n" + "".join(f"a,{time:.1f},{time:.2f},0\n" for time in times)
    seen = np.isfinite(read_tracks(write(tmp_path, text), dt=0.4).positions[0, :, 0])
    assert np.flatnonzero(~seen).tolist() == [10, 11, 12, 13, 14]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("a,0.4,1,2\na,0.4,1,2", r"line 3 repeats time 0\.4 of id a \(line 2\); remove one"),
        ("a,0.4,1_0,2", "line 2: x is '1_0'; wanted a number"),
        ("a,0,1,2\na,1e12,1,2\n", "are the times in s"),
        ("a,0.4,1", "line 2: 3 columns; wanted 4: `id time x y`"),
    ],
)
def test_bad_rows_with_times_name_place_and_cure(tmp_path: Path, rows: str, said: str) -> None:
    path = write(tmp_path, f"id,time,x,y\n{rows}")
    with pytest.raises(WideberthError, match=said) as caught:
        read_tracks(path, dt=0.4)
    assert str(path) in str(caught.value)


def test_a_recording_of_hours_is_read(tmp_path: Path) -> None:
    """80 936 rows with 1112 people, of whom few are there at once."""
    text = "".join(
        f"{frame} {ident} {0.5 * k} {ident}\n"
        for ident in range(1112)
        for k, frame in enumerate(range(72 * ident, 72 * ident + 9))
    )
    text += "80935 1111 0 0\n"
    recording = read_tracks(write(tmp_path, text), dt=0.4)
    assert recording.positions.shape == (1112, 80936, 2) and len(recording.usable) == 1112
