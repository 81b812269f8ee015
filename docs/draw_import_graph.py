"""Draw which groups of modules import which: ``make graph`` writes docs/figures/import-graph.png.

Modules are read by grimp, not imported; imports inside functions and below ``if TYPE_CHECKING``
count, the ``__init__`` of a package, which repeats names for users, does not. A panel shows one
level of the tree: the rooms with the packages, and the groups within a room. An arrow leads from
what imports down to what it imports. An arrow that follows from a chain of others is left out.
"""

from pathlib import Path

import grimp
import networkx as nx
from matplotlib.figure import Figure

FIGURE = Path(__file__).resolve().parent / "figures" / "import-graph.png"
BESIDE = tuple(f"wideberth_{name}" for name in "arenas embedded nav2 perception ros".split())
PANELS = ("", "framework", "framework.mpc", "simulation", "experiments")
"""Packages whose parts a panel shows; "" for the rooms."""


def modules() -> grimp.ImportGraph:
    """Return which module imports which."""
    return grimp.build_graph("wideberth", *BESIDE, cache_dir=None)


def part_of(module: str, package: str, found: grimp.ImportGraph) -> str | None:
    """Return the part of a package that a module belongs to, or None if it lies elsewhere.

    Modules directly in the package are one part, ``*.py``.
    """
    name = module.removeprefix("wideberth.").removeprefix("wideberth_")
    if name == "wideberth" or (package and not name.startswith(f"{package}.")):
        return None
    first, *inner = name.removeprefix(f"{package}.").split(".")
    return first if inner or found.find_children(module) else "*.py"


def arrows(package: str, found: grimp.ImportGraph) -> nx.DiGraph:
    """Return which parts of a package import which others; a circle of parts is one node."""
    parts = nx.DiGraph()
    for module in found.modules:
        part = part_of(module, package, found)
        if part is None or found.find_children(module):
            continue
        for target in found.find_modules_directly_imported_by(module):
            other = part_of(target, package, found)
            if other not in (part, None):
                parts.add_edge(part, other)
    circles = nx.condensation(parts)
    names = {one: ", ".join(sorted(circle)) for one, circle in circles.nodes(data="members")}
    return nx.relabel_nodes(circles, names)


def layout(parts: nx.DiGraph) -> dict[str, tuple[float, float]]:
    """Place parts in layers, each above all that it imports and near the middle of that."""
    place: dict[str, tuple[float, float]] = {}
    for row, layer in enumerate(nx.topological_generations(parts.reverse())):
        below = {one: [place[other][0] for other in parts[one]] or [0.0] for one in layer}
        order = sorted(layer, key=lambda one: (sum(below[one]) / len(below[one]), one))
        for column, one in enumerate(order):
            place[one] = (column - (len(order) - 1) / 2, row)
    return place


def draw(found: grimp.ImportGraph, file: Path) -> None:
    """Draw all panels into one picture."""
    figure = Figure(figsize=(18, 12), layout="constrained")
    panels = figure.subplot_mosaic("aaaabb;ccddee").values()
    for package, panel in zip(PANELS, panels, strict=True):
        panel.set_title(package or "rooms and packages", fontweight="bold")
        panel.axis("off")
        panel.margins(0.15)
        parts = nx.transitive_reduction(arrows(package, found))
        nx.draw_networkx(
            parts, layout(parts), ax=panel, node_color="none", node_size=700, edge_color="0.45",
            font_size=9, font_family="monospace", connectionstyle="arc3,rad=0.06",
            min_source_margin=14, min_target_margin=18,
            bbox={"boxstyle": "round", "facecolor": "0.92"},
        )  # fmt: skip
    figure.savefig(file, dpi=80)


if __name__ == "__main__":
    draw(modules(), FIGURE)
    print(FIGURE)
