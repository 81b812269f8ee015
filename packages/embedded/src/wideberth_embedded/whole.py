"""From a planner to all that is written of it."""

from dataclasses import replace

from wideberth.experiments.cli.export import exported_solver, slots_for
from wideberth.framework.mpc.planner.planner import Planner

from .files import bundle
from .kernels import kernels
from .supported import CORNERS, refuse
from .tables import NAV2, ExportedPlanner


def planner_in_c(
    planner: Planner, source: str, corners: int, package: str | None, path: str
) -> dict[str, str]:
    """Return the files of a planner by name, see `whole_planner`."""
    whole = whole_planner(planner, source, corners, NAV2 if package is None else package, path)
    return bundle(whole)


def whole_planner(
    planner: Planner,
    source: str,
    corners: int = CORNERS,
    package: str = NAV2,
    path: str = "planner",
) -> ExportedPlanner:
    """Gather what is written of a planner with all that is around its solver.

    Parameters
    ----------
    planner, source : what is exported, and its title.
    corners, package : as in `export`.
    path : dotted path of the planner in its config, for messages.

    Raises
    ------
    WideberthError : the planner in C lacks what this one needs, or no package has such a name.
    """
    robot = refuse(planner, corners, path)
    most = slots_for("most_obstacles", max(planner.most_obstacles, 1))
    still = 0 if planner.static_region is None else most
    solver = exported_solver(planner, (most, still, corners), source)
    solver = replace(solver, further=kernels(robot, solver))
    return ExportedPlanner(planner, solver, package)
