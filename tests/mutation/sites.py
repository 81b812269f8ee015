"""Places at which a module can be changed for the worse, and the changes.

A site is one node of the syntax tree and what to put in its place. Left out is what changes
nothing that a program does: docstrings, annotations, messages, asserts that narrow a type,
imports, decorators, and arguments that only guard or speed up a call.
"""

import ast
from collections import Counter
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass
from typing import final

TINY = 1e-5
"""Numbers below are tolerances, of which twice as much is as good: they are made 1e4 as large."""

_COMPARED = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}  # fmt: skip
_AT_THE_EDGE = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_COMPUTED = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
    ast.Pow: ast.Mult, ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.FloorDiv: ast.Mult,
}  # fmt: skip
_PAIRS = (
    ("min", "max"), ("minimum", "maximum"), ("any", "all"), ("sin", "cos"), ("floor", "ceil"),
    ("argmin", "argmax"), ("nanmin", "nanmax"), ("zeros", "ones"), ("sum", "mean"),
    ("sqrt", "square"), ("exp", "log"), ("amin", "amax"),
)  # fmt: skip
_CALLED = {one: two for pair in _PAIRS for one, two in (pair, pair[::-1])}
_GUARDS = {"strict", "dtype", "copy", "stacklevel", "kind", "default_factory", "init", "repr"}
"""Keywords of calls that are left as they are."""
_SPOKEN = {"__repr__", "__str__"}
"""Functions that only make text."""


@final
@dataclass(frozen=True)
class Site:
    """One change.

    Attributes
    ----------
    path : of the module, from the root of the repository.
    owner : qualified name of the function or class around it, "" at module level.
    number : of the change in the module, in the order of `sites`.
    line : of the source, counted from 1.
    text : the line, stripped, and the change; the same in another commit if the line is.
    names : that a module's or class's statement defines; () within functions.
    """

    path: str
    owner: str
    number: int
    line: int
    text: str
    names: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Name it as the list of survivors does."""
        return f"{self.path} {self.owner}: {self.text}"


def sites(path: str, source: str) -> list[Site]:
    """All changes of a module, in the order of its lines."""
    lines, found, seen = source.splitlines(), [], Counter[str]()
    for number, (slot, new) in enumerate(_changes(ast.parse(source))):
        old = slot.node
        line = getattr(old, "lineno", 1)
        text = f"{lines[line - 1].strip()} | {_short(old)} -> {_short(new)}"
        seen[slot.scope.owner + text] += 1
        if (again := seen[slot.scope.owner + text]) > 1:
            text += f" #{again}"
        found.append(Site(path, slot.scope.owner, number, line, text, slot.scope.names))
    return found


def changed(source: str, number: int) -> ast.Module:
    """Syntax tree of a module with one change made."""
    tree = ast.parse(source)
    for place, (slot, new) in enumerate(_changes(tree)):
        if place == number:
            slot.put(new)
            return ast.fix_missing_locations(tree)
    raise IndexError(number)


@final
@dataclass(frozen=True)
class _Scope:
    """Around a node: qualified name of function or class, and what a statement defines."""

    owner: str = ""
    within: bool = False  # a function
    names: tuple[str, ...] = ()

    def of(self, child: ast.AST) -> "_Scope":
        """Scope of what is inside a child."""
        if self.within:
            return self
        if isinstance(child, ast.ClassDef | ast.FunctionDef):
            inside = f"{self.owner}.{child.name}".lstrip(".")
            return _Scope(inside, isinstance(child, ast.FunctionDef))
        if isinstance(child, ast.Assign | ast.AnnAssign):
            targets = child.targets if isinstance(child, ast.Assign) else [child.target]
            inside = (one for target in targets for one in ast.walk(target))
            names = tuple(one.id for one in inside if isinstance(one, ast.Name))
            return _Scope(self.owner, False, names)
        return self


@final
@dataclass(frozen=True)
class _Slot:
    """Where a node hangs in its tree."""

    node: ast.AST
    parent: ast.AST
    field: str
    index: int | None
    scope: _Scope

    def put(self, new: ast.AST) -> None:
        ast.copy_location(new, self.node)
        if self.index is None:
            setattr(self.parent, self.field, new)
        else:
            getattr(self.parent, self.field)[self.index] = new


def _changes(tree: ast.Module) -> Iterator[tuple[_Slot, ast.AST]]:
    for slot in _slots(tree, _Scope()):
        for new in _worse(slot.node):
            yield slot, new


def _slots(node: ast.AST, scope: _Scope) -> Iterator[_Slot]:
    for field, value in ast.iter_fields(node):
        for index, child in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(child, ast.AST) and not _left_alone(node, field, child):
                inside = scope.of(child)
                place = index if isinstance(value, list) else None
                yield _Slot(child, node, field, place, inside)
                if not _reshaped_by(node, child):
                    yield from _slots(child, inside)


def _reshaped_by(parent: ast.AST, child: ast.AST) -> bool:
    """Whether it is -1 in a call of reshape, where any number below 0 means the same."""
    called = parent.func if isinstance(parent, ast.Call) else None
    reshapes = isinstance(called, ast.Attribute) and called.attr == "reshape"
    return reshapes and isinstance(child, ast.UnaryOp)


def _left_alone(parent: ast.AST, field: str, child: ast.AST) -> bool:
    if field in ("annotation", "returns", "decorator_list", "bases", "type_params"):
        return True
    if isinstance(child, ast.Import | ast.ImportFrom | ast.JoinedStr | ast.Raise | ast.Assert):
        return True
    if isinstance(child, ast.FunctionDef) and child.name in _SPOKEN:
        return True
    if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
        return True
    if isinstance(child, ast.keyword) and child.arg in _GUARDS:
        return True
    if isinstance(child, ast.Assign | ast.AnnAssign):
        text = ast.unparse(child)
        return any(word in text for word in ("__all__", "TypeAlias", "TypeVar", "ClassVar[str]"))
    return isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant)


def _worse(node: ast.AST) -> Iterator[ast.AST]:
    """Changes of one node."""
    if isinstance(node, ast.Constant):
        yield from _numbers(node)
    elif isinstance(node, ast.Compare) and len(node.ops) == 1:
        yield from _comparisons(node)
    elif isinstance(node, ast.BinOp) and type(node.op) in _COMPUTED:
        yield ast.BinOp(node.left, _COMPUTED[type(node.op)](), node.right)
    elif isinstance(node, ast.AugAssign) and type(node.op) in _COMPUTED:
        yield ast.AugAssign(node.target, _COMPUTED[type(node.op)](), node.value)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not | ast.Invert):
        yield node.operand
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
    elif isinstance(node, ast.IfExp):
        yield node.body
        yield node.orelse
    elif isinstance(node, ast.If):
        yield from _branches(node)
    elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        yield ast.Pass()
    elif isinstance(node, ast.Break | ast.Continue):
        yield ast.Pass()
    elif isinstance(node, ast.Call):
        yield from _calls(node)


def _numbers(node: ast.Constant) -> Iterator[ast.AST]:
    value = node.value
    if isinstance(value, bool):
        yield ast.Constant(not value)
    elif isinstance(value, int):
        yield ast.Constant(value + 1)
    elif isinstance(value, float):
        yield ast.Constant(1.0 if value == 0.0 else value * (1e4 if abs(value) < TINY else 2.0))


def _comparisons(node: ast.Compare) -> Iterator[ast.AST]:
    kind, right = type(node.ops[0]), node.comparators[0]
    yield ast.Compare(node.left, [_COMPARED[kind]()], [right])
    counted = isinstance(right, ast.Constant) and isinstance(right.value, int)
    if kind in _AT_THE_EDGE and (counted or "len(" in ast.unparse(node)):
        yield ast.Compare(node.left, [_AT_THE_EDGE[kind]()], [right])


def _branches(node: ast.If) -> Iterator[ast.AST]:
    """Take out one branch; a check that only raises keeps its condition to be changed."""
    never, always = ast.Constant(False), ast.Constant(True)
    yield ast.If(never, node.body, node.orelse)
    if not isinstance(node.body[0], ast.Raise):
        yield ast.If(always, node.body, node.orelse)


def _calls(node: ast.Call) -> Iterator[ast.AST]:
    new = deepcopy(node)
    if isinstance(new.func, ast.Name) and new.func.id in ("min", "max", "any", "all"):
        new.func.id = _CALLED[new.func.id]
        yield new
    elif isinstance(new.func, ast.Attribute) and new.func.attr in _CALLED:
        if new.func.attr in ("zeros", "ones") and " 0" in f" {ast.unparse(new)}".replace("(", " "):
            return  # empty
        new.func.attr = _CALLED[new.func.attr]
        yield new


def _short(node: ast.AST) -> str:
    if isinstance(node, ast.If):
        return f"if {ast.unparse(node.test)}"
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
