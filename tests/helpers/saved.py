"""What is saved, in small: the files of tests/data/saved, from which a test reads.

``python -m wideberth.tests.helpers.saved`` writes them anew. That is due where a format has a new
version; then the files of the former one stay beside them, and the test reads both.
"""

import shutil
from pathlib import Path

import numpy as np

from wideberth import build
from wideberth.controllers.diagnosis.solve_record import SolveRecord, write_solve
from wideberth.experiments.engine.runner import run
from wideberth.framework.plugins.config import save_plugin
from wideberth.framework.predictor import Fittable
from wideberth.framework.testing.predictor_cases import draw_recordings
from wideberth.tests.helpers.planning import past_a_walker

SAVED = Path(__file__).resolve().parents[1] / "data" / "saved"
STUDY = {
    "type": "encounter",
    "scenario": {"type": "crossing"},
    "robot": "unicycle",
    "planners": {"default": {"type": "recommended", "robot": "unicycle"}},
    "settings": {"time_limit": 3.0},
    "seeds": 1,
}


def solve() -> SolveRecord:
    """Return a solve past a walker who crosses the path."""
    found: SolveRecord = past_a_walker().explain()
    return found


def fitted() -> Fittable:
    """Return a predictor that has learnt."""
    predictor = build("predictors", "conformal")
    assert isinstance(predictor, Fittable)
    return predictor.fit(draw_recordings(2, np.random.default_rng(0)))


def main() -> None:
    """Write the files."""
    shutil.rmtree(SAVED, ignore_errors=True)
    SAVED.mkdir(parents=True)
    folder = SAVED / "result"
    run(build("experiments", STUDY), folder)
    shutil.rmtree(folder / "tasks")  # its rows are those of the table
    shutil.rmtree(folder / "figures", ignore_errors=True)
    write_solve(SAVED / "solve.json", solve())
    save_plugin(SAVED / "predictor.json", "predictor", fitted())


if __name__ == "__main__":
    main()
