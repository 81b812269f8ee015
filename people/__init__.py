"""People as models: how somebody walks next, for simulations and forecasts alike."""
