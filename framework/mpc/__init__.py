"""The MPC: the problem as a value, its transcription, the solvers, and the planner."""
