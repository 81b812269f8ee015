"""Batched arithmetic for the predictors, one topic per file.

All of it works on every obstacle at once. A predictor gathers `history`, does its arithmetic
(`kalman_filter`, `least_squares`, `velocity_process`, `propagation`, ...) and turns the outcome
into a `Forecast` with `assembly`.
"""
