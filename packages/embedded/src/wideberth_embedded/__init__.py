"""The planner as a C library without Python: forecasts, choices, solver, verification, rungs."""
