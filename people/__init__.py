"""Models of people: how a person walks next, in simulations and in forecasts.

Its modules are not promised, see docs/promise.md.
"""
