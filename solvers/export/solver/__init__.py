"""The solver as object code, for a controller in C that has neither Python nor a compiler of ours.

`wideberth.solvers.export.solver.files` makes the files of one problem.
"""
