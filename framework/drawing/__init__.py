"""How pictures look, and the shapes in them; matplotlib is imported when something is drawn."""
