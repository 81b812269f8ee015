"""Simulation: scenarios, the engine that runs them, what agents sense, logs and measures.

Its modules are not promised, see docs/promise.md.
"""
