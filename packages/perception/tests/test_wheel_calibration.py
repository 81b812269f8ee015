"""The calibration of wheels in the physics."""

from pathlib import Path

import pytest

from wideberth.experiments.engine.base import Result
from wideberth.experiments.engine.csv_tables import write_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.values.errors import WideberthError
from wideberth_perception.physics.body import LARGE, SkidSteerBody
from wideberth_perception.studies.wheel_calibration import WheelCalibration


def test_a_soft_servo_and_light_wheels_turn_at_a_fraction(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="pip install 'wideberth[perception]'")
    experiment, _ = read_experiment("wheel_calibration", [])
    assert isinstance(experiment, WheelCalibration)
    assert experiment.bodies["small"] == SkidSteerBody() and experiment.bodies["large"] == LARGE
    quick = experiment.quick()
    rows = [row for task in quick.tasks() for row in quick.measure(task).rows]
    assert rows == [row for task in quick.tasks() for row in quick.measure(task).rows]
    lines = {(line["body"], line["cone"]): line for line in quick.summary(rows)}
    for (name, cone), line in lines.items():
        if name in ("small", "large"):
            # The friction of a pyramid is a little more than that of an ellipse within it.
            room = 0.1 if cone == "pyramidal" else 0.2
            assert abs(line["yaw_gain"] / line["theory"] - 1.0) < room, (name, cone)
            assert line["straight"] == pytest.approx(1.0, abs=0.002)
            assert line["least"] <= line["yaw_gain"] <= line["largest"]
        if name == "both":
            assert line["yaw_gain"] < 0.45 * line["theory"]
    droops = (lines[name, "pyramidal"]["droop_m_s"] for name in ("small", "both"))
    assert next(droops) < 0.2 * next(droops)
    write_table(tmp_path / "table.csv", rows)
    drawn = quick.figures(Result(tmp_path), tmp_path / "figures")
    assert {file.suffix for file in drawn} == {".png", ".pdf"}


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(WideberthError, match="bodies is empty"):
        WheelCalibration(bodies={})
    with pytest.raises(WideberthError, match="wanted a speed above 0"):
        WheelCalibration(speeds=(0.0,))
    with pytest.raises(WideberthError, match="each larger than that before"):
        WheelCalibration(rates=(0.3, 0.1))
    with pytest.raises(WideberthError, match="rates is 0"):
        WheelCalibration(rates=(0.0,))
