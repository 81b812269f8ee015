"""Recorded tracks and forecasts: their readers, and the windows that predictors are fitted to."""
