"""A process that ends while one of its threads compiles ends well."""

import subprocess
import sys

ENDS = """
import sys, threading, time
from wideberth.framework.jit import kernel_source, machine, module_source
from wideberth.framework.numerics.symbolic import ca

v, p = ca.SX.sym("v", 4), ca.SX.sym("p", 2)
x = v
for _ in range(60):
    x = ca.sin(x * p[0]) + ca.cos(ca.vertcat(x[1:], x[0])) * p[1]
rows = ca.vertcat(x, ca.vec(ca.jacobian(x, v)))
text = module_source([kernel_source(ca.Function("f", [v, p], [rows], {"cse": True}), "kernel")])
target = machine.host()
threading.Thread(target=machine.object_code, args=(text, target), daemon=True).start()
time.sleep(float(sys.argv[1]))
"""
DELAYS = (0.1, 0.2, 0.3, 0.5)
"""s after which it ends; compiling takes about one."""


def test_a_thread_that_compiles_does_not_crash_a_process_that_ends() -> None:
    words = [sys.executable, "-c", ENDS]
    running = [
        subprocess.Popen([*words, str(one)], stderr=subprocess.PIPE, text=True) for one in DELAYS
    ]
    said = [one.communicate()[1] for one in running]
    assert [one.returncode for one in running] == [0] * len(DELAYS), said
