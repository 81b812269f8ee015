"""Machine code by LLVM alone: compiled to object files, which are loaded into this process.

An object file holds what it defines and asks for functions of the C library alone, which are
handed to it by name, see `_LIBRARY`. So nothing is looked up in other parts of the process, and
a name that is missing is an error and no crash.
"""

import atexit
import ctypes
import ctypes.util
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from itertools import count
from threading import RLock
from types import MappingProxyType
from typing import Any

from ..plugins.extras import missing as extra_missing
from ..values.errors import WideberthError
from .shipped import Target

_LIBRARY = (
    *("acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "cbrt", "ceil", "copysign"),
    *("cos", "cosh", "erf", "exp", "exp10", "exp2", "expm1", "fabs", "floor", "fmax", "fmin"),
    *("fmod", "hypot", "ldexp", "log", "log10", "log1p", "log2", "pow", "rint", "round", "sin"),
    *("sincos", "sinh", "sqrt", "tan", "tanh", "trunc"),
    *("free", "malloc", "memcpy", "memmove", "memset"),
)
"""Functions of the C library that code may call: those of `operations`, what LLVM makes of them,
and memory."""
MEMORY = {"wideberth_take": "malloc", "wideberth_give": "free"}
"""Names by which code asks for memory: the C library gives it here, else who embeds the code."""

_GUARD = RLock()
"""Held by who compiles or loads. A process that ends takes it and keeps it: what LLVM needs goes
then, and a thread that still compiled would crash."""
atexit.register(_GUARD.acquire)
_HELD: list[Any] = []
"""Loaded code; it stays as long as the process, since functions of it are known by address."""


@cache
def missing() -> str | None:
    """Say why nothing can be compiled here; None where it can."""
    try:
        llvm()
    except Exception as error:  # a broken installation may raise anything
        return str(error)
    return None


def compiler() -> str:
    """Name and version of what compiles."""
    return f"llvmlite {version('llvmlite')}"


@cache
def llvm() -> Any:
    """Return LLVM, ready to compile for this processor.

    Raises
    ------
    WideberthError : llvmlite is not installed.
    """
    try:
        import llvmlite.binding
    except Exception as error:  # a broken installation may raise anything
        raise extra_missing("fast", "what is compiled needs llvmlite", error) from error
    found = llvmlite.binding
    found.initialize_native_target()
    found.initialize_native_asmprinter()
    return found


@cache
def host() -> Target:
    """Return this processor."""
    features = llvm().get_host_cpu_features().flatten()
    return Target(llvm().get_process_triple(), llvm().get_host_cpu_name(), features)


def host_features() -> frozenset[str]:
    """Names of what this processor can do, of LLVM."""
    return frozenset(name for name, has in llvm().get_host_cpu_features().items() if has)


def object_code(text: str, target: Target, optimise: bool = True, straight: bool = False) -> bytes:
    """Compile an LLVM module to an object file.

    Parameters
    ----------
    text, target : the module, and what it is compiled for.
    optimise : whether to, which takes most of the time.
    straight : whether vectors are looked for in straight-line code, too.

    Raises
    ------
    WideberthError : llvmlite cannot be imported, or LLVM refuses the text.
    """
    with _GUARD:
        return _compiled(text, target, optimise, straight)


def _compiled(text: str, target: Target, optimise: bool, straight: bool) -> bytes:
    tool = llvm()
    if target != host():
        tool.initialize_all_targets()
        tool.initialize_all_asmprinters()
    try:
        module = tool.parse_assembly(text)
        module.triple = target.triple
        machine = tool.Target.from_triple(target.triple).create_target_machine(
            cpu=target.cpu, features=target.features, opt=3, reloc="pic", codemodel="default"
        )
        module.data_layout = str(machine.target_data)
        module.verify()
    except RuntimeError as error:
        raise WideberthError(
            f"LLVM refuses generated code ({error}); take a solver that needs no compilation, "
            "such as 'fatrop', and report this"
        ) from error
    if optimise:
        _optimise(module, machine, straight)
    return bytes(machine.emit_object(module))


def _optimise(module: Any, machine: Any, straight: bool) -> None:
    """Optimise each function, then all of them together, as Numba does."""
    options = llvm().create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization, options.slp_vectorization = True, straight
    for function in module.functions:
        if not function.is_declaration:
            builder = llvm().create_pass_builder(machine, options)
            builder.getFunctionPassManager().run(function, builder)
    builder = llvm().create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)


def loaded(
    code: bytes, names: Sequence[str], instead: Mapping[str, int] = MappingProxyType({})
) -> Mapping[str, int]:
    """Load an object file into this process and return the addresses of functions.

    Parameters
    ----------
    code : the file.
    names : of the functions.
    instead : addresses of functions that it is given for those of the C library.

    Raises
    ------
    WideberthError : this is no object file for this processor, or it lacks a function.
    """
    with _GUARD:
        try:
            library = llvm().JITLibraryBuilder().add_object_img(code)
            for name, address in {**_of_the_system(), **instead}.items():
                library.import_symbol(name, address)
            for name in names:
                library.export_symbol(name)
            tracker = library.link(_linker(), f"wideberth{next(_NUMBERS)}")
        except RuntimeError as error:
            raise WideberthError(f"this object file does not load ({error})") from error
        _HELD.append(tracker)
    return {name: int(tracker[name]) for name in names}


_NUMBERS = count()


@cache
def _linker() -> Any:
    # JITLink keeps the sections of an object together. LLVM's older loader may put them more than
    # 2 GiB apart in a process that has used much memory, and then ends the process.
    return llvm().create_lljit_compiler(use_jit_link=True, suppress_errors=True)


@cache
def _of_the_system() -> Mapping[str, int]:
    """Addresses of those functions of the C library that this system has."""
    found = _addresses(ctypes.CDLL(None) if sys.platform != "win32" else ctypes.cdll.msvcrt)
    if len(found) < len(_LIBRARY):  # Python does not link the mathematical part itself
        with suppress(OSError):  # the search needs a folder for temporary files
            if where := ctypes.util.find_library("m"):
                found = {**_addresses(ctypes.CDLL(where)), **found}
    return {**found, **{name: found[own] for name, own in MEMORY.items() if own in found}}


def _addresses(library: ctypes.CDLL) -> dict[str, int]:
    """Addresses of those functions of `_LIBRARY` that a library has."""
    names = (name for name in _LIBRARY if hasattr(library, name))
    return {
        name: ctypes.cast(getattr(library, name), ctypes.c_void_p).value or 0 for name in names
    }
