"""Helpers of the site's `conf.py`: what is written into docs/auto before Sphinx reads it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = jinja2.Environment(
    loader=jinja2.FileSystemLoader(Path(__file__).parent / "pages"),
    trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined,
)  # fmt: skip


def page(template: str, title: str, **values: Any) -> str:
    """Return the source of a page from a template of docs/_site/pages."""
    return PAGES.get_template(f"{template}.rst").render(title=title, **values)


def write(folder: Path, texts: Mapping[str, str], kind: str = "*") -> None:
    """Write files by name and remove others of the kind; unchanged ones keep their time."""
    for old in folder.glob(kind):
        if old.name not in texts:
            old.unlink()
    for name, text in texts.items():
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != text:
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text, encoding="utf-8")
