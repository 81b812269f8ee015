"""The gallery: pictures and films, each with the script or the command that makes it.

`docs/pictures.yaml` lists them. A script of docs/gallery is run by sphinx-gallery, which makes its
page, too. What a command draws was drawn before (`make pictures`); its page is written here.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import yaml
from PIL import Image, ImageOps, ImageSequence
from sphinx_gallery.py_source_parser import split_code_and_text_blocks

from . import DOCS, page, write

LIST = DOCS / "pictures.yaml"
KEPT = DOCS / "figures" / "gallery"
CARD = (480, 320)  # pixels of a thumbnail
COLOURS = {".png": 64, ".gif": 24}
WIDTHS = {".png": (1200,), ".gif": (640, 480, 420, 360, 320)}
"""Pixels; of several the first that is small enough."""
LARGEST = 290_000  # bytes
FRAMES = 24  # of a film, at most


@dataclass(frozen=True)
class Picture:
    """One picture: how it is made, where it lies, and which part of it is the thumbnail.

    Parameters
    ----------
    text : one sentence on the card.
    picture : file of the picture, relative to docs.
    script : of docs/gallery, without its ending; or empty.
    command : what a shell runs, where no script draws the picture.
    file : what of the command's files is shown; empty where it writes the picture itself.
    thumbnail : left, top and width of the shown part, as shares of the picture; its height is a
        card's.
    page : the guide that explains it, or empty.
    """

    name: str
    title: str
    text: str
    picture: str
    script: str = ""
    command: str = ""
    file: str = ""
    thumbnail: tuple[float, float, float] = (0.0, 0.0, 1.0)
    page: str = ""

    @property
    def document(self) -> str:
        """Name of the picture's page on the site."""
        return f"auto/gallery/{self.script}" if self.script else f"auto/pictures/{self.name}"

    @property
    def small(self) -> str:
        """File of the thumbnail, relative to docs."""
        return f"auto/thumbnails/{self.name}{Path(self.picture).suffix}"


def sections() -> dict[str, list[Picture]]:
    """Return the pictures of each section of the gallery, in their order."""
    listed = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    return {title: [read(entry) for entry in entries] for title, entries in listed.items()}


def pictures() -> list[Picture]:
    """Return all pictures."""
    return [one for section in sections().values() for one in section]


def read(entry: dict) -> Picture:
    """Return a picture of the list; a script says itself what it draws."""
    if script := entry.get("script"):
        _, ((_, words, _), *_) = split_code_and_text_blocks(str(DOCS / f"gallery/{script}.py"))
        title, _, _, paragraph = words.strip().split("\n", 3)
        first = " ".join(paragraph.split()).split(". ")[0].rstrip(".") + "."
        drawn = f"auto/gallery/images/sphx_glr_{script}_001.png"
        return Picture(
            **{"name": script, "title": title, "text": first, "picture": drawn, **entry}
        )
    kept = f"figures/gallery/{entry['name']}{Path(entry.get('file', '')).suffix}"
    return Picture(**{"picture": kept, **entry})


def write_pages() -> None:
    """Write the page of each picture that a command makes."""
    drawn = [one for one in pictures() if not one.script]
    texts = {f"{one.name}.rst": page("picture", one.title, one=one) for one in drawn}
    write(DOCS / "auto" / "pictures", texts)


def index(header: str) -> str:
    """Return the source of the gallery's first page: cards, section by section."""
    return page("gallery", header, sections=sections())


def draw(names: list[str]) -> None:
    """Run the commands of these pictures, or of all, and keep what they draw."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for one in pictures():
        target = DOCS / one.picture
        if target.parent != KEPT or (names and one.name not in names):
            continue
        with tempfile.TemporaryDirectory() as place:
            subprocess.run(
                one.command, shell=True, cwd=place, check=True, stdout=subprocess.DEVNULL,
                env={**os.environ, "PATH": path},
            )  # fmt: skip
            for width in WIDTHS[target.suffix]:
                shrink(Path(place) / one.file, target, width)
                if target.stat().st_size <= LARGEST:
                    break
        print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")


def draw_thumbnails() -> None:
    """Draw the part of each picture that its card shows, where the picture is newer."""
    for one in pictures():
        small, source = DOCS / one.small, DOCS / one.picture
        newest = max(path.stat().st_mtime for path in (source, LIST))
        if not small.exists() or small.stat().st_mtime <= newest:
            shrink(source, small, CARD[0], one.thumbnail)


def shrink(source: Path, target: Path, width: int, part: tuple = (), most: int = FRAMES) -> None:
    """Write a picture or a film with fewer pixels and colours, and a film with fewer frames.

    Parameters
    ----------
    width : pixels, at most.
    part : see `Picture.thumbnail`; filled up with white to a card.
    most : frames of a film, at most.
    """
    with Image.open(source) as image:
        every = -(-getattr(image, "n_frames", 1) // most)
        frames = [frame.convert("RGBA") for frame in ImageSequence.Iterator(image)][::every]
        film = {"duration": every * image.info.get("duration", 0), "loop": 0, "save_all": True}
    frames = [shown(frame, part) for frame in frames]
    for frame in frames:
        frame.thumbnail((width, frame.height), Image.Resampling.LANCZOS)
    method = Image.Quantize.MAXCOVERAGE
    palette = frames[len(frames) // 2].quantize(COLOURS[target.suffix], method, kmeans=3)
    few = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in frames]
    target.parent.mkdir(parents=True, exist_ok=True)
    film = {**film, "append_images": few[1:]} if target.suffix == ".gif" else {}
    few[0].save(target, optimize=True, **film)


def shown(frame: Image.Image, part: tuple[float, ...]) -> Image.Image:
    """Return a frame on white, or a part of it, filled up to the shape of a card."""
    white = Image.alpha_composite(Image.new("RGBA", frame.size, "white"), frame).convert("RGB")
    if not part:
        return white
    left, top, width = (
        share * size for share, size in zip(part, (*frame.size, frame.width), strict=True)
    )
    bottom = min(frame.height, top + width * CARD[1] / CARD[0])
    cut = white.crop([round(edge) for edge in (left, top, left + width, bottom)])
    return ImageOps.pad(cut, CARD, Image.Resampling.LANCZOS, color="white")
