"""A package that extends wideberth: a predictor, a study, a config and a command."""
