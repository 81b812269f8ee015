"""The files of an exported solver."""

import json
from importlib.resources import files as resources

from .... import __version__
from ....framework.plugins.io import stamped
from ..bundle import KIND, MANIFEST, VERSION
from ..readme import regions, wrapped
from ..rendering import rendered
from .header import header
from .needs import ExportedSolver, memory, stack
from .tables import tables

ARCHIVE = "libwideberth.a"


def bundle(solver: ExportedSolver) -> dict[str, str | bytes]:
    """Return the files of an exported solver by name; the same solver gives the same bytes.

    Raises
    ------
    WideberthError : a kernel that cannot be compiled, or more kinds of slots than the core has.
    """
    shown = has_example(solver)
    found: dict[str, str | bytes] = {
        "README.md": _readme(solver),
        "wideberth_solver.h": header(solver),
        "wideberth_solver.c": source("wideberth_solver.c"),
        "wideberth_tables.h": tables(solver),
        ARCHIVE: solver.native.archive(),
        "Makefile": rendered(
            "solver/Makefile", loops="loop loop_cpp" if shown else "wideberth_solver.o"
        ),
    }
    if shown:
        found |= {name: source(name) for name in ("loop.c", "loop.cpp")}
    needs = {"memory": memory(solver), "stack": stack(solver)}
    return {**found, MANIFEST: manifest(solver, [*found], needs)}


def has_example(solver: ExportedSolver) -> bool:
    """Whether the example fits: a robot in the plane, obstacles, all of it filled in C."""
    problem, native = solver.native.subject.problem, solver.native
    first = problem.slots[0]
    return (
        problem.dimension == 2 and not problem.curve and first.name == "obstacle"
        and first.count > 0 and native.filled[0]
    )  # fmt: skip


def _readme(solver: ExportedSolver) -> str:
    native = solver.native
    return wrapped(
        "solver/README.md",
        source=native.subject.source,
        problem=native.subject.problem,
        machine=native.machine.name,
        memory=memory(solver),
        stack=stack(solver),
        called=", ".join(f"`{name}`" for name in native.called),
        iterations=solver.settings.iterations,
        cost=type(native.subject.cost).__name__,
        regions="\n\n".join(regions(native.subject)),
    )


def source(name: str) -> str:
    """Return the text of one of the C files that every exported solver has."""
    return resources(__name__.rpartition(".")[0]).joinpath("c", name).read_text(encoding="utf-8")


def manifest(solver: ExportedSolver, files: list[str], needs: dict[str, int]) -> str:
    """Return the manifest of a folder: of what it was made, what it needs, and its files."""
    native = solver.native
    content = {
        "wideberth": __version__,
        "source": native.subject.source,
        "target": native.machine.name,
        "build": native.build,
        "key": native.subject.problem.key,
        **needs,
        "files": files,
        "planner": native.subject.config,
    }
    return json.dumps(stamped(KIND, VERSION, content), indent=1) + "\n"
