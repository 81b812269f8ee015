"""A process that ends while one of its threads compiles waits for it: LLVM would crash it."""

import subprocess
import sys

ENDS = """
import atexit, threading, time

done = threading.Event()
atexit.register(lambda: print(done.wait(0.2)))  # after what is registered later
from wideberth.framework.jit import kernel_source, machine, module_source
from wideberth.framework.numerics.symbolic import ca

v, p = ca.SX.sym("v", 4), ca.SX.sym("p", 2)
x = v
for _ in range(40):
    x = ca.sin(x * p[0]) + ca.cos(ca.vertcat(x[1:], x[0])) * p[1]
rows = ca.vertcat(x, ca.vec(ca.jacobian(x, v)))
text = module_source([kernel_source(ca.Function("f", [v, p], [rows], {"cse": True}), "kernel")])
target, begun = machine.host(), threading.Event()

def compile():
    begun.set()
    machine.object_code(text, target)
    done.set()

threading.Thread(target=compile, daemon=True).start()
begun.wait()
time.sleep(0.05)
assert not done.is_set()
"""


def test_a_process_that_ends_waits_for_what_is_compiled() -> None:
    ran = subprocess.run([sys.executable, "-c", ENDS], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (0, "True\n"), ran.stderr
