"""Recorded solves: a pair of files, JSON and npz, that opens the exact problem again.

``NAME.json`` holds the planner's config, the size of the problem and the hash of its expressions,
the names of its slots, and what the planner said; ``NAME.npz`` the numbers: ``parameters.*``,
``guess0.*``, ``guess1.*``, ... and ``point.*`` (the plan taken), as the fields of `Parameters` and
`Guess`. Format "wideberth/solve", version 1.
"""

import io
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...plugins.io import expanded, read_arrays, read_bytes, read_json, write_bytes, write_json
from ...values.arrays import Array, positive, whole
from ...values.errors import WideberthError
from ...values.plan import Rung
from ..ocp.problem import Parameters
from ..ocp.transcription import Guess
from ..planner.problem_cache import Size
from .explain import Decision, Solve, Verdict

KIND = "solve"
VERSION = 1

V = TypeVar("V", Parameters, Guess)


@dataclass(frozen=True)
class Record:
    """Which solves are kept, and where. Writing a pair takes milliseconds of the loop.

    Parameters
    ----------
    folder : made when first needed.
    slower_than : s; calls that took longer are kept besides those that ended below the first
        rung. None keeps only these.
    most : pairs that the folder may hold; what comes then is not kept.

    Raises
    ------
    WideberthError : a number out of range.
    """

    folder: str
    slower_than: float | None = None
    most: int = 20

    def __post_init__(self) -> None:
        if self.slower_than is not None:
            positive("record.slower_than", self.slower_than, zero=True)
        whole("record.most", self.most)

    def wants(self, decision: Decision) -> bool:
        """Whether this one is to be kept."""
        slow = self.slower_than is not None and decision.seconds > self.slower_than
        return slow or decision.plan.rung is not Rung.OPTIMAL

    def keep(self, decision: Decision, planner: Any) -> str:
        """Write the pair; never raises. Returns why it could not be written, or nothing."""
        try:
            folder = Path(self.folder).expanduser()
            folder.mkdir(parents=True, exist_ok=True)
            if len(list(folder.glob("solve-*.json"))) < self.most:
                solve = decision.solve(planner)
                digest = sha256(_numbers(solve)).hexdigest()[:12]
                write_solve(folder / f"solve-{digest}.json", solve)
        except Exception as error:  # a folder may fail in any way, and the robot drives
            return f"not recorded: {type(error).__name__}: {error}"
        return ""


def write_solve(path: str | Path, solve: Solve) -> Path:
    """Write a solve as ``path`` (.json) and the .npz beside it; each whole or not at all.

    Raises
    ------
    WideberthError : a folder that cannot be written, or settings that are no plain values.
    """
    path = expanded(path).with_suffix(".json")
    write_bytes(path.with_suffix(".npz"), _numbers(solve))
    content = {
        "planner": solve.planner,
        "size": asdict(solve.size),
        "key": solve.key,
        "names": list(solve.names),
        "starts": len(solve.guesses),
        "verdict": asdict(solve.verdict),
    }
    try:
        return write_json(path, KIND, VERSION, content)
    except TypeError as error:
        raise WideberthError(
            f"{path} cannot be written: a plug-in's setting is no plain value ({error})"
        ) from None


def read_solve(path: str | Path) -> Solve:
    """Read what `write_solve` wrote; either file of the pair names it.

    Raises
    ------
    WideberthError : a file is missing or damaged, of another format, or of a newer version.
    """
    path = expanded(path).with_suffix(".json")
    content = read_json(path, KIND, VERSION)
    numbers = path.with_suffix(".npz")
    try:
        arrays = read_arrays(read_bytes(numbers), str(numbers))
    except WideberthError as error:
        raise WideberthError(
            f"{error}; a recorded solve is a pair of files, .json and .npz"
        ) from None
    try:
        return Solve(
            planner=dict(content["planner"]),
            size=Size(**content["size"]),
            key=str(content["key"]),
            names=tuple(content["names"]),
            parameters=_taken(Parameters, "parameters", arrays),
            guesses=tuple(_taken(Guess, f"guess{i}", arrays) for i in range(content["starts"])),
            point=_taken(Guess, "point", arrays),
            verdict=Verdict(**content["verdict"]),
        )
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise WideberthError(
            f"{path} and {numbers.name} are damaged or no pair: {type(error).__name__}: {error}"
        ) from None


def _numbers(solve: Solve) -> bytes:
    """All arrays of a solve as an npz; the same solve gives the same bytes."""
    values: dict[str, Parameters | Guess] = {"parameters": solve.parameters, "point": solve.point}
    values |= {f"guess{i}": guess for i, guess in enumerate(solve.guesses)}
    arrays = {
        f"{name}.{entry.name}": np.asarray(getattr(value, entry.name))
        for name, value in values.items()
        for entry in fields(value)
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def _taken(kind: type[V], name: str, arrays: dict[str, Array]) -> V:
    """Rebuild a value of its arrays; a single number becomes a float again."""
    found: dict[str, Any] = {}
    for entry in fields(kind):
        value = arrays[f"{name}.{entry.name}"]
        found[entry.name] = value if value.ndim else float(value)
    return kind(**found)
