"""Texts and names of the package and its documentation use plain words.

Docstrings, comments, messages, pages and configs are read as they stand; names, of files too, are
split at underscores and capitals.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from wideberth.tests.house.test_imports import CORE, ROOT

WORDS = frozenset({"told", "hear", "heard", "tells", "somebody", "nobody", "everybody", "whoever"})
"""A sentence without them says who does what."""
QUOTATIONS = (
    ("CONTRIBUTING.md", "told, hear, heard, tells, somebody, nobody, everybody, whoever"),
)
"""File and text: where the words are quoted."""
FOLDERS = (*CORE, "docs", "benchmarks", "examples", "packages")
KINDS = {
    ".bib", ".c", ".css", ".h", ".html", ".js", ".json", ".md", ".py", ".pyi", ".rst", ".toml",
    ".txt", ".yaml",
}  # fmt: skip
MADE = {"__pycache__", "_build", "auto"}
"""Folders that commands write."""
PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def refused(text: str) -> Iterator[tuple[int, str]]:
    """Yield line and word for each word of a text, or part of a name, that is not plain."""
    for number, line in enumerate(text.splitlines(), start=1):
        yield from ((number, one) for one in PART.findall(line) if one.lower() in WORDS)


def files(place: str) -> list[Path]:
    """Return the texts of a folder, or those at the top."""
    found = (ROOT / place).rglob("*") if place else ROOT.iterdir()
    texts = (path for path in found if path.suffix in KINDS)
    left_out = MADE | ({"tests"} if place == "packages" else set())
    return sorted(path for path in texts if not left_out & {*path.relative_to(ROOT).parts})


def read(path: Path) -> str:
    """Return what a file says in its own words; of the changes, those not yet released."""
    text, name = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
    for file, quoted in QUOTATIONS:
        text = text.replace(quoted, "") if file == name else text
    return re.split(r"^## \d", text, flags=re.MULTILINE)[0] if name == "CHANGELOG.md" else text


@pytest.mark.parametrize("place", [*FOLDERS, pytest.param("", id="top")])
def test_texts_and_names_use_plain_words(place: str) -> None:
    found, texts = [], files(place)
    assert texts
    for path in texts:
        name = path.relative_to(ROOT).as_posix()
        found += [f"{name}: {word}" for _, word in refused(name)]
        found += [f"{name}:{line}: {word}" for line, word in refused(read(path))]
    assert found == [], f"write who does what instead of {len(found)} words:\n" + "\n".join(found)


@pytest.mark.parametrize("file, quoted", QUOTATIONS)
def test_a_quotation_is_still_there(file: str, quoted: str) -> None:
    assert quoted in (ROOT / file).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "text, words",
    [
        ("Nobody is told.", ["Nobody", "told"]),
        ("def _told(self): ...", ["told"]),
        ("use_of_heard_topics = 1", ["heard"]),
        ("isToldOf, NotHeard, HEARD_BY, JSONTells", ["Told", "Heard", "HEARD", "Tells"]),
        ('"WHOEVER": somebody\'s', ["WHOEVER", "somebody"]),
        ("everybody_else = everybodies", ["everybody"]),
        ("foretold, untold, hearing, heart, sheared, tell, someone, nobodies", []),
    ],
)
def test_parts_of_names_count_and_parts_of_words_do_not(text: str, words: list[str]) -> None:
    assert [word for _, word in refused(text)] == words


def test_lines_are_counted_from_one() -> None:
    assert list(refused("a\nhe tells\n")) == [(2, "tells")]


def test_make_docs_finds_a_misspelt_word(tmp_path: Path) -> None:
    """With our settings the speller reads folders, and skips those that are not ours."""
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for folder in ("docs", "framework", "docs/auto", "build"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "page.md").write_text("They recieve it.\n")
    done = subprocess.run([sys.executable, "-m", "codespell_lib"], cwd=tmp_path,
                          capture_output=True, text=True)  # fmt: skip
    found = {line.partition(":")[0] for line in done.stdout.splitlines()}
    assert found == {"./docs/page.md", "./framework/page.md"}
