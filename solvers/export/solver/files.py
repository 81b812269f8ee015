"""The files of an exported solver."""

import json
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from .... import __version__
from ....framework.plugins.io import stamped
from ....framework.programs import SOURCES as PROGRAMS
from ... import riccati
from ..bundle import KIND, MANIFEST, VERSION
from ..readme import regions
from ..rendering import rendered
from .exported import ExportedSolver
from .header import header
from .tables import problem_header, problem_source

CORE = Path(riccati.__file__).with_name("core")
"""Folder of the core's sources."""
SOURCES = ("riccati.c", "problem.c", "wideberth_solver.c")
"""C files that every export with a solver compiles."""
_HEADERS = ("riccati.h", "state.h", "slots.h", "sweep.h", "levels.h")


def bundle(solver: ExportedSolver) -> dict[str, str]:
    """Return the files of an exported solver by name; the same solver gives the same bytes.

    Raises
    ------
    WideberthError : a stage function that no C can be made of, or an extension module that was
        not built.
    """
    loops = ("loop.c", "loop.cpp") if has_example(solver) else ()
    files = {
        "README.md": _readme(solver),
        **solver_files(solver),
        **{name: source(name) for name in loops},
        **{
            name: rendered(f"solver/{name}", sources=SOURCES, loops=loops)
            for name in ("Makefile", "CMakeLists.txt")
        },
    }
    needs = {"memory": solver.memory, "stack": solver.stack}
    return with_manifest(solver, files, needs)


def solver_files(solver: ExportedSolver) -> dict[str, str]:
    """Return the C files of a solver: the core's own, its problem, and what is around it."""
    return {
        "wideberth_solver.h": header(solver),
        "wideberth_solver.c": source("wideberth_solver.c"),
        "problem.h": problem_header(solver),
        "problem.c": problem_source(solver),
        **{name: (CORE / name).read_text(encoding="utf-8") for name in ("riccati.c", *_HEADERS)},
        "kernel.h": (PROGRAMS / "kernel.h").read_text(encoding="utf-8"),
    }


def has_example(solver: ExportedSolver) -> bool:
    """Whether the example fits: a robot in the plane, obstacles, all of it filled in C."""
    problem = solver.subject.problem
    first = problem.slots[0]
    return (
        problem.dimension == 2 and not problem.curve and first.name == "obstacle"
        and first.count > 0 and solver.filled[0]
    )  # fmt: skip


def _readme(solver: ExportedSolver) -> str:
    subject = solver.subject
    return rendered(
        "solver/README.md",
        source=subject.source,
        problem=subject.problem,
        memory=solver.memory,
        stack=solver.stack,
        iterations=solver.settings.iterations,
        cost=type(subject.cost).__name__,
        regions="\n\n".join(regions(subject)),
    )


def source(name: str) -> str:
    """Return the text of one of the C files that every exported solver has."""
    return Path(__file__).with_name("c").joinpath(name).read_text(encoding="utf-8")


def with_manifest(
    solver: ExportedSolver, files: dict[str, str], needs: Mapping[str, int] = MappingProxyType({})
) -> dict[str, str]:
    """Return files by name with their manifest: what they were made of, and what they need.

    Parameters
    ----------
    needs : bytes of memory and stack of a solve, where the manifest states them.
    """
    content = {
        "wideberth": __version__,
        "source": solver.subject.source,
        "build": solver.build,
        "key": solver.subject.problem.key,
        **needs,
        "files": [*files],
        "planner": solver.subject.config,
    }
    return {**files, MANIFEST: json.dumps(stamped(KIND, VERSION, content), indent=1) + "\n"}
