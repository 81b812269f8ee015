"""Kinds of processors that LLVM compiles for."""

import platform
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ..values.errors import WideberthError


@dataclass(frozen=True)
class Target:
    """A processor to compile for, as LLVM names it: triple, model, features."""

    triple: str
    cpu: str
    features: str = ""


@dataclass(frozen=True)
class Processor:
    """A kind of processor that code is shipped for.

    Attributes
    ----------
    machine : its family, as `platform.machine` says.
    target : what the code is compiled for.
    needs : features, as LLVM names them, without which the code does not run.
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
"""By the name of the file. Every x86-64 processor since about 2015 is of the third level."""

_CALLED = {"abm": "lzcnt", "bmi1": "bmi"}
"""Names of Linux for features that LLVM calls otherwise."""


@cache
def features() -> frozenset[str]:
    """Names of what this processor can do, as LLVM names them; none where Linux does not say."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return frozenset()
    for line in text.splitlines():
        name, _, words = line.partition(":")
        if name.strip() == "flags":
            return frozenset(_CALLED.get(word, word) for word in words.split())
    return frozenset()


def fitting() -> str:
    """Name of the files that this processor runs.

    Raises
    ------
    WideberthError : there are none.
    """
    if sys.platform.startswith("linux") and sys.maxsize > 2**32:
        for name, one in PROCESSORS.items():
            if platform.machine() == one.machine and one.needs <= features():
                return name
    raise WideberthError(
        f"no shipped object code is for this processor ({sys.platform}, {platform.machine()})"
    )
