"""Forecasts as messages: what is written is read back."""

import numpy as np
import pytest

from wideberth.framework.values.forecast import Forecast
from wideberth.framework.values.occupancy_grid import OccupancyGrid
from wideberth_ros.decoding import ObstaclesMessage, decode_message
from wideberth_ros.encoding import MessageEncoder
from wideberth_ros.messages import messages

pytest.importorskip("rosbags", reason="pip install 'wideberth[ros]'")

ENCODER = MessageEncoder(5 * 10**9, "odom")


def drawn(seed: int, people: int = 3, modes: int = 2, instants: int = 4) -> Forecast:
    rng = np.random.default_rng(seed)
    root = rng.normal(0.0, 0.4, (people, modes, instants, 2, 2))
    return Forecast(
        rng.normal(0.0, 3.0, (people, modes, instants, 2)),
        root @ np.swapaxes(root, -1, -2),
        rng.dirichlet(np.ones(modes), people),
        0.25,
        (None,) * people,
    )


@pytest.mark.parametrize("seed", range(5))
def test_gaussians_come_back(seed: int) -> None:
    forecast = drawn(seed)
    message = ENCODER.gaussians(2.0, ["4", "17", "eve"], forecast)
    data = messages().to_bytes(message)
    read = messages().read("mpc_planner_msgs/msg/ObstacleArray", data)
    decoded = decode_message("mpc_planner_msgs/msg/ObstacleArray", read)
    assert decoded.stamp == 7 * 10**9 and decoded.frame == "odom"
    assert isinstance(decoded.content, ObstaclesMessage)
    seen = decoded.content.seen
    assert [one.ident for one in seen[:2]] == ["4", "17"] and int(seen[2].ident) < 2**31
    for o, one in enumerate(seen):
        assert one.forecast is not None
        np.testing.assert_allclose(one.forecast.weight, forecast.weight[o], rtol=1e-12)
        np.testing.assert_allclose(one.forecast.mean, forecast.mean[o, :, 1:], rtol=1e-12)
        np.testing.assert_allclose(
            one.forecast.covariance, forecast.covariance[o, :, 1:], rtol=1e-9, atol=1e-12
        )
        likeliest = int(np.argmax(forecast.weight[o]))
        np.testing.assert_allclose(one.pose[:2], forecast.mean[o, likeliest, 0])
    stamps = [pose.header.stamp for pose in read.obstacles[0].gaussians[0].mean.poses]
    assert [(one.sec, one.nanosec) for one in stamps] == [
        (7, 250_000_000), (7, 500_000_000), (7, 750_000_000),
    ]  # fmt: skip


def test_an_axis_that_is_known_exactly_comes_back() -> None:
    flat = np.array([[0.25, 0.0], [0.0, 0.0]])
    forecast = Forecast.single(np.zeros((1, 2, 2)), np.stack([flat, flat])[None], 0.1)
    message = ENCODER.gaussians(0.0, ["1"], forecast)
    decoded = decode_message("mpc_planner_msgs/msg/ObstacleArray", message)
    assert isinstance(decoded.content, ObstaclesMessage)
    found = decoded.content.seen[0].forecast
    assert found is not None
    np.testing.assert_allclose(found.covariance[0, 0], flat, atol=1e-15)


def test_a_grid_comes_back() -> None:
    cells = np.array([[-1, 0, 3], [100, 50, 99]])
    grid = OccupancyGrid(cells, 0.25, (-1.5, 2.0))
    data = messages().to_bytes(ENCODER.grid(1.0, grid))
    kind = "nav_msgs/msg/OccupancyGrid"
    found = decode_message(kind, messages().read(kind, data)).content
    assert isinstance(found, OccupancyGrid) and found.resolution == 0.25
    assert np.array_equal(found.cells, cells) and found.origin == (-1.5, 2.0)
