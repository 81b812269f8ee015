"""The pictures that the scripts in examples/ draw, and what they print."""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from . import DOCS, ROOT, write

FIRST = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
ROW = re.compile(r"^\| (\[(\w+)\.py\]\([^)]*\)) \|", re.MULTILINE)


def draw() -> None:
    """Run the README's first script and all examples that changed since they drew."""
    (script, *_) = FIRST.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    write(DOCS / "auto" / "first", {"plan.py": script}, "*.py")
    run(DOCS / "auto" / "first" / "plan.py", DOCS / "auto" / "first")
    for path in sorted((ROOT / "examples").glob("*.py")):
        run(path, DOCS / "auto" / "examples")


def run(script: Path, folder: Path) -> None:
    """Run a script in a folder of its own; keep its picture and its words.

    Raises
    ------
    RuntimeError : it failed, or drew not exactly one picture.
    """
    picture = folder / f"{script.stem}.png"
    if picture.exists() and picture.stat().st_mtime > script.stat().st_mtime:
        return
    with tempfile.TemporaryDirectory() as place:
        environment = {**os.environ, "MPLBACKEND": "Agg"}
        command = [sys.executable, str(script)]
        done = subprocess.run(command, cwd=place, text=True, capture_output=True, env=environment)
        drawn = [file.read_bytes() for file in Path(place).glob("*.png")]
    if done.returncode or len(drawn) != 1:
        raise RuntimeError(f"{script.name} drew {len(drawn)} pictures: {done.stderr}")
    folder.mkdir(parents=True, exist_ok=True)
    picture.with_suffix(".txt").write_text(done.stdout, encoding="utf-8")
    picture.write_bytes(*drawn)


def with_pictures(page: str) -> str:
    """Add its picture to each row of the page's table of scripts."""
    return ROW.sub(r"| \1 ![](auto/examples/\2.png) |", page)
