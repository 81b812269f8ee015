"""From ranges to wheels: robots that perceive one another, and drive on wheels."""
