"""Solve random problems by a core that checks its memory: a program, see test_riccati_memory.py.

Arguments: the extension module, which takes the place of the one that is installed.
"""

import sys
from importlib import import_module
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

NAME = "wideberth.solvers.riccati._core"


def replace_core(path: Path) -> None:
    """Import the module of a file as the solver's core."""
    spec = spec_from_loader(NAME, ExtensionFileLoader(NAME, str(path)))
    assert spec is not None and spec.loader is not None
    sys.modules[NAME] = module = module_from_spec(spec)
    spec.loader.exec_module(module)


def main() -> None:
    """Solve, cold and warm, plain and one start against another."""
    replace_core(Path(sys.argv[1]))
    import wideberth.solvers.riccati as package
    from wideberth.tests.helpers.random_problems import Draw, draws

    package._core = sys.modules[NAME]
    from wideberth.framework.values.plan import Status
    from wideberth.solvers.riccati.solver import Riccati

    assert vars(import_module("wideberth.solvers.riccati.problem"))["_core"] is sys.modules[NAME]
    count = 0
    for draw in draws():
        assert isinstance(draw, Draw)
        stage, parameters, guess = draw.make()
        solver = Riccati(iterations=draw.iterations)
        first = solver.solve(stage, parameters, [guess])
        again = solver.solve(stage, parameters, [first[0].point])
        solver.solve_cheapest(stage, parameters, [guess], first, 0.3)
        assert not first[0].stand_in and not again[0].stand_in
        count += first[0].status is Status.SOLVED
    print(count)


if __name__ == "__main__":
    main()
