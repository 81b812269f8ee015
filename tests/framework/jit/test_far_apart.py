"""Sections of one object may lie nowhere near each other in a process that uses much memory."""

import subprocess
import sys

import pytest

OBJECT = """
define double @scaled(double %x) nounwind {
  %y = fmul double %x, 0x3FF3333333333333
  ret double %y
}
"""
"""Code that reads a constant from a section of its own, by its distance in 32 bits."""
FULL = """
import ctypes
import mmap
import sys
from wideberth.framework.jit import machine

RESERVED, WALL = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | 0x4000, 8 << 30  # MAP_NORESERVE
size, number = ctypes.c_size_t, ctypes.c_int
libc = ctypes.CDLL(None)
libc.mmap.restype = size
libc.mmap.argtypes = [size, size, number, number, number, ctypes.c_long]
libc.munmap.argtypes = [size, size]

def reserve(count):  # no memory, addresses alone
    found = libc.mmap(0, count, 0, RESERVED, -1, 0)
    assert found < 1 << 63, "no addresses are left"
    return found

code = machine.object_code(sys.argv[1], machine.host())
machine._linker(), machine._of_the_system()
wall, piece = reserve(WALL), WALL // 4
while piece >= mmap.PAGESIZE:  # fill every gap above the wall
    found = reserve(piece)
    if found < wall:
        libc.munmap(found, piece)
        piece //= 2
libc.munmap(wall + WALL - mmap.PAGESIZE, mmap.PAGESIZE)  # room for one section; no other above
place = machine.loaded(code, ["scaled"])["scaled"]
print(ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(place)(2.0))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="takes addresses by mmap")
def test_an_object_loads_where_memory_has_room_for_one_section_only() -> None:
    """LLVM's older loader puts the code into the gap, its constant 8 GiB away, and ends."""
    ran = subprocess.run(
        [sys.executable, "-c", FULL, OBJECT], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert float(ran.stdout) == 2.4
