"""Links between Markdown pages, which lead to files of the repository, as links of the site.

A page keeps reading well on a code host: there a link leads to the file. Here it leads to the page
that the file became: a guide, a tutorial that was executed, or a page that shows the source.
"""

import os.path
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
LINK = re.compile(r"(?<!!)\[(?P<text>[^\]]+)\]\((?P<target>[^)#:\s]+)(?P<anchor>#[^)\s]*)?\)")
IMAGE = re.compile(r"(?P<text>!\[[^\]]*\])\((?P<target>[^):\s]+)\)")
LANGUAGES = {".py": "python", ".yaml": "yaml", ".toml": "toml"}


def addresses() -> dict[str, str]:
    """Return the addresses of the project: Documentation, Source and others."""
    settings: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    urls: dict[str, str] = settings["project"]["urls"]
    return urls


def document(file: Path) -> str | None:
    """Return the name of the page that a file of the repository has on the site, or None.

    Parameters
    ----------
    file : relative to the repository.
    """
    if file == Path("README.md"):
        return "index"
    if file in (Path("examples"), Path("docs/tutorials"), Path("docs/gallery")):
        return f"auto/{file.name}/index" if file.name != "examples" else "examples"
    if not (ROOT / file).is_file():
        return None
    if file.parent in (Path("docs/tutorials"), Path("docs/gallery")):
        return f"auto/{file.parent.name}/{file.stem}"
    if file.parts[0] == "docs" and file.suffix == ".md":
        return file.relative_to("docs").with_suffix("").as_posix()
    if file.match("packages/*/docs/*.md"):
        return f"auto/packages/{file.stem}"
    return f"auto/repository/{file.with_suffix('').as_posix()}"


def linked(text: str, home: Path, page: str) -> str:
    """Return Markdown with its links to files turned into links between pages.

    Parameters
    ----------
    text : Markdown.
    home : folder of the file that it stands in, relative to the repository.
    page : the page's name on the site.
    """

    def leading(match: re.Match[str]) -> str:
        file = Path(os.path.normpath(home / match["target"]))
        name = document(file)
        if name is None:
            return match["text"]
        suffix = ".md" if name in ("index", "examples") or file.suffix == ".md" else ".rst"
        target = os.path.relpath(f"{name}{suffix}", Path(page).parent)
        text = "" if match["text"].endswith(".md") else match["text"]  # then its title is shown
        return f"[{text}]({target}{match['anchor'] or ''})"

    def shown(match: re.Match[str]) -> str:
        file = os.path.normpath(home / match["target"])
        return f"{match['text']}({os.path.relpath(file, Path('docs') / Path(page).parent)})"

    parts = re.split(r"(^```.*?^```$)", text, flags=re.DOTALL | re.MULTILINE)
    return "".join(
        p if i % 2 else IMAGE.sub(shown, LINK.sub(leading, p)) for i, p in enumerate(parts)
    )


def files_linked(pages: Iterable[Path]) -> set[Path]:
    """Return the files outside docs/ that the pages lead to, relative to the repository."""
    found = set()
    for page in pages:
        for match in LINK.finditer(page.read_text(encoding="utf-8")):
            file = Path(os.path.normpath(page.parent.relative_to(ROOT) / match["target"]))
            name = document(file)
            if name and name.startswith(("auto/repository/", "auto/packages/")):
                found.add(file)
    return found


def write(folder: Path, pages: list[Path]) -> None:
    """Write a page for each file of the repository that a page leads to, and for all examples."""
    wanted = files_linked(pages)
    wanted |= {path.relative_to(ROOT) for path in (ROOT / "examples").glob("*.py")}
    more = [ROOT / file for file in wanted if file.suffix == ".md"]
    wanted |= files_linked(more)
    for file in wanted:
        name = document(file)
        assert name is not None
        path = folder / Path(name).relative_to("auto")
        path = path.with_name(path.name + (".md" if file.suffix == ".md" else ".rst"))
        text = page_of(file, name)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


def forget(folder: Path) -> None:
    """Remove the pages of tutorials and pictures whose script is gone."""
    for built in (folder / "tutorials", folder / "gallery"):
        scripts = {path.stem for path in (folder.parent / built.name).glob("*.py")}
        for page in built.glob("*.rst"):
            if page.stem not in scripts | {"index", "sg_execution_times"}:
                page.unlink()


def page_of(file: Path, name: str) -> str:
    """Return the source of the page that shows a file."""
    if file.suffix == ".md":
        text = (ROOT / file).read_text(encoding="utf-8")
        return linked(text, file.parent, name)
    title = file.as_posix()
    up = "../" * (len(Path(name).parts) - 1) + "../"
    language = LANGUAGES.get(file.suffix, "text")
    lines = [":orphan:", "", title, "=" * len(title), ""]
    if file.parent == Path("examples"):
        lines += [f":download:`Download the script <{up}{title}>`", ""]
        lines += [f".. image:: /auto/examples/{file.stem}.png", "   :alt: what the script draws",
                  "   :width: 80%", "", "It prints:", "",
                  f".. literalinclude:: /auto/examples/{file.stem}.txt", "   :language: text", "",
                  ".. rubric:: The script", ""]  # fmt: skip
    lines += [f".. literalinclude:: {up}{title}", f"   :language: {language}", ""]
    return "\n".join(lines)
