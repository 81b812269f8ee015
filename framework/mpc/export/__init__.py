"""The problem as C, for those who embed the planner in a controller of their own.

`wideberth.framework.mpc.export.bundle` makes the files of one problem.
"""
