"""Models of people: how a person walks next, in simulations and in forecasts."""
