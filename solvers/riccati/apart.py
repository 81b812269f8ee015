"""Compile the core in a process of its own, so that this one neither waits nor grows.

Numba holds Python's lock while it compiles and keeps some 300 MB; both end with that process.
"""

import atexit
import subprocess
import sys

from ...framework.jit.machine import host
from ...framework.values.errors import WideberthError
from . import emit


def compiled(kinds: int) -> bytes:
    """Return the core as object code for this processor.

    The other process ends with this one.

    Raises
    ------
    WideberthError : Numba is missing or switched off, or the other process fails.
    """
    emit.compiler()
    command = [sys.executable or "python", "-m", __name__, str(kinds)]
    try:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    except OSError as error:
        raise WideberthError(
            f"no process can be started to compile the solver: {error}"
        ) from error
    atexit.register(process.kill)
    code, said = process.communicate()
    atexit.unregister(process.kill)
    if process.returncode:
        last = said.decode(errors="replace").strip().splitlines()[-1:]
        why = "".join(last) or f"it ended with code {process.returncode}"
        raise WideberthError(f"the solver is not compiled: {why}")
    return code


if __name__ == "__main__":
    sys.stdout.buffer.write(emit.compiled(int(sys.argv[1]), host()))
