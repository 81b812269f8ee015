"""Recorded solves: a pair of files, JSON and npz, that opens the exact problem again.

``NAME.json`` holds the planner's config, the sizes of the problem and the hash of its expressions,
the names of its slots, and what the planner said; ``NAME.npz`` the numbers: ``parameters.*``,
``guess0.*``, ``guess1.*``, ... and ``point.*`` (the plan taken), as the fields of `Parameters` and
`Guess`, those of the k-th kind of slots as ``parameters.slots.k.*`` and ``guess0.auxiliaries.k``.
Format "wideberth/solve", version 1.
"""

import io
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from pathlib import Path
from typing import Any, final

import numpy as np

from ...framework.mpc.ocp.problem import Parameters, SlotNumbers
from ...framework.mpc.ocp.transcription import Guess, Multipliers
from ...framework.mpc.planner.cycle import Solved
from ...framework.mpc.planner.recorder import Recorder
from ...framework.mpc.planner.settings import PlannerSettings
from ...framework.plugins.io import (
    expanded,
    read_arrays,
    read_bytes,
    read_json,
    write_bytes,
    write_json,
)
from ...framework.values.arrays import Array, positive, whole
from ...framework.values.errors import WideberthError
from ...framework.values.plan import Rung
from .explain import PlanSummary, SolveRecord

KIND = "solve"
VERSION = 1


@final
@dataclass(frozen=True)
class Record(Recorder):
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

    def wants(self, solved: Solved) -> bool:
        """Whether this one is to be kept."""
        slow = self.slower_than is not None and solved.seconds > self.slower_than
        return slow or solved.plan.rung is not Rung.OPTIMAL

    def keep(self, settings: PlannerSettings, solved: Solved) -> str:
        """Write the pair; never raises. Returns why it could not be written, or nothing."""
        try:
            folder = Path(self.folder).expanduser()
            folder.mkdir(parents=True, exist_ok=True)
            if len(list(folder.glob("solve-*.json"))) < self.most:
                solve = SolveRecord.of(settings, solved)
                digest = sha256(_numbers(solve)).hexdigest()[:12]
                write_solve(folder / f"solve-{digest}.json", solve)
        except Exception as error:  # a folder may fail in any way, and the robot drives
            return f"not recorded: {type(error).__name__}: {error}"
        return ""


def write_solve(path: str | Path, solve: SolveRecord) -> Path:
    """Write a solve as ``path`` (.json) and the .npz beside it; each whole or not at all.

    Raises
    ------
    WideberthError : a folder that cannot be written, or settings that are no plain values.
    """
    path = expanded(path).with_suffix(".json")
    write_bytes(path.with_suffix(".npz"), _numbers(solve))
    content = {
        "planner": solve.planner,
        "rooms": [list(room) for room in solve.rooms],
        "key": solve.key,
        "names": list(solve.names),
        "starts": len(solve.guesses),
        "ends": list(solve.ends),
        "verdict": asdict(solve.verdict),
    }
    try:
        return write_json(path, KIND, VERSION, content)
    except TypeError as error:
        raise WideberthError(
            f"{path} cannot be written: a plug-in's setting is no plain value ({error})"
        ) from None


def read_solve(path: str | Path) -> SolveRecord:
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
        return SolveRecord(
            planner=dict(content["planner"]),
            rooms=tuple(tuple(map(int, room)) for room in content["rooms"]),
            key=str(content["key"]),
            names=tuple(content["names"]),
            parameters=_parameters(_below("parameters", arrays)),
            guesses=tuple(
                _guess(_below(f"guess{i}", arrays)) for i in range(int(content["starts"]))
            ),
            point=_guess(_below("point", arrays)),
            verdict=PlanSummary(**content["verdict"]),
            ends=tuple(map(str, content.get("ends", ()))),
        )
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise WideberthError(
            f"{path} and {numbers.name} are damaged or no pair: {type(error).__name__}: {error}"
        ) from None


def _numbers(solve: SolveRecord) -> bytes:
    """All arrays of a solve as an npz; the same solve gives the same bytes."""
    values: dict[str, Parameters | Guess] = {"parameters": solve.parameters, "point": solve.point}
    values |= {f"guess{i}": guess for i, guess in enumerate(solve.guesses)}
    arrays = {
        f"{name}.{field}": array for name, one in values.items() for field, array in _flat(one)
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def _flat(value: Any) -> Iterator[tuple[str, Array]]:
    """Yield the arrays of a value, those of nested values and tuples under dotted names."""
    nested = isinstance(value, tuple)
    inner = (
        enumerate(value) if nested else ((f.name, getattr(value, f.name)) for f in fields(value))
    )
    for name, entry in inner:
        if isinstance(entry, tuple | SlotNumbers | Multipliers):
            yield from ((f"{name}.{below}", array) for below, array in _flat(entry))
        elif entry is not None:
            yield str(name), np.asarray(entry)


def _below(name: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Arrays whose names begin with ``name`` and a dot, under the rest of their names."""
    cut = len(name) + 1
    return {key[cut:]: value for key, value in arrays.items() if key.startswith(f"{name}.")}


def _parameters(arrays: dict[str, Array]) -> Parameters:
    """Rebuild the numbers of an instance."""
    below = _below("slots", arrays)
    count = len({key.partition(".")[0] for key in below})
    slots = tuple(SlotNumbers(**_below(str(k), below)) for k in range(count))
    plain = {key: value for key, value in arrays.items() if not key.startswith("slots.")}
    return Parameters(slots=slots, **plain)


def _guess(arrays: dict[str, Array]) -> Guess:
    """Rebuild a starting point."""
    below = _below("auxiliaries", arrays)
    own = tuple(below[str(k)] for k in range(len(below)))
    plain = {key: arrays[key] for key in ("states", "inputs", "slack")}
    below = _below("multipliers", arrays)
    slots = tuple(below[f"slots.{k}"] for k in range(len(below) - 1))
    known = Multipliers(below["steps"], slots) if below else None
    return Guess(auxiliaries=own, level=float(arrays["level"]), multipliers=known, **plain)
