"""Helpers of the site: which words of a docstring are formulas, where methods are documented."""

import re
import sys
from pathlib import Path
from typing import Any

import pytest

from wideberth import Polygon, Region
from wideberth.framework.plugins.registry import ROOMS
from wideberth.regions import MahalanobisEllipse
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


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("margin : m, r + r_d.", ["r + r_{d}"]),
        ("Level z = Phi^-1(1 - tail), at least 0.", [r"z = \Phi ^{-1}(1 -\ \mathrm{tail})"]),
        ("with mean mu and step i + 1", [r"\mu", "i + 1"]),
        ("grows by F P F' + Q as in", ["F P F' + Q"]),
        ("the constraint is 0.5 log q >= 0.", [r"0.5 \log  q \ge  0"]),
        ("takes (a_h, b_h)\nfrom w_c and\nw_v.", ["(a_{h}, b_{h})", "w_{c}", "w_{v}"]),
        ("Return n . mu + margin, m.", [r"n \cdot  \mu  +\ \mathrm{margin}"]),
        ("k = a / 0.5 m/s times", ["k = a / 0.5"]),
        ("more than 1 - p (for some)", ["1 - p"]),
        (r"mu_h -> mu_h + a_h u", [r"\mu _{h} \to  \mu _{h} + a_{h} u"]),
    ],
)
def test_formulas_in_a_sentence_are_found(text: str, found: list[str]) -> None:
    from _site.formulas import split  # type: ignore[import-not-found]

    assert split(text)[1::2] == found


@pytest.mark.parametrize(
    "text",
    [
        "points : (P, D), m, of a path", "at 0.5 m/s and below these", "m^2/s^3; it suits people",
        "(..., V, 2) m -> (..., P)", "(N, m) -> x", "A person at a door, as I said.",
        "weight of (a - guess)^2",
        "the delta method", "dv = -v / braking dt + dw, to one", "see d. For a list - x is left",
        "a 2-D plane, the x-axis and 95 % of it", "- stopping: slowly\n- going on: fast",
        "turn_gain and v_max_speed are names", "(N, D, D), (O, 2D + 1), (C * N,), m",
    ],
)  # fmt: skip
def test_words_units_and_shapes_are_no_formulas(text: str) -> None:
    from _site.formulas import split

    assert split(text) == [text]


def test_a_letter_is_a_symbol_where_a_formula_uses_it() -> None:
    from _site.docstrings import rewritten  # type: ignore[import-not-found]

    lines = ["With q = sqrt(n), a set of n points; C is a language.", "", "Example of `q`."]
    (first, *_) = rewritten(lines, lambda name: f"``{name}``")
    assert first == "With :math:`q =\\ \\sqrt{n}`, a set of :math:`n` points; C is a language."


def test_every_entry_of_the_reference_has_a_name_and_a_sentence() -> None:
    from _site.reference import groups, overview

    for group in groups():
        assert overview(group) and all(entry.line for entry in group.entries), group.name


def test_every_room_of_plug_ins_stands_in_the_reference() -> None:
    from _site.reference import ROOM_TITLES

    assert {*ROOM_TITLES} == {*ROOMS}


def test_inherited_members_are_named_with_their_page() -> None:
    from _site.reference import inherited  # type: ignore[import-not-found]

    homes = {id(Region): "wideberth.Region"}
    (line, _) = inherited(MahalanobisEllipse, homes)
    assert line.startswith("Inherited from :py:obj:`Region <wideberth.Region>`: ")
    assert ":py:obj:`auxiliary <wideberth.Region.auxiliary>`" in line and "`contains <" not in line
    assert inherited(MahalanobisEllipse, {}) == [] == inherited(Polygon, homes)


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
    from _site.repository import files_linked, linked

    place = Path("packages/nav2/docs")
    text = f"[its page](../{place}/nav2.md#static-worlds)"
    assert linked(text, Path("docs"), "start") == "[its page](auto/packages/nav2.md#static-worlds)"
    text = "[start](../../../docs/start.md), [ROS 2](../../ros/docs/ros.md)"
    assert linked(text, place, "auto/packages/nav2") == "[start](../../start.md), [ROS 2](ros.md)"
    assert {Path(f"packages/{name}/docs/{name}.md") for name in BESIDE} <= files_linked(
        [ROOT / "docs" / "guides.md"]
    )


def test_the_page_of_an_example_offers_its_script() -> None:
    from _site.repository import document, page_of

    for script in (ROOT / "examples").glob("*.py"):
        name = document(script.relative_to(ROOT))
        page = page_of(script.relative_to(ROOT), name)
        (place,) = re.findall(r":download:`[^<`]+<(.+?)>`", page)
        assert (ROOT / "docs" / name).parent.joinpath(place).resolve() == script


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
