"""The pictures that the scripts in examples/ draw, and what they print."""

import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROW = re.compile(r"^\| \[(?P<name>\w+)\.py\]\([^)]*\) \| (?P<text>.+?) \|$", re.MULTILINE)
FIRST = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TABLE = re.compile(r"^\| Script \|.*\n\| --- .*\n(?:\|.*\n?)+", re.MULTILINE)


def draw(folder: Path) -> None:
    """Run each example whose picture in the folder is missing or older than the script."""
    folder.mkdir(parents=True, exist_ok=True)
    scripts = sorted((ROOT / "examples").glob("*.py"))
    stale = [one for one in scripts if not fresh(folder / f"{one.stem}.png", one)]
    with ThreadPoolExecutor(2) as pool:
        for _ in pool.map(lambda script: run(script, folder), stale):
            pass


def draw_first(folder: Path) -> None:
    """Run the README's first script, as `plan.py` of the folder, where that has changed."""
    block = FIRST.search((ROOT / "README.md").read_text(encoding="utf-8"))
    assert block is not None
    script = folder / "plan.py"
    if not script.exists() or script.read_text(encoding="utf-8") != block[1]:
        folder.mkdir(parents=True, exist_ok=True)
        script.write_text(block[1], encoding="utf-8")
    if not fresh(folder / "plan.png", script):
        run(script, folder)


def fresh(picture: Path, script: Path) -> bool:
    """Whether a picture is newer than the script that draws it."""
    return picture.exists() and picture.stat().st_mtime > script.stat().st_mtime


def run(script: Path, folder: Path) -> None:
    """Run one example in a folder of its own; keep its picture and its words.

    Raises
    ------
    RuntimeError : it failed, or drew not exactly one picture.
    """
    with tempfile.TemporaryDirectory() as place:
        done = subprocess.run(
            [sys.executable, str(script)], cwd=place, text=True, capture_output=True, timeout=600,
            env={**os.environ, "MPLBACKEND": "Agg"},
        )  # fmt: skip
        pictures = list(Path(place).glob("*.png"))
        if done.returncode or len(pictures) != 1:
            raise RuntimeError(f"{script.name} drew {len(pictures)} pictures: {done.stderr}")
        (folder / f"{script.stem}.txt").write_text(done.stdout, encoding="utf-8")
        (folder / f"{script.stem}.png").write_bytes(pictures[0].read_bytes())


def with_pictures(page: str) -> str:
    """Turn the page's table of scripts into cards with pictures."""
    table = TABLE.search(page)
    assert table is not None
    cards = ["::::{grid} 1 2 2 3", ":gutter: 3", ""]
    for row in ROW.finditer(table[0]):
        name = row["name"]
        cards += [
            f":::{{grid-item-card}} {name}.py",
            f":img-bottom: auto/examples/{name}.png",
            f":link: auto/repository/examples/{name}", ":link-type: doc",
            ":class-card: example", "",
            row["text"][0].upper() + row["text"][1:] + ".", ":::", "",
        ]  # fmt: skip
    return TABLE.sub("\n".join([*cards, "::::", ""]).replace("\\", r"\\"), page)
