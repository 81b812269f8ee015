"""Links between Markdown pages, which lead to files of the repository, as links of the site.

A page keeps reading well on a code host: there a link leads to the file. Here it leads to the page
that the file became, or to the file on the code host.
"""

import os.path
import re
import tomllib
from pathlib import Path

from . import DOCS, ROOT, page, write

LINK = re.compile(r"\[(?P<text>[^\]]*)\]\((?P<target>[^)#:\s]+)(?P<anchor>#[^)\s]*)?\)")
SHOWN = ("*.md", "benchmarks/*.md", "packages/*/docs/*.md")
"""Pages of the site that lie outside docs."""


def addresses() -> dict[str, str]:
    """Return the addresses of the project: Documentation, Source and others."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    urls: dict[str, str] = settings["project"]["urls"]
    return urls


def document(file: Path) -> str | None:
    """Return the name of the page that a file of the repository has on the site, or None.

    Parameters
    ----------
    file : relative to the repository.
    """
    folder, name = file.parent, file.stem
    if file in (Path("docs/tutorials"), Path("docs/gallery")):
        return f"auto/{name}/index"
    if folder in (Path("docs/tutorials"), Path("docs/gallery"), Path("examples")):
        return f"auto/{folder.name}/{name}" if file.suffix == ".py" else None
    if file.suffix != ".md":
        return None
    if folder == Path("docs") or file == Path("README.md"):
        return "index" if name == "README" else name
    if file.match("packages/*/docs/*.md"):
        return f"auto/packages/{name}"
    shown = any(file == Path(one.relative_to(ROOT)) for kind in SHOWN for one in ROOT.glob(kind))
    return f"auto/repository/{file.with_suffix('')}" if shown else None


def linked(text: str, home: Path, page: str) -> str:
    """Return Markdown with its links to files turned into links of the site.

    Parameters
    ----------
    text : Markdown.
    home : folder of the file that it stands in, relative to the repository.
    page : the page's name on the site.
    """

    def leading(match: re.Match[str]) -> str:
        file = Path(os.path.normpath(home / match["target"]))
        name, up = document(file), Path(page).parent
        if not (ROOT / file).exists():
            return match[0]
        if file.suffix in (".png", ".gif", ".svg"):
            target = os.path.relpath(ROOT / file, DOCS / up)
        elif name is None:
            target = f"{addresses()['Source']}/blob/main/{file}"
        else:
            kind = ".md" if file.suffix == ".md" else ".rst"
            target = os.path.relpath(f"{name}{kind}", up)
        shown = "" if name and match["text"].endswith(".md") else match["text"]  # then the title
        return f"[{shown}]({target}{match['anchor'] or ''})"

    return LINK.sub(leading, text)


def write_pages() -> None:
    """Write the pages of Markdown files outside docs, and of examples."""
    for kind in SHOWN:
        for path in ROOT.glob(kind):
            file = path.relative_to(ROOT)
            place = DOCS / f"{document(file)}.md"
            if place.parent != DOCS:
                text = linked(path.read_text(encoding="utf-8"), file.parent, f"{document(file)}")
                write(place.parent, {place.name: f"---\norphan: true\n---\n\n{text}"}, place.name)
    names = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))
    texts = {f"{name}.rst": page("example", f"examples/{name}.py", name=name) for name in names}
    write(DOCS / "auto" / "examples", texts, "*.rst")
