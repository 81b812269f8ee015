"""A page in one file: no network, nothing beside it, the same bytes for the same content."""

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from html import escape
from pathlib import Path

DATA = Path(__file__).resolve().parents[1] / "data"
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
    scripts : files in data/, joined to one script at the end of the page.
    """
    code = "\n".join(template(name) for name in scripts)
    digest = base64.b64encode(hashlib.sha256(code.encode("utf-8")).digest()).decode("ascii")
    allowed = f"'sha256-{digest}'" if code else "'none'"
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src {allowed}; base-uri 'none'; "
        "form-action 'none'"
    )
    lines = [
        "<!DOCTYPE html>",
        '<html lang="en">',
        "<head>",
        '<meta charset="utf-8">',
        MARK,
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="data:,">',
        f"<title>{escape(title)}</title>",
        f"<style>\n{template('page.css')}</style>",
        "</head>",
        "<body>",
        body,
        *([f"<script>{code}</script>"] if code else []),
        "</body>",
        "</html>",
    ]
    return "\n".join(lines) + "\n"


@cache
def template(name: str) -> str:
    """Return the text of a file in data/."""
    return (DATA / name).read_text(encoding="utf-8")


def data_uri(kind: str, data: bytes) -> str:
    """Return bytes as an address that holds them: data:KIND;base64,..."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
