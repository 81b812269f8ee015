"""Makes recorded instances hard, in nine ways; kept in the file format of the recorded ones.

python benchmarks/perturbations.py HARD.npz    # four in each way, of the sample
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from wideberth.benchmarks.recorded_instances import FIELDS, LEVEL, SAMPLE

Row: TypeAlias = dict[str, Any]
"""One instance: a copy of its arrays, by field."""
DT = 0.5


def bad_guess(row: Row, rng: np.random.Generator) -> None:
    """Move the guess aside, heading and all, and forget its inputs and its level."""
    row["guess_states"][:, :3] += rng.normal(scale=(0.3, 0.3, 0.1))
    row["guess_inputs"][:] = 0.0
    row["guess_scale"][...] = LEVEL


def face_back(row: Row, rng: np.random.Generator) -> None:
    """Let the robot look the other way: heading off by pi."""
    row["initial_state"][2] += np.pi


def guess_inside(row: Row, rng: np.random.Generator) -> None:
    """Stand the first obstacle still upon the middle of the guess, the start kept free."""
    place = row["guess_states"][len(row["reference"]) // 2, :2]
    place = place + rng.normal(scale=0.1, size=2)
    row["mean"][0] = place
    away = np.linalg.norm(place - row["initial_state"][:2])
    row["margin"][0] = min(row["margin"][0], 0.8 * away)


def hugecov(row: Row, rng: np.random.Generator) -> None:
    """Make all deviations eight times as large."""
    row["deviation"] *= 8.0


def jump(row: Row, rng: np.random.Generator) -> None:
    """Move the first obstacle aside by 0.8 m since the guess was made."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    row["mean"][0] += 0.8 * np.array([np.cos(angle), np.sin(angle)])


def singcov(row: Row, rng: np.random.Generator) -> None:
    """Let covariances degenerate: first deviation three times as large, the second 1e-8 m."""
    angle = rng.uniform(0.0, np.pi, (len(row["mean"]), 1))
    row["axis"][..., 0], row["axis"][..., 1] = np.cos(angle), np.sin(angle)
    row["deviation"][..., 0] *= 3.0
    row["deviation"][..., 1] = 1e-8


def symmetric(row: Row, rng: np.random.Generator) -> None:
    """Drive straight at an obstacle that stands or comes straight on; the others are far away."""
    steps = len(row["reference"])
    time = DT * np.arange(steps + 1)
    row["initial_state"][:] = 0.0, 0.0, 0.0, 0.5, 0.0
    row["guess_states"][:] = 0.0
    row["guess_states"][:, 0], row["guess_states"][:, 3] = 0.5 * time, 0.5
    row["guess_inputs"][:] = 0.0
    row["guess_scale"][...] = LEVEL
    row["reference"][:] = row["guess_states"][1:, :2]
    row["mean"][:] = 50.0
    row["mean"][0, :, 0] = rng.uniform(3.5, 4.5) - rng.choice((0.0, 0.4)) * time[:-1]
    row["mean"][0, :, 1] = 0.0
    row["axis"][0] = 1.0, 0.0


def wrap2pi(row: Row, rng: np.random.Generator) -> None:
    """Count the robot's heading a full turn on from the guess's."""
    row["initial_state"][2] += 2.0 * np.pi


def x0_inside(row: Row, rng: np.random.Generator) -> None:
    """Stand the first obstacle still where the robot is, 0.3 m aside: nothing is feasible."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    aside = 0.3 * np.array([np.cos(angle), np.sin(angle)])
    row["mean"][0] = row["initial_state"][:2] + aside


KINDS: dict[str, Callable[[Row, np.random.Generator], None]] = {
    made.__name__: made
    for made in (
        bad_guess,
        face_back,
        guess_inside,
        hugecov,
        jump,
        singcov,
        symmetric,
        wrap2pi,
        x0_inside,
    )
}
SAME = ("bad_guess", "wrap2pi")
"""Kinds whose best cost is that of the instance they were made of."""


def perturb(source: Path, target: Path, each: int, seed: int) -> Path:
    """Make ``each`` instances of every kind out of recorded ones and write them to a file.

    Instances of at most five obstacles are taken, spread over the file. Costs that are no longer
    known are NaN.
    """
    with np.load(source, allow_pickle=False) as data:
        arrays = {name: data[name] for name in FIELDS}
    few = np.flatnonzero(arrays["count"] <= 5)
    taken = few[np.linspace(0, len(few) - 1, each).astype(int)]
    rng = np.random.default_rng(seed)
    rows = []
    for index in taken:
        for kind, change in KINDS.items():
            row = {name: np.array(array[index]) for name, array in arrays.items()}
            row["kind"] = np.array(kind)
            if kind not in SAME:
                row["best_cost"] = np.array(np.nan)
            change(row, rng)
            _blank(row)
            rows.append(row)
    np.savez(target, **{name: np.stack([row[name] for row in rows]) for name in FIELDS})
    return target


def _blank(row: Row) -> None:
    """Leave no numbers where there is no obstacle."""
    for name in ("mean", "axis", "deviation", "margin"):
        row[name][int(row["count"]) :] = np.nan


if __name__ == "__main__":
    perturb(SAMPLE, Path(sys.argv[1]), 4, seed=0)
