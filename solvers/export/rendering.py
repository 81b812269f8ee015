"""Text of exported files, from templates that read as C or Markdown."""

from functools import cache
from pathlib import Path
from textwrap import fill, wrap
from typing import TYPE_CHECKING, Any

from .layout import c_array, number
from .routines import Routine

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).with_name("templates")


def rendered(name: str, *, templates: Path = TEMPLATES, **values: Any) -> str:
    """Return a template of a folder, filled in; a value that it lacks is an error.

    Paragraphs of Markdown are wrapped; its tables, headings, lists and code stay as they are.
    """
    text = _environment(templates).get_template(name).render(values)
    if not name.endswith(".md"):
        return text
    return "\n\n".join(map(_wrapped, text.rstrip().split("\n\n"))) + "\n"


def _wrapped(block: str) -> str:
    if block.startswith(("|", "#", ">", "1", "```")):
        return block
    return fill(block, 99, break_long_words=False, break_on_hyphens=False)


@cache
def _environment(templates: Path) -> "Environment":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(templates),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.globals["c_array"] = c_array
    made.filters |= {
        "number": number, "define": _define, "in_brackets": _in_brackets,
        "signature": _signature, "declaration": _declaration,
    }  # fmt: skip
    return made


def _in_brackets(value: object) -> str:
    """Put a negative number into brackets, so that a macro may stand anywhere."""
    return f"({value})" if str(value).startswith("-") else str(value)


def _define(constant: tuple[str, object, str]) -> str:
    """Define a constant, wrapped where its line is long."""
    name, value, text = constant
    lines = wrap(f"#define WIDEBERTH_{name} {_in_brackets(value)} /* {text} */", 99)
    return "\n".join([lines[0], *(f"    {line}" for line in lines[1:])])


def _signature(routine: Routine) -> str:
    given = ", ".join(f"const double *{name}" for name in routine.arguments)
    return f"void wideberth_{routine.name}({given}, double *{routine.result})"


def _declaration(routine: Routine) -> str:
    text = f"/* {routine.result}[{routine.size}]: {routine.text}. */"
    lines = wrap(text, 99, subsequent_indent=" * ", break_on_hyphens=False)
    call = wrap(f"{_signature(routine)};", 99, subsequent_indent="    ")
    return "\n".join([*lines, *call])
