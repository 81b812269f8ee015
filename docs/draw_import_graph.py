"""Draw which groups of modules import which: ``make graph`` writes docs/figures/import-graph.png.

The script parses the files and imports none of them. Imports inside functions and below ``if
TYPE_CHECKING`` count; the ``__init__`` of a package, which repeats names for users, does not. A
panel shows one level of the tree: the rooms with the packages, and the groups within a room. An
arrow leads from what imports down to what it imports. An arrow that follows from a chain of
others is left out.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FIGURE = ROOT / "docs" / "figures" / "import-graph.png"
ROOMS = (
    "framework", "draw", "people", "metrics", "predictors", "regions", "robots", "routes",
    "solvers", "controllers", "simulation", "experiments",
)  # fmt: skip
PANELS = ("", "framework", "framework/mpc", "simulation", "experiments")
"""Folders whose parts a panel shows; "" for the rooms."""
SWEEPS = 24  # of the ordering of nodes within the layers
GAP = 0.35  # inches between two boxes of a layer
LAYER = 0.75  # inches from one layer to the next
LETTER = 0.085  # inches, width of a letter

Edges = dict[str, set[str]]
"""What imports, to what it imports."""


def modules(root: Path = ROOT) -> dict[str, Path]:
    """Return every module of the rooms and packages, named by its path without the suffix."""
    places = [(root, root / room) for room in ROOMS]
    places += [(place.parent, place) for place in sorted(root.glob("packages/*/src/wideberth_*"))]
    return {
        str(file.relative_to(base).with_suffix("")): file
        for base, place in places
        for file in sorted(place.rglob("*.py"))
    }


def imported(name: str, known: dict[str, Path]) -> Iterator[str]:
    """Yield the modules among the known ones that a module imports."""
    folder = Path(name).parent.parts
    for node in ast.walk(ast.parse(known[name].read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom):
            continue
        above = folder[: len(folder) + 1 - node.level] if node.level else ()
        base = [*above, *(node.module or "").removeprefix("wideberth.").split(".")]
        source = "/".join(part for part in base if part)
        for alias in node.names:
            for candidate in (f"{source}/{alias.name}", source, f"{source}/__init__"):
                if candidate in known:
                    yield candidate
                    break


def module_imports(root: Path = ROOT) -> Edges:
    """Return what each module imports; those named ``__init__`` import nothing here."""
    known = modules(root)
    return {
        name: set() if Path(name).name == "__init__" else set(imported(name, known))
        for name in known
    }


def part_of(name: str, folder: str) -> str | None:
    """Return the part of a folder that a module belongs to, or None if it lies elsewhere.

    Files directly in the folder are one part, ``*.py``.
    """
    parents, parts = Path(folder).parts if folder else (), Path(name).parts
    if parts[: len(parents)] != parents:
        return None
    return parts[len(parents)] if len(parts) > len(parents) + 1 else "*.py"


def arrows(folder: str, imports: Edges) -> Edges:
    """Return which parts of a folder import which others."""
    found: Edges = {}
    for name, targets in imports.items():
        part = part_of(name, folder)
        if part is None or Path(name).name == "__init__":
            continue
        others = {part_of(target, folder) for target in targets} - {part, None}
        found.setdefault(part, set()).update(str(other) for other in others)
    for target in {target for targets in found.values() for target in targets}:
        found.setdefault(target, set())
    used = {target for targets in found.values() for target in targets}
    return {part: targets for part, targets in found.items() if targets or part in used}


def reached(start: str, edges: Edges) -> set[str]:
    """Return all parts that a part imports, directly or through others."""
    seen: set[str] = set()
    waiting = [start]
    while waiting:
        for target in edges[waiting.pop()] - seen:
            seen.add(target)
            waiting.append(target)
    return seen


def circles(edges: Edges) -> list[str]:
    """Return the parts that import themselves through others."""
    return sorted(part for part in edges if part in reached(part, edges))


def one_way(edges: Edges) -> tuple[Edges, list[tuple[str, str]]]:
    """Return the arrows without those that close a circle, and these."""
    kept: Edges = {part: set() for part in edges}
    closing = []
    for part in sorted(edges, key=lambda name: (-len(edges[name]), name)):
        for target in sorted(edges[part]):
            if part in reached(target, kept):
                closing.append((part, target))
            else:
                kept[part].add(target)
    return kept, closing


def reduced(edges: Edges) -> Edges:
    """Leave out each arrow that follows from a chain of others."""
    return {
        part: {
            target
            for target in targets
            if not any(target in reached(other, edges) for other in targets - {target})
        }
        for part, targets in edges.items()
    }


def heights(edges: Edges) -> dict[str, int]:
    """Return the layer of each part: one above the highest that it imports."""
    found: dict[str, int] = {}

    def height(part: str) -> int:
        if part not in found:
            found[part] = max((height(target) + 1 for target in edges[part]), default=0)
        return found[part]

    for part in edges:
        height(part)
    return found


@dataclass(frozen=True)
class Drawing:
    """A layered drawing of arrows.

    Attributes
    ----------
    place : part or bend -> (x, y) of its centre, inches.
    width : part -> inches.
    lines : each arrow as the parts and bends that it runs through, from the top.
    """

    place: dict[str, tuple[float, float]]
    width: dict[str, float]
    lines: list[list[str]]


def layout(edges: Edges) -> Drawing:
    """Place parts in layers so that all arrows lead down and few of them cross.

    An arrow over several layers has a bend in each layer that it passes. Each sweep orders every
    layer by the mean place of its neighbours in the layer above or below; the order with the
    fewest crossings is kept.
    """
    height = heights(edges)
    lines = []
    layers: list[list[str]] = [[] for _ in range(max(height.values()) + 1)]
    for part in sorted(edges, key=lambda name: (-len(edges[name]), name)):
        layers[height[part]].append(part)
    for part, targets in edges.items():
        for target in sorted(targets):
            levels = range(height[part] - 1, height[target], -1)
            bends = [f"{part}>{target}@{level}" for level in levels]
            for level, bend in zip(levels, bends, strict=True):
                layers[level].append(bend)
            lines.append([part, *bends, target])
    links = [link for line in lines for link in pairwise(line)]
    best = min(orders(layers, links), key=lambda order: crossings(order, links))
    width = {part: LETTER * len(part) + 0.25 for part in edges}
    return Drawing(placed(best, links, width), width, lines)


def orders(layers: list[list[str]], links: list[tuple[str, str]]) -> Iterator[list[list[str]]]:
    """Yield orders of the layers, each by the neighbours in the one before."""
    neighbours: dict[str, list[str]] = {}
    for above, below in links:
        neighbours.setdefault(above, []).append(below)
        neighbours.setdefault(below, []).append(above)
    order = [list(layer) for layer in layers]
    yield order
    for sweep in range(SWEEPS):
        order = [list(layer) for layer in order]
        levels = range(1, len(order)) if sweep % 2 else range(len(order) - 2, -1, -1)
        for level in levels:
            other = order[level - 1 if sweep % 2 else level + 1]
            where = {name: (i + 0.5) / len(other) for i, name in enumerate(other)}
            own = {name: (i + 0.5) / len(order[level]) for i, name in enumerate(order[level])}

            def middle(name: str, where: dict = where, own: dict = own) -> float:
                near = [where[one] for one in neighbours.get(name, []) if one in where]
                return sum(near) / len(near) if near else own[name]

            order[level].sort(key=middle)
        yield order


def crossings(order: list[list[str]], links: list[tuple[str, str]]) -> int:
    """Count the pairs of arrows that cross."""
    level = {name: i for i, layer in enumerate(order) for name in layer}
    rank = {name: i for layer in order for i, name in enumerate(layer)}
    count = 0
    for i, (above, below) in enumerate(links):
        for up, down in links[i + 1 :]:
            if level[up] == level[above]:
                count += (rank[above] - rank[up]) * (rank[below] - rank[down]) < 0
    return count


def placed(
    order: list[list[str]], links: list[tuple[str, str]], width: dict[str, float]
) -> dict[str, tuple[float, float]]:
    """Return the place of each name: near its neighbours, in the given order, without overlap."""
    x = {}
    for layer in order:
        position = 0.0
        for name in layer:
            x[name] = position + width.get(name, 0.0) / 2
            position += width.get(name, 0.0) + GAP
        for name in layer:
            x[name] -= position / 2
    near: dict[str, list[str]] = {name: [] for name in x}
    for above, below in links:
        near[above].append(below)
        near[below].append(above)
    for _ in range(60):
        for layer in order:
            wanted = [
                sum(x[one] for one in near[name]) / len(near[name]) if near[name] else x[name]
                for name in layer
            ]
            x.update(zip(layer, apart(wanted, [width.get(n, 0.0) for n in layer]), strict=True))
    return {name: (x[name], LAYER * i) for i, layer in enumerate(order) for name in layer}


def apart(wanted: list[float], widths: list[float]) -> list[float]:
    """Return places in the same order, near the wanted ones, with a gap between the boxes.

    The mean of two solutions: one that pushes to the right only, and one to the left.
    """

    def pushed(places: list[float], sizes: list[float]) -> list[float]:
        found: list[float] = []
        for i, place in enumerate(places):
            least = found[-1] + (sizes[i - 1] + sizes[i]) / 2 + GAP if found else place
            found.append(max(place, least))
        return found

    right = pushed(wanted, widths)
    left = pushed([-place for place in reversed(wanted)], widths[::-1])
    return [(a - b) / 2 for a, b in zip(right, reversed(left), strict=True)]


def draw(imports: Edges, file: Path) -> None:
    """Draw all panels into one picture."""
    from matplotlib.figure import Figure

    found = {folder: one_way(arrows(folder, imports)) for folder in PANELS}
    drawings = {folder: layout(reduced(edges)) for folder, (edges, _) in found.items()}
    spans = {folder: span(drawing) for folder, drawing in drawings.items()}
    rows = (("", "framework"), ("framework/mpc", "simulation", "experiments"))
    width = max(sum(spans[name][0] for name in row) for row in rows)
    figure = Figure(figsize=(width, sum(max(spans[n][1] for n in row) for row in rows)))
    top = figure.get_figheight()
    for row in rows:
        left = (width - sum(spans[name][0] for name in row)) / 2
        for name in row:
            across, down = spans[name]
            box = (left / width, (top - down) / figure.get_figheight())
            size = (across / width, down / figure.get_figheight())
            axes = figure.add_axes((*box, *size))
            panel(axes, name or "rooms and packages", drawings[name])
            for above, below in found[name][1]:
                mark_circle(axes, drawings[name], above, below)
            left += across
        top -= max(spans[name][1] for name in row)
    file.parent.mkdir(exist_ok=True)
    figure.savefig(file, dpi=110)


def span(drawing: Drawing) -> tuple[float, float]:
    """Return width and height of a panel, inches."""
    edges = [
        x + side * drawing.width.get(name, 0.0) / 2
        for name, (x, _) in drawing.place.items()
        for side in (-1, 1)
    ]
    rows = max(y for _, y in drawing.place.values())
    return max(edges) - min(edges) + 0.8, rows + 1.2


def panel(axes, title: str, drawing: Drawing) -> None:
    """Draw one panel: boxes with names, and arrows that lead down."""
    half = 0.13  # inches, half of a box's height
    for line in drawing.lines:
        points = [drawing.place[name] for name in line]
        points[0] = (points[0][0], points[0][1] - half)
        points[-1] = (points[-1][0], points[-1][1] + half)
        axes.plot(*zip(*points[:-1], strict=True), color="0.45", linewidth=1, zorder=1)
        style = {"arrowstyle": "-|>", "color": "0.45", "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", points[-1], points[-2], arrowprops=style, zorder=1)
    for name in drawing.width:
        x, y = drawing.place[name]
        axes.text(
            x, y, name, ha="center", va="center", family="monospace", fontsize=9, zorder=3,
            bbox={"boxstyle": "round,pad=0.3", "facecolor": "0.92", "edgecolor": "0.2"},
        )  # fmt: skip
    xs = [x for x, _ in drawing.place.values()]
    middle, (across, down) = (min(xs) + max(xs)) / 2, span(drawing)
    axes.set_xlim(middle - across / 2, middle + across / 2)
    axes.set_ylim(-0.4, down - 0.4)
    axes.text(middle, down - 0.85, title, ha="center", fontsize=11, fontweight="bold")
    axes.axis("off")


def mark_circle(axes, drawing: Drawing, above: str, below: str) -> None:
    """Draw an arrow that closes a circle, dashed."""
    style = {"arrowstyle": "-|>", "color": "k", "linestyle": "--", "linewidth": 1.5}
    style["connectionstyle"] = "arc3,rad=0.4"
    axes.annotate("", drawing.place[below], drawing.place[above], arrowprops=style, zorder=2)


if __name__ == "__main__":
    found = module_imports()
    for folder in PANELS:
        for part in circles(arrows(folder, found)):
            print(f"{folder or 'rooms'}: {part} imports itself through others")
    draw(found, FIGURE)
    print(FIGURE.relative_to(ROOT))
