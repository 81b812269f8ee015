"""One problem's solver as machine code: the shipped core, and the problem's kernels beside it."""

import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Any

from .... import __version__
from ....framework.jit.machine import MEMORY, host, host_features, object_code
from ....framework.jit.operations import exactly
from ....framework.jit.shipped import PROCESSORS, Target, fitting
from ....framework.jit.transpile import kernel_source, module_source
from ....framework.mpc.slots.base import GaussianKind
from ....framework.numerics.symbolic import ca
from ....framework.plugins.registry import unknown
from ....framework.values.errors import WideberthError
from ...riccati import objects
from ...riccati.compiled import KernelSet, sources
from ...riccati.kernels import carried
from ..object_files import archive, wanted
from ..subject import Subject

NATIVE = "native"
"""This processor, with all that it can do: its code gives the numbers of Python, bit for bit."""
PREFIX = "wideberth_kernel_"
"""Of the names of all kernels in the archive."""
_ASKED = ("avx", "avx2", "bmi", "bmi2", "fma", "popcnt", "avx512f", "avx512bw", "avx512cd",
          "avx512dq", "avx512vl")  # fmt: skip
"""Features of x86-64 that every C compiler can ask the processor for, by its and LLVM's name."""


@dataclass(frozen=True)
class Machine:
    """What code is made for.

    Attributes
    ----------
    name : as ``--target`` takes it.
    core : name of the shipped object.
    target : what kernels are compiled for.
    needs : features that the code asks the processor for before it runs.
    """

    name: str
    core: str
    target: Target
    needs: tuple[str, ...]

    @property
    def family(self) -> str:
        """Name of the processors, as C compilers define it between underscores."""
        return PROCESSORS[self.core].machine


def targets() -> tuple[str, ...]:
    """Names that ``--target`` takes."""
    return (NATIVE, *PROCESSORS)


def machine(name: str) -> Machine:
    """Return a target by its name.

    Raises
    ------
    WideberthError : an unknown name, or ``native`` where no shipped object fits.
    """
    if name == NATIVE:
        try:
            core = fitting()
        except WideberthError as error:
            raise WideberthError(
                f"there is no object code for this machine ({sys.platform}, "
                f"{platform.machine()}): {error}; give --target, one of "
                f"{', '.join(PROCESSORS)}"
            ) from None
        return Machine(name, core, host(), _asked(host_features()))
    if name not in PROCESSORS:
        raise WideberthError(unknown("target", name, targets()))
    one = PROCESSORS[name]
    return Machine(name, name, one.target, _asked(one.needs))


def _asked(features: frozenset[str]) -> tuple[str, ...]:
    return tuple(one for one in _ASKED if one in features)


@dataclass(frozen=True, eq=False)
class Native:
    """The code of one problem.

    Attributes
    ----------
    subject : the problem and what its numbers are called.
    machine : what the code is for.
    margin : m, added around the robot's bodies.
    exact : further functions (v, p) of one column, by name, with CasADi's own rounding.
    """

    subject: Subject
    machine: Machine
    margin: float
    exact: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def kernels(self) -> KernelSet:
        """The kernels that the core calls."""
        found = KernelSet.of(self.subject.problem)
        if len(found.kinds) != objects.KINDS:
            raise WideberthError(
                f"this problem has {len(found.kinds)} kinds of slots; object code is shipped for "
                f"up to {objects.KINDS}"
            )
        return found

    @cached_property
    def around(self) -> Mapping[str, Any]:
        """What is called beside the core: functions (v, p) of one column, by name."""
        return around(self.subject, self.margin)

    @property
    def filled(self) -> tuple[bool, ...]:
        """Of which kinds the code computes the parameters of a slot."""
        return tuple(f"set{k}" in self.around for k in range(len(self.subject.problem.slots)))

    @cached_property
    def source(self) -> str:
        """LLVM module of all kernels."""
        inner = sources(self.kernels.functions, carried(self.subject.problem.states), PREFIX)
        outer = [kernel_source(one, PREFIX + name) for name, one in self.around.items()]
        exact = [exactly(kernel_source(one, PREFIX + name)) for name, one in self.exact.items()]
        return module_source([*inner, *outer, *exact])

    @cached_property
    def core(self) -> bytes:
        """The core; it asks `wideberth_solver.c` for memory, see `MEMORY`."""
        return objects.code_for(self.machine.core)

    @cached_property
    def build(self) -> int:
        """Number of 64 bits that header and archive have in common, and no other export has."""
        parts = (__version__, self.machine, self.source, self.subject.problem.key, self.margin)
        return int.from_bytes(sha256(repr(parts).encode() + self.core).digest()[:8], "big")

    @cached_property
    def members(self) -> Mapping[str, bytes]:
        """The object files.

        Raises
        ------
        WideberthError : LLVM refuses a kernel.
        """
        named = f"@wideberth_archive_build = constant i64 {_signed(self.build)}\n"
        code = object_code(named + self.source, self.machine.target)
        return {"core.o": self.core, "kernels.o": code}

    @property
    def called(self) -> tuple[str, ...]:
        """Functions of the C library that the code calls."""
        names = {name for code in self.members.values() for name in wanted(code)}
        return tuple(sorted(names - {*MEMORY}))

    def archive(self) -> bytes:
        """Return the static library."""
        return archive(self.members)


def _signed(number: int) -> int:
    return number - 2**64 if number >= 2**63 else number


def around(subject: Subject, margin: float) -> dict[str, Any]:
    """Return what code around the solver needs, each a function (v, p) of one column.

    ``step`` (x, u) -> next x; ``place`` x -> position; ``motion`` (x, u, next x) -> gaps of the
    dynamics, then limits >= 0; ``final`` x_N -> limits >= 0; for kind k of the slots ``rowsk``
    (x, s, a), numbers -> inequalities, equalities, and, where a closed form is known, ``setk``
    (mean, covariance, radius) -> parameters. What has no result is left out.
    """
    problem, robot = subject.problem, subject.robot
    x, u, after = (
        ca.SX.sym("x", problem.states), ca.SX.sym("u", problem.inputs),
        ca.SX.sym("after", problem.states),
    )  # fmt: skip
    none = ca.SX.sym("p", 0)
    follows = problem.dynamics(x, u)
    limits = ca.vertcat(problem.input_constraints(x, u), problem.state_constraints(after))
    place = robot.pose(tuple(ca.vertsplit(x))).position
    found = {
        "step": ((ca.vertcat(x, u), none), follows),
        "place": ((x, none), ca.vertcat(*place)),
        "motion": ((ca.vertcat(x, u, after), none), ca.vertcat(after - follows, limits)),
        "final": ((x, none), problem.terminal_constraints(x)),
    }
    for k, (kind, slots) in enumerate(zip(subject.kinds, problem.slots, strict=True)):
        if not slots.count:
            continue
        s, a = ca.SX.sym("s", int(problem.shared)), ca.SX.sym("a", len(slots.auxiliary))
        numbers = ca.SX.sym("numbers", slots.size)
        rows = ca.vertcat(*slots.constraint(x, a, s, numbers))
        found[f"rows{k}"] = (ca.vertcat(x, s, a), numbers), rows
        if (one := _filled(subject, kind, margin)) is not None:
            found[f"set{k}"] = (one[0], none), one[1]
    return {
        name: ca.Function(name, [ca.vec(one) for one in given], [ca.densify(out)], {"cse": True})
        for name, (given, out) in found.items()
        if out.numel()
    }


def _filled(subject: Subject, kind: Any, margin: float) -> tuple[Any, Any] | None:
    """Parameters of a slot as an expression of (mean, covariance, radius), or None."""
    if not isinstance(kind, GaussianKind):
        return None
    try:
        function = kind.parameters_of_one(subject.robot, margin)
    except WideberthError:  # the caller fills them
        return None
    given = [ca.SX.sym(f"g{i}", *function.size_in(i)) for i in range(function.n_in())]
    return ca.vertcat(*map(ca.vec, given)), function(*given)
