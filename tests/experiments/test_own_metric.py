"""A metric of the user's in a comparison, as the page of plug-ins shows it."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine.csv_tables import read_table
from wideberth.experiments.engine.shipped_configs import read_experiment
from wideberth.framework.values.errors import WideberthError

PAGE = Path(__file__).resolve().parents[2] / "docs" / "write-your-own.md"


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the page's config, with the page's module beside it."""
    part = PAGE.read_text(encoding="utf-8").partition("## A metric\n")[2]
    module, text = re.findall(r"```(?:python|yaml)\n(.*?)```", part, re.DOTALL)[:2]
    (tmp_path / "my_metric.py").write_text(module, encoding="utf-8")
    (tmp_path / "speed.yaml").write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "my_metric", raising=False)
    return tmp_path / "speed.yaml"


def test_the_metric_of_the_page_is_a_column(config: Path) -> None:
    out = config.parent / "out"
    with pytest.raises(SystemExit) as end:
        cli.main(["run", str(config), "--out", str(out), "--no-figures"])
    assert not end.value.code
    rows, lines = read_table(out / "table.csv"), read_table(out / "summary.csv")
    values = [row["mean_speed_mps"] for row in rows]
    assert len(values) == 2 and all(value > 0.0 for value in values)
    assert lines[0]["mean_speed_mps"] == pytest.approx(np.mean(values))


@pytest.mark.parametrize(
    ("target", "why"),
    [
        ("my_metric:speed", "has no 'speed'"),
        ("my_metric", "names no function"),
        ("no_metric:mean_speed", "No module named 'no_metric'"),
    ],
)
def test_a_metric_that_is_not_there_is_refused_before_the_work(
    config: Path, target: str, why: str
) -> None:
    experiment, _ = read_experiment(str(config), [f"metrics.mean_speed_mps={target}"])
    with pytest.raises(WideberthError, match=why):
        experiment.check()


def test_a_metric_replaces_no_column(config: Path) -> None:
    experiment, _ = read_experiment(str(config), ["metrics={jerk_rms: 'my_metric:mean_speed'}"])
    with pytest.raises(WideberthError, match="'jerk_rms' exists"):
        experiment.measure(next(iter(experiment.tasks())))
