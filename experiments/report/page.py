"""A page in one file: no network, nothing beside it, the same bytes for the same content."""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
PLAYER = ("player.js", "player_view.js", "player_page.js")
"""Scripts of the player, in the order in which they need each other."""
MARK = '<meta name="generator" content="wideberth">'
"""Stands near the beginning of every page: one that holds it may be replaced by another."""


def page(title: str, body: str, scripts: Sequence[str] = ()) -> str:
    """Return a whole HTML page.

    A content security policy forbids all connections and every script but the page's own,
    which it knows by their hashes: text that got in unescaped could do nothing.

    Parameters
    ----------
    title : plain text.
    body : HTML.
    scripts : files in templates/, joined to one script at the end of the page.
    """
    code = "\n".join(text_of(name) for name in scripts)
    digest = base64.b64encode(hashlib.sha256(code.encode("utf-8")).digest()).decode("ascii")
    allowed = f"'sha256-{digest}'" if code else "'none'"
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src {allowed}; base-uri 'none'; form-action 'none'"
    )
    return filled(
        "page.html",
        mark=MARK,
        policy=policy,
        title=escaped(title),
        style=text_of("page.css"),
        body=body,
        script=f"<script>{code}</script>\n" if code else "",
    )


def text_of(name: str) -> str:
    """Return a file of templates/."""
    return (TEMPLATES / name).read_text(encoding="utf-8")


def filled(name: str, /, **values: str) -> str:
    """Return a file of templates/ with HTML in the place of its ``$names``."""
    return Template(text_of(name)).substitute(values)


_ESCAPES = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&#34;", "'": "&#39;"})


def escaped(text: object) -> str:
    """Return plain text as HTML, as templates of Jinja2 escape it."""
    return str(text).translate(_ESCAPES)


def rendered(name: str, **values: Any) -> str:
    """Return a template of Jinja2 in templates/ as HTML; text in it is escaped."""
    return _environment().get_template(name).render(values)


@cache
def _environment() -> "Environment":
    import jinja2

    made: Environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return made


def data_uri(kind: str, data: bytes) -> str:
    """Return bytes as an address that holds them: data:KIND;base64,..."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
