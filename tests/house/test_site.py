"""Helpers of the site: which words of a docstring are formulas, where methods are documented."""

import re
import sys
from pathlib import Path
from typing import Any

import pytest

from wideberth.framework.plugins.registry import ROOMS
from wideberth.framework.testing import CHECKS
from wideberth.tests.house.test_imports import BESIDE

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
INCLUDED = re.compile(
    r"^```{include} \.\./README\.md\n:start-after: (?P<first>.+)\n:end-before: (?P<last>.+)\n```$",
    re.MULTILINE,
)


@pytest.fixture(autouse=True)
def site(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    for name in [one for one in sys.modules if one.partition(".")[0] == "_site"]:
        monkeypatch.delitem(sys.modules, name)


def test_names_stand_above_their_texts_and_signs_are_escaped() -> None:
    from _site.docstrings import rewritten  # type: ignore[import-not-found]

    lines = ["Keep |v| and `a*b`s low.", "", "    |v| <= 1", "", "Parameters", "----------",
             "a : m. b : s,", "    not a_.", "c, d : m.", "", "Examples", "--------",
             ">>> 2*3"]  # fmt: skip
    assert rewritten("\n".join(lines)).splitlines() == [
        r"Keep \|v\| and \ `a*b`\ s low.", "", ".. code-block:: text", "", "    |v| <= 1", "", "",
        "Parameters", "----------", "a", "    m.", "b", "    s,", r"    not a\_.", "c, d",
        "    m.", "", "Examples", "--------", ">>> 2*3",
    ]  # fmt: skip


def test_every_entry_of_the_reference_has_a_name_and_a_sentence() -> None:
    from _site.reference import groups  # type: ignore[import-not-found]

    for group in groups():
        assert group.entries and all(entry.line for entry in group.entries), group.name


def test_every_room_of_plug_ins_and_every_check_stands_in_the_reference() -> None:
    from _site.reference import groups

    found = {group.name: {entry.found.__name__ for entry in group.entries} for group in groups()}
    assert {*ROOMS} <= {*found} and {*CHECKS} <= found["checks"]


def test_no_name_stands_twice_in_the_reference() -> None:
    from _site.reference import groups

    paths = [entry.path for group in groups() for entry in group.entries]
    assert len(paths) == len({*paths}) > 200


def test_headings_are_smaller_the_deeper_on_any_screen() -> None:
    """The sizes of the theme, and what our own style changes where the screen is narrow."""
    import pydata_sphinx_theme

    folder = Path(pydata_sphinx_theme.__file__).parent / "theme" / "pydata_sphinx_theme"
    theme = (folder / "static" / "styles" / "pydata-sphinx-theme.css").read_text("utf-8")
    own = (ROOT / "docs" / "_static" / "site.css").read_text("utf-8")
    narrow = own[own.index("@media (max-width: 600px)") :]
    variable, direct = (
        r"--pst-font-size-(h\d): ?([\d.]+)rem",
        r"[ {](h\d) ?{ ?font-size: ?([\d.]+)rem",
    )
    wide = dict(re.findall(variable, theme))
    changed = dict(re.findall(variable, narrow)) | dict(re.findall(direct, narrow))
    for sizes in (wide, wide | changed):
        found = [float(sizes[f"h{depth}"]) for depth in range(1, 7)]
        assert found == sorted(set(found), reverse=True)


def included(page: str) -> list[str]:
    """Return the parts of the README that a page shows."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    parts = []
    for match in INCLUDED.finditer(text):
        (found,) = README.split(match["first"].strip('"') + "\n")[1:]
        part, *rest = found.split(match["last"].strip('"'))
        assert rest
        parts.append(part)
    return parts


def test_the_first_page_has_film_installation_script_and_cards() -> None:
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    (script,) = included("index.md")
    assert script.count("```python\n") == 1 and "draw.plan(" in script
    wanted = (
        "{image} figures/episode.gif",
        "pip install wideberth\n",
        "{include}",
        "{image} auto/first/plan.png",
        "## What you can do",
        "## What was measured",
    )
    places = [text.index(one) for one in wanted]
    assert places == sorted(places)
    assert 3 <= text[places[-2] : places[-1]].count("{grid-item-card}") <= 6


def test_the_start_page_shows_installation_and_script_of_the_readme_and_no_copy() -> None:
    page = (ROOT / "docs" / "start.md").read_text(encoding="utf-8")
    install, script = included("start.md")
    assert "```sh\npip install " in install and "| Extra |" in install
    assert included("index.md") == [script]
    paragraphs = {one.strip() for one in README.split("\n\n") if len(one) > 40}
    assert not paragraphs & {one.strip() for one in page.split("\n\n")}


def test_a_link_that_names_a_file_shows_the_title_of_its_page() -> None:
    from _site.repository import linked  # type: ignore[import-not-found]

    text = "See [scenarios.md](scenarios.md), [a planner](choose.md#a-planner) and "
    text += "[write-your-own.md](write-your-own.md#a-scenario)."
    assert linked(text, Path("docs"), "start") == (
        "See [](scenarios.md), [a planner](choose.md#a-planner) and "
        "[](write-your-own.md#a-scenario)."
    )


def test_pages_of_packages_are_linked_as_those_of_docs() -> None:
    from _site.repository import document, linked

    place = Path("packages/nav2/docs")
    text = f"[its page](../{place}/nav2.md#static-worlds)"
    assert linked(text, Path("docs"), "start") == "[its page](auto/packages/nav2.md#static-worlds)"
    text = "[start](../../../docs/start.md), [ROS 2](../../ros/docs/ros.md)"
    assert linked(text, place, "auto/packages/nav2") == "[start](../../start.md), [ROS 2](ros.md)"
    for name in BESIDE:
        assert document(Path(f"packages/{name}/docs/{name}.md")) == f"auto/packages/{name}"


def test_links_to_code_lead_to_the_code_host_and_code_stays() -> None:
    from _site.repository import addresses, linked

    place = f"{addresses()['Source']}/blob/main"
    text = "[a filter](../predictors/kalman.py#L3), [tables](../benchmarks/RESULTS.md)"
    assert linked(text, Path("docs"), "start") == (
        f"[a filter]({place}/predictors/kalman.py#L3), "
        "[tables](auto/repository/benchmarks/RESULTS.md)"
    )
    assert linked("names[0](one), [x](https://a.b)", Path("docs"), "start") == (
        "names[0](one), [x](https://a.b)"
    )


def test_the_examples_have_pages_with_pictures() -> None:
    from _site.examples import with_pictures  # type: ignore[import-not-found]
    from _site.repository import document, linked

    page = with_pictures((ROOT / "docs" / "examples.md").read_text(encoding="utf-8"))
    page = linked(page, Path("docs"), "examples")
    for script in (ROOT / "examples").glob("*.py"):
        name = document(script.relative_to(ROOT))
        assert f"]({name}.rst)" in page and f"![]({name}.png)" in page


def test_the_title_of_the_first_picture_is_explained() -> None:
    (script,) = included("index.md")
    code, after = re.findall(r"^```python\n(.*?)^```$(.*)", script, re.DOTALL | re.MULTILINE)[0]
    known: dict[str, Any] = {}
    exec(code.replace('plt.savefig("plan.png")', ""), known)
    plan = known["planner"].plan
    title = known["plt"].gca().get_title(loc="left")
    (held,) = re.findall(r"holds ([\d.]+ %)", title)
    assert held == f"{100 * plan.lowest_content:.3g} %" and plan.given_way is not None
    assert f"holds {held}" in after and "95 %" in after and "`relaxed`" in after
    known["plt"].close("all")


def test_numbers_on_the_first_page_were_measured() -> None:
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    measured = (ROOT / "docs" / "measured.md").read_text(encoding="utf-8")
    section = re.sub(r"\]\([^)]*\)", "", text[text.index("## What was measured") :])
    cards = re.findall(r"^:::\{grid-item-card\} (.*?)^:::$", section, re.DOTALL | re.MULTILINE)
    assert len(cards) >= 3
    for number in re.findall(r"\d[\d.]*\d|\d", "\n".join(cards)):
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.]*\d)", measured), number
