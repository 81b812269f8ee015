"""Simulation: scenarios, the engine that runs them, what agents sense, logs and measures."""
