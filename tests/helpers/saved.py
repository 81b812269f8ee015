"""What is saved, in small: the files of tests/data/saved, from which a test reads.

``python -m wideberth.tests.helpers.saved`` writes them anew. That is due where a format has a new
version; then the files of the former one stay beside them, and the test reads both.
"""

import shutil
from pathlib import Path

import numpy as np

from wideberth import Detection, Observation, build, recommended
from wideberth import Path as Route
from wideberth.experiments.engine.runner import run
from wideberth.framework.mpc.diagnosis.solve_record import SolveRecord, write_solve
from wideberth.framework.plugins.config import save_plugin
from wideberth.framework.predictor import Fittable
from wideberth.framework.testing.predictor_cases import draw_recordings

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
    planner = recommended("unicycle", 0.5, quiet=True)
    planner.set_path(Route([(0, 0), (12, 0)]))
    for k in range(-20, 1):
        walker = Detection("walker", (5.0, 0.25 * k - 1.0), 4e-4 * np.eye(2), 0.3)
        observation = Observation(0.5 * k, (0, 0, 0, 0.5, 0), (walker,))
        planner.remember(observation)
    planner.command(observation)
    return planner.explain()


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
