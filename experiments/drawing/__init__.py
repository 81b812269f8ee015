"""Figures and films of episodes."""
