"""Studies of what each choice costs, the engine that runs them, and the command line.

Its modules are not promised, see docs/promise.md.
"""
