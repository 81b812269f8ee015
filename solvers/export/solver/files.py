"""The files of an exported solver."""

import json
from importlib.resources import files as resources

from .... import __version__
from ....framework.plugins.io import stamped
from ..bundle import KIND, MANIFEST, VERSION
from .header import header
from .needs import ExportedSolver, memory, stack
from .readme import readme
from .tables import tables

ARCHIVE = "libwideberth.a"
_MAKEFILE = """\
CC ?= cc
CXX ?= c++
CFLAGS ?= -O2 -Wall -Wextra
CXXFLAGS ?= $(CFLAGS)

loops: {loops}

loop: loop.c wideberth_solver.o
	$(CC) $(CFLAGS) -o $@ loop.c wideberth_solver.o libwideberth.a -lm

loop_cpp: loop.cpp wideberth_solver.o
	$(CXX) $(CXXFLAGS) -o $@ loop.cpp wideberth_solver.o libwideberth.a -lm

wideberth_solver.o: wideberth_solver.c wideberth_solver.h wideberth_tables.h
	$(CC) $(CFLAGS) -c wideberth_solver.c

clean:
	rm -f loop loop_cpp *.o

.PHONY: loops clean
"""


def bundle(solver: ExportedSolver) -> dict[str, str | bytes]:
    """Return the files of an exported solver by name; the same solver gives the same bytes.

    Raises
    ------
    WideberthError : a kernel that cannot be compiled, or more kinds of slots than the core has.
    """
    shown = has_example(solver)
    found: dict[str, str | bytes] = {
        "README.md": readme(solver),
        "wideberth_solver.h": header(solver),
        "wideberth_solver.c": _source("wideberth_solver.c"),
        "wideberth_tables.h": tables(solver),
        ARCHIVE: solver.native.archive(),
        "Makefile": _MAKEFILE.format(loops="loop loop_cpp" if shown else "wideberth_solver.o"),
    }
    if shown:
        found |= {name: _source(name) for name in ("loop.c", "loop.cpp")}
    return {**found, MANIFEST: _manifest(solver, [*found])}


def has_example(solver: ExportedSolver) -> bool:
    """Whether the example fits: a robot in the plane, obstacles, all of it filled in C."""
    problem, native = solver.native.subject.problem, solver.native
    first = problem.slots[0]
    return (
        problem.dimension == 2 and not problem.curve and first.name == "obstacle"
        and first.count > 0 and native.filled[0]
    )  # fmt: skip


def _source(name: str) -> str:
    return resources(__name__.rpartition(".")[0]).joinpath("c", name).read_text(encoding="utf-8")


def _manifest(solver: ExportedSolver, files: list[str]) -> str:
    native = solver.native
    content = {
        "wideberth": __version__,
        "source": native.subject.source,
        "target": native.machine.name,
        "build": native.build,
        "key": native.subject.problem.key,
        "memory": memory(solver),
        "stack": stack(solver),
        "files": files,
        "planner": native.subject.config,
    }
    return json.dumps(stamped(KIND, VERSION, content), indent=1) + "\n"
