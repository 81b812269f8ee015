"""Run what pages show, as a reader does who has installed the wheel and has no clone.

Commands run in one folder, README and start page first, then page by page, and scripts in
another. A study runs with ``--quick`` and a seed or two, into the folder where the
page's command would leave its result.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path
from time import perf_counter

from wideberth.tests.house.test_pages import BEFORE, NOT_RUN, PAGES, ROOT, blocks, provide

CLONE = {"CONTRIBUTING.md", "docs/promise.md", "docs/negative-results.md"}
"""Pages about work on the package, in a clone."""
ELSEWHERE = {
    r"(make (?!-C)|git |pip |source |\. env|python3 -m )": "installs, or works in a clone",
    r"python benchmarks/": "measures in a clone",
    r"(dask|openssl|TLS=|export DASK_)|.* --scheduler": "needs several machines",
    r"wideberth (node|forecast|world) ": "needs ROS 2",
    r".*(THOR_MAGNI|labels_3d|biwi_hotel|my_bag)": "needs others' data",
    r".*(results/(magni|jrdb)|forecasts=FOLDER|tracks=FOLDER)": "needs others' data",
    r".*(solve-28c34182c698|results/solves)": "needs a recorded solve",
    r"(cc |\./drive)": "needs the reader's own drive.c",
    r"(for|done)\b": "needs others' data",
}
"""Commands that are not run, by what they begin with, and why."""
SETTINGS = {"docs/report.md": "blind_corner", "docs/results.md": "prediction_benchmark"}
"""Pages that speak of the results of a study which others run."""
LONGEST = 900
"""s, of a command."""


def commands() -> list[tuple[str, str]]:
    """Return every different command of the pages, with the first page that shows it."""
    first = ["README.md", "docs/start.md"]
    found: dict[str, str] = {}
    for page in [*first, *(one for one in PAGES if one not in CLONE.union(first))]:
        if page in SETTINGS:
            found.setdefault(f"wideberth run {SETTINGS[page]} --fresh", page)
        for block in blocks(page, "sh", "bash"):
            for line in block.replace("\\\n", " ").splitlines():
                command = " ".join(re.sub(r"\s#\s.*", "", line).split())
                if command and not command.startswith("#"):
                    found.setdefault(command, page)
    return [(page, command) for command, page in found.items()]


def shortened(command: str) -> str:
    """Return the command of a study with few seeds, and its result where the page expects it."""
    if not (study := re.match(r"wideberth run (\w+)", command)):
        return command
    command = re.sub(r"seeds=(\d+)", lambda one: f"seeds={1 + (int(one[1]) > 5)}", command)
    if "--quick" not in command:
        command += " --quick"
        command += "" if "--out" in command else f" --out results/{study[1]}"
    return command


def run(python: Path, folder: Path) -> int:
    """Run all commands and scripts of the pages with the Python of a wheel; count failures."""
    for one in (folder / "commands", folder / "scripts"):
        one.mkdir(parents=True)
        provide(one)
    shutil.copytree(ROOT / "examples", folder / "commands" / "examples")
    programs = python.absolute().parent
    environment = {
        **os.environ, "PATH": f"{programs}:{os.environ['PATH']}", "PYTHONPATH": ".",
        "MPLBACKEND": "Agg", "BROWSER": "true",
    }  # fmt: skip
    failed = ran = 0
    for page, command in commands():
        if why := [reason for start, reason in ELSEWHERE.items() if re.match(start, command)]:
            print(f"-        {page}: {command}: {why[0]}", flush=True)
            continue
        ran += 1
        failed += not _works(
            page, ["bash", "-c", shortened(command)], folder / "commands", environment
        )
    for page in sorted(one for one in PAGES if blocks(one, "python")):
        if page not in NOT_RUN | {"docs/write-your-own.md"}:  # runs in parts, see test_readme.py
            ran += 1
            script = "\n".join([BEFORE.get(page, ""), *blocks(page, "python")])
            failed += not _works(page, ["python", "-c", script], folder / "scripts", environment)
    print(f"{ran} commands and scripts of pages ran, {failed} failed")
    return failed


def _works(page: str, words: list[str], folder: Path, environment: dict[str, str]) -> bool:
    """Run a command; say how it went, and how it failed."""
    begin = perf_counter()
    try:
        done = subprocess.run(
            words, cwd=folder, env=environment, text=True, timeout=LONGEST,
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        error = f"{done.stdout[-600:]}\n" if done.returncode else ""
    except subprocess.TimeoutExpired:
        error = "it takes too long"
    shown = words[-1] if words[0] == "bash" else "its Python"
    print(f"{'FAILS' if error else 'ok':<5} {perf_counter() - begin:3.0f} s  {page}: {shown}")
    print(error, end="", flush=True)
    return not error
