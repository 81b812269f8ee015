"""Nav2's local controllers, and the loop that they run in.

Its modules are not promised, see docs/promise.md.
"""
