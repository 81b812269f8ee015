"""Counts the Python code of this repository against its budget, `budget.toml`: `make size`.

A line counts if it holds a token that is neither a comment nor a docstring.
"""

import ast
import tokenize
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip
GENERATED = {"_build", "auto", "__pycache__"}
TOOLING = ("tests/house", "tests/fuzz")


def code_lines(path: Path) -> int:
    """Return the number of lines of a file that hold code."""
    docstrings: set[int] = set()
    code: set[int] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            if isinstance(node.value.value, str):
                docstrings.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):
            if token.type not in NO_CODE:
                code.update(range(token.start[0], token.end[0] + 1))
    return len(code - docstrings)


def lines_in(folder: str) -> int:
    """Return the lines of code in a folder, without generated files."""
    files = (ROOT / folder).rglob("*.py")
    return sum(code_lines(file) for file in files if GENERATED.isdisjoint(file.parts))


def sizes() -> dict[str, int]:
    """Return the lines of code of each entry of the budget."""
    folders = sorted(path.parent.name for path in ROOT.glob("*/__init__.py"))
    core = {folder: lines_in(folder) for folder in folders}
    core["framework/testing"] = lines_in("framework/testing")
    core["framework"] -= core["framework/testing"]
    names = sorted(path.parent.name for path in ROOT.glob("packages/*/pyproject.toml"))
    packages = {f"packages/{name}": lines_in(f"packages/{name}/src") for name in names}
    core_lines = sum(core.values()) + sum(map(code_lines, ROOT.glob("*.py")))
    return {
        **core, "core": core_lines, **packages,
        "core and packages": core_lines + sum(packages.values()),
        "benchmarks": lines_in("benchmarks"), "docs": lines_in("docs"),
        "test tooling": sum(map(lines_in, TOOLING)),
    }  # fmt: skip


def limits() -> dict[str, int]:
    """Return the most lines of code that each entry may have."""
    text = Path(__file__).with_name("budget.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def main() -> None:
    """Print the lines of code of each entry beside its limit."""
    allowed = limits()
    print(f"{'':20}{'lines':>8}{'limit':>8}")
    for name, lines in sizes().items():
        print(f"{name:20}{lines:8}{allowed.get(name, 0):8}")


if __name__ == "__main__":
    main()
