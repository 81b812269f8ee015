"""What an index shows of a release: version, date, metadata, and links that work from anywhere."""

import re
import sys
import tomllib
from pathlib import Path

import pytest
from trove_classifiers import classifiers

import wideberth
from wideberth.tests.house.test_imports import BESIDE, CORE
from wideberth.tests.house.test_packaging import ROOT, SETTINGS
from wideberth.tests.house.test_pages import FILES

PROJECT = SETTINGS["project"]
SITE, REPOSITORY = PROJECT["urls"]["Documentation"], PROJECT["urls"]["Source"]
RAW = "https://raw.githubusercontent.com/wideberth/wideberth"


def read(name: str) -> str:
    """Return a text at the top of the repository."""
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_newest_version_of_the_changelog_is_this_one_and_is_cited_with_its_date() -> None:
    headings = re.findall(r"^## (.*)$", read("CHANGELOG.md"), re.MULTILINE)
    assert headings[0] == "Unreleased"
    dated = [re.fullmatch(r"(\S+) - (\d{4}-\d\d-\d\d)", heading) for heading in headings[1:]]
    assert all(dated), headings
    version, date = dated[0].groups()  # type: ignore[union-attr]
    assert version == wideberth.__version__
    citation = read("CITATION.cff").splitlines()
    assert f"version: {version}" in citation and f"date-released: {date}" in citation
    days = [found[2] for found in dated if found]
    assert days == sorted(days, reverse=True)


def test_metadata_says_who_what_and_where() -> None:
    assert not set(PROJECT["classifiers"]) - classifiers
    assert PROJECT["classifiers"] == sorted(PROJECT["classifiers"])
    assert PROJECT["authors"] and PROJECT["maintainers"] and len(PROJECT["keywords"]) >= 5
    citation = read("CITATION.cff").splitlines()
    assert f"repository-code: {REPOSITORY}" in citation and f"url: {SITE}" in citation


def test_least_python_is_the_first_that_the_classifiers_name() -> None:
    named = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["classifiers"]))
    assert PROJECT["requires-python"] == f">={named[0]}" and len(named) >= 3


@pytest.mark.parametrize("package", ["", *BESIDE])
def test_every_licence_in_a_package_is_a_licence_file(package: str) -> None:
    home = ROOT / "packages" / package if package else ROOT
    project = tomllib.loads((home / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    folders = [home / "src"] if package else [ROOT / room for room in CORE]
    texts = {path for folder in folders for path in folder.rglob("*.txt")
             if re.search(r"licen[cs]e|MIT|BSD|Apache", path.name)}  # fmt: skip
    named = {path for pattern in project["license-files"] for path in home.glob(pattern)}
    assert named == {home / "LICENSE", *texts}
    assert bool(texts) == (package == "arenas")  # data of DynaBARN


READMES = ["README.md", *(f"packages/{name}/README.md" for name in BESIDE)]
LINKS = {name: re.findall(r"\]\(([^)\s]+)\)", read(name)) for name in READMES}
EVERY_LINK = sorted({link for links in LINKS.values() for link in links if link[0] != "#"})


@pytest.mark.parametrize("name", READMES)
def test_a_readme_has_no_link_that_an_index_breaks(name: str) -> None:
    assert len(LINKS[name]) >= (30 if name == "README.md" else 2)
    assert [link for link in LINKS[name] if not link.startswith(("https://", "#"))] == []


@pytest.mark.parametrize("link", EVERY_LINK)
def test_a_link_of_a_readme_leads_to_what_is_here(
    link: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = link.partition("#")[0].rstrip("/")
    if address in (SITE, REPOSITORY):
        return
    if address.startswith(SITE):
        monkeypatch.syspath_prepend(str(ROOT / "docs"))
        assert address.removeprefix(f"{SITE}/en/latest/") in pages_of_the_site()
        return
    kind, found = "", re.fullmatch(rf"{REPOSITORY}/(blob|tree)/main/(.+)", address)
    if found:
        kind, place = found.groups()
    else:
        place = address.removeprefix(f"{RAW}/main/")
    file = ROOT / place
    assert file.is_dir() if kind == "tree" else file.is_file(), link


def pages_of_the_site() -> set[str]:
    """Return the pages that the site has of guides, tutorials and pictures."""
    for name in [one for one in sys.modules if one.partition(".")[0] == "_site"]:
        del sys.modules[name]
    from _site.repository import document  # type: ignore[import-not-found]

    files = [Path("docs/tutorials"), Path("docs/gallery")]
    files += [path.relative_to(ROOT) for path in FILES if path.parent.name == "docs"]
    return {f"{document(file)}.html" for file in files}


def test_no_change_stands_twice() -> None:
    entries = re.findall(r"^- (.{40})", read("CHANGELOG.md"), re.MULTILINE)
    assert len(entries) > 80 and sorted(entries) == sorted({*entries})
