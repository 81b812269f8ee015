"""Git holds sources, pictures and small data; what compilers make is made where it is used."""

import subprocess
from pathlib import Path

import pytest

from wideberth.tests.house.test_packaging import ROOT

PICTURES, LARGEST_PICTURE = {".gif", ".png"}, 600_000
DATA, LARGEST_DATA = {".npz"}, 200_000
"""Suffixes, and bytes of the largest file."""
MADE = {".a", ".bc", ".dll", ".dylib", ".lib", ".ll", ".o", ".obj", ".pyd", ".so", ".whl", ".xz"}
"""Suffixes of what compilers and packers make, be it text."""


def refusal(path: Path) -> str | None:
    """Return why a file does not belong into git; None where it does."""
    content = path.read_bytes()
    if path.suffix in MADE:
        return "is made by a compiler"
    if path.suffix in PICTURES:
        return "is a large picture" if len(content) > LARGEST_PICTURE else None
    if path.suffix in DATA:
        return "is large" if len(content) > LARGEST_DATA else None
    return "is binary" if b"\0" in content else None


def test_no_binary_is_in_git() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if not listed.stdout:
        pytest.skip("no clone")
    names = [name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]
    refused = {name: why for name in names if (why := refusal(ROOT / name))}
    assert refused == {} and len(names) > 1000


@pytest.mark.parametrize(
    ("name", "content", "why"),
    [
        ("text.py", b"x = 1\n", None),
        ("core.ll", b"define void @f()", "is made by a compiler"),
        ("renamed.dat", b"\x7fELF\0", "is binary"),
        ("figure.png", b"\0" * 700_000, "is a large picture"),
        ("data.npz", b"\0" * 300_000, "is large"),
    ],
)
def test_what_is_refused(name: str, content: bytes, why: str | None, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    assert refusal(tmp_path / name) == why
