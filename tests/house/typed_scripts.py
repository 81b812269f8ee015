"""Check the types of every script that a reader copies, with pyright's defaults.

README, pages, tutorials, gallery and examples stand in a folder of their own, as a user's scripts
do, and are checked against the wideberth that a Python has installed: typed_scripts.py [PYTHON].
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from wideberth.tests.house.test_pages import BEFORE, NOT_RUN, ROOT, blocks, having

FOLDERS = "docs/tutorials", "docs/gallery", "examples"


def scripts() -> dict[str, str]:
    """Return the scripts by the names of their files; the sample's misspelt lines among them."""
    files = [file for folder in FOLDERS for file in sorted((ROOT / folder).glob("*.py"))]
    files.append(ROOT / "tests" / "house" / "typed_sample.py")
    found = {file.name: file.read_text(encoding="utf-8") for file in files}
    for page in sorted(set(having("python")) - NOT_RUN):
        name = Path(page).stem.replace("-", "_")
        found[f"page_{name}.py"] = "\n".join([BEFORE.get(page, ""), *blocks(page, "python")])
    return found


def check(python: Path) -> int:
    """Let pyright check them against the packages of this Python; 0 without an error."""
    with tempfile.TemporaryDirectory() as name:
        for file, text in scripts().items():
            (Path(name) / file).write_text(text, encoding="utf-8")
        command = [Path(sys.executable).with_name("pyright"), "--pythonpath", python.absolute()]
        environment = dict(os.environ)
        if python == Path(sys.executable):  # packages of a checkout are found by an import hook
            sources = map(str, sorted(ROOT.glob("packages/*/src")))
            environment["PYTHONPATH"] = os.pathsep.join(sources)
        return subprocess.run(command, cwd=name, env=environment).returncode


if __name__ == "__main__":
    sys.exit(check(Path(sys.argv[1] if len(sys.argv) > 1 else sys.executable)))
