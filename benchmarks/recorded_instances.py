"""Recorded MPC instances: read a file, rebuild the problems, check solutions in NumPy.

The file (NumPy ``npz``) holds the paper's problem as met in closed loop. First axis the
instance; K obstacles of which the rest is NaN: ``count``, ``initial_state`` (5),
``reference`` (N, 2), ``mean`` (K, N, 2), ``axis`` (K, N, 2: cosine and sine of the first
eigenvector of the covariance), ``deviation`` (K, N, 2: roots of its eigenvalues, first
along ``axis``), ``margin`` (K), the shifted guess ``guess_states`` (N + 1, 5),
``guess_inputs`` (N, 2), ``guess_scale``, and ``best_cost``, the best feasible cost known.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wideberth.framework.mpc.assembly import assemble
from wideberth.framework.mpc.levels.paper import Paper
from wideberth.framework.mpc.ocp.problem import Parameters, Problem, SlotNumbers
from wideberth.framework.mpc.ocp.transcription import Guess
from wideberth.framework.mpc.slots.gaussian_discs import GaussianDiscs
from wideberth.framework.plugins.config import build
from wideberth.framework.plugins.io import read_arrays, read_bytes
from wideberth.framework.region import Region
from wideberth.framework.values.arrays import Array
from wideberth.framework.values.errors import WideberthError
from wideberth.framework.values.forecast import GaussianObstacle

SAMPLE = Path(__file__).resolve().parents[1] / "tests" / "data" / "mpc_instances.npz"
"""Forty of the recorded instances."""
ELLIPSE, EXACT = "mahalanobis_ellipse", "minkowski_sum"
"""The paper's region, and the exact sum of ellipse and disc."""
DT = 0.5
"""s, the paper's step."""
LEVEL = float(np.sqrt(5.991))
"""s_ref as the paper prints it; its content is 0.949988."""

FIELDS = (
    "count",
    "initial_state",
    "reference",
    "mean",
    "axis",
    "deviation",
    "margin",
    "guess_states",
    "guess_inputs",
    "guess_scale",
    "best_cost",
    "kind",
)


@cache
def unicycle() -> Any:
    """Return the paper's robot."""
    return build("robots", "unicycle")


@cache
def paper_problem(region: str, obstacles: int, steps: int = 15) -> Problem:
    """Build the paper's problem; its printed s_ref is in the recorded parameters."""
    return assemble(
        unicycle(),
        (GaussianDiscs(build("regions", region)),),
        Paper(tail=float(np.exp(-0.5 * LEVEL**2))),
        horizon=steps,
        dt=DT,
        rooms=((obstacles,),),
    )


@dataclass(frozen=True, eq=False)
class Instance:
    """One recorded instance: numbers, starting point, best known cost."""

    kind: str
    obstacles: int
    parameters: Parameters
    guess: Guess
    best_cost: float
    ellipses: tuple[Array, Array, Array, Array]
    """mean, axis, deviation, margin as recorded, for the independent check."""

    def gap(self, cost: float) -> float:
        """(f - f*) / (1 + |f*|)."""
        return (cost - self.best_cost) / (1.0 + abs(self.best_cost))


def read_instances(path: Path, region: Region, speed: float = 0.5) -> Iterator[Instance]:
    """Read the instances of a file, built for a region (the recorded one is the ellipse).

    Raises
    ------
    WideberthError : the file lacks a field.
    """
    arrays = read_arrays(read_bytes(path), str(path))
    missing = sorted(set(FIELDS) - set(arrays))
    if missing:
        raise WideberthError(f"{path.name} lacks {missing}; wanted the fields {FIELDS}")
    arrays = {name: arrays[name] for name in FIELDS}
    for i, count in enumerate(arrays["count"]):
        row = {name: array[i] for name, array in arrays.items()}
        yield _instance(row, int(count), region, speed)


def _instance(row: dict[str, Array], count: int, region: Region, speed: float) -> Instance:
    steps = len(row["reference"])
    mean, axis, deviation = (row[name][:count] for name in ("mean", "axis", "deviation"))
    across = np.stack([-axis[..., 1], axis[..., 0]], axis=-1)
    frame = np.stack([axis, across], axis=-1)
    covariance = np.einsum("...ij,...j,...kj->...ik", frame, deviation**2, frame)
    margin = row["margin"][:count]
    gaussian = GaussianObstacle(mean.swapaxes(0, 1), covariance.swapaxes(0, 1))
    numbers = region.parameters(gaussian, np.broadcast_to(margin, (steps, count)))
    path = np.diff(row["reference"], axis=0, prepend=row["initial_state"][None, :2])
    size = np.linalg.norm(path, axis=1, keepdims=True)
    extra = np.zeros((steps, count, len(region.auxiliary(2))))
    parameters = Parameters(
        initial=row["initial_state"],
        reference=row["reference"],
        direction=path / np.where(size > 0, size, 1.0),
        speed=np.full(steps, speed),
        slots=(SlotNumbers(numbers, np.ones(count), extra, np.full((steps, count), LEVEL)),),
    )
    level = float(row["guess_scale"])
    guess = Guess.bare(row["guess_states"], row["guess_inputs"], level)
    guess = replace(guess, auxiliaries=(extra,))
    ellipses = (mean, axis, deviation, margin)
    kind, best = str(row["kind"]), float(row["best_cost"])
    return Instance(kind, count, parameters, guess, best, ellipses)


def worst_violation(instance: Instance, point: Guess, dt: float = DT) -> float:
    """Largest violation of the paper's unicycle problem, in plain NumPy.

    Written without any code of the assembler: RK4 of the unicycle, the paper's bounds, and
    sqrt(q) - 1 of the enlarged ellipse.
    """
    states, inputs = point.states, point.inputs
    rates = np.array([_rk4(x, u, dt) for x, u in zip(states[:-1], inputs, strict=True)])
    worst = [
        np.abs(states[1:] - rates).max(),
        np.abs(states[0] - instance.parameters.initial).max(),
    ]
    limits = ((states[1:, 3], 0.7), (states[1:, 4], 0.3), (inputs[:, 0], 0.7), (inputs[:, 1], 0.1))
    worst += [np.abs(values).max() - bound for values, bound in limits]
    mean, axis, deviation, margin = instance.ellipses
    offset = states[1:, :2] - mean
    along = (offset * axis).sum(-1)
    across = axis[..., 0] * offset[..., 1] - axis[..., 1] * offset[..., 0]
    size = point.level * deviation + margin[:, None, None]
    root = np.sqrt((along / size[..., 0]) ** 2 + (across / size[..., 1]) ** 2)
    return float(max(*worst, (1.0 - root).max(initial=0.0), -point.level))


def _rk4(state: Array, control: Array, dt: float) -> Array:
    def rate(x: Array) -> Array:
        return np.array([x[3] * np.cos(x[2]), x[3] * np.sin(x[2]), x[4], *control])

    k1 = rate(state)
    k2 = rate(state + dt / 2 * k1)
    k3 = rate(state + dt / 2 * k2)
    k4 = rate(state + dt * k3)
    return np.asarray(state + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
