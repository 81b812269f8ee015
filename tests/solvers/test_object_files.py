"""Object files are packed so that a linker takes them."""

import pytest

from wideberth.framework.jit.machine import Target, object_code
from wideberth.framework.values.errors import WideberthError
from wideberth.solvers.export.object_files import archive, defined, wanted

TARGET = Target("x86_64-unknown-linux-gnu", "x86-64")
SOURCE = """
declare ptr @malloc(i64)
define ptr @found(i64 %size) {
  %place = call ptr @malloc(i64 %size)
  ret ptr %place
}
define internal i64 @hidden() noinline {
  ret i64 3
}
define i64 @three() {
  %three = call i64 @hidden()
  ret i64 %three
}
"""


@pytest.fixture(scope="module")
def code() -> bytes:
    return object_code(SOURCE, TARGET, optimise=False)


def test_names_that_are_defined_and_wanted(code: bytes) -> None:
    assert sorted(defined(code)) == ["found", "three"] and wanted(code) == ("malloc",)


def test_the_list_of_an_archive_leads_to_its_members(code: bytes) -> None:
    text = SOURCE.replace("@found", "@two").replace("@three", "@four")
    other = object_code(text, TARGET, optimise=False)
    packed = archive({"a.o": code, "odd.o": other + b"x", "c.o": code})
    assert packed.startswith(b"!<arch>\n")
    size = int(packed[8 + 48 : 8 + 58])
    table = packed[68 : 68 + size]
    count = int.from_bytes(table[:4], "big")
    places = [int.from_bytes(table[4 + 4 * k : 8 + 4 * k], "big") for k in range(count)]
    names = table[4 + 4 * count :].rstrip(b"\n").split(b"\0")[:count]
    found = [(name.decode(), packed[at : at + 16].decode().strip()) for name, at in
             zip(names, places, strict=True)]  # fmt: skip
    wanted_names = [*((one, "a.o/") for one in defined(code)),
                    *((one, "odd.o/") for one in defined(other)),
                    *((one, "c.o/") for one in defined(code))]  # fmt: skip
    assert found == wanted_names
    for at in places:
        length = int(packed[at + 48 : at + 58])
        assert packed[at + 58 : at + 60] == b"`\n" and at + 60 + length <= len(packed)
        assert packed[at + 60 : at + 64] == b"\x7fELF"


@pytest.mark.parametrize("text", [b"", b"\x7fELF\x01\x01" + bytes(80), b"!<arch>\n"])
def test_other_files_are_refused(text: bytes) -> None:
    with pytest.raises(WideberthError, match="no object file of 64-bit Linux"):
        defined(text)


def test_long_names_are_refused(code: bytes) -> None:
    with pytest.raises(WideberthError, match="too long for an archive"):
        archive({"sixteen-letters.o": code})
