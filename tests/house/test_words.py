"""Texts and names of the package and its documentation use plain words."""

import re
from pathlib import Path

import pytest

from wideberth.tests.house.test_imports import CORE, ROOT

QUOTED = "told, hear, heard, tells, somebody, nobody, everybody, whoever"
"""A sentence without them says who does what. CONTRIBUTING.md lists them."""
WORDS = frozenset(QUOTED.split(", "))
FOLDERS = (*CORE, "docs", "benchmarks", "examples", "packages", "")
KINDS = {
    ".bib", ".c", ".css", ".h", ".html", ".js", ".json", ".md", ".py", ".pyi", ".rst", ".toml",
    ".txt", ".yaml",
}  # fmt: skip
LEFT_OUT = {"__pycache__", "_build", "auto"}
"""Folders that commands write."""
PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def refused(text: str) -> list[str]:
    """Return each word of a text, or part of a name, that is not plain."""
    return [one for one in PART.findall(text) if one.lower() in WORDS]


def read(path: Path) -> str:
    """Return what a file says in its own words; of the changes, those not yet released."""
    text = path.read_text(encoding="utf-8").replace(QUOTED, "")
    return re.split(r"^## \d", text, flags=re.MULTILINE)[0] if path.stem == "CHANGELOG" else text


@pytest.mark.parametrize("place", FOLDERS)
def test_texts_and_names_use_plain_words(place: str) -> None:
    left_out = LEFT_OUT | ({"tests"} if place == "packages" else set())
    texts = [
        path for path in ((ROOT / place).rglob("*") if place else ROOT.iterdir())
        if path.suffix in KINDS and not left_out & {*path.relative_to(ROOT).parts}
    ]  # fmt: skip
    found = [
        f"{path.relative_to(ROOT)}:{number}: {word}"
        for path in texts
        for number, line in enumerate([path.name, *read(path).splitlines()])
        for word in refused(line)
    ]
    assert texts and not found, "write who does what instead:\n" + "\n".join(found)


@pytest.mark.parametrize(
    "text, words",
    [
        ("Nobody is told.", ["Nobody", "told"]),
        ("isToldOf, NotHeard, use_of_heard_topics", ["Told", "Heard", "heard"]),
        ("foretold, untold, hearing, heart, sheared, tell, someone, nobodies", []),
    ],
)
def test_parts_of_names_count_and_parts_of_words_do_not(text: str, words: list[str]) -> None:
    assert refused(text) == words
