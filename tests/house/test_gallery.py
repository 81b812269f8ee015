"""Each picture of the gallery is there, and what makes it can be copied."""

import re
import shlex
import sys
from pathlib import Path
from typing import Any

import pytest

from wideberth.tests.house.test_pages import FILES, understood

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


@pytest.fixture
def gallery(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module of the site."""
    monkeypatch.syspath_prepend(str(DOCS))
    for name in [one for one in sys.modules if one.partition(".")[0] == "_site"]:
        monkeypatch.delitem(sys.modules, name)
    from _site import gallery  # type: ignore[import-not-found]

    return gallery


def test_there_are_two_dozen_pictures_and_films_of_different_things(gallery: Any) -> None:
    listed = gallery.pictures()
    assert len(listed) >= 24 and sum(one.picture.endswith(".gif") for one in listed) >= 5
    for field in ("name", "title", "text", "picture"):
        assert len({getattr(one, field) for one in listed}) == len(listed), field


def test_every_script_is_shown_and_every_other_picture_is_kept(gallery: Any) -> None:
    from _site.repository import document  # type: ignore[import-not-found]

    pages = {document(path.relative_to(ROOT)) for path in FILES}
    scripts = sorted(path.stem for path in (DOCS / "gallery").glob("*.py"))
    assert sorted(one.script for one in gallery.pictures() if one.script) == scripts
    kept = {path.relative_to(DOCS).as_posix() for path in gallery.KEPT.iterdir()}
    listed = {one.picture for one in gallery.pictures()}
    assert kept == {name for name in listed if (DOCS / name).parent == gallery.KEPT}
    assert all((DOCS / name).stat().st_size < 300_000 for name in kept)
    assert sum((DOCS / name).stat().st_size for name in kept) < 3_000_000
    for one in gallery.pictures():
        if one.picture.startswith("figures/"):
            assert (DOCS / one.picture).is_file()
        if one.page:
            assert one.page in pages


def test_every_command_is_understood_and_writes_the_file(gallery: Any) -> None:
    for one in gallery.pictures():
        lines = one.command.replace("\\\n", " ").splitlines()
        assert bool(lines) != bool(one.script), one.name
        for line in lines:
            understood(shlex.split(line))
        if one.file.startswith("results/"):
            (name, quick) = re.findall(r"^wideberth run (\w+)( --quick)?", one.command)[0]
            folder = f"results/{name}{'-quick' if quick else ''}/figures/"
            assert one.file.startswith(folder), one.name
        else:
            assert one.file in one.command


def test_a_thumbnail_is_a_part_of_its_picture_that_fills_the_card(gallery: Any) -> None:
    from PIL import Image

    for one in gallery.pictures():
        left, top, width = one.thumbnail
        assert 0 <= left < left + width <= 1 and 0 <= top < 1, one.name
        if (DOCS / one.picture).is_file():
            with Image.open(DOCS / one.picture) as image:
                height = width * image.width / 1.5 / image.height
            assert 0.6 * height < 1 - top, f"{one.name}: much of the card is empty"


def test_a_thumbnail_is_cut_and_filled_up_with_white(gallery: Any) -> None:
    from PIL import Image

    picture = Image.new("RGB", (1000, 100), "white")
    picture.paste("red", (0, 0, 500, 100))
    found = gallery.shown(picture.convert("RGBA"), (0.25, 0.0, 0.5))
    assert found.size == gallery.CARD == (480, 320)
    places = {(5, 160): "red", (475, 160): "white", (5, 5): "white", (5, 315): "white"}
    for place, colour in places.items():
        assert found.getpixel(place) == Image.new("RGB", (1, 1), colour).getpixel((0, 0))


FILM = """python -c "from PIL import Image
frames = [Image.effect_noise((700, 100), 50 + i).convert('RGB') for i in range(30)]
frames[0].save('long.gif', save_all=True, append_images=frames[1:], duration=50)"
"""


@pytest.mark.parametrize(("most", "width"), [(10**9, 640), (0, 320)])
def test_a_film_gets_smaller_until_it_is_small_enough(
    most: int, width: int, gallery: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    film = gallery.Picture("film", "", "", "kept/film.gif", command=FILM, file="long.gif")
    for name, value in (
        ("DOCS", tmp_path),
        ("KEPT", tmp_path / "kept"),
        ("LARGEST", most),
        ("pictures", lambda: [film]),
    ):
        monkeypatch.setattr(gallery, name, value)
    gallery.draw([])
    with Image.open(tmp_path / "kept" / "film.gif") as image:
        assert image.n_frames <= gallery.FRAMES and image.width == width
        lasts = image.n_frames * image.info["duration"]
    assert abs(lasts - 30 * 50) <= 2 * 50  # as long


def test_what_a_command_draws_in_a_folder_of_its_own_is_kept(
    gallery: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from PIL import Image

    command = "python -c \"from PIL import Image; Image.new('RGB', (2400, 9)).save('drawn.png')\""
    settings = {"title": "", "text": "", "command": command, "file": "drawn.png"}
    both = [gallery.Picture(name, picture=f"kept/{name}.png", **settings) for name in "ab"]
    for name, value in (
        ("DOCS", tmp_path),
        ("KEPT", tmp_path / "kept"),
        ("pictures", lambda: both),
    ):
        monkeypatch.setattr(gallery, name, value)
    gallery.draw(["b"])
    assert [path.name for path in tmp_path.rglob("*.png")] == ["b.png"]
    with Image.open(tmp_path / "kept" / "b.png") as image:
        assert image.width == 1200


def test_every_picture_has_a_card_that_leads_to_its_page(gallery: Any) -> None:
    text = gallery.index("Gallery\n=======\n")
    for one in gallery.pictures():
        assert text.count(f":link: /{one.document}\n") == 1
        assert text.count(f"\n   /{one.document}\n") == 1
        if not one.script:
            page = gallery.page("picture", one.title, one=one)
            assert all(f"   {line}\n" in page for line in one.command.splitlines())
