"""Kernels that are ready to be called: compiled, or programs where llvmlite is not installed."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from . import interpreter, machine
from .store import load


@dataclass(frozen=True, eq=False)
class Records:
    """Records of kernels, see `columns`; the code needs them as long as it is called.

    Attributes
    ----------
    records : by name.
    """

    records: Mapping[str, NDArray[np.int64]]

    @classmethod
    def of(
        cls,
        stem: str,
        functions: Mapping[str, Any],
        source: Callable[[], str],
        carried: Mapping[str, int],
        announce: Callable[[str], None] | None = None,
        usual: float | None = None,
    ) -> Self:
        """Compile functions of CasADi, or write programs of them where there is no compiler.

        Parameters
        ----------
        functions : by name, see `transpile.kernel_source`.
        source : writes the LLVM module of them.
        carried : of those that hand numbers on, how many, see `transpile.recursion_source`.
        stem, announce, usual : see `store.load`.

        Raises
        ------
        WideberthError : they have another form, or neither way is open here.
        """
        if machine.missing() is not None:
            programs = {
                name: interpreter.program(one, carried.get(name))
                for name, one in functions.items()
            }
            return cls(programs)
        places = load(stem, source(), list(functions), announce, usual)
        return cls({name: np.array([place]) for name, place in places.items()})

    def place(self, name: str) -> int:
        """Where the record of a kernel stands."""
        return int(self.records[name].__array_interface__["data"][0])

    def code(self, name: str) -> int:
        """Address of the code of a kernel."""
        return int(self.records[name][0])
