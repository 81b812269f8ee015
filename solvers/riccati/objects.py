"""The core as object code that the package ships, so that no user has to compile it.

Each file beside this one in ``objects`` is for one kind of processor. `emit` makes them from the
sources; the hash of these and of every object is kept in ``core.json``. An object is used where
the processor can run it and where the sources are still those that it was made from.
"""

import json
import lzma
import platform
import sys
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from ...framework.jit.machine import Target, host_features
from ...framework.values.errors import WideberthError

ENTRY = "wideberth_core"
"""Name of the core in every object."""
KINDS = 2
"""Kinds of slots that shipped objects are for; as many as a planner has anyway."""
FOLDER = Path(__file__).with_name("objects")
MANIFEST = "core.json"

_SOURCES = (
    "_core.py",
    "_protocol.py",
    "emit.py",
    "interior_point.py",
    "support.ll",
    "../../framework/jit/columns.py",
)
"""Files that the core consists of: after a change of any of them it has to be compiled anew."""


@dataclass(frozen=True)
class Processor:
    """A kind of processor that an object is shipped for.

    Attributes
    ----------
    machine : its family, as `platform.machine` says.
    target : what the object is compiled for.
    needs : features, as LLVM names them, without which the object does not run.
    """

    machine: str
    target: Target
    needs: frozenset[str] = frozenset()


PROCESSORS = {
    "linux-x86_64-v3": Processor(
        "x86_64",
        Target("x86_64-unknown-linux-gnu", "x86-64-v3"),
        frozenset({"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt"}),
    ),
    "linux-aarch64": Processor("aarch64", Target("aarch64-unknown-linux-gnu", "generic")),
}
"""By the name of the object. Every x86-64 processor since about 2015 is of the third level."""


def sources() -> str:
    """Hash of the files that the core consists of."""
    texts = [(Path(__file__).parent / name).read_text(encoding="utf-8") for name in _SOURCES]
    return sha256("\0".join(texts).encode()).hexdigest()


def manifest() -> dict[str, Any]:
    """Read what is said of the shipped objects.

    Raises
    ------
    WideberthError : it is missing or damaged.
    """
    try:
        found = json.loads((FOLDER / MANIFEST).read_text(encoding="utf-8"))
        words = {name: str(found[name]) for name in ("sources", "compiler")}
        return {**words, "objects": dict(found["objects"])}
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise WideberthError(f"{FOLDER / MANIFEST} is damaged ({error})") from error


def shipped(kinds: int) -> bytes:
    """Return the object for this processor.

    Raises
    ------
    WideberthError : there is none, or it is damaged, or it is not that of the sources.
    """
    if kinds != KINDS:
        raise WideberthError(f"shipped object code is for {KINDS} kinds of slots, not for {kinds}")
    return code_for(fitting())


def code_for(name: str) -> bytes:
    """Return the object for one of `PROCESSORS`.

    Raises
    ------
    WideberthError : it is damaged, or it is not that of the sources.
    """
    said = manifest()
    if said["sources"] != sources():
        raise WideberthError("shipped object code is not that of the present sources")
    try:
        code = lzma.decompress((FOLDER / f"{name}.o.xz").read_bytes())
    except (OSError, EOFError, lzma.LZMAError) as error:
        raise WideberthError(f"shipped object code {name} is damaged ({error})") from error
    if sha256(code).hexdigest() != said["objects"].get(name):
        raise WideberthError(f"shipped object code {name} is damaged (another hash)")
    return code


def fitting() -> str:
    """Name of the object that this processor runs.

    Raises
    ------
    WideberthError : there is none.
    """
    if sys.platform.startswith("linux") and sys.maxsize > 2**32:
        for name, one in PROCESSORS.items():
            if platform.machine() == one.machine and one.needs <= host_features():
                return name
    raise WideberthError(
        f"no shipped object code is for this processor ({sys.platform}, {platform.machine()})"
    )
