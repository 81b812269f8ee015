"""A planner among people who come into sight briefly, with stamps that jitter."""

from collections.abc import Iterator

import numpy as np
import pytest

from wideberth import Observation, Path, Plan, recommended
from wideberth.framework.mpc.planner.planner import Planner
from wideberth.framework.tracking.perception import FORGET
from wideberth.simulation.engine.agents import ReplayAgent, RobotAgent
from wideberth.simulation.engine.episode import Run
from wideberth.simulation.engine.settings import Settings
from wideberth.simulation.sensing.channel import Channel

EAST = Path(np.array([[0.0, 0.0], [12.0, 0.0]]))
WIDEST = 5.0
"""m, standard deviation at the first step."""


def people(rng: np.random.Generator) -> list[ReplayAgent]:
    """One who is always in sight, and eight who are in sight for 0.2 to 1 s each, off the path."""
    times = np.arange(-1.0, 10.0, 0.1)
    ways = np.outer(times, (0.5, 0.0))
    everyone = [ReplayAgent("always", times, ways + np.array([0.0, -9.0]), 0.3)]
    for number in range(8):
        start, length = rng.uniform(0.0, 6.0), rng.uniform(0.2, 1.0)
        places = ways + rng.uniform((2.0, 4.0), (8.0, 8.0))
        places[(times < start) | (times > start + length)] = np.nan
        everyone.append(ReplayAgent(f"brief {number}", times, places, 0.3))
    return everyone


def decisions(planner: Planner, channel: Channel) -> Iterator[tuple[Observation, Plan]]:
    """Drive one episode; yield what was observed at each decision, and the plan."""
    settings = Settings(time_limit=8.0, history=0.0, channel=channel)
    robot = RobotAgent("robot", planner.robot, planner, EAST, 0.5)
    run = Run([robot], settings, 3, people(np.random.default_rng(5)), (), ())
    observation = run.advance("robot")
    while observation is not None:
        following = run.advance("robot")  # decides first
        assert planner.last_plan is not None
        yield observation, planner.last_plan
        observation = following


@pytest.mark.parametrize("dropout", [0.0, 0.2])
@pytest.mark.parametrize("jitter", [0.0, 0.01])
@pytest.mark.parametrize("predictor", ["adaptive_conformal", "kalman"])
def test_who_was_measured_lately_is_forecast(
    predictor: str, jitter: float, dropout: float
) -> None:
    """Near the place of the newest measurement, with a deviation of at most 5 m."""
    planner = recommended("unicycle", 0.8, predictor=predictor, quiet=True)
    newest: dict[str, tuple[float, np.ndarray]] = {}
    ignored, judged = [], 0
    for observation, plan in decisions(planner, Channel(0.01, dropout, jitter=jitter)):
        now, forecast = observation.stamp, plan.forecast
        newest |= {one.ident: (now - one.age, one.position) for one in observation.detections}
        recent = [name for name, (time, _) in newest.items() if now - time < FORGET - 1e-6]
        assert forecast is not None
        judged += len(recent)
        for name in recent:
            if name not in plan.tracked:
                ignored.append((now, name, "absent"))
                continue
            row = plan.tracked.index(name)
            off = np.linalg.norm(forecast.mean[row, 0, 0] - newest[name][1])
            deviation = np.sqrt(np.linalg.eigvalsh(forecast.covariance[row, 0, 0])[-1])
            if off > WIDEST or deviation > WIDEST:
                ignored.append((now, name, f"{off:.3g} m away, deviation {deviation:.3g} m"))
    assert judged > 80
    assert ignored == []
