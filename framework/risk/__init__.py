"""The probability of a collision, and levels that keep it below a bound."""
