"""Episodes as recordings: an independent decoder reads equal values; nothing is lost."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError, build
from wideberth.draw.plans import kept_out
from wideberth.experiments.cli.app import main
from wideberth.framework.numerics.chi_square import content_bound
from wideberth.framework.values.motion import Command
from wideberth.framework.values.plan import Situation
from wideberth.framework.values.sensing import Scan
from wideberth.simulation.log.episode_log import Episode
from wideberth.tests.helpers import player_samples
from wideberth_ros.bag import Bag, read_bag
from wideberth_ros.bag_tracks import read_bag_tracks
from wideberth_ros.bag_writer import BagWriter
from wideberth_ros.cli.episode_bag import EPOCH, topic_of, write_episode_bag
from wideberth_ros.encoding import MessageEncoder, identity
from wideberth_ros.messages import messages

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")


@pytest.fixture(scope="module")
def episode() -> Episode:
    """An episode with plans that keep out of regions, and names that ROS takes."""
    found = player_samples.episode()
    region = build("regions", "mahalanobis_ellipse")
    situation = Situation(region, 0.4, np.array([0.3]), 0.3)
    names = {one.name: f"walker {i}" for i, one in enumerate(found.agents)}
    agents = []
    for one in found.agents:
        plans = tuple(
            replace(plan, situation=situation, ids=("walker 1",), tracked=("walker 1",))
            for plan in one.plans
        )
        agents.append(replace(one, name=names[one.name], plans=plans))
    return replace(found, agents=tuple(agents), plan_seconds={}, perception={})


@pytest.fixture(scope="module")
def file(episode: Episode, tmp_path_factory: Any) -> Path:
    path = tmp_path_factory.mktemp("episode") / "one.npz"
    path.write_bytes(episode.to_bytes())
    return path


@pytest.fixture(scope="module")
def written(file: Path, tmp_path_factory: Any) -> Path:
    out = tmp_path_factory.mktemp("bags") / "out"
    write_episode_bag(file, out)
    return out


@pytest.fixture(scope="module")
def decoded(written: Path) -> dict[str, list[tuple[int, Any]]]:
    """Topic -> (ns, message), by a decoder that shares no code with ours."""
    reader = pytest.importorskip("mcap.reader", reason="pip install mcap-ros2-support")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="pip install mcap-ros2-support")
    found: dict[str, list[tuple[int, Any]]] = {}
    with (written / "out.mcap").open("rb") as stream:
        made = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        for _, channel, message, content in made.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def seconds(stamp: Any) -> float:
    return (stamp.sec * 10**9 + stamp.nanosec - EPOCH) * 1e-9


def test_an_independent_decoder_reads_the_motion(decoded: Any, episode: Episode) -> None:
    robot = episode.robots[0]
    rows = decoded["/walker_0/odom"]
    assert len(rows) == len(episode.times)
    for (time, one), true, place, heading, speed in zip(
        rows, episode.times, robot.positions, robot.headings, robot.speeds, strict=True
    ):
        assert time == EPOCH + round(true * 1e9) == round(seconds(one.header.stamp) * 1e9) + EPOCH
        pose = one.pose.pose
        assert (pose.position.x, pose.position.y) == tuple(place)
        yaw = 2.0 * np.arctan2(pose.orientation.z, pose.orientation.w)
        assert np.cos(yaw - heading) == pytest.approx(1.0, abs=1e-12)
        assert one.twist.twist.linear.x == speed
        assert (one.header.frame_id, one.child_frame_id) == ("map", "walker_0/base_link")


def test_an_independent_decoder_reads_plans_and_commands(decoded: Any, episode: Episode) -> None:
    robot = episode.robots[0]
    assert len(decoded["/walker_0/plan"]) == len(robot.plans) == 3
    for (_, one), plan in zip(decoded["/walker_0/plan"], robot.plans, strict=True):
        found = [(pose.pose.position.x, pose.pose.position.y) for pose in one.poses]
        np.testing.assert_array_equal(found, plan.positions)
        times = [seconds(pose.header.stamp) for pose in one.poses]
        np.testing.assert_allclose(times, plan.stamp + plan.dt * np.arange(len(found)), atol=1e-9)
    for (_, one), speed in zip(decoded["/walker_0/cmd_vel"], robot.commands.linear, strict=True):
        assert (one.twist.linear.x, one.twist.linear.y) == tuple(speed)


def test_an_independent_decoder_reads_markers(decoded: Any, episode: Episode) -> None:
    robot = episode.robots[0]
    for (_, one), plan in zip(decoded["/walker_0/forecast"], robot.plans, strict=True):
        assert one.markers[0].action == 3  # removes those before
        shown = one.markers[1:]
        steps = [marker.id // 2 for marker in shown]  # two modes, one of them without weight
        assert steps == list(range(8))
        for step, marker in zip(steps, shown, strict=True):
            mean, spread = plan.forecast.mean[0, 0, step], plan.forecast.covariance[0, 0, step]
            assert (marker.pose.position.x, marker.pose.position.y) == tuple(mean)
            yaw = 2.0 * np.arctan2(marker.pose.orientation.z, marker.pose.orientation.w)
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
            axes = np.diag([marker.scale.x / 2, marker.scale.y / 2]) ** 2 / content_bound(2, 0.05)
            np.testing.assert_allclose(turn @ axes @ turn.T, spread, atol=1e-12)
    for (_, one), plan in zip(decoded["/walker_0/regions"], robot.plans, strict=True):
        rims = kept_out(plan, plan.situation, list(range(8)))[0, 0]
        for marker, rim in zip(one.markers[1:], rims, strict=True):
            found = np.array([(point.x, point.y) for point in marker.points])
            np.testing.assert_array_equal(found, [*rim, rim[0]])


def test_nothing_is_lost_on_the_way_back(written: Path, episode: Episode) -> None:
    back: Bag = read_bag(written)
    assert back.notes == () and back.epoch == EPOCH
    robot = episode.robots[0]
    times, poses, twists = back.motions("/walker_0/odom")
    np.testing.assert_allclose(times, episode.times, atol=1e-9)  # stamps are whole ns
    np.testing.assert_array_equal(poses[:, :2], robot.positions)
    np.testing.assert_allclose(np.cos(poses[:, 2] - robot.headings), 1.0, atol=1e-12)
    np.testing.assert_array_equal(twists[:, 0], robot.speeds)
    np.testing.assert_array_equal(twists[:, 2], robot.yaw_rates)
    for (_, path), plan in zip(back.routes("/walker_0/plan"), robot.plans, strict=True):
        np.testing.assert_array_equal(path.points, plan.positions)
    others = {one.name: one for one in episode.agents if one.name != robot.name}
    seen: dict[str, list[Any]] = {name: [] for name in others}
    for time, reading, _ in back.rows("/walker_0/obstacles"):
        for one in reading.content.seen:  # type: ignore[union-attr]
            seen[one.ident].append((time, *one.pose[:2]))
            assert one.radius == others[one.ident].radius
    for name, rows in seen.items():
        here = np.isfinite(others[name].positions).all(axis=1)
        wanted = np.column_stack([episode.times, others[name].positions])[here]
        np.testing.assert_allclose(rows, wanted, atol=1e-9)
    frames = back.frames.motion("map", "walker_0/base_link", episode.times)
    np.testing.assert_allclose(frames[:, :2], robot.positions, atol=1e-9)


def test_an_episode_can_be_replayed_from_its_recording(written: Path, episode: Episode) -> None:
    found = read_bag_tracks(written, 0.1)
    assert set(found.ids) == {one.name for one in episode.agents[1:]}


def test_the_same_episode_gives_the_same_bytes(file: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_episode_bag(file, tmp_path / name / "out")
    for name in ("out.mcap", "metadata.yaml"):
        assert (tmp_path / "a/out" / name).read_bytes() == (tmp_path / "b/out" / name).read_bytes()


def test_trajectories_come_with_lyrical(file: Path, tmp_path: Path, episode: Episode) -> None:
    write_episode_bag(file, tmp_path / "out", distribution="lyrical", storage="sqlite3")
    back = read_bag(tmp_path / "out")
    assert back.topics["/walker_0/trajectory"].kind == "nav_msgs/msg/Trajectory"
    plan = episode.robots[0].plans[0]
    message = MessageEncoder(known=messages("lyrical")).trajectory(plan)
    places = [(one.pose.position.x, one.pose.position.y) for one in message.points]
    np.testing.assert_array_equal(places, plan.positions)
    np.testing.assert_allclose([one.velocity.linear.x for one in message.points], 0.5)
    with pytest.raises(WideberthError, match="there is no message"):
        MessageEncoder().trajectory(plan)


def test_a_scan_comes_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    scan = Scan(
        "front", 1.0 + 0.0005 * np.arange(360), np.linspace(-np.pi, np.pi, 360),
        np.where(rng.random(360) < 0.1, np.inf, rng.uniform(0.2, 9.0, 360)), longest=10.0,
    )  # fmt: skip
    wording = MessageEncoder(EPOCH)
    with BagWriter(tmp_path / "bag", wording.known) as bag:
        bag.write("/scan", EPOCH, wording.scan(scan, "base_link"))
    (found,) = read_bag(tmp_path / "bag").scans("/scan", "base_link")
    np.testing.assert_allclose(found.ranges, scan.ranges, rtol=1e-6)  # float32
    np.testing.assert_allclose(found.bearings, scan.bearings, atol=1e-5)
    np.testing.assert_allclose(found.times - found.times[0], scan.times - 1.0, atol=1e-7)


def test_names_become_identities() -> None:
    assert bytes(identity("eve")).rstrip(b"\0") == b"eve"
    long = identity("somebody with a long name")
    assert long.shape == (16,) and not np.array_equal(long, identity("somebody with another name"))


def test_points_of_a_lidar_are_a_cloud(tmp_path: Path) -> None:
    points = np.array([[1.0, 2.0], [-3.0, 0.5]])
    cloud = MessageEncoder().points(0.0, points)
    found = np.frombuffer(cloud.data.tobytes(), "<f4").reshape(-1, 3)
    np.testing.assert_array_equal(found[:, :2], points)
    assert (cloud.width, cloud.point_step, len(cloud.data)) == (2, 12, 24)


def test_commands_of_the_shell(
    file: Path, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(*words: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as stop:
            main(["bag", *words])
        found = capsys.readouterr()
        return int(stop.value.code or 0), found.out + found.err

    code, said = run(str(file), "--out", str(tmp_path / "out"))
    assert code == 0 and "/walker_0/plan: 3" in said and "written: " in said
    monkeypatch.chdir(tmp_path)
    code, said = run(str(file))  # as `play` and `film`: the episode's name, here
    assert code == 0 and f"written: {file.stem}\n" in said
    assert (tmp_path / file.stem / f"{file.stem}.mcap").is_file()
    for words, cause in (
        (("--out", str(tmp_path / "out")), "a recording is not replaced"),
        (("--out", str(tmp_path / "x"), "--storage", "mcab"), "did you mean 'mcap'"),
        (("--out", str(tmp_path / "x"), "--distribution", "jazy"), "did you mean 'jazzy'"),
    ):
        code, said = run(str(file), *words)
        assert code == 2 and cause in said.replace("\n", " ")


@pytest.fixture(scope="module")
def flown(tmp_path_factory: Any) -> tuple[Episode, dict[str, list[Any]]]:
    """An episode in space, and its messages by an independent decoder."""
    reader = pytest.importorskip("mcap.reader", reason="pip install mcap-ros2-support")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="pip install mcap-ros2-support")
    folder = tmp_path_factory.mktemp("space")
    (folder / "one.npz").write_bytes(player_samples.episode(3).to_bytes())
    write_episode_bag(folder / "one.npz", folder / "out")
    found: dict[str, list[Any]] = {}
    with (folder / "out" / "out.mcap").open("rb") as stream:
        made = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        for _, channel, _, content in made.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(content)
    return player_samples.episode(3), found


def test_an_episode_in_space_has_heights(flown: Any) -> None:
    episode, found = flown
    robot = episode.robots[0]
    own = topic_of(robot, "")
    assert np.ptp(robot.positions[:, 2]) > 0.0
    places = [one.pose.pose.position for one in found[f"{own}odom"]]
    np.testing.assert_array_equal([(p.x, p.y, p.z) for p in places], robot.positions)
    moves = [one.transforms[0].transform.translation for one in found["/tf"]]
    np.testing.assert_array_equal(
        [(p.x, p.y, p.z) for p in moves[:: len(episode.robots)]], robot.positions
    )
    climbs = [one.twist.twist.linear.z for one in found[f"{own}odom"]]
    np.testing.assert_allclose(climbs, np.gradient(robot.positions[:, 2], episode.times))
    for one, plan in zip(found[f"{own}plan"], robot.plans, strict=True):
        poses = [pose.pose.position for pose in one.poses]
        np.testing.assert_array_equal([(p.x, p.y, p.z) for p in poses], plan.positions)
    for one, speed in zip(found[f"{own}cmd_vel"], robot.commands.linear, strict=True):
        assert one.twist.linear.z == speed[2]
    others = [one for one in episode.agents if one.name != robot.name]
    first = found[f"{own}obstacles"][0].obstacles
    np.testing.assert_array_equal(
        [(one.position.x, one.position.y, one.position.z) for one in first],
        [one.positions[0] for one in others],
    )
    assert [one.size.z for one in first] == [2.0 * one.radius for one in others]


def test_forecasts_in_space_are_ellipsoids() -> None:
    from scipy.spatial.transform import Rotation

    plan = player_samples.episode(3).robots[0].plans[0]
    rng = np.random.default_rng(4)
    roots = rng.normal(size=(*plan.forecast.mean.shape, 3))
    spread = roots @ np.swapaxes(roots, -1, -2)
    plan = replace(plan, forecast=replace(plan.forecast, covariance=spread))
    markers = MessageEncoder().forecast(plan).markers[1:]
    assert markers
    for one in markers:
        step, mode = divmod(one.id, plan.forecast.weight.shape[1])
        where = one.pose.position
        np.testing.assert_array_equal(
            (where.x, where.y, where.z), plan.forecast.mean[0, mode, step]
        )
        turn = one.pose.orientation
        axes = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        half = np.array([one.scale.x, one.scale.y, one.scale.z]) / 2
        shape = axes @ np.diag(half**2) @ axes.T / content_bound(3, 0.05)
        np.testing.assert_allclose(shape, spread[0, mode, step], atol=1e-9)


def test_a_trajectory_has_the_robots_own_motion() -> None:
    robot = build("robots", "unicycle")
    base = player_samples.episode().robots[0].plans[0]
    rng = np.random.default_rng(5)
    count = len(base.inputs)
    states, inputs = rng.uniform(-0.3, 0.3, (count + 1, 5)), rng.uniform(-0.1, 0.1, (count, 2))
    plan = replace(base, states=states, inputs=inputs, positions=states[:, :2])
    message = MessageEncoder(known=messages("lyrical")).trajectory(plan, robot)
    found = [
        (
            *(one.pose.position.x, one.pose.position.y),
            2.0 * np.arctan2(one.pose.orientation.z, one.pose.orientation.w),
            *(one.velocity.linear.x, one.velocity.angular.z),
            *(one.acceleration.linear.x, one.acceleration.angular.z),
        )
        for one in message.points
    ]
    wanted = np.column_stack([states, np.vstack([inputs, [0.0, 0.0]])])
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_command_of_two_components() -> None:
    made = MessageEncoder(EPOCH).command(0.5, Command((0.4, 0.1), -0.2), "base")
    assert (made.twist.linear.x, made.twist.linear.y, made.twist.angular.z) == (0.4, 0.1, -0.2)
    assert made.header.stamp.nanosec == 500_000_000
