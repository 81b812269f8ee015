"""The robot among recorded people: how a crossing is drawn, and what is said of bad files."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from wideberth.experiments.cli.app import main
from wideberth.experiments.drawing.plotting import paper_style, save
from wideberth.experiments.engine.base import Result
from wideberth.experiments.engine.runner import draw, run
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.experiments.studies.crowd import (
    DATA,
    PREFIX,
    ROOM,
    TrackFile,
    bridged,
    counted_reasons,
    draw_situation,
    guess_kind,
)
from wideberth.experiments.studies.replay import Replay, compare, contacts
from wideberth.framework.values.errors import WideberthError
from wideberth.predictors.data.recordings import Recording
from wideberth.simulation.engine.agents import ReplayAgent

CROWD = (DATA / "crowd.txt").read_text()
DRAWN = {"reach": 6.0, "speed": 0.7, "radii": (0.3, 0.3), "span": (8.0, 60.0)}


def shipped(*overrides: str) -> Replay:
    experiment, _ = read_experiment("replay", list(overrides))
    assert isinstance(experiment, Replay)
    return experiment


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Replay, Result]:
    experiment = shipped().quick()
    folder = tmp_path_factory.mktemp("replay") / "out"
    return experiment, run(experiment, folder)


@pytest.mark.parametrize("path", ["shipped:crowd.txt", "shipped:robot.txt"])
def test_unhindered_robot_meets_the_person_half_way(path: str) -> None:
    recording = TrackFile(path).read()
    for seed in range(20):
        found = draw_situation(recording, np.random.default_rng(seed), **DRAWN)
        assert found.path.length == pytest.approx(12.0)
        half = 6.0 / 0.7
        (aimed,) = (one for one in found.people if one.name == PREFIX + found.aimed)
        # Starts stand on rows, so that the moment is met to half a row.
        nearest = aimed.at(np.linspace(half - 0.2, half + 0.2, 201)) - found.path.at(6.0)
        assert np.nanmin(np.linalg.norm(nearest, axis=1)) < 1e-6 + 0.01
        for time, place in ((0.0, found.path.points[0]), (2 * half, found.path.goal)):
            row = np.array([round(time / 0.4) * 0.4])
            gaps = [np.linalg.norm(one.at(row)[0] - place) - 0.6 for one in found.people]
            assert not np.nanmin([*gaps, np.inf]) < ROOM


def test_people_are_where_they_were_recorded_on_a_shifted_clock() -> None:
    recording = TrackFile().read()
    found = draw_situation(recording, np.random.default_rng(3), **DRAWN)
    row = round((found.start - recording.times[0]) / recording.dt)
    assert found.end == pytest.approx(recording.times[-1] - found.start)
    for one in found.people:
        track = recording.positions[recording.ids.index(one.name.removeprefix(PREFIX))]
        for k in range(-10, 30):
            if 0 <= row + k < len(track):
                here = one.at(np.array([0.4 * k]))[0]
                np.testing.assert_allclose(here, track[row + k], atol=1e-9)


def test_start_and_moment_are_drawn_from_the_seed_alone() -> None:
    recording = TrackFile().read()
    once, again, other = (
        draw_situation(recording, np.random.default_rng(seed), **DRAWN) for seed in (5, 5, 6)
    )
    assert (once.start, once.aimed) == (again.start, again.aimed)
    np.testing.assert_array_equal(once.path.points, again.path.points)
    assert not np.array_equal(once.path.points, other.path.points)


def test_short_gaps_are_bridged_and_long_ones_kept() -> None:
    line = np.stack([np.arange(12.0), 2.0 * np.arange(12.0)], axis=1)
    holed = line.copy()
    holed[[2, 6, 7, 8]] = np.nan
    recording = Recording(0.4, 0.4 * np.arange(12), ("a",), holed[None], (None,))
    filled = bridged(recording)[0]
    np.testing.assert_allclose(filled[:6], line[:6])  # 0.8 s between two samples
    assert np.isnan(filled[6:9]).all()  # 1.6 s
    assert np.isnan(recording.positions[0, 2]).all()


def test_nobody_to_aim_at_but_an_unusable_track_is_there(tmp_path: Path) -> None:
    text = CROWD + "".join(f"{10 * k} 99 0.0 {9 + 0.1 * k}\n" for k in range(24, 29))
    path = tmp_path / "crowd.txt"
    path.write_text(text)
    recording = TrackFile(str(path)).read()
    assert counted_reasons(recording) == "1: fewer than 8 samples"
    drawn = [draw_situation(recording, np.random.default_rng(k), **DRAWN) for k in range(40)]
    assert all(one.aimed != "99" for one in drawn)
    assert all(f"{PREFIX}99" in {person.name for person in one.people} for one in drawn)


def test_kinds_are_told_apart(tmp_path: Path) -> None:
    def kind(text: str) -> str:
        path = tmp_path / "x.txt"
        path.write_text(text)
        return guess_kind(path)

    assert guess_kind(DATA / "crowd.txt") == "tracks"
    assert guess_kind(DATA / "robot.txt") == "robot-log"
    assert kind("0 1 0.5 0\n10 1 0.6 0\n20 1 0.7 0\n") == "tracks"  # one person
    assert kind("0.0 1.0 0.5 0\n0.0 2.0 0.6 0\n") == "tracks"
    assert kind("0 ann 0.5 0\n") == "tracks"
    assert kind("0.5 1_2 0.5 0\n") == "tracks"  # a name
    assert kind("0 0.5 0 0\n1 0.6 0 0\n") == "robot-log"  # whole seconds
    assert kind("0 0.5 0 0\n0 0.6 0 0\n") == "tracks"  # a frame twice
    assert kind("0.1 1 0 0\n0.0 1 0 0\n") == "robot-log"  # which its reader refuses
    assert kind("# time x y theta\n0 1 2 0\n1 1 2 0\n") == "robot-log"  # its header says so
    assert kind("id,time,x,y\n1,0.5,2,0\n2,0.5,2,0\n") == "tracks"  # with times
    # Whole seconds, whole metres: the stated exception, with its cure.
    standing = "0 1 2 0.1\n1 1 2 0.2\n2 1 2 0.3\n"
    assert kind(standing) == "tracks"
    log = TrackFile(str(tmp_path / "x.txt"), dt=0.2, kind="robot-log", minimum_samples=2)
    assert log.read().ids == ("x",)


def test_contacts_are_counted_by_whose_fault_they_are() -> None:
    times = np.linspace(0.0, 4.0, 41)
    driving = np.stack([np.minimum(times, 3.0), 0 * times], axis=1)
    still = SimpleNamespace(
        positions=driving, radius=0.3, speeds=np.where(times < 3.0, 1.0, 0.0), name="robot"
    )

    def person(x: float, begin: float, end: float = 4.0, come: float = 0.0) -> ReplayAgent:
        clock = np.array([begin, end, 5.0])
        places = np.array([[x - come, 0.0], [x, 0.0], [np.nan, np.nan]])
        return ReplayAgent(f"{x} {begin}", clock, places, 0.3)

    people = (
        person(1.5, -3.0, 2.5),  # stands there to be seen, the robot drives into it
        person(2.5, 1.8),  # turns up 0.1 s before the robot is there
        person(3.5, -3.0, 4.0, come=-7.0),  # walks into the waiting robot
        person(0.0, -3.0, -1.0),  # was there before
        person(9.0, -3.0),  # never near
    )
    logs = [SimpleNamespace(positions=one.at(times), radius=0.3) for one in people]
    episode = SimpleNamespace(agents=(still, *logs), times=times)
    found = contacts(episode, SimpleNamespace(people=people))  # type: ignore[arg-type]
    assert found == {"drove_into": 1, "run_into": 1, "sudden": 1}


def test_played_result_states_the_tracks(played: tuple[Replay, Result]) -> None:
    experiment, result = played
    rows = result.rows
    assert [row["planner"] for row in rows] == ["kalman", "static", "oracle"]
    assert len({(row["start"], row["aimed"], row["people"]) for row in rows}) == 1
    for line in experiment.summary(rows):
        assert (line["tracks_usable"], line["tracks_unusable"]) == (12, 0)
        assert line["collisions"] <= line["drove_into"] + line["run_into"] + line["sudden"]
    assert result.read("tracks.txt").startswith(b"12 of 12 tracks usable, 60 rows of 0.4 s")
    by = {row["planner"]: row for row in rows}
    assert by["kalman"]["named_forecasts"] == 1.0
    assert 0.2 < by["oracle"]["named_forecasts"] <= 1.0  # the rest left the recording too soon
    assert by["static"]["coverage"] < by["kalman"]["coverage"]
    assert by["kalman"]["ended"] == "goals" and by["kalman"]["clearance"] > 0.0


def test_the_same_episode_again_gives_the_same_bytes(played: tuple[Replay, Result]) -> None:
    experiment, result = played
    task = next(task for task in experiment.tasks() if task.settings["planner"] == "static")
    again = experiment.measure(task)
    assert again.files == {"replay-static-0.npz": result.read("replay-static-0.npz")}


def test_figures_are_drawn_from_the_result_alone(
    played: tuple[Replay, Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TrackFile, "read", lambda self: pytest.fail("read the recording"))
    files = draw(played[1].folder)
    names = {path.name for path in files}
    assert {"comparison.pdf", "run_static.png", "animation_kalman.gif"} <= names
    assert all(path.stat().st_size > 1000 for path in files)
    with paper_style():
        again = save(compare(played[1].rows), played[1].folder, "again")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in files[:2]]


def test_comparison_names_who_never_arrived() -> None:
    rows = [
        {"planner": name, "clearance": clearance, "extra_time_worst": extra, "success": extra < 9}
        for name, clearance, extra in (("a", 0.2, 1.1), ("a", 0.3, 2.0), ("b", -0.1, np.inf))
    ]
    (panel,) = compare(rows).axes
    assert panel.get_xlabel().endswith("(no success: b)")
    assert [line.get_marker() for line in panel.lines if line.get_marker() != "None"] == ["o"]


@pytest.mark.parametrize(
    ("text", "say"),
    [
        (None, "cannot be read: No such file"),
        ("", "holds no rows"),
        (b"\x00\x01\xff\xfe", "is not a text file"),
        ("0 1 nan 2\n", "line 1: x is nan"),
        ("0 1 0 2\n10 1 1 2\n10 1 1 2\n", "line 3 repeats frame 10 of id 1"),
        ("10 1 1 2\n10 2 1 2\n0 1 0 2\n", "line 3: frame 0 of id 1 comes after frame 10"),
        ("0.5 1 0 2\n0.1 1 0 2\n", "line 2: time 0.1 does not come after 0.5"),
        ("0 1 0\n", "3 columns; wanted 4"),
        ("0 1 0 2\n10 1 1 2\n", "holds no usable track: 0 of 1 tracks usable"),
        ("".join(f"{k} 1 {k} 2\n" for k in range(20)), "the recording lasts 7.6 s"),
        (
            "".join(f"{k} 1 {500 * k} 2\n" for k in range(40)),
            "median speed 1.25e+03 m/s of those who move: is dt right, are positions in metres?",
        ),
        ("frame,id,x_mm,y_mm\n0,1,2,3\n", "line 1: positions are in millimetres: divide by 1000"),
    ],
)
def test_bad_files_end_before_any_work(
    text: str | bytes | None,
    say: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    if text is not None:
        Path("x.txt").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SystemExit) as end:
        main(["run", "replay", "--set", "tracks.path=x.txt"])
    error = capsys.readouterr().err
    assert end.value.code == 2
    assert say in error and error.count("Error:") == 1
    assert not Path("results").exists()


@pytest.mark.parametrize(
    ("override", "say"),
    [
        ("tracks.dt=0", "tracks.dt is 0"),
        ("tracks.dt=-0.4", "tracks.dt is -0.4"),
        ("tracks.dt=400", r"tracks\.dt is 400 s; is it in ms\?$"),
        ("tracks.radius=-1", "tracks.radius is -1"),
        ("tracks.frames_per_row=0", "tracks.frames_per_row"),
        ("tracks.kind=people", "tracks.kind"),
        ("tracks.file=x", "unknown key"),
        ("seeds=0", "seeds is 0"),
        ("show=[9]", r"show is \[9\]"),
        ("speed=0", "speed is 0"),
        ("planners={}", "planners is empty"),
    ],
)
def test_bad_settings_are_named(override: str, say: str) -> None:
    with pytest.raises(WideberthError, match=say):
        shipped(override)


def test_other_refusals() -> None:
    with pytest.raises(WideberthError, match=r"crowd\.txt"):
        TrackFile("shipped:crowds.txt").read()
    with pytest.raises(WideberthError, match=r"2 x 60 m at 0\.7 m/s"):
        shipped("reach=60").tasks()
    full = np.mgrid[-10:11, -10:11].reshape(2, -1).T.astype(float)
    tracks = np.repeat(full[:, None], 60, axis=1)
    names = tuple(str(k) for k in range(len(full)))
    packed = Recording(0.4, 0.4 * np.arange(60), names, tracks, (None,) * len(names))
    with pytest.raises(WideberthError, match="no start and goal"):
        draw_situation(packed, np.random.default_rng(0), **{**DRAWN, "reach": 1.0})


def test_robot_log_is_played() -> None:
    experiment = shipped("tracks.path=shipped:robot.txt").quick()
    (task, *_) = experiment.tasks()
    (row,) = experiment.measure(task).rows
    assert row["recording"] == "robot" and row["aimed"] == "robot" and row["people"] == 1
    assert row["tracks_usable"] == 1 and row["ended"] == "goals"


def test_a_recording_of_ros_is_replayed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")
    from wideberth.tests.helpers.bags import obstacles, odometry, write_bag

    recording = TrackFile().read()
    rows_of = recording.positions.swapaxes(0, 1)
    rows = [
        (topic, 1000.0 + time, message)
        for time, places in zip(recording.times, rows_of, strict=True)
        for topic, message in (
            ("/obstacles", obstacles(1000.0 + time, np.nan_to_num(places, nan=1e9))),
            ("/odom", odometry(1000.0 + time, (0, 0, 0), (0, 0, 0))),
        )
    ]
    for _, _, message in rows[::2]:
        message.obstacles = [one for one in message.obstacles if one.position.x < 1e8]
    bag = write_bag(tmp_path / "walk", rows)
    found = TrackFile(str(bag)).read()
    order = np.argsort(found.ids)
    assert len(found.ids) == len(recording.ids)
    np.testing.assert_allclose(found.positions[order], recording.positions, atol=1e-9)
    experiment = shipped(f"tracks.path={bag}", "seeds=1")
    assert len(experiment.tasks()) == 3
    said = capsys.readouterr().err
    assert "topics used: /obstacles, in the frame 'map'" in said
    assert "topics that could be used instead: /odom" in said
    assert experiment.inputs() == [bag / "walk.mcap"]
    other = shipped(f"tracks.path={bag}", "tracks.topic=/odom")
    assert other.tracks.read().ids == ("/odom",)


@pytest.mark.parametrize(("unit", "warned"), [(1.0, False), (10.0, True)])
def test_a_file_of_ones_own_is_taken_as_said(
    unit: float, warned: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The time between rows is not in the file; decimetres look like people who fly."""
    walk = "".join(
        f"{10 * k} {who} {unit * 0.4 * k} {unit * (who + 0.1 * k)}\n"
        for who in range(3)
        for k in range(40)
    )
    (tmp_path / "mine.txt").write_text(walk)
    shipped(f"tracks.path={tmp_path / 'mine.txt'}").check()
    said = capsys.readouterr().err
    assert "mine.txt: taken as 0.4 s between rows (tracks.dt); median speed" in said
    assert ("median speed 10.3 m/s of those who move: is dt right" in said) == warned
    assert ("is dt right, are positions in metres?" in said) == warned
    shipped().check()
    assert capsys.readouterr().err == ""
