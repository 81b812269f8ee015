"""The gallery: pictures and films, each with the script or the command that makes it.

`docs/pictures.yaml` lists them. A script of docs/gallery is run by sphinx-gallery, which makes its
page, too. What a command draws was drawn before (`make pictures`); its page is written here.
"""

import ast
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml
from PIL import Image, ImageOps, ImageSequence

Part = tuple[float, float, float]
DOCS = Path(__file__).resolve().parents[1]
LIST = DOCS / "pictures.yaml"
KEPT = DOCS / "figures" / "gallery"
SIZE = (480, 320)  # pixels of a thumbnail
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
    script : of docs/gallery, without its ending; or empty.
    command : what a shell runs, where no script draws the picture.
    file : what of the command's files is shown; empty where it writes the picture itself.
    picture : file of the picture, relative to docs.
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
    thumbnail: Part = (0.0, 0.0, 1.0)
    page: str = ""

    @property
    def document(self) -> str:
        """Name of the picture's page on the site."""
        return f"auto/gallery/{self.script}" if self.script else f"auto/pictures/{self.name}"

    @property
    def moves(self) -> bool:
        """Whether it is a film."""
        return self.picture.endswith(".gif")

    @property
    def small(self) -> str:
        """File of the thumbnail, relative to docs."""
        return f"auto/thumbnails/{self.name}.{'gif' if self.moves else 'png'}"


def sections() -> dict[str, list[Picture]]:
    """Return the pictures of each section of the gallery, in their order."""
    listed = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    return {title: [read(entry) for entry in entries] for title, entries in listed.items()}


def pictures() -> Iterator[Picture]:
    """Yield all pictures."""
    for found in sections().values():
        yield from found


def read(entry: dict) -> Picture:
    """Return a picture of the list; a script says itself what it draws."""
    entry = {**entry, "thumbnail": tuple(entry.get("thumbnail", (0.0, 0.0, 1.0)))}
    if script := entry.get("script"):
        words = ast.get_docstring(
            ast.parse((DOCS / "gallery" / f"{script}.py").read_text("utf-8"))
        )
        title, _, *paragraph = words.splitlines()
        first = " ".join(paragraph).strip().split(". ")[0].rstrip(".") + "."
        entry = {"name": script, "title": title, "text": first, **entry}
        entry["picture"] = f"auto/gallery/images/sphx_glr_{script}_001.png"
    entry.setdefault(
        "picture", f"figures/gallery/{entry['name']}{Path(entry.get('file', '')).suffix}"
    )
    return Picture(**entry)


def write(folder: Path) -> None:
    """Write the page of each picture that a command makes."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {f"{one.name}.rst": page_of(one) for one in pictures() if not one.script}
    for old in folder.glob("*.rst"):
        if old.name not in wanted:
            old.unlink()
    for name, text in wanted.items():
        if not (folder / name).exists() or (folder / name).read_text(encoding="utf-8") != text:
            (folder / name).write_text(text, encoding="utf-8")


def page_of(one: Picture) -> str:
    """Return the source of the page of a picture: what it shows, and the command."""
    lines = [one.title, "=" * len(one.title), "", one.text, ""]
    lines += [] if one.file else ["In a clone of the repository:", ""]
    lines += [".. code-block:: sh", ""]
    lines += [f"   {line}" for line in one.command.strip().splitlines()]
    drawn = one.file or f"docs/{one.picture}"
    lines += ["", f"It writes ``{drawn}``:", ""]
    lines += [f".. image:: /{one.picture}", f"   :alt: {one.title}", "   :align: center", ""]
    if one.page:
        lines += [f"More of it: :doc:`/{one.page}`.", ""]
    return "\n".join(lines)


def draw(names: list[str]) -> None:
    """Run the commands of these pictures, or of all, and keep what they draw."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for one in pictures():
        target = DOCS / one.picture
        if target.parent != KEPT or (names and one.name not in names):
            continue
        target.parent.mkdir(exist_ok=True)
        with tempfile.TemporaryDirectory() as place:
            subprocess.run(
                one.command, shell=True, cwd=place, check=True, stdout=subprocess.DEVNULL,
                env={**os.environ, "PATH": path},
            )  # fmt: skip
            shrink(Path(place) / one.file, target)
        print(f"{target}: {target.stat().st_size / 1e3:.0f} kB")


def shrink(source: Path, target: Path) -> None:
    """Write a picture or a film with fewer pixels and colours, and a film with fewer frames."""
    frames, pause = frames_of(source)
    every = -(-len(frames) // FRAMES)
    for most in WIDTHS[target.suffix]:
        width = min(most, frames[0].width)
        size = width, round(frames[0].height * width / frames[0].width)
        small = [one.resize(size, Image.Resampling.LANCZOS) for one in frames[::every]]
        save(small, target, every * pause)
        if target.stat().st_size <= LARGEST:
            return


def frames_of(source: Path) -> tuple[list[Image.Image], float]:
    """Return a picture, or all of a film, on white, and the time from frame to frame in ms."""
    with Image.open(source) as image:
        frames = [frame.convert("RGBA") for frame in ImageSequence.Iterator(image)]
        pause = image.info.get("duration", 0)
    for i, frame in enumerate(frames):
        white = Image.new("RGBA", frame.size, "white")
        white.alpha_composite(frame)
        frames[i] = white.convert("RGB")
    return frames, pause


def save(frames: list[Image.Image], target: Path, pause: float) -> None:
    """Write a picture or a film of few colours, those of the frame in the middle."""
    most = Image.Quantize.MAXCOVERAGE
    palette = frames[len(frames) // 2].quantize(COLOURS[target.suffix], most, kmeans=3)
    few = [one.quantize(palette=palette, dither=Image.Dither.NONE) for one in frames]
    film = {"save_all": True, "append_images": few[1:], "duration": pause, "loop": 0}
    few[0].save(target, optimize=True, **(film if target.suffix == ".gif" else {}))


def index(header: str) -> str:
    """Return the source of the gallery's first page: cards, section by section."""
    lines = [":html_theme.sidebar_secondary.remove:", "", header.rstrip(), ""]
    lines += [".. toctree::", "   :hidden:", ""]
    lines += [f"   /{one.document}" for one in pictures()]
    for title, found in sections().items():
        lines += ["", title, "-" * len(title), "", ".. grid:: 1 2 3 3", "   :gutter: 3", ""]
        for one in found:
            lines += [
                f"   .. grid-item-card:: {one.title}",
                f"      :img-top: /{one.small}",
                f"      :img-alt: {one.title}",
                f"      :link: /{one.document}",
                "      :link-type: doc",
                "      :class-card: thumbnail",
                "",
                f"      {one.text}",
                "",
            ]
    return "\n".join(lines)


def draw_thumbnails() -> None:
    """Draw the part of each picture that its card shows, where the picture is newer."""
    for one in pictures():
        small, source = DOCS / one.small, DOCS / one.picture
        newest = max(path.stat().st_mtime for path in (source, LIST))
        if small.exists() and small.stat().st_mtime > newest:
            continue
        small.parent.mkdir(parents=True, exist_ok=True)
        frames, pause = frames_of(source)
        every = -(-len(frames) // FRAMES)
        shown = [thumbnail(frame, one.thumbnail) for frame in frames[::every]]
        save(shown, small, every * pause)


def thumbnail(image: Image.Image, part: Part) -> Image.Image:
    """Return a part of a picture in the size of a thumbnail, filled up with white."""
    left, top, right = image.width * part[0], image.height * part[1], image.width * sum(part[::2])
    bottom = min(image.height, top + (right - left) * SIZE[1] / SIZE[0])
    shown = image.crop([round(edge) for edge in (left, top, right, bottom)])
    return ImageOps.pad(shown, SIZE, method=Image.Resampling.LANCZOS, color="white")
