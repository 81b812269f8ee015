"""What the predictors are made of: batched arithmetic, one topic per file, no method of its own.

All of it works on every obstacle at once. A predictor gathers `history`, does its arithmetic
(`kalman_filter`, `least_squares`, `velocity_process`, `propagation`, ...) and turns the outcome
into a `Forecast` with `assembly`.
"""
