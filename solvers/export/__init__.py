"""The problem as C, for those who embed the planner in a controller of their own.

`wideberth.solvers.export.bundle` makes the files of one problem.
"""
