"""Docstrings as this package writes them, turned into reStructuredText for autodoc.

A section is a list of ``name : what it is, unit``, with further lines indented; an indented block
is an equation or a small table; single backticks name code. Prose is escaped, so that a_i, |v| and
v* stay what they are.
"""

import inspect
import re
import sys
from collections.abc import Callable
from functools import cached_property
from typing import Any

from .formulas import letters, split
from .mathematics import latex

SECTIONS = (
    "Parameters", "Attributes", "Returns", "Raises", "References", "Examples", "Notes",
)  # fmt: skip
LISTS = ("Parameters", "Attributes", "Raises")
EQUATION_WORDS = {
    "exp", "log", "ln", "sin", "cos", "tan", "max", "min", "sum", "sqrt", "Sigma", "mu", "sigma",
    "rho", "Pr", "with", "and", "Cov", "diag", "pi", "lambda",
}  # fmt: skip
CODE = re.compile(r"(``.+?``|(?<!`)`[^`]+`(?!`))", re.DOTALL)
POWERS = {"2": "²", "3": "³", "-1": "⁻¹", "-2": "⁻²"}
Linker = Callable[[str], str]
Symbols = frozenset[str] | None
"""Letters that formulas use; None where there are no formulas."""


def rewritten(lines: list[str], link: Linker) -> list[str]:
    """Return a docstring's lines as reStructuredText."""
    found: list[str] = []
    parted = sections(lines)
    known = symbols(parted)
    for title, body in parted:
        if not title:
            found += prose(body, link, known)
        elif title in LISTS or (title == "Returns" and is_list(body)):
            found += ["", f":{title}:", *indented(items(body, link, known)), ""]
        elif title == "Examples":
            found += ["", ".. rubric:: Example", "", *body, ""]
        else:
            of_formulas = None if title == "References" else known
            found += ["", f".. rubric:: {title}", "", *prose(body, link, of_formulas), ""]
    return found


def symbols(parted: list[tuple[str, list[str]]]) -> frozenset[str]:
    """Return the single letters that the formulas of a docstring use."""
    formulas = []
    for title, body in parted:
        if title not in ("Examples", "References"):
            for part in CODE.split("\n".join(body))[::2]:
                formulas += split(part)[1::2]
    return letters(formulas)


def sections(lines: list[str]) -> list[tuple[str, list[str]]]:
    """Split at the underlined titles; what stands before the first has the title ""."""
    found: list[tuple[str, list[str]]] = [("", [])]
    i = 0
    while i < len(lines):
        below = lines[i + 1] if i + 1 < len(lines) else ""
        if lines[i] in SECTIONS and re.fullmatch(r"-{3,}", below):
            found.append((lines[i], []))
            i += 2
            continue
        found[-1][1].append(lines[i])
        i += 1
    return found


def is_list(body: list[str]) -> bool:
    """Whether a section of results names them."""
    first = next((line for line in body if line), "")
    return bool(re.match(r"[\w, ]{1,40} : ", first))


def items(body: list[str], link: Linker, known: Symbols) -> list[str]:
    """Return ``name : text`` items as a definition list."""
    found: list[str] = []
    for line in dedented(body):
        name, colon, text = line.partition(" : ")
        if line and not line.startswith(" ") and colon:
            named = ", ".join(f"**{escaped(one)}**" for one in name.split(", "))
            found += ["", named, f"    {text.strip()}"]
        elif line:
            found.append(f"    {line.strip()}" if found else line)
        else:
            found.append("")
    return coded(found, link, known, skip_bold=True)


def prose(body: list[str], link: Linker, known: Symbols) -> list[str]:
    """Return paragraphs; an indented block becomes mathematics, or stays as a small table."""
    found: list[str] = []
    i = 0
    while i < len(body):
        if starts_block(body, i):
            end = i
            plain = not body[i].startswith("    ")
            while end < len(body) and (body[end] if plain else in_block(body[end])):
                end += 1
            block = body[i:end]
            while block and not block[-1]:
                block.pop()
            found += ["", *displayed(block), ""]
            i = end
            continue
        end = i + 1
        while end < len(body) and not starts_block(body, end):
            end += 1
        found += coded(body[i:end], link, known)
        i = end
    return found


def in_block(line: str) -> bool:
    """Whether a line goes on with an indented block."""
    return line.startswith("    ") or not line


def starts_block(body: list[str], i: int) -> bool:
    """Whether an indented block or an equation of its own starts at line i, after an empty one."""
    if i and body[i - 1]:
        return False
    return body[i].startswith("    ") or is_equation(body, i)


def is_equation(body: list[str], i: int) -> bool:
    """Whether the paragraph at line i is an equation, written without indentation."""
    rest = body[i:]
    end = rest.index("") if "" in rest else len(rest)
    text = " ".join(rest[:end])
    words = re.findall(r"(?<![\w\\])[A-Za-z]{2,}(?!\w)", text)
    signs = re.search(r" (?:[=<>~]|<=|>=) ", text) and not re.search(r"[`:]", text)
    return 0 < end <= 2 and bool(signs) and all(word in EQUATION_WORDS for word in words)


def displayed(block: list[str]) -> list[str]:
    """Return an indented block as mathematics, or as text where it is none."""
    text = dedented(block)
    if is_mathematics(text):
        return [".. math::", "", *indented(latex(text).splitlines())]
    return [".. code-block:: text", "", *indented(text)]


def is_mathematics(text: list[str]) -> bool:
    """Whether a block is equations: signs, and no sentence."""
    words = re.findall(r"(?<![\w\\])[a-z]{3,}(?!\w)", " ".join(text))
    known = {"exp", "log", "sin", "cos", "tan", "max", "min", "det", "sum", "sqrt", "grad", "int"}
    known |= {"tail", "erfinv", "erfcx", "sign", "prod", "unit", "over", "left", "step", "with"}
    greek = {"alpha", "gamma", "delta", "kappa", "sigma", "omega", "theta", "rho", "tau", "phi"}
    greek |= {"lambda", "psi", "eps", "lam", "rate", "gap", "reach", "heading", "error", "view"}
    sentence = [word for word in words if word not in known | greek]
    return len(sentence) <= 1 and bool(re.search(r"[=<>^_+]", " ".join(text)))


def coded(
    lines: list[str], link: Linker, known: Symbols = frozenset(), skip_bold: bool = False
) -> list[str]:
    """Link names in backticks, set formulas, and escape everything else."""
    found = [""]  # text, markup, text, ...
    for i, part in enumerate(CODE.split("\n".join(lines))):
        if i % 2:
            code = part.startswith("``")
            found += [part if code else link(" ".join(part.strip("`").split())), ""]
            continue
        names = re.split(r"(^\*\*.+\*\*$)", part, flags=re.MULTILINE) if skip_bold else [part]
        for j, some in enumerate(names):
            if j % 2:
                found[-1] += some
                continue
            first, *more = [some] if known is None else split(some, known)
            found[-1] += escaped(first)
            for formula, text in zip(more[::2], more[1::2], strict=True):
                found += [f":math:`{formula}`", escaped(text)]
    return "".join(apart(found)).split("\n")


def apart(parts: list[str]) -> list[str]:
    """Put an escaped blank where code would touch a letter, as reStructuredText forbids."""
    for i in range(1, len(parts), 2):
        if parts[i - 1] and (parts[i - 1][-1].isalnum() or parts[i - 1][-1] in "^_/="):
            parts[i] = "\\ " + parts[i]
        if parts[i + 1] and (parts[i + 1][0].isalnum() or parts[i + 1][0] in "^_("):
            parts[i] += "\\ "
    return parts


def escaped(text: str) -> str:
    """Escape what reStructuredText would take for markup."""
    text = re.sub(r"([*|\\])", r"\\\1", text)
    text = re.sub(r"^(\s*)([A-Za-z]\.) ", r"\1\\\2 ", text, flags=re.MULTILINE)  # no list
    for power, sign in POWERS.items():
        text = re.sub(rf"\^{re.escape(power)}(?![\w(]|\.\d)", sign, text)
    text = re.sub(r"::$", ":", text, flags=re.MULTILINE)
    return re.sub(r"_(?=\W|$)", r"\\_", text)


def indented(lines: list[str]) -> list[str]:
    """Indent by four blanks."""
    return [f"    {line}" if line else "" for line in lines]


def dedented(lines: list[str]) -> list[str]:
    """Remove the indentation that all lines share."""
    return inspect.cleandoc("\n".join(["", *lines])).splitlines()


def linker(pages: dict[int, str], owner: Any, holder: Any = None) -> Linker:
    """Return what turns a name used in the docstring of ``owner`` into a link or into code.

    Parameters
    ----------
    pages : id of a documented object -> its name on the site.
    owner : the object whose docstring it is.
    holder : the class that it belongs to, or None.
    """
    place = holder or owner
    namespace = vars(sys.modules.get(getattr(place, "__module__", ""), object)).copy()
    if inspect.isclass(place):
        methods = {name for name in dir(place) if has_text(place, name)}
    else:
        methods = set()

    def link(name: str) -> str:
        first, *rest = name.split(".")
        if not rest and first in methods:
            return reference(name, place, name)
        found = namespace.get(first)
        if len(rest) == 1 and inspect.isclass(found) and has_text(found, rest[0]):
            return reference(name, found, rest[0])
        if not rest and id(found) in pages:
            return f":py:obj:`{name} <{pages[id(found)]}>`"
        return f"``{name}``"

    def reference(shown: str, owner: type, name: str) -> str:
        for base in owner.__mro__:
            if name in vars(base) and id(base) in pages and has_own_text(base, name):
                return f":py:obj:`{shown} <{pages[id(base)]}.{name}>`"
        return f"``{shown}``"

    return link


def has_text(owner: type, name: str) -> bool:
    """Whether a class has a public method or property of this name that is documented."""
    return any(has_own_text(base, name) for base in owner.__mro__)


def has_own_text(owner: type, name: str) -> bool:
    """Whether a class itself defines and documents the method or property."""
    found = vars(owner).get(name)
    kinds = (property, classmethod, staticmethod, cached_property)
    public = not name.startswith("_") and (inspect.isfunction(found) or isinstance(found, kinds))
    return public and bool(getattr(found, "__doc__", None))
