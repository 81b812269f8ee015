"""Configs that `wideberth run NAME` finds by their names."""
