"""Measures of forecasts, plans and episodes, each defined once.

Its modules are not promised, see docs/promise.md.
"""
