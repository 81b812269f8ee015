"""The example of a package that extends wideberth, installed as a third party's is."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from wideberth.tests.house.test_imports import ROOT

EXAMPLE = ROOT / "examples" / "extension"
RUN = "from wideberth.experiments.cli.app import main; main()"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the package alone, built from a copy."""
    folder = tmp_path_factory.mktemp("installed")
    made = shutil.ignore_patterns("build", "*.egg-info", "__pycache__", "results")
    source = tmp_path_factory.mktemp("source") / "extension"
    shutil.copytree(EXAMPLE, source, ignore=made)
    words = ["install", "-q", "--no-deps", "--no-build-isolation", "--target", str(folder)]
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *words, str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return folder


@pytest.mark.parametrize(
    ("words", "output"),
    [
        ("--help", "Print how far people drift."),
        ("drift 0.5", "1.50 m"),
        ("list predictors", "Enlarge the covariance of the Kalman filter"),
        ("list configs", "How far do people drift within"),
        ("check predictor drift", "drift keeps the laws of predictors"),
        ("run drift --quick --no-figures", "drift (m)"),
    ],
)
def test_what_it_offers_is_found(words: str, output: str, installed: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", RUN, *words.split()],
        cwd=tmp_path, capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": str(installed), "COLUMNS": "200"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert output in " ".join(done.stdout.split())
