"""Compile the core by Numba to object code: what the package ships, and what it falls back on.

``python -m wideberth.solvers.riccati.emit`` makes the shipped objects anew, which
takes some minutes. The object has one function, `objects.ENTRY`, and needs nothing of Numba or
Python when it runs: it takes memory from `wideberth_take`, see ``support.ll``.
"""

import atexit
import lzma
import os
import platform
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ...framework.jit import machine
from ...framework.jit.machine import host, llvm, object_code
from ...framework.jit.shipped import PROCESSORS, Target, library_name, linked
from ...framework.plugins.extras import missing
from ...framework.values.errors import WideberthError
from . import _protocol as protocol
from . import objects

_HERE = Path(__file__).parent
_SUPPORT = _HERE / "support.ll"
"""What compiled code asks of Numba's runtime."""

_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz", "arcp"},
    "nogil": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


def source(kinds: int) -> str:
    """Write the function that takes the core's arrays from their table."""
    place, groups = 0, []
    for fields in protocol.layout(kinds):
        arrays = []
        for kind, dimensions in fields:
            pointer = f"{'reals' if kind == 'f8' else 'integers'}(table[{place}])"
            shape = "".join(f"table[{place + 1 + k}], " for k in range(dimensions))
            arrays.append(f"carray({pointer}, ({shape}))")
            place += protocol.WORDS
        groups.append((type(fields).__name__, arrays))
    (_, plain), head, start, *slots, found, (_, stop) = groups
    whole = [f"{name}({', '.join(arrays)})" for name, arrays in (head, start, *slots, found)]
    kinds_of = "".join(f"{one}, " for one in whole[2:-1])
    arguments = [*plain, *whole[:2], f"({kinds_of})", whole[-1], *stop]
    return "def solve(table):\n    iterate(" + ",\n        ".join(arguments) + ")\n"


def compiled(kinds: int, target: Target) -> bytes:
    """Compile the core by Numba, for the processor that Numba is set to, which is the target.

    Raises
    ------
    WideberthError : Numba is missing or switched off, or does not compile it.
    """
    compiler()
    try:
        return object_code(_alone(*_by_numba(kinds)), target, optimise=False)
    except WideberthError:
        raise
    except Exception as error:
        raise WideberthError(
            f"Numba does not compile the solver ({type(error).__name__}: {error}); take a solver "
            "that needs no compilation, such as 'fatrop', and report this"
        ) from error


def compile_in_subprocess(kinds: int) -> bytes:
    """Return the core as object code for this processor, compiled by another process.

    Numba holds Python's lock while it compiles and keeps some 300 MB: so this process neither
    waits nor grows. The other one ends with this one.

    Raises
    ------
    WideberthError : Numba is missing or switched off, or the other process fails.
    """
    compiler()
    command = [sys.executable or "python", "-m", __name__, _HOST, str(kinds)]
    try:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    except OSError as error:
        raise WideberthError(
            f"no process can be started to compile the solver: {error}"
        ) from error
    atexit.register(process.kill)
    code, said = process.communicate()
    atexit.unregister(process.kill)
    if process.returncode:
        last = said.decode(errors="replace").strip().splitlines()[-1:]
        why = "".join(last) or f"it ended with code {process.returncode}"
        raise WideberthError(f"the solver is not compiled: {why}")
    return code


_HOST = "host"
"""This processor, where the name of a shipped object may stand as well."""


def compiler() -> str:
    """Names and versions of what compiles.

    Raises
    ------
    WideberthError : Numba is missing or switched off.
    """
    try:
        import numba
        from numba.core import config
    except ImportError as error:
        instead = "or take a solver that needs no compilation, such as 'fatrop'"
        raise missing("fast", "the solver needs Numba here", error, instead) from error
    if getattr(config, "DISABLE_JIT", 0):
        raise WideberthError(
            "NUMBA_DISABLE_JIT is set, so nothing is compiled; unset it, or take a solver that "
            "needs no compilation, such as 'fatrop'"
        )
    return f"Numba {numba.__version__}, {machine.compiler()}"


def _by_numba(kinds: int) -> tuple[str, str]:
    """LLVM module of the core and all that it calls, optimised; name of the core in it."""
    import numba

    from . import _core

    tool: Any = numba
    integers, reals = _pointers()
    names = {
        **vars(protocol), "carray": tool.carray, "iterate": _core.solve, "integers": integers,
        "reals": reals,
    }  # fmt: skip
    exec(source(kinds), names)
    made: Any = tool.njit("void(CPointer(int64))", **_OPTIONS)(names["solve"])
    (found,) = made.overloads.values()
    return found.library.get_llvm_str(), found.fndesc.llvm_func_name


def _pointers() -> tuple[Any, Any]:
    """Numba functions that make a pointer of an address, to integers and to numbers."""
    from numba.core import types as numba_types
    from numba.extending import intrinsic

    types: Any = numba_types

    def to(kind: Any) -> Any:
        @intrinsic
        def pointer(typing: Any, address: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
                return builder.inttoptr(given[0], context.get_value_type(signature.return_type))

            return types.CPointer(kind)(types.int64), generate

        return pointer

    return to(types.int64), to(types.float64)


def _alone(text: str, name: str) -> str:
    """Cut a module down to one function, `objects.ENTRY`, that needs no other part of Numba."""
    tool = llvm()
    text = re.sub(rf"@{name}\b", f"@{objects.ENTRY}", text)
    text = re.sub(r"(\[\d+ x i8\]) c\"[^\"]*\"", r"\1 zeroinitializer", text)
    text = re.sub(r"(define [^@]*)@(NRT_incref|NRT_decref)\(", r"\1@\2.unused(", text)
    text += "\ndeclare void @NRT_incref(ptr)\ndeclare void @NRT_decref(ptr)\n"
    module = tool.parse_assembly(text)
    module.link_in(tool.parse_assembly(_SUPPORT.read_text(encoding="utf-8")))
    defined = [*module.functions, *module.global_variables]
    for one in defined:
        if not one.is_declaration and one.name != objects.ENTRY:
            one.linkage = "internal"
    manager = tool.create_new_module_pass_manager()
    manager.add_global_dead_code_eliminate_pass()
    machine = tool.Target.from_triple(module.triple).create_target_machine()
    options = tool.create_pipeline_tuning_options()
    manager.run(module, tool.create_pass_builder(machine, options))
    kept = [*module.functions, *module.global_variables]
    for place, one in enumerate(kept):  # Numba's names change from process to process
        if not one.is_declaration and one.name != objects.ENTRY:
            one.name = f"part{place}"
    module.name = "core"
    # pickled texts are as long as the paths of the files on this machine
    text = re.sub(r"constant \[\d+ x i8\] zero", "constant [1 x i8] zero", str(module))
    return re.sub(r"({ ptr @part\d+, i32) \d+,", r"\1 0,", text)


def emitted(name: str) -> bytes:
    """Compile a shipped object, in a process of its own: Numba compiles for one processor.

    For processors of another family, Numba compiles for the oldest of this one, whose vectors are
    as long as theirs, and LLVM translates that.

    Raises
    ------
    WideberthError : this is no x86-64 Linux, or the other process fails.
    """
    if not (sys.platform.startswith("linux") and platform.machine() == "x86_64"):
        raise WideberthError("the shipped objects are made on x86-64 Linux")
    one = PROCESSORS[name]
    model = one.target.cpu if one.machine == "x86_64" else "x86-64"
    settings = {"NUMBA_CPU_NAME": model, "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}
    ran = subprocess.run(
        [sys.executable, "-m", f"{__package__}.emit", name, str(objects.KINDS)],
        env={**os.environ, **settings}, capture_output=True, check=False,
    )  # fmt: skip
    if ran.returncode:
        raise WideberthError(f"{name} is not compiled: {ran.stderr.decode()}")
    return ran.stdout


def _main() -> None:
    """Make every shipped object, and say what they were made from."""
    with ThreadPoolExecutor() as pool:
        codes = list(pool.map(emitted, PROCESSORS))
    files: dict[str, bytes] = {}
    for name, code in zip(PROCESSORS, codes, strict=True):
        files[objects.object_name(name)] = lzma.compress(code, preset=9)
        files[library_name(name)] = library(name, code)
    objects.SHIPPED.write(files, compiler())


def library(name: str, code: bytes) -> bytes:
    """Link the object for one of `shipped.PROCESSORS` with what it needs in a library.

    Raises
    ------
    WideberthError : the linker is missing.
    """
    beside = [
        (_HERE / file).read_text(encoding="utf-8") for file in ("memory.ll", "row_of_calls.ll")
    ]
    target = PROCESSORS[name].target
    return linked([code, *(object_code(text, target) for text in beside)])


def _write_compiled(name: str, kinds: str) -> None:
    """Write the code of one processor to the standard output; `emitted` asks for it."""
    target = host() if name == _HOST else PROCESSORS[name].target
    sys.stdout.buffer.write(compiled(int(kinds), target))


if __name__ == "__main__":
    if len(sys.argv) == 1:
        _main()
    else:
        _write_compiled(*sys.argv[1:])
