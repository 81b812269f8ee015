"""Measures of forecasts, plans and episodes, each defined once."""
