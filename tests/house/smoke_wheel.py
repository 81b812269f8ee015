"""Try a wheel in a fresh environment, away from the checkout: smoke_wheel.py WHEEL."""

import os
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

README = Path(__file__).resolve().parents[2] / "README.md"


def call(folder: Path, *words: str) -> str:
    """Run a program of the environment in an empty folder; its output."""
    program, *rest = words
    done = subprocess.run(
        [str(folder / "env" / "bin" / program), *rest], cwd=folder, text=True,
        stdout=subprocess.PIPE, check=True,
        env={**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": ""},
    )  # fmt: skip
    return done.stdout


def main(wheel: Path) -> None:
    """Install the wheel, run the command line, a study, and the README's script."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        venv.create(folder / "env")
        uv, python = Path(sys.executable).with_name("uv"), folder / "env" / "bin" / "python"
        install = [uv, "pip", "install", "-q", "--python", python, wheel.resolve()]
        subprocess.run(install, check=True)
        print(call(folder, "wideberth", "--version").strip())
        where = call(folder, "python", "-c", "import wideberth; print(wideberth.__file__)")
        assert Path(where.strip()).is_relative_to(folder.resolve()), where
        call(folder, "wideberth", "run", "approximation_error", "--quick")
        assert list(folder.glob("results/approximation_error-quick/figures/*.png"))
        (script,) = re.findall(r"```python\n(.*?)```", README.read_text("utf-8"), re.DOTALL)
        call(folder, "python", "-c", script)
        assert (folder / "plan.png").stat().st_size > 10_000
    print(f"{wheel.name} works in a fresh environment")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
